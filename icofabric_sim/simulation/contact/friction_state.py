# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The stretches of friction between two searches: what pairs keep while lists of pairs change."""

import math
from typing import Any

from icofabric_sim.geometry.icosahedron import circumscribed_radius
from icofabric_sim.kernels.contact.listing import carry_over, find_both
from icofabric_sim.kernels.records import ContactLosses, Contacts, Model
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.contact.setup import ContactSetup
from icofabric_sim.simulation.model.layout import aligned_empty
import numpy as np

# Stiffness along a surface beside that of the contact: then a sphere that is hit obliquely swings
# back as long as it is pushed (J. Schaefer, S. Dippel and D. E. Wolf, J. Phys. I 6, 5, 1996).
TANGENTIAL = 2.0 / 7.0
# Above the largest second derivative of the energy of a contact that a search found, in parts of
# K, by the places and a times the rotation angles of both bodies (docs/contact.md).
CURVATURE = 7.0
# Squared distance, over a^2, at which a turn about the normal is resisted at most.
_PATCH = 0.25
_ROWS = ('stretch', 'held', 'start', 'saved')
SLOPES = 16
# Those that a step leaves behind; dense output finds the others again.
_KEPT_SLOPES = 13


def contact_losses(contacts: Contacts | None) -> ContactLosses | None:
    """Return what contacts lose energy by; None where nothing is near, or nothing is lost."""
    return None if contacts is None else contacts.losses


def lightest(model: Model, setup: ContactSetup) -> float:
    """The larger of 1 / M and a^2 / Lambda [1/kg] of bodies, see CURVATURE."""
    return float(max(model.inverse_mass, setup.largest**2 * model.inverse_inertia))


def frequency_of(model: Model, setup: ContactSetup) -> float:
    """The highest frequency [rad/s] of two bodies that push each other."""
    return math.sqrt(CURVATURE * setup.stiffness * lightest(model, setup))


class FrictionState:
    """Friction springs of the pairs that are listed, and room for what they lose; none without."""

    def __init__(self, setup: ContactSetup, lightest: float) -> None:
        """Start without any; `lightest`: larger of 1 / M and a^2 / Lambda [1/kg]."""
        self._setup = setup
        self.stiffness = TANGENTIAL * setup.stiffness
        self._pairs = np.zeros((0, 2), np.int32)
        self._losses: ContactLosses | None = None
        # The slip of a body is dx + theta x arm along the surface, with an arm of at most R, and
        # at most sqrt(_PATCH) a theta about the normal; that of a pair is a difference of two. So
        # its square is at most that times the sum of the squares of places and a times angles.
        radius = circumscribed_radius(1.0)
        most = 2.0 * (1.0 + radius**2 + _PATCH) if setup.friction > 0.0 else 0.0
        # [1/s^2] what a contact adds to the squared frequency of its bodies at most; its push.
        self.push_rate = lightest * CURVATURE * setup.stiffness
        self.least_rate = self.push_rate + lightest * most * self.stiffness
        # The dashpot is as quick as that, so that it asks for no shorter steps.
        self.lag = self.least_rate ** -0.5
        # [1/s] the rate at which the dashpot changes velocities, and damping for each m of depth.
        self.lag_rate = lightest * most * self.stiffness * self.lag
        self.damping_rate = lightest * CURVATURE * setup.stiffness * setup.damping

    def room(
        self, pairs: np.ndarray, slot_count: int, slots: np.ndarray
    ) -> ContactLosses | None:
        """
        Room for the losses of other pairs (p, 2); those that were listed keep their stretches.

        `slots` of all of their bodies.
        """
        setup, before, old = self._setup, self._losses, self._pairs
        if not setup.spends:
            return None
        spent = aligned_empty((1, slot_count))
        lead, lost = aligned_empty((6, slot_count)), aligned_empty((6, slot_count))
        spent[:] = lead[:] = lost[:] = 0.0
        if before is not None:
            # What a kick has yet to spend outlasts a search.
            lost[:, slots] = before.lost[:, slots]
        rows = len(pairs) if setup.friction > 0.0 else 0
        self._pairs = pairs
        stretch, held, start, stage, saved = (np.zeros((rows, 4)) for _ in range(5))
        self._losses = losses = ContactLosses(
            setup.damping, setup.friction, self.stiffness, self.lag, np.zeros(len(pairs)), spent,
            stretch, held, start, stage, saved, np.zeros((SLOPES, rows, 4)), lead,
            np.zeros((len(pairs), 9)), lost)
        if before is not None and rows:
            here, there = np.empty(len(pairs), np.int64), np.empty(len(pairs), np.int64)
            both = int(find_both(pairs, old, here, there))
            here, there = here[:both], there[:both]
            for name in _ROWS:
                carry_over(here, there, getattr(before, name)[None], getattr(losses, name)[None])
            carry_over(here, there, before.slopes, losses.slopes)
        return losses

    def forget(self) -> None:
        """Nothing is stretched: another state begins, or nothing is near."""
        if self._losses is not None:
            for name in (*_ROWS, 'slopes'):
                getattr(self._losses, name)[:] = 0.0
            self._losses.lost[:] = 0.0

    def energy(self, contacts: Contacts, stretches: np.ndarray | None) -> float:
        """
        Energy [J] in the springs of what touches, in a state that `contact_look` has just seen.
        """
        if stretches is None or not len(stretches):
            return 0.0
        touching = contacts.aside[:, 9] > 0.0
        # As a sum that depends on no order.
        return 0.5 * self.stiffness * math.fsum((stretches[touching]**2).ravel())

    def state_tree(self) -> dict[str, Any]:
        """What is stretched, or was in the step in progress."""
        losses = self._losses
        if losses is None:
            return {name: np.zeros((0, 0)) for name in ('pairs', 'rows', 'slopes')}
        rows = np.hstack([getattr(losses, name) for name in _ROWS])
        slopes = np.swapaxes(losses.slopes[:_KEPT_SLOPES], 0, 1).reshape(
            len(rows), 4 * _KEPT_SLOPES)
        some = rows.any(axis=1) | slopes.any(axis=1)
        return {
            'pairs': self._pairs[some].astype(float), 'rows': rows[some], 'slopes': slopes[some]}

    def load_state(self, tree: StateTree) -> None:
        """Go on from there; the pairs are listed."""
        pairs = tree.array('pairs')
        if not pairs.size:
            return
        count, losses = len(pairs), self._losses
        pairs = tree.array('pairs', (count, 2))
        rows = tree.array('rows', (count, 4 * len(_ROWS)))
        slopes = tree.array('slopes', (count, 4 * _KEPT_SLOPES))
        keys = {tuple(pair): place for place, pair in enumerate(self._pairs.tolist())}
        places = [keys.get((int(first), int(second)), -1) for first, second in pairs]
        if losses is None or min(places) < 0 or len(set(places)) < count or not (
                np.isfinite(rows).all() and np.isfinite(slopes).all()):
            raise ValueError('watch.stretches are of pairs that are not near, or no numbers')
        for number, name in enumerate(_ROWS):
            getattr(losses, name)[places] = rows[:, 4 * number:4 * number + 4]
        losses.slopes[:_KEPT_SLOPES, places] = np.swapaxes(
            slopes.reshape(count, _KEPT_SLOPES, 4), 0, 1)


def carried(rows: np.ndarray, pairs: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Rows (p, 4) of `pairs` (p, 2) in the order of `others` (q, 2); zero where one is new."""
    found = np.zeros((len(others), rows.shape[1]))
    here, there = _places_of_both(others, pairs)
    found[here] = rows[there]
    return found


def _places_of_both(one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where pairs that both lists have are, in each of them."""
    first, second = (
        (pairs[:, 0].astype(np.int64) << 32) + pairs[:, 1] for pairs in (one, other))
    _, here, there = np.intersect1d(first, second, assume_unique=True, return_indices=True)
    return here, there
