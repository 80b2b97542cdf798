# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The table of all parameters: names, defaults, units, ranges and what a change does.

The table only defines the vocabulary: `validation.py` checks values against it, the node builds
its parameter descriptors from it, and docs/parameters.md prints it.
"""

from collections.abc import Iterator
from enum import Enum
from typing import NamedTuple, TypedDict, Unpack

from icofabric_sim.terms.registry import LAWS, TERMS

Scalar = bool | int | float | str
Value = bool | int | float | str | list[bool] | list[int] | list[float] | list[str]


class Change(Enum):
    """
    Effect of a parameter change on a run; the values are the words of documents and messages.

    Ordered by severity: a change of several parameters has the most severe of their effects.
    """

    FIXED = 'fixed at the start'
    AT_ONCE = 'acts at once'
    REBUILDS = 'rebuilds and keeps the motion'
    RESTARTS = 're-weaves and restarts the motion'


class Specification(NamedTuple):
    """
    Name, type, range and description of one parameter.

    The default determines the type; lists have its length and element type. `minimum` and
    `maximum` bound every element, and `open_minimum` excludes the minimum itself. `smallest` is
    the smallest value allowed other than 0. `change` is the effect of a change at run time.
    """

    name: str
    default: Value
    unit: str
    description: str
    change: Change = Change.REBUILDS
    minimum: float | None = None
    maximum: float | None = None
    open_minimum: bool = False
    smallest: float | None = None
    choices: tuple[Scalar, ...] = ()
    required: bool = False


class _Options(TypedDict, total=False):
    minimum: float
    maximum: float
    open_minimum: bool
    smallest: float
    choices: tuple[Scalar, ...]
    required: bool


def _s(
    name: str,
    default: Value,
    unit: str,
    description: str,
    change: Change = Change.REBUILDS,
    **options: Unpack[_Options],
) -> Specification:
    return Specification(name, default, unit, description, change, **options)


def _positive(**options: Unpack[_Options]) -> _Options:
    return {'minimum': 0.0, 'open_minimum': True, **options}


def _of(term: str, rows: str = 'PARAMETERS') -> Iterator[Specification]:
    """Yield parameters from the folder of a term."""
    for name, default, unit, description, *options in getattr(
            _TERMS[term].module('parameters'), rows):
        yield _s(name, default, unit, description, **dict(*options))


_TERMS = {term.name: term for term in TERMS}
# Those of connector laws that have a name.
LAW_PARAMETERS = [
    row for law in LAWS if law.has('parameters') for row in law.module('parameters').PARAMETERS]
FIXED, AT_ONCE, RESTARTS = Change.FIXED, Change.AT_ONCE, Change.RESTARTS
_ZERO3 = [0.0, 0.0, 0.0]
# Forms of the equations of rotation.
ROTATIONS = ('quaternion', 'direction_cosines')
# What an equilibrium solve minimises.
OBJECTIVES = ('energy', 'resultants')
# Beyond this time, seconds in double precision no longer resolve nanoseconds.
_MAX_TIME_S = 1e9

STATIC: tuple[Specification, ...] = (
    _s('shell.edge_length', 0.02, 'm', 'outer edge length 2a of a shell', RESTARTS, **_positive()),
    _s('shell.thickness', 0.002, 'm',
       'shell thickness T at a face centre (eq 41)', RESTARTS, **_positive()),
    _s('shell.inner_edge_length', 0.0, 'm',
       'inner edge length 2b; a value above 0 replaces shell.thickness', RESTARTS, minimum=0.0),
    _s('shell.density', 1200.0, 'kg/m^3',
       'density rho of the shell material', RESTARTS, **_positive()),
    _s('shell.layers', '', '',
       'CSV of two columns: distance from the centre [m] of a layer parallel to the faces, '
       'and its density [kg/m^3]; interpolated linearly; replaces shell.density',
       RESTARTS),
    _s('shell.expression', '', '',
       'density [kg/m^3] in place of shell.density, an expression of x, y, z [m] in body axes',
       RESTARTS),
    _s('shell.mass', 0.0, 'kg',
       'mass of a shell; 0: from geometry and density; a given mass also scales the inertia',
       RESTARTS, minimum=0.0),
    _s('shell.inertia', 0.0, 'kg m^2',
       'isotropic moment of inertia Lambda of a shell; 0: from geometry and mass',
       RESTARTS, minimum=0.0),
    _s('shell.principal_inertia', _ZERO3, 'kg m^2',
       'moments of inertia about the body axes x, y, z, if not isotropic; zeros: shell.inertia',
       RESTARTS),
    _s('weave.kind', 'orthogonal', '',
       'weave; bias: the orthogonal weave, turned so that a face of each shell points up',
       RESTARTS, choices=('orthogonal', 'bias', 'radial')),
    _s('weave.variant', 0, '',
       '0: a body at the corner of the grid; 1: a gap at the corner; 2 and 3: variants 0 and 1 '
       'turned by 90 degrees',
       RESTARTS, choices=(0, 1, 2, 3)),
    _s('weave.size', [5, 5, 5], '', 'number of grid positions Nx, Ny, Nz', RESTARTS, minimum=1),
    _s('weave.box', _ZERO3, 'm',
       'box to fill with whole shells; an upright bias weave fills it with shell centres, so '
       'shells protrude; zeros: weave.size',
       RESTARTS, minimum=0.0),
    _s('weave.radius', 0.0, 'm',
       'radial only: radius of the lowest level about the axis; 0: the rows span a quarter '
       'circle',
       RESTARTS, minimum=0.0),
    _s('weave.azimuth', 0.0, 'rad', 'bias only: rotation about the vertical', RESTARTS),
    _s('weave.boundary', 'upright', '',
       'bias only: box that the weave fills; upright: axis-aligned, fabric: turned with the weave',
       RESTARTS, choices=('upright', 'fabric')),
    _s('weave.region', '', '',
       'region to cut the weave to, centred on the fabric: sphere R, cylinder R H, box X Y Z [m], '
       'or a closed mesh file (.stl, .obj; m); keeps bodies whose centres lie inside',
       RESTARTS),
    _s('weave.connected', True, '',
       'false: bodies at their woven positions without connectors', RESTARTS),
    _s('weave.connector_length', 0.0, 'm',
       'length L of a connector as woven; a value above 0 determines the angle',
       RESTARTS, minimum=0.0),
    _s('weave.connector_angle', 0.0, 'rad',
       'angle theta between a connector as woven and the nearest grid axis, used while '
       'weave.connector_length is 0', RESTARTS),
    _s('connector.stiffness', 500.0, 'N/m',
       'stiffness k in extension and compression (eq 1)', minimum=0.0),
    _s('connector.stiffness_extension', -1.0, 'N/m',
       'stiffness k_e above the natural length (eq 2); negative: connector.stiffness'),
    _s('connector.stiffness_compression', -1.0, 'N/m',
       'stiffness k_c below the natural length (eq 2); negative: connector.stiffness; 0: the '
       'connector goes slack'),
    _s('connector.natural_length', 0.0, 'm',
       'natural length D; 0: the length L as woven', minimum=0.0),
    _s('connector.break_length_extension', 0.0, 'm',
       'total length L_e > D at which a stretched connector breaks for good (eq 3); 0: never '
       'breaks',
       minimum=0.0),
    _s('connector.break_length_compression', 0.0, 'm',
       'total length L_c < D at which a compressed connector breaks for good; 0: never breaks',
       minimum=0.0),
    *_of('damping'),
    *_of('maxwell'),
    *_of('bending'),
    *_of('twisting'),
    _s('connector.obstruction', 'warn', '',
       'response to a connector that enters its own shell: warn once, stop the run, or wrap it '
       'over the faces along the shortest path (attachment points on the shell or outside)',
       choices=('warn', 'stop', 'wrap')),
    _s('connector.attachment_scale', 1.0, '',
       'factor by which edge midpoints are multiplied to give attachment points', **_positive()),
    *(
        _s(f'connector.attachment.{edge}', _ZERO3, 'm',
           f'attachment point at the edge {edge}, from the centre, body axes; zeros: scaled '
           'midpoint')
        for edge in ('up', 'down', 'north', 'south', 'west', 'east')
    ),
    _s('connector.law', '', '',
       'law that replaces eq 1: exponential, or a CSV of length [m], force [N] (positive: '
       'tension)'),
    _s('connector.law_beyond', 'extrapolate', '',
       'lengths outside the table: extrapolate linearly and warn once, or stop the run',
       choices=('extrapolate', 'stop')),
    *(
        _s(f'connector.{name}', default, unit, description)
        for name, default, unit, description in LAW_PARAMETERS
    ),
    *_of('gravity'),
    *_of('drag'),
    _s('charge.per_body', 0.0, 'C', 'charge of each shell, distributed like its mass'),
    _s('charge.expression', '', '',
       'charge density [C/m^3], an expression of x, y, z [m] in body axes; replaces '
       'charge.per_body and charge.dipole'),
    _s('charge.layers', '', '',
       'the same as a CSV, as shell.layers'),
    *_of('dipole'),
    *_of('coulomb'),
    _s('field.electric', _ZERO3, 'V/m', 'uniform electric field, world axes'),
    _s('field.electric_expression', '', '',
       'electric field added to field.electric: three expressions of x, y, z, t'),
    *_of('magnet'),
    _s('field.profile', 'steady', '',
       'time factor of the electric field, as for loads; the work of a field that varies counts '
       'as external work'),
    _s('field.start', 0.0, 's',
       'time at which the electric field starts, from the start of the motion',
       minimum=0.0, maximum=_MAX_TIME_S),
    _s('field.duration', 0.0, 's',
       'of the ramp or pulse; steady and sine: how long the field acts, 0: without end',
       minimum=0.0, maximum=_MAX_TIME_S),
    _s('contact.mode', 'auto', '',
       'never: shells pass through each other; always: computed in every step; auto: only while '
       'shells can touch, with the same result',
       choices=('never', 'always', 'auto')),
    _s('contact.stiffness', 0.0, 'N/m',
       'K, between shells, and between shells and planes: energy K d^2 / 2 at overlap d; 0: '
       'chosen for the scene so that overlaps stay below 1 % of a',
       minimum=0.0),
    _s('contact.damping', 0.0, 's/m',
       'c: normal forces are multiplied by 1 + c times the rate of overlap, and never '
       'attractive; icofabric_sim.contact.damping_for returns c for a coefficient of restitution',
       minimum=0.0),
    _s('contact.friction', 0.0, '',
       'coefficient of friction mu: bodies in contact stick by a tangential spring up to mu '
       'times the normal force, then slide',
       minimum=0.0),
    _s('pull.strength', 1.0, '',
       'scale of ~/pull: stiffness and largest force relative to the values chosen for the '
       'fabric',
       **_positive(maximum=1000.0)),
    _s('initial_random.velocity_sigma', 0.0, 'm/s',
       'random start: standard deviation of each velocity component', minimum=0.0),
    _s('initial_random.spin_sigma', 0.0, 'rad/s',
       'random start: standard deviation of each angular velocity component', minimum=0.0),
    _s('initial_random.seed', 0, '', 'seed of the random start', minimum=0, maximum=2**32 - 1),
    _s('equilibrium.objective', 'energy', '',
       'what an equilibrium solve minimises; energy: potential energy, with contacts as springs; '
       'resultants: force and moment resultants without overlap, as in the document (no follower '
       'loads)',
       AT_ONCE, choices=OBJECTIVES),
    _s('duration', 0.0, 's',
       'simulated time after which the node ends; 0: runs until stopped',
       AT_ONCE, minimum=0.0, maximum=_MAX_TIME_S),
    _s('solver.method', 'auto', '',
       'integration method; auto: the cheapest method that meets the tolerance in this scene',
       choices=('auto', 'leapfrog', 'srkn4', 'srkn6', 'srkn8', 'dop8', 'tsit5', 'sdirk4')),
    _s('solver.tolerance', 1e-6, '1/s',
       'largest error added per second of simulated time: position over a, or orientation in '
       'rad, whichever is larger',
       minimum=1e-15, maximum=_MAX_TIME_S),
    _s('solver.step', 0.0, 's',
       'fixed time step, for which the tolerance is only reported; 0: the longest step that '
       'stability and tolerance allow',
       minimum=0.0, maximum=_MAX_TIME_S, smallest=1e-12),
    _s('solver.error_estimate', True, '',
       'estimate the errors that the method adds; false: only the step-size control measures '
       'errors; the steps are the same'),
    _s('solver.rotation', 'quaternion', '',
       'equations of rotation: quaternion (eqs 21-27), or direction_cosines (eqs 16-20) as an '
       'independent check',
       choices=ROTATIONS),
    _s('solver.energy_limit', 0.01, '',
       'largest relative error of the energy balance before the run stops; relative to the '
       'largest energy stored, exchanged or supplied',
       **_positive()),
    _s('solver.device', 'cpu', '',
       'cpu: compiled loops on the processor; cuda: Warp kernels on an NVIDIA GPU; warp_cpu: the '
       'Warp kernels on the processor, for tests',
       choices=('cpu', 'cuda', 'warp_cpu')),
    _s('solver.threads', 0, '',
       'number of threads, at most one per core; 0: as many as speed up the scene; results do '
       'not depend on it',
       minimum=0),
    _s('real_time_factor', 1.0, '',
       'target real-time factor; 0: as fast as possible',
       AT_ONCE, minimum=0.0, maximum=1e6, smallest=1e-6),
    _s('publish_rate', 60.0, 'Hz',
       'rate of poses, in simulated time', AT_ONCE, **_positive(maximum=1e6)),
    _s('marker_rate', 10.0, 'Hz',
       'rate of markers, in simulated time', AT_ONCE, **_positive(maximum=1e6)),
    _s('clock_rate', 100.0, 'Hz',
       'rate of /clock, in simulated time', AT_ONCE, **_positive(maximum=1e6)),
    _s('publish.group', '', '',
       'group of bodies published and recorded in `~/poses` and `~/state`; empty: all bodies; '
       '`~/bodies` lists their numbers',
       FIXED),
    _s('publish.stride', 1, '',
       'publish every n-th body of publish.group, starting with the first', FIXED, minimum=1),
    _s('tf.group', '', '',
       'group of bodies broadcast on /tf as frames `icosahedron_K` in `frame_id`, at '
       '`publish_rate`; empty: none; requires the package tf2_msgs',
       FIXED),
    _s('publish.connectors', '', '',
       'connectors in `~/tensions`: two groups, separated by a space, whose bodies they join '
       '(`all`: every body); empty: all',
       FIXED),
    _s('publish_clock', True, '', 'publish /clock', FIXED),
    _s('frame_id', 'world', '',
       'frame of all published data: no leading /, not the frame of a body, and not empty if '
       '`tf.group` is set',
       FIXED),
    _s('start_paused', False, '', 'start paused', FIXED),
    _s('reset_time', False, '', 'a reset also sets the time to 0', AT_ONCE),
    _s('step_count', 1, '', 'steps per call of the service ~/step',
       AT_ONCE, minimum=1, maximum=10**6),
    _s('advance_duration', 0.01, 's',
       'simulated time per call of the service ~/advance, in whole nanoseconds',
       AT_ONCE, minimum=1e-9, maximum=_MAX_TIME_S),
    _s('input_horizon', 1.0, 's',
       'how far the stamp of an input may lie ahead of simulated time; inputs with later stamps '
       '(of another clock) act at once',
       AT_ONCE, minimum=0.0, maximum=_MAX_TIME_S),
    _s('input_reliability', 'reliable', '',
       'QoS reliability of the subscriptions for wrenches and twists; best_effort also matches '
       'best-effort publishers, and lost messages are not sent again',
       FIXED, choices=('reliable', 'best_effort')),
    _s('checkpoint.path', '', '',
       'folder of numbered checkpoints, or a file NAME.checkpoint that each checkpoint '
       "overwrites; '': the folder PATH_checkpoints next to the bag PATH",
       AT_ONCE),
    _s('record.path', '', '',
       "folder of the bag; later recordings go to PATH_1, PATH_2 and so on; '': no recording; "
       'changes of record.* affect the next bag',
       AT_ONCE),
    _s('record.storage', 'mcap', '',
       'storage format of the bag', AT_ONCE, choices=('mcap', 'sqlite3')),
    _s('record.split_size', 0, '',
       'file size in bytes at which the bag continues in a new file; 0: one file',
       AT_ONCE, minimum=0, maximum=10**15, smallest=1024),
    _s('record.split_duration', 0.0, 's',
       'simulated time per file, after which the bag continues in a new file; 0: one file',
       AT_ONCE, minimum=0.0, maximum=_MAX_TIME_S, smallest=1e-3),
    _s('record.compression', 'none', '',
       'none, or zstd: compresses chunks (mcap) or messages (sqlite3)',
       AT_ONCE, choices=('none', 'zstd')),
    _s('record.measured', False, '',
       'also record `~/reactions`, `~/tensions` and `~/contacts`, from the next bag on', AT_ONCE),
)

_PROFILE = (
    _s('profile', 'steady', '',
       'time factor: steady, ramp, half_sine, sine F (F in Hz), or table FILE'),
    _s('start', 0.0, 's',
       'start time, from the start of the motion', minimum=0.0, maximum=_MAX_TIME_S),
    _s('duration', 0.0, 's',
       'duration of the profile; 0: without end', minimum=0.0, maximum=_MAX_TIME_S),
)

# Families of parameters FAMILY.NAME.FIELD with any number of NAMEs; the field '' is FAMILY.NAME.
FAMILIES: dict[str, tuple[Specification, ...]] = {
    'groups': (
        _s('', '', '',
           'selector: x_min, z_max, ..., level K, row K, column K, ids K K, box x0 y0 z0 x1 y1 '
           f'z1, all; with and, or, not; driven groups: {RESTARTS.value}',
           required=True),
    ),
    'constants': (
        _s('', 0.0, '', 'constant of expressions by its name', required=True),
    ),
    'connector_groups': (
        _s('between', '', '',
           "two groups: selects the connectors between their bodies; '': any bodies, with a "
           'direction'),
        _s('direction', '', '',
           'two opposite edges that the connectors join: up down, north south or west east, each '
           "a third of all connectors; '': any"),
        _s('stiffness', -1.0, 'N/m',
           'k in extension and compression; negative: as in connector.*'),
        _s('stiffness_extension', -1.0, 'N/m', 'k_e; negative: stiffness'),
        _s('stiffness_compression', -1.0, 'N/m', 'k_c; negative: stiffness'),
        _s('natural_length', 0.0, 'm',
           'natural length D; 0: connector.natural_length', minimum=0.0),
        _s('law', '', '', "exponential, or CSV of length [m], force [N]; '': connector.law"),
        _s('law_beyond', '', '',
           "lengths outside the table: extrapolate or stop; '': connector.law_beyond",
           choices=('', 'extrapolate', 'stop')),
        *(
            _s(name, default, unit, f'{description}; {default:g}: connector.{name}')
            for name, default, unit, description in LAW_PARAMETERS
        ),
        *_of('bending', 'GROUP_PARAMETERS'),
        *_of('twisting', 'GROUP_PARAMETERS'),
        *_of('damping', 'GROUP_PARAMETERS'),
        *_of('maxwell', 'GROUP_PARAMETERS'),
        _s('break_length_extension', -1.0, 'm',
           'L_e > D; 0: never breaks; negative: connector.break_length_extension'),
        _s('break_length_compression', -1.0, 'm',
           'L_c < D; 0: never breaks; negative: connector.break_length_compression'),
    ),
    'masses': (
        _s('group', '', '',
           'group of bodies whose mass, inertia or size differs from shell.*',
           RESTARTS, required=True),
        _s('edge_length', 0.0, 'm',
           'outer edge length 2a of each shell; 0: shell.edge_length; attachment points of '
           'connectors stay in place',
           RESTARTS, minimum=0.0),
        _s('mass', 0.0, 'kg',
           'mass of each body; 0: the mass of the shell times the cube of the edge ratio',
           RESTARTS, minimum=0.0),
        _s('inertia', 0.0, 'kg m^2',
           'moment of inertia of each body; 0: in proportion to the mass and the square of the '
           'edge',
           RESTARTS, minimum=0.0),
        _s('expression', '', '', 'as shell.expression', RESTARTS),
        _s('principal_inertia', _ZERO3, 'kg m^2',
           'moments of inertia of each body about its axes x, y, z, if not isotropic; zeros: '
           'inertia',
           RESTARTS),
    ),
    'charges': (
        _s('group', '', '',
           'group of bodies with an individual charge and dipole moment', required=True),
        _s('charge', 0.0, 'C', 'charge of each body, replaces charge.per_body'),
        _s('dipole', _ZERO3, 'C m',
           'dipole moment of each body, body axes; replaces charge.dipole'),
        _s('expression', '', '', 'as charge.expression'),
        _s('layers', '', '', 'as charge.layers'),
    ),
    'supports': (
        _s('group', '', '', 'supported group', required=True),
        _s('fix', 'all', '',
           'fixed degrees of freedom: tx ty tz (along world axes) rotation, or all'),
    ),
    'loads': (
        _s('group', '', '', 'group that the wrench acts on', required=True),
        _s('frame', 'world', '', 'axes of the wrench', choices=('world', 'body')),
        _s('point', _ZERO3, 'm', 'point of application in body axes, from the centre'),
        _s('hold', 0.0, 's', 'how long a received wrench is held; 0: until replaced', minimum=0.0),
        _s('share', 'each', '',
           'each: every body gets the wrench; total: each of n bodies gets 1/n of it',
           choices=('each', 'total')),
        _s('force', _ZERO3, 'N', 'force that the scene applies; a received wrench replaces it'),
        _s('torque', _ZERO3, 'N m',
           'torque that the scene applies; a received wrench replaces it'),
        _s('expression', '', '',
           'force added to all others: three expressions of x, y, z, t'),
        *_PROFILE,
    ),
    'tractions': (
        _s('group', '', '', 'group that the surface forces act on', required=True),
        _s('faces', 'exterior', '',
           'selector of faces: numbers K K ... (1 to 20), toward X Y Z, within ANGLE X Y Z, '
           'exterior, all; combined by and, or, not'),
        _s('pressure', 0.0, 'Pa', 'pressure, against the outward normal'),
        _s('shear', [0.0, 0.0], 'Pa',
           'shear along the first side of a face (first corner to second) and across it (normal '
           'x that side)'),
        _s('variation', '', '',
           'polynomial in the face coordinates (eq 35) that multiplies pressure and shear: '
           "coefficients of 1, l2, l3, l2^2, l2 l3, l3^2, ...; '': 1"),
        _s('expression', '', '',
           'factor of pressure and shear, or pressure and two shears [Pa]: expressions of xi, '
           'eta, x, y, z, t'),
        _s('direction', 'follower', '',
           'follower: turns with the body; fixed: keeps its world direction as woven',
           choices=('follower', 'fixed')),
        _s('frictionless', False, '', 'only the component along the face normal acts'),
        *_PROFILE,
    ),
    'line_loads': (
        _s('group', '', '', 'group with loaded edges', required=True),
        _s('edges', 'all', '',
           'edges: up down north south west east, all, or F-G, where the faces F and G meet'),
        _s('force', _ZERO3, 'N/m', 'force per length'),
        _s('frame', 'world', '', 'axes of the force', choices=('world', 'body')),
        _s('expression', '', '',
           'factor of the force, or three forces per length: expressions of s (0 to 1 along the '
           'edge), x, y, z, t'),
        *_PROFILE,
    ),
    'drives': (
        _s('group', '', '', 'group that moves as one rigid body', RESTARTS, required=True),
        _s('freedoms', 'all', '',
           'degrees of freedom that the drive prescribes: tx ty tz (along world axes) rotation, '
           'or all; the others stay free',
           RESTARTS),
        _s('motion', 'hold', '',
           'hold: no motion; velocity: constant twist (linear, angular); ramp: from rest to that '
           'twist; sine: harmonic from the start position; table, velocity_table: from a file',
           RESTARTS, choices=('hold', 'velocity', 'ramp', 'sine', 'table', 'velocity_table')),
        _s('linear', _ZERO3, 'm/s',
           'velocity of the centroid of the group, world axes; sine: amplitude [m]', RESTARTS),
        _s('angular', _ZERO3, 'rad/s',
           'angular velocity about the centroid, world axes; sine: amplitude of the rotation '
           'vector [rad]',
           RESTARTS),
        _s('start', 0.0, 's',
           'start time, from the start of the motion', RESTARTS, minimum=0.0, maximum=_MAX_TIME_S),
        _s('duration', 0.0, 's',
           'rise time of a ramp; otherwise how long the drive moves, 0: without end',
           RESTARTS, minimum=0.0, maximum=_MAX_TIME_S),
        _s('frequency', 0.0, 'Hz', 'frequency of sine', RESTARTS, minimum=0.0),
        _s('phase', 0.0, 'rad',
           'phase of sine: the displacement follows sin(2 pi f t + phase) - sin(phase)', RESTARTS),
        _s('file', '', '',
           'CSV of time [s], displacement [m], optionally rotation vector [rad], on a smooth '
           'curve; velocity_table: velocity [m/s], optionally angular velocity [rad/s] about one '
           'axis, linear in between',
           RESTARTS),
    ),
    'planes': (
        _s('normal', _ZERO3, '', 'normal of a rigid plane, towards its free side', required=True),
        _s('offset', 0.0, 'm', 'the free side is normal . x >= offset'),
        _s('motion', 'fixed', '',
           'fixed: never moves; hold: at rest until a twist on ~/planes/NAME; others as of drives',
           RESTARTS, choices=(
               'fixed', 'hold', 'velocity', 'ramp', 'sine', 'table', 'velocity_table')),
        _s('linear', _ZERO3, 'm/s',
           'velocity of the plane, world axes, in any direction; sine: amplitude [m]', RESTARTS),
        _s('start', 0.0, 's', 'as of drives', RESTARTS, minimum=0.0, maximum=_MAX_TIME_S),
        _s('duration', 0.0, 's', 'as of drives', RESTARTS, minimum=0.0, maximum=_MAX_TIME_S),
        _s('frequency', 0.0, 'Hz', 'as of drives', RESTARTS, minimum=0.0),
        _s('phase', 0.0, 'rad', 'as of drives', RESTARTS),
        _s('file', '', '',
           'as of drives, without rotation', RESTARTS),
    ),
    'connectors': (
        _s('bodies', [0, 0], '', 'two bodies that a custom connector joins', minimum=0),
        _s('points', [0.0] * 6, 'm', 'attachment point on each, from its centre, its axes'),
        _s('kind', 'spring', '',
           'hinge: a point common to both at rest, held by a stiff spring of length 0; only the '
           'first point is given',
           choices=('spring', 'hinge')),
        _s('axis', _ZERO3, '',
           'hinge: axis of rotation, axes of the first body; zero: rotations are free'),
        _s('file', '', '', 'instead: CSV of body, body, x, y, z, x, y, z [m] for each connector'),
        _s('stiffness', -1.0, 'N/m',
           'k in extension and compression; negative: as in connector.*'),
        _s('stiffness_extension', -1.0, 'N/m', 'k_e; negative: stiffness'),
        _s('stiffness_compression', -1.0, 'N/m', 'k_c; negative: stiffness; 0: a rope'),
        _s('natural_length', 0.0, 'm',
           'natural length D; 0: connector.natural_length, or the length at rest', minimum=0.0),
        _s('damping', -1.0, 'N s/m', 'damping along it; negative: connector.damping'),
        _s('break_length_extension', 0.0, 'm',
           'total length L_e > D; 0: never breaks', minimum=0.0),
        _s('break_length_compression', 0.0, 'm',
           'total length L_c < D; 0: never breaks', minimum=0.0),
    ),
    'anchors': (
        _s('body', 0, '',
           'body that this connector joins to a point of the world', minimum=0),
        _s('edge', 'up', '',
           'edge of the body where the connector is attached, or its centre',
           choices=('up', 'down', 'north', 'south', 'west', 'east', 'centre')),
        _s('point', _ZERO3, 'm',
           'attachment point on the body, from the centre, body axes; zero: the edge midpoint'),
        _s('position', _ZERO3, 'm', 'point where the connector ends, world frame', required=True),
        _s('velocity', _ZERO3, 'm/s',
           'velocity of that point from the start of the motion, world axes'),
        _s('file', '', '',
           'CSV of time [s] and displacement x, y, z [m] of that point, world axes; interpolated '
           'by a smooth curve that starts and ends at rest'),
        _s('motion', '', '',
           "motion of that point as of drives, by the next five; '': velocity or file",
           choices=('', 'ramp', 'sine')),
        _s('linear', _ZERO3, 'm/s', 'ramp: final velocity, world axes; sine: amplitude [m]'),
        _s('start', 0.0, 's',
           'as of drives', minimum=0.0, maximum=_MAX_TIME_S),
        _s('duration', 0.0, 's',
           'as of drives',
           minimum=0.0, maximum=_MAX_TIME_S),
        _s('frequency', 0.0, 'Hz', 'as of drives', minimum=0.0),
        _s('phase', 0.0, 'rad', 'as of drives'),
        _s('damping', 0.0, 'N s/m', 'viscous damping along the connector', minimum=0.0),
        _s('stiffness', -1.0, 'N/m',
           'k in extension and compression; negative: as in connector.*'),
        _s('stiffness_extension', -1.0, 'N/m', 'k_e; negative: stiffness'),
        _s('stiffness_compression', -1.0, 'N/m', 'k_c; negative: stiffness; 0: a rope'),
        _s('natural_length', 0.0, 'm', 'natural length D; 0: that of connectors', minimum=0.0),
        _s('break_length_extension', 0.0, 'm',
           'total length L_e > D; 0: never breaks', minimum=0.0),
        _s('break_length_compression', 0.0, 'm',
           'total length L_c < D; 0: never breaks', minimum=0.0),
    ),
    'initial': (
        _s('group', '', '', 'group with an initial state other than the woven one', required=True),
        _s('displacement', _ZERO3, 'm', 'displacement added to the woven positions, world axes'),
        _s('rotation', _ZERO3, 'rad', 'rotation vector about each centre, world axes'),
        _s('linear_velocity', _ZERO3, 'm/s', 'added velocity, world axes'),
        _s('angular_velocity', _ZERO3, 'rad/s', 'added angular velocity, world axes'),
        _s('file', '', '',
           'CSV with header, as snapshot.to_csv writes: body, any of x_m y_m z_m; qx qy qz qw; '
           'vx_m_s vy_m_s vz_m_s; wx_rad_s ... or wx_body_rad_s ...; replaces the woven state '
           'before the values above are added'),
    ),
    'bodies': (
        _s('position', _ZERO3, 'm',
           'centre of a loose body, which is no part of the weave; world frame',
           RESTARTS, required=True),
        _s('orientation', [0.0, 0.0, 0.0, 1.0], '', 'quaternion x y z w, body to world', RESTARTS),
        _s('linear_velocity', _ZERO3, 'm/s', 'velocity, world axes', RESTARTS),
        _s('angular_velocity', _ZERO3, 'rad/s', 'angular velocity, world axes', RESTARTS),
        _s('edge_length', 0.0, 'm',
           'outer edge length 2a of the shell; 0: shell.edge_length', RESTARTS, minimum=0.0),
        _s('mass', 0.0, 'kg',
           'mass; 0: the mass of the shell times the cube of the edge ratio',
           RESTARTS, minimum=0.0),
        _s('inertia', 0.0, 'kg m^2',
           'moment of inertia; 0: in proportion to the mass and the square of the edge',
           RESTARTS, minimum=0.0),
        _s('expression', '', '', 'as shell.expression', RESTARTS),
        _s('principal_inertia', _ZERO3, 'kg m^2',
           'moments of inertia about the body axes x, y, z, if not isotropic; zeros: inertia',
           RESTARTS),
    ),
}

BY_NAME: dict[str, Specification] = {entry.name: entry for entry in STATIC}

# Parameters that one kind of weave has.
OF_KIND = {'weave.azimuth': 'bias', 'weave.boundary': 'bias', 'weave.radius': 'radial'}


def with_kind(name: str, value: Value) -> dict[str, Value]:
    """Return a change of a parameter; one of the kind of weave resets those of other kinds."""
    return {name: value} | ({
        other: BY_NAME[other].default for other, kind in OF_KIND.items() if kind != value
    } if name == 'weave.kind' else {})
