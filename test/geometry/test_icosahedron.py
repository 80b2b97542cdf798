# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Geometry and quadrature against exact arithmetic in Q(sqrt 5), SciPy, and integral theorems."""

from fractions import Fraction
from itertools import combinations, permutations
from math import factorial

from icofabric_sim.geometry import icosahedron as ico
from icofabric_sim.geometry.icosahedron import TAU
import numpy as np
import pytest
from scipy.integrate import tplquad
from scipy.spatial import ConvexHull

SCALES = (1e-3, 1.0, 1e3)
# The list of faces in the text, with a = 1 (the Maple listing has another order, erratum 5).
T = TAU
TEXT_FACES = np.array([
    [(0, -1, T), (0, 1, T), (-T, 0, 1)], [(0, -1, T), (0, 1, T), (T, 0, 1)],
    [(0, -1, T), (-T, 0, 1), (-1, -T, 0)], [(0, -1, T), (-1, -T, 0), (1, -T, 0)],
    [(0, -1, T), (1, -T, 0), (T, 0, 1)], [(0, 1, T), (-T, 0, 1), (-1, T, 0)],
    [(0, 1, T), (-1, T, 0), (1, T, 0)], [(0, 1, T), (1, T, 0), (T, 0, 1)],
    [(-T, 0, 1), (-1, -T, 0), (-T, 0, -1)], [(-T, 0, 1), (-1, T, 0), (-T, 0, -1)],
    [(T, 0, 1), (1, -T, 0), (T, 0, -1)], [(T, 0, 1), (1, T, 0), (T, 0, -1)],
    [(0, -1, -T), (-T, 0, -1), (-1, -T, 0)], [(0, -1, -T), (-1, -T, 0), (1, -T, 0)],
    [(0, -1, -T), (1, -T, 0), (T, 0, -1)], [(0, 1, -T), (-T, 0, -1), (-1, T, 0)],
    [(0, 1, -T), (-1, T, 0), (1, T, 0)], [(0, 1, -T), (1, T, 0), (T, 0, -1)],
    [(0, -1, -T), (0, 1, -T), (-T, 0, -1)], [(0, 1, -T), (0, -1, -T), (T, 0, -1)]])


# --- vertices, edges, faces ------------------------------------------------------------------

@pytest.mark.parametrize('a', SCALES)
def test_vertices_are_those_of_the_document(a):
    expected = set()
    for s in (-1, 1):
        for t in (-1, 1):
            expected |= {(0, s, t * TAU), (s, t * TAU, 0), (s * TAU, 0, t)}
    found = ico.vertices(a) / a
    assert found.shape == (12, 3)
    distance = np.linalg.norm(found[:, None] - np.array(sorted(expected)), axis=2)
    assert sorted(distance.argmin(axis=1)) == list(range(12))
    assert distance.min(axis=1).max() < 1e-15
    assert np.all(np.diff(found[:, 2]) <= 0)  # five heights, from the top downwards
    assert np.unique(np.round(found[:, 2], 12)).size == 5


def test_faces_are_the_convex_hull():
    hull = {tuple(sorted(face)) for face in ConvexHull(ico.vertices(1.0)).simplices.tolist()}
    assert {tuple(sorted(face)) for face in ico.FACES.tolist()} == hull
    assert len(hull) == 20


def test_faces_have_the_numbers_of_the_document():
    corners = ico.outer_triangles(1.0)
    for number in range(20):
        expected = {tuple(np.round(v, 12)) for v in TEXT_FACES[number]}
        assert {tuple(np.round(v, 12)) for v in corners[number]} == expected
        # Both lists begin each face with the same vertex.
        np.testing.assert_allclose(corners[number, 0], TEXT_FACES[number, 0], atol=1e-15)


def test_all_faces_are_right_handed_and_eleven_of_the_text_are_not():
    """Erratum 5."""
    assert np.all(ico.face_geometry(1.0).determinants > 0.0)
    w1 = TEXT_FACES[:, 0]
    volume = np.einsum(
        'fi,fi->f', w1, np.cross(TEXT_FACES[:, 1] - w1, TEXT_FACES[:, 2] - w1))
    left_handed = (np.flatnonzero(volume < 0) + 1).tolist()
    assert left_handed == [2, 6, 7, 8, 9, 12, 13, 14, 15, 19, 20]


def test_height_classes():
    assert len(ico.FACE_HEIGHT_NAMES) == 5
    # The document's headings; within two of the classes the centroids have two heights.
    expected = ({2 * TAU + 1}, {TAU, TAU + 1}, {0.0}, {-TAU, -TAU - 1}, {-2 * TAU - 1})
    sums = np.round(ico.outer_triangles(1.0)[:, :, 2].sum(axis=1), 12)
    for height_class, (count, values) in enumerate(zip((2, 6, 4, 6, 2), expected)):
        inside = sums[ico.FACE_HEIGHT_CLASSES == height_class]
        assert inside.size == count
        assert set(inside) == {round(value, 12) for value in values}
    assert np.all(np.diff(ico.FACE_HEIGHT_CLASSES) >= 0)
    # Seven heights in all (erratum 19).
    heights, counts = np.unique(sums, return_counts=True)
    assert heights == pytest.approx(
        [-2 * TAU - 1, -TAU - 1, -TAU, 0.0, TAU, TAU + 1, 2 * TAU + 1], abs=1e-12)
    assert counts.tolist() == [2, 4, 2, 4, 2, 4, 2]


@pytest.mark.parametrize('a', SCALES)
def test_edges_are_thirty_of_length_two_a(a):
    """Erratum 17: the comment of the Maple listing says a, its code 2a."""
    x = ico.vertices(a)
    ends = x[ico.EDGES]
    np.testing.assert_allclose(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1), 2 * a, rtol=1e-15)
    near = [pair for pair in combinations(range(12), 2)
            if np.linalg.norm(x[pair[0]] - x[pair[1]]) < 2.5 * a]
    assert near == [tuple(edge) for edge in ico.EDGES.tolist()]
    assert len(near) == 30


def test_named_edges():
    assert ico.NAMED_EDGES == ('up', 'down', 'north', 'south', 'west', 'east')
    a = 0.01
    x = ico.vertices(a)
    ends = x[ico.NAMED_EDGE_VERTICES]
    np.testing.assert_allclose(ends.mean(axis=1), ico.edge_midpoints(a), atol=1e-17)
    expected = {'up': (0, 0, 1), 'down': (0, 0, -1), 'north': (1, 0, 0), 'south': (-1, 0, 0),
                'west': (0, 1, 0), 'east': (0, -1, 0)}
    for code, name in enumerate(ico.NAMED_EDGES):
        np.testing.assert_allclose(
            ico.edge_midpoints(a)[code], TAU * a * np.array(expected[name]), atol=1e-17)
        assert sorted(ico.NAMED_EDGE_VERTICES[code].tolist()) in ico.EDGES.tolist()
        for number in ico.NAMED_EDGE_FACES[code]:
            assert set(ico.NAMED_EDGE_VERTICES[code]) <= set(ico.FACES[number - 1])
    np.testing.assert_allclose(
        (ends[:, 1] - ends[:, 0]) / (2 * a), ico.NAMED_EDGE_TANGENTS, atol=1e-15)
    assert len({tuple(pair) for pair in ico.NAMED_EDGE_FACES.tolist()}) == 6


def test_tables_are_read_only():
    for table in (ico.FACES, ico.EDGES, ico.NAMED_EDGE_DIRECTIONS, ico.face_geometry(1.0).frames):
        with pytest.raises(ValueError, match='read-only'):
            table[0] = 0


# --- frames and first fundamental form -------------------------------------------------------

@pytest.mark.parametrize('a', SCALES)
def test_face_frames(a):
    faces = ico.face_geometry(a)
    assert ico.face_geometry(a) is faces  # computed once
    corners = ico.outer_triangles(a)
    np.testing.assert_allclose(faces.frames[:, :, 0], corners[:, 0], rtol=1e-15)
    np.testing.assert_allclose(faces.frames[:, :, 1], corners[:, 1] - corners[:, 0], rtol=1e-15)
    np.testing.assert_allclose(faces.frames[:, :, 2], corners[:, 2] - corners[:, 0], rtol=1e-15)
    np.testing.assert_allclose(
        faces.frames @ faces.inverses, np.broadcast_to(np.eye(3), (20, 3, 3)), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(faces.frames), faces.determinants, rtol=1e-13)
    np.testing.assert_allclose(faces.determinants, 2 * TAU ** 2 * a ** 3, rtol=1e-14)


@pytest.mark.parametrize('a', SCALES)
def test_normals_and_areas(a):
    faces = ico.face_geometry(a)
    np.testing.assert_allclose(np.linalg.norm(faces.normals, axis=1), 1.0, rtol=1e-14)
    # Parallel to the centroid, and every other vertex lies behind the face.
    np.testing.assert_allclose(
        faces.normals * ico.inscribed_radius(a), faces.centroids, atol=1e-14 * a)
    height = ico.vertices(a) @ faces.normals.T
    assert height.max() < ico.inscribed_radius(a) * (1 + 1e-14)
    np.testing.assert_allclose(faces.first_fundamental_form / a ** 2, [[4, 2, 4]] * 20, rtol=1e-14)
    # An equilateral triangle of edge 2a has the area sqrt(3) a^2.
    np.testing.assert_allclose(faces.area_elements / 2, np.sqrt(3) * a ** 2, rtol=1e-14)


def test_radii():
    """Erratum 18: a tau^2 / sqrt(3) belongs to a sphere; the circle in a face has a / sqrt(3)."""
    assert ico.inscribed_radius(1.0) == pytest.approx(1.511522628, abs=5e-10)
    assert ico.inscribed_radius(1.0) == pytest.approx(np.sqrt(2 / 3 + TAU), rel=1e-15)
    corners = ico.outer_triangles(1.0)
    np.testing.assert_allclose(
        np.linalg.norm(corners.mean(axis=1), axis=1), ico.inscribed_radius(1.0), rtol=1e-15)
    to_edge = np.linalg.norm(
        corners.mean(axis=1) - (corners[:, 0] + corners[:, 1]) / 2, axis=1)
    np.testing.assert_allclose(to_edge, 1 / np.sqrt(3), rtol=1e-14)
    np.testing.assert_allclose(
        np.linalg.norm(ico.vertices(1.0), axis=1), ico.circumscribed_radius(1.0), rtol=1e-15)
    middle = ico.vertices(1.0)[ico.EDGES].mean(axis=1)
    np.testing.assert_allclose(np.linalg.norm(middle, axis=1), ico.midradius(1.0), rtol=1e-15)


def test_printed_domain_of_a_face_is_no_triangle():
    """Erratum 2: 0 <= l2 + l3 <= 1 alone admits points far outside the icosahedron."""
    faces = ico.face_geometry(1.0)
    coordinates = np.array([[3.0, -2.5]])
    assert 0.0 <= coordinates.sum() <= 1.0
    outside = ico.face_points(1.0, coordinates)[:, 0]
    assert np.all((outside @ faces.normals.T).max(axis=1) > 1.5 * ico.inscribed_radius(1.0))
    inside, _ = ico.face_quadrature(1.0, degree=6)
    reach = (inside.reshape(-1, 3) @ faces.normals.T).max(axis=1)
    np.testing.assert_allclose(reach, ico.inscribed_radius(1.0), rtol=1e-14)


def test_printed_derivatives_are_wrong():
    """Erratum 3: dx/dl2 = w2, as finite differences say too; w2 - w1 is far off."""
    faces = ico.face_geometry(1.0)
    w1, w2, w3 = np.moveaxis(faces.frames, 2, 0)
    lower = ico.face_points(1.0, np.array([[0.25, 0.25]]))
    right = ico.face_points(1.0, np.array([[0.75, 0.25]]))
    np.testing.assert_allclose(((right - lower) / 0.5)[:, 0], w2, atol=1e-14)
    printed = np.cross(w2 - w1, w3 - w1)
    printed_area = np.linalg.norm(printed, axis=1)
    assert np.all(np.abs(printed_area - faces.area_elements) > 0.5)
    off = np.linalg.norm(printed / printed_area[:, None] - faces.normals, axis=1)
    assert off.max() > 0.4


def test_printed_face_integrand_is_wrong():
    """Erratum 4: at lambda1 = 1 - l2 - l3 the point leaves the face, and div x = 3 fails."""
    faces = ico.face_geometry(1.0)
    coordinates, weights = ico.triangle_rule(4)
    first = 1.0 - coordinates.sum(axis=1)
    volume = 10 * (1 + np.sqrt(5) / 3)
    flux = {}
    for name, lambda1 in (('corrected', np.ones_like(first)), ('printed', first)):
        lambdas = np.column_stack([lambda1, coordinates])
        x = np.einsum('fic,mc->fmi', faces.frames, lambdas)
        flux[name] = np.einsum('m,fmi,fi->', weights, x, faces.normals) * faces.area_elements[0]
    assert flux['corrected'] == pytest.approx(3 * volume, rel=1e-14)
    assert flux['printed'] == pytest.approx(volume, rel=1e-13)  # a third of it


# --- exact monomial integrals in Q(sqrt 5) ---------------------------------------------------

class Surd:
    """p + q sqrt(5) with rational p and q."""

    def __init__(self, p=0, q=0):
        self.p, self.q = Fraction(p), Fraction(q)

    def __add__(self, other):
        return Surd(self.p + other.p, self.q + other.q)

    def __sub__(self, other):
        return Surd(self.p - other.p, self.q - other.q)

    def __mul__(self, other):
        return Surd(self.p * other.p + 5 * self.q * other.q, self.p * other.q + self.q * other.p)

    def __float__(self):
        # Without cancellation: p + q sqrt(5) = (p^2 - 5 q^2) / (p - q sqrt(5)).
        p, q = self.p, self.q
        if p * q >= 0:
            return float(p) + float(q) * 5 ** 0.5
        return float(p * p - 5 * q * q) / (float(p) - float(q) * 5 ** 0.5)


EXACT = {0.0: Surd(), 1.0: Surd(1), -1.0: Surd(-1),
         TAU: Surd(Fraction(1, 2), Fraction(1, 2)), -TAU: Surd(Fraction(-1, 2), Fraction(-1, 2))}


def _multiply(p, q):
    product = {}
    for i, x in p.items():
        for j, y in q.items():
            key = tuple(m + n for m, n in zip(i, j))
            product[key] = product.get(key, Surd()) + x * y
    return product


def _exact_monomials(degree):
    """
    Exact integrals over each solid pyramid (centre, face) with a = 1 for all exponents.

    x_i is linear in the barycentric coordinates of the face, and over the simplex
    integral l1^p l2^q l3^r = p! q! r! / (p + q + r + 3)! times the determinant (Dirichlet).
    """
    unit = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    result = {}
    for triangle in ico.outer_triangles(1.0).tolist():
        corners = [[EXACT[value] for value in vertex] for vertex in triangle]
        linear = [{unit[c]: corners[c][i] for c in range(3)} for i in range(3)]
        (a, b, c), (d, e, f), (g, h, i) = corners
        det = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
        powers = [[{(0, 0, 0): Surd(1)}] for _ in range(3)]
        for axis in range(3):
            for _ in range(degree):
                powers[axis].append(_multiply(powers[axis][-1], linear[axis]))
        for p in range(degree + 1):
            for q in range(degree + 1 - p):
                plane = _multiply(powers[0][p], powers[1][q])
                for r in range(degree + 1 - p - q):
                    total = Surd()
                    for key, value in _multiply(plane, powers[2][r]).items():
                        weight = Fraction(
                            factorial(key[0]) * factorial(key[1]) * factorial(key[2]),
                            factorial(sum(key) + 3))
                        total = total + value * Surd(weight)
                    result.setdefault((p, q, r), []).append(total * det)
    return result


@pytest.fixture(scope='module')
def exact_monomials():
    return _exact_monomials(5)


@pytest.mark.parametrize('ratio', [0.0, 0.3, 0.9, 0.999])
def test_volume_integrals_of_monomials(exact_monomials, ratio):
    exponents = np.array(list(exact_monomials))
    found = ico.integrate_volume(
        lambda x: np.prod(x[:, None, :] ** exponents, axis=2), 1.0, ratio, degree=5)
    for (key, faces), value in zip(exact_monomials.items(), found):
        total = Surd()
        for face in faces:
            total = total + face
        # Homogeneous: the frustum is the pyramid less the one scaled by b/a.
        share = 1.0 - ratio ** (sum(key) + 3)
        assert value == pytest.approx(float(total) * share, rel=1e-12, abs=1e-13 * share), key
    assert np.count_nonzero(np.abs(found) > 1e-3 * (1 - ratio)) >= 10


def test_face_integrals_of_monomials(exact_monomials):
    # Over a pyramid of height h: integral = h / (degree + 3) times the one over its base.
    exponents = np.array(list(exact_monomials))
    for number in (1, 7, 12, 20):
        found = ico.integrate_face(
            lambda x: np.prod(x[:, None, :] ** exponents, axis=2), number, 1.0, degree=5)
        for (key, faces), value in zip(exact_monomials.items(), found):
            expected = float(faces[number - 1]) * (sum(key) + 3) / ico.inscribed_radius(1.0)
            assert value == pytest.approx(expected, rel=1e-12, abs=1e-13), key


@pytest.mark.parametrize('degree', range(13))
def test_triangle_rule_is_exact_up_to_its_degree(degree):
    points, weights = ico.triangle_rule(degree)
    assert np.all(points > 0) and np.all(points.sum(axis=1) < 1) and np.all(weights > 0)
    for p in range(degree + 1):
        for q in range(degree + 1 - p):
            exact = factorial(p) * factorial(q) / factorial(p + q + 2)
            found = weights @ (points[:, 0] ** p * points[:, 1] ** q)
            assert found == pytest.approx(exact, rel=1e-13)


def test_degree_matters():
    """A rule of too low a degree misses, so the tests above are no accident."""
    def high(x):
        return x[:, 0] ** 6

    good = ico.integrate_volume(high, 1.0, 0.4, degree=6)
    assert ico.integrate_volume(high, 1.0, 0.4, degree=20) == pytest.approx(good, rel=1e-13)
    assert abs(ico.integrate_volume(high, 1.0, 0.4, degree=2) / good - 1) > 1e-4


# --- independent integrals and theorems ------------------------------------------------------

def test_frustum_against_scipy():
    """Eq 34 as printed (it has no erratum), for a function that is no polynomial."""
    b, number = 0.6, 5
    frame = ico.face_geometry(1.0).frames[number - 1]

    def f(x):
        return np.exp(0.4 * x[..., 0] - 0.3 * x[..., 1]) * np.cos(x[..., 2])

    expected, _ = tplquad(
        lambda l3, l2, l1: f(frame @ (l1, l2, l3)), b, 1.0, 0.0, lambda l1: l1, 0.0,
        lambda l1, l2: l1 - l2, epsabs=1e-11, epsrel=1e-11)
    points, weights = ico.volume_quadrature(1.0, b, degree=16)
    assert weights @ f(points[number - 1]) == pytest.approx(
        expected * np.linalg.det(frame), rel=1e-11)


@pytest.mark.parametrize('a', SCALES)
def test_divergence_theorem(a):
    """The flux through both surfaces equals the integral of the divergence, for several fields."""
    b = 0.35 * a
    normals = ico.face_geometry(a).normals

    def field(x):
        x, y, z = (x / a).T
        return np.stack([x ** 3 * y + z, y ** 3 * x ** 2 - 2 * y, z * y ** 2 + x ** 4], axis=1)

    def divergence(x):
        x, y, z = (x / a).T
        return (3 * x ** 2 * y + 3 * y ** 2 * x ** 2 - 2 + y ** 2) / a

    def flux(edge):
        return sum(ico.integrate_face(lambda x, n=normal: field(x) @ n, number + 1, edge)
                   for number, normal in enumerate(normals))

    volume = ico.integrate_volume(divergence, a, b)
    assert flux(a) - flux(b) == pytest.approx(volume, rel=1e-12)
    assert abs(volume) > a ** 2


@pytest.mark.parametrize('a', SCALES)
def test_closed_surface_and_closed_forms(a):
    faces = ico.face_geometry(a)
    ones = ico.integrate_faces(lambda x: np.ones(len(x)), a)
    assert ones == pytest.approx(20 * np.sqrt(3) * a ** 2, rel=1e-14)
    force = sum(ico.integrate_face(lambda x: np.ones(len(x)), n + 1, a) * faces.normals[n]
                for n in range(20))
    np.testing.assert_allclose(force / a ** 2, 0.0, atol=1e-13)  # uniform pressure: no force
    b = 0.7 * a
    volume = ico.integrate_volume(lambda x: np.ones(len(x)), a, b)
    assert volume == pytest.approx(10 * (1 + np.sqrt(5) / 3) * (a ** 3 - b ** 3), rel=1e-13)
    # eqs 43-44 by eq 12: all six integrals at once.
    tensor = ico.integrate_volume(
        lambda x: ((x ** 2).sum(axis=1)[:, None, None] * np.eye(3)
                   - x[:, :, None] * x[:, None, :]).reshape(-1, 9), a, b).reshape(3, 3)
    expected = 4 * (7 / 3 + np.sqrt(5)) * (a ** 5 - b ** 5)
    np.testing.assert_allclose(tensor, expected * np.eye(3), rtol=1e-13, atol=1e-13 * expected)


def test_maple_output_has_a_to_the_fifth():
    """
    Erratum 16: the printed a^-5 is a~^5; with it the printed expressions equal eqs 42 and 44.
    """
    a, b, s = 1.3, 0.8, np.sqrt(5)

    def printed(power):
        x = a ** power
        return -16 / 3 * (-7 * x + 7 * b ** 5 - 3 * s * x + 3 * s * b ** 5) / ((s - 1) * (s + 1))

    expected = 4 * (7 / 3 + s) * (a ** 5 - b ** 5)
    assert printed(5) == pytest.approx(expected, rel=1e-13)
    assert abs(printed(-5) / expected - 1) > 0.5


def test_thin_shell_keeps_its_digits():
    a = 1.0
    for thickness in (1e-6, 1e-9):
        b = a - thickness
        found = ico.integrate_volume(lambda x: np.ones(len(x)), a, b)
        expected = 10 * (1 + np.sqrt(5) / 3) * (a - b) * (a * a + a * b + b * b)
        assert found == pytest.approx(expected, rel=1e-14)


def test_faces_can_be_chosen_and_are_congruent():
    def f(x):
        return np.column_stack([np.ones(len(x)), (x ** 2).sum(axis=1)])

    each = np.array([ico.integrate_face(f, number, 0.01) for number in range(1, 21)])
    np.testing.assert_allclose(each, np.broadcast_to(each[0], each.shape), rtol=1e-13)
    chosen = ico.integrate_faces(f, 0.01, face_numbers=(3, 9, 20))
    np.testing.assert_allclose(chosen, 3 * each[0], rtol=1e-13)
    np.testing.assert_allclose(ico.integrate_faces(f, 0.01), each.sum(axis=0), rtol=1e-13)


def test_face_coordinates_belong_to_the_points():
    coordinates, _ = ico.triangle_rule(7)
    points, _ = ico.face_quadrature(0.01, degree=7)
    lambdas = np.einsum('fci,fmi->fmc', ico.face_geometry(0.01).inverses, points)
    np.testing.assert_allclose(lambdas[:, :, 0], 1.0, rtol=1e-13)
    np.testing.assert_allclose(
        lambdas[:, :, 1:], np.broadcast_to(coordinates, (20, *coordinates.shape)), atol=1e-14)


# --- symmetry --------------------------------------------------------------------------------

def test_cyclic_exchange_of_axes_keeps_the_body():
    x = ico.vertices(1.0)
    keeping = []
    for order in permutations(range(3)):
        image = x[:, order]
        distance = np.linalg.norm(image[:, None] - x[None], axis=2).min(axis=1)
        if distance.max() < 1e-15:
            keeping.append(order)
    assert keeping == [(0, 1, 2), (1, 2, 0), (2, 0, 1)]


# --- refusals --------------------------------------------------------------------------------

@pytest.mark.parametrize('edge', [0.0, -1.0, float('nan'), float('inf')])
def test_bad_edge_is_refused(edge):
    with pytest.raises(ValueError, match='half_edge'):
        ico.integrate_volume(lambda x: x[:, 0], edge, 0.0)
    with pytest.raises(ValueError, match='half_edge'):
        ico.integrate_face(lambda x: x[:, 0], 1, edge)


@pytest.mark.parametrize('inner', [1.0, 1.5, -0.1, float('nan')])
def test_bad_inner_edge_is_refused(inner):
    with pytest.raises(ValueError, match='inner_half_edge'):
        ico.integrate_volume(lambda x: x[:, 0], 1.0, inner)


@pytest.mark.parametrize('number', [0, 21, -1])
def test_bad_face_number_is_refused(number):
    with pytest.raises(ValueError, match='1 to 20'):
        ico.integrate_face(lambda x: x[:, 0], number, 1.0)


def test_bad_function_and_degree_are_refused():
    with pytest.raises(ValueError, match='shape'):
        ico.integrate_volume(lambda x: x[:, 0].sum(), 1.0, 0.5)
    with pytest.raises(ValueError, match='degree'):
        ico.integrate_volume(lambda x: x[:, 0], 1.0, 0.5, degree=-1)
