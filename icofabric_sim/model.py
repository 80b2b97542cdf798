# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Packs a scene into the constants that kernels take.
"""

from collections.abc import Iterable

from icofabric_sim.kernels.records import Adjacency, Connectors, Loads, Model, Supports
from icofabric_sim.scene import Scene
import numpy as np


def pack_model(scene: Scene) -> Model:
    """
    Constants of the scene; a term that the scene lacks is None.
    """
    mass, inertia = scene.shell.mass, scene.shell.inertia
    gravity = np.array(scene.parameters['gravity'])
    supports = None
    if scene.supports is not None:
        supports = Supports(
            np.where(scene.supports.translation, 0.0, 1.0 / mass),
            np.where(scene.supports.rotation, 0.0, 1.0 / inertia),
        )
    connectors = adjacency = None
    if scene.connector_count:
        bodies, edges = scene.connectors.bodies, scene.connectors.edges
        connectors = Connectors(
            first=np.ascontiguousarray(bodies[:, 0]),
            second=np.ascontiguousarray(bodies[:, 1]),
            first_edge=np.ascontiguousarray(edges[:, 0]),
            second_edge=np.ascontiguousarray(edges[:, 1]),
            stiffness=scene.connectors.stiffness,
            natural_length=scene.connectors.natural_length,
            half_width=0.5 * scene.geometry.cube_width,
        )
        adjacency = pack_adjacency(bodies, scene.body_count)
    return Model(
        inverse_mass=1.0 / mass,
        inverse_inertia=1.0 / inertia,
        gravity=gravity if gravity.any() else None,
        connectors=connectors,
        adjacency=adjacency,
        supports=supports,
    )


def pack_adjacency(bodies: np.ndarray, body_count: int) -> Adjacency:
    """
    Connectors of each body in ascending order, from the pairs (c, 2).
    """
    ends = bodies.ravel()
    order = np.argsort(ends, kind='stable')
    start = np.zeros(body_count + 1, dtype=np.int32)
    np.cumsum(np.bincount(ends, minlength=body_count), out=start[1:])
    return Adjacency(start, (order // 2).astype(np.int32))


def pack_loads(
    rows: Iterable[tuple[np.ndarray, bool, np.ndarray, np.ndarray, np.ndarray]],
) -> Loads:
    """
    One row for each body of each (bodies, in body axes, force, torque, point), in the order given.
    """
    parts = list(rows)
    counts = [len(part[0]) for part in parts]

    def spread(column: int) -> np.ndarray:
        if not parts:
            return np.zeros((0, 3))
        return np.repeat(np.array([part[column] for part in parts], dtype=float), counts, axis=0)

    return Loads(
        body=np.concatenate([np.zeros(0, np.int32), *(part[0] for part in parts)]).astype(
            np.int32
        ),
        in_body_axes=np.repeat(np.array([part[1] for part in parts], dtype=bool), counts),
        force=spread(2),
        torque=spread(3),
        point=spread(4),
    )


def load_rate(loads: Loads | None, model: Model, size: float) -> float:
    """
    Rate [rad/s] at which the loads alone would move a free body by `size` [m], or turn it.

    Infinite where the loads are too large for numbers.
    """
    if loads is None or not len(loads.body):
        return 0.0
    with np.errstate(over='ignore', invalid='ignore'):
        force = np.linalg.norm(loads.force, axis=1)
        moment = np.linalg.norm(loads.torque, axis=1)
        moment += np.linalg.norm(loads.point, axis=1) * force
        square = force * (model.inverse_mass / size) + moment * model.inverse_inertia
        largest = np.bincount(loads.body, square).max()
    return float(np.sqrt(largest)) if largest < np.inf else np.inf
