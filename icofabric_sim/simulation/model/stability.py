# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The largest frequency of a fabric in a configuration: the step of an explicit method follows it.
"""

from dataclasses import replace
import math
from typing import NamedTuple

from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.frequency_bound import field_bound, frequency_bound
from icofabric_sim.kernels.hessian import hessian_times
from icofabric_sim.kernels.records import Loads, Model, State
from icofabric_sim.kernels.wrap.forces import largest_wrapping_bound
from icofabric_sim.simulation.model.anchor_stiffness import anchors_eigenvalue
from icofabric_sim.simulation.model.lanczos import (
    find_largest,
    Iteration,
    Lanczos,
    Largest,
    start_vector,
)
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.model.shared_kinds import BESIDE_CONNECTORS, without
import numpy as np

# Relative accuracy of the squared frequency at which the Lanczos iteration stops. A slightly
# larger one that the start hardly contains may hide within the residual: at 1e-3 the frequency
# came out up to 0.6 % low in turned fabrics, at 1e-4 at most 0.01 %. The top of the spectrum of a
# large fabric is dense and takes hundreds of iterations to resolve, where a few give it at most
# 1.5 % too high.
ACCURACY = 1e-4
_LARGE_ACCURACY = 0.03
_SMALL = 2_000  # bodies
LARGEST_ITERATION_COUNT = 300
# Iterations between two tests of convergence: a test costs as much as several iterations
# of a small fabric, and a large one needs few.
_ITERATIONS = 8
_LARGE_ITERATIONS = 2


class Frequency(NamedTuple):
    """The largest frequency and where it lives."""

    rate: float  # [rad/s]
    bodies: tuple[int, ...]  # bodies that take the largest part in it, at most four
    iterations: int


def largest_frequency(
    packed: PackedScene, state: State, *, locate: bool = False
) -> Frequency:
    """
    Largest frequency [rad/s] of small motions about a configuration, supports respected.

    The largest eigenvalue of M^-1/2 H M^-1/2 by the Lanczos iteration (lanczos.py, which modes
    use too), H the Hessian of the connector energy (kernels/hessian.py), M the masses and
    inertias. `locate` also finds the bodies. What electric fields, lying around shells and Maxwell
    arms add is bounded: the largest eigenvalue of a sum is at most the sum of the largest.
    """
    model, layout = packed.model, packed.layout
    start = start_vector(layout, model.supports)
    if not start.any():
        return Frequency(0.0, (), 0)
    more = 0.0
    if model.dipole is not None or model.coulomb is not None:
        more = field_bound(model, state)
    if model.maxwell is not None:
        more += _arms_eigenvalue(packed, state)
    if not is_springy(model):
        return Frequency(math.sqrt(more), (), 0)
    count = layout.body_count
    work = layout.room(model.links)
    springs, poses = without(model, *BESIDE_CONNECTORS), without(state, 'rest')
    place_all(springs, poses, work, 0, len(layout.blocks.slot))
    if model.wrapping is not None:
        more += largest_wrapping_bound(model, state, work)
    upper = frequency_bound(springs, poses, work)
    if not math.isfinite(upper + more):
        # Numbers too large to multiply: nothing is safe.
        return Frequency(math.inf, (), 0)
    run = Lanczos(model, state, work, start, most_steps(count))
    found = converge(run, upper, count)
    bodies: tuple[int, ...] = ()
    if locate and math.isfinite(found.value):
        shape = run.combine(start, found.weights[:, None])[0]
        share = layout.gather(shape**2).sum(axis=1)
        bodies = tuple(int(b) for b in np.argsort(-share, kind='stable')[:4] if share[b] > 0.0)
    return Frequency(float(np.sqrt(max(found.value, 0.0) + more)), bodies, run.matrix.done)


def has_bounded_terms(model: Model) -> bool:
    """Whether terms count that `largest_frequency` adds by a bound, and the iteration lacks."""
    return any(term is not None for term in (
        model.dipole, model.coulomb, model.maxwell, model.wrapping))


def is_springy(model: Model) -> bool:
    """Whether connectors resist at all."""
    links = model.links
    return links is not None and (
        links.stiffness > 0.0 or links.tables is not None or model.bending is not None
        or model.twisting is not None)


def most_steps(body_count: int) -> int:
    """Steps of an iteration at most."""
    return min(LARGEST_ITERATION_COUNT, 6 * body_count)


def converge(run: Iteration, upper: float, body_count: int) -> Largest:
    """The largest eigenvalue, at most `upper`, as accurately as steps need it."""
    if body_count <= _SMALL:
        return find_largest(run, upper, ACCURACY, _ITERATIONS)
    return find_largest(run, upper, _LARGE_ACCURACY, _LARGE_ITERATIONS)


def _arms_eigenvalue(packed: PackedScene, state: State) -> float:
    """
    Largest squared frequency [1/s^2] of the springs of all Maxwell arms alone.

    As if all were as stiff as the stiffest, and at rest in the mean.
    """
    model = packed.model
    assert model.maxwell is not None and model.links is not None and state.rest is not None
    lengths = state.rest[state.rest > 0.0]
    springs = model.links._replace(
        stiffness=model.maxwell.stiffness, natural_length=float(lengths.mean()) if (
            lengths.size) else 0.0, variety=None, tables=None)
    alone = replace(packed, model=model._replace(
        links=springs, bending=None, twisting=None, wrapping=None, dipole=None, coulomb=None,
        maxwell=None))
    return largest_frequency(alone, state).rate ** 2


def with_anchors(
    frequency: Frequency, packed: PackedScene, loads: Loads, state: State, time: float
) -> Frequency:
    """
    Add what anchors can make of it at `time` [s], which is never too low.

    Their second derivatives are a block for each body, whose eigenvalues are exact; the largest
    eigenvalue of a sum is at most the sum of the largest (Weyl).
    """
    if loads.anchors is None or not frequency.rate < math.inf:
        return frequency
    most = anchors_eigenvalue(packed.model, loads, state, time)
    return frequency._replace(rate=math.sqrt(frequency.rate**2 + most))


def hessian_product(
    packed: PackedScene, state: State, shift: np.ndarray, turn: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """
    Second derivative of the connector energy along displacements and rotation vectors (n, 3).

    Returns forces [N] and torques [N m], (n, 3); supports do not count.
    """
    model, layout = without(packed.model, *BESIDE_CONNECTORS), packed.layout
    work = layout.room(model.links)
    place_all(model, state, work, 0, len(layout.blocks.slot))
    vector = layout.spread(np.hstack([shift, turn]))
    product = np.zeros_like(vector)
    hessian_times(
        model, state, work.points, np.zeros_like(work.points), np.zeros((3, layout.slot_count)),
        1.0, 1.0, None, vector, product)
    result = layout.gather(product)
    return result[:, :3], result[:, 3:]


def fastest_motion(
    packed: PackedScene, spread: float, frequency: float, spin: float, load_rate: float,
    proximity: float | None, fall: float,
) -> float:
    """
    Rate [rad/s] of the fastest motion that steps must follow, seen from a body that spins.

    `spread` [m/s]: how much velocities differ; `frequency` and `spin` [rad/s] are the largest,
    `load_rate` [rad/s] that of the loads alone; `proximity` [m]: free bodies may not pass each
    other unseen at this distance, nor what is held, to which they `fall` [m/s^2].
    """
    rate = frequency + spin + packed.velocity_rate
    model = packed.model
    if model.links is None:
        # Free bodies take any step; health checks must come before they have passed each other.
        if proximity is None:
            return rate + load_rate
        return rate + load_rate + max(spread / proximity, math.sqrt(fall / proximity))
    # Loads, weight and speed turn and stretch the fabric before it can answer.
    size = 2.0 * model.links.half_width
    weight = 0.0
    if model.gravity is not None and packed.held:
        # Gravity moves a body by its own size past one that is held.
        weight = math.sqrt(float(np.linalg.norm(model.gravity.acceleration)) / size)
    return max(rate, load_rate + weight, spread / size)
