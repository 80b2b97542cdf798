# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Drives: groups of bodies that follow a prescribed path as one rigid body, in some or all freedoms.

A path is a displacement of the group's centroid (the mean of its centres at the start) and a
rotation vector about the centroid, in world axes, from the start of the motion. Bodies rest at
their initial positions before `.start`, and stay where a motion ends. Contradictory drives are
refused when the scene is built.
"""

from collections.abc import Mapping
import math
from typing import Any, NamedTuple

from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.scene.paths import Path, PathPiece, require_followed, require_resolved
from icofabric_sim.scene.supports import FREEDOMS, named_freedoms, Supports
from icofabric_sim.scene.tables import read_numeric_table
import numpy as np

# Relative tolerance within which velocities and positions count as equal.
_EQUAL_RATIO = 1e-9
_ZERO6 = (0.0,) * 6
_TABLES = 'table', 'velocity_table'


class Drive(NamedTuple):
    """One drive, `drives.NAME`."""

    bodies: np.ndarray  # (m,) int32
    middle: np.ndarray  # (3,) [m] centroid of their centres at the start
    path: Path
    moves: np.ndarray  # (4,) bool: prescribed x, y, z and rotation; the others stay free

    @property
    def freedoms(self) -> np.ndarray:
        """Mask (6,) of the degrees of freedom that the drive prescribes."""
        return np.append(self.moves[:3], np.repeat(self.moves[3], 3))


def make_drives(
    parameters: Parameters, groups: Mapping[str, np.ndarray], state: InitialState,
    supports: Supports | None,
) -> dict[str, Drive]:
    """
    Return all `drives.NAME`, and set the velocities of their bodies in `state`.

    Raises ParameterError if a drive contradicts supports, other drives or the initial state.
    """
    drives: dict[str, Drive] = {}
    for name in parameters.names('drives'):
        bodies = groups[parameters[f'drives.{name}.group']]
        key = f'drives.{name}.group'
        moves = moved_freedoms(parameters, name)
        for other, drive in drives.items():
            _refuse_shared_freedoms(key, bodies, moves, other, drive)
        if supports is not None:
            held = np.column_stack([supports.translation[bodies], supports.rotation[bodies]])
            twice = (held & moves).any(axis=1)
            if twice.any():
                raise ParameterError(
                    key, f'{key}: body {int(bodies[np.argmax(twice)])} is held by a support, '
                    f'which fixes a degree of freedom that the drive moves; take the body out of '
                    f'one of the groups, or name other freedoms in drives.{name}.freedoms')
        path = make_path(parameters, f'drives.{name}')
        middle = state.position[bodies].mean(axis=0)
        drive = Drive(bodies, middle, path, moves)
        _set_initial_velocities(parameters, groups, name, drive, state)
        drives[name] = drive
        _refuse_turned_faces(parameters, groups, name, drive)
    return drives


def _refuse_turned_faces(
    parameters: Parameters, groups: Mapping[str, np.ndarray], name: str, drive: Drive
) -> None:
    """Refuse surface forces on bodies whose rotation is driven and whose translation is free."""
    if not drive.moves[3] or drive.moves.all():
        return
    for key in (
            f'{family}.{other}.group' for family in ('tractions', 'line_loads')
            for other in parameters.names(family)):
        both = np.intersect1d(groups[parameters[key]], drive.bodies)
        if len(both):
            raise ParameterError(
                key, f'{key}: drives.{name} rotates body {int(both[0])} and leaves its '
                'translation free; surface forces do not support this; take the body out of one '
                'of the groups, let the drive move all freedoms, or give loads.NAME instead')


def moved_freedoms(parameters: Parameters, name: str) -> np.ndarray:
    """Return the mask (4,) of tx, ty, tz, rotation that `drives.NAME.freedoms` names."""
    key = f'drives.{name}.freedoms'
    words = named_freedoms(key, parameters[key])
    moves = np.array([word in words for word in FREEDOMS])
    for field, mine in (('linear', moves[:3]), ('angular', np.repeat(moves[3], 3))):
        amounts = np.array(parameters[f'drives.{name}.{field}'])
        if (amounts[~mine] != 0.0).any():
            raise ParameterError(
                f'drives.{name}.{field}',
                f'drives.{name}.{field} {amounts.tolist()} moves a freedom that is not in {key} '
                f'{parameters[key]!r}; add it there, or set it to 0 here')
    return moves


def _refuse_shared_freedoms(
    key: str, bodies: np.ndarray, moves: np.ndarray, other: str, drive: Drive
) -> None:
    """Refuse two drives of the same freedom, and two drives that share some but not all bodies."""
    both = np.intersect1d(bodies, drive.bodies)
    if not len(both):
        return
    body = int(both[0])
    if (moves & drive.moves).any():
        raise ParameterError(
            key, f'{key}: body {body} is already moved by drives.{other}; take it out of one of '
            'the groups, or let them move different freedoms')
    if len(both) != len(bodies) or len(both) != len(drive.bodies):
        raise ParameterError(
            key, f'{key}: drives.{other} moves body {body} too, but not all bodies of this drive; '
            'drives that share bodies must have the same bodies, because displacements are those '
            'of their centroid')


def _set_initial_velocities(
    parameters: Parameters, groups: Mapping[str, np.ndarray], name: str, drive: Drive,
    state: InitialState
) -> None:
    """
    Set the initial velocities of the bodies to those of their path; refuse other given ones.

    Random initial velocities do not apply to driven bodies.
    """
    twist = drive.path.pieces[0].twist_at(0.0)
    arms = state.position[drive.bodies] - drive.middle
    paths = twist[:3] + np.cross(twist[3:], arms), np.broadcast_to(twist[3:], arms.shape)
    moved = drive.moves[:3], np.repeat(drive.moves[3], 3)
    loose = parameters.names('bodies')
    first = len(state.position) - len(loose)
    sources = [(f'initial.{source}', groups[parameters[f'initial.{source}.group']])
               for source in parameters.names('initial')]
    sources += [(f'bodies.{source}', np.array([first + k])) for k, source in enumerate(loose)]
    for field, wanted, mine in zip(('linear_velocity', 'angular_velocity'), paths, moved):
        given, told = np.zeros((len(state.position), 3)), ''
        for source, bodies in sources:
            value = parameters[f'{source}.{field}']
            if any(value) and np.isin(bodies, drive.bodies).any():
                given[bodies] += value
                told = f'{source}.{field}'
        given, wanted = given[drive.bodies] * mine, wanted * mine
        size = float(max(np.abs(given).max(), np.abs(wanted).max()))
        wrong = given.any(axis=1) & (np.abs(given - wanted).max(axis=1) > _EQUAL_RATIO * size)
        if wrong.any():
            row = int(np.argmax(wrong))
            raise ParameterError(
                told, f'{told} {parameters[told]} disagrees with drives.{name}, which moves body '
                f'{drive.bodies[row]} from the start with {wanted[row].tolist()}; leave it out, '
                'or take the body out of one of the groups')
        velocity = getattr(state, field)
        velocity[drive.bodies] = np.where(mine, wanted, velocity[drive.bodies])


def make_path(parameters: Parameters, prefix: str, *, turns: bool = True) -> Path:
    """
    Return the path that `prefix` (drives.NAME) describes, or raise ParameterError.

    Without `turns` there is no parameter `angular`.
    """
    def field(name: str) -> Any:
        return (0.0, 0.0, 0.0) if name == 'angular' and not turns else (
            parameters[f'{prefix}.{name}'])

    motion, start, duration = field('motion'), field('start'), field('duration')
    amounts = tuple(field('linear')) + tuple(field('angular'))

    def refuse(name: str, why: str) -> None:
        raise ParameterError(f'{prefix}.{name}', f'{prefix}.{name} {why}')

    _require_used(motion, field, refuse)
    end = start + duration
    if duration > 0.0 and not end > start:
        refuse('duration', f'{duration!r} s is below the round-off of the start {start!r} s; make '
                           'it longer')
    rest = PathPiece(0.0)
    if motion == 'hold':
        return Path((rest,))
    if motion == 'table':
        pieces = _table(prefix, field('file'), start, parameters, turns=turns)
    elif motion == 'velocity_table':
        pieces = _velocity_table(prefix, field('file'), start, parameters, turns=turns)
    elif motion == 'velocity':
        pieces = [PathPiece(start, (_ZERO6, amounts, _ZERO6, _ZERO6))]
        if duration > 0.0:
            pieces.append(_rest_piece(pieces[0], end))
    elif motion == 'ramp':
        rise = PathPiece(
            start, (_ZERO6, _ZERO6, tuple(0.5 * value / duration for value in amounts), _ZERO6))
        middle = tuple(0.5 * duration * value for value in amounts)
        pieces = [rise, PathPiece(end, (middle, amounts, _ZERO6, _ZERO6))]
    else:
        rate, phase = 2.0 * math.pi * field('frequency'), field('phase')
        if not math.isfinite(rate * max(1.0, *map(abs, amounts))):
            refuse('frequency', f'{field("frequency")!r} Hz makes velocities overflow; lower it')
        offset = tuple(-value * math.sin(phase) for value in amounts)
        pieces = [PathPiece(start, (offset, _ZERO6, _ZERO6, _ZERO6), amounts, rate, phase)]
        if start > 0.0 and abs(math.cos(phase)) > _EQUAL_RATIO:
            refuse(
                'phase', f'{phase!r} rad: the velocity would jump at the start, {start!r} s; '
                'begin at a turning point (phase -1.5707963267948966), or with the motion '
                '(start 0)')
        if duration > 0.0:
            last = rate * duration + phase
            if abs(math.cos(last)) > _EQUAL_RATIO * max(1.0, abs(last)):
                refuse(
                    'duration', f'{duration!r} s: the velocity would jump at the end; end at a '
                    'turning point, a whole number of half periods after the last one')
            pieces.append(_rest_piece(pieces[0], end))
    if pieces[0].start > 0.0:
        pieces.insert(0, rest)
    return Path(tuple(pieces))


def _require_used(motion: str, field: Any, refuse: Any) -> None:
    """Refuse missing fields that a motion needs, and given fields that the motion ignores."""
    moves = any(field('linear')) or any(field('angular'))
    if motion in ('hold', *_TABLES) and moves:
        name = 'linear' if any(field('linear')) else 'angular'
        refuse(name, f'must be zero for the motion {motion}, got {field(name)}')
    if motion == 'ramp' and not field('duration') > 0.0:
        refuse('duration', 'must be above 0 s for the motion ramp: the time in which the '
                           'velocity rises')
    if motion == 'sine' and not field('frequency') > 0.0:
        refuse('frequency', 'must be above 0 Hz for the motion sine')
    if motion != 'sine' and field('frequency') > 0.0:
        refuse('frequency', f'must be 0 Hz for the motion {motion}: only sine has a frequency')
    if (motion in _TABLES) != bool(field('file').strip()):
        refuse('file', f'must {"name a CSV file" if motion in _TABLES else "be empty"} for the '
                       f'motion {motion}, got {field("file")!r}')
    if motion in ('hold', *_TABLES) and field('duration') > 0.0:
        refuse('duration', f'must be 0 s for the motion {motion}, got {field("duration")!r} s')


def _rest_piece(piece: PathPiece, end: float) -> PathPiece:
    return PathPiece(end, (tuple(piece.at(end).tolist()), _ZERO6, _ZERO6, _ZERO6))


def _table(
    prefix: str, file: str, start: float, parameters: Parameters, *, turns: bool
) -> list[PathPiece]:
    """
    Return the pieces of a clamped cubic spline through a table.

    Position, velocity and acceleration are continuous; the spline starts and ends at rest.
    """
    # A slow import, needed only by scenes with tables.
    from scipy.interpolate import CubicSpline

    name = f'{prefix}.file'
    times, values = _read_table(
        name, file, start, 'displacement x, y, z [m]',
        'rotation vector x, y, z [rad]' if turns else '')
    if np.abs(values[0]).max() > _EQUAL_RATIO * np.abs(values).max():
        raise ParameterError(
            name, f'{name}: {file} begins with the displacement {values[0].tolist()}, but the '
            'motion starts at the initial position: make the first line zero')
    with np.errstate(over='ignore', invalid='ignore'):
        spline = CubicSpline(times, values, bc_type='clamped')
    if not np.isfinite(spline.c).all():
        raise ParameterError(name, f'{name}: {file} has displacements too large for a smooth path')
    require_followed(name, file, spline, parameters)
    pieces = []
    for k, time in enumerate(times[:-1].tolist()):
        cubic = tuple(tuple(row) for row in spline.c[::-1, k].tolist())
        pieces.append(PathPiece(time, cubic))
    last = tuple(values[-1].tolist())
    return [*pieces, PathPiece(float(times[-1]), (last, _ZERO6, _ZERO6, _ZERO6))]


def _read_table(
    name: str, file: str, start: float, places: str, turns: str
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return times [s] and values (m, 6) of a table of `places` and, unless '', optionally `turns`.
    """
    columns = {4: f'time [s] and {places}'}
    if turns:
        columns[7] = f'time [s], {places} and {turns}'
    table = read_numeric_table(name, file, columns)
    values = np.zeros((len(table), 6))
    values[:, :table.shape[1] - 1] = table[:, 1:]
    times = start + table[:, 0]
    if not (np.diff(times) > 0.0).all():
        raise ParameterError(
            name, f'{name}: steps of time in {file} are below the round-off of the start '
            f'{start!r} s')
    return times, values


def _velocity_table(
    prefix: str, file: str, start: float, parameters: Parameters, *, turns: bool
) -> list[PathPiece]:
    """
    Return the pieces of a path whose velocity is linear between the rows of a table.

    The last velocity continues. A rotation vector is the integral of the angular velocity only
    about a fixed axis.
    """
    name = f'{prefix}.file'
    times, values = _read_table(
        name, file, start, 'velocity x, y, z [m/s]',
        'angular velocity x, y, z [rad/s]' if turns else '')
    spins = values[:, 3:]
    largest = spins[np.argmax(np.linalg.norm(spins, axis=1))]
    if np.linalg.norm(np.cross(spins, largest), axis=1).max() > _EQUAL_RATIO * largest @ largest:
        raise ParameterError(
            name, f'{name}: the angular velocities in {file} have several axes; give one axis, or '
            'rotation vectors by the motion table')
    require_resolved(name, file, values, parameters)
    pieces, place = [], np.zeros(6)
    for time, before, after, length in zip(times, values, values[1:], np.diff(times)):
        half = 0.5 * (after - before) / length
        pieces.append(PathPiece(
            float(time), (*(tuple(row.tolist()) for row in (place, before, half)), _ZERO6)))
        place = place + length * (before + length * half)
    last = tuple(place.tolist()), tuple(values[-1].tolist())
    return [*pieces, PathPiece(float(times[-1]), (*last, _ZERO6, _ZERO6))]
