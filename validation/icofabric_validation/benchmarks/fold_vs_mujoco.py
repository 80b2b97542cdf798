# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A wide slab that folds on itself, compared with MuJoCo: time per step for growing contacts.

The slab is bent into a hairpin above a floor. The lower half falls on the floor and the upper half
on the lower one. A simulation with drag and damping leads to the stages: no contacts, hundreds,
thousands. From each stage both programs continue without drag and damping, first for a time that
is not measured, because a run measures its error most often at the start. Both have the same
states, weight and floor. MuJoCo has shells as convex meshes, connectors as tendons with springs,
and frictionless contacts of the largest recommended stiffness (solref: twice the step), which are
constraints that dissipate energy. Contacts of this project have a potential. Needs mujoco.

    .venv/bin/python -m icofabric_validation.benchmarks.fold_vs_mujoco --size 25 8 2
    .venv/bin/python -m icofabric_validation.benchmarks.fold_vs_mujoco  # 4,960 bodies

The smaller slab, of 200 bodies, has `--stages 1 50 200`.
"""

import argparse
from collections.abc import Iterator
import logging
import math
import time
from typing import Any, NamedTuple

import icofabric_sim as ico
from icofabric_sim import contact
from icofabric_sim.geometry.icosahedron import circumscribed_radius, vertices
from icofabric_sim.scene.initial import InitialState
from icofabric_validation.benchmarks.machine import describe_machine, import_mujoco
from icofabric_validation.benchmarks.peers import mujoco_peer
from icofabric_validation.benchmarks.scenes import plain_numbers
import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

# Contact solvers of MuJoCo, and steps [s].
SOLVERS, STEPS = ('newton', 'cg'), (1e-3, 5e-4, 2e-4)
# Largest number of steps of the Newton solver, each of which takes a second.
MAX_NEWTON_STEPS = 3
# Until the stages: drag over mass [1/s], damping of contacts [s/m], tolerance.
DRAG, DAMPING, TOLERANCE = 50.0, 5.0, 1.0
# Largest number of runs of each row from the same state, and time [s] after which none is started.
RUNS, MAX_TIME_S = 2, 5.0
# Simulated time between two samples of the fold [s].
SPACING = 5e-3
# Initial gap below the lowest shell [m].
GAP = 5e-4


class Row(NamedTuple):
    """One program at one stage."""

    label: str
    steps: int
    step: float  # mean [s]
    taken: float  # processor time of a step [s]
    stages: int  # evaluations of the forces in a step of ours
    place: np.ndarray  # final positions (n, 3) [m]
    quaternion: np.ndarray  # (n, 4) x y z w


def fold(size: tuple[int, int, int], radius: float, **changes: Any) -> ico.Scene:
    """Return the woven slab above a floor on which it lies after bending about `radius` [m]."""
    flat: dict[str, Any] = {
        'weave.size': list(size), 'connector.stiffness': 500.0, 'gravity': [0.0, 0.0, -9.81],
        'planes.floor.normal': [0.0, 0.0, 1.0], 'solver.threads': 1, **changes}
    woven = ico.Scene.from_parameters(flat)
    thickness = float(np.ptp(woven.position[:, 2]))
    flat['planes.floor.offset'] = -radius - 0.5 * thickness - circumscribed_radius(
        woven.geometry.half_edge) - GAP
    return ico.Scene.from_parameters(flat)


def hairpin(scene: ico.Scene, radius: float, tilt: float) -> InitialState:
    """
    Return the slab at rest, bent about the y axis with its middle layer on an arc of `radius` [m].

    Both halves are straight behind the arc; the upper one is inclined to the lower one by `tilt`
    [rad].
    """
    rest = scene.initial
    along, across, height = (rest.position - 0.5 * (
        rest.position.min(axis=0) + rest.position.max(axis=0))).T
    turned = np.clip(along / radius, -0.5 * math.pi, 0.5 * math.pi + tilt)
    straight = along - radius * turned
    # The tangent and the outward normal of the middle layer.
    forward, up = np.sin(turned), np.cos(turned)
    x = radius * (1.0 - np.cos(turned)) + straight * forward - height * up
    z = radius * np.sin(turned) + straight * up + height * forward
    turn = Rotation.from_euler('y', (turned - 0.5 * math.pi)[:, None])
    still = np.zeros((len(x), 3))
    return InitialState(
        np.stack([x, across, z], axis=1),
        (turn * Rotation.from_quat(rest.orientation)).as_quat(), still, still)


def set_initial_state(simulation: ico.Simulation, state: InitialState) -> ico.Simulation:
    """Set the state of a simulation, and return the simulation."""
    simulation.warm_up()
    simulation.set_state(
        position=state.position, orientation=state.orientation,
        linear_velocity=state.linear_velocity, angular_velocity=state.angular_velocity)
    return simulation


def stages(
    size: tuple[int, int, int], radius: float, tilt: float, stiffness: float, wanted: list[int],
    longest: float
) -> Iterator[tuple[float, int, InitialState]]:
    """Yield time [s], contacts and state at the start and at each requested number of contacts."""
    shell = fold(size, radius).shell
    scene = fold(size, radius, **{
        'contact.stiffness': stiffness, 'contact.damping': DAMPING,
        'drag.linear': DRAG * shell.mass, 'drag.angular': DRAG * shell.inertia,
        'solver.method': 'dop8', 'solver.tolerance': TOLERANCE})
    state = hairpin(scene, radius, tilt)
    simulation = set_initial_state(ico.compile_scene(scene), state)
    yield 0.0, 0, state
    left = sorted(wanted)
    while left and simulation.time < longest:
        simulation.advance_to(simulation.time + SPACING)
        if simulation.status.contact_count < left[0]:
            continue
        left = [count for count in left if count > simulation.status.contact_count]
        now = simulation.snapshot()
        yield simulation.time, simulation.status.contact_count, InitialState(
            now.position, now.orientation, now.linear_velocity, now.angular_velocity)


def own_row(
    scene: ico.Scene, state: InitialState, lead: float, span: float
) -> tuple[Row, InitialState]:
    """Time our steps over `span` [s] after `lead` [s], the fastest run; return the start."""
    simulation, taken = ico.compile_scene(scene), math.inf
    # The first run compiles kernels of contacts.
    for _ in range(RUNS):
        set_initial_state(simulation, state)
        simulation.advance_to(simulation.time + lead)
        now = simulation.snapshot()
        start = InitialState(
            now.position.copy(), now.orientation.copy(), now.linear_velocity.copy(),
            now.angular_velocity.copy())
        begun, counted = simulation.time, simulation.status.step_count
        started = time.process_time()
        simulation.advance_to(begun + span)
        taken = min(taken, time.process_time() - started)
        steps = simulation.status.step_count - counted
        if taken > MAX_TIME_S:
            break
    method, now = simulation.status.method_name, simulation.snapshot()
    label = f'{method}, tolerance {scene.parameters["solver.tolerance"]:g}'
    return Row(label, steps, span / steps, taken / steps, ico.METHODS[method].stages,
               now.position.copy(), now.orientation.copy()), start


def mujoco_row(model: Any, solver: str, step: float, state: InitialState, count: int) -> Row:
    """Time `count` steps of MuJoCo, the fastest of some runs."""
    mujoco = import_mujoco()
    model.opt.timestep, model.opt.integrator = step, mujoco.mjtIntegrator.mjINT_EULER
    model.opt.solver = getattr(mujoco.mjtSolver, f'mjSOL_{solver.upper()}')
    model.geom_solref[:] = 2.0 * step, 1.0
    data, taken = mujoco.MjData(model), math.inf
    for _ in range(RUNS):
        mujoco.mj_resetData(model, data)
        mujoco_peer.set_bodies(data, *state)
        mujoco.mj_forward(model, data)
        started = time.process_time()
        mujoco.mj_step(model, data, count)
        taken = min(taken, time.process_time() - started)
        if taken > MAX_TIME_S:
            break
    place = data.qpos.reshape(-1, 7)
    return Row(f'MuJoCo Euler, {solver.upper()}', count, step, taken / count, 0,
               place[:, :3].copy(), place[:, [4, 5, 6, 3]])


def overlap(scene: ico.Scene, row: Row) -> float:
    """Return the largest overlap of two shells, or a shell and the floor, over a."""
    a, place = scene.geometry.half_edge, row.place
    if not np.isfinite(place).all():
        return math.nan
    first, second = cKDTree(place).query_pairs(
        2.0 * circumscribed_radius(a), output_type='ndarray').T
    poses = [(place[k], row.quaternion[k]) for k in (first, second)]
    distance = contact.separation(a, *poses).distance
    lowest = [
        Rotation.from_quat(turn).apply(vertices(a))[:, 2].min() for turn in row.quaternion]
    floor = scene.parameters['planes.floor.offset'] - np.min(place[:, 2] + lowest)
    return max(0.0, floor, -float(np.min(distance, initial=0.0))) / a


def show(scene: ico.Scene, row: Row, reference: Row) -> None:
    """Print one line."""
    single = f'{1e3 * row.taken / row.stages:8.3f} ms' if row.stages else 11 * ' '
    apart = np.linalg.norm(row.place - reference.place, axis=1).max() / scene.geometry.half_edge
    same = f'{apart:9.4f} a' if math.isclose(
        row.steps * row.step, reference.steps * reference.step) else 11 * ' '
    print(f'{row.label:28} {1e6 * row.step:9.1f} us {row.steps:6d} {1e3 * row.taken:10.3f} ms '
          f'{single} {row.step / row.taken:10.5f} {100.0 * overlap(scene, row):8.3f} % {same}',
          flush=True)


def main() -> None:
    """Print a table for each stage."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--size', type=int, nargs=3, default=(124, 40, 2), help='weave.size')
    parser.add_argument('--radius', type=float, default=0.07, help='of the bend [m]')
    parser.add_argument('--tilt', type=float, default=0.01, help='of the upper half [rad]')
    parser.add_argument('--stiffness', type=float, default=1e5, help='of our contacts [N/m]')
    parser.add_argument('--stages', type=int, nargs='+', default=[300, 2000, 5000],
                        help='touching pairs')
    parser.add_argument('--longest', type=float, default=3.0, help='way to the stages [s]')
    parser.add_argument('--lead', type=float, default=0.012, help='before that [s]')
    parser.add_argument('--span', type=float, default=0.012, help='timed at each stage [s]')
    parser.add_argument('--most', type=int, default=24, help='steps of MuJoCo')
    parser.add_argument('--methods', nargs='+', default=['leapfrog', 'dop8'], help='ours')
    given = parser.parse_args()
    logging.disable(logging.WARNING)
    mujoco = import_mujoco()
    common = {'contact.stiffness': given.stiffness}
    size = tuple(given.size)
    own = [fold(size, given.radius, **common, **{
        'solver.method': method, 'solver.tolerance': TOLERANCE}) for method in given.methods]
    plain = plain_numbers('fold', own[0])
    model = mujoco.MjModel.from_xml_string(mujoco_peer.model_text(
        plain, floor=float(own[0].parameters['planes.floor.offset'])))
    print(describe_machine() + f', MuJoCo {mujoco.__version__}; one thread each')
    print(f'{plain.body_count} bodies, {plain.connector_count} connectors; '
          f'K = {given.stiffness:g} N/m')
    for moment, pairs, state in stages(
            size, given.radius, given.tilt, given.stiffness, given.stages, given.longest):
        print(f'\nt = {moment:.3f} s, {pairs} pairs touch')
        print(f'{"":28} {"step":>12} {"steps":>6} {"for a step":>13} {"evaluation":>11} '
              f'{"pace":>10} {"overlap":>10} {"from the first":>11}')
        first: Row | None = None
        for scene in own:
            row, begin = own_row(scene, state, given.lead, given.span)
            if first is None:
                # The state of the first run after the lead is the start of all others.
                first, start = row, begin
            show(own[0], row, first)
        assert first is not None
        for solver in SOLVERS:
            for step in STEPS:
                most = MAX_NEWTON_STEPS if solver == 'newton' else given.most
                count = min(round(given.span / step), most)
                show(own[0], mujoco_row(model, solver, step, start, count), first)


if __name__ == '__main__':
    main()
