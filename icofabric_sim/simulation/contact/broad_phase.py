# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Broad phase of contact: when to search for candidate pairs, and which pairs they are.

While no pair can touch before the next search, kernels compute no contacts. Wherever forces are
evaluated, kernels record the displacements of bodies (terms/contacts/displacement.py, with a
proof of the bound) and request the next search in time.
"""

from dataclasses import dataclass
import logging
import math
from typing import Any, NamedTuple

from icofabric_sim.geometry.icosahedron import circumscribed_radius, inscribed_radius
from icofabric_sim.kernels.records import Blocks, Model, State
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.kernels.runtime.outlined import address_of
from icofabric_sim.simulation.checkpoints.state_tree import as_number, StateTree
from icofabric_sim.simulation.contact.conflicts import name_conflict
from icofabric_sim.simulation.contact.friction_state import FrictionState, lightest
from icofabric_sim.simulation.contact.neighbour_list import Near, NeighbourList
from icofabric_sim.simulation.contact.passing import (
    bezier_points,
    Course,
    first_passing,
    turned_at_most,
)
from icofabric_sim.simulation.contact.setup import ContactSetup
from icofabric_sim.simulation.model.layout import aligned_empty, Layout
from icofabric_sim.terms.contacts.displacement import (
    HORIZON,
    LATE,
    LIMIT_COUNT,
    longest_step,
    MAX_REACH,
    MIN_REACH,
    MOST_STRIDE,
    OWN,
    pace,
    REACH_FACTOR,
    set_reach,
    SKIN,
    SOON,
    SPEED,
    STRIDE,
)
from icofabric_sim.terms.contacts.force import contact_look, LEAST_PART, touch_some
from icofabric_sim.terms.contacts.listing import arrange
from icofabric_sim.terms.contacts.pair import contact_scratch, found_gap, OUT_SIZE
from icofabric_sim.terms.contacts.rebuild_check import least_reach
from icofabric_sim.terms.contacts.record import Contacts, Sleep, Watch
from icofabric_sim.terms.contacts.sleeping import AWAKE
from icofabric_sim.terms.contacts.stiffness import largest_stiffness
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')
# Approximate number of force evaluations between two searches if shells are near: a search takes
# as long as about ten evaluations.
LOOK_AFTER = 32
# Number of slots whose bodies are tracked in the time that the test of a pair takes.
SLOTS_OF_A_PAIR = 16


@dataclass(frozen=True)
class SearchSettings:
    """Tunables of the search for candidate pairs, and limits of overlaps."""

    min_reach_ratio: float = 0.01  # shortest reach of a search, over a
    reported_overlap_ratio: float = 0.01  # overlap over a that is reported once
    max_overlap_ratio: float = 0.2  # overlap over the inscribed radius that stops a run


_SETTINGS = SearchSettings()


class Overlap(NamedTuple):
    """Two shells, or a shell and a plane, whose overlap exceeds the intended one."""

    time: float  # [s]
    first: int
    second: int  # -1 - k: plane k
    depth: float  # [m]
    part: float  # depth over a
    plane: str  # name of the plane; '': a body

    def __str__(self) -> str:
        """Return a sentence for logs, summaries and bags."""
        other = f'plane {self.plane}' if self.plane else f'body {self.second}'
        return (
            f'body {self.first} and {other} overlap by {self.depth:.3g} m at t = '
            f'{self.time:.6g} s, {100.0 * self.part:.3g} % of a')


class Touching(NamedTuple):
    """The pairs in contact in one state."""

    bodies: np.ndarray  # (m, 2) int32; the second one -1 - k: plane k
    point: np.ndarray  # (m, 3) [m], world
    force: np.ndarray  # (m, 3) [N] on the first body, along the normal of the contact
    overlap: np.ndarray  # (m,) [m]
    planes: tuple[str, ...]  # names
    # (m, 3) [N] on the first body, along the surfaces, by the friction springs of the last step;
    # the whole friction force while sticking.
    spring: np.ndarray

    def describe(self, number: int) -> str:
        """Return the names of the bodies of a pair."""
        first, second = (int(body) for body in self.bodies[number])
        other = f'plane {self.planes[-1 - second]}' if second < 0 else f'body {second}'
        return f'body {first} and {other}'


NOTHING_TOUCHES = Touching(
    np.zeros((0, 2), np.int32), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), (),
    np.zeros((0, 3)))


class NoContacts:
    """Stand-in for the broad phase of a scene whose shells cannot touch; it does nothing."""

    is_possible = is_wary = lists_by_few_axes = False
    counts_listed = True
    contacts = watch = trial_watch = passing = None
    found: Overlap | None = None
    rate = least_rate = velocity_rate = stiffness = fall = displacement = 0.0
    touching_pairs = tests = evaluated = 0
    stride = 1
    longest_step = deepest = reported = math.inf
    searched = wary_until = -math.inf

    def has_touched(self) -> bool:
        """Return False."""
        return False

    def has_left(self, state: State, time: float) -> bool:
        """Return False."""
        return False

    def passing_by(
        self, before: State, after: State, start: float, end: float, *, long: bool
    ) -> str:
        """Return an empty text."""
        return ''

    def find_conflict(self, state: State) -> tuple[str, int]:
        """Return no conflict."""
        return '', 0

    def depth_of(self, number: int, state: State) -> float:
        """Return 0 m."""
        return 0.0

    def energies(self, state: State, stretches: np.ndarray | None) -> tuple[float, float]:
        """Return 0 J."""
        return 0.0, 0.0

    def touching(self, state: State, stretches: np.ndarray | None = None) -> Touching:
        """Return no pairs."""
        return NOTHING_TOUCHES

    def note(self, time: float, state: State) -> None:
        """Return no overlap."""

    def _ignore(self, *arguments: Any, **named: Any) -> None:
        """Do nothing."""

    announce = forget = forget_displacements = forget_friction = calm = count_touching = _ignore
    search = make_room = pace = miss = be_wary = rebase = take_over = _ignore


class BroadPhase:
    """Search for candidate pairs, repeated when bodies have moved far enough."""

    is_possible = True

    def __init__(self, setup: ContactSetup, layout: Layout, model: Model, threads: int) -> None:
        """Track the bodies of a `layout` for `threads` threads."""
        self.setup, self._layout, self._threads = setup, layout, threads
        self.stiffness = setup.stiffness  # [N/m] of a contact
        self._lists = NeighbourList(setup, layout)
        self._radius = circumscribed_radius(setup.largest)
        # Contacts that may occur before the next search; None: no pair is near.
        self.contacts: Contacts | None = None
        # Bound of the contribution of contacts to the squared frequency [1/s^2].
        self.rate = 0.0
        self.passing = setup.smallest
        self.deepest = _SETTINGS.max_overlap_ratio * inscribed_radius(setup.smallest)
        self.reported = _SETTINGS.reported_overlap_ratio * setup.smallest
        self.found: Overlap | None = None
        self._announced = False
        self._bodies = np.zeros((0, 2), np.int32)
        self._caution = 1.0
        self._listed, self._missed = 0.0, False
        # Longest step [s] until a time [s], after bodies exceeded the speed of a search.
        self._wary_step, self._wary_until = math.inf, -math.inf
        # True: all listed pairs contribute to the frequency; False: only pairs in contact. Then
        # the number of stiffest contacts of a body at the last health check, at least one.
        self.counts_listed, self._touching = True, 1.0
        # Number of pairs in contact at the last health check.
        self.touching_pairs = 0
        # True if additional pairs may be listed, because steps do not depend on listed pairs.
        self.lists_by_few_axes = False
        self._mobility = float(model.inverse_mass), float(model.inverse_inertia)
        self._sums = np.zeros(layout.slot_count)
        self._scratch = contact_scratch()
        shape = (4, layout.slot_count) if not layout.cosines else (3, 3, layout.slot_count)
        self.limits = np.zeros(LIMIT_COUNT)
        self.limits[[MIN_REACH, MAX_REACH, SKIN]] = (
            _SETTINGS.min_reach_ratio * setup.smallest, self._lists.most, self._lists.skin)
        self.limits[[SOON, LATE, STRIDE, MOST_STRIDE]] = math.inf, math.inf, 1, 1
        self._watch = Watch(
            aligned_empty((3, layout.slot_count)), aligned_empty(shape), np.zeros(7),
            self._radius, self.limits, np.zeros(8 * threads), self._lists.nearby, layout.carried)
        # Displacements of trial steps are discarded.
        unused = self.limits.copy()
        unused[STRIDE] = 2.0**62
        self._trial_watch = self._watch._replace(far=np.zeros(8 * threads), limits=unused)
        # Bound of the contribution of one contact to the squared frequency of its bodies [1/s^2].
        self.stretches = FrictionState(setup, lightest(model, setup))
        self.least_rate = self.stretches.least_rate
        self._rows = aligned_empty((6, layout.slot_count if layout.body_count else 0))
        # The last contacts, from which the next ones copy constant fields.
        self._made: Contacts | None = None
        # Number of pairs tested in the steps of the trajectory.
        self.tests = 0

    def has_touched(self) -> bool:
        """Return True if a pair touched in any evaluation since the last call."""
        if self.contacts is None:
            return False
        deepest = self.contacts.deepest[1::8]
        touched = bool((deepest > 0.0).any())
        deepest[:] = 0.0
        return touched

    @property
    def evaluated(self) -> int:
        """Number of pairs that kernels have tested since the last search, in all steps."""
        return 0 if self.contacts is None else int(self.contacts.tests.sum())

    @property
    def velocity_rate(self) -> float:
        """
        Rate [1/s] at which dissipative contact forces change velocities at intended overlaps.

        The power c K delta (d(delta)/dt)^2 is c delta times K (grad delta . u)^2, and the second
        derivatives of the energy contain K grad delta grad delta. Steps through contacts bound the
        damping themselves (terms/contacts/losses.py); the contacts are then mostly vertices and
        edges, far below the bound.
        """
        if not self.rate > 0.0:
            return 0.0
        if not self.counts_listed:
            return self.stretches.lag_rate
        own = self.stretches.lag_rate + self.stretches.damping_rate * self.reported
        return own * (self.rate / self.least_rate)

    @property
    def watch(self) -> Watch:
        """Displacement limits that kernels check."""
        if self._watch.nearby is not self._lists.nearby:
            self._watch = self._watch._replace(nearby=self._lists.nearby)
        return self._watch

    @property
    def trial_watch(self) -> Watch:
        """Displacement limits for trial steps, whose displacements are discarded."""
        if self._trial_watch.nearby is not self._lists.nearby:
            self._trial_watch = self._trial_watch._replace(nearby=self._lists.nearby)
        return self._trial_watch

    @property
    def fall(self) -> float:
        """Acceleration [m/s^2] of free bodies towards held bodies."""
        return 0.0 if self.setup.free else float(np.linalg.norm(self.setup.fall))

    @property
    def longest_step(self) -> float:
        """Longest step [s] in which no body moves beyond the reach of a search."""
        return float(longest_step(self.limits))

    def pace(self, step: float, stages: int, *, alone: bool) -> None:
        """
        Set the number of steps of `step` [s] between two checks of displacements.

        If `alone`, kernels may search without the caller, because the step size does not depend on
        the result.
        """
        self.limits[MOST_STRIDE] = max(LOOK_AFTER // stages, 1)
        pace(self.limits, step)
        self.limits[OWN] = float(
            alone and not self.is_wary and self.contacts is None and self._lists.is_small)

    @property
    def is_wary(self) -> bool:
        """True while steps are kept short because bodies exceeded the speed of the last search."""
        return self._wary_until > -math.inf

    @property
    def wary_until(self) -> float:
        """Time [s] until which steps are kept short; -inf if they are not."""
        return self._wary_until

    @property
    def stride(self) -> int:
        """Number of steps between two checks of displacements."""
        return int(self.limits[STRIDE])

    def be_wary(self, step: float, until: float) -> None:
        """
        Check displacements after each step until the time `until` [s].

        Bodies exceeded the speed of the last search in steps of `step` [s]. If each of these steps
        was checked already, steps become a quarter as long.
        """
        if not self.limits[STRIDE] > 1.0:
            step *= 0.25
        self._wary_step = min(step, 0.25 * self._wary_step) if self.is_wary else step
        self._wary_until = max(until, self._wary_until)

    def calm(self) -> None:
        """Allow steps as long as the speeds of a search permit."""
        self._wary_step, self._wary_until = math.inf, -math.inf

    @property
    def displacement(self) -> float:
        """Largest displacement [m] since the last search, recorded by a step."""
        return math.sqrt(self._watch.far.max(initial=0.0))

    def search(
        self, time: float, state: State, step: float, steps: float, *,
        displacement: float = 0.0
    ) -> None:
        """
        Find candidate pairs from `state` on at `time` [s].

        The search covers `steps` steps of `step` [s], at least the time until the next search, and
        a `displacement` [m] up to the longest reach.
        """
        velocity, limits = np.empty(3), self.limits
        speed = self._lists.survey(state, velocity)
        if not speed < math.inf:
            # The next health check ends the run.
            return
        watch = self._watch
        limits[SPEED] = speed
        watch.frame[0], watch.frame[1:4] = time, velocity
        if time < self._wary_until:
            displacement = math.inf
        watch.frame[4:7] = 0.5 * self.setup.fall if self.setup.free else 0.0
        limits[HORIZON] = self._caution * step * max(2.0 * steps, 1.1 * REACH_FACTOR)
        least = min(max(float(least_reach(limits, speed)), displacement), float(limits[MAX_REACH]))
        np.copyto(watch.reference, state.position)
        np.copyto(watch.turned, state.orientation)
        self._take(self._lists.find(
            state, least, limits[MAX_REACH], few_axes=self.lists_by_few_axes), least)
        if time < self._wary_until:
            # Before the next search, bodies may become so fast that a step covers its reach.
            reach = math.sqrt(limits[LATE])
            limits[SPEED] = max(speed, reach / (REACH_FACTOR * self._wary_step))

    def make_room(self, state: State) -> None:
        """Enlarge the list for all pairs near `state`; listed pairs remain."""
        self._lists.make_room(state.position)

    def _take(self, near: Near, least: float) -> None:
        set_reach(self.limits, near.reach, len(near.pairs) > 0)
        self.limits[OWN] = 0.0
        self._bodies = near.pairs
        self._listed = least if len(near.pairs) or self.setup.always else 0.0
        self.contacts = self._pack(near) if self._listed else None
        if self.contacts is None:
            self.stretches.forget()
        elif not self.contacts.touch_address:
            # Compilation of these kernels is reported.
            touch, gap = self._called(self.contacts)
            self.contacts = self._made = self.contacts._replace(
                touch_address=address_of(*touch), gap_address=address_of(*gap))
        self.rate = 0.0
        if len(near.pairs) and not self.counts_listed:
            self.rate = self.least_rate * self._touching
        elif len(near.pairs):
            # The quadratic form of a pair is at most `least_rate` times the kinetic form of its
            # two bodies; so the sum is at most `least_rate` times the largest number of pairs.
            pair = near.pairs[:, 1] >= 0
            share = np.bincount(np.concatenate([near.pairs[:, 0], near.pairs[pair, 1]]))
            self.rate = self.least_rate * float(share.max())

    def has_left(self, state: State, time: float) -> bool:
        """Return True if a body has moved beyond the displacement for which the list is valid."""
        unpack, watch = self._layout.unpack, self._watch
        looked = unpack(State(watch.reference, watch.turned, watch.reference, watch.reference))
        now, since = unpack(state), time - watch.frame[0]
        # Overflowing positions are out of reach; a health check reports the reason.
        with np.errstate(over='ignore', invalid='ignore'):
            shift = since * (watch.frame[1:4] + since * watch.frame[4:7])
            way = np.linalg.norm(now.position - shift - looked.position, axis=1)
            way += self._radius * turned_at_most(looked.orientation, now, now, 0.0)
            carriers = self._layout.carriers
            planes = np.linalg.norm(
                state.position[:, carriers] - watch.reference[:, carriers], axis=0)
        return not max(way.max(initial=0.0), planes.max(initial=0.0)) <= math.sqrt(
            self.limits[LATE])

    def _carried(self, before: State, after: State, length: float) -> np.ndarray | None:
        """
        Return displacements (5, k, 3) [m] of planes in a step of `length` [s], as `first_passing`.
        """
        slots = self._lists.nearby.carriers
        if slots is None:
            return None
        third = length / 3.0
        carried = np.stack([
            before.position, before.position + third * before.linear_velocity,
            after.position - third * after.linear_velocity, after.position,
            self._watch.reference])[:, :, slots]
        carried[:, :, slots < 0] = 0.0
        return np.swapaxes(carried, 1, 2)

    def passing_by(
        self, before: State, after: State, start: float, end: float, *, long: bool
    ) -> str:
        """
        Return a text on bodies that may have passed through each other in a step; or none.

        The step lasts from `start` to `end` [s]. If `long`, listed pairs may pass, too, between
        two evaluations. The same holds if bodies move by more than a relative to each other in the
        step.
        """
        unpack, watch = self._layout.unpack, self._watch
        looked = unpack(State(watch.reference, watch.turned, watch.reference, watch.reference))
        first, last, length = unpack(before), unpack(after), end - start
        frame, since = watch.frame, np.array([start, end])[:, None] - watch.frame[0]
        third, reach = length / 3.0, math.sqrt(self.limits[LATE])
        # A health check stops the run on overflow and reports the reason.
        with np.errstate(over='ignore', invalid='ignore'):
            places = since * (frame[1:4] + since * frame[4:7])
            speeds = frame[1:4] + 2.0 * since * frame[4:7]
            shift = np.stack([
                places[0], places[0] + third * speeds[0], places[1] - third * speeds[1],
                places[1]])
            course = Course(
                bezier_points(first, last, length) - shift[:, None],
                turned_at_most(looked.orientation, first, last, length))
            moved = np.linalg.norm(course.points - course.points[0], axis=2).max(initial=0.0)
            long = long or not 2.0 * moved <= self.setup.smallest
            found = first_passing(
                course, looked.position, self.setup.planes, shift, reach=reach,
                radius=circumscribed_radius(1.0) * self.setup.edges(
                    np.arange(self._layout.body_count)),
                seen=None if long else self._bodies, carried=self._carried(before, after, length))
        if found is None:
            return ''
        other = (
            f'body {found.second}' if found.second >= 0
            else f'plane {self.setup.names[-1 - found.second]}')
        return (
            f'body {found.first} and {other} may pass through each other undetected between t = '
            f'{start:.9g} s and {end:.9g} s: they move by {found.way:.3g} m against each other '
            f'in one step of {length:.6g} s, and contacts are known for displacements of '
            f'{reach:.3g} m')

    def miss(self, way_out: str) -> None:
        """
        Search farther from now on: bodies have moved beyond the reach of the last search.

        `way_out` names a remedy that shortens steps.
        """
        self._caution = min(2.0 * self._caution, 2.0**20)
        if not self._missed:
            self._missed = True
            _LOGGER.warning(
                'bodies moved so far in one step (up to %.3g m/s) that a contact may have been '
                'detected late: %s', self.limits[SPEED], way_out)

    def count_touching(self, state: State) -> None:
        """
        Bound the contact frequency by the pairs in contact in an evaluated `state`.

        This applies only if the bound does not include all listed pairs. The next contact may have
        the largest stiffness.
        """
        if self.contacts is None or self.counts_listed or not len(self._bodies):
            return
        self.touching_pairs = int(np.count_nonzero(self.contacts.aside[:, 9] > 0.0))
        found = float(largest_stiffness(
            self.contacts, state.position, *self._mobility, self.stretches.push_rate,
            self.stretches.stiffness if self.setup.friction > 0.0 else 0.0, self._sums))
        self._touching = max(found / self.least_rate, 1.0)
        self.rate = self.least_rate * self._touching

    def forget_displacements(self) -> None:
        """Discard displacements recorded before the last search."""
        self._watch.far[:] = 0.0

    def forget_friction(self) -> None:
        """Release all friction springs: the state has jumped."""
        self.stretches.forget()

    @property
    def searched(self) -> float:
        """Time [s] of the last search."""
        return float(self._watch.frame[0])

    def energies(self, state: State, stretches: np.ndarray | None) -> tuple[float, float]:
        """
        Return energies [J] of contacts and of friction springs in a state near the last search.
        """
        if self.contacts is None:
            return 0.0, 0.0
        energy = float(contact_look(self.contacts, state.position, state.orientation)[0])
        return energy, self.stretches.energy(self.contacts, stretches)

    @property
    def bodies(self) -> np.ndarray:
        """Listed pairs, (p, 2); the second body is -1 - k for plane k."""
        return self._bodies

    def touching(self, state: State, stretches: np.ndarray | None = None) -> Touching:
        """
        Return the contacts of a state near the last search; `stretches` are of friction springs.
        """
        if self.contacts is None:
            return NOTHING_TOUCHES
        contact_look(self.contacts, state.position, state.orientation)
        which = self.contacts.aside[:, 9] > 0.0
        found, bodies = self.contacts.aside[which], self._bodies[which]
        place = state.position[:, self._layout.slot].T
        # From the midpoint of both centres, or from the centre of a body on a plane.
        other = np.where(bodies[:, 1] >= 0, bodies[:, 1], bodies[:, 0])
        point = found[:, 15:18] + 0.5 * (place[bodies[:, 0]] + place[other])
        force, spring = self.setup.stiffness * found[:, 0:3], np.zeros((len(bodies), 3))
        if stretches is not None and len(stretches):
            spring = self.stretches.stiffness * stretches[which, :3]
            along = force / np.linalg.norm(force, axis=1, keepdims=True)
            spring -= (spring * along).sum(axis=1, keepdims=True) * along
        return Touching(bodies, point, force, found[:, 11], self.setup.names, spring)

    def note(self, time: float, state: State) -> Overlap | None:
        """Return the deepest overlap in a state."""
        if self.contacts is None or not len(self._bodies):
            return None
        contact_look(self.contacts, state.position, state.orientation)
        depth = self.contacts.aside[:, 11]
        number = int(np.argmax(depth))
        first, second = (int(body) for body in self._bodies[number])
        name = self.setup.names[-1 - second] if second < 0 else ''
        return Overlap(
            time, first, second, float(depth[number]),
            float(depth[number]) / self.setup.smallest, name)

    def find_conflict(self, state: State) -> tuple[str, int]:
        """
        Return prescribed motions that press bodies on in a state, and the number of their pair.

        The text is empty if overlaps are as intended, or if bodies can yield.
        """
        if self.note(0.0, state) is None or self.contacts is None:
            return '', 0
        aside, setup = self.contacts.aside, self.setup
        moving = setup.moving or (False,) * len(setup.names)
        for number in np.argsort(-aside[:, 11]).tolist():
            if not aside[number, 11] > self.reported:
                break
            text = name_conflict(
                setup.prescribed, list(zip(setup.names, moving)), self._bodies[number],
                aside[number], setup.half_edge)
            if text:
                return text, number
        return '', 0

    def depth_of(self, number: int, state: State) -> float:
        """Return the overlap [m] of a listed pair in a state; 0 if apart."""
        if self.contacts is None:
            return 0.0
        contact_look(self.contacts, state.position, state.orientation)
        return float(self.contacts.aside[number, 11])

    def forget(self) -> None:
        """Reset the search to the beginning of a run."""
        self.found, self._announced = None, False
        self._caution, self._missed = 1.0, False
        self.calm()
        self.tests, self._touching, self.touching_pairs = 0, 1.0, 0

    def announce(self) -> None:
        """Warn once of an overlap that exceeds the intended one."""
        if self.found is not None and not self._announced:
            self._announced = True
            _LOGGER.warning(
                '%s: more than the intended 1 %%; give a larger contact.stiffness', self.found)

    def rebase(self, time: float) -> None:
        """Restart at another `time` [s], without displacements."""
        self._watch.frame[0] = time
        if self.found is not None:
            self.found = self.found._replace(time=time)

    def take_over(self, found: Overlap | None) -> None:
        """Continue after another search of the same motion, which has issued its warning."""
        if found is not None:
            self.found, self._announced = found, True

    def state_tree(self) -> dict[str, Any]:
        """Return the state and purpose of the last search, and the reported overlap."""
        gather, watch, limits = self._layout.gather_moving, self._watch, self.limits
        tree: dict[str, Any] = {
            'reference': gather(watch.reference), 'turned': gather(watch.turned),
            'frame': watch.frame.copy(), 'late': float(limits[LATE]), 'listed': self._listed,
            'stride': int(limits[STRIDE]), 'speed': float(limits[SPEED]),
            'horizon': float(limits[HORIZON]), 'alone': bool(limits[OWN]),
            'most_stride': int(limits[MOST_STRIDE]), 'caution': self._caution,
            'missed': self._missed, 'announced': self._announced, 'tests': self.tests}
        if not self.counts_listed:
            tree['touching'], tree['touching_pairs'] = self._touching, self.touching_pairs
        if self.is_wary:
            tree['wary_step'], tree['wary_until'] = self._wary_step, self._wary_until
        if self.found is not None:
            tree['found'] = [*self.found]
        if self.setup.friction > 0.0:
            tree['stretches'] = self.stretches.state_tree()
        return tree

    def load_state(self, tree: StateTree) -> None:
        """Restore the search from a checkpoint."""
        layout, watch, limits = self._layout, self._watch, self.limits
        watch.reference[:] = 0.0
        slots, rows = layout.moving_slots, watch.turned.shape[:-1]
        watch.reference[:, slots] = tree.array('reference', (len(slots), 3)).T
        watch.turned[..., slots] = np.moveaxis(
            tree.array('turned', (len(slots), *rows)), 0, -1)
        watch.frame[:] = tree.array('frame', (7,))
        limits[SPEED], limits[HORIZON] = (
            tree.number('speed', 0.0), tree.number('horizon', 0.0))
        self._caution, self._missed = tree.number('caution', 1.0), tree.flag('missed')
        self.calm()
        if 'wary_until' in tree:
            self._wary_step = tree.number('wary_step', 0.0)
            self._wary_until = tree.number('wary_until')
        self._announced, self.tests = tree.flag('announced'), tree.count('tests')
        self.found = self._judged(tree.entries('found')) if 'found' in tree else None
        if not self.counts_listed:
            self._touching = max(tree.number('touching', 1.0), 1.0)
            self.touching_pairs = tree.count('touching_pairs')
        late, listed = tree.number('late', 0.0, finite=False), tree.number('listed', 0.0)
        reach, most = math.sqrt(late), float(limits[MAX_REACH])
        if not reach <= 1.0001 * most:
            raise ValueError('watch.late is longer than any reach')
        reach = min(reach, most)
        there = State(watch.reference, watch.turned, watch.reference, watch.reference)
        near = Near(reach, np.zeros((0, 2), np.int32))
        if listed > 0.0:
            self._lists.survey(there, np.empty(3))
            near = self._lists.find(
                there, min(listed, most), most, few_axes=self.lists_by_few_axes)
        self.stretches.forget()
        self._take(near._replace(reach=reach), listed)
        limits[MOST_STRIDE] = tree.count('most_stride', 1)
        limits[STRIDE] = tree.count('stride', 1)
        alone = tree.flag('alone')
        limits[OWN] = float(alone and self.contacts is None and self._lists.is_small)
        if self.setup.friction > 0.0:
            self.stretches.load_state(tree.part('stretches'))

    def _judged(self, entry: list[Any]) -> Overlap:
        """
        Return the overlap that a list of values describes; raise ValueError for an invalid list.
        """
        if len(entry) == 6:
            time, first, second, depth, part, plane = entry
            bodies, planes = range(self._layout.body_count), len(self.setup.names)
            pair = type(first) is int and first in bodies and type(second) is int and (
                second in bodies or -planes <= second < 0)
            numbers = None not in (as_number(time), as_number(depth), as_number(part))
            if pair and numbers and isinstance(plane, str):
                return Overlap(
                    float(time), first, second, float(depth), float(part), plane)
        raise ValueError('watch.found is not a time, a pair of bodies and an overlap')

    def is_ready(self) -> bool:
        """Return True if the kernels called for candidate pairs are compiled."""
        return all(
            kernel.is_ready(*arguments) for kernel, *arguments in self._called(self.nothing()))

    def _called(self, contacts: Contacts) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """Return the kernels that contacts call by address, with arguments of the same types."""
        watch, scratch, place = self._watch, contacts.scratch, contacts.first[0]
        return (
            (touch_some, contacts, watch.reference, watch.turned, scratch, contacts.result,
             contacts.sleep.until, 0.0, contacts.earlier, 0, 1),
            (found_gap, contacts.half_edge, contacts.half_edge, place[0], place[1:], place[0],
             place[1:], scratch))

    def nothing(self) -> Contacts:
        """
        Return empty contacts, of the type of all contacts; valid only without candidate pairs.
        """
        return self._pack(Near(0.0, np.zeros((0, 2), np.int32)))

    def _pack(self, near: Near) -> Contacts:
        """
        Return contacts for the kernels: each pair once, and the entries of each block in order.
        """
        layout, count = self._layout, len(near.pairs)
        slots, room = np.empty((count, 2), np.int32), np.empty(layout.slot_count, np.int64)
        entries = count + int(np.count_nonzero(near.pairs[:, 1] >= 0))
        slot, entry = np.empty(entries, np.int32), np.empty(entries, np.int32)
        start = np.zeros(len(layout.blocks.slot) + 1, np.int32)
        arrange(near.pairs, layout.slot, layout.blocks.slot, room, slots, start, slot, entry)
        rows = self._rows
        rows[:] = 0.0
        changed: dict[str, Any] = {
            'pairs': slots, 'result': np.zeros((count, OUT_SIZE)), 'start': start, 'slot': slot,
            'entry': entry, 'deepest': np.zeros(8 * self._threads),
            'tests': np.zeros(8 * self._threads),
            'latest': np.full(8 * self._threads, -1),
            'earlier': np.zeros(count // LEAST_PART + 2, np.int64),
            'aside': np.zeros((count, OUT_SIZE)),
            'sleep': self._sleep(count),
            'losses': self.stretches.room(near.pairs, rows.shape[1], self._pushed(near, slot))}
        if self._made is None:
            # Replacing fields takes half of the time of a new record.
            self._made = Contacts(
                stiffness=self.setup.stiffness, half_edge=self.setup.half_edge,
                planes=self.setup.planes, rows=rows, turns=self._turns(),
                pushes=np.zeros(len(layout.blocks.slot)),
                first=np.zeros((self._threads, 8, 3)),
                second=np.zeros((self._threads, 8, 3)), scratch=self._scratch, touch_address=0,
                gap_address=0, half_edges=self._half_edges(),
                carriers=self._lists.nearby.carriers, **changed)
        else:
            self._made = self._made._replace(**changed)
        return self._made

    def _pushed(self, near: Near, slots: np.ndarray) -> np.ndarray:
        """Return the slots of the bodies of pairs, `slots`, and those of carriers of planes."""
        carriers = self._lists.nearby.carriers
        if carriers is None:
            return slots
        planes = carriers[-1 - near.pairs[near.pairs[:, 1] < 0, 1]]
        return np.concatenate([slots, planes[planes >= 0]])

    def _half_edges(self) -> np.ndarray | None:
        """Return the half edges [m] of all slots; None if all bodies are equal."""
        if self.setup.half_edges is None:
            return None
        edges = np.full(self._layout.slot_count, self.setup.half_edge)
        edges[self._layout.slot] = self.setup.half_edges
        return edges

    def _turns(self) -> np.ndarray:
        """Return the index of the block of each slot number over LANES."""
        slots = self._layout.blocks.slot
        turns = np.full(max(self._layout.slot_count // LANES, 1), -1, np.int32)
        turns[slots // LANES] = np.arange(len(slots))
        return turns

    def _sleep(self, count: int) -> Sleep:
        """Let pairs sleep if tracking all bodies is cheaper than testing `count` pairs."""
        layout = self._layout
        blocks, rows = layout.blocks, self._watch.turned.shape[:-1]
        if layout.carried is not None:
            blocks = blocks._replace(alive=blocks.alive | layout.carried[blocks.slot // LANES])
        followed = layout.slot_count
        if not SLOTS_OF_A_PAIR * count > followed:
            blocks, followed = Blocks(blocks.slot[:0], blocks.alive[:0], blocks.reach), 0
        position, orientation = aligned_empty((3, followed)), aligned_empty((*rows, followed))
        position[:], orientation[:] = 0.0, 0.0
        path = np.zeros(8 * self._threads)
        path[0] = AWAKE
        changed: dict[str, Any] = {
            'blocks': blocks, 'position': position, 'orientation': orientation, 'path': path,
            'until': np.full(count, AWAKE), 'looked': np.full(count, AWAKE),
            'axis': np.zeros((count, 3)),
            'awake': np.zeros(count, np.int32)}
        if self._made is None:
            return Sleep(radius=self._radius, free=self.setup.free, **changed)
        return self._made.sleep._replace(**changed)
