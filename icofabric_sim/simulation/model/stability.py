# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The largest frequency of a fabric in a configuration, which limits the step of explicit methods.
"""

from dataclasses import dataclass, replace
import math
from typing import NamedTuple

from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.frequency_bound import field_bound, frequency_bound, wrapping_bound
from icofabric_sim.kernels.hessian import hessian_times
from icofabric_sim.kernels.records import Loads, Model, State
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
from icofabric_sim.simulation.model.ties import stiffest_blocks
import numpy as np


@dataclass(frozen=True)
class FrequencySettings:
    """Tunables of the Lanczos iteration for the largest frequency."""

    # Relative accuracy of the squared frequency at which the iteration stops. A slightly larger
    # eigenvalue that the start hardly contains may hide within the residual: with 1e-3 the
    # frequency was up to 0.6 % low in turned fabrics, with 1e-4 at most 0.01 %.
    accuracy_ratio: float = 1e-4
    # The spectrum of a large fabric is dense at its top and takes hundreds of iterations to
    # resolve. A few iterations give the top at most 1.5 % too high.
    large_accuracy_ratio: float = 0.03
    small_body_count: int = 2_000  # most bodies of a small fabric
    max_iterations: int = 300
    # Iterations between two tests of convergence: a test takes as long as several iterations of
    # a small fabric, and a large fabric needs few iterations.
    test_interval: int = 8
    large_test_interval: int = 2


_SETTINGS = FrequencySettings()


class Frequency(NamedTuple):
    """The largest frequency and the bodies that vibrate most."""

    rate: float  # [rad/s]
    bodies: tuple[int, ...]  # at most four bodies that vibrate most
    iterations: int


def largest_frequency(
    packed: PackedScene, state: State, *, locate: bool = False
) -> Frequency:
    """
    Return the largest frequency [rad/s] of small motions about a configuration with its supports.

    The Lanczos iteration (lanczos.py) finds the largest eigenvalue of M^-1/2 H M^-1/2. H is the
    Hessian of the connector energy (kernels/hessian.py), M the masses and inertias. `locate` also
    finds the bodies that vibrate most. The contributions of electric fields, wrapping over shells
    and Maxwell arms are bounded: the largest eigenvalue of a sum is at most the sum of the
    largest.
    """
    model, layout = packed.model, packed.layout
    start = start_vector(layout, model.supports)
    if not start.any():
        return Frequency(0.0, (), 0)
    more, pairs, most = 0.0, None, 0.0
    if model.ties is not None and packed.custom is not None:
        pairs, most = stiffest_blocks(packed.custom, model, layout, state)
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
        more += wrapping_bound(model, state, work)
    upper = frequency_bound(springs, poses, work) + most
    if not math.isfinite(upper + more):
        # Products of these numbers overflow: no step is stable.
        return Frequency(math.inf, (), 0)
    run = Lanczos(model, state, work, start, most_steps(count), pairs=pairs)
    found = converge(run, upper, count)
    bodies: tuple[int, ...] = ()
    if locate and math.isfinite(found.value):
        shape = run.combine(start, found.weights[:, None])[0]
        share = layout.gather(shape**2).sum(axis=1)
        bodies = tuple(int(b) for b in np.argsort(-share, kind='stable')[:4] if share[b] > 0.0)
    return Frequency(float(np.sqrt(max(found.value, 0.0) + more)), bodies, run.matrix.done)


def has_bounded_terms(model: Model) -> bool:
    """Return True if `largest_frequency` bounds a term that the iteration leaves out."""
    return any(term is not None for term in (
        model.dipole, model.coulomb, model.maxwell, model.wrapping))


def is_springy(model: Model) -> bool:
    """Return True if connectors have any stiffness, or there are custom ones."""
    links = model.links
    return model.ties is not None or links is not None and (
        links.stiffness > 0.0 or links.laws is not None or model.bending is not None
        or model.twisting is not None)


def most_steps(body_count: int) -> int:
    """Return the largest number of steps of an iteration."""
    return min(_SETTINGS.max_iterations, 6 * body_count)


def converge(run: Iteration, upper: float, body_count: int) -> Largest:
    """
    Return the largest eigenvalue, at most `upper`, with the accuracy that step sizes require.
    """
    if body_count <= _SETTINGS.small_body_count:
        return find_largest(run, upper, _SETTINGS.accuracy_ratio, _SETTINGS.test_interval)
    return find_largest(
        run, upper, _SETTINGS.large_accuracy_ratio, _SETTINGS.large_test_interval)


def _arms_eigenvalue(packed: PackedScene, state: State) -> float:
    """
    Return the largest squared frequency [1/s^2] of the springs of all Maxwell arms alone.

    All arms have the stiffness of the stiffest arm and are relaxed on average.
    """
    model = packed.model
    assert model.maxwell is not None and model.links is not None and state.rest is not None
    lengths = state.rest[state.rest > 0.0]
    springs = model.links._replace(
        stiffness=model.maxwell.stiffness, natural_length=float(lengths.mean()) if (
            lengths.size) else 0.0, variety=None, laws=None)
    alone = replace(packed, model=model._replace(
        links=springs, bending=None, twisting=None, wrapping=None, dipole=None, coulomb=None,
        maxwell=None, ties=None))
    return largest_frequency(alone, state).rate ** 2


def with_anchors(
    frequency: Frequency, packed: PackedScene, loads: Loads, state: State, time: float
) -> Frequency:
    """
    Add an upper bound of the contribution of anchors at `time` [s] to a frequency.

    The second derivatives of anchors are one block for each body, whose eigenvalues are exact. The
    largest eigenvalue of a sum is at most the sum of the largest (Weyl).
    """
    if loads.anchors is None or not frequency.rate < math.inf:
        return frequency
    most = anchors_eigenvalue(packed.model, loads, state, time)
    return frequency._replace(rate=math.sqrt(frequency.rate**2 + most))


def hessian_product(
    packed: PackedScene, state: State, shift: np.ndarray, turn: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return forces [N] and torques [N m], (n, 3), that displacements cause to first order.

    They are the second derivative of the connector energy along displacements `shift` and rotation
    vectors `turn`, (n, 3), without supports.
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
    Return the rate [rad/s] of the fastest motion in the frame of a spinning body.

    `spread` [m/s] is the largest difference of velocities. `frequency` and `spin` [rad/s] are the
    largest ones, `load_rate` [rad/s] is that of the loads alone. `proximity` [m] is the distance
    at which free bodies must not pass each other, or a held body, between two health checks;
    `fall` [m/s^2] is the acceleration towards held bodies.
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
