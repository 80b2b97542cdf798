# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Where the drives of a run stand: on the paths of the scene, or taken over by a received twist.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from icofabric_sim.scene.drives import Drive
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.scene.paths import PathPiece
from icofabric_sim.simulation.checkpoints.state_tree import as_number, StateTree
from icofabric_sim.simulation.inputs.input_types import (
    DriveTarget,
    restored_target,
    stored_target,
    Twist,
)
from icofabric_sim.simulation.inputs.timetable import Timetable
import numpy as np


class DriveRow(NamedTuple):
    """Bodies on a piece of a path, at times of the run."""

    bodies: np.ndarray  # (m,) int32
    middle: np.ndarray  # (3,) [m] mean of their centres at the start
    piece: PathPiece
    moves: np.ndarray  # (4,) bool: along x, y, z, and turning


class DrivePack(NamedTuple):
    """What kernels need of all drives."""

    rows: tuple[DriveRow, ...]
    arm: np.ndarray  # (n, 3) [m] from the middle to each body at the start
    start: InitialState


class Driving:
    """The drives of a scene, the timetable of their paths, and the twists that took over."""

    def __init__(
        self, drives: Mapping[str, Drive], start: InitialState, timetable: Timetable
    ) -> None:
        """Begin on the paths of the scene; `start` is its initial state."""
        self._drives = {DriveTarget(name): drive for name, drive in drives.items()}
        self._start, self._timetable = start, timetable
        # Pages of memory that are never written take no room.
        self._arm = np.zeros(start.position.shape)
        for drive in drives.values():
            self._arm[drive.bodies] = start.position[drive.bodies] - drive.middle
        self.taken: dict[DriveTarget, PathPiece] = {}
        # Numbers of the pieces, or the twists, that were packed last.
        self._packed: dict[DriveTarget, int | PathPiece] = {}

    def take_over(self, target: DriveTarget, time: float, twist: Twist) -> None:
        """Go on with one twist from where a drive is at `time` [s]."""
        pose = self.taken.get(target, self._timetable.piece(target)).pose_at(time)
        self.taken[target] = PathPiece.constant_twist(time, pose, twist.linear, twist.angular)

    def adopt(self, other: 'Driving') -> None:
        """Take over the twists of a run that goes on here."""
        self.taken = {
            target: piece for target, piece in other.taken.items() if target in self._drives}

    def pack(self) -> DrivePack | None:
        """What moves them now."""
        self._packed = {
            target: self._timetable.numbers.get(target, 0) for target in self._drives}
        self._packed.update(self.taken)
        return self.pack_again()

    def pack_again(self) -> DrivePack | None:
        """What was packed last."""
        if not self._drives:
            return None
        rows = []
        for target, drive in self._drives.items():
            kept = self._packed.get(target, 0)
            if not isinstance(kept, PathPiece):
                kept = self._timetable.piece(target, kept)
            rows.append(DriveRow(drive.bodies, drive.middle, kept, drive.moves))
        return DrivePack(tuple(rows), self._arm, self._start)

    def state_tree(self) -> dict[str, Any]:
        """The twists that rule, and what was packed."""
        return {
            'taken': [
                [stored_target(target), *_numbers(self.taken[target])]
                for target in sorted(self.taken, key=str)],
            'packed': [
                [stored_target(target), *([kept] if isinstance(kept, int) else _numbers(kept))]
                for target, kept in sorted(self._packed.items(), key=lambda item: str(item[0]))],
        }

    def load_state(self, tree: StateTree) -> None:
        """Go on from there."""
        taken: dict[DriveTarget, PathPiece] = {}
        packed: dict[DriveTarget, int | PathPiece] = {}
        for entry in tree.entries('taken'):
            target, piece = self._entry(entry)
            if isinstance(piece, int):
                raise ValueError(f'inputs.driving.taken has no twist for {target}')
            taken[target] = piece
        for entry in tree.entries('packed'):
            target, packed[target] = self._entry(entry)
        self.taken, self._packed = taken, packed

    def _entry(self, entry: Any) -> tuple[DriveTarget, int | PathPiece]:
        target = None
        if isinstance(entry, list) and len(entry) in (2, 15):
            target = restored_target(entry[0])
        if not isinstance(target, DriveTarget) or target not in self._drives:
            raise ValueError('inputs.driving has an entry that is not of a drive of the scene')
        rest = entry[1:]
        if len(rest) == 1:
            known = self._timetable.known_numbers([entry]) if rest[0] != 0 else {target: 0}
            return target, known[target]
        values = np.array([as_number(value) for value in rest], dtype=float)
        if not np.isfinite(values).all():
            raise ValueError(f'inputs.driving has no finite numbers for {target}')
        return target, PathPiece.constant_twist(
            float(values[0]), (values[1:4], values[4:8]), values[8:11], values[11:])


def _numbers(piece: PathPiece) -> list[float]:
    """Start, displacement, quaternion and twist of a piece with a constant twist."""
    return [piece.start, *piece.shift, *piece.turn, *piece.cubic[1]]
