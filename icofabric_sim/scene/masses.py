# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Masses and inertias of bodies: those of the shell, or individual ones.

Bodies are icosahedra of one size or individually sized (body_sizes.py), and their filling or
bracing may differ. The inertia of a shell is isotropic (eq 43), so the gyroscopic term vanishes.
Bodies with unequal principal moments have a gyroscopic term (terms/gyration.py).
"""

from collections.abc import Mapping
from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import TAU
from icofabric_sim.geometry.shell import Shell
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.body_sizes import half_edge_of
from icofabric_sim.scene.densities import Density, make_density
import numpy as np

_AXES = 'xyz'
# Allows for round-off of decimal values.
_ROUNDING_FACTOR = 1.0 + 1e-12


class BodyMasses(NamedTuple):
    """Masses and inertias, (n,), or (1,) if all equal those of the shell."""

    mass: np.ndarray  # [kg]
    inertia: np.ndarray  # [kg m^2]; the smallest principal moment if not isotropic

    @property
    def all_equal(self) -> bool:
        """True if all bodies have the mass and inertia of the shell."""
        return len(self.mass) == 1

    def mass_of(self, body: int) -> float:
        """Return the mass [kg] of one body."""
        return float(self.mass[0 if self.all_equal else body])

    def total(self, bodies: int) -> float:
        """Return the total mass [kg] of this number of `bodies`."""
        return float(self.mass.sum()) if not self.all_equal else bodies * float(self.mass[0])


class _MassProperties(NamedTuple):
    """Mass [kg] and moments of inertia [kg m^2] about the principal axes, (3,)."""

    mass: float
    moments: np.ndarray
    axes: np.ndarray | None  # (3, 3) in body axes, by rows; None: the body axes

    @property
    def inertia(self) -> float:
        return float(self.moments.min())


def individual_masses(parameters: Parameters, shell: Shell) -> dict[str, tuple[float, float]]:
    """
    Return mass [kg] and inertia [kg m^2] of every `masses.NAME` and `bodies.NAME` that sets one.

    A missing value is the shell's, scaled to the size of the body; inertia scales with mass. The
    inertia of a body with principal moments is the smallest of them.
    """
    _, own = _all_masses(parameters, shell)
    return {prefix: (each.mass, each.inertia) for prefix, each in own.items()}


def _all_masses(
    parameters: Parameters, shell: Shell
) -> tuple[_MassProperties, dict[str, _MassProperties]]:
    """Return the masses of the shell and of each `masses.NAME` and `bodies.NAME` that sets any."""
    density = make_density(parameters, 'shell', shell)
    moments = _principal(parameters, 'shell', float(shell.mass), shell.half_edge, density)
    common = _MassProperties(
        float(shell.mass), np.full(3, float(shell.inertia)) if moments is None else moments,
        None if density is None else density.axes)
    if moments is not None and parameters['shell.inertia']:
        raise ParameterError(
            'shell.principal_inertia', 'shell.principal_inertia and shell.inertia are both given: '
            'set one of them to zero')
    _refuse_inertia('shell', parameters['shell.inertia'], common.mass, shell.half_edge)
    found = {}
    for family in ('bodies', 'masses'):
        for name in parameters.names(family):
            prefix = f'{family}.{name}'
            mass, inertia = (parameters[f'{prefix}.{field}'] for field in ('mass', 'inertia'))
            half_edge = half_edge_of(parameters, prefix, shell)
            size = half_edge / shell.half_edge
            density = make_density(parameters, prefix, shell)
            heavy = mass or (common.mass * size**3 if density is None else density.mass)
            moments = _principal(parameters, prefix, heavy, half_edge, density)
            if mass == inertia == 0.0 and moments is None and size == 1.0:
                continue
            if moments is not None and inertia:
                raise ParameterError(
                    f'{prefix}.principal_inertia',
                    f'{prefix}.principal_inertia and {prefix}.inertia are both given: set one of '
                    'them to zero')
            _refuse_inertia(prefix, inertia, heavy, half_edge)
            axes = None if density is None else density.axes
            if moments is None and inertia:
                moments = np.full(3, inertia)
            elif moments is None:
                moments, axes = common.moments * (heavy / common.mass * size**2), common.axes
            found[prefix] = _MassProperties(heavy, moments, axes)
    return common, found


def _refuse_inertia(prefix: str, inertia: float, mass: float, half_edge: float) -> None:
    """Refuse an inertia [kg m^2] above that of the whole `mass` [kg] at the vertices."""
    most = mass * half_edge**2 * (TAU + 2.0) * 2.0 / 3.0
    if inertia > most * _ROUNDING_FACTOR:
        raise ParameterError(
            f'{prefix}.inertia',
            f'{prefix}.inertia {inertia!r} kg m^2 is more than {most:.6g} kg m^2, the largest '
            f'possible: that of {mass:.6g} kg at the vertices of the icosahedron; give a smaller '
            'inertia, or more mass')


def _principal(
    parameters: Parameters, prefix: str, mass: float, half_edge: float, density: Density | None
) -> np.ndarray | None:
    """Return the principal moments [kg m^2] for a `mass` [kg]; None if not given."""
    if density is not None:
        return density.moments * (mass / density.mass)
    name = f'{prefix}.principal_inertia'
    moments = np.array(parameters[name])
    if not moments.any():
        return None
    # The whole mass at the largest distance of a vertex from the axis.
    most = mass * half_edge**2 * (TAU + 2.0)
    if not (moments > 0.0).all():
        raise ParameterError(
            name, f'{name} must have three moments above 0 kg m^2, got {moments.tolist()}; zeros '
            'for an isotropic inertia')
    largest = int(np.argmax(moments))
    others = float(moments.sum() - moments[largest])
    if moments[largest] > others * _ROUNDING_FACTOR:
        raise ParameterError(
            name, f'{name} {moments.tolist()} kg m^2 is impossible: the moment about '
            f'{_AXES[largest]} is at most the sum of the other two, {others:.6g} kg m^2')
    if moments[largest] > most * _ROUNDING_FACTOR:
        raise ParameterError(
            name, f'{name} {moments.tolist()} kg m^2 has a moment above {most:.6g} kg m^2, the '
            f'largest possible: that of {mass:.6g} kg at the vertices of the icosahedron; give '
            'smaller moments, or more mass')
    return moments


def make_masses(
    parameters: Parameters, shell: Shell, groups: Mapping[str, np.ndarray], bodies: int
) -> BodyMasses:
    """Return the masses of all `bodies`, loose ones last; later groups take precedence."""
    common, own = _all_masses(parameters, shell)
    mass, inertia = np.array([common.mass]), np.array([common.inertia])
    if not own:
        return BodyMasses(mass, inertia)
    mass, inertia = np.repeat(mass, bodies), np.repeat(inertia, bodies)
    for prefix, each in own.items():
        members = _members(parameters, groups, prefix, bodies)
        mass[members], inertia[members] = each.mass, each.inertia
    return BodyMasses(mass, inertia)


def make_moments(
    parameters: Parameters, shell: Shell, groups: Mapping[str, np.ndarray], bodies: int
) -> np.ndarray | None:
    """Return the principal moments [kg m^2] of all bodies, (n, 3); None if all are isotropic."""
    common, own = _all_masses(parameters, shell)
    if not any(np.ptp(each.moments) for each in (common, *own.values())):
        return None
    moments = np.tile(common.moments, (bodies, 1))
    for prefix, each in own.items():
        moments[_members(parameters, groups, prefix, bodies)] = each.moments
    return moments


def make_principal_axes(
    parameters: Parameters, shell: Shell, groups: Mapping[str, np.ndarray], bodies: int
) -> np.ndarray | None:
    """
    Return the principal axes of all bodies in body axes, by rows, (n, 3, 3).

    None if they are the body axes of all.
    """
    common, own = _all_masses(parameters, shell)
    if all(each.axes is None for each in (common, *own.values())):
        return None
    axes = np.tile(np.eye(3) if common.axes is None else common.axes, (bodies, 1, 1))
    for prefix, each in own.items():
        axes[_members(parameters, groups, prefix, bodies)] = (
            np.eye(3) if each.axes is None else each.axes)
    return axes


def turned_axes(tilted: np.ndarray | None, axes: np.ndarray) -> np.ndarray:
    """Return principal axes by rows, in world components, from body axes (n, 3, 3)."""
    return axes if tilted is None else np.asarray(np.einsum('bki,bij->bkj', tilted, axes))


def moments_parameter_name(parameters: Parameters) -> str:
    """Return the name of the first parameter that gives principal moments, or ''."""
    prefixes = ['shell'] + [
        f'{family}.{name}' for family in ('masses', 'bodies') for name in parameters.names(family)]
    names = [f'{prefix}.{field}' for field in ('principal_inertia', 'expression')
             for prefix in prefixes]
    return next((name for name in names if any(parameters[name])), '')


def require_isotropic(parameters: Parameters, moments: np.ndarray | None, what: str) -> None:
    """Refuse `what` if inertias are not isotropic, naming the parameter that gives them."""
    if moments is not None:
        name = moments_parameter_name(parameters)
        raise ParameterError(
            name, f'{name} {parameters[name]}: {what} of bodies whose inertia is not isotropic '
            f'are not supported; leave it out, and give {name.rpartition(".")[0]}.inertia')


def all_members(
    parameters: Parameters, groups: Mapping[str, np.ndarray], bodies: int
) -> dict[str, np.ndarray]:
    """Return the bodies of each `masses.NAME`, then of each `bodies.NAME`."""
    return {
        f'{family}.{name}': _members(parameters, groups, f'{family}.{name}', bodies)
        for family in ('masses', 'bodies') for name in parameters.names(family)}


def _members(
    parameters: Parameters, groups: Mapping[str, np.ndarray], prefix: str, bodies: int
) -> np.ndarray:
    family, name = prefix.split('.')
    if family == 'bodies':
        loose = parameters.names('bodies')
        return np.array([bodies - len(loose) + loose.index(name)])
    return groups[parameters[f'{prefix}.group']]


def smallest_mass_and_inertia(parameters: Parameters, shell: Shell) -> tuple[float, float]:
    """Return the smallest mass [kg] and the smallest inertia [kg m^2] of all bodies."""
    common, own = _all_masses(parameters, shell)
    every = (common, *own.values())
    return min(each.mass for each in every), min(each.inertia for each in every)
