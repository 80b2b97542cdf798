# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""A slab whose held bodies move step by step, from one equilibrium to the next."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.statics.equilibrium import Equilibrium, seek_on_path, solve_equilibrium
from icofabric_sim.statics.fabric import StaticFabric
from icofabric_sim.statics.friction import FrictionPath
from icofabric_sim.statics.held_motion import HeldMotion
import numpy as np

EXTENSION, COMPRESSION = 'extension', 'compression'


class Break(NamedTuple):
    """A connector that has broken."""

    connector: int
    amount: float  # strain, or angle [rad], at which it was beyond its break length
    side: str  # 'extension' or 'compression'
    length: float  # [m] when it broke
    released: float  # [J] by which the energy falls when the fabric comes to rest without it


class Step(NamedTuple):
    """One amount, and where the slab rests there."""

    amount: float
    found: Equilibrium
    conjugate: float  # derivative of the energy by the amount [J]
    before_breaks: float  # the same before anything broke at this amount
    breaks: tuple[Break, ...]  # at this amount, in their order


class Tally(NamedTuple):
    """What is counted of a state."""

    obstructed: int  # connectors that lead through a shell of their own, or lie around it
    beyond: int  # connectors beyond the length at which they break
    broken: int  # connectors that have broken so far
    touching: int  # pairs of shells that push each other
    sliding: int  # of these, pairs that slide (contact.friction)
    at_kink: int  # connectors at their natural length, where k_e is not k_c
    # Connectors that are there before anything moves, or have come to the other side since.
    past_kink: int


def follow(
    motion: HeldMotion, amounts: Iterable[float], rest: 'Rest | None' = None
) -> Iterator[Step]:
    """
    Equilibria with the held bodies where amounts put them, each sought from the one before.

    Of the connectors beyond their break lengths the one that is farthest beyond breaks for good,
    and the search goes on, until none is (the quasi-static order of de Arcangelis, Redner and
    Herrmann 1985, J. Phys. Lett. 46, L585). What touches sticks and slides with friction, of which
    there is none at `rest`, the slab before anything moves (None: it is sought where it is
    needed). Ends where no equilibrium is found.
    """
    done: list[tuple[float, Snapshot]] = []
    path = FrictionPath.of(motion.scene)
    if path is not None:
        # What touches before anything moves has not slipped yet.
        found = (rest or Rest(motion)).found
        if found.converged:
            path, done = _begun(path, motion, found), [(0.0, found.snapshot)]
    for amount in amounts:
        here = motion.placed(amount)
        found, next_path = seek_on_path(
            here, path, start=_ahead(done, amount), body_force=motion.body_force)
        before = motion.conjugate(amount, found.reaction)
        breaks: list[Break] = []
        while found.converged and (worst := _worst_beyond(here, found.snapshot)) is not None:
            last = found.snapshot
            since = last.break_time.copy()
            since[worst] = 0.0
            found, next_path = seek_on_path(
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


class Rest:
    """The slab before anything moves."""

    def __init__(self, motion: HeldMotion) -> None:
        """Note on which sides of their kinks the connectors are."""
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

    def tally(self, found: Equilibrium) -> Tally:
        """Count what has happened since."""
        now = found.snapshot
        past = self._kinked & now.intact & (self._longer != (now.connector_length > self._rest))
        past[self._at_kink] = True
        return Tally(
            int(np.count_nonzero(now.obstructed)),
            int(np.count_nonzero(_excess(self._scene, now) >= 0.0)),
            int(np.count_nonzero(~now.intact)),
            0 if found.touching is None else len(found.touching.pairs),
            0 if found.rubbing is None else int(np.count_nonzero(found.rubbing.slides)),
            len(found.at_kink), int(np.count_nonzero(past)))


def _begun(path: FrictionPath, motion: HeldMotion, rest: Equilibrium) -> FrictionPath:
    """Friction of what touches at rest, before anything has slipped."""
    fabric = StaticFabric(motion.scene, friction=path)
    here = fabric.configuration('start', rest.snapshot)
    assert fabric.contacts is not None
    return path.advanced(fabric.contacts, here.position, here.axes)


def tension_range(found: Equilibrium) -> tuple[float, float]:
    """Least and largest tension [N] of connectors; below 0: they push."""
    return float(found.tension.min(initial=np.inf)), float(found.tension.max(initial=-np.inf))


def _ahead(done: list[tuple[float, Snapshot]], amount: float) -> Snapshot | None:
    """Where to begin: on from the last two states, as far as the amount goes."""
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
    """How far the unbroken connectors are beyond their break lengths, over those, (c,)."""
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
