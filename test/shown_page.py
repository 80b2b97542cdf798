# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A run in this process with the page of the viewer."""

import icofabric_sim as ico
from icofabric_sim.running.runner import Runner
from icofabric_sim.viewer.local import RunActions, SightSink
from icofabric_sim.viewer.page import Page
from icofabric_sim.viewer.sight import Sight
from runner_helpers import Beside, ListSink, SCENE


class Shown:
    """A run with its page, at an address of its own."""

    def __init__(self, *, read_only=False, **changes):
        scene = ico.Scene.from_parameters({
            **SCENE, 'duration': 0.0, 'real_time_factor': 1.0, **changes})
        simulation = ico.compile_scene(scene)
        simulation.warm_up()
        self.sight, self.inputs = Sight(), ListSink()
        self.runner = Runner(simulation, [self.inputs, SightSink(self.sight, is_run=True)])
        self.page = Page(
            self.sight, None if read_only else RunActions(self.runner), port=18080, rate=60.0)
        self.port = self.page.server.get_port()
        self.beside = Beside(self.runner)

    def __enter__(self):
        self.beside.__enter__()
        return self

    def __exit__(self, *words):
        self.page.close()
        self.beside.__exit__(*words)

    def position(self, body):
        return self.runner.post(
            lambda: self.runner.simulation.snapshot().position[body].copy()).result(60.0)
