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
How held bodies of a slab are moved: its ends against each other, or all of its outer faces.

A motion says for each amount, a strain or an angle, where the bodies are that it moves, and at
which rate they go on from there. What their supports bear times that rate is the derivative of the
energy by the amount.
"""

from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace
import math
from typing import NamedTuple

from icofabric_sim import checks
from icofabric_sim.scene.body_sizes import names_of_sizes
from icofabric_sim.scene.initial import rotate_by_vector
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.model.body_force import as_body_force, BodyForce, Force
import numpy as np

PULL, PUSH, SHEAR = 'pull', 'push', 'shear'
# All outer faces towards the centre, or away from it.
HYDROSTATIC, INFLATION = 'hydrostatic', 'inflation'
BEND, TWIST = 'bend', 'twist'
# What the amount is: a strain, or an angle [rad].
STRAINED, TURNED = (PULL, PUSH, SHEAR, HYDROSTATIC, INFLATION), (BEND, TWIST)
# Those whose moved end may go along a given direction.
DIRECTED = (PULL, PUSH, SHEAR)
# A displacement this close to across an axis, as a part of its length, is across it.
_ACROSS_RATIO = 1e-9
_SECTIONS = (
    'groups.', 'supports.', 'drives.', 'loads.', 'tractions.', 'anchors.', 'initial', 'masses.')
# Of a body within the weave.
_NEIGHBOURS = 12
# Below this angle [rad] a series is more exact than differences of sines.
_SMALL = 0.01


class Placement(NamedTuple):
    """Where the moved bodies are, and how they go on."""

    position: np.ndarray  # (m, 3) [m]
    rotation: np.ndarray  # (3,) [rad] from how they are woven
    rate: np.ndarray  # (m, 6) displacement [m] and rotation [rad] for each unit of the amount


@dataclass(frozen=True)
class HeldMotion:
    """A slab, which of its bodies are held, and how some of them move."""

    scene: Scene  # the slab with its held bodies as woven
    axis: int  # from end to end
    length: float  # [m] between the centres of the ends
    end: np.ndarray  # (e,) the bodies of the end that moves, or of the face there
    moved: np.ndarray  # (m,) all bodies that move
    at: Callable[[float], Placement]
    body_force: BodyForce | None = None  # of the user, which acts beside the supports

    def placed(self, amount: float) -> Scene:
        """The slab with its held bodies where an amount puts them."""
        placement = self.at(amount)
        start = self.scene.initial
        position, orientation = start.position.copy(), start.orientation.copy()
        position[self.moved] = placement.position
        orientation[self.moved] = rotate_by_vector(placement.rotation, orientation[self.moved])
        return replace(
            self.scene, initial=start._replace(position=position, orientation=orientation))

    def conjugate(self, amount: float, reaction: np.ndarray) -> float:
        """
        What the supports do for each unit of the amount [J]: the derivative of the energy.

        Of reactions (n, 6) on bodies where an amount puts them. A moment [N m] for an angle.
        """
        return float((reaction[self.moved] * self.at(amount).rate).sum())

    def end_wrench(
        self, position: np.ndarray, reaction: np.ndarray
    ) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Force [N] and moment [N m] about its centre that hold the moved end, world axes."""
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
    The motion of a kind for the slab of a scene, without its loads, supports and drives.

    `axis`: from end to end. `about`: the axis across it that a bend turns about, None: the next.
    `body_force`: what acts on the slab all the same. `along` (3,), of length 1: where the end of
    a pull or shear goes, and a push comes from; None: the axis, or for a shear the next one.
    ValueError where the slab has no two ends.
    """
    own = as_body_force(body_force)
    letter = 'xyz'[axis]
    base, ends = _held(scene, _ends(scene, axis))
    coordinate = base.position[:, axis]
    length = float(coordinate[ends[1]].mean() - coordinate[ends[0]].mean())
    if not length > 0.0 or len(set(ends[0]) & set(ends[1])):
        raise ValueError(
            f'the fabric has no two ends along the axis {letter}: weave.size must be at '
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
        From end to end: 0, 1 or 2.
    along : sequence of three floats or None
        Direction, world frame, of any length; None: that of the load case.

    Returns
    -------
    ndarray or None
        The same (3,) of length 1.

    Raises
    ------
    ValueError
        Of a load case without such a direction, of a shear that is not across the axis, or of a
        pull or push that does not part or approach the ends.
    """
    if along is None:
        return None
    letter = 'xyz'[axis]
    if kind not in DIRECTED:
        raise ValueError(f'along is of {", ".join(DIRECTED)} alone: leave it out for a {kind}')
    given = checks.array('along', along, (3,))
    size = float(np.abs(given).max())
    if not size > 0.0:
        raise ValueError('along must be a direction, got 0 0 0')
    unit = given / size
    unit = unit / np.linalg.norm(unit)
    if kind == SHEAR and abs(unit[axis]) > _ACROSS_RATIO:
        raise ValueError(
            f'along {checks.shown(given.tolist())} of a shear must be across the axis {letter}: '
            'an oblique displacement is that of a pull or push')
    if kind != SHEAR and not unit[axis] > _ACROSS_RATIO:
        raise ValueError(
            f'along {checks.shown(given.tolist())} of a {kind} must lead from the fixed end to '
            f'the moved one, with a part along {letter} above 0; across it is a shear')
    return np.asarray(unit)


def _ends(scene: Scene, axis: int) -> dict[str, str]:
    """Selectors of the fixed end and the moved one: of a radial weave its first and last row."""
    if scene.weave.kind != 'radial':
        return {'fixed_end': f'{"xyz"[axis]}_min', 'moved_end': f'{"xyz"[axis]}_max'}
    word, place = ('row', 'column', 'level')[axis], scene.weave.grid[:, axis]
    return {'fixed_end': f'{word} {place.min()}', 'moved_end': f'{word} {place.max()}'}


def _scaled(place: np.ndarray, sign: float, amount: float) -> Placement:
    """All bodies farther from their centre, or nearer (-1), by a part of their distance."""
    arm = place - 0.5 * (place.min(axis=0) + place.max(axis=0))
    return Placement(
        place + sign * amount * arm, np.zeros(3), np.hstack([sign * arm, np.zeros_like(arm)]))


def _bent(
    place: np.ndarray, along: np.ndarray, turn: np.ndarray, length: float, angle: float
) -> Placement:
    """
    An end turned about a lateral axis, its centre at the end of an arc of the woven length.

    So the line through the centres of a slab that bends evenly keeps its length.
    """
    aside = np.cross(turn, along)
    if abs(angle) < _SMALL:
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
    """Bodies turned about an axis through their centre, which is shifted, at a rate (3,)."""
    centre = place.mean(axis=0)
    arm = place - centre
    level = arm - np.outer(arm @ axis, axis)
    arm = arm + (math.cos(angle) - 1.0) * level + math.sin(angle) * np.cross(axis, level)
    spin = np.broadcast_to(axis, arm.shape)
    return Placement(
        centre + shift + arm, angle * axis, np.hstack([rate + np.cross(axis, arm), spin]))


def _bare(scene: Scene) -> dict[str, object]:
    """Parameters of the fabric alone: shells, weave and connectors, and groups that these need."""
    sections: tuple[str, ...] = (*_SECTIONS, 'gravity', 'field')
    if not scene.electric.mutual:
        # Without a field charges do nothing but this.
        sections = (*sections, 'charge')
    charged = scene.electric.mutual and scene.parameters.names('charges')
    sized = names_of_sizes(scene.parameters, scene.shell, ('masses',))
    if sized:
        # At rest masses matter to nothing else.
        sections = tuple(name for name in sections if name != 'masses.')
    if charged or sized or scene.parameters.names('connector_groups'):
        sections = tuple(name for name in sections if name != 'groups.')
    return {name: value for name, value in scene.parameters.items()
            if not name.startswith(sections) and value != ''}


def _held(scene: Scene, groups: dict[str, str]) -> tuple[Scene, list[np.ndarray]]:
    """The bare fabric with groups held as they are woven, and the bodies of each."""
    names = [_unlike(name, scene.groups) for name in groups]
    held: dict[str, object] = {}
    for name, selector in zip(names, groups.values()):
        held |= {f'groups.{name}': selector, f'supports.{name}.group': name}
    found = Scene.from_parameters({**_bare(scene), **held})
    return found, [found.groups[name] for name in names]


def _unlike(name: str, others: Container[str]) -> str:
    """A name of our own beside those of the user."""
    while name in others:
        name += '_'
    return name


def _within_faces(scene: Scene) -> tuple[Scene, np.ndarray]:
    """
    The bare fabric with its outermost bodies held, and which they are.

    Those of the weave that lack a neighbour: also where a face has steps, as in bias.
    """
    count = len(scene.weave.position)
    joined = np.bincount(scene.connectors.bodies.ravel(), minlength=count)[:count]
    outer = np.flatnonzero(joined < _NEIGHBOURS)
    base, [bodies] = _held(scene, {'outer_faces': 'ids ' + ' '.join(map(str, outer.tolist()))})
    return base, bodies
