# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Steps by diagonally implicit Runge-Kutta methods, with stages solved by Newton's method.

Steps of any length are stable: motion that decays or vibrates faster than a step is not resolved,
but does not grow. The matrix of the stages is that of the last saved state, so it follows from the
state alone. The matrix serves until the next health check; if convergence is too slow, a new
matrix is computed in between.
"""

from collections.abc import Callable
import math
from typing import Any, NamedTuple

from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.integrators.bodies import bodies_of, check_health, slope_at
from icofabric_sim.kernels.integrators.diagonal import (
    end_stage,
    end_step,
    place_paths,
    residual,
    stage_error,
    take_velocities,
    to_stage,
)
from icofabric_sim.kernels.integrators.embedded import (
    CLEAR_TOTAL,
    CLOSE,
    FLOOR,
    GOAL,
    HELD,
    HOLD,
    IS_CLEAR,
    KINK,
    LAST,
    LENGTH,
    LIST_FULL,
    LONGEST_STEP,
    NEXT,
    RATE,
    REFUSED,
    SCALES,
    SHORTEST_STEP,
    START,
    TOLERANCE,
    TOO_FAR,
    TOO_SHORT,
    TOTAL,
)
from icofabric_sim.kernels.integrators.splitting import NEVER
from icofabric_sim.kernels.loads import keep_work
from icofabric_sim.kernels.monitor import least_scale, LIMIT, save
from icofabric_sim.kernels.records import Loads, Model, State, Team, Trail, Work
from icofabric_sim.kernels.rhs import add_work, path_error, place_blocks
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.errors import ElsewhereError
from icofabric_sim.simulation.model.layout import aligned_empty, copied_state
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.model.velocity_matrix import Factors, freedom_masses, VelocityMatrix
from icofabric_sim.simulation.stepping.embedded_kernels import EmbeddedKernels
from icofabric_sim.simulation.stepping.methods import facts_of, Method
from icofabric_sim.terms.contacts.clearance import CLEAR, find_clear, NEAR_CONTACT, NO_ROOM
from icofabric_sim.terms.contacts.displacement import forget_ways, has_missed, LATE, ways_of
from icofabric_sim.terms.contacts.rebuild_check import can_look_farther
from icofabric_sim.terms.contacts.record import Watch
from icofabric_sim.terms.meters import add_flow
import numpy as np

# Sufficiently small corrections of a stage, over a or in rad: the first value, or the second ratio
# to the allowed error of a chosen step; the third value if round-off stops convergence.
_SOLVED, _SOLVED_PART, _ROUNDING_LIMIT = 1e-13, 1e-3, 1e-9
# Ratio of successive corrections above which a new matrix is computed.
_SLOW_RATIO = 0.2
_MAX_CORRECTIONS, _HALVINGS = 40, 12
# Intended error over the tolerance, and limits of the ratio of successive steps; steps that would
# grow by less than the last ratio do not change. Below: the largest ratio after a rejected step.
_TARGET_RATIO, _SHRINK, _GROW, _WORTH = 0.4, 0.2, 4.0, 1.4
_LESS = 0.5
# Ratio of the estimate, of order 3, to the error of order 4, and its exponent.
_ESTIMATE, _POWER = 3.0, 1.0 / 3.0
# No limit.
_ANY = 1e300
# Most bisections of a chosen step without solution.
_PARTS = 16
# Allowed energy error of a step over solver.energy_limit.
_LOST = 0.05
# Number of short steps after one that may have missed a contact, and the most if the next long
# step is rejected, too.
_HOLD, _LONGEST_HOLD = 8.0, 64.0
# Largest depth of a contact between stages of a step, over the displacement of bodies in the step.
_GRAZE = 0.01
# Cached matrices: of the step, of its halves in trials, and of steps that inputs end.
_KEPT_MATRIX_COUNT = 3


def _even(h: float) -> float:
    """Return the nearest power of the root of 2 below a length [s]."""
    return 2.0 ** (math.floor(2.0 * math.log2(h)) / 2.0)


def _trail(work: Work) -> Trail:
    """Return the arrays of the stages, which exist."""
    assert work.trail is not None
    return work.trail


class _Ways:
    """Squared displacements [m^2] in a step, and the largest one in its evaluations."""

    def __init__(self, watch: Watch | None) -> None:
        """Continue from the contacts that the `watch` has noted."""
        self._far = np.zeros(1) if watch is None else watch.far
        self._most = self._last = self.looked = float(self._far[0])

    def begin(self) -> None:
        """Start another evaluation."""
        self._far[0] = 0.0

    def end(self) -> None:
        """End the evaluation."""
        self._last = float(self._far[0])
        self.looked = max(self.looked, self._last)
        self._far[0] = self._most

    def accept(self) -> None:
        """Accept the last evaluation as that of a stage."""
        self._far[0] = self._most = max(self._most, self._last)


class Tableau(NamedTuple):
    """A diagonally implicit method with equal diagonals, so that one matrix serves all stages."""

    diagonal: float
    stages: tuple[np.ndarray, ...]  # weights of the slopes before each, (0,), (1,), ...
    step: np.ndarray
    # The same less those of the embedded method, and weights by powers of the part of a step, from
    # the first on, for states within it; None: there is no embedded method.
    error: np.ndarray | None
    dense: np.ndarray | None
    # Weights of the step less those of a rule of higher order for integrals over the step, which
    # has the start of the step as its last node.
    integral_error: np.ndarray | None


TABLEAUS = {
    # Hairer and Wanner 1996, Solving Ordinary Differential Equations II, table IV.6.5.
    'sdirk4': Tableau(
        0.25,
        tuple(np.array(row) for row in (
            (), (1 / 2,), (17 / 50, -1 / 25), (371 / 1360, -137 / 2720, 15 / 544),
            (25 / 24, -49 / 48, 125 / 16, -85 / 12))),
        np.array([25 / 24, -49 / 48, 125 / 16, -85 / 12, 1 / 4]),
        np.array([-3 / 16, -27 / 32, 25 / 32, 0.0, 1 / 4]),
        np.array([
            [11 / 3, 11 / 2, -125 / 18, 0.0, -11 / 9],
            [-463 / 72, -385 / 16, 20125 / 432, -85 / 4, 557 / 108],
            [217 / 36, 661 / 24, -8875 / 216, 85 / 6, -359 / 54],
            [-20 / 9, -10.0, 250 / 27, 0.0, 80 / 27]]),
        # The rule of Boole.
        np.array([
            25 / 24 - 32 / 90, -49 / 48 - 32 / 90, 125 / 16, -85 / 12 - 12 / 90, 1 / 4 - 7 / 90,
            -7 / 90])),
}


class _Kept(NamedTuple):
    """Factors for a time g [s], and their state."""

    time: float
    state: State
    factors: Factors | None


def _can_press(model: Model, loads: Loads) -> bool:
    """Return True if driven bodies may press on others: shells near each other or a plane."""
    return loads.drives is not None and model.contacts is not None


class ImplicitSteps:
    """Steps of a fabric by a diagonally implicit method."""

    def __init__(self, scene: Scene, packed: PackedScene, tableau: Tableau) -> None:
        """Prepare to solve for the bodies of a scene."""
        self._tableau = tableau
        self._given = scene.parameters['solver.step'] > 0.0
        self._solved = 0.0 if self._given else _SOLVED_PART * scene.parameters['solver.tolerance']
        driven = [drive.bodies for drive in scene.drives.values()]
        bodies = np.concatenate([np.zeros(0, np.int64), *driven])
        self._layout, self._half_edge = packed.layout, scene.geometry.half_edge
        self._free = np.ones((packed.layout.body_count, 6))
        self._free[bodies] = 0.0
        held = self._free == 0.0
        if scene.supports is not None:
            held[:, :3] |= scene.supports.translation
            held[:, 3:] |= scene.supports.rotation[:, None]
        self._matrix = VelocityMatrix(packed, scene.weave.grid, held)
        self._root = np.sqrt(freedom_masses(packed))
        # What a velocity moves in a second, in parts of a and rad.
        self._part = np.repeat([1.0 / self._half_edge, 1.0], 3)
        self._base = packed.layout.like(packed.layout.pack(scene.initial))
        slots = packed.layout.slot_count
        self._velocity, self._residual, self._change = (
            aligned_empty((6, slots)) for _ in range(3))
        self._velocity[:] = self._residual[:] = self._change[:] = 0.0
        self._kept: list[_Kept] = []
        self._has_touched = False
        self._evaluations = 0  # of the forces, since they were counted last

    def count_evaluations(self) -> int:
        """Return the number of force evaluations since the last call."""
        count, self._evaluations = self._evaluations, 0
        return count

    @property
    def kept_slopes(self) -> tuple[int, ...] | None:
        """Numbers of the slopes that states within a step need; None without such states."""
        return None if self._tableau.dense is None else tuple(range(len(self._tableau.stages)))

    def advance(
        self, model: Model, loads: Loads, state: State, saved: State, work: Work, team: Team,
        origin: float, index: int, h: float, count: int, since_check: int, check_interval: int,
        watch: Watch | None, ledger: np.ndarray
    ) -> tuple[int, int, int]:
        """Take up to `count` steps of `h` [s] from origin + index h [s] on, as `splitting`."""
        last, done = len(model.blocks.slot), 0
        while done < count:
            start, end = origin + (index + done) * h, origin + (index + done + 1) * h
            parts = 0 if self._given else _PARTS
            if not self._step(
                    model, loads, state, saved, work, team, watch, start, h, parts, ledger):
                if check_interval >= NEVER:
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
            status, since_check = check_health(
                bodies_of(model, loads, state, saved, work, team, watch), since_check,
                check_interval, ledger, done, end, h)
            if since_check == 0 and status == 0:
                keep_work(loads, 0, last)
            if status != 0:
                return int(status), done, int(since_check)
        return 0, done, int(since_check)

    def take(
        self, model: Model, loads: Loads, state: State, saved: State, work: Work, team: Team,
        control: np.ndarray, count: int, since_check: int, check_interval: int,
        watch: Watch | None, ledger: np.ndarray
    ) -> tuple[int, int, int]:
        """
        Take up to `count` steps until one ends after control[GOAL], as `adaptive_pair`.

        Steps are also rejected if their probable error of energy is too large, or that of the work
        of paths during contacts. Lengths are powers of the root of 2, so that a matrix serves more
        steps.
        """
        trail, last = _trail(work), len(model.blocks.slot)
        weights, error_weights = self._tableau.step, self._tableau.error
        assert error_weights is not None
        turn_rows, scales = trail.slopes.shape[1] - 9, control[SCALES:]
        tolerance = float(max(control[TOLERANCE], control[FLOOR]))
        done = status = 0
        while done < count and control[START] + control[LENGTH] <= control[GOAL] and not status:
            start, h = float(control[START] + control[LENGTH]), float(control[NEXT])
            accepted = False
            begins_touching = self._begins_touching(
                model, loads, state, work, trail, team, watch, start)
            while not accepted and not status:
                error, change = math.inf, _SHRINK
                self._has_touched = begins_touching
                forget_ways(watch, 0)
                ways = _Ways(watch)
                if self._find_stages(
                        model, loads, state, saved, work, team, watch, start, h, ways):
                    end_step(model, state, trail.slopes, weights, h, trail.stage)
                    ways_of(watch, model.blocks, trail.stage, start + h, 0, 0, last)
                    error = _ESTIMATE * max(
                        stage_error(model, trail.slopes, error_weights, turn_rows, scales),
                        self._work_error(model, loads, trail, turn_rows, float(scales[2])))
                # Steps must not depend on which contacts were known where it was looked.
                if watch is not None and can_look_farther(watch, start) and (
                        ways.looked > watch.limits[LATE] or has_missed(watch, 0)):
                    watch.far[0] = max(watch.far[0], ways.looked)
                    return TOO_FAR, done, since_check
                if has_missed(watch, 0):
                    error = math.inf
                if tolerance < _ANY and error < math.inf:
                    error = max(error, tolerance * self._energy_part(state, work, ledger, h))
                    change = min(_GROW, max(_SHRINK, (
                        _TARGET_RATIO * tolerance / max(error, 1e-300)) ** _POWER))
                accepted = error <= tolerance or (h <= control[KINK] and error < math.inf)
                if accepted and h > control[CLOSE]:
                    clear = self._find_clear(
                        model, state, trail, team, watch, start, h, tolerance)
                    if clear == NO_ROOM:
                        return LIST_FULL | TOO_FAR, done, since_check
                    hold = max(float(control[HOLD]), _HOLD)
                    if clear == NEAR_CONTACT:
                        accepted = False
                        control[HELD], control[HOLD] = hold, min(2.0 * hold, _LONGEST_HOLD)
                    else:
                        control[HOLD] = _HOLD
                if accepted:
                    control[HELD] = max(control[HELD] - 1.0, 0.0)
                    self._accept(model, loads, state, work, control, error, start, h)
                else:
                    control[REFUSED] += 1.0
                    if h <= control[SHORTEST_STEP]:
                        status = TOO_SHORT
                    change = min(change, _LESS)
                if tolerance < _ANY:
                    h = _even(h * change) if change < 1.0 or change >= _WORTH else h
                    if control[HELD] > 0.0:
                        h = min(h, _even(float(control[CLOSE])))
                h = min(max(h, float(control[SHORTEST_STEP])), float(control[LONGEST_STEP]))
                control[NEXT] = h
            if not status:
                slope_at(
                    model, loads, state, work, trail, LAST, team, watch,
                    float(control[START] + control[LENGTH]), 0, last)
                self._evaluations += 1
                done += 1
                since_check += 1
                status, since_check = check_health(
                    bodies_of(model, loads, state, saved, work, team, watch), since_check,
                    check_interval, ledger, done, float(control[START] + control[LENGTH]), 0.0)
        return int(status), done, int(since_check)

    def _begins_touching(
        self, model: Model, loads: Loads, state: State, work: Work, trail: Trail, team: Team,
        watch: Watch | None, start: float
    ) -> bool:
        """Compute the power of paths at the start of a step; return True with contacts."""
        if not _can_press(model, loads):
            return False
        slope_at(
            model, loads, state, work, trail, np.int64(len(self._tableau.stages)), team, watch,
            start, 0, len(model.blocks.slot))
        assert model.contacts is not None
        self._evaluations += 1
        return bool(model.contacts.deepest[0] > 0.0)

    def _work_error(
        self, model: Model, loads: Loads, trail: Trail, turn_rows: int, scale: float
    ) -> float:
        """
        Return the error of the work of paths per second, see `path_error`; 0 without contacts.
        """
        weights = self._tableau.integral_error
        if weights is None or not _can_press(model, loads):
            return 0.0
        # Also if nothing touches, so that the kernel is ready before the first contact.
        error = float(path_error(
            loads.drives, model, loads, trail.slopes, turn_rows, weights, np.zeros(len(weights)),
            scale, 0, len(model.blocks.slot)))
        return error if self._has_touched else 0.0

    def _find_clear(
        self, model: Model, state: State, trail: Trail, team: Team, watch: Watch | None,
        start: float, h: float, tolerance: float
    ) -> int:
        """
        Return NEAR_CONTACT if a step may miss a relevant contact, else the result of `find_clear`.

        A contact that starts and ends between two stages is at most as deep as a hundredth of the
        displacement in the step, and displaces the bodies by this depth.
        """
        clear = int(find_clear(
            watch, model.blocks, state, trail, len(self._tableau.stages), team, start, h, 0,
            len(model.blocks.slot)))
        if clear == NEAR_CONTACT and (
                _GRAZE * float(trail.speeds[0]) <= tolerance * self._half_edge):
            return CLEAR
        return clear

    def _accept(
        self, model: Model, loads: Loads, state: State, work: Work, control: np.ndarray,
        error: float, start: float, h: float
    ) -> None:
        """Continue from the end of a step of `h` [s] that started at `start` [s]."""
        trail, last, weights = _trail(work), len(model.blocks.slot), self._tableau.step
        control[IS_CLEAR] = 1.0
        control[CLEAR_TOTAL] += error * h
        control[TOTAL] += error * h
        control[RATE] = error
        save(model, state, trail.start, 0, last)
        save(model, trail.stage, state, 0, last)
        keep_work(loads, 0, last)
        add_work(loads, h, weights, 0, last)
        add_flow(work.spent, model.blocks.slot, h, weights, 0, last)
        control[START], control[LENGTH] = start, h

    def _energy_part(
        self, state: State, work: Work, ledger: np.ndarray, h: float
    ) -> float:
        """
        Return the probable energy error of a step of `h` [s] over the allowed one.

        Motion that starts in the step counts for the next balance.
        """
        if not ledger[LIMIT] > 0.0:
            return 0.0
        scale = max(least_scale(ledger), self._kinetic(_trail(work).stage))
        allowed = _LOST * float(ledger[LIMIT]) * scale
        error = self._energy_error(state, work, h)
        return error / allowed if allowed > 0.0 else 0.0

    def _kinetic(self, state: State) -> float:
        """Return the kinetic energy [J] of bodies that are not driven."""
        velocity = np.concatenate([state.linear_velocity, state.angular_velocity])
        with np.errstate(over='ignore', invalid='ignore'):
            return 0.5 * float((
                (self._layout.gather(velocity) * self._root * self._free)**2).sum())

    def prepare(self, *_: Any) -> None:
        """Do nothing: states within a step follow from its stages."""

    def dense_state(
        self, model: Model, loads: Loads, state: State, team: Team, trail: Trail, time: float,
        h: float, x: float, target: State
    ) -> None:
        """
        Compute the state at the fraction `x` of the step in progress, which starts at `time` [s].
        """
        end_step(model, trail.start, trail.slopes, self._weights_at(x), h, target)
        place_paths(model, loads, target, time + x * h)

    def dense_sum(self, rates: np.ndarray, before: Any, after: Any, h: float, x: float) -> Any:
        """Return the integral of `rates` over the fraction `x` of a step of length `h`."""
        weights = self._weights_at(x)
        return before + h * np.tensordot(weights, rates[:len(weights)], axes=1)

    def _weights_at(self, x: float) -> np.ndarray:
        dense = self._tableau.dense
        assert dense is not None
        return np.asarray(x ** np.arange(1.0, len(dense) + 1.0) @ dense)

    def _step(
        self, model: Model, loads: Loads, state: State, saved: State, work: Work, team: Team,
        watch: Watch | None, start: float, h: float, parts: int, ledger: np.ndarray
    ) -> bool:
        """
        Take a step of `h` [s] from `start` [s] on; return True if it was solved.

        A step without solution, or with too large an energy error, is bisected up to `parts`
        times.
        """
        is_solved = self._find_stages(
            model, loads, state, saved, work, team, watch, start, h, _Ways(watch))
        if parts > 0 and not (is_solved and self._energy_part(state, work, ledger, h) <= 1.0):
            return all(
                self._step(
                    model, loads, state, saved, work, team, watch, begin, 0.5 * h, parts - 1,
                    ledger)
                for begin in (start, start + 0.5 * h))
        if is_solved:
            last, weights = len(model.blocks.slot), self._tableau.step
            end_step(model, state, _trail(work).slopes, weights, h, state)
            add_work(loads, h, weights, 0, last)
            add_flow(work.spent, model.blocks.slot, h, weights, 0, last)
        return is_solved

    def _energy_error(self, state: State, work: Work, h: float) -> float:
        """
        Return the probable energy error [J] of a step of `h` [s], from its present stages.

        By the velocities of the embedded method: where motion dies out within a step, the
        energy that it leaves is not counted right.
        """
        weights, trail = self._tableau.error, _trail(work)
        if weights is None:
            return 0.0
        row = trail.slopes.shape[1] - 6
        gather, root = self._layout.gather, self._root * self._free
        differences = sum(
            weight * gather(slope[row:]) for weight, slope in zip(weights, trail.slopes) if weight)
        with np.errstate(over='ignore', invalid='ignore'):
            error = 0.5 * h * h * float(((differences * root)**2).sum())
            return 2.0 * math.sqrt(error * max(error, self._kinetic(state)))

    def _find_stages(
        self, model: Model, loads: Loads, state: State, saved: State, work: Work, team: Team,
        watch: Watch | None, start: float, h: float, ways: _Ways
    ) -> bool:
        """Find the slopes of a step of `h` [s] from `start` [s] on; return True if found."""
        trail, last = _trail(work), len(model.blocks.slot)
        tableau, slopes, base = self._tableau, trail.slopes, self._base
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
                ways.begin()
                slope_at(
                    model, loads, trail.stage, work, trail, np.int64(number), team, watch, time,
                    0, last)
                self._evaluations += 1
                ways.end()
                residual(model, base, velocity, slopes[number], g, self._residual)
                return self._residual[:, self._layout.slot].T * self._free

            if not self._solve(look_at, model, saved, trail.stage, work, g, h):
                return False
            ways.accept()
            if model.contacts is not None and _can_press(model, loads):
                self._has_touched = self._has_touched or model.contacts.deepest[0] > 0.0
        return True

    def _solve(
        self, look_at: Callable[[np.ndarray], np.ndarray], model: Model, saved: State,
        stage: State, work: Work, g: float, h: float
    ) -> bool:
        """
        Solve for velocities of a stage by Newton's method; return True if solved.

        `look_at` returns the residual (n, 6) of velocities (6, s).
        """
        velocity, solved = self._velocity, max(_SOLVED, self._solved * h)
        factors, own, before = self._factors(model, saved, work, g), False, math.inf
        left = look_at(velocity)
        size = self._size(left)
        for _ in range(_MAX_CORRECTIONS):
            if factors is None or not math.isfinite(size):
                return False
            change = factors.solve((left * self._root).ravel()).reshape(left.shape) / self._root
            correction = g * float(np.abs(change * self._part).max(initial=0.0))
            if not math.isfinite(correction):
                return False
            is_slow = correction > _SLOW_RATIO * before
            if is_slow and correction <= _ROUNDING_LIMIT:
                return True
            if is_slow and not own:
                # The velocities are those of the last look.
                factors, own, before = self._matrix.factors(model, stage, work.points, g), (
                    True), math.inf
                continue
            before, own = correction, False
            self._change[:, self._layout.slot] = change.T
            part = 1.0
            for _ in range(_HALVINGS):
                other = velocity - part * self._change
                found = look_at(other)
                found_size = self._size(found)
                # Near the solution rounding decides.
                if found_size < size or part * correction <= _ROUNDING_LIMIT:
                    break
                part *= 0.5
            else:
                return False
            velocity[:] = other
            left, size = found, found_size
            if correction <= solved:
                return True
        return False

    def _size(self, left: np.ndarray) -> float:
        """Return the size of a residual in the energy norm."""
        with np.errstate(over='ignore', invalid='ignore'):
            return float(np.sqrt(((left * self._root)**2).sum()))

    def _factors(self, model: Model, saved: State, work: Work, g: float) -> Factors | None:
        """Return the factors for a time `g` [s], of the state that was saved last."""
        for kept in self._kept:
            if kept.time == g and all(
                    np.array_equal(one, other)
                    for one, other in zip(kept.state.rows(), saved.rows())):
                return kept.factors
        place_all(model, saved, work, 0, len(model.blocks.slot))
        found = _Kept(
            g, copied_state(saved),
            self._matrix.factors(model, saved, work.points, g))
        self._kept = [
            kept for kept in self._kept if kept.time != g][1 - _KEPT_MATRIX_COUNT:] + [found]
        return found.factors


def implicit_method(scene: Scene, packed: PackedScene, name: str) -> Method:
    """Return the method `name` with the steps of a scene."""
    steps = ImplicitSteps(scene, packed, TABLEAUS[name])
    embedded = None if steps.kept_slopes is None else EmbeddedKernels(
        steps.take, steps.prepare, steps.dense_state, steps.dense_sum, steps.kept_slopes)
    return facts_of(name)._replace(
        advance=steps.advance, count_evaluations=steps.count_evaluations, embedded=embedded)
