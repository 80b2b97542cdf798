# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A wide slab that folds on itself, beside MuJoCo: time per step while more and more shells touch.

The slab is bent into a hairpin above a floor. Its lower half falls on the floor, the upper one on
the lower, and our simulation takes it, with drag and damping, through the stages: nothing touches,
hundreds of pairs touch, thousands. From there it goes on without drag and damping in both, first
for a while that is not timed, as a run measures its error most where it begins: the same states,
weight and floor, in MuJoCo the shells as convex meshes and connectors as tendons with a spring,
contacts without friction, as stiff as it recommends at most (solref: twice the step). Its contacts
are constraints that lose energy, ours a potential. Needs mujoco.

    .venv/bin/python -m icofabric_validation.benchmarks.fold_beside_mujoco --size 25 8 2 \
        --stages 1 50 200  # 200 bodies
    .venv/bin/python -m icofabric_validation.benchmarks.fold_beside_mujoco  # 4,960
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

# MuJoCo's solvers of contacts and steps [s].
SOLVERS, STEPS = ('newton', 'cg'), (1e-3, 5e-4, 2e-4)
# Steps of Newton's method at most: one takes a second.
NEWTON_STEPS = 3
# Of the way to the stages: drag for mass [1/s], damping of contacts [s/m], tolerance.
DRAG, DAMPING, TOLERANCE = 50.0, 5.0, 1.0
# Runs of each row from the same state, and time after which there is no other [s].
RUNS, ENOUGH = 2, 5.0
# Simulated time between two looks at the fold [s].
SPACING = 5e-3
# Room below the lowest shell at the start [m].
ABOVE = 5e-4


class Row(NamedTuple):
    """One contestant at one stage."""

    label: str
    steps: int
    step: float  # mean [s]
    taken: float  # time of the processor for a step [s]
    stages: int  # evaluations of the forces in a step, where ours
    place: np.ndarray  # (n, 3) [m] where it came to
    quaternion: np.ndarray  # (n, 4) x y z w


def fold(size: tuple[int, int, int], radius: float, **changes: Any) -> ico.Scene:
    """The slab as woven, above a floor on which it lies once it is bent about `radius` [m]."""
    flat: dict[str, Any] = {
        'weave.size': list(size), 'connector.stiffness': 500.0, 'gravity': [0.0, 0.0, -9.81],
        'planes.floor.normal': [0.0, 0.0, 1.0], 'solver.threads': 1, **changes}
    woven = ico.Scene.from_parameters(flat)
    thickness = float(np.ptp(woven.position[:, 2]))
    flat['planes.floor.offset'] = -radius - 0.5 * thickness - circumscribed_radius(
        woven.geometry.half_edge) - ABOVE
    return ico.Scene.from_parameters(flat)


def hairpin(scene: ico.Scene, radius: float, tilt: float) -> InitialState:
    """
    The slab bent about the y axis with its middle layer on an arc of `radius` [m]; at rest.

    Behind the arc both halves are straight; the upper one leans to the lower one by `tilt` [rad].
    """
    rest = scene.initial
    along, across, height = (rest.position - 0.5 * (
        rest.position.min(axis=0) + rest.position.max(axis=0))).T
    turned = np.clip(along / radius, -0.5 * math.pi, 0.5 * math.pi + tilt)
    straight = along - radius * turned
    # The tangent and, to the outside, the normal of the middle layer.
    forward, up = np.sin(turned), np.cos(turned)
    x = radius * (1.0 - np.cos(turned)) + straight * forward - height * up
    z = radius * np.sin(turned) + straight * up + height * forward
    turn = Rotation.from_euler('y', (turned - 0.5 * math.pi)[:, None])
    still = np.zeros((len(x), 3))
    return InitialState(
        np.stack([x, across, z], axis=1),
        (turn * Rotation.from_quat(rest.orientation)).as_quat(), still, still)


def give(simulation: ico.Simulation, state: InitialState) -> ico.Simulation:
    """Have a simulation stand in a state."""
    simulation.warm_up()
    simulation.set_state(
        position=state.position, orientation=state.orientation,
        linear_velocity=state.linear_velocity, angular_velocity=state.angular_velocity)
    return simulation


def stages(
    size: tuple[int, int, int], radius: float, tilt: float, stiffness: float, wanted: list[int],
    longest: float
) -> Iterator[tuple[float, int, InitialState]]:
    """Time [s], touching pairs and state at the start, and whenever so many pairs touch."""
    shell = fold(size, radius).shell
    scene = fold(size, radius, **{
        'contact.stiffness': stiffness, 'contact.damping': DAMPING,
        'drag.linear': DRAG * shell.mass, 'drag.angular': DRAG * shell.inertia,
        'solver.method': 'dop8', 'solver.tolerance': TOLERANCE})
    state = hairpin(scene, radius, tilt)
    simulation = give(ico.compile_scene(scene), state)
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
    """Our own steps over `span` [s] after `lead` [s], the quickest of some runs; its start."""
    simulation, taken = ico.compile_scene(scene), math.inf
    # Whatever is needed where shells touch is compiled and found in the first.
    for _ in range(RUNS):
        give(simulation, state)
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
        if taken > ENOUGH:
            break
    method, now = simulation.status.method_name, simulation.snapshot()
    label = f'{method}, tolerance {scene.parameters["solver.tolerance"]:g}'
    return Row(label, steps, span / steps, taken / steps, ico.METHODS[method].stages,
               now.position.copy(), now.orientation.copy()), start


def mujoco_row(model: Any, solver: str, step: float, state: InitialState, count: int) -> Row:
    """`count` steps of MuJoCo; the quickest of some runs."""
    mujoco = import_mujoco()
    model.opt.timestep, model.opt.integrator = step, mujoco.mjtIntegrator.mjINT_EULER
    model.opt.solver = getattr(mujoco.mjtSolver, f'mjSOL_{solver.upper()}')
    model.geom_solref[:] = 2.0 * step, 1.0
    data, bodies, taken = mujoco.MjData(model), len(state.position), math.inf
    place, rate = data.qpos.reshape(bodies, 7), data.qvel.reshape(bodies, 6)
    for _ in range(RUNS):
        mujoco.mj_resetData(model, data)
        place[:, :3] = state.position
        place[:, 3], place[:, 4:] = state.orientation[:, 3], state.orientation[:, :3]
        rate[:, :3] = state.linear_velocity
        # A free joint turns in the axes of its body.
        rate[:, 3:] = Rotation.from_quat(state.orientation).inv().apply(
            state.angular_velocity.copy())
        mujoco.mj_forward(model, data)
        started = time.process_time()
        mujoco.mj_step(model, data, count)
        taken = min(taken, time.process_time() - started)
        if taken > ENOUGH:
            break
    return Row(f'MuJoCo Euler, {solver.upper()}', count, step, taken / count, 0,
               place[:, :3].copy(), place[:, [4, 5, 6, 3]])


def overlap(scene: ico.Scene, row: Row) -> float:
    """
    How deep two shells, or a shell and the floor, overlap where a contestant came to, over a.
    """
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
    """One line."""
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
                # What the first came to after the lead is where all that follow begin, or nearly.
                first, start = row, begin
            show(own[0], row, first)
        assert first is not None
        for solver in SOLVERS:
            for step in STEPS:
                most = NEWTON_STEPS if solver == 'newton' else given.most
                count = min(round(given.span / step), most)
                show(own[0], mujoco_row(model, solver, step, start, count), first)


if __name__ == '__main__':
    main()
