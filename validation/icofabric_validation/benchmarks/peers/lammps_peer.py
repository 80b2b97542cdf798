# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""LAMMPS: each body a rigid molecule of its edge midpoints, connectors as harmonic bonds."""

from collections.abc import Iterator
from pathlib import Path
import shutil
import tempfile
from typing import Any
import weakref

from icofabric_validation.benchmarks.scenes import axes_from_midpoints, Motion, PlainScene
from icofabric_validation.benchmarks.solver import Solver, StepSolver, Unusable
from icofabric_validation.stress import lammps_engine
import numpy as np

DISTRIBUTION, INSTALL = lammps_engine.DISTRIBUTION, lammps_engine.INSTALL
# The last one is for threads, but its loops are faster also with one thread.
_STYLES = ('rigid/nve/small', 'rigid/small', 'rigid/small/omp')


class Lammps(StepSolver):
    """One integrator of rigid bodies."""

    tool = 'lammps'
    order = 2
    evaluations = 1

    def __init__(
        self, scene: PlainScene, style: str, folder: '_Folder'
    ) -> None:
        """Read the files of `write_files` in `folder`."""
        self._scene, self._style = scene, style
        # The folder is removed with its last solver.
        self._folder = folder
        self.label = f'LAMMPS {style}'
        self.longest = 1.0 / scene.frequency_bound
        self._engine: Any = None

    def start(self, step: float) -> None:
        self.close()
        self._engine = lammps_engine.open_engine()
        folder = self._folder.path
        reach = 2.0 * self._scene.natural_length
        if self._style.endswith('/omp'):
            self._command('package omp 1')
            self._command('suffix omp')
        for line in (
            'units si',
            'atom_style bond',
            # Atoms keep their order, and there are no neighbours: only bonds act.
            'atom_modify map array sort 0 0.0',
            'boundary f f f',
            f'comm_modify cutoff {reach!r}',
            'bond_style harmonic',
            f'read_data {folder / "fabric.data"}',
            # LAMMPS omits the factor 1/2 of the energy.
            f'bond_coeff 1 {0.5 * self._scene.stiffness!r} {self._scene.natural_length!r}',
            'neigh_modify once yes',
            f'fix rigid all {self._style} molecule infile {folder / "bodies.txt"}',
            'thermo_style custom step',
            'thermo 0',
            f'timestep {step!r}',
            'run 0',
        ):
            self._command(line)

    def advance(self, count: int) -> None:
        self._command(f'run {count} pre no post no')

    def motion(self) -> Motion:
        flat = self._engine.gather_atoms('x', 1, 3)
        return axes_from_midpoints(np.array(flat).reshape(self._scene.body_count, 6, 3))

    def close(self) -> None:
        if self._engine is not None:
            self._engine.close()
            self._engine = None

    def _command(self, line: str) -> None:
        try:
            self._engine.command(line)
        except Exception as error:
            raise Unusable(f'{line}: {error}') from error


def write_files(scene: PlainScene, folder: Path) -> None:
    """Write atoms and bonds for LAMMPS, and masses, inertias and velocities of bodies."""
    count = scene.body_count
    points = scene.position[:, None, :] + np.einsum('ei,bij->bej', scene.edge_points, scene.axes)
    # A margin for the motion, because atoms that leave a box without periods are lost.
    margin = 20.0 * scene.half_width
    low, high = points.min(axis=(0, 1)) - margin, points.max(axis=(0, 1)) + margin
    lines = ['fabric', '', f'{6 * count} atoms', f'{scene.connector_count} bonds', '1 atom types',
             '1 bond types', '']
    lines += [f'{low[k]!s} {high[k]!s} {axis}lo {axis}hi' for k, axis in enumerate('xyz')]
    lines += ['', 'Masses', '', f'1 {scene.mass / 6.0!r}', '', 'Atoms # bond', '']
    lines += [f'{atom + 1} {atom // 6 + 1} 1 {place[0]!r} {place[1]!r} {place[2]!r}'
              for atom, place in enumerate(points.reshape(-1, 3).tolist())]
    lines += ['', 'Bonds', '']
    ends = 6 * scene.bodies + scene.edges + 1
    lines += [f'{c + 1} 1 {i} {j}' for c, (i, j) in enumerate(ends.tolist())]
    (folder / 'fabric.data').write_text('\n'.join(lines) + '\n')
    # Masses of points at the edges would give another inertia; the file overrides them.
    rows = [str(count)]
    inertia = f'{scene.inertia!r} {scene.inertia!r} {scene.inertia!r} 0 0 0'
    for b in range(count):
        momentum = scene.inertia * scene.spin[b]
        numbers = ' '.join(
            repr(float(value)) for value in (*scene.velocity[b], *momentum))
        centre = ' '.join(repr(float(value)) for value in scene.position[b])
        rows.append(f'{b + 1} {scene.mass!r} {centre} {inertia} {numbers} 0 0 0')
    (folder / 'bodies.txt').write_text('\n'.join(rows) + '\n')


def solvers(scene: PlainScene) -> Iterator[Solver]:
    """Yield every integrator for many small rigid bodies."""
    engine = lammps_engine.open_engine()
    styles = [style for style in _STYLES if engine.has_style('fix', style)]
    engine.close()
    folder = _Folder()
    write_files(scene, folder.path)
    for style in styles:
        yield Lammps(scene, style, folder)


class _Folder:
    """A folder that is removed with its last reference."""

    def __init__(self) -> None:
        self.path = Path(tempfile.mkdtemp(prefix='icofabric_lammps_'))
        weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)
