# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Equilibria compared with minimisers of SciPy and a damped run: time and residual force.

With `--growth`: the solver of this package alone, for slabs of 63 to 49,726 bodies, each in a
separate process.

All solvers start from the woven state with the same energy and forces. Those of SciPy get the
gradient in positions and rotation vectors since the start. The damped run has drag of twice the
lowest frequency.

    .venv/bin/python -m icofabric_validation.benchmarks.equilibrium
    .venv/bin/python -m icofabric_validation.benchmarks.equilibrium --growth
"""

import argparse
from collections.abc import Callable
import resource
import subprocess
import sys
import time
from typing import Any, NamedTuple

import icofabric_sim as ico
from icofabric_sim.statics.fabric import Configuration, StaticFabric
from icofabric_validation.benchmarks.machine import machine_lines
import numpy as np
from scipy.optimize import minimize


class Row(NamedTuple):
    """The result of one solver."""

    name: str
    seconds: float
    evaluations: int  # of forces, or of products with the Hessian
    residual: float
    energy: float  # [J]


def cantilever(size: list[int]) -> ico.Scene:
    """Return a slab with bending stiffness that is held at one side, under its weight."""
    return ico.Scene.from_parameters({
        'weave': {'size': size}, 'gravity': [0.0, 0.0, -9.81], 'groups': {'wall': 'x_min'},
        'supports': {'wall': {'group': 'wall'}}, 'contact': {'mode': 'never'},
        'connector': {'stiffness': 2000.0, 'bending_stiffness': 0.02}})


def hanging(size: list[int]) -> ico.Scene:
    """Return a slab of point springs under its ceiling, which folds far before equilibrium."""
    return ico.Scene.from_parameters({
        'weave': {'size': size}, 'gravity': [0.0, 0.0, -9.81], 'groups': {'top': 'z_max'},
        'supports': {'top': {'group': 'top'}}, 'contact': {'mode': 'never'}})


def measure_growth(text: str, kind: str) -> str:
    """Return a row for a slab of a size, with times and memory without the scene."""
    make = KINDS[kind]
    # Compile or load kernels first.
    ico.solve_equilibrium(make([3, 3, 3]))
    scene = make([int(part) for part in text.split('x')])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began, spent = time.perf_counter(), time.process_time()
    result = ico.solve_equilibrium(scene)
    wall, used = time.perf_counter() - began, time.process_time() - spent
    more = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / scene.body_count
    return (f'{kind:8} {scene.body_count:7,} bodies {result.step_count:5,} steps '
            f'{result.product_count:8,} products {wall:8.2f} s, of the processor {used:8.2f} s, '
            f'{more:6.1f} kB a body; {result.verdict}, residual {result.residual:.1e}')


def residual(here: Configuration) -> float:
    """Return the largest residual force, or torque over a, over the largest acting force."""
    left = np.abs(np.where(here.fabric.free, here.force, 0.0))
    left[:, 3:] /= here.fabric.half_edge
    return float(left.max() / here.force_scale)


def own(scene: ico.Scene) -> Row:
    """Solve with this package."""
    began = time.perf_counter()
    result = ico.solve_equilibrium(scene)
    return Row('solve_equilibrium', time.perf_counter() - began, result.product_count,
               result.residual, energy_of(scene, result.snapshot))


def energy_of(scene: ico.Scene, snapshot: ico.Snapshot) -> float:
    """Return the potential energy [J]."""
    return Configuration(
        StaticFabric(scene), snapshot.position.copy(), snapshot.orientation.copy()).energy


class Chart:
    """Energy and gradient in displacements and rotation vectors, scaled by mass."""

    def __init__(self, scene: ico.Scene) -> None:
        """Start at the woven state."""
        self.fabric = StaticFabric(scene)
        self.scale = np.where(self.fabric.free, 1.0 / self.fabric.root, 0.0)
        self.unit = self.fabric.start.force_scale * self.fabric.half_edge
        self.calls = 0

    def at(self, vector: np.ndarray) -> Configuration:
        """Return the configuration of a vector."""
        return self.fabric.start.moved(self.scale * vector.reshape(self.scale.shape))

    def energy_and_gradient(self, vector: np.ndarray) -> tuple[float, np.ndarray]:
        """Return energy and gradient in units of the weight of a body times a."""
        self.calls += 1
        here, motion = self.at(vector), self.scale * vector.reshape(self.scale.shape)
        slope = -here.force
        # exp(phi + d phi) = exp(J d phi) exp(phi), with the left Jacobian J of the rotations.
        turn = motion[:, 3:]
        angle = np.linalg.norm(turn, axis=1)[:, None]
        first = 0.5 * np.sinc(angle / (2.0 * np.pi))**2
        safe = np.where(angle > 1e-4, angle, 1.0)
        second = np.where(angle > 1e-4, (safe - np.sin(safe)) / safe**3, 1.0 / 6.0)
        moment = slope[:, 3:]
        cross = np.cross(turn, moment)
        slope[:, 3:] = moment - first * cross + second * np.cross(turn, cross)
        return here.energy / self.unit, (slope * self.scale).ravel() / self.unit


def general(scene: ico.Scene, method: str, options: dict[str, Any]) -> Row:
    """Minimise with a method of SciPy."""
    chart = Chart(scene)
    began = time.perf_counter()
    found = minimize(
        chart.energy_and_gradient, np.zeros(chart.scale.size), jac=True, method=method,
        options=options)
    seconds = time.perf_counter() - began
    here = chart.at(found.x)
    return Row(f'SciPy {method}', seconds, chart.calls, residual(here), here.energy)


def damped(scene: ico.Scene) -> Row:
    """Run with drag until less than 1e-8 of the forces remains, or for 20 periods."""
    rate = 2.0 * float(ico.solve_modes(scene, count=1).frequencies[0])
    drag = {'drag.linear': rate * scene.shell.mass, 'drag.angular': rate * scene.shell.inertia,
            'solver.tolerance': 1e-8, 'contact.mode': 'never'}
    began = time.perf_counter()
    simulation = ico.compile_scene(
        ico.Scene.from_parameters(scene.parameters.with_changes(drag)))
    fabric, left, here = StaticFabric(scene), 1.0, None
    while left > 1e-8 and simulation.time < 20.0 * 2.0 * np.pi / rate:
        simulation.advance_to(simulation.time + 2.0 / rate)
        snapshot = simulation.snapshot()
        here = Configuration(fabric, snapshot.position.copy(), snapshot.orientation.copy())
        left = residual(here)
    assert here is not None
    return Row('run with drag (dop8)', time.perf_counter() - began,
               12 * simulation.status.step_count, left, here.energy)


KINDS = {'held': cantilever, 'hanging': hanging}
GROWTH = ['5x5x5', '11x10x8', '21x21x21', '47x46x46']


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--sizes', nargs='*')
    parser.add_argument('--growth', nargs='*', choices=KINDS, metavar='KIND', help='held, hanging')
    parser.add_argument('--one', nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        print(measure_growth(*arguments.one), flush=True)
        return
    print('\n'.join(machine_lines(('scipy',), threads='threads as chosen')))
    if arguments.growth is not None:
        for kind in arguments.growth or KINDS:
            for size in arguments.sizes or GROWTH:
                subprocess.run(
                    [sys.executable, '-m', 'icofabric_validation.benchmarks.equilibrium', '--one',
                     size, kind], check=True)
        return
    solvers: list[Callable[[ico.Scene], Row]] = [
        own,
        lambda scene: general(scene, 'L-BFGS-B', {
            'maxiter': 20_000, 'maxfun': 40_000, 'ftol': 0.0, 'gtol': 0.0, 'maxcor': 20}),
        lambda scene: general(scene, 'CG', {'maxiter': 20_000, 'gtol': 1e-12}),
        damped]
    for size in arguments.sizes or ['5x3x3', '9x5x5', '13x7x7']:
        scene = cantilever([int(part) for part in size.split('x')])
        # Compile or load kernels of both kinds first.
        own(scene)
        damped(cantilever([3, 2, 2]))
        print(f'\n{size}: {scene.body_count:,} bodies')
        for solve in solvers:
            row = solve(scene)
            print(f'  {row.name:22} {row.seconds:8.3f} s  {row.evaluations:7,} evaluations  '
                  f'residual {row.residual:8.1e}  energy {row.energy:.12g} J')


if __name__ == '__main__':
    main()
