# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A scene in MuJoCo: bodies on joints, connectors as spatial tendons with springs and dampers.

The method is Runge-Kutta of order 4, in double precision. The unit of length is a, that of mass
the mass of a shell, and that of time the inverse rate of the fastest motion, because MuJoCo
rejects masses below 1e-15. Loads act by the callback for passive forces, which MuJoCo calls in
each stage.
"""

from importlib import import_module
from typing import Any

from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.libraries import install_command
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.errors import SimulationError
from icofabric_validation.stress.peer_run import number_words, PeerRun
from icofabric_validation.stress.peer_state import State
import numpy as np

# Terms of kinds that MuJoCo computes with the same forces.
TERMS = ('gravity', 'supports', 'damping', 'attachments', 'groups', 'loads')
DISTRIBUTION, INSTALL = 'mujoco', install_command('mujoco')
METHOD = 'MuJoCo RK4'
# Error of the method in a radian of an oscillation, over (step times frequency)^order.
ERROR, ORDER = 1.0 / 120.0, 4


class MuJoCoRun(PeerRun):
    """A run of a scene in MuJoCo."""

    check_period_steps = 16

    def __init__(self, scene: Scene, step: float, rate: float) -> None:
        """
        Prepare steps of `step` [s]; the unit of time is 1 / `rate` of the fastest motion [rad/s].

        Raises ValueError if MuJoCo rejects the scene.
        """
        super().__init__(scene, step, rate)
        self._mujoco = import_module('mujoco')
        self._cosines = cosines_from_quaternions(scene.initial.orientation)
        self._model = self._mujoco.MjModel.from_xml_string(self._mjcf())
        self._data = self._mujoco.MjData(self._model)
        self._shown = self._mujoco.MjData(self._model)
        self._start()

    def _advance(self, end: int) -> None:
        super()._advance(end)
        for kind in range(self._mujoco.mjtWarning.mjNWARNING):
            if self._data.warning[kind].number:
                words = self._mujoco.mju_warningText(
                    kind, int(self._data.warning[kind].lastinfo))
                raise SimulationError(
                    f'MuJoCo at t = {self.time:.9g} s, after steps of {self.step:.6g} s: {words}')

    def _advance_equal(self, count: int) -> None:
        mujoco, first = self._mujoco, self.step_count
        self._model.opt.timestep = self._steps.length(first) * self._rate
        if self._loads.bodies.size:
            within = self._steps.middle(first)
            mujoco.set_mjcb_passive(lambda model, data: self._apply_loads(model, data, within))
        try:
            mujoco.mj_step(self._model, self._data, count)
        finally:
            mujoco.set_mjcb_passive(None)
        self.step_count += count

    def _apply_loads(self, model: Any, data: Any, within: float) -> None:
        """Add the loads to the passive forces, for the poses at the time of a stage."""
        numbers = self._bodies[self._loads.bodies]
        axes = data.xmat[numbers].reshape(-1, 3, 3).transpose(0, 2, 1)
        force, torque = self._loads.at(data.time / self._rate, within, axes)
        unit = self.scene.shell.mass * self._length * self._rate**2
        for body, push, turn in zip(numbers, force / unit, torque / (unit * self._length)):
            self._mujoco.mj_applyFT(
                model, data, push, turn, data.xpos[body], int(body), data.qfrc_passive)

    def snapshot(self) -> State:
        """Return the current state."""
        mujoco, model, data = self._mujoco, self._model, self._shown
        mujoco.mj_copyData(data, model, self._data)
        mujoco.mj_forward(model, data)
        bodies = self._bodies
        velocity = np.zeros((len(bodies), 6))
        for row, body in zip(velocity, bodies):
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, int(body), row, 0)
        a, rate = self._length, self._rate
        return State(
            a * data.xpos[bodies], data.xquat[bodies][:, [1, 2, 3, 0]],
            a * rate * velocity[:, 3:], rate * velocity[:, :3], self._intact)

    def saved(self) -> np.ndarray:
        """Return the complete state of the integrator."""
        kind = self._mujoco.mjtState.mjSTATE_FULLPHYSICS
        numbers = np.zeros(self._mujoco.mj_stateSize(self._model, kind))
        self._mujoco.mj_getState(self._model, self._data, numbers, kind)
        return numbers

    def restore(self, numbers: np.ndarray, step_count: int) -> None:
        """Restore a saved state that was reached after `step_count` steps."""
        self._mujoco.mj_setState(
            self._model, self._data, numbers, self._mujoco.mjtState.mjSTATE_FULLPHYSICS)
        self.step_count = step_count

    def _mjcf(self) -> str:
        """Return the model of the scene as MJCF."""
        scene, a, rate = self.scene, self._length, self._rate
        mass, inertia = 1.0, scene.shell.inertia / (scene.shell.mass * a**2)
        laws, start = scene.connectors.laws, scene.initial
        ends, points = scene.connectors.bodies.tolist(), scene.connectors.points_body / a
        sites, bodies = [''] * scene.body_count, ''
        for number, pair in enumerate(ends):
            for side, body in enumerate(pair):
                sites[body] += (
                    f'<site name="s{number}_{side}" pos="{number_words(points[number, side])}"/>')
        for body in range(scene.body_count):
            place, (x, y, z, w) = start.position[body] / a, start.orientation[body]
            moving, turning = self._free_axes(body)
            joints, quat = '<freejoint/>', (1.0, 0.0, 0.0, 0.0)
            if not (all(moving) and turning):
                joints = ''
                axes = np.eye(3)
                if not turning:
                    quat = w, x, y, z
                    axes = self._cosines[body].T
                # Joint axes are in the initial frame of the body.
                joints += ''.join(
                    f'<joint type="slide" axis="{number_words(axes[axis])}"/>'
                    for axis in range(3) if moving[axis])
                joints += '<joint type="ball"/>' if turning else ''
            bodies += (
                f'<body name="b{body}" pos="{number_words(place)}" quat="{number_words(quat)}">'
                f'{joints}<inertial pos="0 0 0" mass="{mass!r}" '
                f'diaginertia="{number_words([inertia] * 3)}"/>'
                f'{sites[body]}</body>')
        unit = scene.shell.mass * rate**2
        stiffness, length, damping = (
            np.broadcast_to(values, len(ends))
            for values in (laws.extension, laws.natural_length, scene.connectors.damping))
        tendons = ''.join(
            f'<spatial stiffness="{float(stiffness[c]) / unit!r}" '
            f'springlength="{float(length[c]) / a!r}" '
            f'damping="{float(damping[c]) * rate / unit!r}">'
            f'<site site="s{c}_0"/><site site="s{c}_1"/></spatial>' for c in range(len(ends)))
        gravity = np.array(scene.parameters['gravity'], dtype=float) / (a * rate**2)
        return (
            '<mujoco><compiler balanceinertia="false" boundmass="0" boundinertia="0"/>'
            f'<option gravity="{number_words(gravity)}" integrator="RK4" jacobian="sparse"><flag '
            'contact="disable" constraint="disable" sensor="disable" actuation="disable" '
            'limit="disable" equality="disable" frictionloss="disable"/></option>'
            f'<worldbody>{bodies}</worldbody><tendon>{tendons}</tendon></mujoco>')

    def _free_axes(self, body: int) -> tuple[list[bool], bool]:
        """Return the world axes along which a body may move, and whether the body may rotate."""
        supports = self.scene.supports
        if supports is None:
            return [True] * 3, True
        return [not held for held in supports.translation[body]], not supports.rotation[body]

    def _start(self) -> None:
        """Set all bodies to the initial state of the scene."""
        start, model, data = self.scene.initial, self._model, self._data
        a, rate = self._length, self._rate
        self._bodies = np.array([
            self._mujoco.mj_name2id(model, self._mujoco.mjtObj.mjOBJ_BODY, f'b{body}')
            for body in range(self.scene.body_count)])
        for body, number in enumerate(self._bodies):
            x, y, z, w = start.orientation[body]
            moving, turning = self._free_axes(body)
            place, speed = start.position[body] / a, start.linear_velocity[body] / (a * rate)
            # Angular velocities of joints are in the frame of the body.
            spin = self._cosines[body] @ start.angular_velocity[body] / rate
            joint = int(model.body_jntadr[number])
            if joint < 0:
                continue
            q, v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
            if all(moving) and turning:
                data.qpos[q:q + 7] = *place, w, x, y, z
                data.qvel[v:v + 6] = *speed, *spin
                continue
            free = [axis for axis in range(3) if moving[axis]]
            data.qvel[v:v + len(free)] = speed[free]
            if turning:
                q, v = q + len(free), v + len(free)
                data.qpos[q:q + 4] = w, x, y, z
                data.qvel[v:v + 3] = spin
        self._mujoco.mj_forward(model, data)
