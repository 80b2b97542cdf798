# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Compiled loops over bodies and connectors; each also runs as plain Python with NUMBA_DISABLE_JIT=1.
"""

# Checks whether Numba is imported already, and so comes before all other imports of kernels.
from icofabric_sim.kernels.runtime import target  # noqa: F401
