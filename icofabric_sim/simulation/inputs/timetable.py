# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Times at which segments of profiles and paths start, and the present segments."""

from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Any

from icofabric_sim.scene.paths import Path
from icofabric_sim.scene.profiles import Profile
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.inputs.input_types import (
    ChannelTarget,
    DriveTarget,
    PathTarget,
    PlaneTarget,
    stored_target,
)


@dataclass(frozen=True, slots=True)
class TractionProfile:
    """The profile of `tractions.NAME`, or of a line load or an expression by its whole name."""

    name: str

    def __str__(self) -> str:
        return self.name if '.' in self.name else f'tractions.{self.name}'


@dataclass(frozen=True, slots=True)
class ExpressionTimes:
    """The times at which a load by an expression changes."""

    number: int

    def __str__(self) -> str:
        return f'times of expression {self.number}'


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


@dataclass(frozen=True)
class PulseSettings:
    """Tunables of given steps through pulses and sines."""

    max_pulse_angle: float = math.pi * (1.0 + 1e-9)  # a pulse is at most half a period of a sine
    # A pulse of fewer given steps is divided into intervals with shorter steps.
    min_steps: int = 8
    impulse_error_ratio: float = 1e-5  # approximate relative error of the impulse of such a pulse
    max_angle: float = 2.0 * math.pi  # largest angle [rad] of a sine in a given step


_SETTINGS = PulseSettings()

# Types that follow a profile or a path.
Follower = (
    ChannelTarget | PathTarget | TractionProfile | ExpressionTimes | AnchorPath | FieldProfile)


class Timetable:
    """Profiles and paths by their followers, at times since the start of the motion."""

    def __init__(self, profiles: Mapping[Follower, Profile | Path]) -> None:
        """Start at time 0."""
        self._pieces: dict[Follower, tuple[Any, ...]] = {
            name: profile.pieces for name, profile in profiles.items() if len(profile.pieces) > 1}
        # Start times [s] of segments; a divided pulse has one entry for each interval.
        self._starts = {
            name: tuple(piece.start for piece in pieces) for name, pieces in self._pieces.items()}
        self._by_stored_name = {_stored(name): name for name in self._pieces}
        self._steady = {
            name: profile.pieces[0] for name, profile in profiles.items()
            if len(profile.pieces) == 1}
        self.epoch = 0.0  # [s] start of the motion
        self.numbers: dict[Follower, int] = {}
        self.begin(0.0)

    def follow(self, step: float, order: int, stability: float) -> None:
        """
        Adapt the profiles to a given `step` [s]: divide a pulse of few steps into intervals.

        `order` and `stability` (radians in a step) are those of the method. Call before the motion
        starts; raises ValueError with the name of a sine that the step cannot resolve.
        """
        angle = min(stability, _SETTINGS.max_angle)
        count = max(
            _SETTINGS.min_steps, math.ceil(_SETTINGS.impulse_error_ratio ** (-1.0 / order)))
        for name, piece in self._steady.items():
            _require_followed(name, piece, step, angle)
        for name, starts in self._starts.items():
            parts, begins = [], []
            for piece, start, end in zip(self._pieces[name], starts, (*starts[1:], math.inf)):
                number = 1
                if piece.rate * (end - start) > _SETTINGS.max_pulse_angle:
                    _require_followed(name, piece, step, angle)
                elif piece.rate > 0.0 and end - start < _SETTINGS.min_steps * step:
                    number = count
                parts += [piece] * number
                begins += [start + k * (end - start) / number if k else start
                           for k in range(number)]
            self._pieces[name], self._starts[name] = tuple(parts), tuple(begins)

    def part_length(self, numbers: Mapping[Follower, int]) -> float:
        """
        Return the shortest interval [s] of the pulses with these numbers; infinite without one.
        """
        shortest = math.inf
        for name, number in numbers.items():
            pieces, starts = self._pieces[name], self._starts[name]
            for k in (number, number - 1):
                if 0 <= k < len(pieces) - 1 and pieces[k] is pieces[k + 1]:
                    shortest = min(shortest, starts[k + 1] - starts[k])
        return shortest

    def begin(self, epoch: float, now: float | None = None) -> None:
        """Start the motion at `epoch` [s] and move to the time `now` [s], by default `epoch`."""
        self.epoch = epoch
        now = epoch if now is None else now
        self.numbers = dict.fromkeys(self._pieces, 0)
        while self.next_time <= now:
            self.turn()

    @property
    def next_time(self) -> float:
        """Time [s] at which the next segment starts; infinite without one."""
        return min((self.next_start(name) for name in self._pieces), default=math.inf)

    def turn(self) -> list[Follower]:
        """Start the next segments; return their followers."""
        time = self.next_time
        begun = [name for name in self._pieces if self.next_start(name) <= time]
        for name in begun:
            self.numbers[name] += 1
        return begun

    def piece(self, name: Follower, number: int | None = None) -> Any:
        """Return the present segment, or segment `number`, at times of the run."""
        if name in self._steady:
            piece: Any = self._steady[name]
            return piece._replace(start=self.epoch + piece.start)
        number = self.numbers[name] if number is None else number
        piece = self._pieces[name][number]
        return piece._replace(start=self.epoch + piece.start)

    def state_tree(self) -> dict[str, Any]:
        """Return the start of the motion and the numbers of the present segments."""
        return {'epoch': self.epoch, 'numbers': self.listing(self.numbers)}

    def load_state(self, tree: StateTree, now: float) -> None:
        """Restore the present segments; no segment may start before `now` [s]."""
        epoch = tree.number('epoch', 0.0, now)
        numbers = self.known_numbers(tree.entries('numbers'))
        if set(numbers) != set(self._pieces):
            raise ValueError('inputs.timetable.numbers are of other profiles')
        self.epoch, self.numbers = epoch, numbers
        if self.next_time < now:
            raise ValueError(
                f'inputs.timetable has a piece that was to begin before {now!r} s')

    def listing(self, numbers: Mapping[Follower, int]) -> list[Any]:
        """Return numbers of segments in the form of checkpoints."""
        return sorted([_stored(name), number] for name, number in numbers.items())

    def known_numbers(self, entries: list[Any]) -> dict[Follower, int]:
        """Return validated numbers of segments from the form of checkpoints."""
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

    def next_start(self, name: Follower) -> float:
        """Return the time [s] at which the next segment of a follower starts, or infinity."""
        starts, number = self._starts[name], self.numbers[name] + 1
        return self.epoch + starts[number] if number < len(starts) else math.inf


def _require_followed(name: Follower, piece: Any, step: float, angle: float) -> None:
    """Raise ValueError for a given `step` [s] that exceeds `angle` [rad] of a sine."""
    if not piece.rate * step <= angle:
        raise ValueError(
            f'solver.step {step!r} s is too long for the sine of {name}, whose period is '
            f'{2.0 * math.pi / piece.rate:.6g} s: choose one of at most {angle / piece.rate:.3g} '
            's, or 0 to have it chosen')


def _stored(name: Follower) -> str:
    """Return the form of a follower in checkpoints: its name for channels, else its parameter."""
    if isinstance(name, (ChannelTarget, DriveTarget, PlaneTarget)):
        return str(stored_target(name))
    return str(name)
