# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A grid of shells falls on a floor: overlaps with damping, energy without."""

from collections.abc import Iterator
from typing import Any

from icofabric_sim.simulation.simulation import compile_scene
from icofabric_validation.named.crowds import crowd
from icofabric_validation.named.loose_bodies import A, contact_time
from icofabric_validation.named.problem import Curve, Point, Problem

_START: dict[str, Any] = {
    'initial_random.velocity_sigma': 0.05, 'initial_random.spin_sigma': 5.0}


def _overlaps(long: bool) -> Iterator[Curve]:
    """Yield the reported largest overlap, which falls with the contact stiffness."""
    size, end = ((6, 6, 12), 0.5) if long else ((3, 3, 6), 0.2)
    points = []
    for stiffness in (1e5, 1e6, 1e7):
        scene = crowd(size, within='floor', parameters={
            **_START, 'contact.stiffness': stiffness, 'contact.damping': 2.0,
            'contact.friction': 0.4, 'solver.tolerance': 0.1})
        simulation = compile_scene(scene)
        simulation.advance_to(end)
        status = simulation.status
        points.append(Point(
            contact_time(scene.shell.mass, stiffness), status.deepest_overlap / A,
            status.step_count))
        method = status.method_name
    yield Curve(f'{method}, {scene.body_count} shells', 'contact time [s]', tuple(points), 1e-2,
                order=1.0)


def _energy(long: bool) -> Iterator[Curve]:
    """Yield the energy error without dissipation, which falls with the tolerance."""
    size, end = ((6, 6, 12), 0.3) if long else ((3, 3, 6), 0.15)
    points = []
    for tolerance in (1e-2, 1e-4, 1e-6, 1e-8):
        scene = crowd(size, within='floor', parameters={
            **_START, 'contact.stiffness': 1e6, 'solver.method': 'dop8',
            'solver.tolerance': tolerance})
        simulation = compile_scene(scene)
        simulation.advance_to(end)
        energy = simulation.snapshot().energy
        points.append(Point(
            tolerance, abs(energy['balance_error']) / energy['kinetic'],
            simulation.status.step_count))
    yield Curve(f'dop8, {scene.body_count} shells', 'tolerance [1/s]', tuple(points), 1e-8,
                floor=1e-13)


FALLING = Problem(
    'grid_666', 'a grid of shells falls on a floor, with friction and damping',
    'SimBenchmark (Kang and Hwangbo 2018), 666', 'largest overlap over a', _overlaps,
    has_long_form=True)
ELASTIC = Problem(
    'elastic_666', 'a grid of shells falls on a floor without dissipation',
    'SimBenchmark (Kang and Hwangbo 2018), elastic 666',
    'error of the energy over the kinetic energy', _energy, has_long_form=True)
