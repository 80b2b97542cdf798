# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Distance and contact forces of two shells, or of a shell and a plane.

    from icofabric_sim import contact
    first, second = (position, orientation), (other_position, other_orientation)
    found = contact.contact_force(half_edge, first, second, stiffness=1e4)

Poses are centres [m] (3,) and unit quaternions x, y, z, w (4,); or (n, 3) and (n, 4) for n pairs,
which give results with n rows. A single pose is combined with all others. The law is in
docs/contact.md.
"""

import math
from typing import Any, NamedTuple, TYPE_CHECKING

from icofabric_sim import checks
from icofabric_sim.checks import renamed_attributes, renamed_text
import numpy as np

Pose = tuple[Any, Any]


class Separation(NamedTuple):
    """Distance of two shells."""

    distance: Any  # [m], (n,); negative: the smallest displacement that separates them
    axis: np.ndarray  # direction from the first to the second, (n, 3)


@renamed_attributes(touching='in_contact')
class ContactForce(NamedTuple):
    """Contact forces between two shells, or of a shell and a plane; 0 without contact."""

    in_contact: Any  # bool, (n,)
    force: np.ndarray  # on the first [N], (n, 3); opposite on the second, or on the plane
    torque: np.ndarray  # on the first about its centre [N m], (n, 3)
    torque_on_second: np.ndarray  # about its centre [N m], (n, 3); 0 for a plane
    energy: Any  # stiffness times depth squared over 2 [J], (n,)
    depth: Any  # delta, four times the mean depth of the overlap [m], (n,)


def separation(
    half_edge: float, first: Pose, second: Pose, *, other_edge: float | None = None
) -> Separation:
    """
    Return the distance of two shells up to round-off, or minus their depth if they overlap.

    The depth is the smallest displacement that separates them. All features of both are tested.

    Parameters
    ----------
    half_edge
        Half edge a [m] of both shells, or of the first.
    first, second
        Poses of the shells, as above.
    other_edge
        Half edge [m] of the second shell if different.

    Returns
    -------
    Separation
        Distances [m] and the directions in which they are measured.
    """
    from icofabric_sim.terms.contacts.many import signed_distances

    half_edge = checks.positive('half_edge', half_edge, 'm')
    (xa, ra), (xb, rb), single = _poses(first=first, second=second)
    distance, axis = np.zeros(len(xa)), np.zeros((len(xa), 3))
    signed_distances(_edges(half_edge, other_edge, len(xa)), xa, ra, xb, rb, distance, axis)
    return Separation(*_rows(single, distance, axis))


def contact_force(
    half_edge: float, first: Pose, second: Pose, stiffness: float, *,
    other_edge: float | None = None
) -> ContactForce:
    """
    Return the contact forces of two shells.

    Parameters
    ----------
    half_edge
        Half edge a [m] of both shells, or of the first.
    first, second
        Poses of the shells, as above.
    stiffness
        Contact stiffness [N/m].
    other_edge
        Half edge [m] of the second shell if different.

    Returns
    -------
    ContactForce
        Forces [N], torques [N m], energies [J] and depths [m].
    """
    from icofabric_sim.terms.contacts.many import touch_pairs
    from icofabric_sim.terms.contacts.pair import contact_scratch, OUT_SIZE

    half_edge = checks.positive('half_edge', half_edge, 'm')
    stiffness = checks.positive('stiffness', stiffness, 'N/m')
    (xa, ra), (xb, rb), single = _poses(first=first, second=second)
    touching, out = np.zeros(len(xa), bool), np.zeros((len(xa), OUT_SIZE))
    touch_pairs(
        _edges(half_edge, other_edge, len(xa)), xa, ra, xb, rb, contact_scratch(), touching, out)
    return _contact_force(single, touching, out, stiffness)


def plane_contact_force(
    half_edge: float, normal: Any, offset: float, pose: Pose, stiffness: float
) -> ContactForce:
    """
    Return the contact forces of a rigid plane on a shell.

    Parameters
    ----------
    half_edge
        Half edge a [m] of the shell.
    normal, offset
        Normal (3,) of any length and offset: the free side is normal . x >= offset, x in [m].
    pose
        Pose of the shell, as above.
    stiffness
        Contact stiffness [N/m].

    Returns
    -------
    ContactForce
        Forces [N], torques [N m], energies [J] and depths [m] of the shell.
    """
    from icofabric_sim.terms.contacts.many import touch_planes
    from icofabric_sim.terms.contacts.pair import contact_scratch, OUT_SIZE

    half_edge = checks.positive('half_edge', half_edge, 'm')
    stiffness = checks.positive('stiffness', stiffness, 'N/m')
    up = checks.array('normal', normal, (3,))
    length = math.hypot(*up)
    if not 0.0 < length < math.inf:
        raise ValueError(f'normal must be three numbers, not all 0, got {checks.shown(normal)}')
    offset = checks.number('offset', offset, unit='m')
    (x, r), _, single = _poses(pose=pose)
    touching, out = np.zeros(len(x), bool), np.zeros((len(x), OUT_SIZE))
    touch_planes(
        _edges(half_edge, None, len(x)), up / length, offset / length, x, r, contact_scratch(),
        touching, out)
    return _contact_force(single, touching, out, stiffness)


def _edges(half_edge: float, other: float | None, count: int) -> np.ndarray:
    """Return the half edges [m] of both shells of `count` pairs, (n, 2)."""
    second = half_edge if other is None else checks.positive('other_edge', other, 'm')
    return np.tile([float(half_edge), float(second)], (count, 1))


def restitution(damping: float, speed: float) -> float:
    """
    Return the ratio of speeds after and before a damped collision at a single point.

    Parameters
    ----------
    damping
        c [s/m] as in terms/contacts/laws.py; 0 has the restitution 1.
    speed
        Rate of delta at first touch [m/s].

    Returns
    -------
    float
        Coefficient of restitution e, 0 to 1.

    Notes
    -----
    With u = c speed: u - ln(1 + u) = -e u - ln(1 - e u) (Hunt and Crossley 1975). Slow collisions,
    u below 0.0015, return sqrt((1 - r) / (1 + r)) = 0.999 by the slider of that law, with r =
    SLIDER_RATIO. Simulated collisions agree to 3e-7 for e up to 0.985 and to 3e-4 above.
    """
    from icofabric_sim.terms.contacts.laws import SLIDER_RATIO
    from scipy.optimize import brentq

    u = checks.number('damping', damping, unit='s/m', least=0.0) * checks.positive(
        'speed', speed, 'm/s')
    if u == 0.0:
        return 1.0
    if u == math.inf:
        return 0.0
    most = math.sqrt((1.0 - SLIDER_RATIO) / (1.0 + SLIDER_RATIO))
    if u < 1e-3:
        return most
    whole = u - math.log1p(u)
    # In z = -ln(1 - e u) the unknown has no bounds.
    z: float = brentq(lambda z: math.expm1(-z) + z - whole, 0.0, whole + 1.0, xtol=1e-16)
    return min(-math.expm1(-z) / u, most)


def damping_for(target_restitution: float, speed: float) -> float:
    """
    Return the damping with which a collision has a given coefficient of restitution.

    Parameters
    ----------
    target_restitution
        Coefficient of restitution. Damped contacts return at most 0.999 of a speed, so it is below
        that, or 1 for contacts without damping.
    speed
        Rate of delta at first touch [m/s].

    Returns
    -------
    float
        Damping c [s/m].
    """
    from scipy.optimize import brentq

    target = checks.number(
        'target_restitution', target_restitution, above=0.0, most=1.0,
        wish='a number above 0 and at most 1')
    speed = checks.positive('speed', speed, 'm/s')
    if target == 1.0:
        return 0.0
    lowest, highest = 1e-3, 1.0
    if not target < restitution(lowest, 1.0):
        raise ValueError(
            f'target_restitution must be 1, for contacts without damping, or below '
            f'{restitution(lowest, 1.0):.3f}, which damped contacts return at most, '
            f'got {checks.shown(target)}')
    while restitution(highest, 1.0) > target:
        highest *= 2.0
    result: float = brentq(lambda u: restitution(u, 1.0) - target, lowest, highest, xtol=1e-14)
    return result / speed


def _contact_force(
    single: bool, touching: np.ndarray, out: np.ndarray, stiffness: float
) -> ContactForce:
    forces = stiffness * out[:, :10]
    return ContactForce(*_rows(
        single, touching, forces[:, 0:3], forces[:, 3:6], forces[:, 6:9], forces[:, 9],
        out[:, 10]))


def _rows(single: bool, *arrays: np.ndarray) -> list[Any]:
    return [array[0] for array in arrays] if single else list(arrays)


def _poses(**poses: Pose) -> tuple[
        tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray], bool]:
    """
    Return positions (n, 3) and matrices (n, 3, 3) of the first and last, and if all are single.
    """
    given, single = [], True
    for name, pose in poses.items():
        if not isinstance(pose, (tuple, list, np.ndarray)) or len(pose) != 2:
            kind = ValueError if isinstance(pose, (tuple, list, np.ndarray)) else TypeError
            raise kind(
                f'{name} must be a pose: a centre (3,) [m] and a unit quaternion (4,), or (n, 3) '
                f'and (n, 4), got {checks.shown(pose)}')
        place = checks.array(f'the centre of {name}', pose[0], ('[n]', 3), 'm')
        turn = checks.quaternions(f'the orientation of {name}', pose[1], ('[n]', 4))
        single = single and place.ndim == turn.ndim == 1
        given += [np.atleast_2d(place), _matrices(np.atleast_2d(turn))]
    try:
        (count,) = np.broadcast_shapes(*(part.shape[:1] for part in given))
    except ValueError:
        raise ValueError(
            f'the centres and orientations of {" and ".join(poses)} must have the same number of '
            'rows, or one') from None
    whole = [
        np.ascontiguousarray(np.broadcast_to(part, (count, *part.shape[1:]))) for part in given]
    return (whole[0], whole[1]), (whole[-2], whole[-1]), single


def _matrices(orientation: np.ndarray) -> np.ndarray:
    """
    Return matrices (..., 3, 3) from body to world axes of unit quaternions x, y, z, w (..., 4).
    """
    x, y, z, w = np.moveaxis(orientation, -1, 0)
    rows = np.array([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)]])
    return np.moveaxis(rows, (0, 1), (-2, -1))


_RENAMED = {
    'push': 'contact_force', 'push_of_plane': 'plane_contact_force', 'Push': 'ContactForce'}

if not TYPE_CHECKING:
    def __getattr__(name: str) -> Any:
        raise AttributeError(
            renamed_text('contact', name, _RENAMED) if name in _RENAMED else
            f'module {__name__!r} has no attribute {name!r}')
