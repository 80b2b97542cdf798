# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Stretches of friction springs, kept between searches while lists of pairs change."""

import math
from typing import Any

from icofabric_sim.geometry.icosahedron import circumscribed_radius
from icofabric_sim.kernels.integrators.tableau import DENSE, SLOPE_COUNT
from icofabric_sim.kernels.records import Model
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.contact.setup import ContactSetup
from icofabric_sim.simulation.model.layout import aligned_empty
from icofabric_sim.terms.contacts.listing import carry_over, find_both
from icofabric_sim.terms.contacts.record import ContactLosses, Contacts
import numpy as np

# Tangential over normal stiffness: the tangential and normal half periods of a sphere in oblique
# impact are then equal (J. Schaefer, S. Dippel and D. E. Wolf, J. Phys. I 6, 5, 1996).
TANGENTIAL = 2.0 / 7.0
# Upper bound, over K, of the second derivatives of the contact energy by positions and by a times
# rotation angles of both bodies, as found by a search (docs/contact.md).
CURVATURE = 7.0
# Largest squared arm, over a^2, of friction against rotation about the normal.
_PATCH_RATIO = 0.25
_CARRIED_FIELDS = ('stretch', 'held', 'start', 'saved')


def contact_losses(contacts: Contacts | None) -> ContactLosses | None:
    """Return the dissipative terms of contacts; None without candidate pairs or dissipation."""
    return None if contacts is None else contacts.losses


def lightest(model: Model, setup: ContactSetup) -> float:
    """Return the larger of 1 / M and a^2 / Lambda [1/kg] of bodies, see CURVATURE."""
    return float(max(model.inverse_mass, setup.largest**2 * model.inverse_inertia))


def frequency_of(model: Model, setup: ContactSetup) -> float:
    """Return the highest frequency [rad/s] of two bodies in contact."""
    return math.sqrt(CURVATURE * setup.stiffness * lightest(model, setup))


class FrictionState:
    """Friction springs of the listed pairs, and arrays for the energy that contacts dissipate."""

    def __init__(self, setup: ContactSetup, lightest: float) -> None:
        """Start without springs; `lightest` is the larger of 1 / M and a^2 / Lambda [1/kg]."""
        self._setup = setup
        self.stiffness = TANGENTIAL * setup.stiffness
        self._pairs = np.zeros((0, 2), np.int32)
        self._losses: ContactLosses | None = None
        # The slip of a body is dx + theta x arm along the surface, with an arm of at most R, and
        # at most sqrt(_PATCH_RATIO) a theta about the normal. The slip of a pair is the difference
        # of two. So its square is at most `most` times the sum of squares of displacements and a
        # times angles.
        radius = circumscribed_radius(1.0)
        most = 2.0 * (1.0 + radius**2 + _PATCH_RATIO) if setup.friction > 0.0 else 0.0
        # [1/s^2] largest contribution of a contact to the squared frequency of its bodies:
        # `push_rate` by its normal force, `least_rate` with friction.
        self.push_rate = lightest * CURVATURE * setup.stiffness
        self.least_rate = self.push_rate + lightest * most * self.stiffness
        # The dashpot has the same rate, so that it does not require shorter steps.
        self.lag = self.least_rate ** -0.5
        # [1/s] rate at which the dashpot changes velocities; for damping, per m of overlap.
        self.lag_rate = lightest * most * self.stiffness * self.lag
        self.damping_rate = lightest * CURVATURE * setup.stiffness * setup.damping

    def room(
        self, pairs: np.ndarray, slot_count: int, slots: np.ndarray
    ) -> ContactLosses | None:
        """
        Allocate arrays for pairs (p, 2); pairs that were listed before keep their stretches.

        `slots` are those of all bodies of the pairs, and of carriers of their planes.
        """
        setup, before, old = self._setup, self._losses, self._pairs
        if not setup.spends:
            return None
        spent = aligned_empty((1, slot_count))
        lead, lost = aligned_empty((6, slot_count)), aligned_empty((6, slot_count))
        spent[:] = lead[:] = lost[:] = 0.0
        if before is not None:
            # Energy that an impulse has yet to dissipate remains after a search.
            lost[:, slots] = before.lost[:, slots]
        rows = len(pairs) if setup.friction > 0.0 else 0
        self._pairs = pairs
        stretch, held, start, stage, saved = (np.zeros((rows, 4)) for _ in range(5))
        self._losses = losses = ContactLosses(
            setup.damping, setup.friction, self.stiffness, self.lag, np.zeros(len(pairs)), spent,
            stretch, held, start, stage, saved, np.zeros((SLOPE_COUNT, rows, 4)), lead,
            np.zeros((len(pairs), 9)), lost)
        if before is not None and rows:
            here, there = np.empty(len(pairs), np.int64), np.empty(len(pairs), np.int64)
            both = int(find_both(pairs, old, here, there))
            here, there = here[:both], there[:both]
            for name in _CARRIED_FIELDS:
                carry_over(here, there, getattr(before, name)[None], getattr(losses, name)[None])
            carry_over(here, there, before.slopes, losses.slopes)
        return losses

    def forget(self) -> None:
        """Relax all springs, for a new state or without candidate pairs."""
        if self._losses is not None:
            for name in (*_CARRIED_FIELDS, 'slopes'):
                getattr(self._losses, name)[:] = 0.0
            self._losses.lost[:] = 0.0

    def energy(self, contacts: Contacts, stretches: np.ndarray | None) -> float:
        """
        Return the energy [J] in the springs of contacts, in the state of the last `contact_look`.
        """
        if stretches is None or not len(stretches):
            return 0.0
        touching = contacts.aside[:, 9] > 0.0
        # A sum that does not depend on the order of pairs.
        return 0.5 * self.stiffness * math.fsum((stretches[touching]**2).ravel())

    def state_tree(self) -> dict[str, Any]:
        """Return the pairs with stretched springs, now or in the step in progress."""
        losses = self._losses
        if losses is None:
            return {name: np.zeros((0, 0)) for name in ('pairs', 'rows', 'slopes')}
        rows = np.hstack([getattr(losses, name) for name in _CARRIED_FIELDS])
        slopes = np.swapaxes(losses.slopes[:DENSE], 0, 1).reshape(
            len(rows), 4 * DENSE)
        some = rows.any(axis=1) | slopes.any(axis=1)
        return {
            'pairs': self._pairs[some].astype(float), 'rows': rows[some], 'slopes': slopes[some]}

    def load_state(self, tree: StateTree) -> None:
        """Restore the springs from a checkpoint; their pairs are listed."""
        pairs = tree.array('pairs')
        if not pairs.size:
            return
        count, losses = len(pairs), self._losses
        pairs = tree.array('pairs', (count, 2))
        rows = tree.array('rows', (count, 4 * len(_CARRIED_FIELDS)))
        slopes = tree.array('slopes', (count, 4 * DENSE))
        keys = {tuple(pair): place for place, pair in enumerate(self._pairs.tolist())}
        places = [keys.get((int(first), int(second)), -1) for first, second in pairs]
        if losses is None or min(places) < 0 or len(set(places)) < count or not (
                np.isfinite(rows).all() and np.isfinite(slopes).all()):
            raise ValueError('watch.stretches are of pairs that are not near, or no numbers')
        for number, name in enumerate(_CARRIED_FIELDS):
            getattr(losses, name)[places] = rows[:, 4 * number:4 * number + 4]
        losses.slopes[:DENSE, places] = np.swapaxes(
            slopes.reshape(count, DENSE, 4), 0, 1)


def carried(rows: np.ndarray, pairs: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return rows (p, 4) of `pairs` (p, 2) in the order of `others` (q, 2); 0 for new pairs."""
    found = np.zeros((len(others), rows.shape[1]))
    here, there = _places_of_both(others, pairs)
    found[here] = rows[there]
    return found


def _places_of_both(one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices, in each of two lists, of the pairs that both contain."""
    first, second = (
        (pairs[:, 0].astype(np.int64) << 32) + pairs[:, 1] for pairs in (one, other))
    _, here, there = np.intersect1d(first, second, assume_unique=True, return_indices=True)
    return here, there
