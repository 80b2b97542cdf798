# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A runner without ROS: a sink that keeps messages, and a run in a thread of its own."""
import threading
import time

import icofabric_sim as ico
from icofabric_sim.messages import WrenchStampedBytes
from icofabric_sim.messages.frames import body_frame
from icofabric_sim.messages.input_topics import input_type, InputMessage, topic_of
from icofabric_sim.running.runner import Runner
from icofabric_sim.simulation.inputs.input_types import BodyTarget, ChannelTarget, Wrench
import numpy as np

SCENE = {
    'weave': {'size': [2, 2, 2]},
    'connector': {'stiffness': 200.0},
    'contact': {'mode': 'never'},
    'groups': {'tip': 'ids 1'},
    'loads': {'tip': {'group': 'tip'}},
    'real_time_factor': 0.0,
    'duration': 0.1,
}
FORCE = np.array([0.0, 0.0, 0.05])


class ListSink:
    """Keeps what it is sent; wants the given topics only."""

    is_bag = False

    def __init__(self, *topics, bag=False):
        self.topics, self.is_bag = topics, bag
        self.messages, self.jumps = [], []

    def wants(self, topic):
        return topic in self.topics

    def send(self, topic, nanoseconds, data):
        assert topic in self.topics and type(data) is bytes
        self.messages.append((topic, nanoseconds, data))

    def send_input(self, topic, type_name, nanoseconds, data):
        assert type_name == input_type(topic)
        self.messages.append((topic, nanoseconds, data))

    def time_jumped_back(self, simulation, parameters, ended):
        self.jumps.append((simulation, parameters, ended))

    def of(self, topic):
        return [(time, data) for kind, time, data in self.messages if kind == topic]


def make_runner(*sinks, **changes):
    dotted = {name.replace('__', '.'): value for name, value in changes.items()}
    scene = ico.Scene.from_parameters(SCENE)
    scene = ico.Scene.from_parameters(scene.parameters.with_changes(dotted))
    return Runner(ico.compile_scene(scene), list(sinks))


def push(runner, key='tip', *, stamp=0, force=FORCE, judged=True):
    """Send a wrench on a channel or a body; where not `judged` it may be too large to follow."""
    target = BodyTarget(key) if isinstance(key, int) else ChannelTarget(key)
    frame = body_frame(key) if isinstance(key, int) else ''
    message = WrenchStampedBytes(frame)
    message.force[:] = force
    data = message.stamped(max(stamp, 0))
    if judged:
        runner.inputs.receive(topic_of(target), data)
        return
    received = InputMessage(target, Wrench(np.array(force), np.zeros(3)), stamp, frame)
    runner.post(lambda: runner.inputs.act(received, data))


def run(runner):
    """To the end of its duration, as fast as possible."""
    runner.run(until_finished=True)
    return runner


class Beside:
    """A runner in a thread of its own, as in the node."""

    def __init__(self, runner):
        self.runner = runner
        self.thread = threading.Thread(target=runner.run, daemon=True)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, kind, error, traceback):
        self.runner.stop()
        self.thread.join(60.0)
        assert not self.thread.is_alive()

    def wait_for(self, condition):
        deadline = time.monotonic() + 60.0
        while not condition():
            assert time.monotonic() < deadline
            time.sleep(0.002)
