# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
What contacts take from the motion, by the laws of contact_laws.py, for Runge-Kutta methods.

Who evaluates a pair also says what it loses: the push of the pair is changed before the bodies
add up what acts on them, so what one gets the other gets too, and no bit depends on the number of
threads.
"""

from icofabric_sim.kernels.borrowed import borrowed
from icofabric_sim.kernels.compiled import compiled
from icofabric_sim.kernels.contact_laws import damping_factor, depth_rate, Three
from icofabric_sim.kernels.contacts import add_up, touch_all, touch_some
from icofabric_sim.kernels.lanes import load, Vector
from icofabric_sim.kernels.records import ContactLosses, Contacts, State, Team
from icofabric_sim.kernels.team import own_blocks, wait_for_all
import numpy as np


@compiled
def losses_of(contacts: Contacts | None) -> ContactLosses | None:
    """
    What contacts lose, if there are any.
    """
    if contacts is None:
        return None
    else:
        return contacts.losses


@compiled
def touch_moving(contacts: Contacts | None, state: State, team: Team) -> None:
    """
    As `touch_all`, with what depends on velocities; also a barrier.
    """
    touch_losing(losses_of(contacts), contacts, state, team)


@compiled
def touch_losing(
    losses: ContactLosses | None, contacts: Contacts | None, state: State, team: Team
) -> None:
    """
    The same; without losses it is `touch_all`.
    """
    if losses is None:
        touch_all(contacts, state.position, state.orientation, team)
    else:
        touch_and_lose(losses, contacts, state, team)


@compiled
def touch_and_lose(
    losses: ContactLosses, contacts: Contacts, state: State, team: Team
) -> None:
    """
    The same with losses.
    """
    count = contacts.pairs.shape[0]
    first, last = count * team.member // team.size, count * (team.member + 1) // team.size
    touch_some(
        contacts, state.position, state.orientation, team.scratch, contacts.result, team.member,
        first, last)
    lose_some(losses, contacts, state, first, last)
    wait_for_all(team)
    first, last = own_blocks(team, contacts.start.shape[0] - 1)
    add_up(contacts, first, last)
    add_up_taken(losses, contacts, first, last)


@compiled
def lose_some(
    losses: ContactLosses, contacts: Contacts, state: State, first: int, last: int
) -> None:
    """
    Change the pushes of the pairs first to last, which are in place, by what they lose.
    """
    pairs, result = borrowed(contacts.pairs), borrowed(contacts.result)
    velocity, spin = borrowed(state.linear_velocity), borrowed(state.angular_velocity)
    power = borrowed(losses.power)
    for p in range(first, last):
        out = result[p]
        power[p] = 0.0
        if out[10] > 0.0:
            s, t = pairs[p, 0], pairs[p, 1]
            va, wa = column(velocity, s), column(spin, s)
            vb, wb = column(velocity, t), column(spin, t)
            rate = depth_rate(out, va, wa, vb, wb)
            factor = damping_factor(losses.damping, rate)
            power[p] = contacts.stiffness * out[10] * rate * (factor - 1.0)
            for k in range(9):
                out[k] *= factor


@compiled
def column(rows: np.ndarray, s: int) -> Three:
    """
    Three numbers of slot `s`; 0 for a plane, whose number is below 0.
    """
    if s < 0:
        return 0.0, 0.0, 0.0
    return rows[0, s], rows[1, s], rows[2, s]


@compiled
def add_up_taken(losses: ContactLosses, contacts: Contacts, first: int, last: int) -> None:
    """
    Powers [W] that the pairs of bodies of blocks first to last take, each at its first body.
    """
    before = -1
    for e in range(contacts.start[first], contacts.start[last]):
        s, p, side = contacts.slot[e], contacts.entry[e] >> 1, contacts.entry[e] & 1
        if s != before:
            losses.spent[0, s] = 0.0
        before = s
        if side == 0:
            losses.spent[0, s] += losses.power[p]


@compiled
def add_taken(losses: ContactLosses | None, s: int, spent: Vector) -> Vector:
    """
    Add the power [W] that contacts take at a block.
    """
    if losses is None:
        return spent
    else:
        return spent + load(losses.spent, 0, s)
