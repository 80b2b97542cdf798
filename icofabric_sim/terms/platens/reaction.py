# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Work of moving planes against the contact forces on them."""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fma,
    LANES,
    load,
    load_at,
    splat,
    store,
    store_at,
    Vector,
    where,
)
from icofabric_sim.terms.contacts.record import Contacts
from icofabric_sim.terms.loads import Loads
from icofabric_sim.terms.platens.record import Platens
from icofabric_sim.terms.shared import Six, State


@compiled
def resist_row(
    platens: Platens | None, contacts: Contacts | None, loads: Loads, state: State, m: int, s: int,
    h: float, again: float, a: Six
) -> Six:
    """
    Add the work [J] of the path of row `m` over a kick of `h`, see terms/drives/reaction.py.

    The accelerations of carriers are zero already.
    """
    if platens is None:
        return a
    if contacts is None:
        return a
    if is_platen(platens, loads.wrench[m]):
        mine, power = bits(loads.lanes[m]), power_on(contacts, state, s)
        done = load_at(loads.work, LANES * m)
        more = done - splat(h) * power
        if again != 0.0:
            more = more - splat(again) * power
        store_at(loads.work, LANES * m, where(mine, more, done))
    return a


@compiled
def resist_row_slope(
    platens: Platens | None, contacts: Contacts | None, loads: Loads, state: State, m: int, s: int,
    index: int
) -> None:
    """Store the power [W] of the path of row `m` at a Runge-Kutta stage."""
    if platens is None:
        return
    if contacts is None:
        return
    if is_platen(platens, loads.wrench[m]):
        store(loads.power, index, LANES * m, where(
            bits(loads.lanes[m]), splat(0.0) - power_on(contacts, state, s), splat(0.0)))


@compiled
def is_platen(platens: Platens, number: int) -> bool:
    """Check that a row of the loads is the path of a plane."""
    return platens.first <= -1 - number < platens.first + platens.count


@compiled
def power_on(contacts: Contacts, state: State, s: int) -> Vector:
    """Return the power [W] of contact forces on the carriers of a block."""
    power = splat(0.0)
    for k in range(3):
        power = fma(load(contacts.rows, k, s), load(state.linear_velocity, k, s), power)
    return power
