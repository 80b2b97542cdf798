# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""A heap of shells at rest: the floor bears its weight, and nothing creeps."""

from collections.abc import Iterator

from icofabric_sim.simulation.simulation import compile_scene
from icofabric_sim.studies.named.crowds import crowd
from icofabric_sim.studies.named.loose_bodies import A, GRAVITY
from icofabric_sim.studies.named.problem import Curve, Point, PremiseError, Problem
import numpy as np

_SETTLED = 1e-9  # kinetic energy of a body at rest, over its weight times a
_LONGEST = 20.0  # until then it has come to rest [s]


def _solve(long: bool) -> Iterator[Curve]:
    size, hold = ((3, 3, 6), 10.0) if long else ((3, 3, 2), 1.0)
    scene = crowd(size, walls=False, parameters={
        'initial_random.velocity_sigma': 0.02, 'initial_random.spin_sigma': 2.0,
        'contact.stiffness': 1e5, 'contact.damping': 20.0, 'contact.friction': 0.6,
        'solver.method': 'leapfrog', 'solver.tolerance': 0.1})
    simulation = compile_scene(scene)
    weight = scene.shell.mass * GRAVITY
    calm = 0
    while calm < 3:
        simulation.advance_to(simulation.time + 0.1)
        kinetic = simulation.snapshot().energy['kinetic'] / scene.body_count
        calm = calm + 1 if kinetic < _SETTLED * weight * A else 0
        if simulation.time > _LONGEST:
            raise PremiseError(
                f'after {_LONGEST:g} s the heap still moves: {kinetic:.3g} J a body')
    before, borne = simulation.snapshot(), []
    began = simulation.time
    for time in began + hold * np.arange(1, 11) / 10.0:
        simulation.advance_to(float(time))
        touching = simulation.status.touching()
        borne.append(float(touching.force[touching.bodies[:, 1] < 0, 2].sum()))
    way = np.abs(simulation.snapshot().position - before.position).max() / A
    steps = simulation.status.step_count
    error = np.abs(np.array(borne) / (weight * scene.body_count) - 1.0).max()
    of = f'leapfrog, {scene.body_count} shells'
    yield Curve(f'{of}: floor force', 'rest from [s]', (Point(began, float(error), steps),), 1e-6,
                is_refined=False)
    yield Curve(f'{of}: way over a', 'held for [s]', (Point(hold, float(way), steps),), 1e-5,
                is_refined=False)


PROBLEM = Problem(
    'heap', 'a heap of shells at rest on a floor', 'statics: forces add up to the weight',
    'floor force against the weight, relative; way of a body over a', _solve, has_long_form=True)
