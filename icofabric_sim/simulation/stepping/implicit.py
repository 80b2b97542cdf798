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
Steps by the implicit midpoint rule, each solved by Newton's method.

Stable for steps of any length: what vibrates or is damped faster than a step is not followed, but
does not grow. The matrix of the step is that of the state that was saved last, so that it follows
from the state alone, and serves until the next health check; where it does not lead to the
solution fast enough it is made anew on the way there.
"""

import math
from typing import NamedTuple

from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.integrators.embedded import FIRST, look, slope_at
from icofabric_sim.kernels.integrators.midpoint import (
    finish,
    residual,
    take_velocities,
    to_middle,
)
from icofabric_sim.kernels.integrators.splitting import NEVER
from icofabric_sim.kernels.loads import keep_work
from icofabric_sim.kernels.meters import add_flow
from icofabric_sim.kernels.records import Loads, Model, State, Team, Watch, Work
from icofabric_sim.kernels.rhs import add_work, place_blocks
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.errors import ElsewhereError
from icofabric_sim.simulation.model.layout import aligned_empty
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.model.velocity_matrix import Factors, VelocityMatrix
from icofabric_sim.simulation.stepping.methods import Method, METHODS
import numpy as np

# Corrections of a step, in parts of a or rad, that are small enough; where rounding is larger, so
# that they do not shrink, the second.
_SOLVED, _ROUNDED = 1e-13, 1e-9
# A correction that is not smaller than this part of the one before asks for a matrix of its own.
_SLOW = 0.2
_MOST, _HALVINGS = 40, 12
# How often a chosen step that cannot be solved is halved.
_PARTS = 10
_WHOLE = np.ones(1)
# Matrices that are kept: of the step, of its halves in trials, and of steps that inputs cut.
_KEPT = 3


class _Kept(NamedTuple):
    """Factors for a step [s], and the state whose they are."""

    step: float
    state: State
    factors: Factors


class MidpointSteps:
    """Takes steps of a fabric by the implicit midpoint rule."""

    def __init__(self, scene: Scene, packed: PackedScene) -> None:
        """Solve for the bodies of a scene."""
        self._given = scene.parameters['solver.step'] > 0.0
        driven = [drive.bodies for drive in scene.drives.values()]
        bodies = np.concatenate([np.zeros(0, np.int64), *driven])
        self._layout, self._half_edge = packed.layout, scene.geometry.half_edge
        self._matrix = VelocityMatrix(packed, scene.weave.grid, bodies)
        self._free = np.ones((packed.layout.body_count, 6))
        self._free[bodies] = 0.0
        self._root = np.sqrt(np.repeat(
            [1.0 / packed.model.inverse_mass, 1.0 / packed.model.inverse_inertia], 3))
        # What a velocity moves in a second, in parts of a and rad.
        self._part = np.repeat([1.0 / self._half_edge, 1.0], 3)
        slots = packed.layout.slot_count
        self._velocity, self._residual = (aligned_empty((6, slots)) for _ in range(2))
        self._velocity[:] = self._residual[:] = 0.0
        self._kept: list[_Kept] = []

    def advance(
        self, model: Model, loads: Loads, state: State, saved: State, work: Work, team: Team,
        origin: float, index: int, h: float, count: int, since_check: int, check_interval: int,
        watch: Watch | None, ledger: np.ndarray
    ) -> tuple[int, int, int]:
        """Take up to `count` steps of `h` [s] from origin + index h [s] on, as `splitting`."""
        last, done = len(model.blocks.slot), 0
        while done < count:
            start, end = origin + (index + done) * h, origin + (index + done + 1) * h
            is_trial = check_interval >= NEVER
            parts = 0 if self._given or is_trial else _PARTS
            if not self._step(model, loads, state, saved, work, team, watch, start, h, parts):
                if is_trial:
                    # Steps of this length are none.
                    state.position[:] = math.inf
                    return 0, count, since_check
                raise ElsewhereError(
                    f'the equations of a step of {h:.6g} s from t = {start:.9g} s on could '
                    'not be solved' + (
                        '; take a smaller solver.step, or 0 to have it chosen' if self._given
                        else f', nor those of steps {2**_PARTS} times as short; take another '
                        'solver.method'))
            place_blocks(model, loads, state, work, end, 0, last)
            done += 1
            since_check += 1
            status, since_check = look(
                model, loads, state, saved, work, team, since_check, check_interval, watch,
                ledger, done, end, h, 0, last)
            if since_check == 0 and status == 0:
                keep_work(loads, 0, last)
            if status != 0:
                return int(status), done, int(since_check)
        return 0, done, int(since_check)

    def _step(
        self, model: Model, loads: Loads, state: State, saved: State, work: Work, team: Team,
        watch: Watch | None, start: float, h: float, parts: int
    ) -> bool:
        """
        Take a step of `h` [s] from `start` [s] on; whether it could be solved.

        One that cannot be is taken as two halves, and these, up to `parts` times.
        """
        if self._whole(model, loads, state, saved, work, team, watch, start, h):
            return True
        return parts > 0 and all(
            self._step(model, loads, state, saved, work, team, watch, begin, 0.5 * h, parts - 1)
            for begin in (start, start + 0.5 * h))

    def _whole(
        self, model: Model, loads: Loads, state: State, saved: State, work: Work, team: Team,
        watch: Watch | None, start: float, h: float
    ) -> bool:
        """Take it as one step, or none."""
        trail, last = work.trail, len(model.blocks.slot)
        assert trail is not None
        middle, slope, velocity = trail.stage, trail.slopes[0], self._velocity
        take_velocities(model, state, velocity)
        factors, own, before = self._factors(model, saved, work, h), False, math.inf

        def look_at(velocity: np.ndarray) -> np.ndarray:
            to_middle(model, state, velocity, h, middle)
            slope_at(
                model, loads, middle, work, trail, FIRST, team, watch, start + 0.5 * h, 0, last)
            residual(model, state, velocity, slope, h, self._residual)
            return self._layout.gather(self._residual) * self._free

        left = look_at(velocity)
        size = self._size(left)
        for _ in range(_MOST):
            if not math.isfinite(size):
                return False
            change = factors.solve((left * self._root).ravel()).reshape(left.shape) / self._root
            correction = h * float(np.abs(change * self._part).max(initial=0.0))
            if not math.isfinite(correction):
                return False
            is_slow = correction > _SLOW * before
            if is_slow and correction <= _ROUNDED:
                break
            if is_slow and not own:
                # The velocities are those of the last look.
                factors, own, before = self._matrix.factors(model, middle, work.points, h), (
                    True), math.inf
                continue
            before, own = correction, False
            part = 1.0
            for _ in range(_HALVINGS):
                other = velocity - part * self._layout.spread(change)
                found = look_at(other)
                found_size = self._size(found)
                # Near the solution rounding decides.
                if found_size < size or part * correction <= _ROUNDED:
                    break
                part *= 0.5
            else:
                return False
            velocity[:] = other
            left, size = found, found_size
            if correction <= _SOLVED:
                break
        else:
            return False
        finish(model, state, velocity, slope, h)
        add_work(loads, h, _WHOLE, 0, last)
        add_flow(work.spent, model.blocks.slot, h, _WHOLE, 0, last)
        return True

    def _size(self, left: np.ndarray) -> float:
        """Of a residual, as energies count it."""
        with np.errstate(over='ignore', invalid='ignore'):
            return float(np.sqrt(((left * self._root)**2).sum()))

    def _factors(self, model: Model, saved: State, work: Work, h: float) -> Factors:
        """Factors for steps of `h` [s], of the state that was saved last."""
        for kept in self._kept:
            if kept.step == h and all(
                    np.array_equal(one, other) for one, other in zip(kept.state, saved)):
                return kept.factors
        place_all(model, saved, work, 0, len(model.blocks.slot))
        found = _Kept(
            h, State(*(part.copy() for part in saved)),
            self._matrix.factors(model, saved, work.points, h))
        self._kept = [kept for kept in self._kept if kept.step != h][1 - _KEPT:] + [found]
        return found.factors


def implicit_method(scene: Scene, packed: PackedScene, name: str) -> Method:
    """Return the method `name` with the steps of a scene."""
    return METHODS[name]._replace(advance=MidpointSteps(scene, packed).advance)
