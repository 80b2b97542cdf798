# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Where the drives of a run stand: on the paths of the scene, or taken over by a received twist.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from icofabric_sim.scene.drives import Drive
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.scene.paths import PathPiece
from icofabric_sim.simulation.state_tree import as_number, Memory
from icofabric_sim.simulation.timetable import Timetable
import numpy as np

PREFIX = 'drives.'


class DriveRow(NamedTuple):
    """Bodies on a piece of a path, at times of the run."""

    bodies: np.ndarray  # (m,) int32
    middle: np.ndarray  # (3,) [m] mean of their centres at the start
    piece: PathPiece


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
        self._drives, self._start, self._timetable = drives, start, timetable
        self._arm = np.zeros_like(start.position)
        for drive in drives.values():
            self._arm[drive.bodies] = start.position[drive.bodies] - drive.middle
        self.taken: dict[str, PathPiece] = {}
        # Numbers of the pieces, or the twists, that were packed last.
        self._packed: dict[str, int | PathPiece] = {}

    def knows(self, key: object) -> bool:
        """Whether a key of an input is one of these drives."""
        return isinstance(key, str) and key.startswith(PREFIX) and (
            key.removeprefix(PREFIX) in self._drives)

    def require(self, name: str) -> None:
        """Refuse a drive that the scene lacks."""
        if name not in self._drives:
            known = ', '.join(self._drives) or 'none'
            raise ValueError(
                f'there is no drive {name!r}; known: {known}. Define it with drives.{name}.group')

    def take_over(self, key: str, time: float, linear: np.ndarray, angular: np.ndarray) -> None:
        """Go on from where a drive is at `time` [s] with one velocity [m/s] and spin [rad/s]."""
        pose = self.taken.get(key, self._timetable.piece(key)).pose_at(time)
        self.taken[key] = PathPiece.constant_twist(time, pose, linear, angular)

    def adopt(self, other: 'Driving') -> None:
        """Take over the twists of a run that goes on here."""
        self.taken = {key: piece for key, piece in other.taken.items() if self.knows(key)}

    def pack(self) -> DrivePack | None:
        """What moves them now."""
        self._packed = {
            PREFIX + name: self._timetable.numbers.get(PREFIX + name, 0) for name in self._drives}
        self._packed.update(self.taken)
        return self.pack_again()

    def pack_again(self) -> DrivePack | None:
        """What was packed last."""
        if not self._drives:
            return None
        rows = []
        for name, drive in self._drives.items():
            kept = self._packed.get(PREFIX + name, 0)
            if not isinstance(kept, PathPiece):
                kept = self._timetable.piece(PREFIX + name, kept)
            rows.append(DriveRow(drive.bodies, drive.middle, kept))
        return DrivePack(tuple(rows), self._arm, self._start)

    def memory(self) -> dict[str, Any]:
        """The twists that rule, and what was packed."""
        return {
            'taken': [[key, *_numbers(self.taken[key])] for key in sorted(self.taken)],
            'packed': [
                [key, kept] if isinstance(kept, int) else [key, *_numbers(kept)]
                for key, kept in sorted(self._packed.items(), key=lambda item: item[0])],
        }

    def recall(self, memory: Memory) -> None:
        """Go on from there."""
        taken: dict[str, PathPiece] = {}
        packed: dict[str, int | PathPiece] = {}
        for entry in memory.entries('taken'):
            key, piece = self._entry(entry)
            if isinstance(piece, int):
                raise ValueError(f'inputs.driving.taken has no twist for {key}')
            taken[key] = piece
        for entry in memory.entries('packed'):
            key, packed[key] = self._entry(entry)
        self.taken, self._packed = taken, packed

    def _entry(self, entry: Any) -> tuple[str, int | PathPiece]:
        if not isinstance(entry, list) or len(entry) not in (2, 15) or not self.knows(entry[0]):
            raise ValueError('inputs.driving has an entry that is not of a drive of the scene')
        key, *rest = entry
        if len(rest) == 1:
            known = self._timetable.known_numbers([entry]) if rest[0] != 0 else {key: 0}
            return key, known[key]
        values = np.array([as_number(value) for value in rest], dtype=float)
        if not np.isfinite(values).all():
            raise ValueError(f'inputs.driving has no finite numbers for {key}')
        return key, PathPiece.constant_twist(
            float(values[0]), (values[1:4], values[4:8]), values[8:11], values[11:])


def _numbers(piece: PathPiece) -> list[float]:
    """Start, displacement, quaternion and twist of a piece with a constant twist."""
    return [piece.start, *piece.shift, *piece.turn, *piece.cubic[1]]
