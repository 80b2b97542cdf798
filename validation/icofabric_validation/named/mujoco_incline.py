# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The shell on an incline in MuJoCo, as a mesh on a plane."""

from importlib import import_module
from importlib.util import find_spec
import math

from icofabric_validation.named.loose_bodies import A, GRAVITY, NORMALS, rotate_down, VERTICES
import numpy as np


def is_installed() -> bool:
    """Return True if MuJoCo can be imported."""
    return find_spec('mujoco') is not None


def slide(
    tilt: float, friction: float, mass: float, inertia: float, azimuth: float, step: float,
    settle: float, last: float
) -> tuple[float, float, int]:
    """
    Return displacement over a, mean acceleration [m/s^2] along x, and steps.

    They are for the `last` [s] after `settle` [s]. Contacts have the largest recommended stiffness
    (solref: twice the step), the Newton solver and an elliptic cone.
    """
    mujoco = import_module('mujoco')
    points = ' '.join(repr(float(x)) for x in VERTICES.ravel())
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><compiler balanceinertia="false" boundmass="0" boundinertia="0"/>'
        f'<option timestep="{step!r}" integrator="implicitfast" cone="elliptic" gravity="'
        f'{GRAVITY * math.sin(tilt)!r} 0 {-GRAVITY * math.cos(tilt)!r}"/>'
        f'<default><geom friction="{friction!r} 0 0" condim="3" solref="{2.0 * step!r} 1"/>'
        f'</default><asset><mesh name="shell" vertex="{points}"/></asset><worldbody>'
        '<geom type="plane" size="1 1 1"/><body><freejoint/><inertial pos="0 0 0" '
        f'mass="{mass!r}" diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>'
        '<geom type="mesh" mesh="shell"/></body></worldbody></mujoco>')
    data = mujoco.MjData(model)
    turned = rotate_down(NORMALS[0], azimuth)
    data.qpos[:3] = 0.0, 0.0, -float((turned.apply(VERTICES))[:, 2].min())
    x, y, z, w = turned.as_quat()
    data.qpos[3:7] = w, x, y, z
    for _ in range(round(settle / step)):
        mujoco.mj_step(model, data)
    place, speed = data.qpos[:3].copy(), float(data.qvel[0])
    count = round(last / step)
    for _ in range(count):
        mujoco.mj_step(model, data)
    moved = float(np.abs(data.qpos[:3] - place).max()) / A
    return moved, (float(data.qvel[0]) - speed) / (count * step), count
