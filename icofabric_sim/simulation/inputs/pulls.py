# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Pulls: a hand that draws a body towards a point of the world, as a spring with a damper.

The law is that of the mouse spring of MuJoCo, K = 100 / s^2 times a mass and damping ratio 0.5.
The mass lies between that of the body, too little to move a fabric, and that of all that is
connected with the body, which would tear the body out: their geometric mean. The spring draws no
harder than from `LARGEST_DISTANCE`, so that a hand that is flung far away does not break the
fabric, and the force is capped at the same value: both caps only take energy out.

The force acts at the centre of the body, so the inertia of the body has no part in the law.

A force is computed every few steps of the trajectory and held between: its lag of half that time
feeds vibrations. So the force is computed at least once in a radian of the fastest vibration of
the fabric, and ten times in a radian of the body on the spring, which costs 0.05 of the damping
ratio at most; and the damping is limited to what the free body is stable under. A free body of any
mass overshoots by less than a quarter and comes to rest. All of this follows from the state and
the times at which the targets came, so a record repeats the forces.
"""

from collections.abc import Callable, Iterable
import math
from typing import Any

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.checkpoints.state_tree import as_number, StateTree
from icofabric_sim.simulation.inputs.input_types import Pull, PullTarget
from icofabric_sim.simulation.model.packing import WrenchRow
import numpy as np

STIFFNESS = 100.0  # of a pull of strength 1, by its mass [1/s^2]
DAMPING_RATIO = 0.5
LARGEST_ACCELERATION = 50.0  # of its mass, at strength 1 [m/s^2]
# Beyond this distance [m] the spring draws no harder.
LARGEST_DISTANCE = LARGEST_ACCELERATION / STIFFNESS
# The longest that a force is held: simulated time [s], radians of the fastest vibration of the
# fabric, and radians of the body on its spring.
_LONGEST_HOLD_S, _FABRIC_RADIANS, _SPRING_RADIANS = 0.01, 1.0, 0.1
# Ratio of the velocity of a free body that the damping may take away in that time.
_LARGEST_DAMPING_RATIO = 0.25
# Farther is no distance [m]: lengths of it would overflow, and the cap make NaN of that.
_FARTHEST = 1e100

# Position [m] and velocity [m/s] of a body.
BodyMotion = Callable[[int], tuple[np.ndarray, np.ndarray]]


class Pulls:
    """What is pulled where to, and the forces that are held until `due` [s]."""

    def __init__(self, scene: Scene) -> None:
        """Begin with no pull."""
        self._scene = scene
        self._strength = float(scene.parameters['pull.strength'])
        self._targets: dict[int, np.ndarray] = {}  # (3,) [m] by body
        self._masses: dict[int, float] = {}  # [kg], set where a pull begins
        self._forces: dict[int, np.ndarray] = {}  # (3,) [N] held now
        self._packed: dict[int, np.ndarray] = {}  # the forces that kernels have
        self.due = math.inf

    def __bool__(self) -> bool:
        """Whether anything is pulled, or kernels still have the force of a pull."""
        return bool(self._targets or self._packed)

    @property
    def bodies(self) -> list[int]:
        """The bodies that are pulled, by number."""
        return sorted(self._targets)

    @property
    def forces(self) -> dict[int, np.ndarray]:
        """Force [N] of each pull, world axes, by body."""
        return {body: self._forces[body].copy() for body in sorted(self._forces)}

    @property
    def targets(self) -> dict[int, np.ndarray]:
        """Where each body is pulled to [m], by body."""
        return {body: self._targets[body].copy() for body in self.bodies}

    def mass(self, body: int) -> float:
        """The mass [kg] that the law of a body's pull is scaled by."""
        return self._masses[body]

    def take(self, target: PullTarget, value: Pull, time: float) -> None:
        """Begin, aim or end a pull; the forces follow at `time` [s]."""
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
        """End all of them; what kernels have is packed anew by the caller."""
        for held in (self._targets, self._masses, self._forces):
            held.clear()
        self.due = math.inf

    def adopt(self, other: 'Pulls', now: float) -> None:
        """Go on with the pulls of another scene on bodies that are here too."""
        self.clear()
        for body in other.bodies:
            if body < self._scene.body_count:
                self._targets[body], self.due = other._targets[body], now

    def compute(
        self, time: float, motion: BodyMotion, rate: float, connected: Callable[[int], float]
    ) -> float:
        """
        Compute the forces of `time` [s]; returns for how long [s] they may be held at most.

        `rate` [rad/s]: of the fastest vibration. `connected`: mass [kg] of all bodies that hang
        together with a body, queried where its pull begins.
        """
        held = min(_LONGEST_HOLD_S, _FABRIC_RADIANS / rate if rate > 0.0 else math.inf)
        for body in self.bodies:
            own = self._scene.masses.mass_of(body)
            if body not in self._masses:
                self._masses[body] = math.sqrt(own * connected(body))
            stiffness = self._strength * STIFFNESS * self._masses[body]
            held = min(held, _SPRING_RADIANS * math.sqrt(own / stiffness))
        self._forces = {}
        for body in self.bodies:
            mass = self._masses[body]
            stiffness = self._strength * STIFFNESS * mass
            damping = min(
                2.0 * DAMPING_RATIO * math.sqrt(stiffness * mass),
                _LARGEST_DAMPING_RATIO * self._scene.masses.mass_of(body) / held)
            position, velocity = motion(body)
            away = np.clip(self._targets[body] - position, -_FARTHEST, _FARTHEST)
            self._forces[body] = _capped(
                stiffness * _capped(away, LARGEST_DISTANCE) - damping * velocity,
                stiffness * LARGEST_DISTANCE)
        self.due = math.inf
        return held if self._targets else math.inf

    @property
    def is_packed(self) -> bool:
        """Whether kernels have a row for each pull, and for no other."""
        return self._packed.keys() == self._forces.keys()

    def repack(self) -> np.ndarray:
        """Take the present forces as what kernels have; (p, 3) [N] in the order of the rows."""
        self._packed = dict(self._forces)
        return np.array([self._packed[body] for body in sorted(self._packed)]).reshape(-1, 3)

    def packed_rows(self) -> list[WrenchRow]:
        """Rows of what was packed last, by number of the body."""
        return [
            WrenchRow(np.array([body], np.int32), False, self._packed[body], np.zeros(3))
            for body in sorted(self._packed)]

    def state_tree(self) -> dict[str, Any]:
        """All that the forces to come depend on."""
        return {
            'due': self.due,
            'pulled': [
                [body, self._targets[body].tolist(), self._masses.get(body, 0.0)]
                for body in self.bodies],
            'forces': _listing(self._forces),
            'packed': _listing(self._packed),
        }

    def load_state(self, tree: StateTree | None, now: float) -> None:
        """Go on from there, or without any pull; nothing is due before `now` [s]."""
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
    Return the mass [kg] of the bodies that hang together with a body, itself included.

    `broken` (c,): when each connector broke [s]; NaN: it is whole. None: all are.
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
