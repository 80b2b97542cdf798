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
"""The bodies of a scene as the entities of a simulator, named as their frames."""

from collections.abc import Collection, Mapping
import math
from typing import Any, NamedTuple

from icofabric_sim.geometry.icosahedron import circumscribed_radius
from icofabric_sim.messages.frames import body_frame, parse_body_frame
from icofabric_sim.running.name_filter import name_filter
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.simulation import Simulation
import numpy as np

# Parts of a body's state that can be set, and how many numbers each has.
STATE_PARTS = {'position': 3, 'orientation': 4, 'linear_velocity': 3, 'angular_velocity': 3}


class Sphere(NamedTuple):
    """A ball in space [m]."""

    centre: np.ndarray
    radius: float

    def distance(self, points: np.ndarray) -> np.ndarray:
        """How far outside `points` (n, 3) are [m]."""
        return np.maximum(np.linalg.norm(points - self.centre, axis=1) - self.radius, 0.0)


class Box(NamedTuple):
    """A box along the world's axes [m]."""

    lower: np.ndarray
    upper: np.ndarray

    def distance(self, points: np.ndarray) -> np.ndarray:
        """How far outside `points` (n, 3) are [m]."""
        outside = np.maximum(self.lower - points, points - self.upper)
        return np.linalg.norm(np.maximum(outside, 0.0), axis=1)


class Query(NamedTuple):
    """What entities must fulfil; what is empty or None asks for nothing."""

    expression: str = ''
    held: bool | None = None  # whether they are fixed in place and orientation
    tags: tuple[str, ...] = ()  # groups that they belong to
    all_tags: bool = False  # to all of them, or to any
    bounds: Sphere | Box | None = None  # that they overlap with, taken as balls


class Entities:
    """Names and properties of the bodies of one scene."""

    def __init__(self, scene: Scene) -> None:
        """Describe `scene`."""
        self.scene = scene
        self.radius = circumscribed_radius(1.0) * scene.body_half_edges
        supports = scene.supports
        self.held = np.zeros(scene.body_count, dtype=bool)
        if supports is not None:
            self.held = supports.translation.all(axis=1) & supports.rotation

    def number(self, name: str) -> int:
        """Return the body of that name; KeyError where there is none."""
        body = parse_body_frame(name)
        if body is None or not body < self.scene.body_count:
            raise KeyError(
                f'there is no entity {name!r}; entities are {body_frame(0)} to '
                f'{body_frame(self.scene.body_count - 1)}')
        return body

    def tags(self, body: int) -> list[str]:
        """Return the groups that a body belongs to, but `all`."""
        return [
            name for name, bodies in self.scene.groups.items() if name != 'all' and body in bodies]

    def select(self, query: Query, position: np.ndarray) -> list[int]:
        """Return the bodies that fulfil `query` at their `position` (n, 3), in order."""
        chosen = np.ones(self.scene.body_count, dtype=bool)
        if query.held is not None:
            chosen &= self.held == query.held
        if query.tags:
            members = np.array([self._members(tag) for tag in query.tags])
            chosen &= members.all(axis=0) if query.all_tags else members.any(axis=0)
        if query.bounds is not None:
            chosen &= query.bounds.distance(position) <= self.radius
        matches = name_filter(query.expression)
        return [body for body in np.flatnonzero(chosen).tolist() if matches(body_frame(body))]

    def _members(self, tag: str) -> np.ndarray:
        members = np.zeros(self.scene.body_count, dtype=bool)
        members[self.scene.groups.get(tag, [])] = True
        return members


def checked_parts(given: Mapping[str, Collection[float]]) -> dict[str, list[float]]:
    """Judge the `given` parts of one body's state; ValueError names the part."""
    parts = {}
    for name, values in given.items():
        numbers = [float(value) for value in values]
        if len(numbers) != STATE_PARTS[name] or not all(map(math.isfinite, numbers)):
            raise ValueError(
                f'{name} must be {STATE_PARTS[name]} finite numbers, got {numbers}')
        parts[name] = numbers
    return parts


def set_body_state(simulation: Simulation, body: int, parts: Mapping[str, Any]) -> None:
    """
    Put one body elsewhere, in other orientation or motion, now; the others stay as they are.

    `parts` are those of STATE_PARTS that change, world frame, SI units. ValueError or
    SimulationError where they make no sense; the state may then be another one.
    """
    snapshot = simulation.snapshot()
    arrays: dict[str, Any] = {}
    for name, values in parts.items():
        arrays[name] = np.array(getattr(snapshot, name))
        arrays[name][body] = values
    with np.errstate(over='ignore', invalid='ignore'):
        simulation.set_state(**arrays)
        energy = sum(simulation.snapshot().energy.values())
    if not math.isfinite(energy):
        raise ValueError(f'the energy of body {body} would not be a finite number')
