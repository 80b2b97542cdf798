# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Two shells, or a shell and a plane: how far apart, and how they push each other.

    from icofabric_sim import contact
    push = contact.push(half_edge, (position, orientation), (position, orientation), 1e4)

Poses are centres [m] (3,) and unit quaternions x, y, z, w (4,); or (n, 3) and (n, 4), for n pairs
at once and results with n rows. Either pose may stand for all of them. The law is in
docs/contact.md.
"""

import math
from typing import Any, NamedTuple

import numpy as np

Pose = tuple[Any, Any]


class Separation(NamedTuple):
    """
    How far two shells are apart.
    """

    distance: Any  # [m], (n,); negative: the least shift that would part them
    axis: np.ndarray  # along which, from the first to the second, (n, 3)


class Push(NamedTuple):
    """
    What contact does to two shells, or to a shell and a plane; 0 where they do not touch.
    """

    touching: Any  # bool, (n,)
    force: np.ndarray  # on the first [N], (n, 3); the second, or the plane, feels the opposite
    torque: np.ndarray  # on the first about its centre [N m], (n, 3)
    torque_on_second: np.ndarray  # about its own centre [N m], (n, 3); 0 of a plane
    energy: Any  # stiffness times the square of the depth over 2 [J], (n,)
    depth: Any  # delta, four times the mean depth of the overlap [m], (n,)


def separation(half_edge: float, first: Pose, second: Pose) -> Separation:
    """
    Distance of two shells of half edge a [m], to rounding; minus their depth where they overlap.

    The depth is the least shift that parts them. Looks at every feature of both.
    """
    from icofabric_sim.kernels.contact_many import signed_distances

    _check_positive('half_edge', half_edge, 'm')
    (xa, ra), (xb, rb), single = _poses(first, second)
    distance, axis = np.zeros(len(xa)), np.zeros((len(xa), 3))
    signed_distances(float(half_edge), xa, ra, xb, rb, distance, axis)
    return Separation(*_rows(single, distance, axis))


def push(half_edge: float, first: Pose, second: Pose, stiffness: float) -> Push:
    """
    How two shells of half edge a [m] push each other, for a contact stiffness [N/m].
    """
    from icofabric_sim.kernels.contact_many import touch_pairs
    from icofabric_sim.kernels.contact_pair import contact_scratch, OUT_SIZE

    _check_positive('half_edge', half_edge, 'm')
    _check_positive('stiffness', stiffness, 'N/m')
    (xa, ra), (xb, rb), single = _poses(first, second)
    touching, out = np.zeros(len(xa), bool), np.zeros((len(xa), OUT_SIZE))
    touch_pairs(float(half_edge), xa, ra, xb, rb, contact_scratch(), touching, out)
    return _push(single, touching, out, stiffness)


def push_of_plane(
    half_edge: float, normal: Any, offset: float, pose: Pose, stiffness: float
) -> Push:
    """
    How a rigid plane pushes a shell; its free side is normal . x >= offset [m].
    """
    from icofabric_sim.kernels.contact_many import touch_planes
    from icofabric_sim.kernels.contact_pair import contact_scratch, OUT_SIZE

    _check_positive('half_edge', half_edge, 'm')
    _check_positive('stiffness', stiffness, 'N/m')
    up = np.array(normal, dtype=np.float64)
    length = np.linalg.norm(up)
    if up.shape != (3,) or not 0.0 < length < math.inf:
        raise ValueError(f'normal must be three numbers, not all 0, got {normal!r}')
    if not math.isfinite(offset):
        raise ValueError(f'offset must be finite, got {offset!r} m')
    (x, r), _, single = _poses(pose, pose)
    touching, out = np.zeros(len(x), bool), np.zeros((len(x), OUT_SIZE))
    touch_planes(float(half_edge), up / length, float(offset) / length, x, r, contact_scratch(),
                 touching, out)
    return _push(single, touching, out, stiffness)


def restitution(damping: float, speed: float) -> float:
    """
    Speed after over speed before of a damped collision in which one point touches.

    `damping` c [s/m] as in kernels/contact_laws.py, `speed` the rate of delta at first touch
    [m/s]. It depends on u = c speed only: u - ln(1 + u) = -e u - ln(1 - e u).
    """
    from scipy.optimize import brentq

    if not 0.0 <= damping < math.inf:
        raise ValueError(f'damping must be 0 or positive and finite, got {damping!r} s/m')
    _check_positive('speed', speed, 'm/s')
    u = damping * speed
    if u < 1e-4:
        # Here the equation loses its digits; the next term is below 1e-12.
        return 1.0 - 2.0 * u / 3.0 + 4.0 * u * u / 9.0
    whole = u - math.log1p(u)
    # With z = -ln(1 - e u) there are no bounds to come near to.
    z: float = brentq(lambda z: math.expm1(-z) + z - whole, 0.0, whole + 1.0, xtol=1e-16)
    return -math.expm1(-z) / u


def damping_for(wanted: float, speed: float) -> float:
    """
    The damping c [s/m] with which a collision at this rate of delta [m/s] has a restitution.
    """
    from scipy.optimize import brentq

    if not 0.0 < wanted <= 1.0:
        raise ValueError(f'restitution must be above 0 and at most 1, got {wanted!r}')
    _check_positive('speed', speed, 'm/s')
    if wanted == 1.0:
        return 0.0
    highest = 1.0
    while restitution(highest, 1.0) > wanted:
        highest *= 2.0
    result: float = brentq(lambda u: restitution(u, 1.0) - wanted, 0.0, highest, xtol=1e-14)
    return result / speed


def _push(single: bool, touching: np.ndarray, out: np.ndarray, stiffness: float) -> Push:
    forces = stiffness * out[:, :10]
    return Push(*_rows(single, touching, forces[:, 0:3], forces[:, 3:6], forces[:, 6:9],
                       forces[:, 9], out[:, 10]))


def _rows(single: bool, *arrays: np.ndarray) -> list[Any]:
    return [array[0] for array in arrays] if single else list(arrays)


def _poses(
    first: Pose, second: Pose
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray], bool]:
    """
    Places (n, 3) and matrices (n, 3, 3) of both, and whether all was given for one pair.
    """
    given = []
    for name, pose in (('first', first), ('second', second)):
        place, orientation = (np.array(part, dtype=np.float64) for part in pose)
        if place.shape[-1:] != (3,) or place.ndim > 2 or not np.isfinite(place).all():
            raise ValueError(f'the centre of the {name} must be (3,) or (n, 3) finite numbers [m]')
        norm = np.linalg.norm(orientation, axis=-1)
        if orientation.shape[-1:] != (4,) or orientation.ndim > 2 or not (
                np.abs(norm - 1.0) < 1e-3).all():
            raise ValueError(
                f'the orientation of the {name} must be (4,) or (n, 4): unit quaternions '
                'x, y, z, w')
        given += [place, _matrices(orientation / norm[..., None])]
    single = given[0].ndim == given[2].ndim == 1 and given[1].ndim == given[3].ndim == 2
    try:
        (count,) = np.broadcast_shapes(
            *((1,) if part.ndim == ndim else part.shape[:1]
              for part, ndim in zip(given, (1, 2, 1, 2))))
    except ValueError:
        raise ValueError('both poses must have the same number of rows, or one') from None
    whole = [np.ascontiguousarray(np.broadcast_to(part, (count, *part.shape[-ndim:])))
             for part, ndim in zip(given, (1, 2, 1, 2))]
    return (whole[0], whole[1]), (whole[2], whole[3]), single


def _matrices(orientation: np.ndarray) -> np.ndarray:
    """
    Matrices (..., 3, 3) from body to world axes of unit quaternions x, y, z, w (..., 4).
    """
    x, y, z, w = np.moveaxis(orientation, -1, 0)
    rows = np.array([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)]])
    return np.moveaxis(rows, (0, 1), (-2, -1))


def _check_positive(name: str, value: float, unit: str) -> None:
    if not 0.0 < value < math.inf:
        raise ValueError(f'{name} must be positive and finite, got {value!r} {unit}')
