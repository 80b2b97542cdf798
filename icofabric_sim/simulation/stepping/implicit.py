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
Steps by diagonally implicit Runge-Kutta methods, each stage solved by Newton's method.

Stable for steps of any length: what is damped or vibrates faster than a step is not followed, but
does not grow. The matrix of the stages is that of the state that was saved last, so that it
follows from the state alone, and serves until the next health check; where it does not lead to the
solution fast enough it is made anew on the way there.
"""

from collections.abc import Callable
import math
from typing import NamedTuple

from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.integrators.diagonal import (
    end_stage,
    end_step,
    residual,
    take_velocities,
    to_stage,
)
from icofabric_sim.kernels.integrators.embedded import look, slope_at
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
# Matrices that are kept: of the step, of its halves in trials, and of steps that inputs cut.
_KEPT = 3


class Tableau(NamedTuple):
    """A diagonally implicit method: the same diagonal in all stages, so one matrix serves all."""

    diagonal: float
    stages: tuple[np.ndarray, ...]  # weights of the slopes before each, (0,), (1,), ...
    step: np.ndarray


TABLEAUS = {
    'implicit_midpoint': Tableau(0.5, (np.zeros(0),), np.ones(1)),
    # Hairer and Wanner 1996, Solving Ordinary Differential Equations II, table IV.6.5.
    'sdirk4': Tableau(
        0.25,
        tuple(np.array(row) for row in (
            (), (1 / 2,), (17 / 50, -1 / 25), (371 / 1360, -137 / 2720, 15 / 544),
            (25 / 24, -49 / 48, 125 / 16, -85 / 12))),
        np.array([25 / 24, -49 / 48, 125 / 16, -85 / 12, 1 / 4])),
}


class _Kept(NamedTuple):
    """Factors for a time g [s], and the state whose they are."""

    time: float
    state: State
    factors: Factors


class ImplicitSteps:
    """Takes steps of a fabric by a diagonally implicit method."""

    def __init__(self, scene: Scene, packed: PackedScene, tableau: Tableau) -> None:
        """Solve for the bodies of a scene."""
        self._tableau = tableau
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
        tableau, slopes, base = self._tableau, trail.slopes, trail.start
        g = tableau.diagonal * h
        take_velocities(model, state, self._velocity)
        for number, weights in enumerate(tableau.stages):
            end_stage(model, state, slopes, weights, h, base)
            time = start + (float(weights.sum()) + tableau.diagonal) * h

            def look_at(
                velocity: np.ndarray, *, base: State = base, number: int = number,
                time: float = time
            ) -> np.ndarray:
                to_stage(model, base, velocity, g, trail.stage)
                slope_at(
                    model, loads, trail.stage, work, trail, np.int64(number), team, watch, time,
                    0, last)
                residual(model, base, velocity, slopes[number], g, self._residual)
                return self._layout.gather(self._residual) * self._free

            if not self._solve(look_at, model, saved, trail.stage, work, g):
                return False
        end_step(model, state, slopes, tableau.step, h)
        add_work(loads, h, tableau.step, 0, last)
        add_flow(work.spent, model.blocks.slot, h, tableau.step, 0, last)
        return True

    def _solve(
        self, look_at: Callable[[np.ndarray], np.ndarray], model: Model, saved: State,
        stage: State, work: Work, g: float
    ) -> bool:
        """
        Find velocities of a stage by Newton's method from the present ones; whether they are found.

        `look_at` returns the residual (n, 6) that velocities (6, s) leave.
        """
        velocity = self._velocity
        factors, own, before = self._factors(model, saved, work, g), False, math.inf
        left = look_at(velocity)
        size = self._size(left)
        for _ in range(_MOST):
            if not math.isfinite(size):
                return False
            change = factors.solve((left * self._root).ravel()).reshape(left.shape) / self._root
            correction = g * float(np.abs(change * self._part).max(initial=0.0))
            if not math.isfinite(correction):
                return False
            is_slow = correction > _SLOW * before
            if is_slow and correction <= _ROUNDED:
                return True
            if is_slow and not own:
                # The velocities are those of the last look.
                factors, own, before = self._matrix.factors(model, stage, work.points, g), (
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
                return True
        return False

    def _size(self, left: np.ndarray) -> float:
        """Of a residual, as energies count it."""
        with np.errstate(over='ignore', invalid='ignore'):
            return float(np.sqrt(((left * self._root)**2).sum()))

    def _factors(self, model: Model, saved: State, work: Work, g: float) -> Factors:
        """Factors for a time `g` [s], of the state that was saved last."""
        for kept in self._kept:
            if kept.time == g and all(
                    np.array_equal(one, other) for one, other in zip(kept.state, saved)):
                return kept.factors
        place_all(model, saved, work, 0, len(model.blocks.slot))
        found = _Kept(
            g, State(*(part.copy() for part in saved)),
            self._matrix.factors(model, saved, work.points, g))
        self._kept = [kept for kept in self._kept if kept.time != g][1 - _KEPT:] + [found]
        return found.factors


def implicit_method(scene: Scene, packed: PackedScene, name: str) -> Method:
    """Return the method `name` with the steps of a scene."""
    return METHODS[name]._replace(
        advance=ImplicitSteps(scene, packed, TABLEAUS[name]).advance)
