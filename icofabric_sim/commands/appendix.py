# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Appendix of the document: ten integrals over the frustum of each face, in exact arithmetic.

Source: the Maple listing of "A Mathematical Model of Icosahedral Materials". Vertices and faces
come from `geometry/icosahedron.py`. With x = A lambda (eq 31) the integrands are polynomials of
lambda, so eq 34 gives numbers p + q sqrt(5) with rational p and q. Checks compare them with the
closed forms, with the Maple output and with Gauss quadrature.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import factorial, lcm, sqrt
import sys
from typing import Any, NamedTuple

from icofabric_sim.commands.document_tables import align_rows, indent_text
from icofabric_sim.geometry import icosahedron
from icofabric_sim.geometry.shell import (
    INERTIA_FACTOR,
    maximum_thickness,
    Shell,
    VOLUME_FACTOR,
)
from icofabric_sim.pictures.citation import cite
import numpy as np

# Names as in the listing, and the power n of the factor a^n - b^n of each number.
INTEGRALS = {
    'V': 3, 'xcm': 4, 'ycm': 4, 'zcm': 4,
    'Ixx': 5, 'Iyy': 5, 'Izz': 5, 'Ixy': 5, 'Ixz': 5, 'Iyz': 5}
EQUATIONS = (12, *range(28, 35), *range(41, 45))
ERRATA = ('C2', 'C5', 'C16', 'C17')
_COLUMN_GROUPS = (('V',), ('xcm', 'ycm', 'zcm'), ('Ixx', 'Iyy', 'Izz'), ('Ixy', 'Ixz', 'Iyz'))
# Relative round-off of closed forms and of sums of a thousand terms.
_ROUNDING_RATIO = 1e-13


@dataclass(frozen=True)
class Surd:
    """Exact number rational + root sqrt(5)."""

    rational: Fraction
    root: Fraction = Fraction(0)

    def __add__(self, other: Any) -> 'Surd':
        other = _surd(other)
        return Surd(self.rational + other.rational, self.root + other.root)

    __radd__ = __add__

    def __neg__(self) -> 'Surd':
        return Surd(-self.rational, -self.root)

    def __sub__(self, other: Any) -> 'Surd':
        return self + -_surd(other)

    def __mul__(self, other: Any) -> 'Surd':
        other = _surd(other)
        return Surd(
            self.rational * other.rational + 5 * self.root * other.root,
            self.rational * other.root + self.root * other.rational)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> 'Surd':
        other = _surd(other)
        norm = other.rational**2 - 5 * other.root**2
        return self * Surd(other.rational / norm, -other.root / norm)

    def __float__(self) -> float:
        return float(self.rational) + float(self.root) * sqrt(5.0)

    def __str__(self) -> str:
        """Return a text such as (3 + sqrt(5))/6."""
        below = lcm(self.rational.denominator, self.root.denominator)
        p, q = int(self.rational * below), int(self.root * below)
        root = f'{"" if abs(q) == 1 else f"{abs(q)} "}sqrt(5)'
        if not q:
            above = str(p)
        elif not p:
            above = f'{"-" if q < 0 else ""}{root}'
        else:
            sign, p, q = (-1, -p, -q) if p < 0 else (1, p, q)
            above = f'{p} {"-" if q < 0 else "+"} {root}'
            above = f'{"-" if sign < 0 else ""}({above})' if below > 1 or sign < 0 else above
        return above if below == 1 else f'{above}/{below}'


TAU = Surd(Fraction(1, 2), Fraction(1, 2))
_COORDINATES = {0.0: Surd(Fraction(0)), 1.0: Surd(Fraction(1)), icosahedron.TAU: TAU}


class Check(NamedTuple):
    """Tested statement about the integrals."""

    statement: str
    holds: bool


class Appendix:
    """
    Integrals over the 20 frusta of a shell of outer edge 2a and inner edge 2b.

    `coefficients` has a row for each face and a column for each name of INTEGRALS. Its exact
    numbers multiply a^n - b^n (volume; integrals of x, y, z) or rho (a^n - b^n) (inertia).
    """

    def __init__(self, shell: Shell) -> None:
        """Integrate over all faces; values in SI units are those of `shell`."""
        self.shell = shell
        self.corners = np.array([
            [[_exact_coordinate(part) for part in vertex] for vertex in face]
            for face in icosahedron.outer_triangles(1.0).tolist()], dtype=object)
        self.scale_factors = [_determinant(face) for face in self.corners]
        self.coefficients = np.array([
            _integrate_frustum(face, factor)
            for face, factor in zip(self.corners, self.scale_factors)], dtype=object)
        self.totals = dict(zip(INTEGRALS, self.coefficients.sum(axis=0)))

    @cached_property
    def factors(self) -> np.ndarray:
        """Return the factors of the coefficients [SI], (10,): a^n - b^n, times rho for inertia."""
        a, b = self.shell.half_edge, self.shell.inner_half_edge
        # As a product with a - b from the thickness (eq 41), so that thin shells keep all digits.
        difference = self.shell.thickness / maximum_thickness(1.0)
        return np.array([
            (self.shell.density if name[0] == 'I' else 1.0) * difference
            * sum(a**k * b**(power - 1 - k) for k in range(power))
            for name, power in INTEGRALS.items()])

    @cached_property
    def inertia(self) -> np.ndarray:
        """Return the inertia tensor in units of rho (a^5 - b^5), (3, 3) exact numbers."""
        return np.array([
            [self.totals['I' + ''.join(sorted(p + q))] for q in 'xyz'] for p in 'xyz'],
            dtype=object)

    @cached_property
    def eigensystem(self) -> list[tuple[str, float, list[list[float]]]]:
        """
        Return the eigenvalues of the tensor as text and number, with the eigenvectors of each.
        """
        values, vectors = np.linalg.eigh(self.inertia.astype(float))
        found: list[tuple[str, float, list[list[float]]]] = []
        for value, vector in zip(values.tolist(), vectors.T.tolist()):
            if found and _is_near(value, found[-1][1]):
                found[-1][2].append(vector)
                continue
            exact = next((str(d) for d in np.diag(self.inertia) if _is_near(float(d), value)),
                         f'{value:.12g}')
            found.append((exact, value, [vector]))
        return found

    @cached_property
    def checks(self) -> list[Check]:
        """Return the checks of the listing, and comparisons with closed forms and quadrature."""
        zero, tensor, shell = Surd(Fraction(0)), self.inertia, self.shell
        volume, moment = self.totals['V'], tensor[0, 0]
        squares = {
            sum(part * part for part in face[i] - face[i - 1])
            for face in self.corners for i in range(3)}
        root = Surd(Fraction(0), Fraction(1))
        # As in the Maple output, with a^5 for a^-5.
        printed_volume = root * Fraction(10, 3) + 10
        printed_moment = (root * 3 + 7) * Fraction(16, 3) / ((root - 1) * (root + 1))
        printed_eigenvalue = Surd(Fraction(-16, 3)) / (root * 3 - 7)
        values = self.coefficients.astype(float) * self.factors
        by_quadrature = _integrate_numerically(shell)
        largest = np.abs(by_quadrature).max(axis=0)
        deviation = float((np.abs(values - by_quadrature) / largest).max())
        # The quadrature computes a - b as a difference, with the round-off of a and b.
        allowed = max(_ROUNDING_RATIO, 4.0 * sys.float_info.epsilon / (
            1.0 - shell.inner_half_edge / shell.half_edge))
        sums = values.sum(axis=0)
        return [
            Check('there are 20 faces, each with a different set of vertices',
                  len({frozenset(map(tuple, face.tolist())) for face in self.corners}) == 20),
            Check('all edges of the faces are 2a long (C17)', squares == {Surd(Fraction(4))}),
            Check('w1, w2, w3 of each face are right-handed, with determinant 2 tau^2 a^3 '
                  '(eq 33; C5)', set(self.scale_factors) == {TAU * TAU * 2}),
            Check('the centre of mass is at the centre of the shell',
                  all(self.totals[name] == zero for name in ('xcm', 'ycm', 'zcm'))),
            Check('the tensor is Lambda times the identity (eq 43)',
                  all(tensor[i, j] == (moment if i == j else zero)
                      for i in range(3) for j in range(3))),
            Check('V and Lambda equal the closed forms of eqs 42 and 44',
                  _is_near(float(volume), VOLUME_FACTOR)
                  and _is_near(float(moment), INERTIA_FACTOR)),
            Check('V, the moments and the eigenvalue equal the Maple output (C16)',
                  volume == printed_volume and moment == printed_moment == printed_eigenvalue),
            Check('one eigenvalue has three eigenvectors',
                  [len(vectors) for _, _, vectors in self.eigensystem] == [3]),
            Check(f'all {values.size} integrals agree with Gauss quadrature of that shell '
                  f'(largest relative deviation {deviation:.1e})', deviation <= allowed),
            Check('mass and Lambda of that shell equal those used in simulations',
                  _is_near(shell.density * sums[0], shell.mass)
                  and _is_near(sums[4], shell.inertia))]

    def lines(self) -> list[str]:
        """Return the appendix as text."""
        names = list(INTEGRALS)
        lines = [f'Appendix: integrals over the frustum of each face ({cite(EQUATIONS, ERRATA)})',
                 *indent_text(
                     'Edges are 2a and 2b. V is in units of a^3 - b^3; xcm, ycm and zcm, the '
                     'integrals of x, y and z, in units of a^4 - b^4; moments and products of '
                     'inertia in units of rho (a^5 - b^5).')]
        for group in _COLUMN_GROUPS:
            columns = ['face', *group]
            rows: list[list[object]] = [
                *([number, *(_beside(face[names.index(name)]) for name in group)]
                  for number, face in enumerate(self.coefficients, 1)),
                ['sum', *(_beside(self.totals[name]) for name in group)]]
            if group == ('V',):
                columns[1:1] = ['v1', 'v2', 'v3']
                for row, corners in zip(rows, [*self.corners.tolist(), [()] * 3]):
                    row[1:1] = [_vertex(vertex) for vertex in corners]
            lines += ['', *align_rows(columns, rows)]
        lines += ['', '  Inertia tensor in units of rho (a^5 - b^5):', *align_rows(
            ['', *'xyz'], [[axis, *map(str, row)] for axis, row in zip('xyz', self.inertia)])]
        for exact, value, vectors in self.eigensystem:
            lines += indent_text(
                f'Eigenvalue {exact} = {value:.10g}, {len(vectors)}-fold, eigenvectors '
                f'{", ".join(_vector(vector) for vector in vectors)}')
        shell = self.shell
        volume, moment = (float(self.totals[name]) * self.factors[names.index(name)]
                          for name in ('V', 'Ixx'))
        lines += ['', *indent_text(
            f'A shell of edge 2a = {shell.edge_length:g} m, thickness {shell.thickness:g} m (2b = '
            f'{shell.inner_edge_length:.6g} m) and density {shell.density:g} kg/m^3: V = '
            f'{volume:.6g} m^3, M = {shell.density * volume:.6g} kg, Lambda = {moment:.6g} kg m^2'
        )]
        return [*lines, '', '  Checks:', *(
            f'  {"passed" if check.holds else "FAILED"}  {check.statement}'
            for check in self.checks)]

    def to_json(self) -> dict[str, Any]:
        """Return the appendix with exact numbers as text; SI values are those of the shell."""
        def rows(coefficients: Sequence[Surd]) -> dict[str, Any]:
            return {name: {'exact': str(number), 'coefficient': float(number),
                           'value': float(number) * float(factor)}
                    for name, number, factor in zip(INTEGRALS, coefficients, self.factors)}

        return {
            'equations': EQUATIONS, 'errata': ERRATA, 'powers': INTEGRALS,
            'shell': {name: getattr(self.shell, name) for name in (
                'half_edge', 'inner_half_edge', 'thickness', 'density', 'mass', 'inertia')},
            'faces': [{'face': number, 'vertices': [[str(part) for part in v] for v in corners],
                       'integrals': rows(face)}
                      for number, (corners, face) in enumerate(
                          zip(self.corners.tolist(), self.coefficients), 1)],
            'totals': rows(list(self.totals.values())),
            'eigensystem': [
                {'exact': exact, 'eigenvalue': value, 'eigenvectors': vectors}
                for exact, value, vectors in self.eigensystem],
            'checks': [check._asdict() for check in self.checks]}


def _integrate_frustum(corners: np.ndarray, scale_factor: Surd) -> list[Surd]:
    """Return the ten integrals of eq 34 over the frustum of a face, for a = 1 and rho = 1."""
    w1, w2, w3 = corners[0], corners[1] - corners[0], corners[2] - corners[0]
    frame = np.array([w1, w2, w3], dtype=object).T  # A of eq 31
    unit = np.eye(3, dtype=int)
    first = np.array([_lambda_integral(*unit[i]) for i in range(3)], dtype=object)
    second = np.array(
        [[_lambda_integral(*(unit[i] + unit[j])) for j in range(3)] for i in range(3)],
        dtype=object)
    centre = frame @ first * scale_factor
    moments = frame @ second @ frame.T * scale_factor
    trace = moments.trace()
    return [
        scale_factor * _lambda_integral(0, 0, 0), *centre,
        *(trace - moments[i, i] for i in range(3)),
        *(-moments[i, j] for i, j in ((0, 1), (0, 2), (1, 2)))]


def _lambda_integral(p: int, q: int, r: int) -> Fraction:
    """
    Integrate l1^p l2^q l3^r over the domain of eq 34, in units of 1 - (b/a)^(p + q + r + 3).

    The integral over l3 and l2, from 0 to l1 - l2 and from 0 to l1 (C2), is a Beta function times
    a power.
    """
    return Fraction(
        factorial(q) * factorial(r), factorial(q + r + 2) * (int(p) + int(q) + int(r) + 3))


def _determinant(corners: np.ndarray) -> Surd:
    w1, w2, w3 = corners[0], corners[1] - corners[0], corners[2] - corners[0]
    return sum(
        (w1[i] * (w2[i - 2] * w3[i - 1] - w2[i - 1] * w3[i - 2]) for i in range(3)),
        Surd(Fraction(0)))


def _integrate_numerically(shell: Shell) -> np.ndarray:
    """Return the integrals over each frustum by Gauss quadrature [SI], (20, 10)."""
    points, weights = icosahedron.volume_quadrature(
        shell.half_edge, shell.inner_half_edge, degree=2)
    x, y, z = np.moveaxis(points, 2, 0)
    one, rho = np.ones_like(x), shell.density
    integrands = [
        one, x, y, z, rho * (y * y + z * z), rho * (x * x + z * z), rho * (x * x + y * y),
        -rho * x * y, -rho * x * z, -rho * y * z]
    return np.stack([integrand @ weights for integrand in integrands], axis=1)


def _surd(number: Any) -> Surd:
    return number if isinstance(number, Surd) else Surd(Fraction(number))


def _exact_coordinate(number: float) -> Surd:
    exact = _COORDINATES[abs(number)]
    return -exact if number < 0.0 else exact


def _is_near(one: float, other: float) -> bool:
    return bool(abs(one - other) <= _ROUNDING_RATIO * abs(other))


def _beside(number: Surd) -> str:
    """Return an exact number with its decimals."""
    return f'{number} = {float(number):.6f}' if number.root else str(number)


def _vertex(vertex: Sequence[Surd]) -> str:
    letters = {TAU: 'tau', -TAU: '-tau'}
    return f'({", ".join(letters.get(part, str(part)) for part in vertex)})' if vertex else ''


def _vector(vector: Sequence[float]) -> str:
    return f'[{",".join(f"{part + 0.0:g}" for part in vector)}]'
