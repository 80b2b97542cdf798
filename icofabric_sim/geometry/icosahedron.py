# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Geometry of the icosahedron in its body frame, and integration over its faces and volume.

Source: "A Mathematical Model of Icosahedral Materials", eqs 28-41. Where the document has an error
(docs/errata.md), the corrected form is used and cited as "eq 37, corrected". `half_edge` is a,
half the outer edge [m]; the body axes pass through the midpoints of three perpendicular pairs of
edges.
"""

from functools import lru_cache
import math
from typing import Callable, Final, NamedTuple, Sequence

import numpy as np

Function = Callable[[np.ndarray], np.ndarray]

TAU: Final = (1.0 + math.sqrt(5.0)) / 2.0


def _constant(values: object, dtype: type = np.float64) -> np.ndarray:
    array: np.ndarray = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


# From the top downwards: 2, 2, 4, 2, 2 vertices of equal height.
_UNIT_VERTICES: Final = _constant([
    [0, -1, TAU], [0, 1, TAU],
    [-TAU, 0, 1], [TAU, 0, 1],
    [-1, -TAU, 0], [-1, TAU, 0], [1, -TAU, 0], [1, TAU, 0],
    [-TAU, 0, -1], [TAU, 0, -1],
    [0, -1, -TAU], [0, 1, -TAU]])

# Vertex numbers of face 1, ..., 20 (row = face number - 1) in the order of the document's Maple
# listing: counter-clockwise seen from outside, so that w1, w2, w3 are right-handed as eq 33
# requires. The list in its text has 11 left-handed faces.
FACES: Final = _constant([
    [0, 1, 2], [0, 3, 1],
    [0, 2, 4], [0, 4, 6], [0, 6, 3], [1, 5, 2], [1, 7, 5], [1, 3, 7],
    [2, 8, 4], [2, 5, 8], [3, 6, 9], [3, 9, 7],
    [10, 4, 8], [10, 6, 4], [10, 9, 6], [11, 8, 5], [11, 5, 7], [11, 7, 9],
    [10, 8, 11], [11, 9, 10]], np.int32)

# The document's grouping as printed; there are seven heights (docs/errata.md, C19).
FACE_HEIGHT_NAMES: Final = ('top', 'second highest', 'third highest', 'fourth highest', 'bottom')
FACE_HEIGHT_CLASSES: Final = _constant(np.repeat(np.arange(5), (2, 6, 4, 6, 2)), np.int8)

# Vertex numbers of the 30 edges, the lower number first, sorted.
EDGES: Final = _constant(
    sorted({tuple(sorted((int(face[i]), int(face[i - 1])))) for face in FACES for i in range(3)}),
    np.int32)

# The six edges where connectors attach, by edge code 0-5 (int8 in every table).
NAMED_EDGES: Final = ('up', 'down', 'north', 'south', 'west', 'east')
# Outward unit directions to their midpoints, in body axes.
NAMED_EDGE_DIRECTIONS: Final = _constant([
    [0, 0, 1], [0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
# Vertex numbers of their ends, the lower number first.
NAMED_EDGE_VERTICES: Final = _constant(
    [[0, 1], [10, 11], [3, 9], [2, 8], [5, 7], [4, 6]], np.int32)
# Unit vectors along these edges, from the first vertex to the second.
NAMED_EDGE_TANGENTS: Final = _constant([
    [0, 1, 0], [0, 1, 0], [0, 0, -1], [0, 0, -1], [1, 0, 0], [1, 0, 0]])
# Numbers (1-20) of the two faces that meet at each of them.
NAMED_EDGE_FACES: Final = _constant([
    [number + 1 for number in range(20) if set(ends) <= set(FACES[number].tolist())]
    for ends in NAMED_EDGE_VERTICES.tolist()], np.int32)


def vertices(half_edge: float) -> np.ndarray:
    """Return the 12 vertices in body axes [m], (12, 3), in the order to which FACES refers."""
    return half_edge * _UNIT_VERTICES


def edge_midpoints(half_edge: float) -> np.ndarray:
    """Return the midpoints of the six named edges in body axes [m], (6, 3), by edge code."""
    return midradius(half_edge) * NAMED_EDGE_DIRECTIONS


def outer_triangles(half_edge: float) -> np.ndarray:
    """Return the corners of the faces [m], (20, 3, 3), counter-clockwise seen from outside."""
    return vertices(half_edge)[FACES]


def inscribed_radius(half_edge: float) -> float:
    """
    Return the radius of the sphere that touches the faces [m]: a tau^2 / sqrt(3).

    It equals a sqrt(2/3 + tau) of eq 41, which the text calls the radius of a circle.
    """
    return half_edge * (TAU * TAU / math.sqrt(3.0))


def midradius(half_edge: float) -> float:
    """Return the radius of the sphere that touches the edges [m], half the width w: tau a."""
    return half_edge * TAU


def circumscribed_radius(half_edge: float) -> float:
    """Return the radius of the sphere through the vertices [m]: a sqrt(1 + tau^2)."""
    return half_edge * math.sqrt(1.0 + TAU * TAU)


class FaceGeometry(NamedTuple):
    """
    Constants of the 20 faces (row = face number - 1), read-only arrays.

    A point is x = A lambda, and lies on the face when lambda1 = 1, lambda2 >= 0, lambda3 >= 0,
    lambda2 + lambda3 <= 1 (eqs 28 and 35, corrected).
    """

    frames: np.ndarray          # A, columns w1, w2, w3 [m], (20, 3, 3): eqs 29-31
    inverses: np.ndarray        # A^-1 [1/m], (20, 3, 3): eq 32
    determinants: np.ndarray    # det A = 2 tau^2 a^3 [m^3], (20,): eq 33
    normals: np.ndarray         # outward unit normals, (20, 3): eqs 36 and 37, corrected
    first_fundamental_form: np.ndarray  # E, F, G [m^2], (20, 3): eq 38
    area_elements: np.ndarray   # sqrt(E G - F^2) [m^2], twice the area, (20,): eq 39
    centroids: np.ndarray       # [m], (20, 3)


@lru_cache(maxsize=32)
def face_geometry(half_edge: float) -> FaceGeometry:
    """Return the constants of the faces in body axes, computed once for each edge length."""
    # Computed in units of a, to avoid underflow and overflow.
    corners = outer_triangles(1.0)
    w1 = corners[:, 0]
    w2, w3 = corners[:, 1] - w1, corners[:, 2] - w1
    # eq 37, corrected: dx/dlambda2 = w2 and dx/dlambda3 = w3, which are differences already.
    area_vectors = np.cross(w2, w3)
    determinants = np.einsum('fi,fi->f', w1, area_vectors)
    first_form = np.stack([
        np.einsum('fi,fi->f', p, q) for p, q in ((w2, w2), (w2, w3), (w3, w3))], axis=1)
    area_elements = np.sqrt(first_form[:, 0] * first_form[:, 2] - first_form[:, 1] ** 2)
    inverses = np.stack([area_vectors, np.cross(w3, w1), np.cross(w1, w2)], axis=1)
    inverses /= determinants[:, None, None]
    a = float(half_edge)
    return FaceGeometry(
        frames=_constant(a * np.stack([w1, w2, w3], axis=2)),
        inverses=_constant(inverses / a),
        determinants=_constant(a * a * a * determinants),
        normals=_constant(area_vectors / area_elements[:, None]),
        first_fundamental_form=_constant(a * a * first_form),
        area_elements=_constant(a * a * area_elements),
        centroids=_constant(a * corners.mean(axis=1)))


def face_points(half_edge: float, coordinates: np.ndarray) -> np.ndarray:
    """
    Return x(1, lambda2, lambda3) on every face [m], (20, m, 3), for coordinates (m, 2) (eq 31).
    """
    frames = face_geometry(half_edge).frames
    return frames[:, None, :, 0] + np.einsum('fic,mc->fmi', frames[:, :, 1:], coordinates)


@lru_cache(maxsize=64)
def triangle_rule(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """
    Return points (lambda2, lambda3), (m, 2), and weights, (m,), on the unit triangle.

    Exact for polynomials of total degree up to `degree`; the weights add up to 1/2. It is the
    product of two Gauss rules on the square, collapsed to the triangle by
    lambda2 = u, lambda3 = (1 - u) v, whose Jacobian 1 - u costs one degree in u (A. H. Stroud,
    Approximate Calculation of Multiple Integrals, 1971, section 2.4).
    """
    u, u_weights = _gauss(degree + 1)
    v, v_weights = _gauss(degree)
    points = np.stack([
        np.repeat(u, v.size), np.outer(1.0 - u, v).ravel()], axis=1)
    return _constant(points), _constant(np.outer(u_weights * (1.0 - u), v_weights).ravel())


def face_quadrature(half_edge: float, *, degree: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """
    Return points in body axes [m], (20, m, 3), and weights [m^2], (m,), the same on every face.

    The points belong to the face coordinates that `triangle_rule(degree)` lists. eq 40,
    corrected: the integrand is taken at x(1, lambda2, lambda3).
    """
    coordinates, weights = triangle_rule(degree)
    # All faces are congruent, so one area element serves for all.
    return (face_points(half_edge, coordinates),
            weights * face_geometry(half_edge).area_elements[0])


def integrate_face(
        function: Function, face_number: int, half_edge: float, *,
        degree: int = 8) -> float | np.ndarray:
    """
    Integrate a function of the position over one outer face (eq 40, corrected).

    Parameters
    ----------
    function
        Takes points in body axes [m], (m, 3); returns (m,) or (m, k).
    face_number
        1 to 20, as in the document.
    half_edge
        a [m].
    degree
        The result is exact for polynomials up to this total degree.

    Returns
    -------
    float, or (k,) for a function of k values; its unit times m^2.
    """
    return integrate_faces(function, half_edge, face_numbers=(face_number,), degree=degree)


def integrate_faces(
        function: Function, half_edge: float, *, face_numbers: Sequence[int] = range(1, 21),
        degree: int = 8) -> float | np.ndarray:
    """Integrate over several outer faces, all by default, and add up; see `integrate_face`."""
    for number in face_numbers:
        if number not in range(1, 21):
            raise ValueError(f'face numbers run from 1 to 20, got {number!r}')
    _check_lengths(half_edge, 0.0)
    points, weights = face_quadrature(half_edge, degree=degree)
    chosen = points[np.asarray(face_numbers, dtype=int) - 1].reshape(-1, 3)
    return _weighted_sum(function, chosen, np.tile(weights, len(face_numbers)))


def volume_quadrature(
        half_edge: float, inner_half_edge: float, *,
        degree: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """
    Return points in body axes [m], (20, m, 3), and weights [m^3], (m,), of the 20 frusta.

    eq 34 with lambda2 and lambda3 divided by lambda1: each frustum is the face times the depth
    1 - lambda1, which runs from 0 to 1 - b/a, with Jacobian det A lambda1^2.
    """
    on_face, face_weights = triangle_rule(degree)
    nodes, node_weights = _gauss(degree + 2)
    # Depth rather than lambda1 itself keeps full precision for thin shells.
    relative_thickness = (half_edge - inner_half_edge) / half_edge
    radial = 1.0 - relative_thickness * nodes
    points = np.einsum('r,fmi->frmi', radial, face_points(half_edge, on_face))
    radial_weights = relative_thickness * node_weights * radial ** 2
    weights = np.outer(radial_weights, face_weights).ravel()
    return points.reshape(20, -1, 3), weights * face_geometry(half_edge).determinants[0]


def integrate_volume(
        function: Function, half_edge: float, inner_half_edge: float, *,
        degree: int = 8) -> float | np.ndarray:
    """
    Integrate a function of the position over the shell between two icosahedra (eqs 33-34).

    Parameters
    ----------
    function
        Takes points in body axes [m], (m, 3); returns (m,) or (m, k).
    half_edge, inner_half_edge
        a and b [m]; b = 0 gives the solid icosahedron.
    degree
        The result is exact for polynomials up to this total degree. There is no error
        estimate: for a function that is no polynomial compare two degrees, and for a mass
        distribution use `mass_distribution.integrate_density`, which estimates its error.

    Returns
    -------
    float, or (k,) for a function of k values; its unit times m^3.
    """
    _check_lengths(half_edge, inner_half_edge)
    points, weights = volume_quadrature(half_edge, inner_half_edge, degree=degree)
    return _weighted_sum(function, points.reshape(-1, 3), np.tile(weights, 20))


@lru_cache(maxsize=64)
def _gauss(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the Gauss-Legendre rule on [0, 1] that is exact up to the degree."""
    if not degree >= 0:
        raise ValueError(f'degree must not be negative, got {degree!r}')
    nodes, weights = np.polynomial.legendre.leggauss(degree // 2 + 1)
    return (1.0 + nodes) / 2.0, weights / 2.0


def _check_lengths(half_edge: float, inner_half_edge: float) -> None:
    if not 0.0 < half_edge < math.inf:
        raise ValueError(f'half_edge must be positive and finite, got {half_edge!r} m')
    if not 0.0 <= inner_half_edge < half_edge:
        raise ValueError(
            f'inner_half_edge must lie in 0 <= b < half_edge = {half_edge!r} m, '
            f'got {inner_half_edge!r} m')


def _weighted_sum(
        function: Function, points: np.ndarray, weights: np.ndarray) -> float | np.ndarray:
    values = np.asarray(function(points), dtype=np.float64)
    if values.ndim not in (1, 2) or values.shape[0] != points.shape[0]:
        raise ValueError(
            f'the function must return ({points.shape[0]},) or ({points.shape[0]}, k) values '
            f'for ({points.shape[0]}, 3) points, got shape {values.shape}')
    total = weights @ values
    return float(total) if values.ndim == 1 else total
