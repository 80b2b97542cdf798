# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The contestants: the package, and each peer that is installed."""

from collections.abc import Iterable
from typing import NamedTuple

from icofabric_validation.benchmarks import own
from icofabric_validation.benchmarks.peers import PEERS
from icofabric_validation.benchmarks.scenes import PlainScene
from icofabric_validation.benchmarks.solver import Solver


class Contestants(NamedTuple):
    """Solvers, and why others are missing."""

    solvers: list[Solver]
    distributions: list[str]  # of the peers that take part
    missing: list[str]  # one line for each that does not


def gather(
    scene: PlainScene, size: tuple[int, int, int], peers: Iterable[str],
    changes: own.Changes = None
) -> Contestants:
    """Our own methods first, then the solvers of `peers` (keys of PEERS)."""
    solvers, distributions, missing = list(own.solvers(size, changes)), [], []
    for name in peers:
        peer = PEERS[name]
        try:
            solvers += list(peer.solvers(scene))
            distributions.append(peer.DISTRIBUTION)
        except (ImportError, OSError) as error:
            reason = str(error).splitlines()[0] if str(error) else 'not installed'
            missing.append(f'{name} takes no part ({reason}): {peer.INSTALL}')
    return Contestants(solvers, distributions, missing)
