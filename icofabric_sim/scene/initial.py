# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Initial state: the woven rest state plus the displacements and velocities of the scene."""

from collections.abc import Mapping
import math
from typing import NamedTuple

from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.rates import MAX_RATE_PER_S
from icofabric_sim.scene.supports import Supports
from icofabric_sim.scene.tables import BodyTable, read_named_table
import numpy as np

# Column sets of `initial.NAME.file`; the last one is in body axes.
_PLACE, _TURN = ('x_m', 'y_m', 'z_m'), ('qx', 'qy', 'qz', 'qw')
_VELOCITY, _SPIN = ('vx_m_s', 'vy_m_s', 'vz_m_s'), ('wx_rad_s', 'wy_rad_s', 'wz_rad_s')
_BODY_SPIN = ('wx_body_rad_s', 'wy_body_rad_s', 'wz_body_rad_s')
# Spins in both axes may differ by this ratio, as a table with few digits has them.
_SPIN_RATIO = 1e-2


class InitialState(NamedTuple):
    """Initial state of all bodies (eqs 14, 25 and 46), world frame."""

    position: np.ndarray  # (n, 3) [m]
    orientation: np.ndarray  # (n, 4) x y z w
    linear_velocity: np.ndarray  # (n, 3) [m/s]
    angular_velocity: np.ndarray  # (n, 3) [rad/s]


def unit_quaternion(name: str, parameters: Parameters) -> np.ndarray:
    """
    Return the quaternion parameter `name`, scaled to unit length.

    Raises ParameterError if its length differs from 1 by more than 1e-3.
    """
    quaternion = np.array(parameters[name])
    length = float(np.linalg.norm(quaternion))
    if not abs(length - 1.0) <= 1e-3:
        raise ParameterError(
            name,
            f'{name} must be a unit quaternion x y z w, got {parameters[name]} of length '
            f'{length:.6g}',
        )
    return quaternion / length


def rotate_by_vector(rotation: np.ndarray, orientation: np.ndarray) -> np.ndarray:
    """
    Return quaternions (n, 4) rotated by a rotation vector [rad], world axes.

    The result is exp(rotation / 2) q, where exp(rotation / 2) is the quaternion of eq 21.
    """
    angle = math.hypot(*rotation)
    vector = np.sinc(angle / (2.0 * np.pi)) * 0.5 * rotation
    scalar = np.cos(0.5 * angle)
    v, w = orientation[:, :3], orientation[:, 3:]
    turned = np.hstack(
        [scalar * v + w * vector + np.cross(vector, v), scalar * w - v @ vector[:, None]]
    )
    return turned / np.linalg.norm(turned, axis=1, keepdims=True)


def make_initial_state(
    parameters: Parameters,
    position: np.ndarray,
    orientation: np.ndarray,
    groups: Mapping[str, np.ndarray],
    supports: Supports | None,
) -> InitialState:
    """
    Return the initial state from the woven `position` and `orientation`.

    Adds the velocities of loose bodies, every `initial.NAME` and the random start.
    """
    count = len(position)
    if parameters.names('initial'):
        # Otherwise rest and initial positions are equal and share memory.
        position, orientation = position.copy(), orientation.copy()
    state = InitialState(position, orientation, np.zeros((count, 3)), np.zeros((count, 3)))
    loose = parameters.names('bodies')
    for k, name in enumerate(loose, start=count - len(loose)):
        state.linear_velocity[k] = parameters[f'bodies.{name}.linear_velocity']
        state.angular_velocity[k] = parameters[f'bodies.{name}.angular_velocity']
        _refuse_held_motion(f'bodies.{name}', np.array([k]), state, supports)
    for name in parameters.names('initial'):
        bodies = groups[parameters[f'initial.{name}.group']]
        if parameters[f'initial.{name}.file']:
            _replace(state, f'initial.{name}.file', parameters, bodies, supports)
        state.position[bodies] += parameters[f'initial.{name}.displacement']
        rotation = np.array(parameters[f'initial.{name}.rotation'])
        if rotation.any():
            state.orientation[bodies] = rotate_by_vector(rotation, state.orientation[bodies])
        state.linear_velocity[bodies] += parameters[f'initial.{name}.linear_velocity']
        state.angular_velocity[bodies] += parameters[f'initial.{name}.angular_velocity']
        _refuse_held_motion(f'initial.{name}', bodies, state, supports)
    _add_random(parameters, state)
    return hold_still(state, supports)


def _replace(
    state: InitialState, name: str, parameters: Parameters, group: np.ndarray,
    supports: Supports | None
) -> None:
    """Set the state of bodies of a `group` from the table of the parameter `name`."""
    table = read_named_table(
        name, str(parameters[name]), (_PLACE, _TURN, _VELOCITY, _SPIN, _BODY_SPIN))
    bodies, values = table.bodies, table.values
    outside = np.setdiff1d(bodies, group)
    if len(outside):
        raise ParameterError(
            name, f'{name}: {parameters[name]} has body {outside[0]}, which is not in the group '
            f'{parameters[name.replace(".file", ".group")]}; choose a group that contains it')
    if _PLACE in values:
        state.position[bodies] = values[_PLACE]
    if _TURN in values:
        length = np.linalg.norm(values[_TURN], axis=1)
        if (wrong := ~(np.abs(length - 1.0) <= 1e-3)).any():
            row = int(np.flatnonzero(wrong)[0])
            raise ParameterError(
                name, f'{name}: {table.place(row, "qx qy qz qw")}, must be a unit quaternion, got '
                f'length {length[row]:.6g} for body {bodies[row]}')
        # Quaternions written by a snapshot stay bit-identical.
        length[np.abs(length - 1.0) <= 1e-14] = 1.0
        state.orientation[bodies] = values[_TURN] / length[:, None]
    _check_motion(name, table, parameters, supports)
    if _VELOCITY in values:
        state.linear_velocity[bodies] = values[_VELOCITY]
    if _BODY_SPIN in values:
        # Eq 18: body axes are the rows.
        state.angular_velocity[bodies] = spin = np.einsum(
            'bi,bij->bj', values[_BODY_SPIN], cosines_from_quaternions(state.orientation[bodies]))
    if _SPIN in values:
        state.angular_velocity[bodies] = values[_SPIN]
        if _BODY_SPIN in values:
            off = np.linalg.norm(values[_SPIN] - spin, axis=1)
            if (wrong := off > _SPIN_RATIO * np.linalg.norm(spin, axis=1)).any():
                raise ParameterError(
                    name, f'{name}: {parameters[name]} has two spins for body '
                    f'{bodies[np.flatnonzero(wrong)[0]]}: {" ".join(_SPIN)} and '
                    f'{" ".join(_BODY_SPIN)} disagree; leave one set out')


def _check_motion(
    name: str, table: BodyTable, parameters: Parameters, supports: Supports | None
) -> None:
    """Refuse velocities and spins of held bodies, and those that no time step can resolve."""
    largest = MAX_RATE_PER_S * 0.5 * parameters['shell.edge_length']
    for columns, unit, limit in (
            (_VELOCITY, 'm/s', largest), (_SPIN, 'rad/s', MAX_RATE_PER_S),
            (_BODY_SPIN, 'rad/s', MAX_RATE_PER_S)):
        if columns not in table.values:
            continue
        moves, held = table.values[columns], np.zeros(1, bool)
        if supports is not None:
            held = (supports.translation if columns is _VELOCITY
                    else supports.rotation[:, None])[table.bodies]
        for wrong, why in (
                (held & (moves != 0.0), 'a support holds the body in that freedom; set it to 0'),
                (np.abs(moves) > limit, f'time steps resolve {limit:g} {unit} at most')):
            if wrong.any():
                row, column = np.argwhere(wrong)[0]
                raise ParameterError(
                    name, f'{name}: {table.place(row, columns[column])}: '
                    f'{moves[row, column]:.6g} {unit} of body {table.bodies[row]}: {why}')


def hold_still(state: InitialState, supports: Supports | None) -> InitialState:
    """Set the velocities of fixed degrees of freedom to zero in place; return the state."""
    if supports is not None:
        state.linear_velocity[supports.translation] = 0.0
        state.angular_velocity[supports.rotation] = 0.0
    return state


def _refuse_held_motion(
    source: str, bodies: np.ndarray, state: InitialState, supports: Supports | None
) -> None:
    if supports is None:
        return
    for field, held, values in (
        ('linear_velocity', supports.translation, state.linear_velocity),
        ('angular_velocity', supports.rotation[:, None], state.angular_velocity),
    ):
        moving = (held[bodies] & (values[bodies] != 0.0)).any(axis=1)
        if moving.any():
            body = int(bodies[np.flatnonzero(moving)[0]])
            raise ParameterError(
                f'{source}.{field}',
                f'{source}.{field} moves body {body}, which a support holds in '
                'that freedom; take the body out of one of the groups',
            )


def _add_random(parameters: Parameters, state: InitialState) -> None:
    """
    Add normally distributed velocities and angular velocities, equal on every machine.

    NumPy guarantees the stream of MT19937 with the legacy normal generator. Rounding to single
    precision removes differences in the last bits of the platform's logarithm.
    """
    velocity_sigma = parameters['initial_random.velocity_sigma']
    spin_sigma = parameters['initial_random.spin_sigma']
    if velocity_sigma == 0.0 and spin_sigma == 0.0:
        return
    generator = np.random.RandomState(parameters['initial_random.seed'])
    # Both are always drawn, so that one sigma does not change the numbers of the other.
    normal = (
        generator.standard_normal((2, *state.linear_velocity.shape))
        .astype(np.float32)
        .astype(np.float64)
    )
    state.linear_velocity[:] += velocity_sigma * normal[0]
    state.angular_velocity[:] += spin_sigma * normal[1]
