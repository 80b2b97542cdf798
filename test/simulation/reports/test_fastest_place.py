# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Diagnostics name the connector, the pair or the body whose motion limits the step."""

import re

import icofabric_sim as ico
from icofabric_sim.process.compile_notice import KernelsMissing
from icofabric_sim.running import step_limit_reason
from icofabric_sim.running.step_limit_reason import StepLimit
import numpy as np


def test_the_connector_of_the_body_that_vibrates_fastest_is_named():
    scene = ico.load_scene('hanging_slab')
    simulation = ico.compile_scene(scene)
    found = re.fullmatch(
        r'mostly that of body (\d+), at connector (\d+) between bodies (\d+) and (\d+)',
        simulation.status.fastest_place())
    body, connector, first, second = map(int, found.groups())
    assert body in (first, second)
    connectors = simulation.packed.connectors
    assert (connectors.first[connector], connectors.second[connector]) == (first, second)
    assert body in simulation._driver.rates.fastest_bodies()


def test_a_body_that_spins_and_a_pair_that_touches_are_named():
    simulation = ico.compile_scene(ico.load_scene('hanging_slab'))
    spin = np.zeros((56, 3))
    spin[50] = 0.0, 0.0, 4e3
    simulation.set_state(angular_velocity=spin)
    assert simulation.status.fastest_place() == 'body 50 spins fastest'
    simulation = ico.compile_scene(ico.load_scene('dropped_slab'))
    simulation.advance_to(0.2)
    while not len(simulation.status.touching().overlap):
        assert simulation.time < 0.22
        simulation.advance_to(simulation.time + 0.0005)
    assert 'contacts' in simulation.status.fastest_term
    touching = simulation._driver.contact.phase.touching(
        simulation._driver.trajectory.state)
    if len(touching.overlap):
        deepest = touching.describe(int(np.argmax(touching.overlap)))
        assert simulation.status.fastest_place().startswith(f'deepest: {deepest}, by ')
    else:
        assert simulation.status.fastest_place() == 'no pair in contact now'


class Fake:
    """Stands for a simulation whose fastest place the test sets."""

    def __init__(self, simulation):
        self.scene, self.status, self.place = simulation.scene, self, ''
        self._status = simulation.status

    def __getattr__(self, name):
        return getattr(self._status, name)

    def fastest_place(self):
        if not self.place:
            raise KernelsMissing
        return self.place


def test_it_is_said_since_when_it_is_that_place(monkeypatch):
    monkeypatch.setattr(step_limit_reason, '_MAX_SEARCH_SHARE', 0.0)
    simulation = Fake(ico.compile_scene(ico.load_scene('hanging_slab')))
    limit = StepLimit()
    # Kernels that are not there yet are not waited for.
    assert limit.describe(simulation, 0).endswith('; since t = 0 s')
    for now, place, since in (
            (1, 'deepest: body 1 and body 2, by 1e-05 m', 1),
            (2, 'deepest: body 1 and body 2, by 3e-05 m', 1),
            (3, 'deepest: body 1 and plane floor, by 1e-05 m', 3),
            (4, 'deepest: body 1 and plane floor, by 2e-05 m', 3),
            (2, 'deepest: body 1 and plane floor, by 2e-05 m', 2)):
        simulation.place = place
        said = limit.describe(simulation, now * 10**9)
        assert said.endswith(f's; {place}, since t = {since} s'), said


def test_a_look_that_takes_long_is_taken_rarely(monkeypatch):
    simulation = Fake(ico.compile_scene(ico.load_scene('hanging_slab')))
    simulation.place = 'body 1'
    limit = StepLimit()
    assert 'body 1, since' in limit.describe(simulation, 0)
    limit._looked = float('inf')
    simulation.place = 'body 2'
    assert 'body 1, since' in limit.describe(simulation, 1)
