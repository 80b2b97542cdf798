# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Sums and largest values of a health check over all bodies.

They include energies, work, the largest frequency, spin and coordinate. Blocks lie in groups that
depend on the number of blocks alone. One thread or rank adds up a group, and the groups are added
in their order, so sums are bit-identical for every number of threads and ranks.
"""

from icofabric_sim.kernels.frequency_bound import bound_and_energies
from icofabric_sim.kernels.loads import add_row_bound, driven_energy
from icofabric_sim.kernels.obstruction import obstructed_lanes
from icofabric_sim.kernels.records import Loads, Model, State, Work
from icofabric_sim.kernels.runtime.compiled import compiled, compiled_for
from icofabric_sim.kernels.runtime.lane_reductions import largest_lane, sum_of_lanes
from icofabric_sim.kernels.runtime.lanes import fabs, fma, LANES, load, maximum, splat, Vector
from icofabric_sim.terms.gravity.record import Gravity
from icofabric_sim.terms.gyration import turning_square
from icofabric_sim.terms.masses import weights_of
from icofabric_sim.terms.meters import flowed_in
from icofabric_sim.terms.wrapping.bound import sum_bands
from icofabric_sim.terms.wrapping.record import Wrapping
import numpy as np

# Sums. Energies [J] of connectors, of moments and ways around shells, of fields and of anchors;
# magnitudes of tensions [N]; twice the kinetic energies of unit mass and unit inertia, and minus
# the energy of the height, of unit mass; work [J] of the loads and its magnitudes, energy
# dissipated by velocity-dependent forces [J], work of a body force [J], work of drives alone [J];
# ends of connectors in their shells.
LINKS, MOMENTS, FIELDS, ANCHORS, PULLS, MOVING, TURNING, WEIGHT, DONE, DONE_SIZE = range(10)
DISSIPATED, GIVEN, DRIVEN, INSIDE, SUMMED = range(10, 15)
# Largest values: bound of the squared frequency [1/s^2], squared spin [1/s^2], coordinate [m].
STIFFEST, FASTEST, FARTHEST, FIGURE_COUNT = range(14, 18)
# Preferred size of a group in blocks, and the least and largest number of groups (the least if
# there are enough blocks). Ranks have whole groups, and one rank adds up the sums of all groups.
_GOOD_SIZE, _MIN_GROUP_COUNT, _MAX_GROUP_COUNT = 8, 512, 16384


def group_size(block_count: int) -> int:
    """Return the number of blocks in a group for a fabric of `block_count` blocks."""
    return max(
        1, min(_GOOD_SIZE, block_count // _MIN_GROUP_COUNT), -(-block_count // _MAX_GROUP_COUNT))


def figures_room(block_count: int, size: int) -> np.ndarray:
    """
    Return an array for the figures of `block_count` blocks in groups of `size`, and their totals.
    """
    return np.zeros((-(-block_count // size) + 1, FIGURE_COUNT))


@compiled_for(model='contacts', work='')
def note_figures(
    model: Model, loads: Loads | None, state: State, work: Work, time: float, limit: float,
    looks_inside: bool, first: int, last: int, end: int
) -> None:
    """
    Add up groups first to last of `work.group` blocks, none from block `end` on.

    Results go into `work.figures`, at `time` [s], with attachment points in place. Up to the
    `limit` [1/s^2] a coarse bound of the squared frequency suffices. `looks_inside`: count
    connectors inside shells.
    """
    for group in range(first, last):
        row = work.figures[group]
        begin = group * work.group
        stop = min(begin + work.group, end)
        zero = splat(0.0)
        largest, spin, linear, angular, height, extent = zero, zero, zero, zero, zero, zero
        linked, bent, field, anchored, tensions = zero, zero, zero, zero, zero
        for block in range(begin, stop):
            s = model.blocks.slot[block]
            more, part = rows_part(loads, model, state, block, s, time)
            bound, straight, around, potential, pulls = bound_and_energies(
                model, state, work, block, s, splat(limit) - more)
            linked, bent, field = linked + straight, bent + around, field + potential
            tensions = tensions + pulls
            bound, anchored = bound + more, anchored + part
            largest = maximum(bound, largest)
            square = zero
            heavy, slow = weights_of(model.masses, s)
            for k in range(3):
                v, o = load(state.linear_velocity, k, s), load(state.angular_velocity, k, s)
                linear = fma(heavy * v, v, linear)
                square = fma(o, o, square)
            angular = fma(slow, turning_square(
                model.gyration, state.orientation, state.angular_velocity, s, square), angular)
            spin = maximum(square, spin)
            for k in range(3):
                # Added without gravity too: the sum shows numbers that are not finite.
                weight, place = splat(gravity_along(model.gravity, k)), load(state.position, k, s)
                height = fma(heavy * weight, place, height)
                extent = maximum(fabs(place), extent)
        row[LINKS], row[MOMENTS] = sum_of_lanes(linked), sum_of_lanes(bent)
        row[FIELDS], row[ANCHORS] = sum_of_lanes(field), sum_of_lanes(anchored)
        row[PULLS], row[WEIGHT] = sum_of_lanes(tensions), sum_of_lanes(height)
        row[MOVING], row[TURNING] = sum_of_lanes(linear), sum_of_lanes(angular)
        row[STIFFEST], row[FASTEST] = largest_lane(largest), largest_lane(spin)
        row[FARTHEST] = largest_lane(extent)
        row[DONE], row[DONE_SIZE], row[DRIVEN] = done_in(loads, model, state, begin, stop)
        row[DISSIPATED] = flowed_in(work.spent, model.blocks.slot, begin, stop)
        row[GIVEN] = flowed_in(work.given, model.blocks.slot, begin, stop)
        row[INSIDE] = 0.0
        if looks_inside:
            row[INSIDE] = sum_of_lanes(obstructed_ends(
                model.wrapping, model, state, work.points, begin, stop))


@compiled
def fold_figures(figures: np.ndarray) -> np.ndarray:
    """
    Return the sums and largest values of all groups, in their order: the last row of `figures`.
    """
    count = figures.shape[0] - 1
    totals = figures[count]
    totals[:] = 0.0
    for group in range(count):
        row = figures[group]
        for k in range(SUMMED):
            totals[k] += row[k]
        for k in range(STIFFEST, FIGURE_COUNT):
            totals[k] = max(totals[k], row[k])
    return totals


@compiled
def rows_part(
    loads: Loads | None, model: Model, state: State, block: int, s: int, time: float
) -> tuple[Vector, Vector]:
    """
    Return what loads on a block add to the bound of the squared frequency [1/s^2]; energy [J].
    """
    bound, energy = splat(0.0), splat(0.0)
    if loads is None:
        return bound, energy
    else:
        for m in range(loads.start[block], loads.start[block + 1]):
            bound, energy = add_row_bound(model, loads, state, m, s, time, bound, energy)
        return bound, energy


@compiled
def done_in(
    loads: Loads | None, model: Model, state: State, first: int, last: int
) -> tuple[float, float, float]:
    """
    Return the work [J] of the present loads on blocks first to last, and the sum of magnitudes.

    The magnitudes are those of each load on each body. The third result is the kinetic energy of
    driven freedoms, which paths alone have supplied.
    """
    total, size = 0.0, 0.0
    if loads is None:
        return total, size, 0.0
    else:
        for m in range(LANES * loads.start[first], LANES * loads.start[last]):
            total += loads.work[m]
            size += abs(loads.work[m])
        return total, size, driven_energy(model, loads, state, first, last, 0.0)


@compiled
def obstructed_ends(
    wrapping: Wrapping | None, model: Model, state: State, points: np.ndarray, first: int,
    last: int
) -> Vector:
    """
    Count connector ends inside their shells, at bodies of blocks first to last.

    For connectors wrapped over shells, count those without a path over the shell.
    """
    if wrapping is None:
        return obstructed_lanes(
            model.links, model.shells, model.blocks, state.orientation, points,
            state.position.shape[1], first, last)
    else:
        total = splat(0.0)
        for block in range(first, last):
            _, _, lost = sum_bands(
                wrapping, model.links, model.maxwell, model.inverse_mass, model.inverse_inertia,
                state.position, state.orientation, state.rest, points, block,
                model.blocks.slot[block])
            total = total + lost
        return total


@compiled
def gravity_along(gravity: Gravity | None, k: int) -> float:
    """Return gravity [m/s^2] along an axis."""
    if gravity is None:
        return 0.0
    return float(gravity.acceleration[k])
