# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The pile of pile.py compared with MuJoCo: overlap against step, and run time.

Both have the same bodies, initial state, friction and box. Contacts of MuJoCo have the largest
recommended stiffness (solref: twice the step), so their overlap falls with the step; ours falls
with contact.stiffness. The laws dissipate different energies in collisions. Needs mujoco.

    .venv/bin/python -m icofabric_validation.benchmarks.pile_vs_mujoco --size 3 3 6
    .venv/bin/python -m icofabric_validation.benchmarks.pile_vs_mujoco  # 216
    .venv/bin/python -m icofabric_validation.benchmarks.pile_vs_mujoco --solver cg
    .venv/bin/python -m icofabric_validation.benchmarks.pile_vs_mujoco --size 3 3 6 \
        --begin 0.4 --until 0.6  # rest
"""

import argparse
from collections.abc import Callable
from functools import partial
import time

import icofabric_sim as ico
from icofabric_sim.geometry.icosahedron import vertices
from icofabric_validation.benchmarks.machine import describe_machine, import_mujoco
from icofabric_validation.benchmarks.peers import mujoco_peer
from icofabric_validation.benchmarks.pile import A, pile
import numpy as np

STEPS = (2e-3, 1e-3, 5e-4, 2e-4, 1e-4)
STIFFNESSES = (1e5, 3e5, 1e6, 3e6)


def description(scene: ico.Scene, friction: float) -> str:
    """Return the scene as MJCF; lengths in m."""
    points = ' '.join(f'{x:.17g}' for x in vertices(A).ravel())
    mass, inertia = scene.shell.mass, scene.shell.inertia
    inertial = (f'<inertial pos="0 0 0" mass="{mass:.17g}" '
                f'diaginertia="{inertia:.17g} {inertia:.17g} {inertia:.17g}"/>')
    bodies = ''.join(
        f'<body>{inertial}<freejoint/><geom type="mesh" mesh="shell"/></body>'
        for _ in range(scene.body_count))
    walls, values = '', scene.parameters
    for name in values.names('planes'):
        normal = np.array(values[f'planes.{name}.normal'])
        place = normal * values[f'planes.{name}.offset']
        walls += (f'<geom type="plane" size="1 1 1" pos="{place[0]:.17g} {place[1]:.17g} '
                  f'{place[2]:.17g}" zaxis="{normal[0]:g} {normal[1]:g} {normal[2]:g}"/>')
    return (
        '<mujoco><option gravity="0 0 -9.81" integrator="implicitfast" cone="elliptic"/>'
        '<size memory="1G"/>'
        f'<default><geom friction="{friction:g} 0 0" condim="3"/></default>'
        f'<asset><mesh name="shell" vertex="{points}"/></asset>'
        f'<worldbody>{walls}{bodies}</worldbody></mujoco>')


def run_mujoco(
    scene: ico.Scene, friction: float, solver: str, step: float, begin: float, until: float
) -> dict[str, float]:
    """Return the largest overlap over a, and the processor time [s] from `begin` on."""
    mujoco = import_mujoco()
    model = mujoco.MjModel.from_xml_string(description(scene, friction))
    model.opt.timestep = step
    model.opt.solver = getattr(mujoco.mjtSolver, f'mjSOL_{solver.upper()}')
    model.geom_solref[:] = 2.0 * step, 1.0
    data = mujoco.MjData(model)
    mujoco_peer.set_bodies(data, *scene.initial)
    deepest, began = 0.0, time.process_time()
    for number in range(round(until / step)):
        if number == round(begin / step):
            began = time.process_time()
        mujoco.mj_step(model, data)
        if data.ncon:
            deepest = max(deepest, -float(data.contact.dist.min()))
    return {'overlap': deepest / A, 'taken': time.process_time() - began,
            'height': float(data.qpos[2::7].mean())}


def run_own(scene: ico.Scene, begin: float, until: float) -> dict[str, float]:
    """Return the largest overlap over a, and the processor time [s] of this package."""
    simulation = ico.compile_scene(scene)
    simulation.warm_up()
    simulation.advance_to(begin)
    began = time.process_time()
    simulation.advance_to(until)
    return {'overlap': simulation.status.deepest_overlap / A, 'taken': time.process_time() - began,
            'height': float(simulation.snapshot().position[:, 2].mean())}


def main() -> None:
    """Run both and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--size', type=int, nargs=3, default=(6, 6, 12), help='weave.size')
    parser.add_argument('--friction', type=float, default=0.4)
    parser.add_argument('--damping', type=float, default=5.0, help='ours [s/m]')
    parser.add_argument('--tolerance', type=float, default=1.0, help='ours')
    parser.add_argument('--methods', nargs='*', default=('auto', 'dop8'), help='ours')
    parser.add_argument('--steps', type=float, nargs='*', default=STEPS, help="MuJoCo's [s]")
    parser.add_argument('--solver', choices=('newton', 'cg'), default='newton', help="MuJoCo's")
    parser.add_argument('--stiffnesses', type=float, nargs='*', default=STIFFNESSES,
                        help='of our contacts [N/m]')
    parser.add_argument('--begin', type=float, default=0.0, help='start of the timed interval [s]')
    parser.add_argument('--until', type=float, default=0.4, help='simulated time [s]')
    parser.add_argument('--rounds', type=int, default=1, help='the least time counts')
    given = parser.parse_args()
    changes = {'contact.friction': given.friction, 'contact.damping': given.damping,
               'solver.tolerance': given.tolerance}
    scene = pile(tuple(given.size), **changes)
    print(describe_machine())
    print(f'{scene.body_count} bodies to t = {given.until:g} s, friction {given.friction:g}')
    print(f'{"":28} {"deepest overlap":>16} {"processor":>10} {"mean height":>12}')
    runs: dict[str, Callable[[], dict[str, float]]] = {
        f'MuJoCo, steps of {step:g} s': partial(
            run_mujoco, scene, given.friction, given.solver, step, given.begin, given.until)
        for step in given.steps}
    for method in given.methods:
        ours = {**changes, 'solver.method': method, 'solver.threads': 1}
        # A first run compiles kernels.
        run_own(pile((3, 3, 6), **ours), 0.0, 0.1)
        for stiffness in given.stiffnesses:
            own = pile(tuple(given.size), **ours, **{'contact.stiffness': stiffness})
            runs[f'{method}, K = {stiffness:g} N/m'] = partial(
                run_own, own, given.begin, given.until)
    seen: dict[str, dict[str, float]] = {}
    for _ in range(given.rounds):
        for label, run in runs.items():
            found = run()
            if label not in seen or found['taken'] < seen[label]['taken']:
                seen[label] = found
    for label, found in seen.items():
        show(label, found)


def show(label: str, seen: dict[str, float]) -> None:
    """Print one row."""
    print(f'{label:28} {100.0 * seen["overlap"]:10.3f} % a {seen["taken"]:8.2f} s '
          f'{1e3 * seen["height"]:9.2f} mm', flush=True)


if __name__ == '__main__':
    main()
