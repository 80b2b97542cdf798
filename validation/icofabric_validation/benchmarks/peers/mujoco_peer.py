# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""MuJoCo: free bodies joined by spatial tendons with springs; everything else is switched off."""

from collections.abc import Iterator
from importlib import import_module
from typing import Any

from icofabric_sim.geometry.icosahedron import vertices
from icofabric_sim.libraries import install_command
from icofabric_validation.benchmarks.scenes import axes_from_quaternions, Motion, PlainScene
from icofabric_validation.benchmarks.solver import Solver, StepSolver
import numpy as np

DISTRIBUTION = 'mujoco'
INSTALL = install_command('mujoco')
# Integrator, order, evaluations per step, and initial step times frequency. Euler has order 1, but
# its positions are here those of leapfrog, because no force acts at the start.
_INTEGRATORS = {'Euler': (2, 1, 0.5), 'implicitfast': (2, 1, 0.5), 'RK4': (4, 4, 1.5)}


class MuJoCo(StepSolver):
    """One integrator over a compiled model."""

    tool = 'mujoco'

    def __init__(self, scene: PlainScene, integrator: str, model: Any) -> None:
        """Create a solver of `model` with `integrator`."""
        self._mujoco = import_module('mujoco')
        self._scene, self._model = scene, model
        self._integrator = getattr(
            self._mujoco.mjtIntegrator, f'mjINT_{integrator.upper()}')
        self._data = self._mujoco.MjData(model)
        self.label = f'MuJoCo {integrator}'
        self.order, self.evaluations, courant = _INTEGRATORS[integrator]
        self.longest = courant / scene.frequency_bound

    def start(self, step: float) -> None:
        scene, data = self._scene, self._data
        self._model.opt.timestep = step
        self._model.opt.integrator = self._integrator
        self._mujoco.mj_resetData(self._model, data)
        set_bodies(data, scene.position, scene.orientation, scene.velocity, scene.spin)
        self._mujoco.mj_forward(self._model, data)

    def advance(self, count: int) -> None:
        self._model.opt.integrator = self._integrator
        self._mujoco.mj_step(self._model, self._data, count)

    def motion(self) -> Motion:
        places = self._data.qpos.reshape(self._scene.body_count, 7)
        return Motion(places[:, :3].copy(), axes_from_quaternions(places[:, [4, 5, 6, 3]]))


def set_bodies(
    data: Any, position: np.ndarray, orientation: np.ndarray, velocity: np.ndarray,
    spin: np.ndarray
) -> None:
    """Set the state of free bodies: quaternions x y z w, velocities in the world frame."""
    places, rates = data.qpos.reshape(-1, 7), data.qvel.reshape(-1, 6)
    places[:, :3], places[:, 3:] = position, orientation[:, [3, 0, 1, 2]]
    # Angular velocities of free joints are in the frame of the body.
    rates[:, :3] = velocity
    rates[:, 3:] = np.einsum('bij,bj->bi', axes_from_quaternions(orientation), spin)


def model_text(scene: PlainScene, *, floor: float | None = None) -> str:
    """
    Return the MJCF of `scene`: sites at the used edge midpoints, and tendons between them.

    With a `floor` at a height [m] the bodies have weight, and shells are convex meshes in
    frictionless contact with each other and the floor.
    """
    used = sorted({
        (int(body), int(edge))
        for body, edge in zip(scene.bodies.ravel(), scene.edges.ravel())})
    points, sites = scene.edge_points, [''] * scene.body_count
    for body, edge in used:
        sites[body] += f'<site name="s{body}_{edge}" pos="{_numbers(points[edge])}"/>'
    assets, shell, ground, memory, weight = '', '', '', '256M', '0 0 0'
    unused = 'contact="disable" constraint="disable" gravity="disable" '
    if floor is not None:
        corners = _numbers(vertices(scene.half_edge).ravel())
        assets = f'<asset><mesh name="shell" vertex="{corners}"/></asset>'
        shell = '<geom type="mesh" mesh="shell" condim="1"/>'
        ground = f'<geom type="plane" size="1 1 1" pos="0 0 {floor!r}" condim="1"/>'
        unused, memory, weight = '', '4G', '0 0 -9.81'
    bodies = ''.join(
        f'<body><freejoint/><inertial pos="0 0 0" mass="{scene.mass!r}" '
        f'diaginertia="{_numbers([scene.inertia] * 3)}"/>{shell}{own}</body>' for own in sites)
    spring = f'stiffness="{scene.stiffness!r}" springlength="{scene.natural_length!r}"'
    tendons = ''.join(
        f'<spatial {spring}><site site="s{i}_{e}"/><site site="s{j}_{f}"/></spatial>'
        for (i, j), (e, f) in zip(scene.bodies.tolist(), scene.edges.tolist()))
    return (
        '<mujoco><compiler balanceinertia="false" boundmass="0" boundinertia="0"/>'
        f'<size memory="{memory}"/><option gravity="{weight}" jacobian="sparse"><flag {unused}'
        'sensor="disable" actuation="disable" '
        'limit="disable" equality="disable" frictionloss="disable" autoreset="disable"/></option>'
        f'{assets}<worldbody>{ground}{bodies}</worldbody><tendon>{tendons}</tendon></mujoco>')


def solvers(scene: PlainScene) -> Iterator[Solver]:
    """Yield the default integrator, the recommended one, and the accurate one."""
    model = import_module('mujoco').MjModel.from_xml_string(model_text(scene))
    for integrator in _INTEGRATORS:
        yield MuJoCo(scene, integrator, model)


def _numbers(values: Any) -> str:
    return ' '.join(repr(float(value)) for value in values)
