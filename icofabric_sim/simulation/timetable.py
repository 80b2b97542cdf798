# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""When the pieces of the profiles and paths of a scene begin, and which of them rule now."""

from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Any

from icofabric_sim.scene.paths import Path
from icofabric_sim.scene.profiles import Profile
from icofabric_sim.simulation.input_types import ChannelTarget, DriveTarget, stored_target
from icofabric_sim.simulation.state_tree import StateTree


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


# What follows a profile or a path.
Follower = ChannelTarget | DriveTarget | TractionProfile | AnchorPath | FieldProfile


class Timetable:
    """Profiles by what follows them, counted from the time at which the motion began."""

    def __init__(self, profiles: Mapping[Follower, Profile | Path]) -> None:
        """Begin at time 0."""
        self._profiles = {
            name: profile for name, profile in profiles.items() if len(profile.pieces) > 1}
        self._by_stored_name = {_stored(name): name for name in self._profiles}
        self._steady = {
            name: profile.pieces[0] for name, profile in profiles.items()
            if len(profile.pieces) == 1}
        self.epoch = 0.0  # [s] when the motion began
        self.numbers: dict[Follower, int] = {}
        self.begin(0.0)

    def begin(self, epoch: float, now: float | None = None) -> None:
        """Count from `epoch` [s], and stand `now` [s], or there."""
        self.epoch = epoch
        now = epoch if now is None else now
        self.numbers = dict.fromkeys(self._profiles, 0)
        while self.next_time <= now:
            self.turn()

    @property
    def next_time(self) -> float:
        """Time [s] at which the next piece begins; infinite where none does."""
        return min((self._next(name) for name in self._profiles), default=math.inf)

    def turn(self) -> list[Follower]:
        """Let the next pieces begin; returns whose they are."""
        time = self.next_time
        begun = [name for name in self._profiles if self._next(name) <= time]
        for name in begun:
            self.numbers[name] += 1
        return begun

    def piece(self, name: Follower, number: int | None = None) -> Any:
        """The piece of a profile that rules now, or number `number`, at times of the run."""
        if name in self._steady:
            piece: Any = self._steady[name]
            return piece._replace(start=self.epoch + piece.start)
        number = self.numbers[name] if number is None else number
        piece = self._profiles[name].pieces[number]
        return piece._replace(start=self.epoch + piece.start)

    def state_tree(self) -> dict[str, Any]:
        """What rules, and since when it is counted."""
        return {'epoch': self.epoch, 'numbers': self.listing(self.numbers)}

    def load_state(self, tree: StateTree, now: float) -> None:
        """Go on from there; nothing is to begin before `now` [s]."""
        epoch = tree.number('epoch', 0.0, now)
        numbers = self.known_numbers(tree.entries('numbers'))
        if set(numbers) != set(self._profiles):
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
            if type(number) is not int or not 0 <= number < len(self._profiles[name].pieces):
                raise ValueError(f'inputs hold no such piece of {entry[0]}: {number!r:.40}')
            numbers[name] = number
        return numbers

    def _next(self, name: Follower) -> float:
        pieces, number = self._profiles[name].pieces, self.numbers[name] + 1
        return self.epoch + pieces[number].start if number < len(pieces) else math.inf


def _stored(name: Follower) -> str:
    """What a checkpoint holds for it: a channel by its name, the others by their parameters."""
    if isinstance(name, (ChannelTarget, DriveTarget)):
        return str(stored_target(name))
    return str(name)
