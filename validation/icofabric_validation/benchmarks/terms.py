# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Cost of each term of a scene, and of terms that a scene does not have.

The bare scene has only springs. It is compared with a kernel for springs alone
(`springs_only.py`).
"""

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.model.body_force import BodyForce
from icofabric_sim.simulation.model.layout import copy_state
from icofabric_sim.simulation.simulation import compile_scene, Simulation
from icofabric_sim.simulation.stepping.thread_team import core_count
from icofabric_validation.benchmarks import bare_kernels, springs_only
from icofabric_validation.benchmarks.bare_kernels import fresh, Instructions, Kernel
from icofabric_validation.benchmarks.held_arrays import arrays_of
from icofabric_validation.benchmarks.scenes import FABRIC, FABRIC_LENGTH, scene_parameters, SIZES
from icofabric_validation.benchmarks.step_speed import STEP
from icofabric_validation.benchmarks.timing import in_rounds, Spread, STEPS_BLOCK_S, timed
import numpy as np

Size = tuple[int, int, int]
BARE = 'bare scene: springs alone'
# Row for comparison of terms with forces that depend on velocities.
ADAPTIVE = 'bare scene with dop8'
UNWATCHED, KERNEL, LEANEST = (
    'without health checks', 'springs-only kernel', 'springs-only kernel, one kick a step')
# Timed steps, with two health checks, and steps before. Some health checks measure errors of
# steps, which takes as long as some hundred steps and happens less and less often: in S3 at steps
# 576, 832, 1216 and 1792, with a table at 1323, 1350, 1617 and 1650, outside the timed steps.
_STEPS, _WARM_UP, _TABLE_WARM_UP = 128, 1250, 1390
# Steps before the first contact of S3, at step 922.
_BEFORE_CONTACT = 600
# Velocities for displacements below the gaps between shells; contacts soft enough for the steps.
_CALM = {'velocity_sigma': 1e-3, 'spin_sigma': 0.04, 'seed': 1}
_SOFT_CONTACT = {'mode': 'always', 'stiffness': 1e4}
# An angle with faces nearly in contact [rad], and a natural length that closes the gaps [m].
_FACES, _FACES_LENGTH = -0.3648, 0.999 * 0.02506719
# Timed steps and steps before for terms with steps a hundred times as long.
_FEW_STEPS, _SHORT_WARM_UP = 16, 128
_WRENCH = {'force': [1e-3, 0.0, 5e-4], 'torque': [0.0, 1e-6, 0.0]}


class Term(NamedTuple):
    """The bare scene with one additional term."""

    label: str
    parameters: dict[str, Any]
    rotation: str = 'quaternion'
    threads: int = 1
    method: str = 'leapfrog'
    body_force: BodyForce | None = None
    steps: int = _STEPS
    warm_up: int = _WARM_UP

    @property
    def over(self) -> str:
        """The row for comparison."""
        return BARE if self.method == 'leapfrog' else ADAPTIVE


def terms(body: int) -> list[Term]:
    """Return every term that a scene can have; a single load acts on `body`."""
    loads = {'push': {'group': 'pushed', **_WRENCH}}
    charge = {'per_body': 1e-8, 'dipole': [1e-9, 0.0, 2e-9]}
    wall = {'wall': 'x_min'}
    return [
        Term(BARE, {}),
        Term('gravity', {'gravity': [0.0, 0.0, -9.81]}),
        Term('one side held', {
            'groups': wall, 'supports': {'wall': {'group': 'wall'}}}),
        Term('two stiffnesses', {'connector': {'stiffness_compression': 100.0}}),
        Term('individual connector laws', {
            'groups': wall,
            'connector_groups': {'soft': {'between': 'wall all', 'stiffness': 100.0}}}),
        *(Term(f'connector law, table of {rows} rows', {
            'connector': {'law': law_table(rows)}}, warm_up=_TABLE_WARM_UP) for rows in (5, 100)),
        Term('bending stiffness', {'connector': {'bending_stiffness': 0.1}}),
        Term('twisting stiffness', {'connector': {'twisting_stiffness': 0.1}}),
        Term('load on one body', {'groups': {'pushed': f'ids {body}'}, 'loads': loads}),
        Term('loads on all bodies', {'groups': {'pushed': 'all'}, 'loads': loads}),
        Term('loads in body axes on all bodies', {
            'groups': {'pushed': 'all'},
            'loads': {'push': {**loads['push'], 'frame': 'body', 'point': [0.0, 0.0, 1e-3]}}}),
        Term('loads on all bodies with a time profile', {
            'groups': {'pushed': 'all'},
            'loads': {'push': {**loads['push'], 'profile': 'half_sine', 'duration': 1e3}}}),
        Term('pressure on exterior faces', {
            'tractions': {'air': {'group': 'all', 'faces': 'exterior', 'pressure': 1.0}}}),
        Term('pressure of fixed direction on exterior faces', {
            'tractions': {'air': {
                'group': 'all', 'faces': 'exterior', 'pressure': 1.0, 'direction': 'fixed'}}}),
        Term('pressure without friction on exterior faces', {
            'tractions': {'air': {
                'group': 'all', 'faces': 'exterior', 'pressure': 1.0, 'direction': 'fixed',
                'frictionless': True}}}),
        Term('charges in an electric field', {
            'charge': {'per_body': 1e-8}, 'field': {'electric': [0.0, 0.0, 1e4]}}),
        Term('dipoles in an electric field', {
            'charge': charge, 'field': {'electric': [0.0, 0.0, 1e4]}}),
        Term('mutual charges', {
            'charge': {'per_body': 1e-8, 'mutual': True}}, steps=_FEW_STEPS,
            warm_up=_SHORT_WARM_UP),
        Term('contact detection', {'contact': {'mode': 'auto'}}, warm_up=_BEFORE_CONTACT),
        Term('shells near each other, no contact', {
            'weave': {'connector_angle': -0.3}, 'contact': _SOFT_CONTACT,
            'initial_random': _CALM}),
        Term('faces in contact', {
            'weave': {'connector_angle': _FACES}, 'contact': _SOFT_CONTACT,
            'connector': {**FABRIC['connector'], 'natural_length': _FACES_LENGTH},
            'initial_random': _CALM}, steps=_FEW_STEPS, warm_up=_SHORT_WARM_UP),
        Term('direction cosines', {}, rotation='direction_cosines'),
        Term(f'team of {core_count()} threads', {}, threads=0),
        Term(ADAPTIVE, {}, method='dop8'),
        Term('one side driven', {
            'groups': wall, 'drives': {'shake': {
                'group': 'wall', 'motion': 'sine', 'linear': [0.0, 0.0, 1e-4],
                'frequency': 5.0}}}, method='dop8'),
        Term('damped connectors', {'connector': {'damping': 1e-3}}, method='dop8'),
        Term('standard linear solids', {
            'connector': {'maxwell_stiffness': 200.0, 'maxwell_time': 1e-3}}, method='dop8'),
        Term('anisotropic inertias', {
            'shell': {**FABRIC['shell'], 'principal_inertia': [9e-7, 1e-6, 1.2e-6]}},
            method='dop8'),
        Term('individual connector damping', {
            'groups': wall, 'connector_groups': {'soft': {
                'between': 'wall all', 'damping': 1e-3}}}, method='dop8'),
        Term('breakable connectors', {
            'connector': {'break_length_extension': 1.0}}, method='dop8'),
        Term('drag', {'drag': {'linear': 1e-4, 'angular': 1e-8}}, method='dop8'),
        Term('charges and dipoles in a magnetic field', {
            'charge': charge, 'field': {'magnetic': [0.0, 0.0, 1.0]}}, method='dop8'),
        Term('body force, compiled', {}, method='dop8', body_force=BodyForce(
            _pull, compiled=True)),
        Term('body force, called by Python', {}, method='dop8', body_force=BodyForce(
            _pull_all, compiled=False), steps=_FEW_STEPS, warm_up=_SHORT_WARM_UP),
        Term('an anchor', {'anchors': {'hook': {
            'body': 0, 'edge': 'up', 'position': [0.0, 0.0, 0.0485]}}}),
        Term('connectors wrapped over shells', {'connector': {'obstruction': 'wrap'}}),
        Term('arbitrary attachment points', {'connector': {'attachment': {
            'up': [0.0, 0.001, 0.0162]}}}),
    ]


@cache
def _folder() -> TemporaryDirectory[str]:
    """Return a folder for tables, which is removed when the program ends."""
    return TemporaryDirectory()


@cache
def law_table(count: int) -> str:
    """Write a law with the stiffness of the springs at its natural length, which stiffens."""
    file = Path(_folder().name) / f'law_{count}.csv'
    strain = np.linspace(-0.5, 0.5, count)
    rest, stiffness = FABRIC_LENGTH, FABRIC['connector']['stiffness']
    force = stiffness * rest * (strain + strain**3)
    file.write_text(''.join(
        f'{rest * (1.0 + x):.17g}, {f:.17g}\n' for x, f in zip(strain, force)))
    return str(file)


def _pull(
    time: float, position: np.ndarray, orientation: np.ndarray, linear_velocity: np.ndarray,
    angular_velocity: np.ndarray
) -> Any:
    return (-1e-3 * position[0], 0.0, 0.0), (0.0, 0.0, 0.0)


def _pull_all(
    time: float, position: np.ndarray, orientation: np.ndarray, linear_velocity: np.ndarray,
    angular_velocity: np.ndarray
) -> Any:
    return -1e-3 * position * np.array([[1.0, 0.0, 0.0]]), np.zeros_like(position)


class Cost(NamedTuple):
    """One row: a term, or another kernel."""

    label: str
    body_count: int
    times: list[float]  # of a step [s], one for each round
    held: int | None  # bytes of all arrays; None: not a scene
    over: str = BARE  # the row that it is compared with

    def per_body(self) -> Spread:
        """Time per body and step [ns]."""
        return Spread.of([value * 1e9 / self.body_count for value in self.times])


class Terms(NamedTuple):
    """All results; the bare scene is first."""

    rows: list[Cost]
    bare_arrays: dict[str, int]  # bytes by name
    instructions: list[Instructions]
    remarks: list[str]
    rounds: int

    def row(self, label: str) -> Cost | None:
        """Return the row of a label."""
        return next((row for row in self.rows if row.label == label), None)

    def ratio(self, row: Cost, label: str | None = None) -> Spread | None:
        """Return the time of `row` over that of another, by default its bare scene."""
        other = self.row(label or row.over)
        if other is None:
            return None
        return Spread.of([one / two for one, two in zip(row.times, other.times)])


def measure(
    *, rounds: int = 5, size: Size = SIZES['S3'],
    say: Callable[[str], None] = lambda text: None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Terms:
    """Time the bare scene, each term and the other kernel, in rounds."""
    bare = compile_term(size, Term(BARE, {}))
    count = bare.scene.body_count
    rows, tasks, remarks = [], [], []
    for term in terms(count // 2):
        say(term.label)
        simulation = compile_term(size, term)
        label = term.label
        if term.threads == 0 and simulation.status.thread_count == 1:
            remarks.append(f'{label}: one thread is all that pays here')
        rows.append(Cost(
            label, simulation.scene.body_count, [], sum(arrays_of(simulation).values()),
            term.over))
        tasks.append(partial(_block, simulation, term, _start(simulation, term.warm_up)))
    kernels, instructions = [], []
    say('kernels')
    kernels.append((UNWATCHED, bare_kernels.package_kernel(bare.packed)))
    kernels.append((KERNEL, bare_kernels.springs_kernel(bare.packed, springs_only)))
    kernels.append((LEANEST, bare_kernels.leanest_kernel(bare.packed, springs_only)))
    instructions = bare_kernels.count_instructions(bare.packed, bare.scene, springs_only)
    for label, run in kernels:
        rows.append(Cost(label, count, [], None))
        tasks.append(partial(_kernel_block, bare, run))
    bare_kernels.require_same_motion(bare, [run for _, run in kernels[:2]])
    say(f'{rounds} rounds of {len(tasks)} runs')
    results = in_rounds(tasks, rounds, progress)
    timed = [row._replace(times=times) for row, times in zip(rows, results)]
    return Terms(timed, arrays_of(bare), instructions, remarks, rounds)


def compile_term(size: Size, term: Term) -> Simulation:
    """Compile the bare scene of a size with a term, and load its kernels."""
    parameters = {
        **scene_parameters(size, {'method': term.method, 'step': STEP, 'threads': term.threads})}
    for name, section in term.parameters.items():
        own = parameters.get(name)
        if isinstance(own, dict) and isinstance(section, dict):
            section = {**own, **section}
        parameters[name] = section
    simulation = compile_scene(
        Scene.from_parameters(parameters), rotation=term.rotation, body_force=term.body_force)
    simulation.warm_up()
    return simulation


def _start(simulation: Simulation, warm_up: int) -> Checkpoint:
    """Advance a scene past its first steps; return the start of every timed run."""
    simulation.advance_steps(warm_up)
    return simulation.checkpoint()


def _block(simulation: Simulation, term: Term, start: Checkpoint) -> float:
    """Return the time of a step [s], from the same start, because motion may change the cost."""
    spent = timed(
        lambda: simulation.restore(start), lambda: simulation.advance_steps(term.steps),
        block=STEPS_BLOCK_S)
    moved = np.abs(simulation.snapshot().position - simulation.scene.position).max()
    if not (moved > 0.0 and simulation.balance.worst < simulation.balance.limit):
        raise RuntimeError(f'{term.label}: the bodies do not move as they should')
    return spent / term.steps


def _kernel_block(bare: Simulation, run: Kernel) -> float:
    start, room = fresh(bare.packed, bare.scene)
    run(start, room, _SHORT_WARM_UP)
    state, work = fresh(bare.packed, bare.scene)

    def prepare() -> None:
        copy_state(start, state)
        for target, source in ((work.acceleration, room.acceleration), (work.points, room.points)):
            np.copyto(target, source)

    spent = timed(prepare, lambda: run(state, work, _STEPS), block=STEPS_BLOCK_S)
    if not np.isfinite(state.position).all():
        raise RuntimeError('the kernels do not move the bodies as they should')
    return spent / _STEPS
