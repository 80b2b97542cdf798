# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Drag forces that pull a body towards a world point, as a spring with a damper.

The law is that of the mouse spring of MuJoCo, K = 100 / s^2 times a mass and damping ratio 0.5.
The mass of the body would be too small to move a fabric; the mass of all connected bodies would
tear the body out. The law uses the geometric mean of both. The spring force does not increase
beyond `LARGEST_DISTANCE`, so that a distant target does not break the fabric. The total force has
the same limit. Both limits only dissipate energy.

The force acts at the centre of the body, so the inertia of the body does not enter the law.

A force is computed every few steps of the trajectory and held constant between. The mean delay of
half this time excites vibrations. So the force is updated at least once per radian of the fastest
vibration of the fabric, and ten times per radian of the body on the spring, which reduces the
damping ratio by at most 0.05. The damping is limited to keep the free body stable. A free body of
any mass overshoots by less than a quarter and comes to rest. The forces depend only on the state
and the times of the targets, so a replay repeats them.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
import math
from typing import Any

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.checkpoints.state_tree import as_number, StateTree
from icofabric_sim.simulation.inputs.input_types import Pull, PullTarget
from icofabric_sim.simulation.model.packing import WrenchRow
import numpy as np

STIFFNESS = 100.0  # over the mass of the law at strength 1 [1/s^2]
DAMPING_RATIO = 0.5
LARGEST_ACCELERATION = 50.0  # force limit over the mass of the law at strength 1 [m/s^2]
# Distance [m] beyond which the spring force is constant.
LARGEST_DISTANCE = LARGEST_ACCELERATION / STIFFNESS


@dataclass(frozen=True)
class PullSettings:
    """Tunables of the updates of drag forces."""

    # Longest time between two updates: simulated time [s], radians of the fastest vibration of
    # the fabric, and radians of the body on its spring.
    max_hold_s: float = 0.01
    max_fabric_angle: float = 1.0
    max_spring_angle: float = 0.1
    # Largest fraction of the velocity of a free body that damping removes between two updates.
    max_velocity_loss_ratio: float = 0.25
    max_distance: float = 1e100  # [m] of a target: norms of longer vectors overflow


_SETTINGS = PullSettings()

# Position [m] and velocity [m/s] of a body.
BodyMotion = Callable[[int], tuple[np.ndarray, np.ndarray]]


class Pulls:
    """Targets of drag forces, and the forces that are held until `due` [s]."""

    def __init__(self, scene: Scene) -> None:
        """Start without drag forces."""
        self._scene = scene
        self._strength = float(scene.parameters['pull.strength'])
        self._targets: dict[int, np.ndarray] = {}  # (3,) [m] by body
        self._masses: dict[int, float] = {}  # [kg], set at the first target of a body
        self._forces: dict[int, np.ndarray] = {}  # (3,) [N] held now
        self._packed: dict[int, np.ndarray] = {}  # the forces that kernels have
        self.due = math.inf

    def __bool__(self) -> bool:
        """Return True if a body has a target, or kernels still apply a drag force."""
        return bool(self._targets or self._packed)

    @property
    def bodies(self) -> list[int]:
        """Numbers of the bodies with a target, sorted."""
        return sorted(self._targets)

    @property
    def forces(self) -> dict[int, np.ndarray]:
        """Drag forces [N] by body, world axes."""
        return {body: self._forces[body].copy() for body in sorted(self._forces)}

    @property
    def targets(self) -> dict[int, np.ndarray]:
        """Target points [m] by body."""
        return {body: self._targets[body].copy() for body in self.bodies}

    def mass(self, body: int) -> float:
        """Return the mass [kg] that scales the drag force of a body."""
        return self._masses[body]

    def take(self, target: PullTarget, value: Pull, time: float) -> None:
        """Set or release the target of a body; forces are updated at `time` [s]."""
        body = target.number
        if not value.is_release:
            self._targets[body] = value.point
        elif body in self._targets:
            for held in (self._targets, self._masses, self._forces):
                held.pop(body, None)
        else:
            return
        self.due = time

    def clear(self) -> None:
        """Remove all targets and forces; the caller packs the loads again."""
        for held in (self._targets, self._masses, self._forces):
            held.clear()
        self.due = math.inf

    def adopt(self, other: 'Pulls', now: float) -> None:
        """Adopt the targets of another scene for bodies of this scene."""
        self.clear()
        for body in other.bodies:
            if body < self._scene.body_count:
                self._targets[body], self.due = other._targets[body], now

    def compute(
        self, time: float, motion: BodyMotion, rate: float, connected: Callable[[int], float]
    ) -> float:
        """
        Compute the forces at `time` [s]; return how long [s] the forces may be held.

        `rate` [rad/s] is that of the fastest vibration. `connected` returns the mass [kg] of all
        bodies connected with a body; a new target requires this mass.
        """
        held = _SETTINGS.max_hold_s
        if rate > 0.0:
            held = min(held, _SETTINGS.max_fabric_angle / rate)
        for body in self.bodies:
            own = self._scene.masses.mass_of(body)
            if body not in self._masses:
                self._masses[body] = math.sqrt(own * connected(body))
            stiffness = self._strength * STIFFNESS * self._masses[body]
            held = min(held, _SETTINGS.max_spring_angle * math.sqrt(own / stiffness))
        self._forces = {}
        for body in self.bodies:
            mass = self._masses[body]
            stiffness = self._strength * STIFFNESS * mass
            loss = _SETTINGS.max_velocity_loss_ratio
            damping = min(
                2.0 * DAMPING_RATIO * math.sqrt(stiffness * mass),
                loss * self._scene.masses.mass_of(body) / held)
            position, velocity = motion(body)
            farthest = _SETTINGS.max_distance
            away = np.clip(self._targets[body] - position, -farthest, farthest)
            self._forces[body] = _capped(
                stiffness * _capped(away, LARGEST_DISTANCE) - damping * velocity,
                stiffness * LARGEST_DISTANCE)
        self.due = math.inf
        return held if self._targets else math.inf

    @property
    def is_packed(self) -> bool:
        """True if kernels have one row for each drag force."""
        return self._packed.keys() == self._forces.keys()

    def repack(self) -> np.ndarray:
        """Pack the present forces; return them in the order of the rows, (p, 3) [N]."""
        self._packed = dict(self._forces)
        return np.array([self._packed[body] for body in sorted(self._packed)]).reshape(-1, 3)

    def packed_rows(self) -> list[WrenchRow]:
        """Return the rows that were packed last, by number of the body."""
        return [
            WrenchRow(np.array([body], np.int32), False, self._packed[body], np.zeros(3))
            for body in sorted(self._packed)]

    def state_tree(self) -> dict[str, Any]:
        """Return the state that future forces depend on."""
        return {
            'due': self.due,
            'pulled': [
                [body, self._targets[body].tolist(), self._masses.get(body, 0.0)]
                for body in self.bodies],
            'forces': _listing(self._forces),
            'packed': _listing(self._packed),
        }

    def load_state(self, tree: StateTree | None, now: float) -> None:
        """Restore the drag forces, or none; no update is due before `now` [s]."""
        self.clear()
        self._packed = {}
        if tree is None:
            return
        due = tree.number('due', finite=False)
        if not due >= now:
            raise ValueError(f'inputs.pulls.due must not be before {now!r} s, got {due!r} s')
        targets, masses = {}, {}
        for entry in tree.entries('pulled'):
            if not isinstance(entry, list) or len(entry) != 3:
                raise ValueError('inputs.pulls.pulled has an entry that has not 3 fields')
            body, mass = self._body(entry[0]), as_number(entry[2])
            if mass is None or not 0.0 <= mass < math.inf:
                raise ValueError(f'inputs.pulls.pulled has the mass {entry[2]!r:.40}')
            targets[body] = _vector(entry[1])
            if mass > 0.0:
                masses[body] = mass
        forces, packed = (self._vectors(tree.entries(name)) for name in ('forces', 'packed'))
        self._targets, self._masses = targets, masses
        self._forces, self._packed, self.due = forces, packed, due

    def _vectors(self, entries: Iterable[Any]) -> dict[int, np.ndarray]:
        vectors = {}
        for entry in entries:
            if not isinstance(entry, list) or len(entry) != 2:
                raise ValueError('inputs.pulls hold an entry that has not 2 fields')
            vectors[self._body(entry[0])] = _vector(entry[1])
        return vectors

    def _body(self, number: Any) -> int:
        if type(number) is not int or not 0 <= number < self._scene.body_count:
            raise ValueError(f'inputs.pulls name a body {number!r:.40}, which the scene lacks')
        return number


def connected_mass(scene: Scene, broken: np.ndarray | None, body: int) -> float:
    """
    Return the mass [kg] of all bodies connected with a body, itself included.

    `broken` (c,) are the times [s] of breakage of the connectors, NaN while unbroken. None stands
    for no broken connector.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    whole = scene.connectors.bodies
    if broken is not None:
        whole = whole[np.isnan(broken)]
    links = coo_array(
        (np.ones(len(whole), bool), (whole[:, 0], whole[:, 1])),
        shape=(scene.body_count, scene.body_count))
    label = connected_components(links, directed=False)[1]
    return float(np.broadcast_to(scene.masses.mass, scene.body_count)[label == label[body]].sum())


def _capped(vector: np.ndarray, largest: float) -> np.ndarray:
    """Return a vector (3,) shortened to the `largest` length."""
    length = math.hypot(*vector.tolist())
    return vector if length <= largest else vector * (largest / length)


def _listing(vectors: dict[int, np.ndarray]) -> list[Any]:
    return [[body, vectors[body].tolist()] for body in sorted(vectors)]


def _vector(values: Any) -> np.ndarray:
    try:
        vector = np.array(values, dtype=float)
    except (TypeError, ValueError):
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f'inputs.pulls hold {values!r:.40} for three finite numbers')
    return vector
