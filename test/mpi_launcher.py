# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The launcher of MPI, where there is one."""

from pathlib import Path
import shutil
import sys

import pytest


def launcher():
    """Return the launcher of the MPI library beside this Python, or of the machine."""
    pytest.importorskip('mpi4py', reason='mpi4py (extra `mpi`) is not installed')
    found = shutil.which('mpiexec', path=str(Path(sys.executable).parent)) or shutil.which(
        'mpiexec')
    if found is None:
        pytest.skip('no mpiexec on this machine')
    return found
