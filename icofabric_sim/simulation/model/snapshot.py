# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Snapshots: immutable copies of the state at one time."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

from icofabric_sim.checks import counted, renamed_attributes
from icofabric_sim.geometry.rotations import cosines_from_quaternions, relative_rotation
from icofabric_sim.kernels.frequency_bound import field_energy
from icofabric_sim.kernels.moments import moment_energy
from icofabric_sim.kernels.obstruction import find_obstructed
from icofabric_sim.kernels.outlines import fill_lengths, fill_lines
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.scene.masses import turned_axes
from icofabric_sim.scene.notebook import html_of
from icofabric_sim.simulation.model.as_table import AsTable
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.model.wrapped_paths import Segments, straight_segments, trace_paths
from icofabric_sim.terms.wrapping.lengths import measure_wrapped
import numpy as np

_COLUMNS = (
    ('x_m', 'y_m', 'z_m'), ('qx', 'qy', 'qz', 'qw'), ('vx_m_s', 'vy_m_s', 'vz_m_s'),
    ('wx_rad_s', 'wy_rad_s', 'wz_rad_s'), ('wx_body_rad_s', 'wy_body_rad_s', 'wz_body_rad_s'))


@renamed_attributes(lost='without_geodesic')
@dataclass(frozen=True, repr=False)
class Snapshot(AsTable):
    """State of a fabric at one time, world frame; derived values are computed when first read."""

    time: float  # [s]
    position: np.ndarray  # (n, 3) [m]
    orientation: np.ndarray  # (n, 4) unit quaternions x y z w, body to world
    linear_velocity: np.ndarray  # (n, 3) [m/s]
    angular_velocity: np.ndarray  # (n, 3) [rad/s]
    connector_count: int
    packed: PackedScene
    # [J] work in, what was spent and lost at breaks, energy less work at the start, potential of
    # a body force
    ledger: Mapping[str, float]
    broken_since: np.ndarray | None = None  # (c,) [s], NaN while unbroken; None: all are whole
    # Bodies (a,), arms (a, 3) and world points (a, 3) [m] of the anchors.
    anchors: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
    # (a,) [s], NaN while unbroken; None: none of them breaks
    anchors_broken_since: np.ndarray | None = None
    # (c,) [m] lengths at which the springs of Maxwell arms rest; None without arms
    rest_length: np.ndarray | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields without derived values."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Set the fields, with arrays of the state read-only."""
        vars(self).update(state)
        for name in (*InitialState._fields, 'rest_length'):
            if state[name] is not None:
                view = vars(self)[name] = state[name].view()
                view.flags.writeable = False

    def __repr__(self) -> str:
        """Return time, number of bodies and number of connectors."""
        broken = int(np.count_nonzero(~self.intact))
        torn = f', {broken:,} of them broken' if broken else ''
        return (f'<Snapshot at t = {self.time:.9g} s: {counted(len(self.position), "body")}, '
                f'{counted(self.connector_count, "connector")}{torn}>')

    def table(self) -> dict[str, list[float]]:
        """Return the state of the bodies as a list for each column, named with its unit."""
        columns: dict[str, list[float]] = {'body': list(range(len(self.position)))}
        for names, values in zip(_COLUMNS, (
                self.position, self.orientation, self.linear_velocity, self.angular_velocity,
                self.angular_velocity_body)):
            columns.update(zip(names, values.T.tolist()))
        return columns

    def _repr_html_(self) -> str:
        """Return a table for notebooks."""
        energy = self.energy
        return html_of('Snapshot', {
            'time': f'{self.time:.9g} s',
            'bodies': f'{len(self.position):,}',
            'connectors': f'{self.connector_count:,}, {np.count_nonzero(~self.intact):,} broken',
            'from': f'{np.array2string(self.position.min(axis=0), precision=4)} m',
            'to': f'{np.array2string(self.position.max(axis=0), precision=4)} m',
            'kinetic energy': f'{energy["kinetic"]:.6g} J',
            'energy of connectors': f'{energy["connectors"]:.6g} J',
            'balance error': f'{energy["balance_error"]:.2g} J'})

    @cached_property
    def intact(self) -> np.ndarray:
        """Unbroken connectors, (c,) bool."""
        return np.asarray(np.isnan(self.break_time))

    @cached_property
    def break_time(self) -> np.ndarray:
        """Times of breakage [s], (c,); NaN while unbroken."""
        if self.broken_since is None:
            return np.full(self.connector_count, np.nan)
        return self.broken_since

    @property
    def anchor_intact(self) -> np.ndarray:
        """Unbroken anchors, (a,) bool, in the order of the scene."""
        if self.anchors_broken_since is None:
            return np.ones(0 if self.anchors is None else len(self.anchors[0]), bool)
        return np.isnan(self.anchors_broken_since)

    @cached_property
    def connector_ends(self) -> np.ndarray:
        """World positions [m] of the ends of every connector, (c, 2, 3)."""
        connectors = self.packed.connectors
        if connectors is None:
            return np.zeros((0, 2, 3))
        ends = np.empty((len(connectors.first), 2, 3))
        every = np.zeros(len(ends), np.uint8)
        fill_lines(connectors, *self._frozen(), every, 0, ends.reshape(-1, 3))
        return ends

    @cached_property
    def connector_segments(self) -> Segments:
        """
        Straight segments of every connector, along its path over shells.

        A connector has one segment between its ends. With `connector.obstruction: wrap`, a
        connector that is wrapped over a shell bends at each edge that it crosses.
        """
        connectors, wrapping = self.packed.connectors, self.packed.model.wrapping
        if connectors is None or wrapping is None:
            return straight_segments(self.connector_ends)
        return trace_paths(
            wrapping, connectors, self.connector_ends, np.flatnonzero(self.obstructed),
            self.position, self.orientation)

    @cached_property
    def anchor_ends(self) -> np.ndarray:
        """
        World positions [m] of the ends of every anchor, (a, 2, 3), the end at the body first.

        Broken anchors are included.
        """
        if self.anchors is None:
            return np.zeros((0, 2, 3))
        body, arm, point = self.anchors
        axes = cosines_from_quaternions(self.orientation[body])
        ends = self.position[body] + np.einsum('ai,aij->aj', arm, axes)
        return np.stack([ends, point], axis=1)

    @cached_property
    def connector_length(self) -> np.ndarray:
        """Lengths [m] of the connectors, (c,), along the geodesic if wrapped over a shell."""
        connectors = self.packed.connectors
        if connectors is None:
            return np.zeros(0)
        length = np.empty(len(connectors.first))
        fill_lengths(connectors, *self._frozen(), length)
        wrapping = self.packed.model.wrapping
        if wrapping is not None:
            measure_wrapped(
                wrapping, connectors, *self._rows(), self.obstructed, length,
                np.empty(len(length), np.uint8))
        return length

    @cached_property
    def spring_energy(self) -> np.ndarray:
        """Energies [J] of the springs of connectors, (c,), without moments and anchors."""
        connectors = self.packed.connectors
        if connectors is None:
            return np.zeros(0)
        length = self.connector_length
        stretch = length - connectors.natural_length
        slope = np.where(stretch > 0.0, connectors.extension, connectors.compression)
        each = self.packed.curves.replace(
            'energy', 0.5 * slope * stretch**2, length, connectors.extension,
            connectors.natural_length)
        if self.broken_since is not None:
            each[~self.intact] = 0.0
        return np.asarray(each)

    @cached_property
    def maxwell_tension(self) -> np.ndarray:
        """Tensions [N] of the Maxwell arms of connectors, (c,); 0 without arm or if broken."""
        arms = self.packed.arms
        if self.rest_length is None or arms is None:
            return np.zeros(self.connector_count)
        pull = arms.stiffness * (self.connector_length - self.rest_length)
        return np.where(self.intact, pull, 0.0)

    @cached_property
    def angular_velocity_body(self) -> np.ndarray:
        """Angular velocities [rad/s] in the axes of each body, (n, 3): eq 18, inverted."""
        return np.einsum(
            'bij,bj->bi', cosines_from_quaternions(self.orientation), self.angular_velocity)

    @cached_property
    def spin_momentum(self) -> np.ndarray:
        """
        Angular momenta I omega [kg m^2/s] of the bodies about their centres, (n, 3), world frame.
        """
        moments = self.packed.principal_inertia
        if moments is None:
            return np.asarray(self.packed.masses.inertia[:, None] * self.angular_velocity)
        axes = turned_axes(
            self.packed.principal_axes, cosines_from_quaternions(self.orientation))
        return np.einsum(
            'bi,bij->bj', moments * np.einsum('bij,bj->bi', axes, self.angular_velocity), axes)

    @cached_property
    def without_geodesic(self) -> np.ndarray:
        """
        Connectors without a geodesic over their first (bit 0) or second (bit 1) body.

        (c,) uint8, for `connector.obstruction: wrap`.
        """
        found = np.zeros(self.connector_count, np.uint8)
        connectors, wrapping = self.packed.connectors, self.packed.model.wrapping
        if connectors is not None and wrapping is not None:
            measure_wrapped(
                wrapping, connectors, *self._rows(), self.obstructed, np.empty(len(found)), found)
        return found

    @cached_property
    def obstructed(self) -> np.ndarray:
        """
        Connectors that enter the shell of their first body (bit 0) or second (bit 1), (c,) uint8.
        """
        found = np.zeros(self.connector_count, np.uint8)
        connectors = self.packed.connectors
        if connectors is not None:
            # Custom connectors may attach anywhere.
            find_obstructed(
                connectors, self.packed.model.shells, *self._frozen(), found[self.packed.woven])
            if self.broken_since is not None:
                found[~self.intact] = 0
        return found

    @cached_property
    def energy(self) -> dict[str, float]:
        """
        Energies [J] by term, their sum `total`, and the energy balance.

        The terms are `kinetic`, `connectors`, `gravity` (zero at the origin), `contact` and
        `field`. `field` includes charges (zero at the origin) and dipoles (zero along the field)
        in the electric field, mutual energies of charges, and the potential of a body force.

        The energy balance has the external work `work_in`, the energies `dissipated` and
        `lost_at_breaks`, and the `balance_error`. The error is the change of `total` since the
        start, minus `work_in`, plus `dissipated` and `lost_at_breaks`.
        """
        mass, inertia = self.packed.masses
        energy = {
            'kinetic': 0.5 * _weighed(mass, (self.linear_velocity**2).sum(axis=1))
            + (0.5 * _weighed(inertia, (self.angular_velocity**2).sum(axis=1))
               if self.packed.principal_inertia is None
               else 0.5 * float((self.spin_momentum * self.angular_velocity).sum())),
            'connectors': 0.0,
            'gravity': 0.0,
            'contact': self.ledger.get('contact', 0.0),
            'field': self._field_energy(),
        }
        connectors = self.packed.connectors
        if connectors is not None:
            if not self.packed.curves.curves and len(connectors.extension) == 1 and (
                    connectors.extension[0] == connectors.compression[0]):
                stretch = self.connector_length - connectors.natural_length
                if self.broken_since is not None:
                    stretch[~self.intact] = 0.0
                np.square(stretch, out=stretch)
                energy['connectors'] = 0.5 * float(connectors.extension[0]) * float(stretch.sum())
            else:
                energy['connectors'] = float(self.spring_energy.sum())
        if self.packed.moments is not None:
            moments = self.packed.moments
            ends = self.connector_ends[self.packed.woven]
            orientation = self._frozen()[1]
            if moments.woven is not None:
                orientation = relative_rotation(orientation, moments.woven)
            if self.broken_since is not None:
                intact = self.intact[self.packed.woven]
                whole, ends = np.flatnonzero(intact), ends[intact]
                moments = moments._replace(**{
                    name: values[whole] for name, values in moments._asdict().items()
                    if name != 'woven' and len(values) > 1})
            energy['connectors'] += moment_energy(moments, orientation, ends)
        if self.rest_length is not None and self.packed.arms is not None:
            # What holds no arm holds no energy.
            energy['connectors'] += 0.5 * float((
                self.maxwell_tension * (self.connector_length - self.rest_length)).sum())
        energy['connectors'] += self.ledger.get('anchors', 0.0)
        if self.packed.gravity is not None:
            energy['gravity'] = -_weighed(mass, self.position @ self.packed.gravity)
        energy['total'] = sum(energy.values())
        energy['work_in'], energy['dissipated'] = self.ledger['work_in'], self.ledger['spent']
        energy['lost_at_breaks'] = self.ledger.get('lost_at_breaks', 0.0)
        energy['balance_error'] = (
            energy['total'] - energy['work_in'] + energy['dissipated']
            + energy['lost_at_breaks'] - self.ledger['start'])
        return energy

    def _field_energy(self) -> float:
        packed, energy = self.packed, self.ledger['potential']
        if packed.field_force is not None:
            energy -= float((self.position @ packed.field_force).sum())
        if packed.model.dipole is not None or packed.model.coulomb is not None:
            energy += field_energy(packed.model, packed.layout.pack(InitialState(
                self.position, self.orientation, self.linear_velocity, self.angular_velocity)))
        return energy

    def _rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (3, n) and orientations (4, n)."""
        return (
            np.ascontiguousarray(self.position.T), np.ascontiguousarray(self.orientation.T))

    def _frozen(self) -> tuple[np.ndarray, np.ndarray]:
        """
        Return read-only positions and orientations, the types for which kernels are compiled.
        """
        views = self.position.view(), self.orientation.view()
        for view in views:
            view.flags.writeable = False
        return views


def _weighed(weight: np.ndarray, values: np.ndarray) -> float:
    """Return the sum of `values` (n,) times their weights, (n,), or (1,) for all."""
    if len(weight) == 1:
        return float(weight[0]) * float(values.sum())
    return float((weight * values).sum())
