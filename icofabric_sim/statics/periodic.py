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
The fabric without end: waves, and the elastic constants of its homogeneous equivalent.

All bodies of a weave have the same twelve neighbours and the same connectors to them, so the
lattice is face-centred cubic with one body, six freedoms and six connectors to a cell: as many
constraints as freedoms. A wave u = w exp(i k.x) has D(k) w = omega^2 M w with the dynamical matrix
D(k) = sum_R H(0, R) exp(i k.R) over a body and its neighbours (Born and Huang 1954, Dynamical
Theory of Crystal Lattices, 24).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
import logging
import math
from typing import Any

from icofabric_sim import checks
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.scene.body_sizes import names_of_sizes
from icofabric_sim.scene.connector_groups import alike_everywhere
from icofabric_sim.scene.scene import require_scene, Scene
from icofabric_sim.simulation.model.as_table import AsTable
from icofabric_sim.statics.directional import (
    Directional,
    directional,
    LABELS,
    meets_soft,
    pull_of,
    shear_of,
)
from icofabric_sim.statics.fabric import Configuration, StaticFabric
from icofabric_sim.statics.friction import FrictionPath
from icofabric_sim.statics.kinks import length_changes
from icofabric_sim.statics.lattice import form, Lattice, LatticeRest, placed, relax
from icofabric_sim.statics.one_sided import CellEnergy, Response
from icofabric_sim.statics.sides import BRANCHES, check_branch, PULL, PUSH, WITHOUT
import numpy as np

# Grid positions of the piece whose innermost body has all its neighbours.
_PIECE = [5, 5, 5]
_KEPT = ('shell.', 'connector.', 'connector_groups.', 'weave.kind', 'weave.azimuth',
         'weave.connector_length', 'weave.connector_angle')
_ZERO = 1e-9
# Ratio of stiffnesses above which rounding is reported.
_ROUNDED_RATIO = 1e7
_LOGGER = logging.getLogger('icofabric_sim')


@dataclass(frozen=True)
class Cell:
    """One body of an endless fabric and what joins it to its neighbours."""

    scene: Scene  # a piece of it
    body: int  # of that piece, with all its neighbours
    neighbours: np.ndarray  # (m,) itself first, twelve that it is joined to, and others it presses
    offsets: np.ndarray  # (m, 3) [m] from its centre, as woven
    stiffness: np.ndarray  # (m, 6, 6) second derivatives H(0, R) of the energy
    root: np.ndarray  # (6,) roots of mass and the least moment of inertia
    inverse_root: np.ndarray  # (6, 6) M^-1/2 with all moments, world axes
    # Whether connectors are at their natural length, where k_e is not k_c.
    at_kink: bool
    rest: LatticeRest | None = None  # where it has relaxed to; None: as woven

    @property
    def volume(self) -> float:
        """Volume [m^3] for each body: every second point of a grid of pitch W, deformed."""
        deformed = 1.0 if self.rest is None else float(np.linalg.det(self.rest.gradient))
        return 2.0 * float(self.scene.geometry.pitch) ** 3 * deformed

    @property
    def density(self) -> float:
        """Mass in that volume [kg/m^3]."""
        return float(self.root[0]) ** 2 / self.volume


def make_cell(scene: Scene, branch: str | None = None, *, relaxed: bool = False) -> Cell:
    """
    Cell of the endless fabric with the shell, connectors and weave of a scene.

    Its size, loads, supports and groups of bodies do not count. `branch`: how connectors at their
    kink count in its second derivatives, 'push' (None) or 'pull'. `relaxed`: about its rest, with
    what shells do to each other unless `contact.mode` is never, and with `contact.friction` what
    presses there sticks; else as woven, without contact.
    ParameterError where the weave does not repeat, or connectors differ from place to place (by
    direction they may); ValueError where it has no rest.
    """
    parameters = require_scene(scene).parameters
    check_branch(branch)
    relaxed = checks.flag('relaxed', relaxed)
    if parameters['weave.kind'] == 'radial':
        raise ParameterError(
            'weave.kind', 'weave.kind radial does not repeat in space; choose orthogonal or bias')
    if not parameters['weave.connected']:
        raise ParameterError(
            'weave.connected', 'weave.connected: nothing joins the bodies; set it to true')
    if not alike_everywhere(parameters):
        raise ParameterError(
            'connector_groups', 'connector_groups.* make connectors differ from place to place; '
            'for the endless fabric give them a direction only, or leave them out')
    if scene.electric.mutual and scene.electric.charge.any():
        raise ParameterError(
            'charge.mutual', 'charge.mutual: the sum over all charges of an endless fabric has no '
            'end; set it to false for the endless fabric, or take curves and modes of a slab')
    touches = relaxed and parameters['contact.mode'] != 'never'
    sized = names_of_sizes(parameters, scene.shell, ('masses',))
    if touches and sized:
        raise ParameterError(
            sized[0], f'{sized[0]} {parameters[sized[0]]!r} m: shells of the endless fabric are '
            f'alike; take shell.edge_length {scene.shell.edge_length!r} m, or contact.mode never')
    kept = {
        name: value for name, value in parameters.items()
        if name.startswith((*_KEPT, *(('contact.',) if touches else ())))
        and value != '' and name != 'connector.obstruction'}
    kept['weave.size'] = _PIECE
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
        here = placed(
            fabric, piece.position - piece.position[body], rest.gradient, rest.turn)
        _stick(here)
        if here.touching is not None:
            pairs = here.touching.pairs
            pressed = np.where(pairs == body, pairs[:, ::-1], -1).max(axis=1)
            neighbours = np.concatenate([neighbours, np.setdiff1d(
                pressed[pressed >= 0], neighbours)])
    here = here.on(branch or PUSH)
    slope = np.abs(here.slope[here.slope != 0.0])
    if len(slope) and slope.max() > _ROUNDED_RATIO * slope.min():
        _LOGGER.warning(
            'connectors differ %.2g times in stiffness: rounding takes digits of soft waves and '
            'moduli of the endless fabric, and may count soft ones as 0',
            slope.max() / slope.min())
    blocks = np.zeros((len(neighbours), 6, 6))
    for number, other in enumerate(neighbours):
        for freedom in range(6):
            vector = np.zeros((piece.body_count, 6))
            vector[other, freedom] = 1.0
            blocks[number, :, freedom] = here.times(vector)[body]
    return Cell(
        piece, body, neighbours, piece.position[neighbours] - piece.position[body], blocks,
        fabric.root, _inverse_root(fabric, here, body),
        bool((bodies[here.at_kink] == body).any()), rest)


def _inverse_root(fabric: StaticFabric, here: Configuration, body: int) -> np.ndarray:
    """M^-1/2 (6, 6) of a body on world axes, of moments of inertia that may differ."""
    inverse: np.ndarray = np.diag(1.0 / fabric.root)
    moments = fabric.scene.principal_inertia
    if moments is not None:
        # Rows are the axes of the body.
        axes = here.axes[body]
        inverse[3:, 3:] = np.einsum('ki,k,kj->ij', axes, moments[body] ** -0.5, axes)
    return inverse


def _stick(here: Configuration) -> None:
    """With friction what presses sticks, in all that is found from there on."""
    fabric = here.fabric
    if fabric.friction is not None and fabric.contacts is not None:
        fabric.friction = fabric.friction.pressed(fabric.contacts, here.position, here.axes)


def solve_bands(
    scene: Scene, wave_vectors: np.ndarray, *, branch: str | None = None, relaxed: bool = False
) -> np.ndarray:
    """
    Frequencies [rad/s] of the six waves with each of the wave vectors (m, 3) [rad/m]: (m, 6).

    Rising; waves that cost no energy have 0, those that lower it (under pre-stress) negative
    values, the size of which is the rate of their growth. Where connectors are at their natural
    length and have two stiffnesses there are no waves that add up, and a `branch` has to
    be named: 'pull' or 'push', with k_e or k_c in all connectors. The k-th frequency of every
    mixture of pulling and pushing connectors lies between those of the two.
    `relaxed`: about the rest of the fabric, with contact (see `homogenise`); wave vectors are
    those of the lattice as woven, of the deformed one they are F^-T times these.
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
            "do not superpose there; say branch='pull' or branch='push' for the waves of a fabric "
            'whose connectors all pull or all push')
    phase = np.exp(1j * wave_vectors @ cell.offsets.T)
    scaled = cell.inverse_root @ cell.stiffness @ cell.inverse_root
    matrix = np.einsum('mr,rij->mij', phase, scaled)
    values = np.linalg.eigvalsh(0.5 * (matrix + np.conj(np.swapaxes(matrix, 1, 2))))
    largest = float(np.abs(scaled).sum(axis=(0, 2)).max())
    values[np.abs(values) < 1e-14 * largest] = 0.0
    return np.asarray(np.sign(values) * np.sqrt(np.abs(values)))


# Points of high symmetry of a face-centred cubic lattice, in units of pi over the pitch, along the
# fabric's own axes. Its conventional cell is two pitches wide.
SYMMETRY_POINTS = {
    'Γ': (0.0, 0.0, 0.0), 'X': (1.0, 0.0, 0.0), 'W': (1.0, 0.5, 0.0), 'L': (0.5, 0.5, 0.5),
    'K': (0.75, 0.75, 0.0)}
SYMMETRY_PATH = ('Γ', 'X', 'W', 'L', 'Γ', 'K')


def band_path(scene: Scene, points: int = 40) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """
    Wave vectors (m, 3) [rad/m] through the points of high symmetry, distances along, and stops.
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
    """Wave vectors (count^3, 3) [rad/m] spread evenly over all waves, none of them zero."""
    require_scene(scene)
    count = checks.count('count', count, 1)
    pitch = float(scene.geometry.pitch)
    lattice = pitch * np.array([[0, 1, 1], [1, 0, 1], [1, 1, 0]], float) @ _grid_axes(scene)
    reciprocal = 2.0 * math.pi * np.linalg.inv(lattice)
    parts = (np.arange(count) + 0.5) / count
    grid = np.stack(np.meshgrid(parts, parts, parts, indexing='ij'), axis=-1).reshape(-1, 3)
    return np.asarray(grid @ reciprocal.T)


def _grid_axes(scene: Scene) -> np.ndarray:
    """The fabric's own axes as rows, in the world."""
    grid, position = scene.weave.grid.astype(float), scene.position[:len(scene.weave.grid)]
    axes, *_ = np.linalg.lstsq(
        grid - grid.mean(axis=0), position - position.mean(axis=0), rcond=None)
    return np.asarray(axes / np.linalg.norm(axes, axis=1, keepdims=True))


@dataclass(frozen=True, repr=False)
class Elasticity(AsTable):
    """Elastic constants of the endless fabric, world axes."""

    stiffness: np.ndarray  # (6, 6) [Pa], Voigt's order xx yy zz yz xz xy
    density: float  # [kg/m^3]
    # Strains (z, 6) that cost no energy: an orthonormal basis.
    soft_strains: np.ndarray
    # [Pa] of the state, Voigt's order; not 0 where connectors of a woven one are pre-stressed.
    stress: np.ndarray
    energy: CellEnergy
    volume: float  # [m^3] of a cell
    # How many connectors of a cell are at their natural length, where k_e is not k_c. There is no
    # single tangent there: stiffness, soft strains and moduli are those of the `branch`, 'push'
    # (k_c) or 'pull' (k_e in all of them); '' where none is at its kink.
    at_kink: int = 0
    branch: str = ''
    # Both by name; empty where none is at its kink.
    branches: Mapping[str, 'Elasticity'] = field(default_factory=dict)
    rest: LatticeRest | None = None  # the state that they are about; None: as woven

    def __repr__(self) -> str:
        """Say how stiff it is, without the numbers."""
        kink = f', {self.branch} of {self.at_kink:,} connectors at their kink' if (
            self.branch) else ''
        return (f'<Elasticity: stiffness up to {np.abs(self.stiffness).max():.6g} Pa, '
                f'{len(self.soft_strains)} strains without energy{kink}>')

    def table(self) -> dict[str, list[Any]]:
        """Stiffness: a row for each stress, a column for each strain, in Voigt's order."""
        return {'stress': list(LABELS), **{
            f'{name}_pa': column for name, column in zip(LABELS, self.stiffness.T.tolist())}}

    def response(self, strain: np.ndarray) -> Response:
        """
        What a small strain (6,) of this kind and sign meets, exact also at the kink.

        Strains in Voigt's order, xx yy zz yz xz xy; those of shear are angles.
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

    def pulled(self, direction: np.ndarray, sign: float = 1.0) -> Response:
        """What a small pull along a direction (3,) meets, or a push, `sign` -1; free across."""
        n = checks.directions('direction', direction, single=True)
        wish = '1 (a pull) or -1 (a push)'
        if checks.number('sign', sign, wish=wish) not in (1.0, -1.0):
            raise ValueError(f'sign must be {wish}, got {sign!r}')
        # n . strain n, of which the others leave nothing.
        pull = pull_of(n)
        fixed, free = np.zeros(9), np.zeros((9, 8))
        fixed[:6] = sign * pull / float(pull @ pull)
        free[:6, :5] = np.linalg.svd(pull[None])[2][1:].T
        free[6:, 5:] = np.eye(3)
        y = self.energy.relaxed(fixed, free)
        stress = self.energy.gradient(y)[:6] / self.volume
        return Response(
            y[:6], stress, self._modulus(float(stress @ y[:6])), y[6:], self.energy.limit(y))

    def _modulus(self, value: float) -> float:
        """Without what is rounding."""
        energy = self.energy
        most = np.abs(energy.rest).max() + float(
            np.maximum(energy.pull, energy.push) @ np.abs(energy.changes).max(axis=1)**2)
        return 0.0 if abs(value) <= _ZERO * most / self.volume else value

    def young_modulus(self, direction: np.ndarray) -> np.ndarray:
        """
        Modulus [Pa] for a pull along directions (..., 3); 0 where a strain without energy yields.
        """
        n = checks.directions('direction', direction)
        pull = pull_of(n)
        yields = meets_soft(pull, self.soft_strains)
        with np.errstate(divide='ignore'):
            modulus = 1.0 / np.einsum('...i,ij,...j', pull, self._compliance, pull)
        return np.where(yields, 0.0, modulus)

    def poisson_ratio(self, direction: np.ndarray, across: np.ndarray) -> np.ndarray:
        """
        Contraction along `across` for a stretch by a pull along `direction`; NaN where it yields.
        """
        n, m = (
            checks.directions(name, value)
            for name, value in (('direction', direction), ('across', across)))
        checks.alike_rows('direction', n, 'across', m)
        pull, side = pull_of(n), pull_of(m)
        yields = meets_soft(pull, self.soft_strains)
        along = np.einsum('...i,ij,...j', pull, self._compliance, pull)
        ratio = -np.einsum('...i,ij,...j', side, self._compliance, pull) / along
        return np.where(yields, np.nan, ratio)

    def shear_modulus(self, normal: np.ndarray, along: np.ndarray) -> np.ndarray:
        """
        Modulus [Pa] for a shear of the planes across `normal` along `along`, both (..., 3).

        The stress over the angle, nothing held beside; 0 where a strain without energy yields.
        ValueError where the two are not perpendicular.
        """
        n, m = (
            checks.directions(name, value)
            for name, value in (('normal', normal), ('along', along)))
        checks.alike_rows('normal', n, 'along', m)
        slant = np.abs((n * m).sum(axis=-1)).max(initial=0.0)
        if slant > 1e-6:
            raise ValueError(
                'along must be perpendicular to normal: planes slide within themselves; the '
                f'cosine between them is up to {slant:.3g}')
        shear = shear_of(n, m)
        yields = meets_soft(shear, self.soft_strains)
        with np.errstate(divide='ignore'):
            modulus = 1.0 / np.einsum('...i,ij,...j', shear, self._compliance, shear)
        return np.where(yields, 0.0, modulus)

    def along(self, direction: np.ndarray) -> Directional:
        """
        Young's modulus [Pa] along one direction (3,), and the extremes of what goes across.

        Least and largest Poisson's ratio of the pull, and shear modulus [Pa] of the planes across
        it, each with its direction. Says what is undefined, and why.
        """
        n = checks.directions('direction', direction, single=True)
        return directional(self._compliance, self.soft_strains, n)

    @property
    def bulk_modulus(self) -> float:
        """
        Pressure [Pa] over the loss of volume under it; 0 where a strain without energy yields.
        """
        alike = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
        if meets_soft(alike, self.soft_strains):
            return 0.0
        return float(1.0 / (alike @ self._compliance @ alike))

    @property
    def _compliance(self) -> np.ndarray:
        return np.linalg.pinv(self.stiffness, rcond=_ZERO, hermitian=True)


def homogenise(
    scene: Scene, *, branch: str | None = None, relaxed: bool = False
) -> Elasticity:
    """
    Elastic constants of a fabric in its woven state, the rotations of the bodies relaxed.

    Every body is displaced by the same strain, x -> x + eps x, and turned by the same rotation,
    which minimises the energy: with one body to a cell nothing else can relax. From the energy of
    the six connectors of a cell, so exact for all terms of the connectors. Under pre-stress: the
    second derivative of the energy by symmetric displacement gradients. `branch`: how connectors
    at their kink count in the constants, 'push' (None) or 'pull'; `.response` and `.pulled` say
    what small strains of one sign meet there.

    `relaxed`: about the rest of the endless fabric, to which places deform alike and bodies turn
    alike (`.rest`), with what shells do to their neighbours unless `contact.mode` is never.
    Strains are of that state. Pairs at their first touch are left out (`.rest.first_touches`).
    With `contact.friction` what presses there sticks, as it does up to the first slip.
    """
    cell = make_cell(scene, branch, relaxed=relaxed)
    touches = relaxed and scene.parameters['contact.mode'] != 'never'
    lattice, gradient = Lattice(cell.scene, cell.body, contact=touches), np.eye(3)
    if cell.rest is None:
        here = lattice.fabric.start
    else:
        gradient = cell.rest.gradient
        here = lattice.at(gradient, cell.rest.turn)
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
    energy = form(here, motions)
    strain, mixed, turn = energy[:6, :6], energy[:6, 6:], energy[6:, 6:]
    stiffness = strain - mixed @ np.linalg.pinv(turn, rcond=_ZERO, hermitian=True) @ mixed.T
    stiffness = 0.5 * (stiffness + stiffness.T) / cell.volume
    values, vectors = np.linalg.eigh(stiffness)
    soft = vectors[:, np.abs(values) <= _ZERO * np.abs(strain).max() / cell.volume].T
    stress = -np.einsum('inf,nf->i', motions[:6], here.force) / cell.volume
    return Elasticity(
        stiffness, cell.density, soft, stress, cell_energy, cell.volume, rest=cell.rest)


def _cell_energy(here: Configuration, motions: np.ndarray) -> CellEnergy:
    at_kink, fabric = here.at_kink, here.fabric
    changes = length_changes(here, motions).T
    elsewhere = np.flatnonzero(
        fabric.laws.kinked & fabric.counted & ~here.stretched.at_kink)
    return CellEnergy(
        changes[at_kink], here.on(PULL).slope[at_kink], here.on(PUSH).slope[at_kink],
        form(here.on(WITHOUT), motions), changes[elsewhere], here.stretched.stretch[elsewhere])
