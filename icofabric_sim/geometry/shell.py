# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The rigid shell between two concentric icosahedra: lengths, volume, mass and isotropic inertia.

Source: "A Mathematical Model of Icosahedral Materials", eqs 41-44. Its inertia is the same
about every axis through the centre, so one number Lambda stands for the tensor.
"""

from dataclasses import dataclass
import math
from typing import Callable, Final

from icofabric_sim import checks
from icofabric_sim.geometry.icosahedron import inscribed_radius
from icofabric_sim.geometry.mass_distribution import (
    integrate_density,
    MassDistribution,
    SYMMETRY_TOLERANCE,
)
import numpy as np

# eq 42: V = 10 (1 + sqrt(5)/3) (a^3 - b^3).
VOLUME_FACTOR: Final = 10.0 * (1.0 + math.sqrt(5.0) / 3.0)
# eq 44: Lambda = 4 (7/3 + sqrt(5)) rho (a^5 - b^5).
INERTIA_FACTOR: Final = 4.0 * (7.0 / 3.0 + math.sqrt(5.0))

# Relative distance by which a layer may lie beyond the faces: round-off of numbers in a file.
_DISTANCE_TOLERANCE: Final = 1e-9
_UNITS: Final = {
    'half_edge': 'm', 'inner_half_edge': 'm', 'thickness': 'm', 'volume': 'm^3',
    'density': 'kg/m^3', 'mass': 'kg', 'inertia': 'kg m^2'}


@dataclass(frozen=True)
class Shell:
    """A shell. The `from_...` constructors make it from lengths and a density."""

    half_edge: float          # a [m]: half the outer edge
    inner_half_edge: float    # b [m]: half the inner edge, 0 < b < a
    thickness: float          # T [m], measured at the centre of a face: eq 41
    volume: float             # of the material [m^3]: eq 42
    density: float            # rho [kg/m^3]; mass over volume where it is not uniform
    mass: float               # M [kg]
    inertia: float            # Lambda [kg m^2], about any axis through the centre: eq 44
    relative_error: float = 0.0  # estimate for mass and inertia that come from a quadrature

    def __post_init__(self) -> None:
        """Refuse what is not a number above 0."""
        for name, unit in _UNITS.items():
            checks.positive(name, getattr(self, name), unit)
        checks.number('relative_error', self.relative_error, least=0.0)
        if not self.inner_half_edge < self.half_edge:
            raise ValueError(
                f'inner_half_edge must be below half_edge {self.half_edge!r} m, got '
                f'{self.inner_half_edge!r} m')

    @classmethod
    def from_thickness(
            cls, edge_length: float, thickness: float, density: float, *,
            mass: float | None = None, inertia: float | None = None) -> 'Shell':
        """
        Make a shell of uniform density from its outer edge and its thickness.

        Parameters
        ----------
        edge_length, thickness
            2a and T [m], 0 < T < a sqrt(2/3 + tau).
        density
            rho [kg/m^3].
        mass
            [kg]. None or 0: from the geometry. Otherwise the mass replaces the computed one, and
            the inertia is scaled in proportion.
        inertia
            [kg m^2]. None or 0: as above. Otherwise the inertia replaces the computed one.

        Returns
        -------
        Shell

        Raises
        ------
        ValueError
            A length, density, mass or inertia is out of its range.

        """
        half_edge = _half('shell.edge_length', edge_length)
        return cls._uniform(
            half_edge, inner_half_edge(half_edge, thickness), float(thickness), density, mass,
            inertia)

    @classmethod
    def from_inner_edge_length(
            cls, edge_length: float, inner_edge_length: float, density: float, *,
            mass: float | None = None, inertia: float | None = None) -> 'Shell':
        """
        Make a shell of uniform density from its outer and its inner edge.

        Parameters
        ----------
        edge_length, inner_edge_length
            2a and 2b [m], 0 < b < a.
        density
            rho [kg/m^3].
        mass, inertia
            [kg] and [kg m^2], as in `from_thickness`.

        Returns
        -------
        Shell

        Raises
        ------
        ValueError
            A length, density, mass or inertia is out of its range.

        """
        half_edge = _half('shell.edge_length', edge_length)
        inner = _half('shell.inner_edge_length', inner_edge_length)
        return cls._uniform(
            half_edge, inner, shell_thickness(half_edge, inner), density, mass, inertia)

    @classmethod
    def from_layers(
            cls, edge_length: float, thickness: float, distance: np.ndarray,
            density: np.ndarray, *, mass: float | None = None,
            inertia: float | None = None) -> 'Shell':
        """
        Make a shell of layers that are parallel to its faces.

        Eqs 42 and 44 with a density that changes from icosahedron to icosahedron about the centre.
        The density is linear between the given distances and zero outside them. `thickness` is
        the distance between the outer and inner surface in pictures; layers may also lie inside
        the inner surface.

        Parameters
        ----------
        edge_length, thickness
            2a and T [m].
        distance
            Distances of the layer faces from the centre [m], (m,), increasing, at most that of
            the outer faces.
        density
            Density at these distances [kg/m^3], (m,), not below 0.
        mass, inertia
            [kg] and [kg m^2], as in `from_thickness`.

        Returns
        -------
        Shell

        Raises
        ------
        ValueError
            A length, distance, density, mass or inertia is out of its range.

        """
        half_edge = _half('shell.edge_length', edge_length)
        inner = inner_half_edge(half_edge, thickness)
        d, rho = checked_layers(half_edge, distance, density, 'kg/m^3')
        if (rho < 0.0).any() or not rho.any():
            raise ValueError(
                f'density must not be below 0 kg/m^3, and not 0 throughout, got {rho.tolist()}')
        own_mass, own_inertia = integrate_layers(d, rho)
        volume = _volume(half_edge, inner, float(thickness))
        chosen = _override('shell.mass', mass, 'kg') or own_mass
        return cls(
            half_edge, inner, float(thickness), volume, chosen / volume, chosen,
            _override('shell.inertia', inertia, 'kg m^2') or own_inertia * (chosen / own_mass))

    @classmethod
    def from_density(
            cls, edge_length: float, thickness: float,
            density_function: Callable[[np.ndarray], np.ndarray], *,
            include_interior: bool = False, tolerance: float = 1e-5,
            evaluation_limit: int = 50_000_000) -> 'Shell':
        """
        Make a shell whose density depends on the position (eqs 12, 33 and 34).

        The density may jump. It must leave the centre of mass at the centre and the inertia
        isotropic, both to 1e-9; other densities raise ValueError with the values found.

        Parameters
        ----------
        edge_length, thickness
            2a and T [m].
        density_function
            Takes points in body axes [m], (m, 3); returns the density [kg/m^3], (m,).
        include_interior
            The density also counts inside the inner surface: bracing, a ball in the hollow.
        tolerance
            Required relative accuracy of mass and inertia. A smooth density, or one that jumps
            on spheres or icosahedra about the centre, is far more accurate. `relative_error`
            holds the estimate reached.
        evaluation_limit
            Largest number of densities to evaluate before ValueError is raised.

        Returns
        -------
        Shell

        Raises
        ------
        ValueError
            The density is not symmetric enough, or its integral does not converge.

        """
        half_edge = _half('shell.edge_length', edge_length)
        inner = inner_half_edge(half_edge, thickness)
        checks.function(
            'density_function', density_function, 'a function of points (m, 3) [m]')
        include_interior = checks.flag('include_interior', include_interior)
        tolerance = checks.positive('tolerance', tolerance)
        evaluation_limit = checks.count('evaluation_limit', evaluation_limit, 1)
        found = integrate_density(
            density_function, half_edge, float(thickness), include_interior=include_interior,
            tolerance=tolerance, evaluation_limit=evaluation_limit)
        _check_distribution(found, half_edge, tolerance)
        volume = _volume(half_edge, inner, float(thickness))
        return cls(
            half_edge, inner, float(thickness), volume, found.mass / volume, found.mass,
            float(np.trace(found.inertia)) / 3.0, found.relative_error)

    @classmethod
    def _uniform(
            cls, half_edge: float, inner: float, thickness: float, density: float,
            mass: float | None, inertia: float | None) -> 'Shell':
        density = checks.positive('shell.density', density, 'kg/m^3')
        volume = _volume(half_edge, inner, thickness)
        own_mass = density * volume
        # eq 44 over eq 42: the square of the radius of gyration.
        r = inner / half_edge
        quotient = 1.0 + r ** 3 * (1.0 + r) / (1.0 + r + r * r)
        gyration = INERTIA_FACTOR / VOLUME_FACTOR * quotient * (half_edge * half_edge)
        chosen_mass = _override('shell.mass', mass, 'kg') or own_mass
        chosen_inertia = _override('shell.inertia', inertia, 'kg m^2') or chosen_mass * gyration
        for name, value, unit in (
                ('mass', chosen_mass, 'kg'), ('inertia', chosen_inertia, 'kg m^2')):
            if not 0.0 < value < math.inf:
                raise ValueError(
                    f'the {name} of the shell is {value!r} {unit}, outside the range of '
                    f'floating-point numbers, for shell.edge_length {2.0 * half_edge!r} m, '
                    f'thickness {thickness!r} m and shell.density {density!r} kg/m^3; choose '
                    'other ones')
        return cls(
            half_edge, inner, thickness, volume, density, chosen_mass, chosen_inertia)

    @property
    def edge_length(self) -> float:
        """Outer edge 2a [m]."""
        return 2.0 * self.half_edge

    @property
    def inner_edge_length(self) -> float:
        """Inner edge 2b [m]."""
        return 2.0 * self.inner_half_edge


def checked_layers(
    half_edge: float, distance: np.ndarray, density: np.ndarray, unit: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances [m] and densities of layers; raise ValueError if one is outside."""
    d = checks.array('distance', distance, ('m',), 'm')
    farthest = maximum_thickness(half_edge)
    if len(d) < 2 or d[0] < 0.0 or (np.diff(d) <= 0.0).any():
        raise ValueError(
            'distance must be at least two strictly increasing numbers, the first not below '
            f'0 m, got {d.tolist()}')
    if not d[-1] <= farthest * (1.0 + _DISTANCE_TOLERANCE):
        raise ValueError(
            f'distance must not be beyond the faces of the shell, {farthest!r} m from the '
            f'centre, got {float(d[-1])!r} m')
    return d, checks.array('density', density, (len(d),), unit)


def integrate_layers(distance: np.ndarray, density: np.ndarray) -> tuple[float, float]:
    """
    Return the integrals of a density, and of it times the squared distance from an axis.

    The density of layers that are parallel to the faces is linear between distances [m].
    """
    # Of an icosahedron: volume over the cube of this distance, inertia over the fifth power
    # (for a density of 1), both of the half edge 1.
    scale = maximum_thickness(1.0)
    slope = np.diff(density) / np.diff(distance)
    level = density[:-1] - slope * distance[:-1]

    def moment(power: int) -> float:
        """Integral of the density times a power of the distance."""
        parts = [np.diff(distance**(power + n)) * part / (power + n)
                 for n, part in ((1, level), (2, slope))]
        return float(sum(part.sum() for part in parts))

    return (
        3.0 * VOLUME_FACTOR / scale**3 * moment(2), 5.0 * INERTIA_FACTOR / scale**5 * moment(4))


def maximum_thickness(half_edge: float) -> float:
    """Return the limit that T must stay below [m], a sqrt(2/3 + tau): the inscribed radius."""
    return inscribed_radius(half_edge)


def inner_half_edge(half_edge: float, thickness: float) -> float:
    """Return b [m] for a and T [m]: eq 41. Raises ValueError unless 0 < T < a sqrt(2/3 + tau)."""
    limit = maximum_thickness(half_edge)
    thickness = checks.number(
        'shell.thickness', thickness, above=0.0, below=limit,
        wish=f'a number in 0 < T < a sqrt(2/3 + tau) = {limit!r} m for shell.edge_length '
        f'{2.0 * half_edge!r} m (eq 41)')
    # With T below the limit the quotient stays below 1 in rounding too, so b > 0.
    inner = half_edge * (1.0 - thickness / limit)
    if not inner < half_edge:
        raise ValueError(
            f'shell.thickness must be a number in 0 < T < {limit!r} m, got {thickness!r} m, which '
            f'is below round-off relative to shell.edge_length {2.0 * half_edge!r} m; give a '
            'thicker shell')
    return inner


def shell_thickness(half_edge: float, inner_half_edge: float) -> float:
    """Return T [m] for a and b [m]: eq 41. Raises ValueError unless 0 < b < a."""
    if not 0.0 < inner_half_edge < half_edge:
        raise ValueError(
            f'shell.inner_edge_length must lie in 0 < 2b < shell.edge_length = '
            f'{2.0 * half_edge!r} m, got {2.0 * inner_half_edge!r} m; give a shorter inner edge')
    return maximum_thickness(half_edge - inner_half_edge)


def _volume(half_edge: float, inner: float, thickness: float) -> float:
    # a^3 - b^3 as a product, with a - b from the thickness: thin shells keep all digits.
    a, b = half_edge, inner
    return VOLUME_FACTOR * (thickness / maximum_thickness(1.0)) * (a * a + a * b + b * b)


def _check_distribution(found: MassDistribution, half_edge: float, tolerance: float) -> None:
    mean = float(np.trace(found.inertia)) / 3.0
    if not (0.0 < found.mass < math.inf and 0.0 < mean < math.inf):
        raise ValueError(
            f'the density function gives a mass of {found.mass!r} kg and an inertia of {mean!r} '
            'kg m^2; both must be positive and finite')
    moments = np.linalg.eigvalsh(found.inertia)
    principal = f'principal values {", ".join(repr(float(value)) for value in moments)} kg m^2'
    known = f'estimated relative error {found.relative_error:.1e}'
    offset = float(np.abs(found.centre_of_mass).max()) / half_edge
    if found.asymmetry > max(SYMMETRY_TOLERANCE, found.relative_error):
        if offset > max(SYMMETRY_TOLERANCE, found.relative_error):
            raise ValueError(
                'the density function puts the centre of mass at '
                f'{found.centre_of_mass.tolist()} m ({known}); it must lie at the centre of the '
                f'shell, within {SYMMETRY_TOLERANCE:.0e} of half its edge ({half_edge!r} m): '
                'distribute the mass evenly')
        raise ValueError(
            f'the density function makes an inertia with {principal} ({known}); they must agree '
            f'to {SYMMETRY_TOLERANCE:.0e}: distribute the mass equally along x, y and z, or '
            'give a scene the mass and moments as shell.mass and shell.principal_inertia')
    if not found.relative_error <= tolerance:
        raise ValueError(
            f'the integral of the density function did not converge: mass {found.mass!r} kg with '
            f'an {known} after {found.evaluation_count} evaluations, wanted {tolerance:.1e}; '
            'smooth the density, or give a larger tolerance or evaluation_limit')
    if not found.converged:
        raise ValueError(
            'the integral of the density function is not accurate enough to decide whether the '
            f'body is symmetric: {principal}, centre of mass {found.centre_of_mass.tolist()} m, '
            f'{known} after {found.evaluation_count} evaluations, needed '
            f'{SYMMETRY_TOLERANCE:.0e}; give a larger evaluation_limit, or a density that is '
            'symmetric about the body axes')


def _half(name: str, length: float) -> float:
    half = checks.positive(name, length, 'm') / 2.0
    if not half > 0.0:
        raise ValueError(f'{name} is too small for a number, got {length!r} m')
    return half


def _override(name: str, value: float | None, unit: str) -> float:
    """Return a value that replaces the computed one, 0.0 for none."""
    if value is None:
        return 0.0
    return checks.number(
        name, value, unit=unit, least=0.0,
        wish='0 (from the geometry) or a positive, finite number')
