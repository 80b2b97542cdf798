# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Equilibria (eq 48): configurations without unbalanced forces and moments on the bodies.

A trust-region method on positions and rotations minimises the potential energy, so every accepted
step lowers it. The Hessian may be singular; it is analytic except for contacts and body forces,
where differences replace it. Loads that follow their bodies, and torques, have no potential; they
are constant within a step and updated after it.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
import logging
import math
from typing import Any, NamedTuple

from icofabric_sim import checks
from icofabric_sim.checks import counted, renamed_attributes
from icofabric_sim.kernels.conjugate import product_of, weighted_square
from icofabric_sim.parameters.table import OBJECTIVES
from icofabric_sim.scene.scene import require_scene, Scene
from icofabric_sim.simulation.model.as_table import AsTable
from icofabric_sim.simulation.model.body_force import as_body_force, BodyForce, Force
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.reports.load_cells import ContactForces, Reactions
from icofabric_sim.statics.admissible import find_admissible
from icofabric_sim.statics.contacts import ContactState, StaticContacts
from icofabric_sim.statics.crossings import Crossings
from icofabric_sim.statics.fabric import check_snapshot, Configuration, StaticFabric
from icofabric_sim.statics.friction import ContactFriction, FrictionPath, Relaxation
from icofabric_sim.statics.held import check_time, held_time, without_potential
from icofabric_sim.statics.reactions import reactions_of
from icofabric_sim.statics.resultants import find_least_resultants, LEAST_RESULTANTS
from icofabric_sim.statics.sides import BRANCHES, PULL, PUSH, SOFT, STIFF
from icofabric_sim.statics.spectrum import Curvature, judge_curvature
from icofabric_sim.statics.trust_region import steihaug, Step
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')

STABLE = 'equilibrium, stable'
MECHANISM = 'equilibrium, with mechanisms'
UNSTABLE = 'equilibrium, unstable'
# For fabrics that are too large to count mechanisms: no motion was found that lowers the energy.
NOT_COUNTED = 'equilibrium, mechanisms not counted'
# Connectors are at their natural length, and stability depends on which of them are in extension
# and which in compression.
AT_KINK = 'equilibrium, stability depends on the kink'
NOT_AT_REST = 'not in equilibrium'

_AT_REST = ('body', 'x_m', 'y_m', 'z_m', 'qx', 'qy', 'qz', 'qw')
_MAX_STEPS = 2_000
RESULTANTS = 'resultants'


@dataclass(frozen=True)
class SearchSettings:
    """Tunables of the trust-region search for equilibria."""

    # Hessian products in a step: per degree of freedom, and at most.
    products_per_freedom: float = 2.0
    max_products: int = 5_000
    # [rad] Largest rotation of a body in one step; displacements are not limited.
    max_turn_rad: float = 0.7
    # Smallest accepted ratio of the actual to the predicted decrease.
    min_gain_ratio: float = 1e-4
    trial_count: int = 4  # trial lengths of a step, each half of the previous one
    max_pieces: int = 20  # most pieces of a step that crosses kinks
    # After a step whose gain ratio is below `poor_gain_ratio`, because contacts opened or closed
    # in it, the next `gap_steps` steps include pairs within a gap: `reach_factor` times the
    # largest displacement, because both bodies of a pair move, and at most `max_reach_ratio` of
    # a. Not if forces have died out, since overlaps are then negligible.
    poor_gain_ratio: float = 0.5
    gap_steps: int = 30
    reach_factor: float = 3.0
    max_reach_ratio: float = 0.05
    # Steps before that, because including gaps is expensive with many candidate pairs.
    first_steps: int = 800
    stiffen_residual: float = 1e-3  # residual at which contacts are stiffened
    # Steps with stiff contacts after which contacts are softened again.
    soften_after_steps: tuple[float, ...] = (200, 400, 800, math.inf)
    rounding_ratio: float = 1e-9  # relative energy difference below which round-off dominates
    # Forces below this ratio to the initial ones have died out: the residual is then relative to
    # the initial forces, and the search ends after `slack_steps` further steps.
    died_out_ratio: float = 1e-7
    slack_steps: int = 200
    # Displacement, as a ratio to the size of the fabric, beyond which a body has escaped.
    escape_ratio: float = 1e4


@dataclass(frozen=True)
class FrictionSettings:
    """Tunables of the rounds in which normal forces, friction and contact points agree."""

    max_rounds: int = 60  # most rounds until normal forces and friction agree
    settled_ratio: float = 1e-8  # change of friction limits at agreement, over the largest force
    max_rolls: int = 12  # most rounds in which sticking contacts update their points
    # Gap over a of contacts in the first round: they would otherwise slide before they close.
    first_gap_ratio: float = 0.02


_SEARCH = SearchSettings()
_FRICTION = FrictionSettings()


class Progress(NamedTuple):
    """Progress of a search."""

    steps: int
    residual: float  # largest unbalanced force over the largest acting force
    energy: float  # [J]


@renamed_attributes(
    leftover='unbalanced_wrench', touching='contact_state', rubbing='friction')
@dataclass(frozen=True, repr=False)
class Equilibrium(AsTable):
    """Result of an equilibrium solve: state, verdict, unbalanced forces, tensions, reactions."""

    snapshot: Snapshot
    converged: bool
    # Largest unbalanced force, or torque over a, on a free body, over the largest acting force.
    residual: float
    verdict: str
    # Zero-energy motions, including rigid motions of the whole; -1: not counted, because the
    # fabric is not in equilibrium or has more than 400,000 degrees of freedom.
    mechanism_count: int
    # Motions that lower the energy; -1: not counted; above 400,000 degrees of freedom 1 means at
    # least one.
    unstable_count: int
    force_scale: float  # [N] largest acting force
    unbalanced_wrench: np.ndarray  # (n, 6) unbalanced forces [N] and torques [N m] on free bodies
    tension: np.ndarray  # (c,) [N], positive in extension
    contact_state: ContactState | None  # contacts without friction; None: the scene has no contact
    reaction: np.ndarray  # (n, 6) [N], [N m] wrench of supports and drives on each body
    step_count: int
    product_count: int  # Hessian-vector products
    # Connectors, by number, and anchors, by name, at their natural length with k_e other than k_c.
    # The counts above are then those of the stiffest choice of k_e or k_c in each; see `branches`.
    at_kink: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    anchors_at_kink: tuple[str, ...] = ()
    # Counts of zero-energy and unstable motions with k_e in all of these ('pull') and with k_c
    # ('push'); empty if nothing is at its kink.
    branches: Mapping[str, Curvature] = field(default_factory=dict)
    # Pairs of shells, or shells and planes, at first touch: they count as open, but resist
    # compression.
    first_touches: int = 0
    # Why no equilibrium was found, and what to try; '': an equilibrium was found.
    reason: str = ''
    # Reactions of supports, drives, anchors and planes, by name.
    reactions: Reactions | None = None
    # Friction springs on a path of states; None without friction.
    friction: ContactFriction | None = None
    # Force, torques and point of each contact, including friction; None without contact.
    contacts: ContactForces | None = None
    # Smallest contact.friction with which contact forces balance the loads; infinite: none does;
    # NaN: the result has no friction, or is a state of a load path.
    friction_needed: float = math.nan

    def __repr__(self) -> str:
        """Return a summary without arrays."""
        return (f'<Equilibrium: {self.verdict}, residual {self.residual:.2g}, '
                f'{counted(len(self.snapshot.position), "body")}>')

    def table(self) -> dict[str, list[Any]]:
        """Return poses of the bodies and reactions on them, a list for each column."""
        columns = self.snapshot.table()
        at_rest = {name: columns[name] for name in _AT_REST}
        names = [f'reaction_{axis}_n' for axis in 'xyz'] + [
            f'reaction_torque_{axis}_nm' for axis in 'xyz']
        return {**at_rest, **dict(zip(names, self.reaction.T.tolist()))}

    @property
    def worst_bodies(self) -> tuple[int, ...]:
        """Bodies with the largest unbalanced forces, at most four."""
        size = np.abs(self.unbalanced_wrench[:, :3]).max(axis=1)
        return tuple(int(b) for b in np.argsort(-size, kind='stable')[:4] if size[b] > 0.0)


def solve_equilibrium(
    scene: Scene, *, start: Snapshot | None = None, time: float | None = None,
    tolerance: float = 1e-10, largest_step_count: int = _MAX_STEPS, load_factor: float = 1.0,
    body_force: BodyForce | Force | None = None, objective: str | None = None,
    progress: Callable[[Progress], None] | None = None
) -> Equilibrium:
    """
    Find a static equilibrium of a fabric under its loads, supports and drives.

    Parameters
    ----------
    scene
        Fabric, loads and supports. With `contact.friction` the result is one of many possible
        equilibria, see Notes.
    start
        Initial guess; connectors broken there are left out. None: the initial state of the scene.
    time
        Time [s] at which loads, drives and anchors are held; required if they change with time.
    tolerance
        Largest unbalanced force, as a ratio to the largest connector force or load.
    largest_step_count
        Steps after which the search gives up.
    load_factor
        Factor of weight, electric fields, loads, tractions and the body force.
    body_force
        Function or `BodyForce`, as in `compile_scene` (see also `ico.surface_force`), evaluated at
        `time` and zero velocity. Derivatives are computed by finite differences.
    objective
        'energy': the potential energy, with contacts as springs. 'resultants': the sum of squares
        of the force and moment resultants (torques over a) on free bodies, without contact forces
        and without overlap, as the document states after eq 48. `unbalanced_wrench` then has
        the resultants that contacts must bear; if they are not 0 the verdict is 'least
        resultants'. None: the `equilibrium.objective` of the scene.
    progress
        Called with a `Progress` at each step.

    Returns
    -------
    Equilibrium
        State, verdict, unbalanced forces, tensions, reactions and contacts.

    Raises
    ------
    ValueError
        If no equilibrium can exist, the body force acts between bodies, or forces without a
        potential act and the objective is 'resultants'.

    Notes
    -----
    With friction the equilibrium depends on the load path; `step_loads` follows a path. This
    function finds one possible equilibrium in two steps.

    1. It finds a configuration in which all contacts stick. If sticking needs a friction
       coefficient above `contact.friction`, it searches without friction.
    2. It computes contact forces within the friction cones that balance all loads and maximise
       the smallest margin (`contacts.margin`, see admissible.py).

    If no such forces exist, the verdict is 'not in equilibrium', the reason states that the fabric
    slides, and `unbalanced_wrench` has the unbalanced forces.

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
    return find_equilibrium(fabric, start, tolerance, largest_step_count, progress)


def seek_least_resultants(
    fabric: StaticFabric, start: Snapshot | None, tolerance: float, largest_step_count: int,
    progress: Callable[[Progress], None] | None
) -> Equilibrium:
    """Minimise the resultants of a `fabric` with contacts as constraints; see resultants.py."""
    turning = _without_potential(fabric, fabric.start)
    if turning:
        raise ValueError(
            f"objective 'resultants' needs forces with a potential: {', '.join(turning)} follows "
            "its bodies or applies a torque; leave it out, or use the objective 'energy' "
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
        contact_state=found.there.contact_state, step_count=found.step_count)
    if result.converged:
        return result
    return replace(
        result, converged=found.converged, reason=found.reason,
        verdict=LEAST_RESULTANTS if found.converged else NOT_AT_REST)


def find_equilibrium(
    fabric: StaticFabric, start: Snapshot | None, tolerance: float, largest_step_count: int,
    progress: Callable[[Progress], None] | None
) -> Equilibrium:
    """Find an equilibrium of a `fabric`; see `solve_equilibrium`."""
    friction, contacts = fabric.friction, fabric.contacts
    if friction is None or contacts is None:
        return _run_search(fabric, start, tolerance, largest_step_count, progress).result()
    here = fabric.start if start is None else fabric.configuration('start', start)
    first = start
    for turn in range(_FRICTION.max_rolls):
        # Contacts stick at their present points, because bodies roll and tip during the search.
        # The first round includes small gaps, which would otherwise slide before they close.
        fabric.friction = friction = friction.advanced(
            contacts, here.position, here.axes, *([] if turn else [_FRICTION.first_gap_ratio]))
        search = _run_search(fabric, start, tolerance, largest_step_count, progress)
        found = _check_friction(search, friction.coefficient)
        here = search.here
        start = here.snapshot
        if found.converged or not search.steps or not search.is_at_rest:
            break
        if not turn:
            # An equilibrium without friction needs none.
            fabric.friction = None
            smooth = _run_search(fabric, first, tolerance, largest_step_count, progress)
            if smooth.is_at_rest:
                return _check_friction(smooth, friction.coefficient)
    return found


def _check_friction(search: '_Search', coefficient: float) -> Equilibrium:
    """Check if contact forces within the friction cones hold a configuration found by sticking."""
    result = search.result()
    if not result.converged:
        return result
    here = search.exact()
    held = find_admissible(here, coefficient)
    assert here.contact_state is not None
    force = here.force - here.contact_state.wrench + held.contacts.resultants(len(here.position))
    if here.friction is not None:
        force -= here.friction.wrench
    result = replace(
        result, contacts=held.contacts, reactions=reactions_of(here, force, held.contacts),
        reaction=np.where(here.fabric.free, 0.0, -force), friction=None,
        friction_needed=held.friction_needed)
    if held.is_balanced:
        return result
    left = float(np.linalg.norm(held.unbalanced_wrench[:, :3], axis=1).max())
    needed = held.friction_needed
    way_out = (
        f'it would hold with contact.friction of at least {needed:.6g}' if needed < math.inf else
        'more friction would not help: add supports.NAME, anchors.NAME or planes.NAME')
    return replace(
        result, converged=False, verdict=NOT_AT_REST, mechanism_count=-1, unstable_count=-1,
        unbalanced_wrench=held.unbalanced_wrench, branches={}, residual=float(
            np.abs(held.unbalanced_wrench[:, :3]).max(initial=0.0) / here.force_scale), reason=(
                f'the fabric slides: no contact forces within the friction cones '
                f'(contact.friction {coefficient:g}) balance the loads, and a force of up to '
                f'{left:.4g} N on a body is unbalanced; {way_out}'))


def _run_search(
    fabric: StaticFabric, start: Snapshot | None, tolerance: float, largest_step_count: int,
    progress: Callable[[Progress], None] | None
) -> '_Search':
    """Run a search and return it without a verdict."""
    here = _start(fabric, start)
    refuse_free_fall(fabric)
    # Exact derivatives mislead the search where an overlap region gains or loses a corner nearby.
    if fabric.contacts is not None:
        fabric.contacts.smoothed = True
    search = _Search(fabric, here, tolerance, largest_step_count, progress)
    # A given start is near the equilibrium.
    search.run(gently=start is None)
    return search


def _without_potential(fabric: StaticFabric, here: Configuration) -> list[str]:
    """Return the names of loads, tractions and body forces without a potential."""
    own, blocks = fabric.own_force, here.own_force_blocks
    curls = own is not None and blocks is not None and not own.is_symmetric(blocks)
    # A run has received wrenches, too.
    turning = [] if fabric.loads.conservative else (
        without_potential(fabric.scene) or ['a received wrench'])
    return turning + ([own.label] if own is not None and curls else [])


def _start(fabric: StaticFabric, start: Snapshot | None) -> Configuration:
    """Return the start of a search; held degrees of freedom are those of the scene."""
    here = fabric.start
    if start is None:
        return here
    given = fabric.configuration('start', start)
    return Configuration(
        fabric, np.where(fabric.free[:, :3], given.position, here.position),
        np.where(fabric.free[:, 3:4], given.orientation, here.orientation))


def find_next_equilibrium(
    scene: Scene, path: FrictionPath | None, *, start: Snapshot | None, time: float | None = None,
    tolerance: float = 1e-10, largest_step_count: int = _MAX_STEPS, load_factor: float = 1.0,
    body_force: BodyForce | None = None, progress: Callable[[Progress], None] | None = None
) -> tuple[Equilibrium, FrictionPath | None]:
    """
    Find the next equilibrium of a path with friction; also return the continued path.

    Repeats the search of `solve_equilibrium` until the normal forces that limit friction are those
    of the state found; see friction.py.
    """
    fabric = StaticFabric(
        scene, held_time(scene, time), load_factor=load_factor,
        broken_since=None if start is None else start.broken_since,
        anchors_broken_since=None if start is None else start.anchors_broken_since,
        friction=None if path is None else replace(path), body_force=body_force)
    fabric.require_steady(time)
    friction, contacts = fabric.friction, fabric.contacts
    if friction is not None and contacts is not None and not friction.is_begun:
        # Contacts at the start, including first touches, have not slipped.
        here = fabric.start if start is None else fabric.configuration('start', start)
        friction = fabric.friction = path = friction.advanced(
            contacts, here.position, here.axes)
    search = _run_search(fabric, start, tolerance, largest_step_count, progress)
    if friction is None or contacts is None:
        return search.result(), None
    change, relaxation = math.inf, Relaxation()
    for _ in range(_FRICTION.max_rounds):
        if not search.is_at_rest:
            return search.result(), path
        here = search.here
        change = friction.update_limits(contacts, here.position, here.axes, relaxation)
        if change <= _FRICTION.settled_ratio * here.force_scale:
            return search.result(), friction.advanced(contacts, here.position, here.axes)
        search = _run_search(fabric, here.snapshot, tolerance, largest_step_count, progress)
    return replace(
        search.result(), converged=False, verdict=NOT_AT_REST,
        reason=f'normal forces and friction did not converge after {_FRICTION.max_rounds} '
        f'rounds: limits of friction still changed by {change:.3g} N; use smaller steps of the '
        'path'), path


def _check(
    scene: Scene, start: Snapshot | None, time: float | None, tolerance: float,
    largest_step_count: int, progress: Callable[[Progress], None] | None,
    body_force: BodyForce | Force | None
) -> BodyForce | None:
    """Check the arguments of a search; return the body force."""
    require_scene(scene)
    check_snapshot('start', start, scene)
    check_time(time)
    checks.number(
        'tolerance', tolerance, above=0.0, below=1.0,
        wish='a number above 0 and below 1 (a ratio to the largest force)')
    checks.count('largest_step_count', largest_step_count)
    if progress is not None:
        checks.function('progress', progress)
    return as_body_force(body_force)


def step_loads(
    scene: Scene, factors: Iterable[float], *, start: Snapshot | None = None,
    time: float | None = None, tolerance: float = 1e-10, largest_step_count: int = _MAX_STEPS,
    body_force: BodyForce | Force | None = None,
    progress: Callable[[Progress], None] | None = None
) -> Iterator[tuple[float, Equilibrium]]:
    """
    Find equilibria under scaled loads, each starting from the previous one.

    Parameters
    ----------
    scene
        Fabric, loads and supports; `equilibrium.objective` must be energy.
    factors
        Factors of weight, electric fields, loads, tractions and the `body_force`; drives, anchors
        and pre-stress are not scaled.
    start, time, tolerance, largest_step_count, body_force, progress
        As in `solve_equilibrium`.

    Returns
    -------
    iterator of (float, Equilibrium)
        Factors and equilibria. Ends after the first search that does not converge.

    Raises
    ------
    ValueError
        If a factor is invalid, `equilibrium.objective` is not energy, or as in
        `solve_equilibrium`.

    Notes
    -----
    With `contact.friction` the equilibria are a load path on which contacts stick and slide;
    smaller steps follow the path more accurately.
    """
    require_scene(scene)
    if scene.parameters['equilibrium.objective'] != 'energy':
        raise ValueError(
            'load steps follow equilibria of the energy, and equilibrium.objective is '
            f'{scene.parameters["equilibrium.objective"]!r}; set it to energy')
    force = _check(scene, start, time, tolerance, largest_step_count, progress, body_force)
    if not isinstance(factors, Iterable) or isinstance(factors, (str, bytes, Mapping)):
        raise TypeError(f'factors must be numbers, at least 0, got {checks.shown(factors)}')
    # An iterator is not read in advance, because factors may depend on earlier results.
    if not isinstance(factors, Iterator):
        factors = [checks.number('factors', factor, least=0.0) for factor in factors]
        if not factors:
            raise ValueError('factors must hold at least one number, got none')

    def steps(start: Snapshot | None) -> Iterator[tuple[float, Equilibrium]]:
        path = FrictionPath.of(scene)
        for given in factors:
            factor = checks.number('factors', given, least=0.0)
            found, path = find_next_equilibrium(
                scene, path, start=start, time=time, tolerance=tolerance, load_factor=factor,
                largest_step_count=largest_step_count, body_force=force, progress=progress)
            yield factor, found
            if not found.converged:
                return
            start = found.snapshot

    return steps(start)


def refuse_free_fall(fabric: StaticFabric) -> None:
    """Refuse a net load on a fabric without supports, drives, anchors and planes."""
    scene, start = fabric.scene, fabric.start
    if not fabric.free.all() or scene.anchors or (
            fabric.contacts is not None and scene.parameters.names('planes')):
        return
    pushes = start.acting.wrench[:, :3]
    if start.own_wrench is not None and start.own_force_blocks is not None:
        if start.own_force_blocks.any():
            # A force that depends on position may hold the fabric.
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
            f'nothing holds this fabric: a total force of {size:.4g} N acts on it, from gravity, '
            'field.electric, loads or a body force; hold some bodies with supports.NAME, '
            'drives.NAME or anchors.NAME, or put planes.NAME below them')


class _Search:
    """Trust-region search that lowers the energy until all forces are balanced."""

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
        self.slack_steps = 0  # steps since forces have died out
        # Allow steps that include gaps between shells; number of next steps that include them.
        self.includes_gaps, self.gap_steps = False, 0

    def run(self, *, gently: bool) -> None:
        """
        Search until an equilibrium is found or no step improves.

        `gently` starts with soft contacts and stiffens them each time an equilibrium is near,
        because stiff contacts limit steps to the size of their overlaps. If the search stalls,
        contacts are softened again.
        """
        contacts = self.fabric.contacts
        if contacts is None:
            self._descend(self.tolerance)
            return
        begin, radius = self.here, self.radius
        self._search_in_rounds(contacts, self.steps + _SEARCH.first_steps, gently=gently)
        if not self._has_ended:
            # Restart with steps that include gaps between shells.
            self.here, self.radius, self.includes_gaps = begin, radius, True
            self._search_in_rounds(contacts, self.largest, gently=gently)

    def _search_in_rounds(
        self, contacts: StaticContacts, last: int, *, gently: bool
    ) -> None:
        """Search with contacts stiffened round by round, up to step number `last`."""
        stages = contacts.stages(self.first_force) if gently else [contacts.whole]
        for patience in _SEARCH.soften_after_steps:
            for stiffness in stages[:-1]:
                self._search_at(
                    stiffness, max(self.tolerance, _SEARCH.stiffen_residual), last - self.steps)
            self._search_at(contacts.whole, self.tolerance, min(patience, last - self.steps))
            if self._has_ended or self.steps >= last:
                return
            # Many short contacts, which stiff contacts open and close in every step.
            stages = contacts.softer_stages()

    @property
    def _has_ended(self) -> bool:
        """True if the search is over."""
        return self.steps >= self.largest or self._is_balanced(self.tolerance) or (
            self._is_slack() or self._escapes())

    def _search_at(self, stiffness: float, tolerance: float, most: float) -> None:
        """Search with a contact stiffness [N/m], for at most `most` steps."""
        assert self.fabric.contacts is not None
        self.fabric.contacts.stiffness = stiffness
        self.here = Configuration(
            self.fabric, self.here.position.copy(), self.here.orientation.copy())
        self._descend(tolerance, self.steps + most)

    def _acting(self) -> float:
        """Return the largest force [N] on a body: weight, loads, connectors, or unbalanced."""
        return max(self.here.force_scale, float(np.abs(self.unbalanced()[:, :3]).max(initial=0.0)))

    def _descend(self, tolerance: float, last: float = math.inf) -> None:
        stuck = 0
        while self.steps < min(self.largest, last) and stuck < 30 and not (
                self._is_balanced(tolerance) or self._is_slack() or self._escapes()):
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
        """Return the largest unbalanced force, or torque over a, over the largest acting force."""
        left = np.abs(self.unbalanced())
        left[:, 3:] /= self.fabric.half_edge
        most, scale = float(left.max(initial=0.0)), self._scale()
        least = 10.0 * self.fabric.rounding
        if scale > least:
            return float(most / scale)
        # Without acting forces, only the round-off of lengths remains.
        return 1.0 if most > least else 0.0

    def _scale(self) -> float:
        """
        Return the largest acting force [N], or the initial one if forces have died out.

        Relative to the present forces, forces that die out would never count as balanced.
        """
        return self.first_force if self._has_died_out() else self.here.force_scale

    def _has_died_out(self) -> bool:
        """Return True if forces have become negligible and no weight or load acts."""
        here = self.here
        return (here.force_scale < _SEARCH.died_out_ratio * self.first_force
                and self.fabric.model.gravity is None and not here.acting.wrench.any()
                and (here.own_wrench is None or not here.own_wrench.any()))

    def _is_slack(self) -> bool:
        """Return True if forces have been dying out for many steps."""
        return self.slack_steps > _SEARCH.slack_steps

    @property
    def is_at_rest(self) -> bool:
        """True if the unbalanced forces are within the tolerance."""
        return self._is_balanced(self.tolerance)

    def _escapes(self) -> bool:
        """Return True if a body has moved so far that no force will bring it back."""
        return self._farthest()[1] > _SEARCH.escape_ratio * self.extent

    def _farthest(self) -> tuple[int, float, np.ndarray]:
        """Return the body with the largest displacement, its size [m] and direction (3,)."""
        moved = self.here.position - self.fabric.start.position
        away = np.linalg.norm(moved, axis=1)
        body = int(np.argmax(away))
        return body, float(away[body]), moved[body] / max(float(away[body]), 1e-300)

    def _is_balanced(self, tolerance: float) -> bool:
        """Return True if unbalanced forces are within the tolerance or the round-off."""
        rounding, scale = self.fabric.rounding, self._scale()
        return self.residual() <= max(
            tolerance, rounding / scale if scale > 10.0 * rounding else 0.0)

    def unbalanced(self) -> np.ndarray:
        """Return the unbalanced forces and torques (n, 6); 0 on held degrees of freedom."""
        return np.where(self.free, self.here.force, 0.0)

    def _step(self) -> bool:
        """Try one step; return True if it was accepted."""
        here, layout = self.here, self.fabric.layout
        gradient = layout.spread(-self.unbalanced())
        size = math.sqrt(weighted_square(self.weight, gradient))
        self.first_gradient = max(self.first_gradient, size)
        accuracy = min(0.1, math.sqrt(size / self.first_gradient), 0.1 * self.residual()**0.25)
        most = min(_SEARCH.max_products, int(_SEARCH.products_per_freedom * self.free.sum()) + 20)
        found, bend, crossings = self._descent(gradient, accuracy, most)
        motion = layout.gather(found.step)
        # Only rotations are limited; a fabric may move far, as long as the energy decreases.
        turn = float(np.abs(motion[:, 3:]).max(initial=0.0))
        part = _SEARCH.max_turn_rad / turn if turn > _SEARCH.max_turn_rad else 1.0
        slope = product_of(gradient, found.step)
        # Shorter steps in the same direction cost no products (Nocedal and Yuan 1998, Combining
        # trust region and line search techniques).
        for _ in range(_SEARCH.trial_count):
            expected = part * slope + part**2 * bend
            if crossings is not None:
                expected += crossings.energy(part)
            there = here.moved(part * motion)
            gain = self._gain(part * motion, expected, there)
            if gain > _SEARCH.min_gain_ratio:
                break
            part *= 0.5
        length = part * found.length
        if gain < _SEARCH.poor_gain_ratio and self.includes_gaps and (
                not self._has_equal_contacts(there)):
            self.gap_steps = _SEARCH.gap_steps
        if gain < 0.25:
            self.radius = 0.5 * length
        elif gain > 0.75 and (found.on_border or part < 1.0):
            self.radius = max(self.radius, 2.0 * length)
        if gain > _SEARCH.min_gain_ratio:
            self.here = there
            return True
        return False

    def _has_equal_contacts(self, there: Configuration) -> bool:
        """Return True if the number of contacts is the same as in the present configuration."""
        here = self.here.contact_state, there.contact_state
        return all(part is None for part in here) or len({
            len(part.pairs) + sum(map(len, part.planes)) for part in here if part is not None
        }) == 1

    def _descent(
        self, gradient: np.ndarray, accuracy: float, most: int
    ) -> tuple[Step, float, Crossings | None]:
        """Return a step, its second-order energy change by the tangent [J], and its kinks."""
        here, layout = self.here, self.fabric.layout
        found = steihaug(here.multiply, self.weight, gradient, self.radius, accuracy, most)
        self.products += found.iterations
        bend = found.expected - product_of(gradient, found.step)
        self.gap_steps = max(self.gap_steps - 1, 0)
        meets = self.gap_steps > 0 and not self._has_died_out()
        if not (meets or self.fabric.laws.kinked.any()):
            return found, bend, None
        reach = 0.0
        if meets:
            # Bounds the displacements of both bodies of a pair.
            farthest = float(np.abs(layout.gather(found.step)[:, :3]).max(initial=0.0))
            reach = min(
                _SEARCH.reach_factor * farthest,
                _SEARCH.max_reach_ratio * self.fabric.half_edge)
        crossings = Crossings(here, reach)
        step, product, image = (np.zeros_like(found.step) for _ in range(3))
        slopes, length, on_border = gradient, 0.0, False
        for _ in range(_SEARCH.max_pieces):
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
        """Return the ratio of the actual to the expected change of energy."""
        here = self.here
        if not expected < 0.0:
            return -1.0
        # Loads without a potential are those at the start of the step.
        pushed = here.acting.wrench - self._conservative_wrench(here)
        change = there.energy - here.energy - float((pushed * motion).sum())
        own = self.fabric.own_force
        if own is not None and not own.has_potential:
            change -= own.work(here.position, here.orientation, motion)
        if abs(expected) < _SEARCH.rounding_ratio * max(abs(here.energy), abs(there.energy)):
            # The forces at both ends are more accurate than the difference of energies.
            ahead = there.force - (there.acting.wrench - self._conservative_wrench(there)) + pushed
            change = -0.5 * float(((here.force + ahead) * motion).sum())
        return change / expected if math.isfinite(change) else -1.0

    def _conservative_wrench(self, at: Configuration) -> np.ndarray:
        """Return the wrenches with a potential, (n, 6)."""
        return self.fabric.loads.dead_wrench(at.axes)

    def result(self) -> Equilibrium:
        """Return the result with its verdict."""
        residual, converged = self.residual(), self.is_at_rest
        here = self.exact()
        contacts = here.contact_forces
        beyond = ''
        if converged and here.fabric.packed.curves.tables:
            beyond, stops = here.fabric.packed.curves.describe_beyond(
                np.where(here.snapshot.intact, here.snapshot.connector_length, np.nan),
                here.fabric.scene.connectors.bodies)
            if stops:
                converged = False
            elif beyond:
                _LOGGER.warning(
                    '%s at rest: the law is extrapolated there (connector.law_beyond)', beyond)
        verdict, curvature = NOT_AT_REST, Curvature(-1, -1)
        branches: Mapping[str, Curvature] = {}
        if converged:
            verdict, curvature, branches = judge_equilibrium(here)
        reason = '' if converged else self._reason() if not beyond else (
            f'{beyond} at rest, and connector.law_beyond is stop; extrapolate continues the law '
            'linearly')
        return Equilibrium(
            snapshot=here.snapshot, converged=converged, residual=residual, verdict=verdict,
            mechanism_count=curvature.zero, unstable_count=curvature.negative,
            force_scale=here.force_scale, unbalanced_wrench=self.unbalanced(),
            tension=here.tension, contact_state=here.contact_state,
            reaction=np.where(self.free, 0.0, -here.force), step_count=self.steps,
            product_count=self.products, at_kink=here.at_kink,
            anchors_at_kink=here.anchors_at_kink, branches=branches,
            first_touches=here.first_touches, reason=reason, reactions=reactions_of(
                here, here.force, contacts), friction=here.friction, contacts=contacts)

    def exact(self) -> Configuration:
        """Return the present configuration with exact second derivatives of contacts."""
        contacts = self.fabric.contacts
        if contacts is None:
            return self.here
        contacts.smoothed = False
        return self.here.anew()

    def _reason(self) -> str:
        """Return why the search ended without an equilibrium, and what to try."""
        if self._escapes():
            body, far, (x, y, z) = self._farthest()
            return (
                f'body {body} has moved {far:.3g} m along ({x:.4g}, {y:.4g}, {z:.4g}), and '
                'nothing holds it back: the energy decreases without bound in this direction; '
                'hold it by supports.NAME, anchors.NAME, planes.NAME or contact.friction, or '
                'reduce the loads')
        turning = _without_potential(self.fabric, self.here)
        if turning:
            return (
                f'{", ".join(turning)}: follows its bodies or applies a torque, so it has no '
                'potential energy to minimise, and there may be no equilibrium; increase the '
                'loads in steps (--load-steps, ico.step_loads), or simulate the fabric with drag')
        if pushing := self._compressed_wrapped():
            names = ', '.join(map(str, pushing[:4])) + (' and more' if len(pushing) > 4 else '')
            return (
                f'connectors {names} are in compression while wrapped over shells '
                '(connector.obstruction wrap): they rest where another geodesic becomes shorter '
                'and their force jumps, so that no step converges; real connectors over shells '
                'only pull: set connector.stiffness_compression to 0.0, give a '
                'connector.natural_length that keeps them taut, or simulate the fabric with drag')
        if self._has_died_out():
            return (
                f'the fabric goes slack: the forces have dropped to {self.residual():.1g} of '
                'their initial values and decrease with every step, so it bears no load and has '
                'no stiffness; give a connector.natural_length that keeps it taut, or loads')
        if self.steps >= self.largest:
            return (
                f'the search took all of its {self.largest:,} steps; allow more (--steps, '
                'largest_step_count), or increase the loads in steps (--load-steps, '
                'ico.step_loads)')
        return (
            'no step lowers the energy: the unbalanced forces are within round-off, or forces are '
            'discontinuous there; increase the loads in steps (--load-steps, ico.step_loads), or '
            'use a larger tolerance')

    def _compressed_wrapped(self) -> list[int]:
        """Return wrapped connectors in compression on the bodies with the largest residuals."""
        here, of = self.here, self.here.wrapped.of
        left = np.abs(self.unbalanced()[:, :3]).max(axis=1)
        bodies = self.fabric.scene.connectors.bodies[of]
        chosen = (here.tension[of] < 0.0) & (left[bodies].max(axis=1) > 0.1 * left.max())
        found: list[int] = of[chosen].tolist()
        return found


def judge_equilibrium(here: Configuration) -> tuple[str, Curvature, Mapping[str, Curvature]]:
    """
    Return the verdict of an equilibrium, its curvature, and the curvatures of both branches.

    The first curvature is that with the larger of k_e and k_c at each kink.
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
    """Return the verdict from the curvatures with the softest and the stiffest kinks."""
    if stiff.negative > 0:
        return UNSTABLE
    if soft.negative > 0:
        return AT_KINK
    if soft.zero < 0 or stiff.zero < 0:
        return NOT_COUNTED
    if not soft.zero:
        return STABLE
    return MECHANISM if stiff.zero else AT_KINK
