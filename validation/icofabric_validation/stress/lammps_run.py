# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A scene in LAMMPS: bodies of `fix rigid/nve`, connectors as harmonic bonds between their atoms.

`fix rigid/nve` is the LAMMPS method for rigid bodies that conserves energy (velocity Verlet with
NO_SQUISH rotations, order 2). The unit of length is a, that of mass the mass of a shell, and that
of time the inverse rate of the fastest motion. Each body has one atom at its centre, three at
distance a on its axes, which give its state, and one for each end of a connector. Loads act on the
first four atoms, by `fix external`.
"""

from pathlib import Path
import tempfile
from typing import Any

from icofabric_sim.geometry.rotations import (
    cosines_from_quaternions,
    quaternions_from_cosines,
)
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.errors import SimulationError
from icofabric_validation.stress import lammps_engine
from icofabric_validation.stress.peer_run import number_words, PeerRun
from icofabric_validation.stress.peer_state import State
import numpy as np

# Terms of kinds that LAMMPS computes with the same forces.
TERMS = ('gravity', 'supports', 'attachments', 'groups', 'loads')
DISTRIBUTION, INSTALL = lammps_engine.DISTRIBUTION, lammps_engine.INSTALL
METHOD = 'LAMMPS rigid/nve'
# Error of the method in a radian of an oscillation, over (step times frequency)^order.
ERROR, ORDER = 1.0 / 24.0, 2
# Atoms of each body that mark its centre and axes.
_MARKERS = 4


class LammpsRun(PeerRun):
    """A run of a scene in LAMMPS."""

    check_period_steps = 64

    def __init__(self, scene: Scene, step: float, rate: float) -> None:
        """
        Prepare steps of `step` [s]; the unit of time is 1 / `rate` of the fastest motion [rad/s].

        Raises ValueError if LAMMPS rejects the scene.
        """
        super().__init__(scene, step, rate)
        # Interval of the current steps, and the number of the first of them.
        self._interval = self._first = 0
        ends = scene.connectors.bodies
        # Body of each atom: markers of all bodies, then both ends of each connector.
        self._bodies = np.concatenate([
            np.repeat(np.arange(scene.body_count), _MARKERS), ends.ravel()])
        self._engine: Any = lammps_engine.open_engine()
        try:
            self._start()
        except Exception as error:
            self.close()
            raise ValueError(f'LAMMPS: {error}') from error

    def _advance(self, end: int) -> None:
        try:
            super()._advance(end)
        except Exception as error:
            raise SimulationError(f'LAMMPS at t = {self.time:.9g} s: {error}') from error
        if not np.isfinite(self._gather('x')).all():
            raise SimulationError(
                f'LAMMPS at t = {self.time:.9g} s, after steps of {self.step:.6g} s: '
                'positions are not finite')

    def _advance_equal(self, count: int) -> None:
        interval, again = self._steps.interval(self.step_count), 'no'
        if interval != self._interval:
            # Recompute forces at the start of the step, which belong to the new interval.
            self._interval, again = interval, 'yes'
            self._set_step()
        self._first = self.step_count
        self._engine.command(f'run {count} pre {again} post no')
        self.step_count += count

    def _set_step(self) -> None:
        self._engine.command(f'timestep {self._steps.length(self.step_count) * self._rate!r}')

    def _apply_loads(
        self, caller: object, step: int, count: int, tags: np.ndarray, places: np.ndarray,
        forces: np.ndarray
    ) -> None:
        """Set the loads after `step` steps as forces on the markers of the bodies."""
        loads = self._loads
        atoms = np.argsort(tags)[:_MARKERS * self.scene.body_count].reshape(-1, _MARKERS)
        atoms = atoms[loads.bodies]
        axes = places[atoms[:, 1:]] - places[atoms[:, :1]]
        force, torque = loads.at(
            self._steps.time(step), self._steps.middle(self._first), axes)
        unit = self.scene.shell.mass * self._length * self._rate**2
        # For orthonormal axes e the sum of e x (N x e) is 2 N.
        turning = 0.5 * np.cross(torque[:, None] / (unit * self._length), axes)
        forces[:] = 0.0
        forces[atoms[:, 1:]] = turning
        forces[atoms[:, 0]] = force / unit - turning.sum(axis=1)

    def snapshot(self) -> State:
        """Return the current state."""
        count, a, rate = self.scene.body_count, self._length, self._rate
        place, speed = (
            self._gather(name)[:_MARKERS * count].reshape(count, _MARKERS, 3)
            for name in ('x', 'v'))
        # Rows are the axes of the body in the world frame.
        axes = place[:, 1:] - place[:, :1]
        moved = speed[:, 1:] - speed[:, :1]
        spin = 0.5 * np.cross(axes, moved).sum(axis=1)
        return State(
            a * place[:, 0], quaternions_from_cosines(axes), a * rate * speed[:, 0], rate * spin,
            self._intact)

    def saved(self) -> np.ndarray:
        """Return positions and velocities of all atoms."""
        return np.concatenate([self._gather('x'), self._gather('v')])

    def close(self) -> None:
        """Release the memory of LAMMPS."""
        if self._engine is not None:
            self._engine.close()
            self._engine = None

    def _gather(self, name: str) -> np.ndarray:
        return np.array(self._engine.gather_atoms(name, 1, 3)).reshape(-1, 3)

    def _start(self) -> None:
        """Pass the scene to LAMMPS."""
        scene, a, rate = self.scene, self._length, self._rate
        with tempfile.TemporaryDirectory(prefix='icofabric_lammps_') as folder:
            data, bodies = Path(folder) / 'fabric.data', Path(folder) / 'bodies.txt'
            reach, laws = self._write_atoms(data)
            self._write_bodies(bodies)
            gravity = np.array(scene.parameters['gravity'], dtype=float) / (a * rate**2)
            lines = [
                'units lj', 'atom_style bond',
                # Atoms keep their order, and there are no neighbours: only bonds act.
                'atom_modify map array sort 0 0.0', 'boundary f f f',
                f'comm_modify cutoff {reach!r}', 'bond_style harmonic', f'read_data {data}']
            # LAMMPS omits the factor 1/2 of the energy.
            unit = scene.shell.mass * rate**2
            lines += [
                f'bond_coeff {number + 1} {0.5 * float(stiffness) / unit!r} {float(length) / a!r}'
                for number, (stiffness, length) in enumerate(laws)] or ['bond_coeff 1 0.0 1.0']
            lines += ['neigh_modify once yes', 'group centres type 2']
            if gravity.any():
                lines.append('fix gravity centres addforce ' + number_words(gravity))
            if self._loads.bodies.size:
                lines.append('fix loads all external pf/callback 1 1')
            lines += [
                f'fix rigid all rigid/nve molecule {self._support_options()} infile {bodies} '
                'reinit no',
                'thermo_style custom step', 'thermo 0']
            for line in lines:
                self._engine.command(line)
            if self._loads.bodies.size:
                self._engine.set_fix_external_callback('loads', self._apply_loads, None)
            self._set_step()
            self._engine.command('run 0')

    def _support_options(self) -> str:
        """Return the options for supports: freedoms of bodies that are switched off."""
        supports = self.scene.supports
        if supports is None:
            return ''
        words = []
        for body in range(self.scene.body_count):
            moving = ~np.asarray(supports.translation[body], dtype=bool)
            turning = not supports.rotation[body]
            if not (moving.all() and turning):
                words.append(f'force {body + 1} ' + ' '.join(
                    'on' if free else 'off' for free in moving))
                words.append(f'torque {body + 1} ' + 3 * ('on ' if turning else 'off '))
        return ' '.join(words)

    def _write_atoms(self, path: Path) -> tuple[float, np.ndarray]:
        """Write atoms and bonds; return the largest reach of bonds, and their laws (m, 2)."""
        scene, a = self.scene, self._length
        connectors, start = scene.connectors, scene.initial
        axes = cosines_from_quaternions(start.orientation)
        markers = start.position[:, None] / a + np.concatenate(
            [np.zeros((scene.body_count, 1, 3)), axes], axis=1)
        ends = start.position[connectors.bodies] / a + np.einsum(
            'cei,ceij->cej', connectors.points_body / a, axes[connectors.bodies])
        atoms = np.concatenate([markers.reshape(-1, 3), ends.reshape(-1, 3)])
        laws, which = np.unique(np.column_stack([
            np.broadcast_to(values, scene.connector_count)
            for values in (connectors.laws.extension, connectors.laws.natural_length)]),
            axis=0, return_inverse=True)
        size = float(np.ptp(atoms, axis=0).max()) + 1.0
        low, high = atoms.min(axis=0) - 1e3 * size, atoms.max(axis=0) + 1e3 * size
        lines = ['fabric', '', f'{len(atoms)} atoms', f'{scene.connector_count} bonds',
                 '2 atom types', f'{max(len(laws), 1)} bond types', '']
        lines += [f'{low[k]!s} {high[k]!s} {axis}lo {axis}hi' for k, axis in enumerate('xyz')]
        # The file of bodies overrides these masses.
        lines += ['', 'Masses', '', '1 1.0', '2 1.0', '', 'Atoms # bond', '']
        for atom, (body, place) in enumerate(zip(self._bodies.tolist(), atoms.tolist())):
            kind = 2 if atom < _MARKERS * scene.body_count and atom % _MARKERS == 0 else 1
            lines.append(f'{atom + 1} {body + 1} {kind} ' + number_words(place))
        if scene.connector_count:
            first = _MARKERS * scene.body_count + 1
            lines += ['', 'Bonds', '']
            lines += [f'{c + 1} {kind + 1} {first + 2 * c} {first + 2 * c + 1}'
                      for c, kind in enumerate(which.ravel().tolist())]
        path.write_text('\n'.join(lines) + '\n')
        return 4.0 * size, laws

    def _write_bodies(self, path: Path) -> None:
        """Write masses, inertias and velocities of the bodies."""
        scene, a, rate = self.scene, self._length, self._rate
        inertia = scene.shell.inertia / (scene.shell.mass * a**2)
        start, rows = scene.initial, [str(scene.body_count)]
        for body in range(scene.body_count):
            rows.append(f'{body + 1} 1.0 ' + number_words([
                *start.position[body] / a, *([inertia] * 3), 0.0, 0.0, 0.0,
                *start.linear_velocity[body] / (a * rate),
                *inertia * start.angular_velocity[body] / rate]) + ' 0 0 0')
        path.write_text('\n'.join(rows) + '\n')
