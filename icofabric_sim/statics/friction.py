# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Static friction in contacts along a path of equilibria.

With friction an equilibrium depends on the load path. So a path is given and followed in steps. In
the previous state the two surfaces of a pair met in one point of each body. Since then these
points have moved apart along the surface by u, and the bodies have rotated against each other
about the normal by theta. Springs of the stiffness k of the dynamics (docs/contact.md) resist this
motion, limited by the normal force N. With s = (s0 + u, r theta), where s0 is the previous stretch
of the springs and r the radius of the patch,

    V(s) = k |s|^2 / 2             if k |s| <= mu N: the pair sticks,
    V(s) = mu N (|s| - mu N / 2 k) otherwise: the pair slides.

For given mu N the function V is convex in the positions, so an equilibrium is a minimum of the
energy, as without friction. N is then taken from the equilibrium found, and the search is repeated
until N is unchanged (P. D. Panagiotopoulos, A nonlinear programming approach to the unilateral
contact- and friction-boundary value problem in the theory of elasticity, Ing.-Archiv 44, 1975).
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

from icofabric_sim.geometry.rotations import rotate_axes
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.contact.friction_state import TANGENTIAL
from icofabric_sim.simulation.contact.pair_forces import FIRST_TOUCH
from icofabric_sim.simulation.contact.setup import pack_contact
from icofabric_sim.statics.contact_points import ContactPoints
from icofabric_sim.statics.contacts import StaticContacts
import numpy as np

# Step of force differences, as a ratio to a and in rad.
_DIFFERENCE_STEP = 1e-6
_EYE = np.eye(3)
# Fields with a row for each pair.
_OF_PAIRS = ('pairs', 'arms', 'axes', 'normal', 'radius', 'before', 'limit')

# Smallest relaxation factor of friction limits in a round.
_MIN_RELAXATION = 0.05


class ContactFriction(NamedTuple):
    """Friction in one configuration."""

    energy: float  # [J] of the springs, and of sliding against a constant force
    wrench: np.ndarray  # (n, 6) [N], [N m] on the bodies
    pairs: np.ndarray  # (p, 2) bodies; the second one -1 - k: plane k
    # (p, 12) force [N] and torque about its centre [N m] on the first body, and on the second.
    wrenches: np.ndarray
    slides: np.ndarray  # (p,) bool; False: sticks
    stretch: np.ndarray  # (p, 4) [m] of the springs, world frame; the last one about the normal

    @property
    def force(self) -> np.ndarray:
        """Friction forces [N] on the first body of each pair, (p, 3), world frame."""
        return self.wrenches[:, :3]


class Relaxation:
    """
    Relaxation factor of the friction limits between rounds of a search.

    Normal forces respond to the limits. Under strong friction they change by more than the limits,
    in the opposite direction, so that full updates would diverge. The factor follows from the last
    two rounds (dynamic relaxation of Irons and Tuck 1969, Int. J. Numer. Meth. Eng. 1, 275).
    """

    def __init__(self) -> None:
        """Start with the factor 1."""
        self._part, self._before = 1.0, np.zeros(0)

    def factor_for(self, off: np.ndarray) -> float:
        """Return the relaxation factor for limits with errors `off` (p,)."""
        change = off - self._before if len(off) == len(self._before) else np.zeros(0)
        square = float(change @ change)
        if square > 0.0:
            part = -self._part * float(self._before @ change) / square
            self._part = min(max(part, _MIN_RELAXATION), 1.0)
        else:
            # The pairs have changed.
            self._part = 1.0
        self._before = off
        return self._part


@dataclass
class FrictionPath:
    """Friction springs of contacts, carried from one state of a path to the next."""

    coefficient: float  # mu
    stiffness: float  # k [N/m]
    half_edge: float  # a [m]
    body_count: int
    # State of each pair at the start of the step: bodies, as in `ContactFriction`; their common
    # point, in the axes of both bodies (world axes for a plane); these axes; normal and radius.
    pairs: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    arms: np.ndarray = field(default_factory=lambda: np.zeros((0, 2, 3)))  # [m]
    axes: np.ndarray = field(default_factory=lambda: np.zeros((0, 2, 3, 3)))
    normal: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    radius: np.ndarray = field(default_factory=lambda: np.zeros(0))  # [m]
    before: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))  # s0 [m]
    limit: np.ndarray = field(default_factory=lambda: np.zeros(0))  # mu N / k [m]
    is_begun: bool = False  # the step continues from a previous state
    displaced: np.ndarray | None = None  # (k, 3) [m] displacements of planes in this step

    @classmethod
    def of(cls, scene: Scene) -> 'FrictionPath | None':
        """Return the path of a scene before any slip, or None without friction."""
        setup = pack_contact(scene, np.zeros(3), moving=False)
        if setup is None or not setup.friction > 0.0:
            return None
        return cls(
            setup.friction, TANGENTIAL * setup.stiffness, setup.half_edge, scene.body_count)

    def act(self, position: np.ndarray, axes: np.ndarray) -> ContactFriction:
        """Return the friction at `position` (n, 3) and `axes` (n, 3, 3), body axes as rows."""
        wrench = np.zeros((self.body_count, 6))
        wrenches, energy, stretch = self._wrenches(*self._of_pairs(position, axes))
        np.add.at(wrench, self.pairs[:, 0], wrenches[:, :6])
        shells = self.pairs[:, 1] >= 0
        np.add.at(wrench, self.pairs[shells, 1], wrenches[shells, 6:])
        slides = np.linalg.norm(stretch, axis=1) > self.limit
        return ContactFriction(
            float(energy.sum()), wrench, self.pairs, wrenches, slides, stretch)

    def blocks(
        self, position: np.ndarray, axes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """
        Return second derivatives by pairs: bodies (m, 2), and blocks (m, 12, 12).

        Computed by differences of forces, as for contacts; a pair with a plane is a body and
        itself.
        """
        places, turns = self._of_pairs(position, axes)
        here, count = self._wrenches(places, turns)[0], len(self.pairs)
        # Copies of all pairs, one for each degree of freedom and sign, for a single fast call.
        moved, turned = (np.repeat(part[None], 24, axis=0) for part in (places, turns))
        for copy in range(24):
            (end, k), sign = divmod(copy // 2, 6), 1.0 - 2.0 * (copy % 2)
            if k < 3:
                moved[copy, :, end, k] += sign * _DIFFERENCE_STEP * self.half_edge
            else:
                rotation = np.broadcast_to(sign * _DIFFERENCE_STEP * _EYE[k - 3], (count, 3))
                turned[copy, :, end] = rotate_axes(rotation, turns[:, end])
        copies = replace(self)
        for name in _OF_PAIRS:
            setattr(copies, name, np.concatenate([getattr(self, name)] * 24))
        sides = copies._wrenches(
            moved.reshape(-1, 2, 3), turned.reshape(-1, 2, 3, 3))[0].reshape(12, 2, count, 12)
        lengths = np.tile(np.repeat([self.half_edge, 1.0], 3), 2)
        part = np.moveaxis(sides[:, 1] - sides[:, 0], 0, 2) / (2.0 * _DIFFERENCE_STEP * lengths)
        for freedom in (3, 4, 5, 9, 10, 11):
            # Turning the body also rotates the torque; half of that is symmetric.
            torque = slice(freedom // 6 * 6 + 3, freedom // 6 * 6 + 6)
            part[:, torque, freedom] += 0.5 * np.cross(_EYE[freedom % 6 - 3], here[:, torque])
        planes = self.pairs[:, 1] < 0
        part[planes, 6:] = 0.0
        part[planes, :, 6:] = 0.0
        bodies = np.where(planes[:, None], self.pairs[:, :1], self.pairs)
        return bodies, 0.5 * (part + np.swapaxes(part, 1, 2))

    def sizes(self, friction: ContactFriction) -> np.ndarray:
        """Return the magnitude of friction [N], (p,), including the part about the normal."""
        stretch = np.linalg.norm(friction.stretch, axis=1)
        return np.asarray(self.stiffness * np.minimum(stretch, self.limit))

    def update_limits(
        self, contacts: StaticContacts, position: np.ndarray, axes: np.ndarray,
        relaxation: Relaxation
    ) -> float:
        """
        Update friction limits to the normal forces in a configuration; return their error [N].

        Adds pairs that have come into contact since.
        """
        met = contacts.contact_points(position, axes)
        limit = np.zeros(len(self.pairs))
        known = {pair: row for row, pair in enumerate(map(tuple, self.pairs.tolist()))}
        rows = np.array([known.get(tuple(pair), -1) for pair in met.pairs.tolist()], np.int64)
        mine = rows >= 0
        limit[rows[mine]] = self.coefficient / self.stiffness * met.push[mine]
        off = limit - self.limit
        change = float(np.abs(off).max(initial=0.0))
        self.limit = np.maximum(self.limit + relaxation.factor_for(off) * off, 0.0)
        if not mine.all():
            fresh = self._with_unloaded_springs(met, ~mine, position, axes)
            fresh.limit = self.coefficient / self.stiffness * met.push[~mine]
            change = max(change, float(fresh.limit.max()))
            for name in _OF_PAIRS:
                setattr(self, name, np.concatenate([getattr(self, name), getattr(fresh, name)]))
        return self.stiffness * change

    def advanced(
        self, contacts: StaticContacts, position: np.ndarray, axes: np.ndarray,
        reach: float = FIRST_TOUCH
    ) -> 'FrictionPath':
        """
        Return the start of the next step: contacts in a configuration, with their spring stretch.

        `reach`: see `StaticContacts.meetings`.
        """
        met = contacts.contact_points(position, axes, reach)
        there = self._with_unloaded_springs(met, np.ones(len(met.pairs), bool), position, axes)
        if not len(self.pairs) or not len(there.pairs):
            return there
        places, turns = self._of_pairs(position, axes)
        _, _, stretch = self._wrenches(places, turns)
        size = np.linalg.norm(stretch, axis=1)
        kept = stretch * np.minimum(
            1.0, self.limit / np.where(size > 0.0, size, 1.0))[:, None]
        # Springs rotate with their surfaces, by the mean of both bodies; planes do not rotate.
        turn = self._turns(turns)
        planes = self.pairs[:, 1] < 0
        mean = np.where(
            planes[:, None], np.einsum('pi,pi->p', turn[:, 0], self.normal)[:, None]
            * 0.5 * self.normal, 0.5 * (turn[:, 0] + turn[:, 1]))
        kept[:, :3] = rotate_axes(mean, np.repeat(kept[:, None, :3], 3, axis=1))[:, 0]
        old = {pair: row for row, pair in enumerate(map(tuple, self.pairs.tolist()))}
        for row, pair in enumerate(map(tuple, there.pairs.tolist())):
            if pair in old:
                vector, n = kept[old[pair]], there.normal[row]
                there.before[row, :3] = vector[:3] - (vector[:3] @ n) * n
                there.before[row, 3] = vector[3]
        return there

    def sticking(
        self, contacts: StaticContacts, position: np.ndarray, axes: np.ndarray
    ) -> 'FrictionPath':
        """Return sticking springs without force in loaded contacts, for small motions."""
        met = contacts.contact_points(position, axes)
        # Larger than the round-off forces of shells at first touch.
        least = contacts.stiffness * FIRST_TOUCH * self.half_edge
        return self._with_unloaded_springs(met, met.push > least, position, axes)

    def _with_unloaded_springs(
        self, met: ContactPoints, chosen: np.ndarray, position: np.ndarray, axes: np.ndarray
    ) -> 'FrictionPath':
        """Return the `chosen` contacts of a configuration with springs without force."""
        pairs, point = met.pairs[chosen], met.point[chosen]
        there = replace(self, pairs=pairs)
        places, turns = there._of_pairs(position, axes)
        arms = np.einsum('peij,pej->pei', turns, point[:, None] - places)
        return replace(
            there, arms=arms, axes=turns.copy(), normal=met.normal[chosen],
            radius=met.radius[chosen], before=np.zeros((len(pairs), 4)),
            # Normal forces are not known yet, so all pairs stick in the first round.
            limit=np.full(len(pairs), self.half_edge), is_begun=True)

    def _of_pairs(
        self, position: np.ndarray, axes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (p, 2, 3) and axes (p, 2, 3, 3) of pairs; planes have world axes."""
        planes = self.pairs[:, 1] < 0
        bodies = np.maximum(self.pairs, 0)
        places, turns = position[bodies], axes[bodies]
        turns[planes, 1] = _EYE
        places[planes, 1] = 0.0 if self.displaced is None else self.displaced[
            -1 - self.pairs[planes, 1]]
        return places, turns

    def _turns(self, turns: np.ndarray) -> np.ndarray:
        """Return rotation vectors (p, 2, 3) [rad] of both bodies since the start of the step."""
        from scipy.spatial.transform import Rotation

        matrices = np.einsum('peai,peaj->peij', turns, self.axes)
        return np.asarray(
            Rotation.from_matrix(matrices.reshape(-1, 3, 3)).as_rotvec()).reshape(-1, 2, 3)

    def _wrenches(
        self, places: np.ndarray, turns: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return wrenches on both bodies (p, 12), energies [J] and stretches s (p, 4) [m]."""
        count = len(self.pairs)
        if not count:
            return np.zeros((0, 12)), np.zeros(0), np.zeros((0, 4))
        arms = np.einsum('pei,peij->pej', self.arms, turns)
        apart = (places[:, 0] + arms[:, 0]) - (places[:, 1] + arms[:, 1])
        n, turn = self.normal, self._turns(turns)
        stretch = self.before.copy()
        stretch[:, :3] += apart - np.einsum('pi,pi->p', apart, n)[:, None] * n
        stretch[:, 3] += self.radius * np.einsum('pi,pi->p', turn[:, 0] - turn[:, 1], n)
        size = np.linalg.norm(stretch, axis=1)
        limit, k = self.limit, self.stiffness
        held = np.minimum(1.0, limit / np.where(size > 0.0, size, 1.0))
        pull = k * held[:, None] * stretch
        energy = np.where(size <= limit, 0.5 * k * size**2, k * limit * (size - 0.5 * limit))
        push = pull[:, :3] - np.einsum('pi,pi->p', pull[:, :3], n)[:, None] * n
        wrenches = np.zeros((count, 12))
        for end, sign in ((0, -1.0), (1, 1.0)):
            force = sign * push
            wrenches[:, 6 * end:6 * end + 3] = force
            wrenches[:, 6 * end + 3:6 * end + 6] = np.cross(arms[:, end], force) + (
                sign * self.radius * pull[:, 3])[:, None] * _about(n, turn[:, end])
        return wrenches, energy, stretch


def _about(axis: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """
    Return the derivative (p, 3) of axis . log R for R -> exp(dtheta) R; log R is `turn` (p, 3).

    It is the transposed inverse of the left Jacobian of rotations, times the axis.
    """
    angle = np.linalg.norm(turn, axis=1)
    small = angle < 1e-4
    x = np.where(small, 1.0, angle)
    second = np.where(small, 1.0 / 12.0, 1.0 / x**2 - (1.0 + np.cos(x)) / (2.0 * x * np.sin(x)))
    once = np.cross(turn, axis)
    return axis + 0.5 * once + second[:, None] * np.cross(turn, once)
