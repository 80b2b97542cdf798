# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Present motion of drives and planes of a run: the paths of the scene, or received twists instead.
"""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from icofabric_sim.scene.drives import Drive
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.scene.paths import PathPiece
from icofabric_sim.simulation.checkpoints.state_tree import as_number, StateTree
from icofabric_sim.simulation.inputs.input_types import (
    DriveTarget,
    PathTarget,
    PlaneTarget,
    restored_target,
    stored_target,
    Twist,
)
from icofabric_sim.simulation.inputs.timetable import Timetable
import numpy as np

# Bodies, centroid and freedoms of a plane.
_PLANE = np.zeros(0, np.int32), np.zeros(3), np.array([True, True, True, False])


class DriveRow(NamedTuple):
    """Bodies, or a plane, on a segment of a path, at times of the run."""

    bodies: np.ndarray  # (m,) int32; none for a plane, whose carrier moves
    middle: np.ndarray  # (3,) [m] mean of their centres at the start
    piece: PathPiece
    moves: np.ndarray  # (4,) bool: translation along x, y, z, and rotation


class DrivePack(NamedTuple):
    """All drives, then all planes that may move, for the kernels."""

    rows: tuple[DriveRow, ...]
    arm: np.ndarray  # (n, 3) [m] from the middle to each body at the start
    start: InitialState


class Driving:
    """
    Drives and planes of a scene, with the timetable of their paths and the twists instead of them.
    """

    def __init__(
        self, drives: Mapping[str, Drive], planes: Iterable[str], start: InitialState,
        timetable: Timetable
    ) -> None:
        """Start on the paths of the scene; `start` is its initial state."""
        # Bodies, their centroid, and freedoms.
        self._driven: dict[PathTarget, tuple[np.ndarray, np.ndarray, np.ndarray]] = {
            DriveTarget(name): (drive.bodies, drive.middle, drive.moves)
            for name, drive in drives.items()}
        self._driven |= {PlaneTarget(name): _PLANE for name in planes}
        self._start, self._timetable = start, timetable
        # Memory pages that are never written to use no memory.
        self._arm = np.zeros(start.position.shape)
        for drive in drives.values():
            self._arm[drive.bodies] = start.position[drive.bodies] - drive.middle
        self.taken: dict[PathTarget, PathPiece] = {}
        # Numbers of the segments, or the twists, that were packed last.
        self._packed: dict[PathTarget, int | PathPiece] = {}

    def take_over(self, target: PathTarget, time: float, twist: Twist) -> None:
        """Continue the motion of a drive or plane from `time` [s] with a constant twist."""
        pose = self.taken.get(target, self._timetable.piece(target)).pose_at(time)
        self.taken[target] = PathPiece.constant_twist(time, pose, twist.linear, twist.angular)

    def adopt(self, other: 'Driving') -> None:
        """Adopt the twists of a run that continues in this scene."""
        self.taken = {
            target: piece for target, piece in other.taken.items() if target in self._driven}

    def displacement(self, target: PathTarget, time: float) -> np.ndarray:
        """Return the displacement (3,) [m] since the start of the motion at a `time` [s]."""
        piece = self.taken.get(target, self._timetable.piece(target))
        return np.asarray(piece.pose_at(time)[0])

    def pack(self) -> DrivePack | None:
        """Return the present motion of the drives."""
        self._packed = {
            target: self._timetable.numbers.get(target, 0) for target in self._driven}
        self._packed.update(self.taken)
        return self.pack_again()

    def pack_again(self) -> DrivePack | None:
        """Return the motion that was packed last."""
        if not self._driven:
            return None
        rows = []
        for target, (bodies, middle, moves) in self._driven.items():
            kept = self._packed.get(target, 0)
            if not isinstance(kept, PathPiece):
                kept = self._timetable.piece(target, kept)
            rows.append(DriveRow(bodies, middle, kept, moves))
        return DrivePack(tuple(rows), self._arm, self._start)

    def state_tree(self) -> dict[str, Any]:
        """Return the active twists and the motion that was packed last."""
        return {
            'taken': [
                [stored_target(target), *_numbers(self.taken[target])]
                for target in sorted(self.taken, key=str)],
            'packed': [
                [stored_target(target), *([kept] if isinstance(kept, int) else _numbers(kept))]
                for target, kept in sorted(self._packed.items(), key=lambda item: str(item[0]))],
        }

    def load_state(self, tree: StateTree) -> None:
        """Restore the motion from a checkpoint."""
        taken: dict[PathTarget, PathPiece] = {}
        packed: dict[PathTarget, int | PathPiece] = {}
        for entry in tree.entries('taken'):
            target, piece = self._entry(entry)
            if isinstance(piece, int):
                raise ValueError(f'inputs.driving.taken has no twist for {target}')
            taken[target] = piece
        for entry in tree.entries('packed'):
            target, packed[target] = self._entry(entry)
        self.taken, self._packed = taken, packed

    def _entry(self, entry: Any) -> tuple[PathTarget, int | PathPiece]:
        target = None
        if isinstance(entry, list) and len(entry) in (2, 15):
            target = restored_target(entry[0])
        if not isinstance(target, (DriveTarget, PlaneTarget)) or target not in self._driven:
            raise ValueError(
                'inputs.driving has an entry that is not of a drive or plane of the scene')
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
    """Return start, displacement, quaternion and twist of a path segment with a constant twist."""
    return [piece.start, *piece.shift, *piece.turn, *piece.cubic[1]]
