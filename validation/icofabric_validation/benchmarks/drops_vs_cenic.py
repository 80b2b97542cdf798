# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Shells that bounce on a floor, compared with the error-controlled contact of Drake (CENIC).

Each shell falls from a different height and lands without spin on the vertex below its centre. The
law of this project is then that of Hunt and Crossley, K r^2 x (1 + c r dx/dt) with the overlap x
and r = rho / (rho + R), which Drake computes for a sphere of radius R on a plane. Both therefore
solve the same equations. The error is the largest distance over a of a body from a solution by
SciPy that stops at every contact. Needs drake.

    .venv/bin/python -m icofabric_validation.benchmarks.drops_vs_cenic --picture FILE.png
"""

import argparse
from collections.abc import Callable
from functools import partial
from importlib import import_module, metadata
from pathlib import Path
import time
from typing import Any

import icofabric_sim as ico
from icofabric_sim.geometry.icosahedron import circumscribed_radius, inscribed_radius, vertices
from icofabric_sim.pictures.precision_picture import draw_work_precision, PrecisionPoint
from icofabric_validation.benchmarks.machine import describe_machine
import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

Run = Callable[[], tuple[np.ndarray, float, int]]

GRAVITY, STIFFNESS, DAMPING = 9.81, 1e6, 2.0  # [m/s^2], [N/m], [s/m]
# Range of initial heights of the lowest vertices, and spacing of neighbours [m].
LOWEST, HIGHEST, SPACING = 0.01, 0.03, 0.1
ACCURACIES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
OWN = {'leapfrog': (1.0, 1e-1, 1e-2, 1e-3), 'dop8': (1.0, 1e-2, 1e-4, 1e-6, 1e-8)}


def build(method: str, tolerance: float, size: tuple[int, int, int]) -> ico.Scene:
    """Return a scene of separate shells above a floor at z = 0."""
    return ico.Scene.from_parameters({
        'weave.size': list(size), 'weave.connected': False, 'gravity': [0.0, 0.0, -GRAVITY],
        'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -1.0,
        'contact.stiffness': STIFFNESS, 'contact.damping': DAMPING, 'solver.method': method,
        'solver.tolerance': tolerance, 'solver.threads': 1})


def places(count: int, radius: float) -> np.ndarray:
    """Return initial centres (n, 3) [m] above the floor, far from each other."""
    side = int(np.ceil(np.sqrt(count)))
    number = np.arange(count)
    # Distinct heights in irregular order.
    height = LOWEST + (HIGHEST - LOWEST) * (number * 0.6180339887498949 % 1.0)
    return np.stack([SPACING * (number % side), SPACING * (number // side), radius + height], 1)


def solution(height: float, radius: float, mass: float, stiffness: float, damping: float,
             until: float) -> float:
    """Return the final height [m] of a centre, by steps that end at every contact."""
    def fall(_: float, y: np.ndarray) -> list[float]:
        return [y[1], -GRAVITY]

    def touch(_: float, y: np.ndarray) -> list[float]:
        depth = radius - y[0]
        return [y[1], max(stiffness * depth * (1.0 - damping * y[1]), 0.0) / mass - GRAVITY]

    def meets(_: float, y: np.ndarray) -> float:
        return float(y[0] - radius)

    meets.terminal = True  # type: ignore[attr-defined]
    now, state, above = 0.0, [height, 0.0], True
    while now < until:
        meets.direction = -1.0 if above else 1.0  # type: ignore[attr-defined]
        # Far below any printed error.
        found = solve_ivp(fall if above else touch, (now, until), state, method='DOP853',
                          rtol=1e-13, atol=1e-16, events=meets,
                          max_step=np.inf if above else 1e-4)
        now, state, above = float(found.t[-1]), found.y[:, -1].tolist(), not above
        if len(found.t_events[0]):
            # On the right side of the surface in spite of round-off.
            state[0] = radius - (1e-18 if not above else -1e-18)
    return float(state[0])


def own_run(method: str, tolerance: float, size: tuple[int, int, int], until: float
            ) -> tuple[np.ndarray, float, int]:
    """Return final heights [m], processor time [s] and steps."""
    scene = build(method, tolerance, size)
    simulation, a = ico.compile_scene(scene), scene.geometry.half_edge
    radius = circumscribed_radius(a)
    at = places(scene.body_count, radius) - [0.0, 0.0, 1.0]
    down, _ = Rotation.align_vectors([[0.0, 0.0, -1.0]], [vertices(1.0)[0]])
    turn = np.tile(down.as_quat(), (scene.body_count, 1))
    still = np.zeros_like(at)
    simulation.warm_up()
    taken = []
    for _ in range(2):
        # The first run compiles kernels.
        simulation.reset()
        simulation.set_state(position=at, orientation=turn, linear_velocity=still,
                             angular_velocity=still)
        begun, counted, started = (
            simulation.time, simulation.status.step_count, time.process_time())
        simulation.advance_to(begun + until)
        taken.append(time.process_time() - started)
    return (simulation.snapshot().position[:, 2] + 1.0, taken[-1],
            simulation.status.step_count - counted)


def drake_run(scheme: str, accuracy: float, scene: ico.Scene, until: float
              ) -> tuple[np.ndarray, float, int]:
    """Return final heights [m], processor time [s] and steps of Drake, with point contact."""
    plants, trees = import_module('pydrake.multibody.plant'), import_module(
        'pydrake.multibody.tree')
    geometry, analysis = import_module('pydrake.geometry'), import_module(
        'pydrake.systems.analysis')
    transform = import_module('pydrake.math').RigidTransform
    a, count = scene.geometry.half_edge, scene.body_count
    radius, part = circumscribed_radius(a), ratio()
    builder = import_module('pydrake.systems.framework').DiagramBuilder()
    plant, _ = plants.AddMultibodyPlantSceneGraph(builder, 0.0)
    plant.set_contact_model(plants.ContactModel.kPoint)
    smooth = plants.CoulombFriction(0.0, 0.0)

    def material(stiffness: float, damping: float) -> Any:
        properties = geometry.ProximityProperties()
        geometry.AddContactMaterial(damping, stiffness, smooth, properties)
        return properties

    plant.RegisterCollisionGeometry(
        plant.world_body(), transform(), geometry.HalfSpace(), 'floor', material(1e20, 0.0))
    unit = trees.UnitInertia(*[scene.shell.inertia / scene.shell.mass] * 3)
    inertia = trees.SpatialInertia(scene.shell.mass, np.zeros(3), unit)
    at = places(count, radius)
    for number in range(count):
        body = plant.AddRigidBody(f'body{number}', inertia)
        plant.RegisterCollisionGeometry(
            body, transform(), geometry.Sphere(radius), f'shell{number}',
            material(STIFFNESS * part**2, DAMPING * part))
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -GRAVITY])
    plant.Finalize()
    diagram = builder.Build()
    simulator = analysis.Simulator(diagram)
    analysis.ApplySimulatorConfig(analysis.SimulatorConfig(
        integration_scheme=scheme, accuracy=accuracy, max_step_size=0.1,
        use_error_control=True), simulator)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetPositions(context, np.hstack([np.tile([1.0, 0, 0, 0], (count, 1)), at]).ravel())
    simulator.Initialize()
    started = time.process_time()
    simulator.AdvanceTo(until)
    taken = time.process_time() - started
    found = plant.GetPositions(context).reshape(-1, 7)[:, 6]
    return found.copy(), taken, simulator.get_integrator().get_num_steps_taken()


def ratio() -> float:
    """Return delta over the overlap, for a vertex below the centre and a plane."""
    return inscribed_radius(1.0) / (inscribed_radius(1.0) + circumscribed_radius(1.0))


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--size', type=int, nargs=3, default=(5, 5, 5), help='weave.size')
    parser.add_argument('--until', type=float, default=0.3, help='simulated time [s]')
    parser.add_argument('--picture', type=Path, help='draw error against time into this file')
    given = parser.parse_args()
    size, scene = tuple(given.size), build('dop8', 1.0, tuple(given.size))
    a, part = scene.geometry.half_edge, ratio()
    start = places(scene.body_count, circumscribed_radius(a))
    exact = np.array([solution(
        float(height), circumscribed_radius(a), scene.shell.mass, STIFFNESS * part**2,
        DAMPING * part, given.until) for height in start[:, 2]])
    print(describe_machine() + f', drake {metadata.version("drake")}; one thread each')
    print(f'{scene.body_count} bodies, {given.until:g} s')
    rows: list[tuple[str, str, float, Run]] = [
        (method, 'icofabric_sim', tolerance, partial(
            own_run, method, tolerance, size, given.until))
        for method, tolerances in OWN.items() for tolerance in tolerances]
    rows += [
        (f'Drake {scheme}', 'drake', accuracy, partial(
            drake_run, scheme, accuracy, scene, given.until))
        for scheme, accuracies in (('cenic', ACCURACIES), ('runge_kutta3', ACCURACIES[:3]))
        for accuracy in accuracies]
    points = []
    for solver, tool, setting, run in rows:
        found, taken, steps = run()
        error = float(np.abs(found - exact).max()) / a
        points.append(PrecisionPoint(solver, tool, error, taken, taken, taken))
        print(f'{solver:20} {setting:8g} error {error:9.2e} a {taken:9.3f} s {steps:7d} steps',
              flush=True)
    if given.picture:
        draw_work_precision(
            points, given.picture, title=f'bouncing shells: {scene.body_count} bodies, '
            f'{given.until:g} s')


if __name__ == '__main__':
    main()
