# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A bound of the largest frequency of a fabric, body by body, and the energies from the same loop.
"""

from icofabric_sim.kernels.composition import compose_terms
from icofabric_sim.kernels.records import Model, State, Work
from icofabric_sim.kernels.runtime.compiled import compiled, compiled_for
from icofabric_sim.kernels.runtime.lane_reductions import largest_lane
from icofabric_sim.kernels.runtime.lanes import lane, LANES, maximum, splat, Vector

add_moments, add_wrapped, add_arms = (
    compose_terms(
        'add_bound', 'model, state, points, block, s, bound, energy', 'bound, energy', energy=part)
    for part in ('moments', 'wrapped', 'arms'))
add_fields = compose_terms(
    'add_bound', 'model, state, block, s, bound, energy', 'bound, energy',
    energy='fields')
add_limited = compose_terms(
    'add_limited_bound', 'model, state, points, block, s, limit', 'bound, energy, pulls')


@compiled
def bound_and_energies(
    model: Model, state: State, work: Work, block: int, s: int, limit: Vector
) -> tuple[Vector, Vector, Vector, Vector, Vector]:
    """
    Return the bound of the squared frequency [1/s^2] of each body of a block, and energies [J].

    The energies are those of connectors, of moments and connectors wrapped over shells, and of
    fields; then follow the magnitudes of tensions [N]. The bound of a sum of energies is the sum
    of their bounds. Up to the `limit` [1/s^2] a coarse bound suffices.
    """
    zero = splat(0.0)
    more, bent = add_moments(model, state, work.points, block, s, zero, zero)
    field, potential = add_fields(model, state, block, s, zero, zero)
    around, wound = add_wrapped(model, state, work.points, block, s, zero, zero)
    arms, held = add_arms(model, state, work.points, block, s, zero, zero)
    others = more + field + around + arms
    bound, linked, pulls = add_limited(
        model, state, work.points, block, s, limit - others)
    return bound + others, linked + held, bent + wound, potential, pulls


@compiled_for(model='contacts', work='')
def frequency_bound(model: Model, state: State, work: Work) -> float:
    """Return an upper bound of the largest squared frequency [1/s^2], see `bound_and_energies`."""
    return bound_of_blocks(model, state, work, 0, model.blocks.slot.shape[0])


@compiled_for(model='contacts', work='')
def bound_of_blocks(model: Model, state: State, work: Work, first: int, last: int) -> float:
    """
    Return the largest bound of blocks first to last; the largest of all blocks bounds the fabric.
    """
    largest = splat(0.0)
    for block in range(first, last):
        bound, _, _, _, _ = bound_and_energies(
            model, state, work, block, model.blocks.slot[block], splat(-1.0))
        largest = maximum(bound, largest)
    return largest_lane(largest)


@compiled_for(model='contacts')
def field_bound(model: Model, state: State) -> float:
    """Return a bound of what electric fields add to the squared frequency [1/s^2]."""
    largest = splat(0.0)
    for block in range(model.blocks.slot.shape[0]):
        bound, _ = add_fields(
            model, state, block, model.blocks.slot[block], splat(0.0), splat(0.0))
        largest = maximum(bound, largest)
    return largest_lane(largest)


@compiled_for(model='contacts', work='')
def wrapping_bound(model: Model, state: State, work: Work) -> float:
    """Return the largest bound [1/s^2] that wrapping adds; attachment points are in place."""
    largest = splat(0.0)
    for block in range(model.blocks.slot.shape[0]):
        bound, _ = add_wrapped(
            model, state, work.points, block, model.blocks.slot[block], splat(0.0), splat(0.0))
        largest = maximum(bound, largest)
    return largest_lane(largest)


@compiled_for(model='contacts')
def field_energy(model: Model, state: State) -> float:
    """Return the energy [J] of all dipoles in the field and of all pairs of charges."""
    total = 0.0
    for block in range(model.blocks.slot.shape[0]):
        _, energy = add_fields(
            model, state, block, model.blocks.slot[block], splat(0.0), splat(0.0))
        for i in range(LANES):
            total += lane(energy, i)
    return total
