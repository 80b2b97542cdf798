# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Path of equilibria of a slab whose held bodies move in steps."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

from icofabric_sim.checks import renamed_attributes
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.statics.equilibrium import Equilibrium, find_next_equilibrium, solve_equilibrium
from icofabric_sim.statics.fabric import StaticFabric
from icofabric_sim.statics.friction import FrictionPath
from icofabric_sim.statics.held_motion import HeldMotion
import numpy as np

EXTENSION, COMPRESSION = 'extension', 'compression'


@renamed_attributes(released='released_energy')
class Break(NamedTuple):
    """Break of one connector."""

    connector: int
    amount: float  # strain, or angle [rad], at which it was beyond its break length
    side: str  # 'extension' or 'compression'
    length: float  # [m] when it broke
    released_energy: float  # [J] decrease of the energy to the equilibrium without the connector


class Step(NamedTuple):
    """Equilibrium of the slab at one amount."""

    amount: float
    found: Equilibrium
    conjugate: float  # derivative of the energy with respect to the amount [J]
    before_breaks: float  # this derivative before breaks at this amount [J]
    breaks: tuple[Break, ...]  # at this amount, in order


class StateCounts(NamedTuple):
    """Counts of connectors and contacts in one state."""

    obstructed: int  # connectors that pass through the shell they are attached to, or wrap over it
    beyond_break_length: int  # connectors beyond the length at which they break
    broken: int  # connectors that have broken so far
    contact_pairs: int  # pairs of shells in contact
    sliding_pairs: int  # of these, sliding pairs (contact.friction)
    at_kink: int  # connectors at their natural length with k_e other than k_c
    # Connectors at their kink in the initial equilibrium, or on the other side since then.
    past_kink: int


def follow_path(
    motion: HeldMotion, amounts: Iterable[float], rest: 'InitialEquilibrium | None' = None
) -> Iterator[Step]:
    """
    Yield equilibria with held bodies at the amounts, each starting from the previous one.

    If connectors are beyond their break lengths, the one farthest beyond breaks for good, and the
    search is repeated until none is (the quasi-static order of de Arcangelis, Redner and Herrmann
    1985, J. Phys. Lett. 46, L585). With friction, contacts stick and slide along the path, which
    starts without friction at `rest`, the initial equilibrium (None: computed if needed). Ends if
    no equilibrium is found.
    """
    done: list[tuple[float, Snapshot]] = []
    path = FrictionPath.of(motion.scene)
    if path is not None:
        # Contacts in the initial equilibrium have not slipped.
        found = (rest or InitialEquilibrium(motion)).found
        if found.converged:
            path, done = _initial_friction(path, motion, found), [(0.0, found.snapshot)]
    for amount in amounts:
        here = motion.placed(amount)
        found, next_path = find_next_equilibrium(
            here, path, start=_extrapolated_start(done, amount), body_force=motion.body_force)
        before = motion.conjugate(amount, found.reaction)
        breaks: list[Break] = []
        while found.converged and (worst := _worst_beyond(here, found.snapshot)) is not None:
            last = found.snapshot
            since = last.break_time.copy()
            since[worst] = 0.0
            found, next_path = find_next_equilibrium(
                here, path, start=replace(last, broken_since=since), body_force=motion.body_force)
            length = float(last.connector_length[worst])
            breaks.append(Break(
                worst, amount, _side(here, worst, length), length,
                float(last.energy['total']) - float(found.snapshot.energy['total'])))
        done, path = [*done[-1:], (amount, found.snapshot)], next_path
        yield Step(
            amount, found, motion.conjugate(amount, found.reaction), before, tuple(breaks))
        if not found.converged:
            return


class InitialEquilibrium:
    """Initial equilibrium of the slab, and the sides of its connectors."""

    def __init__(self, motion: HeldMotion) -> None:
        """Find the equilibrium without friction, before any motion."""
        scene = motion.scene
        if scene.parameters['contact.friction'] != 0.0:
            scene = scene.with_changes({'contact.friction': 0.0})
        self._scene, found = motion.scene, solve_equilibrium(
            scene, body_force=motion.body_force, objective='energy')
        fabric = StaticFabric(scene)
        self._kinked, self._rest = fabric.laws.kinked, fabric.laws.natural_length
        self._longer = found.snapshot.connector_length > self._rest
        self._at_kink = found.at_kink
        # Derivative of the energy by the amount [J]; NaN: no equilibrium.
        self.conjugate = motion.conjugate(
            0.0, np.where(found.converged, found.reaction, np.nan))
        self.found = found

    def count_state(self, found: Equilibrium) -> StateCounts:
        """Return the counts of an equilibrium relative to the initial one."""
        now = found.snapshot
        past = self._kinked & now.intact & (self._longer != (now.connector_length > self._rest))
        past[self._at_kink] = True
        return StateCounts(
            int(np.count_nonzero(now.obstructed)),
            int(np.count_nonzero(_excess(self._scene, now) >= 0.0)),
            int(np.count_nonzero(~now.intact)),
            0 if found.contact_state is None else len(found.contact_state.pairs),
            0 if found.friction is None else int(np.count_nonzero(found.friction.slides)),
            len(found.at_kink), int(np.count_nonzero(past)))


def _initial_friction(path: FrictionPath, motion: HeldMotion, rest: Equilibrium) -> FrictionPath:
    """Return the friction path from the initial equilibrium, before any slip."""
    fabric = StaticFabric(motion.scene, friction=path)
    here = fabric.configuration('start', rest.snapshot)
    assert fabric.contacts is not None
    return path.advanced(fabric.contacts, here.position, here.axes)


def tension_range(found: Equilibrium) -> tuple[float, float]:
    """Return the smallest and largest tension [N] of connectors; negative: compression."""
    return float(found.tension.min(initial=np.inf)), float(found.tension.max(initial=-np.inf))


def _extrapolated_start(done: list[tuple[float, Snapshot]], amount: float) -> Snapshot | None:
    """Return the start of a search, extrapolated from the last two states to an amount."""
    if not done:
        return None
    *before, (amount_there, last) = done
    if not before or before[0][0] == amount_there:
        return last
    [(first, snapshot)] = before
    ratio = (amount - amount_there) / (amount_there - first)
    moved = last.position - snapshot.position
    return replace(last, position=last.position + max(-1.0, min(ratio, 1.0)) * moved)


def _excess(scene: Scene, snapshot: Snapshot) -> np.ndarray:
    """Return the relative excess of connectors over their break lengths, (c,); broken: -1."""
    limits = scene.connectors.limits
    if limits is None:
        return np.full(snapshot.connector_count, -1.0)
    length = snapshot.connector_length
    longer = np.where(np.isfinite(limits.longest), length / limits.longest - 1.0, -1.0)
    shorter = np.where(limits.shortest > 0.0, 1.0 - length / np.where(
        limits.shortest > 0.0, limits.shortest, 1.0), -1.0)
    return np.where(snapshot.intact, np.maximum(longer, shorter), -1.0)


def _worst_beyond(scene: Scene, snapshot: Snapshot) -> int | None:
    excess = _excess(scene, snapshot)
    worst = int(np.argmax(excess)) if len(excess) else 0
    return worst if len(excess) and excess[worst] >= 0.0 else None


def _side(scene: Scene, connector: int, length: float) -> str:
    limits = scene.connectors.limits
    assert limits is not None
    longest = np.broadcast_to(limits.longest, (scene.connector_count,))[connector]
    return EXTENSION if length >= longest else COMPRESSION
