# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Independent check: energies of a slab by SciPy's minimiser with separately written forces.

The forces, second derivatives and equilibrium solver of this package are not used, only the
attachment points, the vertices of the icosahedron and the numbers of the scene. Springs act
between points. Contact is the potential of docs/contact.md in another form. With the
slacks s_f = h_f - n_f . x of the 40 faces of two shells, min(p_A, p_B) of that page is
the least slack, so

    M_0 = volume of {x: all s_f(x) >= 0},    M_1 = sum over f of the integral of s_f over R_f

where R_f = {x: 0 <= s_f(x) <= all others} is the part of the overlap to which face f is nearest.
The derivative of M_0 with respect to s_f is the area of face f, that of M_1 the volume of R_f.
All are convex polytopes, which Qhull finds (SciPy's HalfspaceIntersection and ConvexHull).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from icofabric_sim.geometry.icosahedron import vertices
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.scene.scene import Scene
from icofabric_sim.statics.held_motion import check_along, held_motion
from icofabric_sim.statics.slab_path import follow_path
import numpy as np
from scipy.optimize import linprog, minimize
from scipy.spatial import cKDTree, ConvexHull, HalfspaceIntersection
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class ReferenceSettings:
    """Tunables of the independent minimisation by SciPy."""

    max_free_bodies: int = 12  # limits the time: the energy of a pair takes 20 ms
    min_depth_ratio: float = 1e-9  # overlap over a below which shells do not overlap
    on_face_ratio: float = 1e-7  # distance of a corner on a face over the size of the overlap
    gradient_ratio: float = 1e-7  # final gradient over the largest spring force
    start_offset: float = 1e-4  # random, from the woven positions, over a and in rad
    seed: int = 20


_REFERENCE = ReferenceSettings()
# Other terms of the energy, which must be absent.
_ABSENT_PARAMETERS: Final = (
    'connector.bending_stiffness', 'connector.twisting_stiffness', 'connector.damping',
    'contact.friction')


class Compared(NamedTuple):
    """Energy at one strain, and its derivative there, by this package and by SciPy."""

    strain: float
    package: float  # [J]
    scipy: float  # [J]
    package_slope: float  # [J]
    scipy_slope: float  # [J]
    position_difference: float  # largest distance between both positions of a body, over a
    gradient: float  # largest residual force of SciPy over the largest spring force
    contact_pairs: int


def require_plain(scene: Scene) -> None:
    """Raise ParameterError for parameters that the independent energies do not support."""
    parameters = scene.parameters
    for name in _ABSENT_PARAMETERS:
        if parameters[name] != 0.0:
            raise ParameterError(name, f'{name}: the result `independent` supports only linear '
                                       f'springs and contact: set {name} to 0')
    if parameters['connector.obstruction'] == 'wrap' or parameters['connector.law'] or (
            scene.parameters.names('connector_groups') or scene.parameters.names('planes')):
        raise ParameterError(
            'connector', 'the result `independent` supports only straight connectors of one '
            'stiffness, and no planes: remove connector.obstruction: wrap, connector.law, '
            'connector_groups and planes')
    extension, compression = (
        parameters[f'connector.stiffness_{side}'] for side in ('extension', 'compression'))
    if (extension if extension >= 0.0 else parameters['connector.stiffness']) != (
            compression if compression >= 0.0 else parameters['connector.stiffness']):
        raise ParameterError(
            'connector.stiffness_extension', 'the result `independent` needs one stiffness in '
            'extension and compression')
    if not parameters['contact.stiffness'] > 0.0:
        raise ParameterError(
            'contact.stiffness', 'contact.stiffness must be above 0 [N/m] for the result '
            '`independent`')


def compare_energies(
    scene: Scene, kind: str, strains: Sequence[float], axis: int,
    along: Sequence[float] | None = None
) -> list[Compared]:
    """Return equilibrium energies of a slab between two held ends, by this package and SciPy."""
    require_plain(scene)
    motion = held_motion(scene, kind, axis, along=check_along(kind, axis, along))
    found: list[Compared] = []
    generator = np.random.default_rng(_REFERENCE.seed)
    for step in follow_path(motion, strains):
        if not step.found.converged:
            break
        strained = motion.placed(step.amount)
        assert strained.supports is not None
        held = strained.supports.translation.all(axis=1)
        if (count := int((~held).sum())) > _REFERENCE.max_free_bodies:
            raise ValueError(
                f'weave.size: the result `independent` supports at most '
                f'{_REFERENCE.max_free_bodies} bodies between the ends, got {count}; use a '
                'smaller slab')
        slab = PlainSlab(strained)
        freedoms = np.repeat(~held, 6)
        start = np.where(
            freedoms, _REFERENCE.start_offset * generator.standard_normal(len(freedoms)), 0.0)
        place = slab.minimise(start, freedoms)
        energy, gradient = slab.energy(place)
        position, _ = slab.pose(place)
        rate = motion.at(step.amount).rate
        pull = gradient.reshape(-1, 6)[motion.moved, :3] / slab.half_edge
        found.append(Compared(
            step.amount, float(step.found.snapshot.energy['total']), energy,
            step.conjugate, float((pull * rate[:, :3]).sum()),
            float(np.linalg.norm(
                position - step.found.snapshot.position, axis=1).max()) / slab.half_edge,
            float(np.abs(gradient[freedoms]).max()) / slab.half_edge / slab.largest_force(place),
            slab.overlapping(place)))
    return found


class PlainSlab:
    """
    Slab of springs between points, and overlapping shells.

    Coordinates are (6 n,): displacement over a and rotation vector [rad] of each body from its
    position in the scene.
    """

    def __init__(self, scene: Scene) -> None:
        """Copy positions and parameters from a scene."""
        parameters = scene.parameters
        extension = parameters['connector.stiffness_extension']
        self._k = extension if extension >= 0.0 else parameters['connector.stiffness']
        self._rest = parameters['connector.natural_length'] or scene.geometry.connector_length
        self._contact = parameters['contact.stiffness']
        self.half_edge = scene.geometry.half_edge
        self._position = scene.initial.position
        self._turn = Rotation.from_quat(scene.initial.orientation)
        self._pairs = np.asarray(scene.connectors.bodies)
        self._points = np.asarray(scene.connectors.points_body)
        # In parts of a.
        corners = vertices(1.0)
        self._reach = 2.0 * float(np.linalg.norm(corners, axis=1).max())
        equations = np.unique(np.round(ConvexHull(corners).equations, 12), axis=0)
        self._normals, self._heights = equations[:, :3], -equations[:, 3]

    def pose(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions [m] (n, 3), and matrices from body to world (n, 3, 3)."""
        parts = place.reshape(-1, 6)
        return (self._position + self.half_edge * parts[:, :3],
                (Rotation.from_rotvec(parts[:, 3:]) * self._turn).as_matrix())

    def energy(self, place: np.ndarray) -> tuple[float, np.ndarray]:
        """Energy [J] and its gradient with respect to the coordinates [J], (6 n,)."""
        position, turn = self.pose(place)
        energy, wrench = self._springs(position, turn)
        for first, second in self._near(position):
            pushed, on_second = self._push(
                position[second] - position[first], turn[first], turn[second])
            if not pushed > 0.0:
                continue
            energy += pushed
            wrench[second] += on_second
            wrench[first, :3] -= on_second[:3]
            wrench[first, 3:] -= on_second[3:] + np.cross(
                position[second] - position[first], on_second[:3])
        parts = place.reshape(-1, 6)
        gradient = -np.hstack([
            self.half_edge * wrench[:, :3],
            np.einsum('nij,ni->nj', _left_jacobian(parts[:, 3:]), wrench[:, 3:])])
        return energy, gradient.ravel()

    def minimise(self, start: np.ndarray, freedoms: np.ndarray) -> np.ndarray:
        """Let SciPy find the least energy over some freedoms."""
        scale = self.largest_force(start) * self.half_edge or self._k * self.half_edge**2

        def function(free: np.ndarray) -> tuple[float, np.ndarray]:
            place = start.copy()
            place[freedoms] = free
            energy, gradient = self.energy(place)
            return energy / scale, gradient[freedoms] / scale

        found = minimize(
            function, start[freedoms], jac=True, method='L-BFGS-B', options={
                'maxcor': 60, 'ftol': 0.0, 'gtol': _REFERENCE.gradient_ratio, 'maxiter': 400,
                'maxls': 40})
        place = start.copy()
        place[freedoms] = found.x
        return place

    def largest_force(self, place: np.ndarray) -> float:
        """Return the largest force of a spring [N]."""
        reach = self._reaches(*self.pose(place))[1]
        return self._k * float(np.abs(np.linalg.norm(reach, axis=1) - self._rest).max())

    def overlapping(self, place: np.ndarray) -> int:
        """Count the pairs of shells that overlap."""
        position, turn = self.pose(place)
        return sum(self._push(position[b] - position[a], turn[a], turn[b])[0] > 0.0
                   for a, b in self._near(position))

    def _reaches(self, position: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Arms of the attachment points (c, 2, 3), and from the first to the second (c, 3)."""
        arms = np.einsum('ceij,cej->cei', turn[self._pairs], self._points)
        ends = position[self._pairs] + arms
        return arms, ends[:, 1] - ends[:, 0]

    def _springs(self, position: np.ndarray, turn: np.ndarray) -> tuple[float, np.ndarray]:
        arms, reach = self._reaches(position, turn)
        length = np.linalg.norm(reach, axis=1)
        pull = (self._k * (length - self._rest) / length)[:, None] * reach
        wrench = np.zeros((len(position), 6))
        for end, sign in ((0, 1.0), (1, -1.0)):
            np.add.at(wrench, self._pairs[:, end], np.hstack(
                [sign * pull, np.cross(arms[:, end], sign * pull)]))
        return 0.5 * self._k * float(((length - self._rest) ** 2).sum()), wrench

    def _near(self, position: np.ndarray) -> list[tuple[int, int]]:
        return sorted(cKDTree(position).query_pairs(self._reach * self.half_edge))

    def _push(
        self, apart: np.ndarray, first: np.ndarray, second: np.ndarray
    ) -> tuple[float, np.ndarray]:
        """Energy [J] of a pair, and force and torque on the second about its centre (6,)."""
        a, wrench = self.half_edge, np.zeros(6)
        apart = apart / a
        normals, heights = self._planes(apart, first, second)
        found = _overlap(normals, heights)
        if found is None:
            return 0.0, wrench
        base, lifted = _moments(normals, heights, *found)
        delta = 4.0 * lifted.total / base.total
        # Slacks of the second shell grow by n . dx - w . (n x arm) as it moves by dx and turns by
        # w; M_0 by them times the areas of its faces, M_1 times the volumes that are theirs.
        own = np.arange(len(self._normals), len(normals))
        rates = [np.hstack([part.weight[own, None] * normals[own], -part.weight[own, None] * (
            np.cross(normals[own], part.centre[own] - apart))]).sum(axis=0)
            for part in (base, lifted)]
        slope = (4.0 * rates[1] - delta * rates[0]) / base.total
        wrench = -self._contact * a * delta * slope
        wrench[3:] *= a
        return 0.5 * self._contact * (delta * a) ** 2, wrench

    def _planes(
        self, apart: np.ndarray, first: np.ndarray, second: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return normals and heights over a of all faces, from the centre of the first shell."""
        other = self._normals @ second.T
        return (np.vstack([self._normals @ first.T, other]),
                np.concatenate([self._heights, self._heights + other @ apart]))


class _Moment(NamedTuple):
    """A moment of the overlap, and what of it belongs to each face."""

    total: float
    weight: np.ndarray  # (f,) its derivative by the slack of a face
    centre: np.ndarray  # (f, 3) where that acts


def _overlap(normals: np.ndarray, heights: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Return the deepest point within all faces and its depth, or None without overlap."""
    found = linprog(
        [0.0, 0.0, 0.0, -1.0], A_ub=np.hstack([normals, np.ones((len(normals), 1))]),
        b_ub=heights, bounds=[(None, None)] * 4)
    depth = float(found.x[3])
    return (found.x[:3], depth) if depth > _REFERENCE.min_depth_ratio else None


def _moments(
    normals: np.ndarray, heights: np.ndarray, inner: np.ndarray, depth: float
) -> tuple[_Moment, _Moment]:
    """M_0 and M_1 of the overlap around its deepest point."""
    slack = heights - normals @ inner
    # The overlap is flat: along its normal it is stretched, and round for Qhull.
    flat = normals[int(np.argmin(slack))]
    back = np.eye(3) + (depth - 1.0) * np.outer(flat, flat)
    rows = np.hstack([normals @ back, -slack[:, None]])
    whole = _Polytope(rows, np.zeros(3), back)
    volumes, parts = np.zeros(len(normals)), np.zeros((len(normals), 3))
    first = 0.0
    for number in np.flatnonzero(whole.area > 0.0):
        # Where this face is the nearest: a pyramid above it, which the others cut.
        others = np.delete(np.arange(len(normals)), number)
        middle = np.linalg.solve(back, whole.middle[number])
        there = slack[others] - rows[others, :3] @ middle
        lift = slack[number] - slack[others] + there
        reach = there[lift > 0.0] / lift[lift > 0.0]
        inside = (1.0 - 0.5 * min(1.0, float(reach.min(initial=1.0)))) * middle
        part = _Polytope(np.vstack([rows[number], rows[others] - rows[number]]), inside, back)
        volumes[number], parts[number] = part.volume, inner + part.centre
        first += part.volume * float(slack[number] - normals[number] @ part.centre)
    return (_Moment(whole.volume, whole.area, inner + whole.middle),
            _Moment(first, volumes, parts))


class _Polytope:
    """Volume, centroid, and areas and centroids of the faces of a convex polytope."""

    def __init__(self, rows: np.ndarray, inside: np.ndarray, back: np.ndarray) -> None:
        """
        Build from rows (normal, -height) and an inner point; `back` maps to outer coordinates.
        """
        size = np.linalg.norm(rows[:, :3], axis=1)
        kept = np.flatnonzero(size > 0.0)
        cut = rows[kept] / size[kept, None]
        corners = HalfspaceIntersection(cut, inside, qhull_options='Qt Q12 Pp').intersections
        corners = corners[np.isfinite(corners).all(axis=1)]
        apex = back @ inside
        self.volume, self.centre = 0.0, np.zeros(3)
        self.area, self.middle = np.zeros(len(rows)), np.zeros((len(rows), 3))
        for number, row in zip(kept, cut):
            on = np.abs(corners @ row[:3] + row[3]) < _REFERENCE.on_face_ratio
            if on.sum() < 3:
                continue
            normal = np.linalg.solve(back, row[:3])
            normal /= np.linalg.norm(normal)
            area, middle = _polygon(corners[on] @ back.T, normal)
            self.area[number], self.middle[number] = area, middle
            pyramid = area * abs(float((middle - apex) @ normal)) / 3.0
            self.volume += pyramid
            self.centre += pyramid * (0.25 * apex + 0.75 * middle)
        self.centre /= self.volume


def _polygon(corners: np.ndarray, normal: np.ndarray) -> tuple[float, np.ndarray]:
    """Area and centroid of a convex polygon with corners in any order."""
    middle = corners.mean(axis=0)
    along = corners[int(np.argmax(np.linalg.norm(corners - middle, axis=1)))] - middle
    across = np.cross(normal, along)
    order = np.argsort(np.arctan2((corners - middle) @ across, (corners - middle) @ along))
    around = corners[order] - middle
    after = np.roll(around, -1, axis=0)
    sizes = 0.5 * np.cross(around, after) @ normal
    area = float(sizes.sum())
    if not area > 0.0:
        return 0.0, middle
    return area, middle + (sizes[:, None] * (around + after)).sum(axis=0) / (3.0 * area)


def _left_jacobian(vectors: np.ndarray) -> np.ndarray:
    """From rates of rotation vectors (n, 3) to spins in world axes, (n, 3, 3)."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    cross = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -z, y, -x
    cross -= np.swapaxes(cross, 1, 2)
    safe = np.where(angle > 1e-4, angle, 1.0)
    first = np.where(angle > 1e-4, (1.0 - np.cos(safe)) / safe**2, 0.5 - angle**2 / 24.0)
    second = np.where(
        angle > 1e-4, (safe - np.sin(safe)) / safe**3, 1.0 / 6.0 - angle**2 / 120.0)
    found: np.ndarray = np.eye(3) + first * cross + second * (cross @ cross)
    return found
