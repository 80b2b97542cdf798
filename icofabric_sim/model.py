# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Packs a scene into the constants that kernels take.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from icofabric_sim.kernels.records import Connectors, Loads, Model
from icofabric_sim.kernels.records import Supports as PackedSupports
from icofabric_sim.layout import Layout, make_layout, make_links
from icofabric_sim.scene import Scene
import numpy as np


@dataclass(frozen=True)
class PackedScene:
    """
    A scene as arrays: for the kernels of motion, and connector by connector.
    """

    model: Model
    layout: Layout
    connectors: Connectors | None


def pack_scene(scene: Scene, *, cosines: bool = False) -> PackedScene:
    """
    Constants of the scene; a term that the scene lacks is None.
    """
    mass, inertia = scene.shell.mass, scene.shell.inertia
    gravity = np.array(scene.parameters['gravity'])
    grid = scene.weave.grid
    layout = make_layout(grid, scene.body_count, cosines=cosines)
    connectors = links = supports = None
    if scene.connector_count:
        bodies, edges = scene.connectors.bodies, scene.connectors.edges
        law = {
            'stiffness': scene.connectors.stiffness,
            'natural_length': scene.connectors.natural_length,
            'half_width': 0.5 * scene.geometry.cube_width,
        }
        connectors = Connectors(bodies[:, 0], bodies[:, 1], edges[:, 0], edges[:, 1], **law)
        layout, links = make_links(layout, grid, bodies, edges, **law)
    if scene.supports is not None:
        supports = PackedSupports(
            layout.spread(np.where(scene.supports.translation, 0.0, 1.0 / mass)),
            layout.spread(np.where(scene.supports.rotation, 0.0, 1.0 / inertia)[:, None]),
        )
    model = Model(
        inverse_mass=1.0 / mass,
        inverse_inertia=1.0 / inertia,
        gravity=gravity if gravity.any() else None,
        blocks=layout.blocks,
        links=links,
        supports=supports,
    )
    return PackedScene(model, layout, connectors)


def pack_loads(
    rows: Iterable[tuple[np.ndarray, bool, np.ndarray, np.ndarray, np.ndarray]],
    layout: Layout,
    *,
    stages: int = 0,
) -> Loads:
    """
    One row for each body of each (bodies, in body axes, force, torque, point).

    In the order of the blocks; those of one block in the order given. `stages`: slopes of a
    Runge-Kutta step.
    """
    parts = list(rows)
    counts = [len(part[0]) for part in parts]

    def spread(column: int) -> np.ndarray:
        if not parts:
            return np.zeros((0, 3))
        return np.repeat(np.array([part[column] for part in parts], dtype=float), counts, axis=0)

    bodies = np.concatenate([np.zeros(0, np.int32), *(part[0] for part in parts)]).astype(np.int32)
    block = layout.block_of(bodies)
    order = np.argsort(block, kind='stable')
    start = np.zeros(len(layout.blocks.slot) + 1, np.int32)
    np.cumsum(np.bincount(block, minlength=len(layout.blocks.slot)), out=start[1:])
    in_body_axes = np.repeat(np.array([part[1] for part in parts], dtype=bool), counts)
    return Loads(
        start=start,
        slot=layout.slot[bodies][order],
        in_body_axes=in_body_axes[order],
        force=spread(2)[order],
        torque=spread(3)[order],
        point=spread(4)[order],
        work=np.zeros(len(bodies)),
        earlier_work=np.zeros(len(bodies)),
        power=np.zeros((stages, len(bodies))),
    )


def load_rate(loads: Loads | None, model: Model, size: float) -> float:
    """
    Rate [rad/s] at which the loads alone would move a free body by `size` [m], or turn it.

    Infinite where the loads are too large for numbers.
    """
    if loads is None or not len(loads.slot):
        return 0.0
    with np.errstate(over='ignore', invalid='ignore'):
        force = np.linalg.norm(loads.force, axis=1)
        moment = np.linalg.norm(loads.torque, axis=1)
        moment += np.linalg.norm(loads.point, axis=1) * force
        square = force * (model.inverse_mass / size) + moment * model.inverse_inertia
        largest = np.bincount(loads.slot, square).max()
    return float(np.sqrt(largest)) if largest < np.inf else np.inf


def expected_liveliness(
    scene: Scene, model: Model, loads: Loads | None, frequency: float
) -> float:
    """
    Speeds over a, or spins [1/s], that a run will reach: from its start, its loads, its weight.

    Loads and weight accelerate until the fabric answers, which takes as many radians of its
    fastest vibration as it has bodies in a row, or until the run ends.
    """
    initial, half_edge = scene.initial, scene.geometry.half_edge
    speed = float(np.sqrt((initial.linear_velocity**2).sum(axis=1).max())) / half_edge
    spin = float(np.sqrt((initial.angular_velocity**2).sum(axis=1).max()))
    duration = scene.parameters['duration'] or np.inf
    answer = float(np.ptp(scene.weave.grid, axis=0).max() + 1) if len(scene.weave.grid) else 1.0
    if frequency > 0.0:
        duration = min(duration, answer / frequency)
    rate = load_rate(loads, model, half_edge)
    acceleration = rate * rate if rate < 1e150 else 0.0
    if model.gravity is not None and model.supports is not None:
        acceleration += float(np.linalg.norm(model.gravity)) / half_edge
    growth = acceleration * duration if duration < np.inf else 0.0
    # A displaced start lets go of energy within a period.
    displaced = np.abs(initial.position - scene.position).max() / half_edge * frequency
    return max(speed, spin, growth, float(min(displaced, frequency)))
