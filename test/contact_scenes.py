# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Loose shells that meet."""

import icofabric_sim as ico
import numpy as np
from scipy.spatial.transform import Rotation

A = 0.01
# It hits the woven body at the origin off its centre.
OBLIQUE = ((0.06, 0.004, 0.003), (-1.0, 0.1, 0.2), (3.0, -20.0, 8.0), Rotation.from_euler(
    'xyz', [0.3, 0.8, -0.4]))


def loose(*bodies, **changes):
    """Bodies of their own: places, velocities, spins, and orientations where they are given."""
    flat = {'weave.size': [1, 1, 1], 'weave.connected': False, 'contact.mode': 'auto',
            'solver.method': 'dop8', 'solver.tolerance': 1e-8, 'contact.stiffness': 2e5}
    for number, (place, velocity, spin, *turned) in enumerate(bodies):
        name = f'bodies.b{number}'
        flat[f'{name}.position'] = [float(x) for x in place]
        flat[f'{name}.linear_velocity'] = [float(x) for x in velocity]
        flat[f'{name}.angular_velocity'] = [float(x) for x in spin]
        if turned:
            flat[f'{name}.orientation'] = [float(x) for x in turned[0].as_quat()]
    flat.update({name.replace('__', '.'): value for name, value in changes.items()})
    return ico.Scene.from_parameters(flat)


def momenta(scene, snapshot):
    """Momentum and angular momentum about the origin of all bodies."""
    mass, inertia = scene.shell.mass, scene.shell.inertia
    linear = mass * snapshot.linear_velocity
    angular = np.cross(snapshot.position, linear) + inertia * snapshot.angular_velocity
    return linear.sum(axis=0), angular.sum(axis=0)


def crowd(seed=4, **changes):
    """27 bodies that are thrown at each other, with all kinds of contacts."""
    generator = np.random.default_rng(seed)
    places = 0.045 * np.array(
        [[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])
    turned = Rotation.random(27, random_state=generator)
    bodies = [
        (place, -6.0 * place + 0.1 * generator.standard_normal(3),
         10.0 * generator.standard_normal(3), turned[number])
        for number, place in enumerate(places) if place.any()]
    return loose(*bodies, solver__tolerance=1e-6, **changes)
