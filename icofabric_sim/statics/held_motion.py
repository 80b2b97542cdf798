# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Prescribed motions of held bodies of a slab: one end against the other, or all outer faces.

For each amount (a strain or an angle) a motion gives the poses of the moved bodies and their rates
of change with the amount. The reactions of the supports times these rates are the derivative of
the energy by the amount.
"""

from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace
import math
from typing import NamedTuple

from icofabric_sim import checks
from icofabric_sim.scene.body_sizes import size_parameter_names
from icofabric_sim.scene.initial import rotate_by_vector
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.model.body_force import as_body_force, BodyForce, Force
import numpy as np

PULL, PUSH, SHEAR = 'pull', 'push', 'shear'
# All outer faces towards the centre, or away from it.
HYDROSTATIC, INFLATION = 'hydrostatic', 'inflation'
BEND, TWIST = 'bend', 'twist'
# Load cases whose amount is a strain, and those whose amount is an angle [rad].
STRAINED, TURNED = (PULL, PUSH, SHEAR, HYDROSTATIC, INFLATION), (BEND, TWIST)
# Load cases whose moved end may follow a given direction.
DIRECTED = (PULL, PUSH, SHEAR)
# Ratio of the axial component of a displacement below which the displacement counts as lateral.
_ACROSS_RATIO = 1e-9
_SECTIONS = (
    'groups.', 'supports.', 'drives.', 'loads.', 'tractions.', 'line_loads.', 'anchors.',
    'initial', 'masses.')
# Neighbours of a body inside the weave.
_NEIGHBOURS = 12
# Below this angle a series is more accurate than differences of sines.
_SERIES_LIMIT_RAD = 0.01


class Placement(NamedTuple):
    """Poses of the moved bodies and their rates of change with the amount."""

    position: np.ndarray  # (m, 3) [m]
    rotation: np.ndarray  # (3,) [rad] from the woven orientation
    rate: np.ndarray  # (m, 6) displacement [m] and rotation [rad] per unit of the amount


@dataclass(frozen=True)
class HeldMotion:
    """Slab with held bodies, some of which follow a prescribed motion."""

    scene: Scene  # slab with its held bodies as woven
    axis: int  # from end to end
    length: float  # [m] between the centres of the ends
    end: np.ndarray  # (e,) bodies of the moved end, or of the face there
    moved: np.ndarray  # (m,) all moved bodies
    at: Callable[[float], Placement]
    body_force: BodyForce | None = None  # of the user, acts in addition to the supports

    def placed(self, amount: float) -> Scene:
        """Return the slab with its held bodies at an amount."""
        placement = self.at(amount)
        start = self.scene.initial
        position, orientation = start.position.copy(), start.orientation.copy()
        position[self.moved] = placement.position
        orientation[self.moved] = rotate_by_vector(placement.rotation, orientation[self.moved])
        return replace(
            self.scene, initial=start._replace(position=position, orientation=orientation))

    def conjugate(self, amount: float, reaction: np.ndarray) -> float:
        """
        Return the derivative of the energy with respect to the amount [J], from reactions (n, 6).

        `reaction` is that at the amount. For an angle the derivative is a moment [N m].
        """
        return float((reaction[self.moved] * self.at(amount).rate).sum())

    def end_wrench(
        self, position: np.ndarray, reaction: np.ndarray
    ) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Return force [N] and moment [N m] on the moved end about its centre, world axes."""
        place, held = position[self.end], reaction[self.end]
        arm = place - place.mean(axis=0)
        fx, fy, fz = held[:, :3].sum(axis=0).tolist()
        mx, my, mz = (held[:, 3:] + np.cross(arm, held[:, :3])).sum(axis=0).tolist()
        return (fx, fy, fz), (mx, my, mz)


def held_motion(
    scene: Scene, kind: str, axis: int, about: int | None = None,
    body_force: BodyForce | Force | None = None, along: np.ndarray | None = None
) -> HeldMotion:
    """
    Return the motion of a load case for the slab of a scene, without loads, supports and drives.

    - `axis`: world axis from end to end.
    - `about`: lateral axis of a bend; None: the next axis.
    - `body_force`: body force that acts on the slab.
    - `along` (3,): unit vector along which the end of a pull or shear moves, and against which the
      end of a push moves; None: the axis, or the next axis for a shear.

    Raises ValueError if the slab does not have two ends.
    """
    own = as_body_force(body_force)
    letter = 'xyz'[axis]
    base, ends = _held(scene, _ends(scene, axis))
    coordinate = base.position[:, axis]
    length = float(coordinate[ends[1]].mean() - coordinate[ends[0]].mean())
    if not length > 0.0 or len(set(ends[0]) & set(ends[1])):
        raise ValueError(
            f'the fabric does not have two ends along the axis {letter}: weave.size must be at '
            'least 3 there')
    end = ends[1]
    place, unit = base.position[end], np.eye(3)
    if kind in (HYDROSTATIC, INFLATION):
        base, moved = _within_faces(scene)
        sign = 1.0 if kind == INFLATION else -1.0
        return HeldMotion(
            base, axis, length, end, moved,
            lambda amount: _scaled(base.position[moved], sign, amount), own)
    if kind == BEND:
        turn = unit[(axis + 1) % 3 if about is None else about]

        def at(amount: float) -> Placement:
            return _bent(place, unit[axis], turn, length, amount)
    elif kind == TWIST:
        def at(amount: float) -> Placement:
            return _turned(place, np.zeros(3), np.zeros(3), unit[axis], amount)
    else:
        if along is None:
            along = unit[(axis + 1) % 3 if kind == SHEAR else axis]
        shift = -length * along if kind == PUSH else length * along

        def at(amount: float) -> Placement:
            rate = np.zeros((len(place), 6))
            rate[:, :3] = shift
            return Placement(place + amount * shift, np.zeros(3), rate)
    return HeldMotion(base, axis, length, end, end, at, own)


def check_along(kind: str, axis: int, along: Sequence[float] | None) -> np.ndarray | None:
    """
    Check the direction of a displacement.

    Parameters
    ----------
    kind : str
        Load case.
    axis : int
        World axis from end to end: 0, 1 or 2.
    along : sequence of three floats or None
        Direction, world frame, of any length; None: the default of the load case.

    Returns
    -------
    ndarray or None
        Unit vector (3,).

    Raises
    ------
    ValueError
        If the load case has no direction, a shear is not perpendicular to the axis, or a pull or
        push does not change the distance of the ends.
    """
    if along is None:
        return None
    letter = 'xyz'[axis]
    if kind not in DIRECTED:
        raise ValueError(
            f'along applies to {", ".join(DIRECTED)} only: leave it out for a {kind}')
    given = checks.array('along', along, (3,))
    size = float(np.abs(given).max())
    if not size > 0.0:
        raise ValueError('along must be a direction, got 0 0 0')
    unit = given / size
    unit = unit / np.linalg.norm(unit)
    if kind == SHEAR and abs(unit[axis]) > _ACROSS_RATIO:
        raise ValueError(
            f'along {checks.shown(given.tolist())} of a shear must be perpendicular to the axis '
            f'{letter}: use a pull or push for an oblique displacement')
    if kind != SHEAR and not unit[axis] > _ACROSS_RATIO:
        raise ValueError(
            f'along {checks.shown(given.tolist())} of a {kind} must point from the fixed end to '
            f'the moved one, with a component along {letter} above 0; use a shear for a lateral '
            'displacement')
    return np.asarray(unit)


def _ends(scene: Scene, axis: int) -> dict[str, str]:
    """Return selectors of the fixed and the moved end; radial weave: its first and last row."""
    if scene.weave.kind != 'radial':
        return {'fixed_end': f'{"xyz"[axis]}_min', 'moved_end': f'{"xyz"[axis]}_max'}
    word, place = ('row', 'column', 'level')[axis], scene.weave.grid[:, axis]
    return {'fixed_end': f'{word} {place.min()}', 'moved_end': f'{word} {place.max()}'}


def _scaled(place: np.ndarray, sign: float, amount: float) -> Placement:
    """Scale distances from the centre by 1 + sign * amount."""
    arm = place - 0.5 * (place.min(axis=0) + place.max(axis=0))
    return Placement(
        place + sign * amount * arm, np.zeros(3), np.hstack([sign * arm, np.zeros_like(arm)]))


def _bent(
    place: np.ndarray, along: np.ndarray, turn: np.ndarray, length: float, angle: float
) -> Placement:
    """
    Rotate an end about a lateral axis, with its centre at the end of an arc of the woven length.

    The centre line of a uniformly bent slab then keeps its length.
    """
    aside = np.cross(turn, along)
    if abs(angle) < _SERIES_LIMIT_RAD:
        square = angle * angle
        shorter = -square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0))
        sideways = 0.5 * angle * (1.0 - square / 12.0 * (1.0 - square / 30.0))
        rates = (-angle / 3.0 * (1.0 - square / 10.0 * (1.0 - square / 28.0)),
                 0.5 * (1.0 - square / 4.0 * (1.0 - square / 18.0)))
    else:
        sine, cosine = math.sin(angle), math.cos(angle)
        shorter, sideways = sine / angle - 1.0, (1.0 - cosine) / angle
        rates = (cosine - sine / angle) / angle, (sine - sideways) / angle
    return _turned(
        place, length * (shorter * along + sideways * aside),
        length * (rates[0] * along + rates[1] * aside), turn, angle)


def _turned(
    place: np.ndarray, shift: np.ndarray, rate: np.ndarray, axis: np.ndarray, angle: float
) -> Placement:
    """Rotate bodies about an axis through their centre, and shift the centre at a rate (3,)."""
    centre = place.mean(axis=0)
    arm = place - centre
    level = arm - np.outer(arm @ axis, axis)
    arm = arm + (math.cos(angle) - 1.0) * level + math.sin(angle) * np.cross(axis, level)
    spin = np.broadcast_to(axis, arm.shape)
    return Placement(
        centre + shift + arm, angle * axis, np.hstack([rate + np.cross(axis, arm), spin]))


def _fabric_parameters(scene: Scene) -> dict[str, object]:
    """Return the parameters of shells, weave and connectors, and of groups that these use."""
    sections: tuple[str, ...] = (*_SECTIONS, 'gravity', 'field')
    if not scene.electric.mutual:
        # Without a field, charges have no other effect.
        sections = (*sections, 'charge')
    charged = scene.electric.mutual and scene.parameters.names('charges')
    sized = size_parameter_names(scene.parameters, scene.shell, ('masses',))
    if sized:
        # At rest, masses have no other effect.
        sections = tuple(name for name in sections if name != 'masses.')
    if charged or sized or scene.parameters.names('connector_groups'):
        sections = tuple(name for name in sections if name != 'groups.')
    return {name: value for name, value in scene.parameters.items()
            if not name.startswith(sections) and value != ''}


def _held(scene: Scene, groups: dict[str, str]) -> tuple[Scene, list[np.ndarray]]:
    """Return the bare fabric with groups held as woven, and the bodies of each group."""
    names = [_unused_name(name, scene.groups) for name in groups]
    held: dict[str, object] = {}
    for name, selector in zip(names, groups.values()):
        held |= {f'groups.{name}': selector, f'supports.{name}.group': name}
    found = Scene.from_parameters({**_fabric_parameters(scene), **held})
    return found, [found.groups[name] for name in names]


def _unused_name(name: str, others: Container[str]) -> str:
    """Return a name that differs from those of the user."""
    while name in others:
        name += '_'
    return name


def _within_faces(scene: Scene) -> tuple[Scene, np.ndarray]:
    """
    Return the bare fabric with its outermost bodies held, and their numbers.

    They are the woven bodies that lack a neighbour, also on the steps of a face as in bias.
    """
    count = len(scene.weave.position)
    joined = np.bincount(scene.woven.bodies.ravel(), minlength=count)[:count]
    outer = np.flatnonzero(joined < _NEIGHBOURS)
    base, [bodies] = _held(scene, {'outer_faces': 'ids ' + ' '.join(map(str, outer.tolist()))})
    return base, bodies
