# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Steps of splitting methods for the terms of a scene: kick, drift, ..., or drift, kick, ...

The control in splitting.py calls one of these kernels by its address. Bodies without loads have
kernels of their own: a search for rows block by block, without any rows, took 5 % of a leapfrog
step.
"""

from typing import Any

from icofabric_sim.kernels.flows import drift, push, push_kept
from icofabric_sim.kernels.integrators.kinked import kinked_steps
from icofabric_sim.kernels.records import Loads, Model, State, Team, Work
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import splat
from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.kernels.runtime.team import own_blocks, TILE, wait_for_all
from icofabric_sim.terms.contacts.displacement import add_ways, note_ways, shift_at
from icofabric_sim.terms.contacts.losses import losses_of, touch_ahead
from icofabric_sim.terms.contacts.record import Contacts, Watch
from icofabric_sim.terms.contacts.stiffness import note_pushes
import numpy as np


class Splitting(Record):
    """
    Fractions of a step that each flow takes; the longer of the two begins and ends a step.
    """

    kicks: np.ndarray
    drifts: np.ndarray


@compiled
def steps(
    kicks: np.ndarray, drifts: np.ndarray, model: Model, contacts: Contacts | None,
    loads: Loads | None, state: State, work: Work, team: Team, watch: Watch | None, origin: float,
    index: int, h: float, count: int
) -> None:
    """
    Take `count` steps of length `h`, the first from origin + index h on; see `splitting`.

    Contacts need the positions of all bodies, so in their sweeps all bodies drift first.
    Dissipative contacts are for the leapfrog alone (terms/contacts/losses.py). The displacements
    of bodies are stored only where forces are evaluated; positions in between do not count.

    A block can be kicked once its neighbours have drifted, so both run over the fabric in one
    sweep (see traversal_order.py) and each body comes from memory once. Blocks of a thread that
    border on another's drift first.
    """
    first, last = own_blocks(team, model.blocks.slot.shape[0])
    sweep = team.sweep
    count_own = last - first
    # A literal would be a type of its own, and compile the drift once more.
    begin: int = np.int64(0)  # type: ignore[assignment]
    kick_first = kicks.shape[0] > drifts.shape[0]
    stages = min(kicks.shape[0], drifts.shape[0])
    if kick_first:
        push_kept(model, loads, state, work, origin + index * h, kicks[0] * h, first, last)
    now = 0.0
    most = splat(0.0)
    for evaluation in range(count * stages):
        stage = evaluation % stages
        # The times of a step do not depend on the call that contains it.
        step = index + evaluation // stages
        if stage == 0:
            now = origin + step * h
        whole = drifts[stage] * h
        after = now + whole
        if kick_first and stage + 1 == stages:
            after = origin + (step + 1) * h
        kick = kicks[stage] * h
        again = 0.0
        keep = False
        if kick_first:
            kick = kicks[stage + 1] * h
            # The last kick of a step and the first of the next share their forces.
            keep = evaluation + 1 == count * stages
            if stage + 1 == stages and not keep:
                again = kicks[0] * h
        drifted = begin
        shift = shift_at(watch, after)
        if team.size > 1:
            drift(
                model, loads, state, work, now, whole, sweep.drifts, drifted, sweep.border)
            drifted = sweep.border
            wait_for_all(team)
        if contacts is not None:
            if team.size == 1:
                drift(model, loads, state, work, now, whole, sweep.drifts, drifted, count_own)
                drifted = count_own
            touch_ahead(
                losses_of(contacts), contacts, state, model.inverse_mass, model.inverse_inertia,
                h, h, team)
        if watch is not None:
            for turn in range(drifted):
                block = sweep.drifts[turn]
                most = add_ways(
                    watch, state, model.blocks.alive[block], shift, model.blocks.slot[block], most)
        for tile in range(sweep.ahead.shape[0]):
            goal: int = np.int64(sweep.ahead[tile])  # type: ignore[assignment]
            drift(model, loads, state, work, now, whole, sweep.drifts, drifted, goal)
            if watch is not None:
                for turn in range(drifted, goal):
                    block = sweep.drifts[turn]
                    most = add_ways(
                        watch, state, model.blocks.alive[block], shift, model.blocks.slot[block],
                        most)
            drifted = goal
            push(
                model, loads, state, work, None, 0.0, after, kick, again, keep, sweep.pushes,
                TILE * tile, min(TILE * tile + TILE, count_own))
        if evaluation + 1 == count * stages:
            note_ways(watch, team.member, most)
            note_pushes(
                contacts, model.blocks, model.inverse_mass, model.inverse_inertia, first, last)
        wait_for_all(team)
        now = after
        if not kick_first and stage + 1 == stages:
            drift(
                model, loads, state, work, now, drifts[stages] * h, sweep.drifts, begin, count_own)
            wait_for_all(team)


@compiled
def loaded_steps(
    method: Splitting, model: Model, loads: Loads, state: State, work: Work, team: Team,
    watch: Watch | None, origin: float, index: int, h: float, count: int
) -> None:
    """Take `count` steps of bodies, some with loads."""
    steps(
        method.kicks, method.drifts, model, model.contacts, loads, state, work, team, watch,
        origin, index, h, count)


@compiled
def unloaded_steps(
    method: Splitting, model: Model, loads: Loads, state: State, work: Work, team: Team,
    watch: Watch | None, origin: float, index: int, h: float, count: int
) -> None:
    """Take `count` steps of bodies without loads."""
    steps(
        method.kicks, method.drifts, model, model.contacts, None, state, work, team, watch,
        origin, index, h, count)


@compiled
def loaded_kinked_steps(
    method: Splitting, model: Model, loads: Loads, state: State, work: Work, team: Team,
    watch: Watch | None, origin: float, index: int, h: float, count: int
) -> None:
    """Take `count` steps that keep their order if slopes jump."""
    kinked_steps(
        work.kinks, method.kicks, method.drifts, model, model.contacts, loads, state, work, team,
        watch, origin, index, h, count)


@compiled
def unloaded_kinked_steps(
    method: Splitting, model: Model, loads: Loads, state: State, work: Work, team: Team,
    watch: Watch | None, origin: float, index: int, h: float, count: int
) -> None:
    """Take `count` such steps of bodies without loads."""
    kinked_steps(
        work.kinks, method.kicks, method.drifts, model, model.contacts, None, state, work, team,
        watch, origin, index, h, count)


def kernel_of(loads: Loads, work: Work) -> Any:
    """Return the kernel for such loads, and for connectors with such kinks."""
    if work.kinks is None:
        return loaded_steps if len(loads.wrench) else unloaded_steps
    return loaded_kinked_steps if len(loads.wrench) else unloaded_kinked_steps
