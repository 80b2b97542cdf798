# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Other tools on the same scene; the package needs none of them.

Every module has `DISTRIBUTION`, its name in the Python package index, `INSTALL`, the install
command, and `solvers(scene)`, which raises ImportError if the tool is missing.
"""

from icofabric_validation.benchmarks.peers import (
    drake_peer,
    exudyn_peer,
    lammps_peer,
    mujoco_peer,
    scipy_peer,
)

PEERS = {
    'scipy': scipy_peer,
    'lammps': lammps_peer,
    'mujoco': mujoco_peer,
    'exudyn': exudyn_peer,
    'drake': drake_peer,
}
