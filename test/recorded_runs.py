# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Small recorded runs for tests of what reads them."""

from pathlib import Path
from typing import Any, NamedTuple

from icofabric_sim.messages import WrenchStampedBytes
from icofabric_sim.running.recording import BagSink, summarise_run
from icofabric_sim.running.runner import Runner
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.simulation import compile_scene

PUSH_START, PUSH_END = 100_000_000, 200_000_000  # [ns]
FORCE = (0.0, 0.75, 0.0)  # [N]
DURATION = 0.3  # [s]
# A slab whose top can be taken over by a twist.
DRIVEN_SCENE = {
    'weave': {'size': [2, 2, 2]},
    'contact': {'mode': 'never'},
    'gravity': [0.0, 0.0, -9.81],
    'groups': {'top': 'z_max'},
    'drives': {'top': {'group': 'top'}},
    'solver': {'method': 'srkn4'},
}


def swing_scene(**changes: Any) -> Scene:
    """A slab that falls from the side at which it is held."""
    return Scene.from_parameters({
        'weave.size': [3, 3, 3],
        'weave.connector_angle': 0.3,
        'gravity': [0.0, 0.0, -9.81],
        'groups.wall': 'x_min',
        'groups.tip': 'x_max',
        'supports.wall.group': 'wall',
        'loads.tip.group': 'tip',
        'loads.tip.share': 'total',
        'real_time_factor': 0.0,
        'duration': DURATION,
        **changes,
    })


class Sent(NamedTuple):
    """A message on an input topic."""

    topic: str
    data: bytes


def wrench(topic: str, stamp: int, force: Any, frame: str = '') -> Sent:
    message = WrenchStampedBytes(frame)
    message.force[:] = force
    message.torque[:] = 0.0
    return Sent(topic, message.stamped(stamp))


def record_run(path: Path, scene: Scene, *inputs: Sent, **summary: str) -> None:
    """Simulate a scene with inputs and record it."""
    simulation = compile_scene(scene)
    bag = BagSink(path, simulation, live=False, storage='mcap')
    runner = Runner(simulation, [bag])
    for topic, data in inputs:
        runner.inputs.receive(topic, data)
    runner.run(until_finished=True)
    assert not runner.failure
    bag.close(summary={**summarise_run(runner.status()), **summary})


def record_push(path: Path, scene: Scene) -> None:
    """Simulate a scene whose tip is pushed for a while."""
    record_run(
        path, scene,
        wrench('~/loads/tip', PUSH_START, FORCE),
        wrench('~/wrench', PUSH_START, (0.1, 0.0, 0.0), 'icosahedron_3'),
        wrench('~/loads/tip', PUSH_END, (0.0, 0.0, 0.0)))
