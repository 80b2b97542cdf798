# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""A runner without ROS: a sink that keeps messages, and a run in a thread of its own."""
import threading
import time

import icofabric_sim as ico
from icofabric_sim.messages import WrenchStampedBytes
from icofabric_sim.running.run_records import WrenchInput
from icofabric_sim.running.runner import Runner
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
        assert type_name == WrenchStampedBytes.TYPE
        self.messages.append((topic, nanoseconds, data))

    def time_jumped_back(self, simulation, parameters, ended):
        self.jumps.append((simulation, parameters, ended))

    def of(self, topic):
        return [(time, data) for kind, time, data in self.messages if kind == topic]


def make_runner(*sinks, **changes):
    dotted = {name.replace('__', '.'): value for name, value in changes.items()}
    scene = ico.Scene.from_parameters(SCENE)
    scene = ico.Scene.from_parameters(scene.parameters.with_changes(dotted))
    return Runner(ico.compile_scene(scene, body_wrenches=True), list(sinks))


def push(runner, key='tip', *, stamp=0, force=FORCE, topic='/loads/tip'):
    data = WrenchStampedBytes('')
    data.force[:] = force
    runner.receive(WrenchInput(topic, key, stamp, np.array(force), np.zeros(3),
                               data.stamped(max(stamp, 0))))


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
