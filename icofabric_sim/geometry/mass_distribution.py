# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Mass, centre of mass and inertia of any density in the icosahedron, with an error estimate.

Eqs 12, 33 and 34 for a density that is a function of the position. The density may be
discontinuous, for instance at the surface of heavier balls inside the shell, where a fixed rule
converges slowly. The integration therefore has two levels:

- along each ray from the centre (lambda1 of eq 34) an adaptive rule finds the jumps by bisection
  and integrates between them, so that they cost no accuracy;
- over the directions an adaptive rule refines a fundamental triangle, one sixth of a face, whose
  120 images under the symmetry group cover the surface. All images share their nodes, so a
  density with icosahedral symmetry gives an isotropic inertia to round-off, whatever the
  quadrature error. Images that agree on the first few thousand rays are treated as equal; each
  later ray is checked on one more image.

Every accepted integral is compared with that at half the spacing, and with samples on the
boundaries of the cells. A detail smaller than the first spacing, about 2 degrees and 3 % of the
thickness, can be missed.
"""

from itertools import permutations
from typing import Callable, Final, NamedTuple

from icofabric_sim.geometry.icosahedron import inscribed_radius, outer_triangles, triangle_rule
from icofabric_sim.geometry.ray_quadrature import DensityProbe, integrate_rays
import numpy as np

# The model needs the centre of mass at the centre (relative to a) and equal principal moments.
SYMMETRY_TOLERANCE: Final = 1e-9
# Densities per call of the user's function stay near a hundred thousand.
_RAYS_PER_CALL: Final = 8192
_RAYS_PER_PASS: Final = 400_000
# Nodes in the outermost 7 % of a cell are missing on each side: this share of its area is seen
# by the boundary samples alone.
_UNSEEN_SHARE: Final = 0.1
_INSET: Final = 1e-6
_SMALLEST_AREA: Final = 1e-12
# Two images of a ray with integrals this close, relative to the largest possible, are equal.
_EQUAL_IMAGE_RATIO: Final = 1e-11
# Intervals to start with on each ray. The chord of a ray that grazes a ball may be too short to be
# noticed. The mass missed this way scales with the cube of the spacing; 16 intervals miss about
# 1e-7 of the mass. Therefore their number follows the tolerance once a jump has been seen.
_PANELS: Final = 4
_PANELS_WITH_JUMPS: Final = 16
_PANELS_LIMIT: Final = 100


class MassDistribution(NamedTuple):
    """Result of the integration, in body axes."""

    mass: float                # [kg]
    centre_of_mass: np.ndarray  # [m], (3,)
    inertia: np.ndarray        # about the centre of the icosahedron [kg m^2], (3, 3): eq 12
    relative_error: float      # estimate for mass, inertia, and offset of the centre divided by a
    asymmetry: float           # larger of: offset of the centre / a, spread of the moments
    converged: bool            # the error is within the tolerance, and the asymmetry is certain
    evaluation_count: int      # densities evaluated


def integrate_density(
        density: Callable[[np.ndarray], np.ndarray], half_edge: float, thickness: float, *,
        include_interior: bool = False, tolerance: float = 1e-5,
        evaluation_limit: int = 50_000_000, needs_symmetry: bool = True) -> MassDistribution:
    """
    Integrate a density over the shell.

    Parameters
    ----------
    density
        Takes points in body axes [m], (m, 3); returns the density there [kg/m^3], (m,), finite
        and not negative.
    half_edge, thickness
        a and T [m].
    include_interior
        Also integrate inside the inner surface: bracing, or a ball in the hollow.
    tolerance
        Required relative error of mass and inertia.
    evaluation_limit
        Largest number of densities to evaluate; beyond it the result has `converged` False.
    needs_symmetry
        Stop when the asymmetry is certain, and have no result `converged` before it is.

    Returns
    -------
    MassDistribution

    """
    probe = DensityProbe(density, half_edge, evaluation_limit)
    depths = [0.0, thickness / inscribed_radius(half_edge)]
    if include_interior:
        depths.append(1.0)
    cells = _Cells(probe, np.array(depths), tolerance)
    cells.needs_symmetry = needs_symmetry
    while True:
        result = cells.result(half_edge)
        # Stop early if the asymmetry is far above the error.
        clearly_asymmetric = needs_symmetry and result.asymmetry > max(
            SYMMETRY_TOLERANCE, 100.0 * result.relative_error)
        if result.converged or clearly_asymmetric or probe.exhausted or not cells.refine():
            return result


class _Leaves(NamedTuple):
    """Triangles that together make up the reference triangle, with the moments over each."""

    corners: np.ndarray          # (k, 3, 2)
    areas: np.ndarray            # as shares of the whole, (k,)
    moments: np.ndarray          # (k, 10)
    quarter_moments: np.ndarray  # of the four quarters, (k, 4, 10)
    errors: np.ndarray           # estimates for `moments`, (k, 10)


class _Cells:
    """
    Leaves of the refinement of the reference triangle, each with its moments and their error.
    """

    def __init__(self, probe: DensityProbe, depths: np.ndarray, tolerance: float) -> None:
        self._probe = probe
        self.needs_symmetry = True
        self._depths = depths
        self._tolerance = tolerance
        self._panels = _PANELS
        self._images = _symmetric_images()
        # Image -> position of the image that stands for it in `_chosen`.
        self._chosen = np.arange(120)
        self._stand_in = np.arange(120)
        self._spot = 0
        self._seen: list[np.ndarray] = []
        self._grouped = False
        triangle = np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]])
        nodes, weights = triangle_rule(6)
        self._fine_nodes = _map_nodes(_quarters(triangle)[0], nodes).reshape(-1, 2)
        self._fine_weights = np.tile(weights / 4.0, 4)
        edge = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0], [0.5, 0.5], [0, 0.5]])
        self._boundary_nodes = edge + _INSET * (1.0 / 3.0 - edge)
        self._extrapolation = _monomials(
            np.concatenate([self._fine_nodes, self._boundary_nodes])) @ np.linalg.pinv(
            _monomials(self._fine_nodes))
        values, _ = self._direction_moments(nodes[None])
        self._leaves = self._integrate_leaves(
            triangle, np.ones(1), np.einsum('m,kmc->kc', weights, values))
        self._group_images()
        if probe.jump_seen:
            self._panels = int(min(_PANELS_LIMIT, max(
                _PANELS, np.ceil(_PANELS_WITH_JUMPS * (1e-6 / tolerance) ** (1.0 / 3.0)))))
            values, _ = self._direction_moments(nodes[None])
            self._leaves = self._integrate_leaves(
                triangle, np.ones(1), np.einsum('m,kmc->kc', weights, values))

    def _integrate_leaves(
            self, corners: np.ndarray, areas: np.ndarray, coarse: np.ndarray) -> '_Leaves':
        """Integrate over leaves; `coarse` holds their moments by the rule without quartering."""
        fine = self._fine_nodes.shape[0]
        values, ray_errors = self._direction_moments(
            _map_nodes(corners, np.concatenate([self._fine_nodes, self._boundary_nodes])))
        inner = values[:, :fine]
        quarters = areas[:, None, None] * np.einsum(
            'qm,kqmc->kqc', self._fine_weights.reshape(4, -1),
            inner.reshape(areas.size, 4, -1, 10))
        moments = quarters.sum(axis=1)
        # A value on the boundary counts only to the extent that the values inside fit a polynomial
        # better: otherwise the comparison of the two rules gives the error.
        fitted = np.einsum('bm,kmc->kbc', self._extrapolation, inner)
        misfit = np.abs(fitted[:, :fine] - inner).max(axis=1)
        surprise = np.abs(fitted[:, fine:] - values[:, fine:]).max(axis=1) - 20.0 * misfit
        errors = np.maximum(
            np.abs(coarse - moments),
            areas[:, None] * (0.5 * _UNSEEN_SHARE * np.maximum(surprise, 0.0)))
        errors += (areas * (ray_errors[:, :fine] @ self._fine_weights))[:, None]
        return _Leaves(corners, areas, moments, quarters, errors)

    def refine(self) -> bool:
        """Quarter the worst leaves; return False if no refinement would reduce the error."""
        leaves = self._leaves
        errors = (leaves.errors / self._scales()).max(axis=1)
        nodes = self._fine_nodes.shape[0] + self._boundary_nodes.shape[0]
        most = max(8, _RAYS_PER_PASS // ((self._chosen.size + 1) * nodes))
        worst = np.argsort(-errors, kind='stable')[:most]
        worst = worst[errors[worst] > max(
            0.05 * errors[worst[0]], 1e-3 * self._tolerance / errors.size)]
        worst = worst[leaves.areas[worst] > _SMALLEST_AREA]
        if not worst.size:
            return False
        added = self._integrate_leaves(
            _quarters(leaves.corners[worst]).reshape(-1, 3, 2),
            np.repeat(leaves.areas[worst] / 4.0, 4),
            leaves.quarter_moments[worst].reshape(-1, 10))
        if self._probe.exhausted:
            return False  # with the rays cut short the new leaves may be worse than the old
        self._leaves = _Leaves(*(
            np.concatenate([np.delete(old, worst, axis=0), new])
            for old, new in zip(leaves, added)))
        return True

    def result(self, half_edge: float) -> MassDistribution:
        total = self._leaves.moments.sum(axis=0)
        scales = self._scales()
        error = float((self._leaves.errors.sum(axis=0) / scales).max())
        xx, yy, zz, xy, xz, yz = total[4:]
        inertia = np.array([[yy + zz, -xy, -xz], [-xy, xx + zz, -yz], [-xz, -yz, xx + yy]])
        offset = float(np.abs(total[1:4] / scales[0]).max())
        principal = np.linalg.eigvalsh(inertia)
        asymmetry = max(offset, float((principal[2] - principal[0]) / scales[4]))
        # An asymmetry smaller than the error may be due to the error alone: refine further.
        certain = not self.needs_symmetry or (
            asymmetry <= SYMMETRY_TOLERANCE or asymmetry > error)
        a = half_edge
        return MassDistribution(
            mass=float(total[0]) * (a * a * a),
            centre_of_mass=a * total[1:4] / scales[0],
            inertia=inertia * (a * a * a * a * a),
            relative_error=error,
            asymmetry=asymmetry,
            converged=error <= self._tolerance and certain,
            evaluation_count=self._probe.count)

    def _scales(self) -> np.ndarray:
        """Return the scale of the error of each moment: the mass, or the mean inertia."""
        total = self._leaves.moments.sum(axis=0)
        tiny = np.finfo(float).tiny
        mass = max(float(total[0]), tiny)
        return np.repeat([mass, max(float(total[4:7].sum()) * 2.0 / 3.0, tiny)], [4, 6])

    def _direction_moments(self, coordinates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """
        Return moments per reference direction, (k, n, 10), summed over the images, and errors.

        Moments: 1, x, y, z, xx, yy, zz, xy, xz, yz, with lengths in units of a.
        """
        shape = coordinates.shape[:2]
        flat = coordinates.reshape(-1, 2)
        barycentric = np.column_stack([1.0 - flat.sum(axis=1), flat])
        moments, errors = np.empty((flat.shape[0], 10)), np.empty(flat.shape[0])
        step = max(1, _RAYS_PER_CALL // self._chosen.size)
        # det A of each sixth of a face (eq 33).
        jacobian = abs(float(np.linalg.det(self._images[0])))
        for start in range(0, flat.shape[0], step):
            part = slice(start, start + step)
            ends = np.einsum('nb,gbi->ngi', barycentric[part], self._images)
            radial, ray_errors = self._image_integrals(ends)
            x, y, z = np.moveaxis(ends, 2, 0)
            moments[part, 0] = radial[:, :, 0].sum(axis=1)
            moments[part, 1:4] = np.einsum('ng,ngi->ni', radial[:, :, 1], ends)
            products = np.stack([x * x, y * y, z * z, x * y, x * z, y * z], axis=2)
            moments[part, 4:] = np.einsum('ng,ngi->ni', radial[:, :, 2], products)
            # |x| < 2 in units of a, so a factor 4 covers all moments.
            errors[part] = 4.0 * ray_errors.sum(axis=1)
        return jacobian * moments.reshape(*shape, 10), jacobian * errors.reshape(shape)

    def _image_integrals(self, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """
        Return the integrals, (n, 120, 3), and errors, (n, 120), on rays that end at (n, 120, 3).
        """
        count = ends.shape[0]
        if self._chosen.size < 120:
            self._spot = (self._spot + 1) % 120
            spots = (self._spot + np.arange(count)) % 120
            row = np.arange(count)
            wanted = np.concatenate([ends[:, self._chosen], ends[row, spots][:, None]], axis=1)
            radial, errors = self._integrate(wanted)
            difference = np.abs(radial[:, -1] - radial[row, self._stand_in[spots]])
            if difference.max() <= _EQUAL_IMAGE_RATIO * self._largest_integral():
                return radial[:, self._stand_in], errors[:, self._stand_in]
            # The images differ on this ray. They were equal on all earlier ones.
            self._chosen = self._stand_in = np.arange(120)
        radial, errors = self._integrate(ends)
        if not self._grouped:
            self._seen.append(radial)
        return radial, errors

    def _group_images(self) -> None:
        """Let one image stand for all that agree with it on the rays seen so far."""
        seen = np.concatenate(self._seen)
        self._seen.clear()
        self._grouped = True
        chosen: list[int] = []
        stand_in = np.empty(120, dtype=int)
        for image in range(120):
            difference = np.abs(seen[:, chosen] - seen[:, image:image + 1]).max(axis=(0, 2))
            equal = np.flatnonzero(difference <= _EQUAL_IMAGE_RATIO * self._largest_integral())
            stand_in[image] = equal[0] if equal.size else len(chosen)
            if not equal.size:
                chosen.append(image)
        self._chosen, self._stand_in = np.array(chosen), stand_in

    def _largest_integral(self) -> float:
        return self._probe.largest * float(self._depths[-1])

    def _integrate(self, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        flat = ends.reshape(-1, 3)
        radial, errors = np.empty(flat.shape), np.empty(flat.shape[0])
        for start in range(0, flat.shape[0], _RAYS_PER_CALL):
            part = slice(start, start + _RAYS_PER_CALL)
            radial[part], errors[part] = integrate_rays(
                self._probe, flat[part], self._depths, 0.1 * self._tolerance,
                panels=self._panels)
        return radial.reshape(*ends.shape), errors.reshape(ends.shape[:2])


def _symmetric_images() -> np.ndarray:
    """
    Return the corners of the 120 sixths of the faces of the unit icosahedron, (120, 3, 3).

    Each is vertex, midpoint of an edge, centroid of a face: the images of any one under all
    rotations and reflections of the icosahedron.
    """
    images = []
    for triangle in outer_triangles(1.0):
        centroid = triangle.mean(axis=0)
        for i, j, _ in permutations(range(3)):
            images.append([triangle[i], (triangle[i] + triangle[j]) / 2.0, centroid])
    return np.array(images)


def _quarters(corners: np.ndarray) -> np.ndarray:
    """Return the four half-size triangles of each triangle, (k, 4, 3, 2)."""
    p, q, r = np.moveaxis(corners, 1, 0)
    pq, qr, rp = (p + q) / 2.0, (q + r) / 2.0, (r + p) / 2.0
    return np.stack([
        np.stack(triangle, axis=1)
        for triangle in ((p, pq, rp), (pq, q, qr), (rp, qr, r), (qr, rp, pq))], axis=1)


def _map_nodes(corners: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Map nodes of the unit triangle, (m, 2), to each triangle, (k, m, 2)."""
    origin = corners[:, :1]
    return origin + np.einsum('mc,kci->kmi', nodes, corners[:, 1:] - origin)


def _monomials(points: np.ndarray) -> np.ndarray:
    """Return all monomials up to degree 6 at the points, (m, 28)."""
    u, v = 2.0 * points.T - 1.0
    return np.stack([u ** i * v ** j for i in range(7) for j in range(7 - i)], axis=1)
