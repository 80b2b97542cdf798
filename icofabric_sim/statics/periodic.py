# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Periodic fabric: dispersion of Bloch waves, and effective elastic constants.

All bodies of a weave have the same twelve neighbours and the same connectors to them. The lattice
is face-centred cubic with one body, six degrees of freedom and six connectors per primitive cell:
as many constraints as degrees of freedom. A wave u = w exp(i k.x) satisfies D(k) w = omega^2 M w
with the dynamical matrix D(k) = sum_R H(0, R) exp(i k.R) over a body and its neighbours (Born and
Huang 1954, Dynamical Theory of Crystal Lattices, 24).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
import logging
import math
from typing import Any

from icofabric_sim import checks
from icofabric_sim.checks import renamed_attributes
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.scene.body_sizes import size_parameter_names
from icofabric_sim.scene.connector_groups import differ_by_direction_only
from icofabric_sim.scene.masses import turned_axes
from icofabric_sim.scene.scene import require_scene, Scene
from icofabric_sim.simulation.model.as_table import AsTable
from icofabric_sim.statics.directional import (
    Directional,
    directional,
    excites_zero_energy,
    LABELS,
    unit_shear,
    unit_tension,
)
from icofabric_sim.statics.fabric import Configuration, StaticFabric
from icofabric_sim.statics.friction import FrictionPath
from icofabric_sim.statics.kinks import length_changes
from icofabric_sim.statics.lattice import (
    deformed_configuration,
    hessian_along,
    Lattice,
    LatticeRest,
    relax,
)
from icofabric_sim.statics.one_sided import CellEnergy, Response
from icofabric_sim.statics.sides import BRANCHES, check_branch, PULL, PUSH, WITHOUT
import numpy as np

# Grid positions of a slab whose innermost body has all its neighbours.
_CELL_SLAB_SIZE = [5, 5, 5]
_CELL_PARAMETERS = ('shell.', 'connector.', 'connector_groups.', 'weave.kind', 'weave.azimuth',
                    'weave.connector_length', 'weave.connector_angle')
# Stiffnesses and energies below this ratio to the largest count as zero.
_ZERO_RATIO = 1e-9
# Ratio of stiffnesses above which a warning about round-off is logged.
_ROUNDED_RATIO = 1e7
_LOGGER = logging.getLogger('icofabric_sim')


@dataclass(frozen=True)
class Cell:
    """Unit cell of a periodic fabric: one body and its stiffness to its neighbours."""

    scene: Scene  # a finite slab of the fabric
    body: int  # body of that slab with all its neighbours
    neighbours: np.ndarray  # (m,) the body itself, its twelve neighbours, and others in contact
    offsets: np.ndarray  # (m, 3) [m] from its centre, as woven
    stiffness: np.ndarray  # (m, 6, 6) second derivatives H(0, R) of the energy
    sqrt_mass: np.ndarray  # (6,) square roots of mass and the smallest moment of inertia
    inverse_sqrt_mass: np.ndarray  # (6, 6) M^-1/2 with all moments, world axes
    # Connectors are at their natural length, and k_e differs from k_c.
    at_kink: bool
    relaxed_state: LatticeRest | None = None  # equilibrium; None: as woven

    @property
    def volume(self) -> float:
        """Volume [m^3] per body: that of every second point of a grid of pitch W, deformed."""
        deformed = 1.0 if self.relaxed_state is None else float(
            np.linalg.det(self.relaxed_state.gradient))
        return 2.0 * float(self.scene.geometry.pitch) ** 3 * deformed

    @property
    def density(self) -> float:
        """Mass per volume [kg/m^3]."""
        return float(self.sqrt_mass[0]) ** 2 / self.volume


def make_cell(scene: Scene, branch: str | None = None, *, relaxed: bool = False) -> Cell:
    """
    Return the unit cell of the periodic fabric with the shell, connectors and weave of a scene.

    The size, loads, supports and groups of bodies of the scene have no effect. `branch` is the
    stiffness of connectors at their natural length: 'push' (None) is k_c, 'pull' is k_e. `relaxed`
    uses the equilibrium of the fabric, with contact unless `contact.mode` is never, and with
    sticking contacts if there is `contact.friction`; otherwise the state is as woven, without
    contact.

    Raises ParameterError if the fabric is not periodic (connectors may differ by direction), and
    ValueError if it has no equilibrium.
    """
    parameters = require_scene(scene).parameters
    check_branch(branch)
    relaxed = checks.flag('relaxed', relaxed)
    if parameters['weave.kind'] == 'radial':
        raise ParameterError(
            'weave.kind', 'weave.kind radial is not periodic; choose orthogonal or bias')
    if not parameters['weave.connected']:
        raise ParameterError(
            'weave.connected', 'weave.connected: nothing joins the bodies; set it to true')
    if not differ_by_direction_only(parameters):
        raise ParameterError(
            'connector_groups', 'connector_groups.* make connectors differ with position; for the '
            'periodic fabric give them a direction only, or leave them out')
    for name in parameters.names('connectors'):
        raise ParameterError(
            f'connectors.{name}', f'connectors.{name}: the periodic fabric has no custom '
            'connectors; leave it out, or compute curves and modes of a slab')
    if scene.electric.is_mutual:
        raise ParameterError(
            'charge.mutual', 'charge.mutual: the sum over all charges of a periodic fabric '
            'diverges; set it to false for the periodic fabric, or compute curves and modes of a '
            'slab')
    touches = relaxed and parameters['contact.mode'] != 'never'
    sized = size_parameter_names(parameters, scene.shell, ('masses',))
    if touches and sized:
        raise ParameterError(
            sized[0], f'{sized[0]} {parameters[sized[0]]!r} m: all shells of the periodic fabric '
            f'are equal; use shell.edge_length {scene.shell.edge_length!r} m, or contact.mode '
            'never')
    kept = {
        name: value for name, value in parameters.items()
        if name.startswith((*_CELL_PARAMETERS, *(('contact.',) if touches else ())))
        and value != '' and name != 'connector.obstruction'}
    kept['weave.size'] = _CELL_SLAB_SIZE
    piece = Scene.from_parameters(kept)
    bodies = piece.connectors.bodies
    full = np.flatnonzero(np.bincount(bodies.ravel(), minlength=piece.body_count) == 12)
    body = int(full[0])
    others = np.where(bodies == body, bodies[:, ::-1], -1).max(axis=1)
    neighbours = np.concatenate([[body], np.sort(others[others >= 0])])
    fabric = StaticFabric(
        piece, contact=touches, friction=FrictionPath.of(piece) if touches else None)
    here, rest = fabric.start, None
    if relaxed:
        rest = relax(Lattice(piece, body, contact=touches))
        here = deformed_configuration(
            fabric, piece.position - piece.position[body], rest.gradient, rest.turn)
        _stick(here)
        if here.contact_state is not None:
            pairs = here.contact_state.pairs
            pressed = np.where(pairs == body, pairs[:, ::-1], -1).max(axis=1)
            neighbours = np.concatenate([neighbours, np.setdiff1d(
                pressed[pressed >= 0], neighbours)])
    here = here.on(branch or PUSH)
    slope = np.abs(here.slope[here.slope != 0.0])
    if len(slope) and slope.max() > _ROUNDED_RATIO * slope.min():
        _LOGGER.warning(
            'stiffnesses of connectors differ by a factor %.2g: soft waves and moduli of the '
            'periodic fabric lose accuracy by round-off, and the softest may count as 0',
            slope.max() / slope.min())
    blocks = np.zeros((len(neighbours), 6, 6))
    for number, other in enumerate(neighbours):
        for freedom in range(6):
            vector = np.zeros((piece.body_count, 6))
            vector[other, freedom] = 1.0
            blocks[number, :, freedom] = here.times(vector)[body]
    return Cell(
        piece, body, neighbours, piece.position[neighbours] - piece.position[body], blocks,
        fabric.root, _inverse_sqrt_mass(fabric, here, body),
        bool((bodies[here.at_kink] == body).any()), rest)


def _inverse_sqrt_mass(fabric: StaticFabric, here: Configuration, body: int) -> np.ndarray:
    """Return M^-1/2 (6, 6) of a body on world axes."""
    inverse: np.ndarray = np.diag(1.0 / fabric.root)
    moments = fabric.scene.principal_inertia
    if moments is not None:
        # Rows are the principal axes of the body.
        axes = turned_axes(fabric.scene.principal_axes, here.axes)[body]
        inverse[3:, 3:] = np.einsum('ki,k,kj->ij', axes, moments[body] ** -0.5, axes)
    return inverse


def _stick(here: Configuration) -> None:
    """Make loaded contacts of a configuration stick, if the scene has friction."""
    fabric = here.fabric
    if fabric.friction is not None and fabric.contacts is not None:
        fabric.friction = fabric.friction.sticking(fabric.contacts, here.position, here.axes)


def solve_bands(
    scene: Scene, wave_vectors: np.ndarray, *, branch: str | None = None, relaxed: bool = False
) -> np.ndarray:
    """
    Compute the dispersion of Bloch waves in the periodic fabric.

    Parameters
    ----------
    scene
        Scene with the shell, connectors and weave; its size, loads and supports have no effect.
    wave_vectors
        Wave vectors (m, 3) [rad/m] of the lattice as woven, world frame. Those of the deformed
        lattice are F^-T times these.
    branch
        'pull' or 'push': k_e or k_c in all connectors. Required if connectors with two stiffnesses
        are at their natural length, where waves do not superpose.
    relaxed
        Compute waves about the equilibrium of the fabric, with contact (see `homogenise`).

    Returns
    -------
    ndarray
        Frequencies [rad/s] of the six waves, (m, 6), rising. Zero-energy waves have 0. Waves that
        lower the energy (under pre-stress) have negative values: minus their growth rate [1/s].

    Raises
    ------
    ValueError
        If the fabric is not periodic, has no equilibrium, or needs a `branch`.

    Notes
    -----
    If k_e - k_c has the same sign in all connectors, the k-th frequency of every mixture of
    connectors in extension and compression lies between those of the two branches.

    References
    ----------
    Born and Huang (1954), Dynamical Theory of Crystal Lattices, section 24.

    """
    relaxed = checks.flag('relaxed', relaxed)
    wave_vectors = checks.array(
        'wave_vectors', wave_vectors, ('[m]', 3), 'rad/m').reshape(-1, 3)
    require_scene(scene)
    cell = make_cell(scene, branch, relaxed=relaxed)
    if cell.at_kink and branch is None:
        raise ValueError(
            'the connectors of this fabric are at their natural length, where '
            'connector.stiffness_extension is not connector.stiffness_compression: small motions '
            "do not superpose there; give branch='pull' or branch='push' for the waves of a "
            'fabric with all connectors in extension or all in compression')
    phase = np.exp(1j * wave_vectors @ cell.offsets.T)
    scaled = cell.inverse_sqrt_mass @ cell.stiffness @ cell.inverse_sqrt_mass
    matrix = np.einsum('mr,rij->mij', phase, scaled)
    values = np.linalg.eigvalsh(0.5 * (matrix + np.conj(np.swapaxes(matrix, 1, 2))))
    largest = float(np.abs(scaled).sum(axis=(0, 2)).max())
    values[np.abs(values) < 1e-14 * largest] = 0.0
    return np.asarray(np.sign(values) * np.sqrt(np.abs(values)))


# Points of high symmetry in the Brillouin zone of the face-centred cubic lattice, in units of pi
# over the pitch, along the fabric's axes. The conventional cell is two pitches wide.
SYMMETRY_POINTS = {
    'Γ': (0.0, 0.0, 0.0), 'X': (1.0, 0.0, 0.0), 'W': (1.0, 0.5, 0.0), 'L': (0.5, 0.5, 0.5),
    'K': (0.75, 0.75, 0.0)}
SYMMETRY_PATH = ('Γ', 'X', 'W', 'L', 'Γ', 'K')


def band_path(scene: Scene, points: int = 40) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """
    Return a path of wave vectors (m, 3) [rad/m] through the points of high symmetry.

    Also returns distances along the path, and the indices of these points.
    """
    require_scene(scene)
    points = checks.count('points', points, 1)
    unit = math.pi / float(scene.geometry.pitch) * _grid_axes(scene)
    stops = [np.array(SYMMETRY_POINTS[name]) @ unit for name in SYMMETRY_PATH]
    path, marks = [stops[0]], [0]
    for first, second in zip(stops, stops[1:]):
        part = np.linspace(0.0, 1.0, points + 1)[1:, None]
        path += list(first + part * (second - first))
        marks.append(len(path) - 1)
    wave_vectors = np.array(path)
    steps = np.linalg.norm(np.diff(wave_vectors, axis=0), axis=1)
    return wave_vectors, np.concatenate([[0.0], np.cumsum(steps)]), marks


def sample_zone(scene: Scene, count: int) -> np.ndarray:
    """Return wave vectors (count^3, 3) [rad/m] on a grid of a reciprocal cell without k = 0."""
    require_scene(scene)
    count = checks.count('count', count, 1)
    pitch = float(scene.geometry.pitch)
    lattice = pitch * np.array([[0, 1, 1], [1, 0, 1], [1, 1, 0]], float) @ _grid_axes(scene)
    reciprocal = 2.0 * math.pi * np.linalg.inv(lattice)
    parts = (np.arange(count) + 0.5) / count
    grid = np.stack(np.meshgrid(parts, parts, parts, indexing='ij'), axis=-1).reshape(-1, 3)
    return np.asarray(grid @ reciprocal.T)


def _grid_axes(scene: Scene) -> np.ndarray:
    """Return the fabric's axes as rows, world frame."""
    grid, position = scene.weave.grid.astype(float), scene.position[:len(scene.weave.grid)]
    axes, *_ = np.linalg.lstsq(
        grid - grid.mean(axis=0), position - position.mean(axis=0), rcond=None)
    return np.asarray(axes / np.linalg.norm(axes, axis=1, keepdims=True))


@renamed_attributes(
    pulled='uniaxial_response', along='directional_moduli', rest='relaxed_state',
    soft_strains='zero_energy_strains')
@dataclass(frozen=True, repr=False)
class Elasticity(AsTable):
    """Elastic constants of the periodic fabric, world axes."""

    stiffness: np.ndarray  # (6, 6) [Pa], Voigt's order xx yy zz yz xz xy
    density: float  # [kg/m^3]
    # Orthonormal basis (z, 6) of the zero-energy strains.
    zero_energy_strains: np.ndarray
    # [Pa] stress of the state, Voigt's order; not 0 for woven fabrics under pre-stress.
    stress: np.ndarray
    energy: CellEnergy
    volume: float  # [m^3] of a cell
    # Connectors of a cell at their natural length with k_e other than k_c. There is no single
    # tangent there: stiffness, zero-energy strains and moduli are those of the `branch`, 'push'
    # (k_c) or 'pull' (k_e in all of them); '' if no connector is at its kink.
    at_kink: int = 0
    branch: str = ''
    # Both branches by name; empty if no connector is at its kink.
    branches: Mapping[str, 'Elasticity'] = field(default_factory=dict)
    # Equilibrium that the constants refer to; None: as woven.
    relaxed_state: LatticeRest | None = None

    def __repr__(self) -> str:
        """Return a summary without arrays."""
        kink = f', {self.branch} of {self.at_kink:,} connectors at their kink' if (
            self.branch) else ''
        return (f'<Elasticity: stiffness up to {np.abs(self.stiffness).max():.6g} Pa, '
                f'{len(self.zero_energy_strains)} zero-energy strains{kink}>')

    def table(self) -> dict[str, list[Any]]:
        """Return the stiffness, a row for each stress and a column for each strain."""
        return {'stress': list(LABELS), **{
            f'{name}_pa': column for name, column in zip(LABELS, self.stiffness.T.tolist())}}

    def response(self, strain: np.ndarray) -> Response:
        """
        Return the response to a small strain of this kind and sign, exact also at the kink.

        Parameters
        ----------
        strain
            Strain (6,) in Voigt's order xx yy zz yz xz xy; shears are angles.

        Returns
        -------
        Response
            Stress, modulus and rotation of the bodies.

        Raises
        ------
        ValueError
            If the strain is zero.
        """
        strain = checks.array('strain', strain, (6,))
        if not strain.any():
            raise ValueError(
                'strain must be six numbers in the order xx yy zz yz xz xy, not all 0')
        fixed, free = np.zeros(9), np.zeros((9, 3))
        fixed[:6], free[6:] = strain, np.eye(3)
        y = self.energy.relaxed(fixed, free)
        stress = self.energy.gradient(y)[:6] / self.volume
        return Response(
            strain, stress, self._modulus(float(stress @ strain) / float(strain @ strain)),
            y[6:], self.energy.limit(y))

    def uniaxial_response(self, direction: np.ndarray, sign: float = 1.0) -> Response:
        """
        Return the response to a small uniaxial load, exact also at the kink; lateral faces free.

        Parameters
        ----------
        direction
            Direction (3,) of the load, world frame.
        sign
            1 for tension, -1 for compression.

        Returns
        -------
        Response
            Strain, stress, modulus and rotation of the bodies.
        """
        n = checks.directions('direction', direction, single=True)
        wish = '1 (a pull) or -1 (a push)'
        if checks.number('sign', sign, wish=wish) not in (1.0, -1.0):
            raise ValueError(f'sign must be {wish}, got {sign!r}')
        # The strain along n is fixed; the strains orthogonal to it are free.
        pull = unit_tension(n)
        fixed, free = np.zeros(9), np.zeros((9, 8))
        fixed[:6] = sign * pull / float(pull @ pull)
        free[:6, :5] = np.linalg.svd(pull[None])[2][1:].T
        free[6:, 5:] = np.eye(3)
        y = self.energy.relaxed(fixed, free)
        stress = self.energy.gradient(y)[:6] / self.volume
        return Response(
            y[:6], stress, self._modulus(float(stress @ y[:6])), y[6:], self.energy.limit(y))

    def _modulus(self, value: float) -> float:
        """Return a modulus, or 0 if it is within round-off."""
        energy = self.energy
        most = np.abs(energy.rest).max() + float(
            np.maximum(energy.pull, energy.push) @ np.abs(energy.changes).max(axis=1)**2)
        return 0.0 if abs(value) <= _ZERO_RATIO * most / self.volume else value

    def young_modulus(self, direction: np.ndarray) -> np.ndarray:
        """
        Return Young's moduli of uniaxial loads.

        Parameters
        ----------
        direction
            Directions (..., 3), world frame.

        Returns
        -------
        ndarray
            Moduli (...) [Pa]; 0 if the load does work on a zero-energy strain.
        """
        return self._modulus_under(unit_tension(checks.directions('direction', direction)))

    def poisson_ratio(self, direction: np.ndarray, across: np.ndarray) -> np.ndarray:
        """
        Return Poisson's ratios: lateral contraction over extension under a uniaxial load.

        Parameters
        ----------
        direction
            Directions (..., 3) of the load, world frame.
        across
            Lateral directions (..., 3), world frame.

        Returns
        -------
        ndarray
            Ratios (...); NaN if the load does work on a zero-energy strain.
        """
        n, m = (
            checks.directions(name, value)
            for name, value in (('direction', direction), ('across', across)))
        checks.alike_rows('direction', n, 'across', m)
        pull, side = unit_tension(n), unit_tension(m)
        excited = excites_zero_energy(pull, self.zero_energy_strains)
        along = np.einsum('...i,ij,...j', pull, self._compliance, pull)
        ratio = -np.einsum('...i,ij,...j', side, self._compliance, pull) / along
        return np.where(excited, np.nan, ratio)

    def shear_modulus(self, normal: np.ndarray, along: np.ndarray) -> np.ndarray:
        """
        Return shear moduli: shear stress over shear angle, with all other stresses 0.

        Parameters
        ----------
        normal
            Normals (..., 3) of the sheared planes, world frame.
        along
            Directions (..., 3) in which the planes slide, world frame.

        Returns
        -------
        ndarray
            Moduli (...) [Pa]; 0 if the load does work on a zero-energy strain.

        Raises
        ------
        ValueError
            If a direction is not perpendicular to its normal.
        """
        n, m = (
            checks.directions(name, value)
            for name, value in (('normal', normal), ('along', along)))
        checks.alike_rows('normal', n, 'along', m)
        slant = np.abs((n * m).sum(axis=-1)).max(initial=0.0)
        if slant > 1e-6:
            raise ValueError(
                'along must be perpendicular to normal, because planes slide within themselves; '
                f'the cosine between them is up to {slant:.3g}')
        return self._modulus_under(unit_shear(n, m))

    def _modulus_under(self, load: np.ndarray) -> np.ndarray:
        """Return moduli (...) [Pa] under loads (..., 6); 0 for work on a zero-energy strain."""
        excited = excites_zero_energy(load, self.zero_energy_strains)
        with np.errstate(divide='ignore'):
            modulus = 1.0 / np.einsum('...i,ij,...j', load, self._compliance, load)
        return np.where(excited, 0.0, modulus)

    def directional_moduli(self, direction: np.ndarray) -> Directional:
        """
        Return Young's modulus for one direction, and extreme Poisson's ratios and shear moduli.

        Parameters
        ----------
        direction
            Direction (3,), world frame.

        Returns
        -------
        Directional
            Modulus [Pa], smallest and largest Poisson's ratio and shear modulus [Pa] of the planes
            normal to the direction, each with its lateral direction, and the reason if a ratio is
            undefined.
        """
        n = checks.directions('direction', direction, single=True)
        return directional(self._compliance, self.zero_energy_strains, n)

    @property
    def bulk_modulus(self) -> float:
        """Bulk modulus [Pa]: pressure over relative loss of volume; 0 if that costs no energy."""
        alike = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
        if excites_zero_energy(alike, self.zero_energy_strains):
            return 0.0
        return float(1.0 / (alike @ self._compliance @ alike))

    @property
    def _compliance(self) -> np.ndarray:
        return np.linalg.pinv(self.stiffness, rcond=_ZERO_RATIO, hermitian=True)


def homogenise(
    scene: Scene, *, branch: str | None = None, relaxed: bool = False
) -> Elasticity:
    """
    Compute the effective elastic constants of the periodic fabric.

    Parameters
    ----------
    scene
        Scene with the shell, connectors and weave; its size, loads and supports have no effect.
    branch
        Stiffness of connectors at their natural length: 'push' (None) is k_c, 'pull' is k_e. The
        methods `response` and `uniaxial_response` of the result are exact for a given small
        strain or load.
    relaxed
        Refer to the equilibrium of the periodic fabric (`relaxed_state` of the result), with
        contact unless `contact.mode` is never, instead of the woven state. Contacts at first touch
        are left out (`relaxed_state.first_touches`). With `contact.friction` loaded contacts
        stick, as they do up to the first slip.

    Returns
    -------
    Elasticity
        Stiffness [Pa], zero-energy strains and moduli, world axes.

    Raises
    ------
    ValueError
        If the fabric is not periodic or has no equilibrium.

    Notes
    -----
    All bodies are displaced by the same strain, x -> x + eps x, and rotated by a common rotation
    that minimises the energy. With one body per primitive cell nothing else can relax. The
    constants are second derivatives of the cell energy with respect to symmetric displacement
    gradients, exact for all terms of the connectors and under pre-stress.

    """
    cell = make_cell(scene, branch, relaxed=relaxed)
    touches = relaxed and scene.parameters['contact.mode'] != 'never'
    lattice, gradient = Lattice(cell.scene, cell.body, contact=touches), np.eye(3)
    if cell.relaxed_state is None:
        here = lattice.fabric.start
    else:
        gradient = cell.relaxed_state.gradient
        here = lattice.at(gradient, cell.relaxed_state.turn)
        _stick(here)
    motions = lattice.motions(gradient)
    energy = _cell_energy(here, motions)
    if not len(energy.changes):
        return _constants(cell, here, motions, energy)
    branches = {side: replace(
        _constants(cell, here.on(side), motions, energy), at_kink=len(energy.changes),
        branch=side) for side in BRANCHES}
    return replace(branches[branch or PUSH], branches=branches)


def _constants(
    cell: Cell, here: Configuration, motions: np.ndarray, cell_energy: CellEnergy
) -> Elasticity:
    energy = hessian_along(here, motions)
    strain, mixed, turn = energy[:6, :6], energy[:6, 6:], energy[6:, 6:]
    stiffness = strain - mixed @ np.linalg.pinv(turn, rcond=_ZERO_RATIO, hermitian=True) @ mixed.T
    stiffness = 0.5 * (stiffness + stiffness.T) / cell.volume
    values, vectors = np.linalg.eigh(stiffness)
    soft = vectors[:, np.abs(values) <= _ZERO_RATIO * np.abs(strain).max() / cell.volume].T
    stress = -np.einsum('inf,nf->i', motions[:6], here.force) / cell.volume
    return Elasticity(
        stiffness, cell.density, soft, stress, cell_energy, cell.volume,
        relaxed_state=cell.relaxed_state)


def _cell_energy(here: Configuration, motions: np.ndarray) -> CellEnergy:
    at_kink, fabric = here.at_kink, here.fabric
    changes = length_changes(here, motions).T
    elsewhere = np.flatnonzero(
        fabric.laws.kinked & fabric.counted & ~here.stretched.at_kink)
    return CellEnergy(
        changes[at_kink], here.on(PULL).slope[at_kink], here.on(PUSH).slope[at_kink],
        hessian_along(here.on(WITHOUT), motions), changes[elsewhere],
        here.stretched.stretch[elsewhere])
