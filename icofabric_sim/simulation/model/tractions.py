# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Surface forces for the kernels: the wrenches on all faces of a body become one row."""

from collections.abc import Sequence
from typing import NamedTuple

from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.scene.profiles import Piece
from icofabric_sim.scene.tractions import FaceWrench
from icofabric_sim.simulation.model.layout import aligned_zeros, Layout
from icofabric_sim.terms.tractions.record import Tractions
from icofabric_sim.terms.tractions.sums import FIXED, SLIDING, TURNING
import numpy as np

# Ratio of a sum of forces to the sum of magnitudes below which the sum is round-off.
_ROUND_OFF_RATIO = 1e-15
# Entries of a symmetric tensor: xx, xy, xz, yy, yz, zz.
_PAIRS = np.triu_indices(3)


class BodyTraction(NamedTuple):
    """A surface force summed over the faces of each body; None for a type without faces."""

    bodies: np.ndarray  # (m,) int32
    turning: np.ndarray | None  # (m, 6) force [N] and torque [N m], body axes
    fixed: np.ndarray | None  # (m, 12) force [N], world, and first moments [N m] by its axes
    sliding: np.ndarray | None  # (m, 45) see terms/tractions/record.py
    force: np.ndarray  # (m,) [N] bound
    moment: np.ndarray  # (m,) [N m] bound


class TractionRow(NamedTuple):
    """A surface force, and the profile that scales it."""

    sums: BodyTraction
    piece: Piece  # at times of the run


class TractionPack(NamedTuple):
    """All surface forces of a scene for the kernels."""

    rows: Sequence[TractionRow]  # those that act
    # All of the scene, also those that act at other times: kernels stay the same.
    scene: Sequence[BodyTraction]


def sum_faces(wrenches: Sequence[FaceWrench]) -> BodyTraction:
    """Return the sum of the wrenches on the faces of each body."""
    bodies = np.unique(np.concatenate(
        [np.zeros(0, np.int32), *(part.bodies for part in wrenches)])).astype(np.int32)
    count = len(bodies)
    turning, fixed, sliding = (np.zeros((count, n)) for n in (TURNING, FIXED, SLIDING))
    force, sizes, slid, moment = (np.zeros(count) for _ in range(4))
    kinds = set()
    for part in wrenches:
        rows = np.searchsorted(bodies, part.bodies)
        size = float(np.linalg.norm(part.force))
        lever = np.cross(part.point, part.normal)
        if part.in_body_axes:
            kinds.add('turning')
            turning[rows] += np.hstack([
                part.force, part.torque + np.cross(part.point, part.force)])
        elif part.normal.any():
            kinds.add('sliding')
            pushed = np.outer(part.normal, part.force)
            sliding[rows] += np.concatenate([
                np.multiply.outer(part.normal, pushed)[_PAIRS].ravel(),
                np.multiply.outer(lever, pushed).ravel()])
            slid[rows] += size
            moment[rows] += size * float(np.linalg.norm(lever))
        else:
            kinds.add('fixed')
            fixed[rows] += np.concatenate([part.force, np.outer(part.force, part.point).ravel()])
            sizes[rows] += size
    own = np.where(np.abs(fixed[:, :3]) > _ROUND_OFF_RATIO * sizes[:, None], fixed[:, :3], 0.0)
    fixed[:, :3] = own
    force = np.linalg.norm(turning[:, :3], axis=1) + np.linalg.norm(own, axis=1) + slid
    # The torque of first moments S is at most sqrt(2) |S|, however the body is turned.
    moment += np.linalg.norm(turning[:, 3:], axis=1)
    moment += np.sqrt(2.0) * np.linalg.norm(fixed[:, 3:], axis=1)
    return BodyTraction(
        bodies, turning if 'turning' in kinds else None, fixed if 'fixed' in kinds else None,
        sliding if 'sliding' in kinds else None, force, moment)


def pack_tractions(
    pack: TractionPack, layout: Layout, first: int, block: np.ndarray, wrench: np.ndarray,
    lanes: np.ndarray
) -> Tractions:
    """
    Pack all surface forces that act, with lanes side by side.

    `first` is the number of the first surface force among the wrenches; `block`, `wrench` and
    `lanes` (m,) belong to the rows of the loads.
    """
    mine = np.flatnonzero(wrench >= first)
    place = np.zeros(len(wrench), np.int64)
    place[mine] = np.arange(len(mine))
    acts = np.unpackbits(lanes[mine, None], axis=1, count=LANES, bitorder='little').astype(bool)
    # The row here and the lane of every body of every surface force.
    found = []
    for number, row in enumerate(pack.rows):
        row_of_block = np.full(len(layout.blocks.slot), -1, np.int64)
        own = mine[wrench[mine] == first + number]
        row_of_block[block[own]] = place[own]
        lane = layout.slot[row.sums.bodies] % LANES
        r = row_of_block[layout.block_of(row.sums.bodies)]
        # Not those that a drive moves.
        acting = np.flatnonzero(r >= 0)
        acting = acting[acts[r[acting], lane[acting]]]
        found.append((acting, r[acting], lane[acting]))

    def spread(field: str, count: int) -> np.ndarray | None:
        if all(getattr(sums, field) is None for sums in pack.scene):
            return None
        flat = aligned_zeros((len(mine) * count * LANES,))
        table = flat.reshape(len(mine), count, LANES)
        for row, (acting, r, lane) in zip(pack.rows, found):
            values = getattr(row.sums, field)
            if values is not None:
                table[r, :, lane] = values[acting].reshape(len(acting), count)
        return flat

    force, moment = spread('force', 1), spread('moment', 1)
    assert force is not None and moment is not None
    kept = aligned_zeros((len(mine) * 6 * LANES,))
    return Tractions(
        kept=kept, first=first, place=place, turning=spread('turning', TURNING),
        fixed=spread('fixed', FIXED), sliding=spread('sliding', SLIDING), force=force,
        moment=moment)
