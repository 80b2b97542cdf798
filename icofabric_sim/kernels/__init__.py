# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Compiled loops over bodies and connectors; each also runs as plain Python with NUMBA_DISABLE_JIT=1.
"""

# Looks whether Numba is there already, so before anything of the kernels imports it.
from icofabric_sim.kernels.runtime import target  # noqa: F401
