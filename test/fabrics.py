# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes that several tests use."""

from typing import NamedTuple

import icofabric_sim as ico
from icofabric_sim.kernels.flows import keep_accelerations, place_all
from icofabric_sim.kernels.loads import kick_row, NONE
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.simulation.inputs.inputs import Inputs
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.simulation.model.snapshot import Snapshot
import numpy as np
import pytest

FORMS = ('quaternion', 'direction_cosines')
# Both, of which `make test` leaves the second to `make test-long`.
BOTH_FORMS = (FORMS[0], pytest.param(FORMS[1], marks=pytest.mark.long))
STATE = ('position', 'orientation', 'linear_velocity', 'angular_velocity')


def make_scene(size=(2, 2, 2), changes=None, **sections):
    """
    Fabric of `size` from nested `sections`, with dotted `changes` on top.

    Shells pass through each other unless it says otherwise: most tests are of other forces.
    """
    scene = ico.Scene.from_parameters(
        {'weave': {'size': list(size)}, 'contact': {'mode': 'never'}, **sections})
    return changed(scene, changes) if changes else scene


def changed(scene, changes):
    """The same scene with other parameters (dotted names)."""
    return ico.Scene.from_parameters(scene.parameters.with_changes(changes))


# Velocities of a random start that stretch the connectors by a few per cent, and spins that turn
# the bodies by a good part of a radian in one period of the fastest motion.
RANDOM = {'initial_random': {'velocity_sigma': 0.5, 'spin_sigma': 60.0, 'seed': 1}}

SUPPORTED = {
    'gravity': [1.0, -2.0, -9.81],
    'groups': {'top': 'z_max', 'corner': 'ids 0', 'rail': 'ids 1'},
    'supports': {
        'ceiling': {'group': 'top'},
        'slide': {'group': 'corner', 'fix': 'tx tz'},
        'clamp': {'group': 'rail', 'fix': 'rotation'},
    },
}

# A follower wrench with its force off centre on one body, a shared one in world axes on two.
LOADED = {
    'groups': {'tip': 'ids 1', 'others': 'ids 0 2'},
    'loads': {
        'follower': {
            'group': 'tip',
            'frame': 'body',
            'point': [0.004, -0.007, 0.011],
            'force': [1.5, -0.7, 2.0],
            'torque': [0.004, 0.01, -0.006],
        },
        'steady': {
            'group': 'others',
            'share': 'total',
            'point': [0.0, 0.016, -0.003],
            'force': [-2.0, 0.4, 1.0],
            'torque': [0.0, -0.008, 0.002],
        },
    },
}


def pair_face_to_face(scene, distance):
    """
    Positions and orientations of a 2x2x1 slab with its connector on the line of the centres.

    Along world x, `distance` [m] from centre to centre.
    """
    arms = scene.connectors.points_body[0]
    orientation = []
    for arm, target in zip(arms, (np.array([1.0, 0, 0]), np.array([-1.0, 0, 0]))):
        unit = arm / np.linalg.norm(arm)
        # Half-way quaternion; no arm is opposite to its target here.
        quaternion = np.append(np.cross(unit, target), 1.0 + unit @ target)
        orientation.append(quaternion / np.linalg.norm(quaternion))
    return np.array([[-0.5 * distance, 0, 0], [0.5 * distance, 0, 0]]), np.array(orientation)


def stretched(scene, factor):
    """Rest positions (n, 3), pulled to `factor` times their distance along x."""
    return scene.position * np.array([factor, 1.0, 1.0])


class Wrenches(NamedTuple):
    """What acts on the bodies, bodies first."""

    force: np.ndarray  # (n, 3) [N]
    torque: np.ndarray  # (n, 3) about each centre [N m], world frame


def packed_state(packed, position, orientation, linear_velocity=None, angular_velocity=None):
    """State for kernels from arrays of bodies; at rest by default."""
    rest = np.zeros_like(position)
    return packed.layout.pack(InitialState(
        position, orientation,
        rest if linear_velocity is None else linear_velocity,
        rest if angular_velocity is None else angular_velocity))


def snapshot_of(scene, position, orientation, packed=None):
    """Snapshot of a fabric at rest, without a simulation: no kernels of steps are compiled."""
    rest = np.zeros_like(position)
    ledger = {'work_in': 0.0, 'start': 0.0, 'spent': 0.0, 'potential': 0.0}
    return Snapshot(
        0.0, position, orientation, rest, rest, scene.connector_count,
        packed or pack_scene(scene), ledger)


def wrenches(scene, position, orientation, *, cosines=False, loaded=False, packed=None):
    """
    Forces and torques of the connectors by the production kernels; `loaded`: and of the loads.

    `packed`: the scene, packed before. Without gravity and supports: those are accelerations, or
    take them away.
    """
    packed = pack_scene(scene, cosines=cosines) if packed is None else packed
    layout, model = packed.layout, packed.model._replace(gravity=None, supports=None)
    state, work = packed_state(packed, position, orientation), layout.room(model.links)
    last = len(model.blocks.slot)
    place_all(model, state, work, 0, last)
    keep_accelerations(model, state, work, 0.0, 0, last)
    if loaded:
        # From rest, in one second, velocities are accelerations.
        loads = Inputs(scene).pack(layout)
        for block in range(last):
            for row in range(loads.start[block], loads.start[block + 1]):
                kick_row(
                    model, loads, state, row, int(model.blocks.slot[block]), 0.0, 1.0, NONE, 1.0)
    acceleration = layout.gather(work.acceleration)
    return Wrenches(
        scene.shell.mass * (acceleration[:, :3] + layout.gather(state.linear_velocity)),
        scene.shell.inertia * (acceleration[:, 3:] + layout.gather(state.angular_velocity)))


def loaded_fabric(changes=None):
    """Fabric in random motion with two load channels, `tip` and `two`."""
    return make_scene(
        (3, 2, 2),
        {
            'groups.tip': 'x_max',
            'groups.two': 'ids 0 3',
            'contact.mode': 'never',
            'loads.tip.group': 'tip',
            'loads.tip.share': 'total',
            'loads.two.group': 'two',
            'loads.two.frame': 'body',
            'loads.two.point': [0.0, 0.01, -0.004],
            **(changes or {}),
        },
        **RANDOM,
    )


def same_state(one, other):
    """Whether two snapshots have the same bits."""
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in STATE)


def warnings_said(caplog):
    """
    Messages of the log, but for those on connectors in their own shells: floppy fabrics have them.
    """
    said = [record.getMessage() for record in caplog.records]
    return [message for message in said if 'enters the shell' not in message]
