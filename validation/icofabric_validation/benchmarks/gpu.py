# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Steps on a GPU and on the processor: body-steps per second, and the difference of the motions.

Without a GPU the same kernels are measured on the processor, and the output says so. Properties of
kernels compiled for a GPU are counted in any case.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.simulation import compile_scene, Simulation
from icofabric_validation.benchmarks.scenes import scene_parameters
from icofabric_validation.benchmarks.step_speed import STEP
from icofabric_validation.benchmarks.timing import in_rounds, Spread, STEPS_BLOCK_S, timed
import numpy as np

Size = tuple[int, int, int]
# About 4,631, 49,726, 100,920, 1,000,188, 9,965,880 and 99,961,946 bodies.
SIZES: tuple[Size, ...] = (
    (21, 21, 21), (46, 46, 47), (58, 58, 60), (126, 126, 126), (271, 271, 271), (585, 585, 584))
# Steps after which motions are compared, and steps of a timed run: two health checks.
_COMPARED, _TIMED = 64, 128
# Compiled kernels: of a plain fabric, and of one with nearly all terms of a device.
PLAIN = 'springs'
ALL = 'springs with own laws, moments, supports, loads'
# Rates for the embedded pair.
DAMPED = 'damped springs, by dop8'
# Candidate pairs, for all scenes.
TOUCHING = 'shells that may touch'


class DeviceSize(NamedTuple):
    """Results of one number of bodies; lists have body-steps per second by round."""

    size: Size
    body_count: int
    processor: list[float]  # loops of Numba, with the best number of threads
    run: list[float]  # a run on the device, health checks included
    kernel: list[float]  # its kernel alone
    error: float  # after _COMPARED steps, position over a, between device and processor
    bytes_each: float  # that a step reads and writes per body

    def gain(self) -> Spread:
        """Rate of the device over that of the processor, round by round."""
        return Spread.of([one / other for one, other in zip(self.run, self.processor)])

    def bandwidth(self) -> float:
        """Bytes per second that the kernel reads and writes."""
        return Spread.of(self.kernel).median * self.bytes_each


class Gpu(NamedTuple):
    """Results of all sizes, and properties of kernels compiled for a GPU."""

    device: str
    is_gpu: bool
    rows: list[DeviceSize]
    compiled: dict[str, Any]  # CompiledKernel by the terms
    bytes_held: int  # per body on the device, at the largest size
    rounds: int
    missing: str  # reason for missing results; '': none


def measure(
    *, rounds: int = 5, largest: int = 101_000, choice: str = 'auto',
    say: Callable[[str], None] = lambda text: None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    sizes: tuple[Size, ...] = SIZES, kernels: tuple[str, ...] = (PLAIN, ALL, DAMPED, TOUCHING)
) -> Gpu:
    """Compare the motions, then time steps in rounds; `choice` is solver.device, or auto."""
    try:
        device, found = _device(choice)
    except ParameterError as problem:
        return Gpu('', False, [], {}, 0, rounds, str(problem))
    from icofabric_sim.simulation.devices.gpu.arrays import bytes_moved, bytes_of
    from icofabric_sim.simulation.devices.gpu.compiled import compiled_as, compiled_kernel
    from icofabric_sim.simulation.devices.gpu.contact import touch
    from icofabric_sim.simulation.devices.gpu.kernels import Terms
    from icofabric_sim.simulation.devices.gpu.slopes import Losses
    say('kernels for a GPU')
    plain = Terms(
        linked=True, midpoints=True, one_law=True, moments=False, dipole=False, held=False,
        loaded=False)
    losses = Losses(damped=True, dragged=False)
    full = plain._replace(one_law=False, moments=True, held=True, loaded=True)
    compiled = {
        name: compiled_as(touch) if name == TOUCHING else compiled_kernel(
            full if name == ALL else plain, losses if name == DAMPED else None)
        for name in kernels}
    rows, held = [], 0
    chosen = [size for size in sizes if size[0] * size[1] * size[2] / 2 <= 1.01 * largest]
    for size in chosen:
        say(f'{size[0]} x {size[1]} x {size[2]}: the same motion?')
        one, other = _start(size, 'cpu'), _start(size, device)
        for simulation in (one, other):
            simulation.advance_steps(_COMPARED)
        error = float(np.abs(
            one.snapshot().position - other.snapshot().position).max())
        error /= one.scene.geometry.half_edge
        count = one.scene.body_count
        steps: Any = other._driver.trajectory.executor
        layout, model = other.packed.layout, other.packed.model
        tasks = [
            partial(_rate, count, partial(one.advance_steps, _TIMED)),
            partial(_rate, count, partial(other.advance_steps, _TIMED)),
            partial(_rate, count, partial(steps.bare_steps, _TIMED))]
        for task in tasks:
            task()
        processor, run, bare = in_rounds(tasks, rounds, progress)
        held = bytes_of(model, layout) // count
        rows.append(DeviceSize(
            size, count, processor, run, bare, error, bytes_moved(model, layout)))
    return Gpu(found, device == 'cuda', rows, compiled, held, rounds, '')


def _device(choice: str) -> tuple[str, str]:
    """Return a value of solver.device, and the name of the device; ParameterError without Warp."""
    from icofabric_sim.simulation.devices.gpu.opening import open_device, warp
    if choice == 'auto':
        choice = 'cuda' if warp().is_cuda_available() else 'warp_cpu'
    return choice, open_device(choice).name


def _start(size: Size, device: str) -> Simulation:
    return compile_scene(Scene.from_parameters({
        **scene_parameters(size), 'solver.method': 'leapfrog', 'solver.step': STEP,
        'solver.device': device}))


def _rate(count: int, run: Callable[[], object]) -> float:
    """Return body-steps per second."""
    return count * _TIMED / timed(lambda: None, run, block=STEPS_BLOCK_S)
