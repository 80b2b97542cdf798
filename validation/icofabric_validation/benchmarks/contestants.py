# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The package and all installed peers."""

from collections.abc import Iterable
from typing import NamedTuple

from icofabric_validation.benchmarks import own_methods
from icofabric_validation.benchmarks.peers import PEERS
from icofabric_validation.benchmarks.scenes import PlainScene
from icofabric_validation.benchmarks.solver import Solver


class Contestants(NamedTuple):
    """Solvers, and the reasons why others are missing."""

    solvers: list[Solver]
    distributions: list[str]  # of the installed peers
    missing: list[str]  # one line for each missing peer


def gather(
    scene: PlainScene, size: tuple[int, int, int], peers: Iterable[str],
    changes: own_methods.Changes = None
) -> Contestants:
    """Return the methods of the package, then the solvers of `peers` (keys of PEERS)."""
    solvers, distributions, missing = list(own_methods.solvers(size, changes)), [], []
    for name in peers:
        peer = PEERS[name]
        try:
            solvers += list(peer.solvers(scene))
            distributions.append(peer.DISTRIBUTION)
        except (ImportError, OSError) as error:
            reason = str(error).splitlines()[0] if str(error) else 'not installed'
            missing.append(f'{name} takes no part ({reason}): {peer.INSTALL}')
    return Contestants(solvers, distributions, missing)
