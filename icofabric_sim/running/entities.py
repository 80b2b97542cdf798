# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Bodies of a scene as entities of a simulator, named like their frames."""

from collections.abc import Collection, Mapping
import math
from typing import Any, NamedTuple

from icofabric_sim.geometry.icosahedron import circumscribed_radius
from icofabric_sim.messages.frames import body_frame, parse_body_frame
from icofabric_sim.running.name_filter import name_filter
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.simulation import Simulation
import numpy as np

# Parts of a body's state that can be set, with their sizes.
STATE_PARTS = {'position': 3, 'orientation': 4, 'linear_velocity': 3, 'angular_velocity': 3}


class Sphere(NamedTuple):
    """Sphere in space [m]."""

    centre: np.ndarray
    radius: float

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Return the distances of `points` (n, 3) outside the sphere [m]."""
        return np.maximum(np.linalg.norm(points - self.centre, axis=1) - self.radius, 0.0)


class Box(NamedTuple):
    """Box along the world axes [m]."""

    lower: np.ndarray
    upper: np.ndarray

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Return the distances of `points` (n, 3) outside the box [m]."""
        outside = np.maximum(self.lower - points, points - self.upper)
        return np.linalg.norm(np.maximum(outside, 0.0), axis=1)


class Query(NamedTuple):
    """Filter of entities; conditions that are empty or None always hold."""

    expression: str = ''
    held: bool | None = None  # whether supports fix position and orientation
    tags: tuple[str, ...] = ()  # groups of the entity
    all_tags: bool = False  # require all of them, or any
    bounds: Sphere | Box | None = None  # that the entity, as a sphere, overlaps


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
        """Return the body of that name; raise KeyError for an unknown name."""
        body = parse_body_frame(name)
        if body is None or not body < self.scene.body_count:
            raise KeyError(
                f'unknown entity {name!r}; entities are {body_frame(0)} to '
                f'{body_frame(self.scene.body_count - 1)}')
        return body

    def tags(self, body: int) -> list[str]:
        """Return the groups that contain a body, except `all`."""
        return [
            name for name, bodies in self.scene.groups.items() if name != 'all' and body in bodies]

    def select(self, query: Query, position: np.ndarray) -> list[int]:
        """Return the bodies that match `query` at their `position` (n, 3), in order."""
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
    """Validate parts of one body's state; raise ValueError with the name of an invalid part."""
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
    Set position, orientation or velocities of one body now; other bodies stay.

    `parts` are those of STATE_PARTS that change, world frame, SI units. Raises ValueError or
    SimulationError for invalid values; the state may then have changed.
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
