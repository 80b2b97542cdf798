# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Sums of a health check on a GPU: the figures of kernels/figures.py.

A thread per body computes the figures. Sums and maxima are formed in a tree that depends on the
number of blocks alone, so results are bit-identical on every device and in every run.
"""

from functools import cache
from importlib import import_module
from typing import Any

from icofabric_sim.simulation.devices.gpu.forces import (
    arm_anywhere,
    arm_at_midpoint,
    has_link,
    law_rows,
    partner_of,
    place_of,
    turn_of,
)
from icofabric_sim.simulation.devices.gpu.options import OPTIONS
from icofabric_sim.simulation.devices.gpu.records import Acting, Fabric
from icofabric_sim.terms.shells import ALONG, LEAN

wp: Any = import_module('warp')

_DOUBLE = wp.float64
_ZERO_F64, _HALF, _QUARTER, _ONE, _TWO = (
    wp.constant(_DOUBLE(x)) for x in (0.0, 0.5, 0.25, 1.0, 2.0))
_MIN_DIVISOR = wp.constant(_DOUBLE(1e-300))
_LEAN, _ALONG = wp.constant(_DOUBLE(LEAN)), wp.constant(_DOUBLE(ALONG))
_INFINITY = wp.constant(_DOUBLE(float('inf')))
# Figures of a body, in this order; the last three are maxima, the others sums.
LINKED, TENSIONS, KINETIC, HEIGHT, BOUND, SPIN, EXTENT = range(7)
FIGURES, SUMMED = 7, 4
# Blocks, or partial sums, that one thread folds.
SHARE = 16

_Six = wp.types.vector(length=6, dtype=_DOUBLE)
_SixBySix = wp.types.matrix(shape=(6, 6), dtype=_DOUBLE)


@wp.func
def larger(a: wp.float64, b: wp.float64):
    """Return the larger of two numbers; infinity if the second is NaN."""
    if b <= a:
        return a
    return wp.where(b == b, b, _INFINITY)


@wp.func
def row_sum(form: _SixBySix, row: int):
    """Return the sum of the magnitudes of a row."""
    total = wp.abs(form[row, 0])
    for k in range(1, 6):
        total = total + wp.abs(form[row, k])
    return total


@wp.func
def largest_of_block(form: _SixBySix):
    """Return a bound of the largest eigenvalue, as in kernels/frequency_bound.py."""
    scale = _ZERO_F64
    for k in range(6):
        scale = wp.max(scale, form[k, k])
    part = form * (_ONE / wp.max(scale, _MIN_DIVISOR))
    square = part * part
    most = _ZERO_F64
    for k in range(6):
        most = wp.max(most, row_sum(square, k))
    return scale * wp.sqrt(most)


@wp.func
def one_slope(fabric: Fabric, at: int, square: wp.float64, length: wp.float64):
    """
    Return twice the energy over the stiffness [m^2], tension [N] and 1, the root of the slope.
    """
    stretch = length - fabric.natural_length
    return stretch * stretch, fabric.stiffness * stretch, _ONE


@wp.func
def own_slope(fabric: Fabric, at: int, square: wp.float64, length: wp.float64):
    """Return twice the energy [J], tension [N] and root of the largest slope of a connector."""
    rest = fabric.natural[at]
    k = wp.where(square > rest * rest, fabric.extension[at], fabric.compression[at])
    stretch = length - rest
    pull = k * stretch
    return stretch * pull, pull, wp.sqrt(wp.max(fabric.extension[at], fabric.compression[at]))


def _by_law(spring: Any, device: Any, row: int) -> Any:
    """Return the function of energies, tensions and slopes with those of a law."""
    replace_pull, replace_slope = device.replace_pull, device.replace_slope
    replace_energy = device.replace_energy

    @wp.func
    def law(fabric: Fabric, at: int, square: wp.float64, length: wp.float64):
        double, pull, root = spring(fabric, at, square, length)
        k, rest, place = fabric.extension[at], fabric.natural[at], at + 12 * row * fabric.stride
        pull = replace_pull(fabric.laws, place, k, rest, length, pull)
        root = wp.sqrt(replace_slope(fabric.laws, place, k, rest, length, root * root))
        double = _TWO * replace_energy(fabric.laws, place, k, rest, length, _HALF * double)
        return double, pull, root
    return law


@cache
def figures_kernel(
    *, linked: bool, midpoints: bool, one_law: bool, own_masses: bool, laws: tuple[str, ...] = ()
) -> Any:
    """Return the kernel that computes the figures of each body, for scenes with these terms."""
    arm_to = arm_at_midpoint if midpoints else arm_anywhere
    slope_of = one_slope if one_law else own_slope
    for row, device in law_rows(laws):
        slope_of = _by_law(slope_of, device, row)

    @wp.kernel(
        module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
    def figures(
        fabric: Fabric, pose: wp.array(dtype=wp.float64), motion: wp.array(dtype=wp.float64),
        found: wp.array(dtype=wp.float64)
    ):
        thread = wp.tid()
        block = thread / fabric.lanes
        lane = thread - block * fabric.lanes
        if (int(fabric.alive[block]) >> lane) & 1 == 0:
            return
        s = fabric.slot[block] + lane
        n = fabric.stride
        place, turn = place_of(pose, n, s), turn_of(pose, n, s)
        energy, pulls, bound = wp.float64(0.0), wp.float64(0.0), wp.float64(0.0)
        if wp.static(linked):
            # See terms/links/bound.py.
            mass, inertia = fabric.inverse_mass, fabric.inverse_inertia
            root_mass, root_inertia = wp.sqrt(mass), wp.sqrt(inertia)
            form, tension = _SixBySix(), wp.float64(0.0)
            for link in range(12):
                if has_link(fabric, block, lane, link) == 1:
                    edge = link >> 1
                    arm = arm_to(fabric, turn, edge)
                    other = partner_of(fabric, block, lane, link)
                    u = (place_of(pose, n, other) + arm_to(
                        fabric, turn_of(pose, n, other), edge ^ 1)) - (place + arm)
                    square = wp.max(wp.dot(u, u), _MIN_DIVISOR)
                    length = wp.sqrt(square)
                    double, pull, root = slope_of(fabric, link * n + s, square, length)
                    energy = energy + double
                    tension = tension + wp.max(pull, _ZERO_F64) / length
                    pulls = pulls + wp.abs(pull)
                    along = u * (root / length)
                    across = wp.cross(arm * root_inertia, along)
                    along = along * root_mass
                    r = _Six(along[0], along[1], along[2], across[0], across[1], across[2])
                    form = form + wp.outer(r, r)
            spread = _TWO * (mass + fabric.half_width * fabric.half_width * inertia)
            moment = fabric.half_width * inertia
            bound = _TWO * largest_of_block(form)
            if wp.static(one_law):
                # Otherwise the sums contain the roots of the stiffnesses.
                bound = fabric.stiffness * bound
                energy = fabric.stiffness * energy
            bound = bound + (spread * tension + moment * pulls)
        velocity = wp.vec3d(motion[s], motion[n + s], motion[2 * n + s])
        spin = wp.vec3d(motion[3 * n + s], motion[4 * n + s], motion[5 * n + s])
        square = wp.dot(spin, spin)
        found[s] = _QUARTER * energy
        found[n + s] = _HALF * pulls
        # Even without weight: values that are not finite must reach the sum.
        if wp.static(own_masses):
            found[2 * n + s] = _HALF * (
                wp.dot(velocity, velocity) * fabric.own_mass[s] + square * fabric.own_inertia[s])
            found[3 * n + s] = -wp.dot(fabric.gravity, place) * fabric.own_mass[s]
        else:
            found[2 * n + s] = _HALF * (
                wp.dot(velocity, velocity) / fabric.inverse_mass
                + square / fabric.inverse_inertia)
            found[3 * n + s] = -wp.dot(fabric.gravity, place) / fabric.inverse_mass
        found[4 * n + s] = bound
        found[5 * n + s] = square
        found[6 * n + s] = wp.max(wp.abs(place[0]), wp.max(wp.abs(place[1]), wp.abs(place[2])))
    return figures


@wp.kernel(module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
def obstructed(
    fabric: Fabric, pose: wp.array(dtype=wp.float64), found: wp.array(dtype=wp.float64)
):
    """Count the connectors that enter the shell of a body, see terms/shells.py."""
    thread = wp.tid()
    block = thread / fabric.lanes
    lane = thread - block * fabric.lanes
    if (int(fabric.alive[block]) >> lane) & 1 == 0:
        return
    s = fabric.slot[block] + lane
    n = fabric.stride
    place, turn = place_of(pose, n, s), turn_of(pose, n, s)
    count = wp.float64(0.0)
    for link in range(12):
        if has_link(fabric, block, lane, link) == 1:
            edge = link >> 1
            arm = arm_at_midpoint(fabric, turn, edge)
            other = partner_of(fabric, block, lane, link)
            u = (place_of(pose, n, other) + arm_at_midpoint(
                fabric, turn_of(pose, n, other), edge ^ 1)) - (place + arm)
            # The axis across the edge is that of the next pair of edges.
            side = arm_at_midpoint(fabric, turn, (edge - (edge & 1) + 2) % 6)
            beside = wp.abs(wp.dot(u, side))
            if wp.dot(u, arm) + _LEAN * beside < -_ALONG * beside:
                count = count + _ONE
    found[s] = count


@wp.kernel(module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
def fold_blocks(
    fabric: Fabric, blocks: int, shares: int, found: wp.array(dtype=wp.float64),
    folded: wp.array(dtype=wp.float64)
):
    """Fold the figures of some blocks, with a thread for each figure and share."""
    thread = wp.tid()
    figure = thread / shares
    share = thread - figure * shares
    total = wp.float64(0.0)
    for block in range(SHARE * share, wp.min(SHARE * share + SHARE, blocks)):
        for lane in range(fabric.lanes):
            if (int(fabric.alive[block]) >> lane) & 1 == 1:
                value = found[figure * fabric.stride + fabric.slot[block] + lane]
                total = wp.where(figure < SUMMED, total + value, larger(total, value))
    folded[thread] = total


@wp.kernel(module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
def fold(
    count: int, shares: int, values: wp.array(dtype=wp.float64),
    folded: wp.array(dtype=wp.float64)
):
    """Fold `count` folded values of each figure further."""
    thread = wp.tid()
    figure = thread / shares
    share = thread - figure * shares
    total = wp.float64(0.0)
    for k in range(SHARE * share, wp.min(SHARE * share + SHARE, count)):
        value = values[figure * count + k]
        total = wp.where(figure < SUMMED, total + value, larger(total, value))
    folded[thread] = total


@wp.kernel(module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
def fold_work(
    count: int, acting: Acting, folded: wp.array(dtype=wp.float64)
):
    """Sum the work [J] and its magnitudes."""
    share = wp.tid()
    shares = folded.shape[0] / 2
    total, size = wp.float64(0.0), wp.float64(0.0)
    for k in range(SHARE * share, wp.min(SHARE * share + SHARE, count)):
        total = total + acting.work[k]
        size = size + wp.abs(acting.work[k])
    folded[share] = total
    folded[shares + share] = size
