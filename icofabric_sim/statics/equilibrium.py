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
"""
Equilibria (eq 48): configurations in which no force and no moment is left on any body.

The potential energy is minimised by a trust region method on positions and rotations, so every
accepted step lowers it; the Hessian is the analytic one, also where it is singular. Loads that
turn with their bodies, and torques, have no potential: within a step they count as they are at its
start, and as they are found at its end in the next.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
import logging
import math
from typing import Any, NamedTuple

from icofabric_sim import checks
from icofabric_sim.checks import counted
from icofabric_sim.kernels.conjugate import product_of, weighted_square
from icofabric_sim.parameters.table import OBJECTIVES
from icofabric_sim.scene.scene import require_scene, Scene
from icofabric_sim.simulation.load_cells import ContactForces, Reactions
from icofabric_sim.simulation.model.as_table import AsTable
from icofabric_sim.simulation.model.body_force import as_body_force, BodyForce, Force
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.statics.admissible import find_admissible
from icofabric_sim.statics.contacts import Contacts, StaticContacts
from icofabric_sim.statics.crossings import Crossings
from icofabric_sim.statics.fabric import check_snapshot, Configuration, StaticFabric
from icofabric_sim.statics.friction import FrictionPath, Relaxation, Rubbing
from icofabric_sim.statics.held import check_time, held_time, without_potential
from icofabric_sim.statics.reactions import reactions_of
from icofabric_sim.statics.resultants import find_least_resultants, LEAST
from icofabric_sim.statics.sides import BRANCHES, PULL, PUSH, SOFT, STIFF
from icofabric_sim.statics.spectrum import Curvature, judge_curvature
from icofabric_sim.statics.trust_region import steihaug, Step
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')

STABLE = 'equilibrium, stable'
MECHANISM = 'equilibrium, with mechanisms'
UNSTABLE = 'equilibrium, unstable'
# Of fabrics that are too large for it: no motion was found that lowers the energy.
NOT_COUNTED = 'equilibrium, mechanisms not counted'
# Connectors are at their natural length, and whether all motions cost energy depends on which of
# them pull and which push.
AT_KINK = 'equilibrium, stability depends on the kink'
NOT_AT_REST = 'not in equilibrium'

_AT_REST = ('body', 'x_m', 'y_m', 'z_m', 'qx', 'qy', 'qz', 'qw')
_STEPS = 2_000
RESULTANTS = 'resultants'
# Products with the Hessian in a step, for each freedom, and at most.
_PRODUCTS = 2.0
_MOST_PRODUCTS = 5_000
# Largest turn [rad] of a body in one step.
_LARGEST_TURN = 0.7
# A step is taken that brings this part of what was expected of it; so many lengths are tried.
_LEAST_GAIN, _TRIES = 1e-4, 4
_PIECES = 20  # of a step that crosses kinks
# After a step that brings less than this part of what was expected, because shells met or parted
# in it, so many steps look out for that: up to so many times as far as a body goes, and at most so
# far in parts of a. Not where forces have died out: overlaps are next to nothing there.
_POOR, _MEETING_STEPS, _REACH, _LARGEST_REACH = 0.5, 30, 3.0, 0.05
# Steps of a search that does not look out for it; it costs much where much is near.
_FIRST_STEPS = 800
# Residual with which contacts are made stiffer; steps after which they are made softer again.
_NEAR, _PATIENCE = 1e-3, (200, 400, 800, math.inf)
# Below this part of the energy its differences are rounding.
_ROUNDING = 1e-9
# Forces that have fallen below this part of the first ones are measured by those, and are sought
# to die out for so many further steps.
_DIED_OUT, _SLACK_STEPS = 1e-7, 200
# Rounds in which pushes and friction are to agree, to this part of the largest force.
_ROUNDS, _SETTLED = 60, 1e-8
# Rounds in which contacts that stick find where they touch; gap over a up to which they do first.
_ROLLS, _NEARLY_RATIO = 12, 0.02
# A body that has gone so many times as far as the fabric is large does not come back.
_AWAY = 1e4


class Progress(NamedTuple):
    """Where the search stands."""

    steps: int
    residual: float  # the largest force that is left over the largest that acts
    energy: float  # [J]


@dataclass(frozen=True, repr=False)
class Equilibrium(AsTable):
    """Where the search ended, and what holds there."""

    snapshot: Snapshot
    converged: bool
    # The largest force, or torque over a, left on a free body, over the largest force that acts.
    residual: float
    verdict: str
    # Motions that cost no energy, rigid ones of the whole included; -1: not counted, because the
    # fabric is not in equilibrium or has more than 400,000 freedoms.
    mechanism_count: int
    unstable_count: int  # motions that lower it; -1: not counted; of large fabrics 1: some
    force_scale: float  # [N]
    leftover: np.ndarray  # (n, 6) forces [N] and torques [N m] left on free bodies
    tension: np.ndarray  # (c,) [N], positive where connectors pull
    touching: Contacts | None  # what touches there; None where the scene has no contact
    reaction: np.ndarray  # (n, 6) forces [N] and torques [N m] of supports and drives on bodies
    step_count: int
    product_count: int
    # Connectors, by number, and anchors, by name, at their natural length, where k_e is not k_c.
    # The counts above are then of motions for which no side of them matters.
    at_kink: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    anchors_at_kink: tuple[str, ...] = ()
    # Motions that cost no energy, and that lower it, with k_e in all of these ('pull') and with
    # k_c ('push'); empty where nothing is at its kink.
    branches: Mapping[str, Curvature] = field(default_factory=dict)
    # Pairs of shells, or shells and planes, at their first touch: they count as open, and resist
    # when they are pressed.
    first_touches: int = 0
    # Why no equilibrium was found, and what to try; '': one was.
    reason: str = ''
    # What supports, drives, anchors and planes bear, each by its name.
    reactions: Reactions | None = None
    # What friction does, on a path of states; None where nothing rubs.
    rubbing: Rubbing | None = None
    # Force, torques and point of each contact, friction included; None where nothing can touch.
    contacts: ContactForces | None = None
    # The least contact.friction with which contact forces balance the loads; infinite: none does.
    # NaN: not a single equilibrium with friction.
    friction_needed: float = math.nan

    def __repr__(self) -> str:
        """Say what was found, without the numbers."""
        return (f'<Equilibrium: {self.verdict}, residual {self.residual:.2g}, '
                f'{counted(len(self.snapshot.position), "body")}>')

    def table(self) -> dict[str, list[Any]]:
        """Bodies at rest, and what supports and drives bear: a list for each column."""
        columns = self.snapshot.table()
        at_rest = {name: columns[name] for name in _AT_REST}
        names = [f'reaction_{axis}_n' for axis in 'xyz'] + [
            f'reaction_torque_{axis}_nm' for axis in 'xyz']
        return {**at_rest, **dict(zip(names, self.reaction.T.tolist()))}

    @property
    def worst_bodies(self) -> tuple[int, ...]:
        """At most four bodies on which the most is left."""
        size = np.abs(self.leftover[:, :3]).max(axis=1)
        return tuple(int(b) for b in np.argsort(-size, kind='stable')[:4] if size[b] > 0.0)


def solve_equilibrium(
    scene: Scene, *, start: Snapshot | None = None, time: float | None = None,
    tolerance: float = 1e-10, largest_step_count: int = _STEPS, load_factor: float = 1.0,
    body_force: BodyForce | Force | None = None, objective: str | None = None,
    progress: Callable[[Progress], None] | None = None
) -> Equilibrium:
    """
    Find where a fabric comes to rest under its loads, supports and drives.

    Parameters
    ----------
    scene
        The fabric. With `contact.friction` the result is one that can be: see Notes.
    start
        Where the search begins, without what is broken there; None: the initial state.
    time
        Time [s] at which loads, drives and anchors are held; needed where they change with it.
    tolerance
        Largest force that may be left, as a ratio to the largest connector force or load.
    largest_step_count
        Steps after which the search gives up.
    load_factor
        Factor of weight, electric fields, loads, tractions and the body force.
    body_force
        A function or `BodyForce` of the user, as `compile_scene` takes it (`ico.surface_force`
        makes one), at that time and at velocities 0. Its derivatives are differences of it.
    objective
        'energy': the potential energy, with contacts as springs. 'resultants': the sum of squares
        of the force and moment resultants (torques over a) on free bodies, without contact forces
        and without overlap, as the document says after eq 48. `leftover` then has the resultants
        that contacts must bear; where they are not 0 the verdict is 'least resultants'. None: the
        `equilibrium.objective` of the scene.
    progress
        Called with the state of the search at each step.

    Returns
    -------
    Equilibrium
        State, verdict, what is left over, tensions, reactions and contacts.

    Raises
    ------
    ValueError
        If nothing could ever be in equilibrium, the body force acts between bodies, or forces
        without a potential act and the objective is 'resultants'.

    Notes
    -----
    With friction a fabric rests in many ways, which depend on how it came there; `step_loads`
    follows a path. Here all that touches sticks while the configuration is sought; where that
    takes more friction than there is, nothing rubs, if a search so finds an equilibrium. Contact
    forces within the friction cones are then sought that balance all loads in it, with the
    largest smallest margin (`contacts.margin`, see admissible.py). Where none do, the verdict is
    'not in equilibrium', the reason says that it slides, and `leftover` has what is left.

    References
    ----------
    Eqs 48 and 49 of the document; Steihaug (1983) for the trust-region step.

    """
    force = _check(scene, start, time, tolerance, largest_step_count, progress, body_force)
    load_factor = checks.number('load_factor', load_factor, least=0.0)
    if objective is None:
        objective = scene.parameters['equilibrium.objective']
    checks.choice('objective', objective, OBJECTIVES)
    friction = FrictionPath.of(scene)
    fabric = StaticFabric(
        scene, held_time(scene, time), load_factor=load_factor,
        broken_since=None if start is None else start.broken_since,
        anchors_broken_since=None if start is None else start.anchors_broken_since,
        friction=friction, body_force=force)
    fabric.require_steady(time)
    if objective == RESULTANTS:
        return seek_least_resultants(fabric, start, tolerance, largest_step_count, progress)
    return seek(fabric, start, tolerance, largest_step_count, progress)


def seek_least_resultants(
    fabric: StaticFabric, start: Snapshot | None, tolerance: float, largest_step_count: int,
    progress: Callable[[Progress], None] | None
) -> Equilibrium:
    """Minimise the resultants of a `fabric`, whose contacts are constraints; see resultants.py."""
    turning = _without_potential(fabric, fabric.start)
    if turning:
        raise ValueError(
            f"objective 'resultants' needs forces that have a potential: {', '.join(turning)} "
            "turns with its bodies or twists them; leave it out, or take the objective 'energy' "
            '(equilibrium.objective)')
    bare = fabric.without_contacts()
    fabric.friction = None

    def report(steps: int, here: Configuration) -> None:
        if progress is not None:
            progress(Progress(steps, _Search(bare, here, tolerance, 0, None).residual(), math.nan))

    found = find_least_resultants(
        bare, fabric, _start(bare, start), largest_step_count, report)
    result = replace(
        _Search(bare, found.here, tolerance, found.step_count, None).result(),
        touching=found.there.touching, step_count=found.step_count)
    if result.converged:
        return result
    return replace(
        result, converged=found.converged, reason=found.reason,
        verdict=LEAST if found.converged else NOT_AT_REST)


def seek(
    fabric: StaticFabric, start: Snapshot | None, tolerance: float, largest_step_count: int,
    progress: Callable[[Progress], None] | None
) -> Equilibrium:
    """Find where a `fabric` comes to rest; see `solve_equilibrium`."""
    friction, contacts = fabric.friction, fabric.contacts
    if friction is None or contacts is None:
        return _sought(fabric, start, tolerance, largest_step_count, progress).result()
    here = fabric.start if start is None else fabric.configuration('start', start)
    first = start
    for turn in range(_ROLLS):
        # What touches sticks, where it touches now: bodies roll and tip on their way. At first
        # what nearly does, too: it would slide off before it touched.
        fabric.friction = friction = friction.advanced(
            contacts, here.position, here.axes, *([] if turn else [_NEARLY_RATIO]))
        search = _sought(fabric, start, tolerance, largest_step_count, progress)
        found = _held_by_friction(search, friction.coefficient)
        here = search.here
        start = here.snapshot
        if found.converged or not search.steps or not search.is_at_rest:
            break
        if not turn:
            # What rests without friction needs none.
            fabric.friction = None
            smooth = _sought(fabric, first, tolerance, largest_step_count, progress)
            if smooth.is_at_rest:
                return _held_by_friction(smooth, friction.coefficient)
    return found


def _held_by_friction(search: '_Search', coefficient: float) -> Equilibrium:
    """Judge whether contact forces within their cones hold what was found with sticking ones."""
    result = search.result()
    if not result.converged:
        return result
    here = search.exact()
    held = find_admissible(here, coefficient)
    assert here.touching is not None
    force = here.force - here.touching.wrench + held.contacts.resultants(len(here.position))
    if here.rubbing is not None:
        force -= here.rubbing.wrench
    result = replace(
        result, contacts=held.contacts, reactions=reactions_of(here, force, held.contacts),
        reaction=np.where(here.fabric.free, 0.0, -force), rubbing=None,
        friction_needed=held.friction_needed)
    if held.is_balanced:
        return result
    left = float(np.linalg.norm(held.leftover[:, :3], axis=1).max())
    needed = held.friction_needed
    way_out = (
        f'it would hold with contact.friction of at least {needed:.6g}' if needed < math.inf else
        'more friction would not help: hold it by supports.NAME, anchors.NAME or planes.NAME')
    return replace(
        result, converged=False, verdict=NOT_AT_REST, mechanism_count=-1, unstable_count=-1,
        leftover=held.leftover, branches={}, residual=float(np.abs(held.leftover[:, :3]).max(
            initial=0.0) / here.force_scale), reason=(
                f'slides: no contact forces within the friction cones (contact.friction '
                f'{coefficient:g}) balance the loads, and up to {left:.4g} N is left on a body; '
                f'{way_out}'))


def _sought(
    fabric: StaticFabric, start: Snapshot | None, tolerance: float, largest_step_count: int,
    progress: Callable[[Progress], None] | None
) -> '_Search':
    """The same search where it has ended, not judged yet."""
    here = _start(fabric, start)
    refuse_free_fall(fabric)
    # Exact ones lead astray where an overlap gains or loses a corner next to where shells are.
    if fabric.contacts is not None:
        fabric.contacts.smoothed = True
    search = _Search(fabric, here, tolerance, largest_step_count, progress)
    # From a start that was given little is left to go.
    search.run(gently=start is None)
    return search


def _without_potential(fabric: StaticFabric, here: Configuration) -> list[str]:
    """Return the names of loads, tractions and body forces that have no energy."""
    own, blocks = fabric.own_force, here.own_force_blocks
    curls = own is not None and blocks is not None and not own.is_symmetric(blocks)
    # A run has received wrenches, too.
    turning = [] if fabric.loads.conservative else (
        without_potential(fabric.scene) or ['a received wrench'])
    return turning + ([f'body_force {own.name}'] if own is not None and curls else [])


def _start(fabric: StaticFabric, start: Snapshot | None) -> Configuration:
    """Return where a search begins; what is held stands where the scene says."""
    here = fabric.start
    if start is None:
        return here
    given = fabric.configuration('start', start)
    return Configuration(
        fabric, np.where(fabric.free[:, :3], given.position, here.position),
        np.where(fabric.free[:, 3:4], given.orientation, here.orientation))


def seek_on_path(
    scene: Scene, path: FrictionPath | None, *, start: Snapshot | None, time: float | None = None,
    tolerance: float = 1e-10, largest_step_count: int = _STEPS, load_factor: float = 1.0,
    body_force: BodyForce | None = None, progress: Callable[[Progress], None] | None = None
) -> tuple[Equilibrium, FrictionPath | None]:
    """
    The next state of a path with friction, and where it goes on from; see friction.py.

    The search of `solve_equilibrium`, with the pushes that friction goes by, until these are those
    of the state found.
    """
    fabric = StaticFabric(
        scene, held_time(scene, time), load_factor=load_factor,
        broken_since=None if start is None else start.broken_since,
        anchors_broken_since=None if start is None else start.anchors_broken_since,
        friction=None if path is None else replace(path), body_force=body_force)
    fabric.require_steady(time)
    friction, contacts = fabric.friction, fabric.contacts
    if friction is not None and contacts is not None and not friction.is_begun:
        # What touches where the search begins, first touches included, has not slipped there.
        here = fabric.start if start is None else fabric.configuration('start', start)
        friction = fabric.friction = path = friction.advanced(
            contacts, here.position, here.axes)
    search = _sought(fabric, start, tolerance, largest_step_count, progress)
    if friction is None or contacts is None:
        return search.result(), None
    change, relaxation = math.inf, Relaxation()
    for _ in range(_ROUNDS):
        if not search.is_at_rest:
            return search.result(), path
        here = search.here
        change = friction.allow(contacts, here.position, here.axes, relaxation)
        if change <= _SETTLED * here.force_scale:
            return search.result(), friction.advanced(contacts, here.position, here.axes)
        search = _sought(fabric, here.snapshot, tolerance, largest_step_count, progress)
    return replace(
        search.result(), converged=False, verdict=NOT_AT_REST,
        reason=f'pushes and friction did not agree after {_ROUNDS} rounds: limits of friction '
        f'still changed by {change:.3g} N; take smaller steps of the path'), path


def _check(
    scene: Scene, start: Snapshot | None, time: float | None, tolerance: float,
    largest_step_count: int, progress: Callable[[Progress], None] | None,
    body_force: BodyForce | Force | None
) -> BodyForce | None:
    """Refuse arguments that no search can begin with; return the body force."""
    require_scene(scene)
    check_snapshot('start', start, scene)
    check_time(time)
    checks.number(
        'tolerance', tolerance, above=0.0, below=1.0,
        wish='a number above 0 and below 1 (a part of the largest force)')
    checks.count('largest_step_count', largest_step_count)
    if progress is not None:
        checks.function('progress', progress)
    return as_body_force(body_force)


def step_loads(
    scene: Scene, factors: Iterable[float], *, start: Snapshot | None = None,
    time: float | None = None, tolerance: float = 1e-10, largest_step_count: int = _STEPS,
    body_force: BodyForce | Force | None = None,
    progress: Callable[[Progress], None] | None = None
) -> Iterator[tuple[float, Equilibrium]]:
    """
    Equilibria under parts of the loads, each sought from the one before.

    `factors`: of weight, electric fields, loads, tractions and the `body_force`; drives, anchors
    and pre-stress are whole from the first. Ends where no equilibrium is found: that one is the
    last. With friction (contact.friction) they are a path on which what touches sticks and slides:
    smaller steps follow it more exactly. They are equilibria of the energy: ValueError where
    `equilibrium.objective` says otherwise.
    """
    require_scene(scene)
    if scene.parameters['equilibrium.objective'] != 'energy':
        raise ValueError(
            'load steps follow equilibria of the energy, and equilibrium.objective is '
            f'{scene.parameters["equilibrium.objective"]!r}; set it to energy')
    force = _check(scene, start, time, tolerance, largest_step_count, progress, body_force)
    if not isinstance(factors, Iterable) or isinstance(factors, (str, bytes, Mapping)):
        raise TypeError(f'factors must be numbers, at least 0, got {checks.shown(factors)}')
    # One after the other may depend on what was found, so an iterator is not read in advance.
    if not isinstance(factors, Iterator):
        factors = [checks.number('factors', factor, least=0.0) for factor in factors]
        if not factors:
            raise ValueError('factors must hold at least one number, got none')

    def steps(start: Snapshot | None) -> Iterator[tuple[float, Equilibrium]]:
        path = FrictionPath.of(scene)
        for given in factors:
            factor = checks.number('factors', given, least=0.0)
            found, path = seek_on_path(
                scene, path, start=start, time=time, tolerance=tolerance, load_factor=factor,
                largest_step_count=largest_step_count, body_force=force, progress=progress)
            yield factor, found
            if not found.converged:
                return
            start = found.snapshot

    return steps(start)


def refuse_free_fall(fabric: StaticFabric) -> None:
    """Refuse weight and loads that nothing bears: no support, no drive, no anchor."""
    scene, start = fabric.scene, fabric.start
    if not fabric.free.all() or scene.anchors or (
            fabric.contacts is not None and scene.parameters.names('planes')):
        return
    pushes = start.acting.wrench[:, :3]
    if start.own_wrench is not None and start.own_force_blocks is not None:
        if start.own_force_blocks.any():
            # A force that changes from place to place may hold the fabric.
            return
        pushes = pushes + start.own_wrench[:, :3]
    acting = pushes.sum(axis=0)
    if fabric.model.gravity is not None:
        acting = acting + scene.masses.total(scene.body_count) * (
            fabric.model.gravity.acceleration)
    size = float(np.linalg.norm(acting))
    scale = float(np.abs(pushes).sum())
    if size > 1e-12 * scale and size > 0.0:
        raise ValueError(
            f'nothing holds this fabric: a force of {size:.4g} N in all acts on it, by gravity, '
            'field.electric, loads or a body force; hold some bodies with supports.NAME, '
            'drives.NAME or anchors.NAME, or put planes.NAME below them')


class _Search:
    """Steps that lower the energy, until nothing pushes any more."""

    def __init__(
        self, fabric: StaticFabric, here: Configuration, tolerance: float, largest: int,
        progress: Callable[[Progress], None] | None
    ) -> None:
        self.fabric, self.here = fabric, here
        self.tolerance, self.largest, self.progress = tolerance, largest, progress
        self.steps = self.products = 0
        self.free = fabric.free
        # Lengths of steps are measured in coordinates scaled by the roots of masses and inertias.
        self.weight = fabric.layout.spread(np.where(self.free, fabric.root**-2.0, 0.0))
        self.radius = 0.1 * fabric.half_edge * float(fabric.root.flat[0]) * math.sqrt(
            max(1, int(self.free.any(axis=1).sum())))
        start = fabric.start.position
        self.extent = float(np.ptp(start, axis=0).max(initial=0.0)) + fabric.half_edge  # [m]
        self.first_gradient = 0.0
        self.first_force = self._acting()  # [N]
        self.slack_steps = 0  # with next to nothing of it left
        # Whether it is looked out for shells that meet or part within steps, and for how many of
        # the next.
        self.looks_out, self.meeting_steps = False, 0

    def run(self, *, gently: bool) -> None:
        """
        Search until it is found, or nothing gets better.

        `gently`: contacts are soft at first, and stiffer each time that an equilibrium is near.
        Stiff ones change within steps as short as their overlaps, and stop bodies that have far
        to go. Where they do so for long they are made soft once more.
        """
        contacts = self.fabric.contacts
        if contacts is None:
            self._descend(self.tolerance)
            return
        begin, radius = self.here, self.radius
        self._press_in_rounds(contacts, self.steps + _FIRST_STEPS, gently=gently)
        if not self._has_ended:
            # Anew, with steps that look out for shells that meet or part within them.
            self.here, self.radius, self.looks_out = begin, radius, True
            self._press_in_rounds(contacts, self.largest, gently=gently)

    def _press_in_rounds(
        self, contacts: StaticContacts, last: int, *, gently: bool
    ) -> None:
        """Search with contacts that get stiffer, round by round, up to step number `last`."""
        stages = contacts.stages(self.first_force) if gently else [contacts.whole]
        for patience in _PATIENCE:
            for stiffness in stages[:-1]:
                self._press(stiffness, max(self.tolerance, _NEAR), last - self.steps)
            self._press(contacts.whole, self.tolerance, min(patience, last - self.steps))
            if self._has_ended or self.steps >= last:
                return
            # Where much touches for a moment only, stiff contacts begin and end at every step.
            stages = contacts.softer()

    @property
    def _has_ended(self) -> bool:
        """Whether there is nothing more to search for."""
        return self.steps >= self.largest or self._good(self.tolerance) or (
            self._is_slack() or self._escapes())

    def _press(self, stiffness: float, tolerance: float, most: float) -> None:
        """Search with contacts of a stiffness [N/m], for so many steps at most."""
        assert self.fabric.contacts is not None
        self.fabric.contacts.stiffness = stiffness
        self.here = Configuration(
            self.fabric, self.here.position.copy(), self.here.orientation.copy())
        self._descend(tolerance, self.steps + most)

    def _acting(self) -> float:
        """The largest force [N] on a body before anything has moved: weight, loads, connectors."""
        return max(self.here.force_scale, float(np.abs(self.leftover()[:, :3]).max(initial=0.0)))

    def _descend(self, tolerance: float, last: float = math.inf) -> None:
        stuck = 0
        while self.steps < min(self.largest, last) and stuck < 30 and not (
                self._good(tolerance) or self._is_slack() or self._escapes()):
            before = self.residual()
            if self.progress is not None:
                self.progress(Progress(self.steps, before, self.here.energy))
            self.steps += 1
            self.slack_steps += self._has_died_out()
            if self._step():
                stuck = 0
            else:
                stuck += 1

    def residual(self) -> float:
        """The largest force left, or torque over a, in parts of the largest force that acts."""
        left = np.abs(self.leftover())
        left[:, 3:] /= self.fabric.half_edge
        most, scale = float(left.max(initial=0.0)), self._scale()
        least = 10.0 * self.fabric.rounding
        if scale > least:
            return float(most / scale)
        # Where nothing acts, rounding of the lengths is all there is.
        return 1.0 if most > least else 0.0

    def _scale(self) -> float:
        """
        The largest force that acts [N]; the first one where next to nothing of it is left.

        In parts of what is left, forces that die out would never come near to rest.
        """
        return self.first_force if self._has_died_out() else self.here.force_scale

    def _has_died_out(self) -> bool:
        """Whether next to nothing acts any more; weight and loads, however small, always do."""
        here = self.here
        return (here.force_scale < _DIED_OUT * self.first_force
                and self.fabric.model.gravity is None and not here.acting.wrench.any()
                and (here.own_wrench is None or not here.own_wrench.any()))

    def _is_slack(self) -> bool:
        """Whether forces die out, and only ever more slowly."""
        return self.slack_steps > _SLACK_STEPS

    @property
    def is_at_rest(self) -> bool:
        """Whether no more is left than is tolerated."""
        return self._good(self.tolerance)

    def _escapes(self) -> bool:
        """Whether a body has gone so far that nothing will hold it back."""
        return self._farthest()[1] > _AWAY * self.extent

    def _farthest(self) -> tuple[int, float, np.ndarray]:
        """The body that has gone the farthest, how far [m], and in which direction (3,)."""
        moved = self.here.position - self.fabric.start.position
        away = np.linalg.norm(moved, axis=1)
        body = int(np.argmax(away))
        return body, float(away[body]), moved[body] / max(float(away[body]), 1e-300)

    def _good(self, tolerance: float) -> bool:
        """Whether no more is left than is tolerated, or than rounding of the lengths may be."""
        rounding, scale = self.fabric.rounding, self._scale()
        return self.residual() <= max(
            tolerance, rounding / scale if scale > 10.0 * rounding else 0.0)

    def leftover(self) -> np.ndarray:
        """Forces and torques on free freedoms (n, 6)."""
        return np.where(self.free, self.here.force, 0.0)

    def _step(self) -> bool:
        """Try one step; whether it was taken."""
        here, layout = self.here, self.fabric.layout
        gradient = layout.spread(-self.leftover())
        size = math.sqrt(weighted_square(self.weight, gradient))
        self.first_gradient = max(self.first_gradient, size)
        accuracy = min(0.1, math.sqrt(size / self.first_gradient), 0.1 * self.residual()**0.25)
        most = min(_MOST_PRODUCTS, int(_PRODUCTS * self.free.sum()) + 20)
        found, bend, crossings = self._descent(gradient, accuracy, most)
        motion = layout.gather(found.step)
        # Only turns are cut: all of a fabric may move far, and the energy limits it.
        turn = float(np.abs(motion[:, 3:]).max(initial=0.0))
        part = _LARGEST_TURN / turn if turn > _LARGEST_TURN else 1.0
        slope = product_of(gradient, found.step)
        # Shorter steps in the same direction cost no products (Nocedal and Yuan 1998, Combining
        # trust region and line search techniques).
        for _ in range(_TRIES):
            expected = part * slope + part**2 * bend
            if crossings is not None:
                expected += crossings.energy(part)
            there = here.moved(part * motion)
            gain = self._gain(part * motion, expected, there)
            if gain > _LEAST_GAIN:
                break
            part *= 0.5
        length = part * found.length
        if gain < _POOR and self.looks_out and not self._touches_alike(there):
            self.meeting_steps = _MEETING_STEPS
        if gain < 0.25:
            self.radius = 0.5 * length
        elif gain > 0.75 and (found.on_border or part < 1.0):
            self.radius = max(self.radius, 2.0 * length)
        if gain > _LEAST_GAIN:
            self.here = there
            return True
        return False

    def _touches_alike(self, there: Configuration) -> bool:
        """Whether the same shells touch as here, about: as many."""
        here = self.here.touching, there.touching
        return all(part is None for part in here) or len({
            len(part.pairs) + sum(map(len, part.planes)) for part in here if part is not None
        }) == 1

    def _descent(
        self, gradient: np.ndarray, accuracy: float, most: int
    ) -> tuple[Step, float, Crossings | None]:
        """
        A step, what the tangent expects of it in second order [J], and the kinks that it crosses.
        """
        here, layout = self.here, self.fabric.layout
        found = steihaug(here.multiply, self.weight, gradient, self.radius, accuracy, most)
        self.products += found.iterations
        bend = found.expected - product_of(gradient, found.step)
        self.meeting_steps = max(self.meeting_steps - 1, 0)
        meets = self.meeting_steps > 0 and not self._has_died_out()
        if not (meets or self.fabric.laws.kinked.any()):
            return found, bend, None
        reach = 0.0
        if meets:
            # As far as both bodies of a pair may go.
            farthest = float(np.abs(layout.gather(found.step)[:, :3]).max(initial=0.0))
            reach = min(_REACH * farthest, _LARGEST_REACH * self.fabric.half_edge)
        crossings = Crossings(here, reach)
        step, product, image = (np.zeros_like(found.step) for _ in range(3))
        slopes, length, on_border = gradient, 0.0, False
        for _ in range(_PIECES):
            changes = crossings.changes(layout.gather(found.step))
            here.multiply(found.step, image)
            part = crossings.best_part(
                changes, product_of(gradient, found.step) + product_of(product, found.step),
                product_of(image, found.step))
            step, product = step + part * found.step, product + part * image
            crossed = crossings.advance(part * changes)
            length += part * found.length
            on_border = found.on_border and part == 1.0
            if not crossed or on_border or not part > 0.0:
                break
            kinks = np.where(self.free, crossings.gradient(), 0.0)
            slopes = gradient + product + layout.spread(kinks)
            if weighted_square(self.weight, slopes) <= accuracy**2 * weighted_square(
                    self.weight, gradient):
                break
            found = steihaug(
                crossings.model().multiply, self.weight, slopes, self.radius - length, accuracy,
                most)
            self.products += found.iterations + 1
        bend = 0.5 * product_of(step, product)
        expected = product_of(gradient, step) + bend + crossings.energy(1.0)
        return Step(step, length, expected, 0, on_border), bend, crossings

    def _gain(self, motion: np.ndarray, expected: float, there: Configuration) -> float:
        """How much of what the model expected a step has brought."""
        here = self.here
        if not expected < 0.0:
            return -1.0
        # Loads without a potential push as at the start of the step.
        pushed = here.acting.wrench - self._dead(here)
        change = there.energy - here.energy - float((pushed * motion).sum())
        own = self.fabric.own_force
        if own is not None and not own.has_potential:
            change -= own.work(here.position, here.orientation, motion)
        if abs(expected) < _ROUNDING * max(abs(here.energy), abs(there.energy)):
            # From the forces at both ends, which know it better than a difference of energies.
            ahead = there.force - (there.acting.wrench - self._dead(there)) + pushed
            change = -0.5 * float(((here.force + ahead) * motion).sum())
        return change / expected if math.isfinite(change) else -1.0

    def _dead(self, at: Configuration) -> np.ndarray:
        """The part of the wrenches that has a potential, (n, 6)."""
        return self.fabric.loads.dead_wrench(at.axes)

    def result(self) -> Equilibrium:
        """Judge where the search stands."""
        residual, converged = self.residual(), self.is_at_rest
        here = self.exact()
        contacts = here.contact_forces
        beyond = ''
        if converged and here.fabric.packed.tables.tables:
            beyond, stops = here.fabric.packed.tables.describe_beyond(
                np.where(here.snapshot.intact, here.snapshot.connector_length, np.nan),
                here.fabric.scene.connectors.bodies)
            if stops:
                converged = False
            elif beyond:
                _LOGGER.warning(
                    '%s at rest: the law goes on straight there (connector.law_beyond)', beyond)
        verdict, curvature = NOT_AT_REST, Curvature(-1, -1)
        branches: Mapping[str, Curvature] = {}
        if converged:
            verdict, curvature, branches = judge(here)
        reason = '' if converged else self._reason() if not beyond else (
            f'{beyond} at rest, and connector.law_beyond is stop; extrapolate lets it go on '
            'straight')
        return Equilibrium(
            snapshot=here.snapshot, converged=converged, residual=residual, verdict=verdict,
            mechanism_count=curvature.zero, unstable_count=curvature.negative,
            force_scale=here.force_scale, leftover=self.leftover(), tension=here.tension,
            touching=here.touching,
            reaction=np.where(self.free, 0.0, -here.force), step_count=self.steps,
            product_count=self.products, at_kink=here.at_kink,
            anchors_at_kink=here.anchors_at_kink, branches=branches,
            first_touches=here.first_touches, reason=reason, reactions=reactions_of(
                here, here.force, contacts), rubbing=here.rubbing, contacts=contacts)

    def exact(self) -> Configuration:
        """Return where the search stands, with exact second derivatives of contacts."""
        contacts = self.fabric.contacts
        if contacts is None:
            return self.here
        contacts.smoothed = False
        return self.here.anew()

    def _reason(self) -> str:
        """Why the search has ended before it was at rest, and what to try."""
        if self._escapes():
            body, far, (x, y, z) = self._farthest()
            return (
                f'body {body} has gone {far:.3g} m along ({x:.4g}, {y:.4g}, {z:.4g}), and nothing '
                'holds it back: in this direction the loads do work without end; hold it by '
                'supports.NAME, anchors.NAME, planes.NAME or contact.friction, or take smaller '
                'loads')
        turning = _without_potential(self.fabric, self.here)
        if turning:
            return (
                f'{", ".join(turning)}: turns with its bodies or twists them, so it has no energy '
                'that a search could lower, and there may be no equilibrium at all; seek it from '
                'smaller loads on (--load-steps, ico.step_loads), or see in a run with drag what '
                'the fabric does')
        if pushing := self._pushing_around():
            names = ', '.join(map(str, pushing[:4])) + (' and more' if len(pushing) > 4 else '')
            return (
                f'connectors {names} push while they lie around shells (connector.obstruction '
                'wrap): they rest where another geodesic becomes the shorter one, and their force '
                'jumps there, so that no step comes nearer; bands only pull: set '
                'connector.stiffness_compression to 0.0, give a connector.natural_length that '
                'keeps them taut, or see in a run with drag what the fabric does')
        if self._has_died_out():
            return (
                f'it goes slack: of the forces at first {self.residual():.1g} is left, and less '
                'with every step, so it bears nothing and has no stiffness there; give it a '
                'connector.natural_length that keeps it tight, or loads')
        if self.steps >= self.largest:
            return (
                f'the search took all of its {self.largest:,} steps; give it more (--steps, '
                'largest_step_count), or seek it from smaller loads on (--load-steps, '
                'ico.step_loads)')
        return (
            'no step lowers the energy any more: rounding hides what is left, or forces jump '
            'there; seek it from smaller loads on (--load-steps, ico.step_loads), or take a '
            'larger tolerance')

    def _pushing_around(self) -> list[int]:
        """Connectors around shells that push, on the bodies on which the most is left."""
        here, of = self.here, self.here.wrapped.of
        left = np.abs(self.leftover()[:, :3]).max(axis=1)
        bodies = self.fabric.scene.connectors.bodies[of]
        chosen = (here.tension[of] < 0.0) & (left[bodies].max(axis=1) > 0.1 * left.max())
        found: list[int] = of[chosen].tolist()
        return found


def judge(here: Configuration) -> tuple[str, Curvature, Mapping[str, Curvature]]:
    """
    Verdict of a configuration at rest, counts that no kink changes, and those of both branches.
    """
    jumps = here.kink_jumps
    if not len(jumps):
        curvature = judge_curvature(here)
        return _verdict(curvature, curvature), curvature, {}
    branches = {side: judge_curvature(here.on(side)) for side in BRANCHES}
    if (jumps > 0.0).all():
        soft, stiff = branches[PUSH], branches[PULL]
    elif (jumps < 0.0).all():
        soft, stiff = branches[PULL], branches[PUSH]
    else:
        soft, stiff = (judge_curvature(here.on(side)) for side in (SOFT, STIFF))
    return _verdict(soft, stiff), stiff, branches


def _verdict(soft: Curvature, stiff: Curvature) -> str:
    """By the least and the most that a motion may cost."""
    if stiff.negative > 0:
        return UNSTABLE
    if soft.negative > 0:
        return AT_KINK
    if soft.zero < 0 or stiff.zero < 0:
        return NOT_COUNTED
    if not soft.zero:
        return STABLE
    return MECHANISM if stiff.zero else AT_KINK
