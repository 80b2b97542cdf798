# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Errors that a run adds, without their growth, by windows of one shortest period.

At the start of each window a reference run of much smaller tolerance takes over the state. If the
distance of the two runs at the end exceeds the allowed error, a displaced companion measures how
much of the distance is growth.
"""

from collections.abc import Callable
import math
from typing import Any, Final, NamedTuple, Protocol

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.errors import Interrupted, SimulationError
from icofabric_sim.simulation.reports.divergence import (
    Companion,
    DISPLACEMENT,
    distance_between,
    Growth,
)
from icofabric_sim.simulation.simulation import compile_scene, Simulation
import numpy as np

# Tolerance of the reference: this fraction of that of the run, within limits for each radian of
# the fastest motion. Round-off dominates below the lower limit.
_REFERENCE_TOLERANCE_RATIO = 1e-2
_MIN_TOLERANCE_PER_RADIAN, _MAX_TOLERANCE_PER_RADIAN = 2e-13, 1e-11
# Largest number of windows of a run; they are spread evenly over longer runs.
MAX_WINDOWS: Final = 24
# Round-off of a window, for coordinates of 1 a.
_ROUND_OFF_RATIO: Final = 256.0 * np.finfo(float).eps
# Words of stops that do not depend on steps: `connector.obstruction: stop`, overlaps too deep.
_PHYSICAL_STOP_TEXTS: Final = (
    'connector.obstruction is stop', 'Give a larger contact.stiffness', 'move them apart')


class Run(Protocol):
    """A run that can be judged: a simulation, or a run of the scene in another program."""

    should_stop: Callable[[], bool] | None

    @property
    def scene(self) -> Scene:
        """The scene."""

    @property
    def time(self) -> float:
        """Time [s] of the present state."""

    def advance_to(self, time: float) -> None:
        """Advance to a time [s], or to the end of a fixed step after it."""

    def advance_steps(self, count: int) -> object:
        """Take whole steps."""

    def snapshot(self) -> Any:
        """Return the state: position, orientation, intact."""


class AddedError(NamedTuple):
    """The error added until the end of the run, and the allowed error."""

    error: float
    promised: float  # tolerance times time, plus round-off
    rounding: float  # round-off in `promised`
    windows: int = 0  # number, with those that could not be compared
    unjudged: int = 0  # windows whose error is unknown
    why: str = ''  # reason for the first of them
    broken: str = ''  # connectors that broke differently in the reference; '': none


def reference_scene(scene: Scene, rate: float) -> Scene:
    """Return a scene with `dop8` and a small tolerance; `rate` [rad/s] of the fastest motion."""
    tolerance = min(max(
        _REFERENCE_TOLERANCE_RATIO * float(str(scene.parameters['solver.tolerance'])),
        _MIN_TOLERANCE_PER_RADIAN * rate), _MAX_TOLERANCE_PER_RADIAN * rate)
    return scene.with_changes({
        'solver.method': 'dop8', 'solver.step': 0.0, 'solver.tolerance': max(tolerance, 1e-15),
        'solver.energy_limit': 1e9, 'solver.threads': 1})


def compile_reference(scene: Scene) -> Simulation:
    """
    Compile a reference scene, with a larger tolerance if double precision cannot reach its own.

    Round-off depends on the coordinates, which the rate of the fastest motion does not contain.
    """
    while True:
        try:
            return compile_scene(scene)
        except ValueError as error:
            if not str(error).startswith('solver.tolerance'):
                raise
            scene = scene.with_changes({
                'solver.tolerance': 3.0 * float(str(scene.parameters['solver.tolerance']))})


def fastest_rate(simulation: Simulation) -> float:
    """Return the rate [rad/s] of the fastest motion; without vibration, one turn per duration."""
    rate = simulation.status.largest_frequency
    return max(rate, 2.0 * math.pi / float(str(simulation.scene.parameters['duration'])))


def is_physical_stop(text: str) -> bool:
    """Return True if a run stopped for the state of its bodies, independently of its steps."""
    return any(words in text for words in _PHYSICAL_STOP_TEXTS)


def continue_from(run: Simulation, other: Simulation) -> float:
    """Let `other` continue from the state of a run; return by how much its clock is behind [s]."""
    other.reset_time()
    other.continue_from(run, keep_motion=True)
    return 0.0


def run_reference(
    run: Run, rate: float, end: float, should_stop: Callable[[], bool],
    started: Simulation | None = None
) -> tuple[Growth | None, float, str]:
    """
    Run a reference from the start, and return growth, distance at the `end` [s] and stop reason.

    The start is the state of `started`, or that of the scene. If the reference stops, growth is
    that until the stop and the distance is 0. Without growth, time ran out.
    """
    reference = compile_reference(reference_scene(run.scene, rate))
    if started is not None:
        try:
            continue_from(started, reference)
        except SimulationError as error:
            # The state itself is the reason for the stop.
            return None, 0.0, str(error)
    reference.should_stop, start = should_stop, reference.time
    companion = Companion(reference)
    try:
        for part in range(1, 9):
            reference.advance_to(start + (end - start) * part / 8.0)
            companion.look()
    except SimulationError as error:
        return companion.result(), 0.0, str(error)
    except Interrupted:
        return None, 0.0, ''
    distance = distance_between(
        run.snapshot(), reference.snapshot(), run.scene.geometry.half_edge)
    return companion.result(), distance, ''


class Windows:
    """One run, compared with references window by window; `result` has the errors so far."""

    def __init__(
        self, run: Run, rate: float, should_stop: Callable[[], bool], *,
        compare: bool = True, max_windows: float = MAX_WINDOWS,
        hand_over: Callable[[Any, Simulation], float] = continue_from
    ) -> None:
        """
        Follow `run`, whose fastest motion has the `rate` [rad/s].

        Without `compare` there are no references. There are at most `max_windows` windows.
        `hand_over` sets a reference to the state of the run. `should_stop` ends an advance of the
        run or a reference with Interrupted.
        """
        self._hand_over, self._earlier = hand_over, 0.0
        self._run, self._rate, self._max_windows = run, rate, max_windows
        self._start, self._half_edge = run.time, run.scene.geometry.half_edge
        self._tolerance = float(str(run.scene.parameters['solver.tolerance']))
        self._error = self._rounding = 0.0
        self._count = self._unjudged = 0
        self._why = self._broken = ''
        # Reason for which a reference stopped and any run must stop; '': none.
        self.stopped = ''
        self._references: list[Simulation] = []
        self._reference, self._reference_tolerance = reference_scene(run.scene, rate), 0.0
        self._should_stop = run.should_stop = should_stop
        if compare:
            self._reference_tolerance = float(str(self._reference.parameters['solver.tolerance']))
            self._references = self._compile_references()

    def follow(self, duration: float) -> None:
        """Advance to `duration` [s]; raise SimulationError if the run stops, or Interrupted."""
        run = self._run
        length = duration - self._start
        period = min(2.0 * math.pi / self._rate, length)
        gap = max(length / self._max_windows - period, 0.0)
        while run.time < duration:
            before = run.time
            if gap > 0.0:
                run.advance_to(before + gap)
                run.advance_steps(1)
            start = run.time
            fault = self._take_over()
            run.advance_to(max(start + 0.999 * period, run.time))
            run.advance_steps(1)
            if self._references:
                self._count += 1
                try:
                    if fault is not None:
                        raise fault
                    self._compare(before, start)
                except SimulationError as error:
                    self._skip(f'the reference run stopped: {error}')
                    if is_physical_stop(str(error)):
                        self.stopped = self.stopped or str(error)
                    # A run that has failed cannot continue.
                    self._references = self._compile_references()

    def result(self) -> AddedError:
        """Return the error added so far, and the allowed error."""
        return AddedError(
            self._error, self._tolerance * (self._run.time - self._start) + self._rounding,
            self._rounding,
            self._count, self._unjudged, self._why, self._broken)

    def _take_over(self) -> SimulationError | None:
        """
        Set the references to the state of the run; return the error if they cannot start there.

        A run with a given step may diverge, and a run with adaptive steps cannot start from such a
        state. The next health check of the run finds the divergence.
        """
        for other in self._references:
            try:
                self._earlier = self._hand_over(self._run, other)
            except SimulationError as error:
                return error
        return None

    def _compile_references(self) -> list[Simulation]:
        """Return the reference and its displaced companion."""
        others = [compile_reference(self._reference) for _ in range(2)]
        for other in others:
            other.should_stop = self._should_stop
        return others

    def _skip(self, why: str) -> None:
        self._unjudged += 1
        self._why = self._why or f'to t = {self._run.time:.6g} s: {why}'

    def _compare(self, before: float, start: float) -> None:
        run, (reference, mark) = self._run, self._references
        end = run.time - self._earlier
        reference.advance_to(end)
        one, two = run.snapshot(), reference.snapshot()
        error, length = distance_between(one, two, self._half_edge), run.time - start
        rounding = _ROUND_OFF_RATIO * (1.0 + float(np.abs(one.position).max()) / self._half_edge)
        allowed = self._tolerance * length + rounding
        if not error <= allowed:
            companion = Companion(mark)
            mark.advance_to(end)
            companion.look()
            growth = companion.result()
            if growth.at_least or growth.ended:
                self._skip(growth.ended or f'small displacements grew {growth.largest:.3g} times')
                error = 0.0
            elif not np.array_equal(one.intact, two.intact):
                differing = int((one.intact != two.intact).sum())
                if growth.is_sensitive or allowed > DISPLACEMENT:
                    # An allowed error may decide whether a connector breaks.
                    self._skip(f'{differing} connectors broke differently')
                elif not self._broken:
                    self._broken = (
                        f'{differing} connectors broke differently from the reference run by t = '
                        f'{run.time:.6g} s, where small displacements grow {growth.largest:.3g} '
                        'times')
                error = 0.0
            else:
                error /= max(1.0, growth.largest)
        # Windows also represent the gaps before them.
        part = (run.time - before) / length
        self._error += error * part
        self._rounding += (rounding + self._reference_tolerance * length) * part
