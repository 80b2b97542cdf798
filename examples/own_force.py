# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A force of your own in Python: a wind that grows with height pushes a hanging fabric.

    .venv/bin/python examples/own_force.py
"""

import icofabric_sim as ico

SCENE = {
    'weave.size': [3, 3, 3], 'weave.connector_angle': 0.3, 'gravity': [0.0, 0.0, -9.81],
    'contact.mode': 'never', 'groups.top': 'z_max', 'supports.top.group': 'top'}
WIND, SHEAR, STRENGTH = 2.0, 10.0, 0.01  # [m/s], [1/s], [N s/m]


def wind(time, position, orientation, linear_velocity, angular_velocity):
    """Return the drag of air that moves along y, faster the higher [N], and no torque."""
    force = -STRENGTH * linear_velocity
    force[1] += STRENGTH * (WIND + SHEAR * position[2])
    return force, 0.0 * angular_velocity


def blow(duration):
    """Displacement [m] of the lowest layer along y, and the simulation."""
    scene = ico.Scene.from_parameters(SCENE)
    # Compiled: Numba calls it for one body at a time.
    simulation = ico.compile_scene(scene, body_force=ico.BodyForce(wind, compiled=True))
    simulation.advance_to(duration)
    lowest = scene.position[:, 2] < 1e-6
    moved = simulation.snapshot().position[lowest, 1] - scene.position[lowest, 1]
    return float(moved.mean()), simulation


def main():
    """Blow, print."""
    moved, simulation = blow(0.5)
    energy = simulation.snapshot().energy
    print(f'after {simulation.time:g} s the lowest layer has moved {moved * 1e3:.3f} mm downwind')
    print(f'the wind has put in {energy["work_in"]:.4g} J; '
          f'the energy balance is off by {energy["balance_error"]:.1g} J')


if __name__ == '__main__':
    main()
