# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The equations of motion of a scene (eq 45) as a function, for external integrators."""

from collections.abc import Callable

from icofabric_sim.kernels.rhs import rates_of_rows
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.model.packing import pack_loads, pack_scene
import numpy as np

Rates = Callable[[float, np.ndarray], np.ndarray]


def compile_rates(scene: Scene) -> Rates:
    """
    Compile dy/dt = f(t, y) of a scene without loads, with the kernels of `compile_scene`.

    y (13 n,) holds for each body position [m], quaternion x y z w, velocity [m/s] and spin
    [rad/s], world frame. Each call returns a new array.
    """
    packed = pack_scene(scene)
    if packed.model.maxwell is not None:
        raise ValueError(
            'the state of Maxwell arms has no place in y: compile_rates takes scenes with '
            'connector.maxwell_stiffness 0')
    model, layout = packed.model, packed.layout
    state = layout.pack(scene.initial)
    work = layout.room(model.links, damped=model.damping is not None)
    slope = np.zeros((13, layout.slot_count))
    loads = pack_loads((), layout, stages=1)

    def rates(time: float, y: np.ndarray) -> np.ndarray:
        if y.shape != (13 * layout.body_count,):
            raise ValueError(
                f'y must have the shape ({13 * layout.body_count},), 13 numbers for each of '
                f'{layout.body_count} bodies, got {y.shape}')
        result = np.empty_like(y)
        rates_of_rows(model, loads, state, work, slope, layout.slot, y, result)
        return result

    return rates
