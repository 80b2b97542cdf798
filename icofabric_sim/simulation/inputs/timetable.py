# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""When the pieces of the profiles and paths of a scene begin, and which of them rule now."""

from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Any

from icofabric_sim.scene.paths import Path
from icofabric_sim.scene.profiles import Profile
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.inputs.input_types import ChannelTarget, DriveTarget, stored_target


@dataclass(frozen=True, slots=True)
class TractionProfile:
    """The profile of `tractions.NAME`."""

    name: str

    def __str__(self) -> str:
        return f'tractions.{self.name}'


@dataclass(frozen=True, slots=True)
class AnchorPath:
    """The path of `anchors.NAME`."""

    name: str

    def __str__(self) -> str:
        return f'anchors.{self.name}'


@dataclass(frozen=True, slots=True)
class FieldProfile:
    """The profile of the electric field."""

    def __str__(self) -> str:
        return 'field.electric'


# A pulse is half a wave of a sine, or less. One that lasts fewer given steps than the first gets
# shorter ones, with which a method misses about the second, a part of its impulse.
_HALF_WAVE = math.pi * (1.0 + 1e-9)
_FEW_STEPS, _MISSED_IMPULSE = 8, 1e-5
# Radians of a longer sine in a given step, at most, whatever is stable.
_LARGEST_ANGLE = 2.0 * math.pi

# What follows a profile or a path.
Follower = ChannelTarget | DriveTarget | TractionProfile | AnchorPath | FieldProfile


class Timetable:
    """Profiles by what follows them, counted from the time at which the motion began."""

    def __init__(self, profiles: Mapping[Follower, Profile | Path]) -> None:
        """Begin at time 0."""
        self._pieces: dict[Follower, tuple[Any, ...]] = {
            name: profile.pieces for name, profile in profiles.items() if len(profile.pieces) > 1}
        # When they begin [s]; a pulse in parts is there once for each of them.
        self._starts = {
            name: tuple(piece.start for piece in pieces) for name, pieces in self._pieces.items()}
        self._by_stored_name = {_stored(name): name for name in self._pieces}
        self._steady = {
            name: profile.pieces[0] for name, profile in profiles.items()
            if len(profile.pieces) == 1}
        self.epoch = 0.0  # [s] when the motion began
        self.numbers: dict[Follower, int] = {}
        self.begin(0.0)

    def follow(self, step: float, order: int, stability: float) -> None:
        """
        Have a given `step` [s] follow the profiles: a pulse of few steps is taken in parts.

        `order` and `stability` (radians in a step) of the method. Call before the motion begins;
        ValueError names a sine that the step cannot follow.
        """
        angle = min(stability, _LARGEST_ANGLE)
        count = max(_FEW_STEPS, math.ceil(_MISSED_IMPULSE ** (-1.0 / order)))
        for name, piece in self._steady.items():
            _require_followed(name, piece, step, angle)
        for name, starts in self._starts.items():
            parts, begins = [], []
            for piece, start, end in zip(self._pieces[name], starts, (*starts[1:], math.inf)):
                number = 1
                if piece.rate * (end - start) > _HALF_WAVE:
                    _require_followed(name, piece, step, angle)
                elif piece.rate > 0.0 and end - start < _FEW_STEPS * step:
                    number = count
                parts += [piece] * number
                begins += [start + k * (end - start) / number if k else start
                           for k in range(number)]
            self._pieces[name], self._starts[name] = tuple(parts), tuple(begins)

    def part_length(self, numbers: Mapping[Follower, int]) -> float:
        """Length [s] of the shortest part of a pulse of these numbers; infinite without one."""
        shortest = math.inf
        for name, number in numbers.items():
            pieces, starts = self._pieces[name], self._starts[name]
            for k in (number, number - 1):
                if 0 <= k < len(pieces) - 1 and pieces[k] is pieces[k + 1]:
                    shortest = min(shortest, starts[k + 1] - starts[k])
        return shortest

    def begin(self, epoch: float, now: float | None = None) -> None:
        """Count from `epoch` [s], and stand `now` [s], or there."""
        self.epoch = epoch
        now = epoch if now is None else now
        self.numbers = dict.fromkeys(self._pieces, 0)
        while self.next_time <= now:
            self.turn()

    @property
    def next_time(self) -> float:
        """Time [s] at which the next piece begins; infinite where none does."""
        return min((self._next(name) for name in self._pieces), default=math.inf)

    def turn(self) -> list[Follower]:
        """Let the next pieces begin; returns whose they are."""
        time = self.next_time
        begun = [name for name in self._pieces if self._next(name) <= time]
        for name in begun:
            self.numbers[name] += 1
        return begun

    def piece(self, name: Follower, number: int | None = None) -> Any:
        """The piece of a profile that rules now, or number `number`, at times of the run."""
        if name in self._steady:
            piece: Any = self._steady[name]
            return piece._replace(start=self.epoch + piece.start)
        number = self.numbers[name] if number is None else number
        piece = self._pieces[name][number]
        return piece._replace(start=self.epoch + piece.start)

    def state_tree(self) -> dict[str, Any]:
        """What rules, and since when it is counted."""
        return {'epoch': self.epoch, 'numbers': self.listing(self.numbers)}

    def load_state(self, tree: StateTree, now: float) -> None:
        """Go on from there; nothing is to begin before `now` [s]."""
        epoch = tree.number('epoch', 0.0, now)
        numbers = self.known_numbers(tree.entries('numbers'))
        if set(numbers) != set(self._pieces):
            raise ValueError('inputs.timetable.numbers are of other profiles')
        self.epoch, self.numbers = epoch, numbers
        if self.next_time < now:
            raise ValueError(
                f'inputs.timetable has a piece that was to begin before {now!r} s')

    def listing(self, numbers: Mapping[Follower, int]) -> list[Any]:
        """Numbers of pieces as they are remembered."""
        return sorted([_stored(name), number] for name, number in numbers.items())

    def known_numbers(self, entries: list[Any]) -> dict[Follower, int]:
        """Numbers of pieces as they were remembered, judged."""
        numbers = {}
        for entry in entries:
            if not (isinstance(entry, list) and len(entry) == 2 and (
                    isinstance(entry[0], str) and entry[0] in self._by_stored_name)):
                raise ValueError('inputs hold the piece of a profile that the scene lacks')
            name, number = self._by_stored_name[entry[0]], entry[1]
            if type(number) is not int or not 0 <= number < len(self._pieces[name]):
                raise ValueError(f'inputs hold no such piece of {entry[0]}: {number!r:.40}')
            numbers[name] = number
        return numbers

    def _next(self, name: Follower) -> float:
        starts, number = self._starts[name], self.numbers[name] + 1
        return self.epoch + starts[number] if number < len(starts) else math.inf


def _require_followed(name: Follower, piece: Any, step: float, angle: float) -> None:
    """Refuse a given `step` [s] with more than `angle` [rad] of a sine in it; ValueError."""
    if not piece.rate * step <= angle:
        raise ValueError(
            f'solver.step {step!r} s is too long for the sine of {name}, whose period is '
            f'{2.0 * math.pi / piece.rate:.6g} s: choose one of at most {angle / piece.rate:.3g} '
            's, or 0 to have it chosen')


def _stored(name: Follower) -> str:
    """What a checkpoint holds for it: a channel by its name, the others by their parameters."""
    if isinstance(name, (ChannelTarget, DriveTarget)):
        return str(stored_target(name))
    return str(name)
