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
The table of all parameters: names, defaults, units, ranges and what a change does.

Nothing is decided here but the vocabulary; `validation.py` judges values against it, the node
builds its descriptors from it, and the documentation prints it.
"""

from enum import Enum
from typing import NamedTuple, TypedDict, Unpack

Scalar = bool | int | float | str
Value = bool | int | float | str | list[bool] | list[int] | list[float] | list[str]


class Change(Enum):
    """
    What a change of a parameter does to a run; the value is how documents and answers say it.

    From the least to the most: a change of several parameters does what the last of theirs does.
    """

    FIXED = 'fixed at the start'
    AT_ONCE = 'acts at once'
    REBUILDS = 'rebuilds and keeps the motion'
    RESTARTS = 're-weaves and restarts the motion'


class Specification(NamedTuple):
    """
    One parameter.

    The type is that of the default; lists have the default's length and element type. `minimum`
    and `maximum` bound every element; `open_minimum` excludes the minimum itself;
    `smallest` is the least value beside 0. `change` says what a change at run time does.
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


FIXED, AT_ONCE, RESTARTS = Change.FIXED, Change.AT_ONCE, Change.RESTARTS
_ZERO3 = [0.0, 0.0, 0.0]
# Forms of the equations of rotation.
ROTATIONS = ('quaternion', 'direction_cosines')
# Simulated time is counted in nanoseconds, and given in seconds to about as many digits [s].
_LONGEST = 1e9

STATIC: tuple[Specification, ...] = (
    _s('shell.edge_length', 0.02, 'm', 'outer edge 2a of a shell', RESTARTS, **_positive()),
    _s(
        'shell.thickness',
        0.002,
        'm',
        'thickness T at a face centre (eq 41)',
        RESTARTS,
        **_positive(),
    ),
    _s(
        'shell.inner_edge_length',
        0.0,
        'm',
        'inner edge 2b; above 0 it replaces the thickness',
        RESTARTS,
        minimum=0.0,
    ),
    _s('shell.density', 1200.0, 'kg/m^3', 'density rho of the shell', RESTARTS, **_positive()),
    _s(
        'shell.layers',
        '',
        '',
        'CSV of the distance of the faces of a layer from the centre [m] and its density '
        '[kg/m^3], linear in between; in place of shell.density',
        RESTARTS,
    ),
    _s(
        'shell.mass',
        0.0,
        'kg',
        '0: from the geometry; else the inertia scales with it',
        RESTARTS,
        minimum=0.0,
    ),
    _s(
        'shell.inertia',
        0.0,
        'kg m^2',
        '0: from geometry and mass; else the isotropic inertia Lambda',
        RESTARTS,
        minimum=0.0,
    ),
    _s(
        'shell.principal_inertia',
        _ZERO3,
        'kg m^2',
        'moments of inertia about the body axes x, y, z of shells that are not isotropic; zeros: '
        'shell.inertia about all',
        RESTARTS,
    ),
    _s(
        'weave.kind',
        'orthogonal',
        '',
        'weave; bias: the orthogonal one in the bias orientation, a face of each shell up',
        RESTARTS,
        choices=('orthogonal', 'bias', 'radial'),
    ),
    _s(
        'weave.variant',
        0,
        '',
        'corner body or gap (0, 1), the same turned by 90 degrees (2, 3)',
        RESTARTS,
        choices=(0, 1, 2, 3),
    ),
    _s('weave.size', [5, 5, 5], '', 'grid positions Nx, Ny, Nz', RESTARTS, minimum=1),
    _s(
        'weave.box',
        _ZERO3,
        'm',
        'box to fill best: with whole shells, or with the centres of the bias orientation in an '
        'upright box, whose shells stand out of it; all zero: weave.size is used',
        RESTARTS,
        minimum=0.0,
    ),
    _s(
        'weave.radius',
        0.0,
        'm',
        'radial only: of the lowest level, about the axis; 0: the rows span a quarter circle',
        RESTARTS,
        minimum=0.0,
    ),
    _s('weave.azimuth', 0.0, 'rad', 'bias only: turn about the vertical', RESTARTS),
    _s(
        'weave.boundary',
        'upright',
        '',
        'bias only: fill an upright box, or turn the whole slab',
        RESTARTS,
        choices=('upright', 'fabric'),
    ),
    _s(
        'weave.region',
        '',
        '',
        'cuts the weave: sphere R, cylinder R H (upright), box X Y Z, all in m, or the path of '
        'a closed mesh (.stl, .obj; in m). Its middle is that of the fabric of weave.size or '
        'weave.box; bodies whose centres lie inside stay',
        RESTARTS,
    ),
    _s('weave.connected', True, '', 'false: bodies at their places without connectors', RESTARTS),
    _s(
        'weave.connector_length',
        0.0,
        'm',
        'length L; above 0 it rules and the angle follows',
        RESTARTS,
        minimum=0.0,
    ),
    _s('weave.connector_angle', 0.0, 'rad', 'angle theta, used while the length is 0', RESTARTS),
    _s('connector.stiffness', 500.0, 'N/m', 'stiffness k in both directions (eq 1)', minimum=0.0),
    _s(
        'connector.stiffness_extension',
        -1.0,
        'N/m',
        'k_e, above the natural length (eq 2); negative: connector.stiffness',
    ),
    _s(
        'connector.stiffness_compression',
        -1.0,
        'N/m',
        'k_c, below the natural length (eq 2); negative: connector.stiffness; 0: slack',
    ),
    _s('connector.natural_length', 0.0, 'm', 'natural length D; 0: D = L', minimum=0.0),
    _s(
        'connector.break_length_extension',
        0.0,
        'm',
        'length L_e at which a connector breaks for good (eq 3), all of it, so above D; 0: never '
        'breaks',
        minimum=0.0,
    ),
    _s(
        'connector.break_length_compression',
        0.0,
        'm',
        'length L_c at which a compressed connector breaks for good, all of it, so below D; 0: '
        'never breaks',
        minimum=0.0,
    ),
    _s('connector.damping', 0.0, 'N s/m', 'damping along the connector', minimum=0.0),
    _s(
        'connector.maxwell_stiffness',
        0.0,
        'N/m',
        'stiffness k_1 of a spring with a dashpot in series, beside the connector: together a '
        'standard linear solid; 0: none',
        minimum=0.0,
    ),
    _s(
        'connector.maxwell_time',
        0.0,
        's',
        'relaxation time tau of that arm, dashpot over spring; above 0 with '
        'connector.maxwell_stiffness',
        minimum=0.0,
    ),
    _s(
        'connector.bending_stiffness',
        0.0,
        'N m/rad',
        'restores the angle of attachment at each end, kappa_b (1 - cos)',
        minimum=0.0,
    ),
    _s(
        'connector.twisting_stiffness',
        0.0,
        'N m/rad',
        'restores the relative orientation of the two bodies, kappa_t (1 - cos)',
        minimum=0.0,
    ),
    _s(
        'connector.obstruction',
        'warn',
        '',
        'a connector that enters the shell it is attached to: warn once, stop the run, or wrap it '
        'around the shell, by the shortest way over the faces (from attachment points on it or '
        'outside)',
        choices=('warn', 'stop', 'wrap'),
    ),
    _s(
        'connector.attachment_scale',
        1.0,
        '',
        'attachment = edge midpoint times this',
        **_positive(),
    ),
    *(
        _s(
            f'connector.attachment.{edge}',
            _ZERO3,
            'm',
            f'attachment point at {edge}, body axes; all zero: the edge midpoint, scaled',
        )
        for edge in ('up', 'down', 'north', 'south', 'west', 'east')
    ),
    _s(
        'connector.law',
        '',
        '',
        'CSV of length [m], force [N] (positive: it pulls) instead of eq 1',
    ),
    _s(
        'connector.law_beyond',
        'extrapolate',
        '',
        'lengths beyond the table: extrapolate it straight and warn once, or stop the run',
        choices=('extrapolate', 'stop'),
    ),
    _s('gravity', _ZERO3, 'm/s^2', 'acceleration of gravity, world frame'),
    _s('drag.linear', 0.0, 'N s/m', 'drag on each body', minimum=0.0),
    _s('drag.angular', 0.0, 'N m s/rad', 'rotational drag on each body', minimum=0.0),
    _s('charge.per_body', 0.0, 'C', 'charge of each shell, spread like its mass'),
    _s('charge.dipole', _ZERO3, 'C m', 'dipole of each shell, body frame'),
    _s(
        'charge.mutual',
        False,
        '',
        'Coulomb forces between the charges of all bodies, pair by pair; at most 5000 bodies',
    ),
    _s('field.electric', _ZERO3, 'V/m', 'uniform electric field'),
    _s('field.magnetic', _ZERO3, 'T', 'uniform magnetic field'),
    _s(
        'field.profile',
        'steady',
        '',
        'factor of the electric field in time: steady, ramp, half_sine, sine F or table FILE, as '
        'of loads; what it does counts as work then, not as energy',
    ),
    _s('field.start', 0.0, 's', 'when the electric field begins, after the motion began',
       minimum=0.0, maximum=_LONGEST),
    _s('field.duration', 0.0, 's',
       'of the ramp or the pulse; how long a steady field or a sine acts, 0: for ever',
       minimum=0.0, maximum=_LONGEST),
    _s(
        'contact.mode',
        'auto',
        '',
        'never: shells pass through each other; always; auto: computed only while shells can '
        'touch, with the same result as always',
        choices=('never', 'always', 'auto'),
    ),
    _s(
        'contact.stiffness',
        0.0,
        'N/m',
        "between shells, and shells and planes: energy K d^2 / 2 at the overlap d; 0: the scene's "
        'own scale, for overlaps below 1 % of a',
        minimum=0.0,
    ),
    _s(
        'contact.damping',
        0.0,
        's/m',
        'c: the push of a contact is multiplied by 1 + c times the rate of its overlap, and never '
        'pulls; contact.damping_for says which gives a restitution',
        minimum=0.0,
    ),
    _s(
        'contact.friction',
        0.0,
        '',
        'mu: what touches sticks by a spring whose force along the surface is at most mu times '
        'the push, and slides at that',
        minimum=0.0,
    ),
    _s(
        'pull.strength',
        1.0,
        '',
        'stiffness and largest force of a pull by ~/pull, in parts of those that are scaled to '
        'the fabric',
        **_positive(maximum=1000.0),
    ),
    _s(
        'initial_random.velocity_sigma',
        0.0,
        'm/s',
        'random start: deviation of each velocity component',
        minimum=0.0,
    ),
    _s(
        'initial_random.spin_sigma',
        0.0,
        'rad/s',
        'random start: deviation of each spin component',
        minimum=0.0,
    ),
    _s('initial_random.seed', 0, '', 'seed of the random start', minimum=0, maximum=2**32 - 1),
    _s(
        'duration',
        0.0,
        's',
        'simulated time after which the node ends; 0: it runs until stopped',
        AT_ONCE,
        minimum=0.0,
        maximum=_LONGEST,
    ),
    _s(
        'solver.method',
        'auto',
        '',
        'integration method; auto: the one with the least work for the tolerance in this scene',
        choices=('auto', 'leapfrog', 'srkn4', 'srkn6', 'srkn8', 'dop8', 'sdirk4'),
    ),
    _s(
        'solver.tolerance',
        1e-6,
        '1/s',
        'error that the method may add for each second of simulated time: position over a, '
        'orientation in rad, the larger',
        minimum=1e-15,
        maximum=_LONGEST,
    ),
    _s(
        'solver.step',
        0.0,
        's',
        'fixed step, for which the tolerance is reported only; 0: chosen, as long as stability '
        'and tolerance allow',
        minimum=0.0,
        maximum=_LONGEST,
        smallest=1e-12,
    ),
    _s(
        'solver.error_estimate',
        True,
        '',
        'whether errors that the method adds are estimated; false: nothing is measured but what '
        'chooses steps, and the same steps are taken',
    ),
    _s(
        'solver.rotation',
        'quaternion',
        '',
        'form of the equations of rotation; quaternion: eqs 21-27; direction_cosines: eqs 16-20, '
        'for a second opinion',
        choices=ROTATIONS,
    ),
    _s(
        'solver.energy_limit',
        0.01,
        '',
        'error of the energy balance, in parts of the largest energy that moved, was exchanged or '
        'put in, that stops a run',
        **_positive(),
    ),
    _s(
        'solver.device',
        'cpu',
        '',
        'what takes the steps; cpu: the processor, by compiled loops; cuda: an NVIDIA GPU, by '
        'kernels of Warp; warp_cpu: the same kernels on the processor, to try them',
        choices=('cpu', 'cuda', 'warp_cpu'),
    ),
    _s(
        'solver.threads',
        0,
        '',
        'threads, at most one for each core; 0: as many as pay; the result does not depend on it',
        minimum=0,
    ),
    _s(
        'real_time_factor',
        1.0,
        '',
        'wanted pace; 0: as fast as possible',
        AT_ONCE,
        minimum=0.0,
        maximum=1e6,
        smallest=1e-6,
    ),
    _s(
        'publish_rate',
        60.0,
        'Hz',
        'rate of the poses, in simulated time',
        AT_ONCE,
        **_positive(maximum=1e6),
    ),
    _s(
        'marker_rate',
        10.0,
        'Hz',
        'rate of the markers, in simulated time',
        AT_ONCE,
        **_positive(maximum=1e6),
    ),
    _s(
        'clock_rate',
        100.0,
        'Hz',
        'rate of /clock, in simulated time',
        AT_ONCE,
        **_positive(maximum=1e6),
    ),
    _s(
        'publish.group',
        '',
        '',
        'bodies in `~/poses` and `~/state`, published and recorded: a group; empty: all bodies. '
        '`~/bodies` has their numbers',
        FIXED,
    ),
    _s(
        'publish.stride',
        1,
        '',
        'of these bodies every so many-th, from the first',
        FIXED,
        minimum=1,
    ),
    _s(
        'tf.group',
        '',
        '',
        'bodies that are broadcast on /tf as frames `icosahedron_K` in `frame_id`, at '
        '`publish_rate`: a group; empty: none. A node needs the package tf2_msgs for them',
        FIXED,
    ),
    _s(
        'publish.connectors',
        '',
        '',
        'connectors in `~/tensions`: two group names, as in `connector_groups.NAME.between`, for '
        'those that lead from one to the other (`all` is any body); empty: all connectors',
        FIXED,
    ),
    _s('publish_clock', True, '', 'publish /clock', FIXED),
    _s(
        'frame_id',
        'world',
        '',
        'frame of all that is published: no leading /, not the frame of a body, and not empty '
        'where `tf.group` is set',
        FIXED,
    ),
    _s('start_paused', False, '', 'start in pause', FIXED),
    _s('reset_time', False, '', 'a reset also sets the time to 0', AT_ONCE),
    _s(
        'step_count',
        1,
        '',
        'solver steps for each call of ~/step',
        AT_ONCE,
        minimum=1,
        maximum=10**6,
    ),
    _s(
        'advance_duration',
        0.01,
        's',
        'simulated time of each call of ~/advance, in whole nanoseconds',
        AT_ONCE,
        minimum=1e-9,
        maximum=_LONGEST,
    ),
    _s(
        'input_horizon',
        1.0,
        's',
        'how far ahead of simulated time a stamp counts',
        AT_ONCE,
        minimum=0.0,
        maximum=_LONGEST,
    ),
    _s(
        'input_reliability',
        'reliable',
        '',
        'of the subscriptions for wrenches and twists; best_effort also hears best effort '
        'publishers, and what is lost on the way is not sent again',
        FIXED,
        choices=('reliable', 'best_effort'),
    ),
    _s(
        'checkpoint.path',
        '',
        '',
        'folder of checkpoints, which are numbered, or one file NAME.checkpoint that always holds '
        "the last one; '': the folder PATH_checkpoints beside the bag PATH",
        AT_ONCE,
    ),
    _s(
        'record.path',
        '',
        '',
        'folder of the bag, followed by PATH_1 and so on each time that recording is switched on; '
        "'': nothing is recorded. Like all of record.*, a change acts on the next bag",
        AT_ONCE,
    ),
    _s(
        'record.storage',
        'mcap',
        '',
        'storage of the bag',
        AT_ONCE,
        choices=('mcap', 'sqlite3'),
    ),
    _s(
        'record.split_size',
        0,
        '',
        'bytes in a file after which the bag goes on in the next; 0: never',
        AT_ONCE,
        minimum=0,
        maximum=10**15,
        smallest=1024,
    ),
    _s(
        'record.split_duration',
        0.0,
        's',
        'simulated time in a file after which the bag goes on in the next; 0: never',
        AT_ONCE,
        minimum=0.0,
        maximum=_LONGEST,
        smallest=1e-3,
    ),
    _s(
        'record.compression',
        'none',
        '',
        'none, or zstd: chunks of mcap, messages of sqlite3',
        AT_ONCE,
        choices=('none', 'zstd'),
    ),
    _s(
        'record.measured',
        False,
        '',
        'record `~/reactions`, `~/tensions` and `~/contacts` too, from the next bag on',
        AT_ONCE,
    ),
)

_PROFILE = (
    _s(
        'profile',
        'steady',
        '',
        'factor in time: steady, ramp (0 to 1, then held), half_sine (a pulse), sine F (of F Hz, '
        'from 0), or table FILE, a CSV of time [s] and factor, straight in between, the last '
        'one held',
    ),
    _s('start', 0.0, 's', 'when it begins, after the motion began', minimum=0.0, maximum=_LONGEST),
    _s(
        'duration',
        0.0,
        's',
        'of the ramp or the pulse; how long a steady load or a sine acts, 0: for ever',
        minimum=0.0,
        maximum=_LONGEST,
    ),
)

# Families: FAMILY.NAME.FIELD, any number of NAMEs. An empty field is FAMILY.NAME itself.
FAMILIES: dict[str, tuple[Specification, ...]] = {
    'groups': (
        _s(
            '',
            '',
            '',
            'selector of bodies: x_min, z_max, ..., level K, row K, column K, ids K K, '
            'box x0 y0 z0 x1 y1 z1, all; joined by and, or, not. A change of the group of a drive '
            f'{RESTARTS.value}',
            required=True,
        ),
    ),
    'connector_groups': (
        _s('between', '', '', 'two groups, whose bodies the connectors join; '
           "'': any bodies, with a direction"),
        _s('direction', '', '', 'the two opposite edges that they join: up down, north south or '
           "west east, a third of the connectors each; '': any"),
        _s('stiffness', -1.0, 'N/m', 'k in both directions; negative: as for all'),
        _s('stiffness_extension', -1.0, 'N/m', 'k_e; negative: stiffness'),
        _s('stiffness_compression', -1.0, 'N/m', 'k_c; negative: stiffness'),
        _s('natural_length', 0.0, 'm', 'D; 0: as for all', minimum=0.0),
        _s('law', '', '', "CSV of length [m], force [N]; '': as for all"),
        _s('law_beyond', '', '', "extrapolate or stop beyond it; '': as for all",
           choices=('', 'extrapolate', 'stop')),
        _s('bending_stiffness', -1.0, 'N m/rad', 'kappa_b; negative: as for all'),
        _s('twisting_stiffness', -1.0, 'N m/rad', 'kappa_t; negative: as for all'),
        _s('damping', -1.0, 'N s/m', 'damping along the connectors; negative: as for all'),
        _s('maxwell_stiffness', -1.0, 'N/m', 'k_1 of a Maxwell arm; negative: as for all'),
        _s('maxwell_time', -1.0, 's', 'tau of that arm; negative: as for all'),
        _s('break_length_extension', -1.0, 'm',
           'length L_e above D; 0: never breaks; negative: as for all'),
        _s('break_length_compression', -1.0, 'm',
           'length L_c below D; 0: never breaks; negative: as for all'),
    ),
    'masses': (
        _s('group', '', '', 'group of bodies with a mass, an inertia or a shell of their own',
           RESTARTS, required=True),
        _s('edge_length', 0.0, 'm',
           "outer edge 2a of the shell of each; 0: the shell's; connectors stay where they are "
           'attached', RESTARTS, minimum=0.0),
        _s('mass', 0.0, 'kg', "of each; 0: the shell's, which grows with the cube of the edge",
           RESTARTS, minimum=0.0),
        _s('inertia', 0.0, 'kg m^2',
           'of each; 0: in proportion to the mass and to the square of the edge', RESTARTS,
           minimum=0.0),
        _s('principal_inertia', _ZERO3, 'kg m^2',
           'of each, about the body axes x, y, z, where it is not isotropic; zeros: inertia',
           RESTARTS),
    ),
    'charges': (
        _s('group', '', '', 'group of bodies with a charge and a dipole of their own',
           required=True),
        _s('charge', 0.0, 'C', 'of each of them, instead of charge.per_body'),
        _s('dipole', _ZERO3, 'C m', 'of each, body frame, instead of charge.dipole'),
    ),
    'supports': (
        _s('group', '', '', 'group that is held', required=True),
        _s('fix', 'all', '', 'held freedoms: tx ty tz rotation, or all'),
    ),
    'loads': (
        _s('group', '', '', 'group that the wrench acts on', required=True),
        _s('frame', 'world', '', 'axes of the wrench', choices=('world', 'body')),
        _s('point', _ZERO3, 'm', 'point of application in body axes, from the centre'),
        _s('hold', 0.0, 's', 'how long a wrench is held; 0: until replaced', minimum=0.0),
        _s(
            'share',
            'each',
            '',
            'every body gets the wrench, or its n-th part',
            choices=('each', 'total'),
        ),
        _s('force', _ZERO3, 'N', 'force of the scene itself'),
        _s('torque', _ZERO3, 'N m', 'torque of the scene itself'),
        *_PROFILE,
    ),
    'tractions': (
        _s('group', '', '', 'group that the surface forces act on', required=True),
        _s(
            'faces',
            'exterior',
            '',
            'selector of faces: numbers K K ... (1 to 20), toward X Y Z, within ANGLE X Y Z, '
            'exterior, all; joined by and, or, not',
        ),
        _s('pressure', 0.0, 'Pa', 'against the outward normal'),
        _s(
            'shear',
            [0.0, 0.0],
            'Pa',
            "along the face's first side, from its first corner to its second, and across "
            '(normal x that side)',
        ),
        _s(
            'variation',
            '',
            '',
            'coefficients of 1, l2, l3, l2^2, l2 l3, l3^2, ...: a polynomial in the face '
            "coordinates (eq 35) that multiplies pressure and shear; '': 1",
        ),
        _s(
            'direction',
            'follower',
            '',
            'turns with the body, or keeps the world direction that it has as woven',
            choices=('follower', 'fixed'),
        ),
        _s('frictionless', False, '', 'only the part along the normal of a face acts'),
        *_PROFILE,
    ),
    'drives': (
        _s('group', '', '', 'group that moves as one rigid body', RESTARTS, required=True),
        _s('freedoms', 'all', '', 'what the path moves: tx ty tz rotation, or all; what it does '
           'not move stays free', RESTARTS),
        _s(
            'motion',
            'hold',
            '',
            'hold; velocity: one twist; ramp: from rest to it; sine: amplitudes; table: a file',
            RESTARTS,
            choices=('hold', 'velocity', 'ramp', 'sine', 'table'),
        ),
        _s(
            'linear',
            _ZERO3,
            'm/s',
            'velocity of the middle of the group, world axes; of sine the amplitude [m]',
            RESTARTS,
        ),
        _s(
            'angular',
            _ZERO3,
            'rad/s',
            'spin about it; of sine the amplitude of the rotation vector [rad]',
            RESTARTS,
        ),
        _s(
            'start',
            0.0,
            's',
            'when it begins, after the motion began',
            RESTARTS,
            minimum=0.0,
            maximum=_LONGEST,
        ),
        _s(
            'duration',
            0.0,
            's',
            'of the rise of a ramp; else how long it moves, 0: for ever',
            RESTARTS,
            minimum=0.0,
            maximum=_LONGEST,
        ),
        _s('frequency', 0.0, 'Hz', 'of sine', RESTARTS, minimum=0.0),
        _s(
            'phase',
            0.0,
            'rad',
            'of sine, which moves by sin(2 pi f t + phase) - sin(phase)',
            RESTARTS,
        ),
        _s(
            'file',
            '',
            '',
            'of table: CSV of time [s], displacement x, y, z [m] and, if it turns, rotation '
            'vector x, y, z [rad]; a smooth curve through them that begins and ends at rest',
            RESTARTS,
        ),
    ),
    'planes': (
        _s('normal', _ZERO3, '', 'of a rigid plane, towards its free side', required=True),
        _s('offset', 0.0, 'm', 'the free side is normal . x >= offset'),
    ),
    'anchors': (
        _s('body', 0, '', 'number of the body', minimum=0),
        _s(
            'edge',
            'up',
            '',
            'its edge that the connector begins at',
            choices=('up', 'down', 'north', 'south', 'west', 'east'),
        ),
        _s('position', _ZERO3, 'm', 'point of the world where it ends', required=True),
        _s('velocity', _ZERO3, 'm/s', 'velocity of that point, from the start of the motion'),
        _s(
            'file',
            '',
            '',
            'CSV of time [s] and displacement x, y, z [m] of that point; a smooth curve through '
            'them that begins and ends at rest',
        ),
        _s('stiffness', -1.0, 'N/m', 'k in both directions; negative: as of connectors'),
        _s('stiffness_extension', -1.0, 'N/m', 'k_e; negative: stiffness'),
        _s('stiffness_compression', -1.0, 'N/m', 'k_c; negative: stiffness; 0: a rope'),
        _s('natural_length', 0.0, 'm', 'D; 0: as of connectors', minimum=0.0),
        _s('break_length_extension', 0.0, 'm', 'length L_e above D; 0: never breaks', minimum=0.0),
        _s('break_length_compression', 0.0, 'm', 'length L_c below D; 0: never breaks',
           minimum=0.0),
    ),
    'initial': (
        _s('group', '', '', 'group that starts away from rest', required=True),
        _s('displacement', _ZERO3, 'm', 'added to the woven positions'),
        _s('rotation', _ZERO3, 'rad', 'rotation vector, about each centre, world axes'),
        _s('linear_velocity', _ZERO3, 'm/s', 'added velocity'),
        _s('angular_velocity', _ZERO3, 'rad/s', 'added spin'),
        _s(
            'file',
            '',
            '',
            'CSV whose first line names its columns, as snapshot.to_csv writes them: body, then '
            'x_m y_m z_m, qx qy qz qw, vx_m_s vy_m_s vz_m_s, wx_rad_s wy_rad_s wz_rad_s or '
            'wx_body_rad_s wy_body_rad_s wz_body_rad_s, all or some of these sets; it replaces '
            'what is woven, before the values above are added',
        ),
    ),
    'bodies': (
        _s('position', _ZERO3, 'm', 'centre of a loose body', RESTARTS, required=True),
        _s('orientation', [0.0, 0.0, 0.0, 1.0], '', 'quaternion x y z w, body to world', RESTARTS),
        _s('linear_velocity', _ZERO3, 'm/s', 'velocity', RESTARTS),
        _s('angular_velocity', _ZERO3, 'rad/s', 'spin', RESTARTS),
        _s('edge_length', 0.0, 'm',
           "outer edge 2a of a shell of another size; 0: the shell's", RESTARTS, minimum=0.0),
        _s('mass', 0.0, 'kg', "0: the shell's, which grows with the cube of the edge", RESTARTS,
           minimum=0.0),
        _s('inertia', 0.0, 'kg m^2',
           '0: in proportion to the mass and to the square of the edge', RESTARTS, minimum=0.0),
        _s('principal_inertia', _ZERO3, 'kg m^2',
           'about the body axes x, y, z, where it is not isotropic; zeros: inertia', RESTARTS),
    ),
}

BY_NAME: dict[str, Specification] = {entry.name: entry for entry in STATIC}
