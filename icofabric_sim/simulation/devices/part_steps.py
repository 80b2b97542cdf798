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
"""
Steps of one rank's part of a fabric, each evaluation of the forces beside those of the others.

The same steps as those of kernels/integrators/splitting.py, in the same order for every body. Its
loop over evaluations stands here, because poses travel in each: the blocks that others need drift
first, their poses leave, the inner blocks are drifted and pushed, and the rest is pushed once the
poses of the others have come.
"""

from typing import NamedTuple

from icofabric_sim.kernels.flows import drift, push_kept
from icofabric_sim.kernels.integrators.splitting import NEVER
from icofabric_sim.kernels.monitor import INVERSE_SIZE, LEDGER_COUNT, roughness, sample
from icofabric_sim.kernels.records import Loads, Model, State, Work
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.kernels.runtime.team import TILE
from icofabric_sim.simulation.devices.rank_kernels import (
    drift_and_push,
    POSE,
    put_poses,
    take_poses,
)
from icofabric_sim.simulation.devices.transport import Transport
from icofabric_sim.simulation.devices.window import Exchange
from icofabric_sim.simulation.model.layout import aligned_empty
import numpy as np


class Weights(NamedTuple):
    """What a rank has to know of a method and of how its steps are judged."""

    kicks: np.ndarray
    drifts: np.ndarray
    differences: int  # order of those by which the roughness of the motion is judged; 0: it is not
    pascal: np.ndarray  # (differences + 1,) binomial coefficients of these
    inverse_size: float  # 1 / a^2 [1/m^2]

    @property
    def stages(self) -> int:
        """Count the evaluations of the forces in a step."""
        return min(len(self.kicks), len(self.drifts))


class Stretch(NamedTuple):
    """Steps without a health check in between: what all ranks take together."""

    origin: float  # [s]
    first: int  # number of the first one from there
    step: float  # [s]
    steps: int
    since_check: int
    check_interval: int

    @property
    def is_checked(self) -> bool:
        """Whether they are steps of the run, not of a trial."""
        return self.check_interval < NEVER


class Arrays(NamedTuple):
    """What steps change."""

    # None: nothing acts on any body of the fabric, and steps have loops of their own, as in
    # splitting.py.
    loads: Loads | None
    state: State
    work: Work


class PartSteps:
    """Takes steps of a part, with the poses of its neighbours."""

    def __init__(
        self, transport: Transport, model: Model, exchange: Exchange, weights: Weights
    ) -> None:
        """Step the blocks of the `exchange` in the arrays of `model`."""
        self._transport, self._model = transport, model
        self._exchange, self._weights = exchange, weights
        self._gives = [
            (rank, slots, _room(len(slots))) for rank, slots in exchange.gives]
        self._needs = [
            (rank, slots, _room(len(slots))) for rank, slots in exchange.needs]
        border = exchange.drifts[:exchange.border]
        self._tiles = np.full(-(-len(border) // TILE), len(exchange.drifts), np.int32)
        self._border = np.ascontiguousarray(border)
        # Differences of the motion in the samples of this part, and the roughest since asked.
        self.difference = aligned_empty((POSE, LANES * len(exchange.samples)))
        self.difference[:] = 0.0
        self._ledger = np.zeros(LEDGER_COUNT)
        self._ledger[INVERSE_SIZE] = weights.inverse_size
        self.roughest = 0.0

    def take(self, arrays: Arrays, stretch: Stretch) -> None:
        """Take the steps of a stretch; samples of the roughness are taken on the way."""
        differences, done, since = self._weights.differences, 0, stretch.since_check
        while done < stretch.steps:
            ahead, sampled = stretch.steps - done, -1
            if differences and stretch.is_checked:
                # Windows as in `splitting`: step ends in sequence, and of the leapfrog only the
                # last before a health check.
                sampled = since - (
                    stretch.check_interval - differences if self._weights.stages < 4 else 0)
                ahead = 1 if sampled >= 0 else min(ahead, -sampled)
            if sampled >= 0 and sampled % differences == 0:
                self._sample(arrays, 0)
            self._steps(arrays, stretch, stretch.first + done, ahead)
            done += ahead
            since += ahead
            if sampled >= 0:
                self._sample(arrays, sampled % differences + 1)

    def take_roughest(self) -> float:
        """Return how rough the motion was at most since this was asked last."""
        found, self.roughest = self.roughest, 0.0
        return found

    def make_ready(self, arrays: Arrays) -> None:
        """Compile what steps need, or load it: with nothing to do."""
        loads, state, work = arrays
        none, nobody = np.zeros(0, np.uint32), np.zeros(0, np.int32)
        push_kept(self._model, loads, state, work, 0.0, 0.0, 0, 0)
        drift(self._model, loads, state, work, 0.0, 0.0, none, 0, 0)
        drift_and_push(
            self._model, loads, state, work, 0.0, 0.0, 0.0, 0.0, 0.0, False, none, 0, none, nobody)
        take_poses(state, nobody, _room(0))
        put_poses(self._model, state, work, nobody, _room(0))
        if self._weights.differences:
            sample(nobody, state.position, state.orientation, _room(0), work.weights, 0)
            roughness(work._replace(difference=_room(0)), self._ledger)

    def _steps(self, arrays: Arrays, stretch: Stretch, index: int, count: int) -> None:
        """Take `count` steps from `index` on, as `steps` of splitting.py does."""
        model, exchange, (loads, state, work) = self._model, self._exchange, arrays
        kicks, drifts = self._weights.kicks, self._weights.drifts
        origin, h = stretch.origin, stretch.step
        kick_first, stages = len(kicks) > len(drifts), self._weights.stages
        if kick_first:
            push_kept(
                model, loads, state, work, origin + index * h, kicks[0] * h, exchange.first,
                exchange.last)
        now = 0.0
        for evaluation in range(count * stages):
            stage, step = evaluation % stages, index + evaluation // stages
            if stage == 0:
                now = origin + step * h
            whole = drifts[stage] * h
            after = now + whole
            if kick_first and stage + 1 == stages:
                after = origin + (step + 1) * h
            kick, again, keep = kicks[stage] * h, 0.0, False
            if kick_first:
                kick = kicks[stage + 1] * h
                keep = evaluation + 1 == count * stages
                if stage + 1 == stages and not keep:
                    again = kicks[0] * h
            self._evaluate(arrays, now, whole, after, kick, again, keep)
            now = after
            if not kick_first and stage + 1 == stages:
                drift(
                    model, loads, state, work, now, drifts[stages] * h, exchange.drifts, 0,
                    len(exchange.drifts))

    def _evaluate(
        self, arrays: Arrays, now: float, whole: float, after: float, kick: float, again: float,
        keep: bool
    ) -> None:
        """One drift and the push after it; poses travel while inner blocks are computed."""
        model, exchange, transport = self._model, self._exchange, self._transport
        loads, state, work = arrays
        drift(model, loads, state, work, now, whole, exchange.drifts, 0, exchange.border)
        requests = [transport.receive_poses(poses, rank) for rank, _, poses in self._needs]
        for rank, slots, poses in self._gives:
            take_poses(state, slots, poses)
            requests.append(transport.send_poses(poses, rank))
        drift_and_push(
            model, loads, state, work, now, whole, after, kick, again, keep, exchange.drifts,
            exchange.border, exchange.inner, exchange.ahead)
        transport.wait(requests)
        for _, slots, poses in self._needs:
            put_poses(model, state, work, slots, poses)
        drift_and_push(
            model, loads, state, work, now, whole, after, kick, again, keep, exchange.drifts,
            len(exchange.drifts), self._border, self._tiles)

    def _sample(self, arrays: Arrays, number: int) -> None:
        if not len(self._exchange.samples):
            return
        state, work = arrays.state, arrays.work
        sample(
            self._exchange.samples, state.position, state.orientation, self.difference,
            work.weights, number)
        if number == self._weights.differences:
            self.roughest = max(
                self.roughest,
                roughness(work._replace(difference=self.difference), self._ledger))


def _room(blocks: int) -> np.ndarray:
    return aligned_empty((POSE, LANES * blocks))
