# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Errors that a run adds, growth apart: windows of one shortest period beside a far tighter run.

At the beginning of each window the tighter run takes the state over. Where the two are apart by
more than was allowed at its end, a displaced companion says how much of that is growth.
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

# Tolerance of the reference: this part of the run's own, and at least this for each radian of the
# fastest motion, below which rounding rules; at most the last.
_FINER, _LEAST, _MOST = 1e-2, 2e-13, 1e-11
# Windows of a run, at most; spread evenly over longer ones.
WINDOWS: Final = 24
# Rounding of a window, in units of the last place of the coordinates over a.
_ROUNDING: Final = 256.0 * np.finfo(float).eps
# Words of stops that are not about steps: `connector.obstruction: stop`, overlaps too deep.
_PHYSICAL: Final = (
    'connector.obstruction is stop', 'Give a larger contact.stiffness', 'move them apart')


class Run(Protocol):
    """What is followed: a simulation, or what another program computes of its scene."""

    should_stop: Callable[[], bool] | None

    @property
    def scene(self) -> Scene:
        """The scene."""

    @property
    def time(self) -> float:
        """Time [s] of the present state."""

    def advance_to(self, time: float) -> None:
        """Go on to a time [s], or a little later where steps have one length."""

    def advance_steps(self, count: int) -> object:
        """Take whole steps."""

    def snapshot(self) -> Any:
        """The state: position, orientation, intact."""


class Added(NamedTuple):
    """What was added by the end of the run, and what may be."""

    error: float
    promised: float  # tolerance times time, and rounding
    rounding: float  # of it
    windows: int = 0  # that were compared, or were to be
    unjudged: int = 0  # of them: where nothing can be said of the error
    why: str = ''  # the first of them
    broken: str = ''  # connectors that broke otherwise than in the reference; '': none did


def reference_scene(scene: Scene, rate: float) -> Scene:
    """The scene by the adaptive method, far tighter; `rate` [rad/s] of the fastest motion."""
    tolerance = min(max(
        _FINER * float(str(scene.parameters['solver.tolerance'])), _LEAST * rate), _MOST * rate)
    return scene.with_changes({
        'solver.method': 'dop8', 'solver.step': 0.0, 'solver.tolerance': max(tolerance, 1e-15),
        'solver.energy_limit': 1e9, 'solver.threads': 1})


def compiled_reference(scene: Scene) -> Simulation:
    """
    A run of a reference scene, or of one whose tolerance is larger until doubles can give it.

    What rounding adds depends on the scene's coordinates too, which its rate says nothing of.
    """
    while True:
        try:
            return compile_scene(scene)
        except ValueError as error:
            if not str(error).startswith('solver.tolerance'):
                raise
            scene = scene.with_changes({
                'solver.tolerance': 3.0 * float(str(scene.parameters['solver.tolerance']))})


def rate_of(simulation: Simulation) -> float:
    """Rate [rad/s] of the fastest motion; that of the duration where nothing vibrates."""
    rate = simulation.status.largest_frequency
    return max(rate, 2.0 * math.pi / float(str(simulation.scene.parameters['duration'])))


def is_physical(text: str) -> bool:
    """Whether a run stopped for what its bodies did, whatever the steps."""
    return any(words in text for words in _PHYSICAL)


def go_on(run: Simulation, other: Simulation) -> float:
    """Have `other` go on where a run is; returns by how much its clock is behind that [s]."""
    other.reset_time()
    other.take_over(run, keep_motion=True)
    return 0.0


def far_tighter(
    run: Run, rate: float, end: float, should_stop: Callable[[], bool],
    begun: Simulation | None = None
) -> tuple[Growth | None, float, str]:
    """
    A far tighter run from the start: growth, distance at the `end` [s], and why it stopped.

    The start is where `begun` stands; None: that of the scene.

    Where it stopped the growth is that until then, and there is no distance; no growth: there was
    no time.
    """
    reference = compiled_reference(reference_scene(run.scene, rate))
    if begun is not None:
        try:
            go_on(begun, reference)
        except SimulationError as error:
            # It cannot begin there: what ends it is in that state.
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
    """One run, followed window by window; `result` says what was found so far."""

    def __init__(
        self, run: Run, rate: float, should_stop: Callable[[], bool], *,
        compare: bool = True, most: float = WINDOWS,
        hand_over: Callable[[Any, Simulation], float] = go_on
    ) -> None:
        """
        Follow `run`, whose fastest motion has the `rate` [rad/s].

        `compare`: whether references go beside it; `most`: windows, at most; `hand_over` brings
        one of these to where the run is. `should_stop` ends an advance of each of them with
        Interrupted.
        """
        self._hand_over, self._earlier = hand_over, 0.0
        self._run, self._rate, self._most = run, rate, most
        self._start, self._half_edge = run.time, run.scene.geometry.half_edge
        self._tolerance = float(str(run.scene.parameters['solver.tolerance']))
        self._error = self._rounding = 0.0
        self._count = self._unjudged = 0
        self._why = self._broken = ''
        # What a reference stopped for that any run must stop for; '': nothing.
        self.stopped = ''
        self._others: list[Simulation] = []
        self._reference, self._finer = reference_scene(run.scene, rate), 0.0
        self._should_stop = run.should_stop = should_stop
        if compare:
            self._finer = float(str(self._reference.parameters['solver.tolerance']))
            self._others = self._compiled()

    def follow(self, duration: float) -> None:
        """Advance to `duration` [s]; raises what ends the run, and Interrupted."""
        run = self._run
        length = duration - self._start
        period = min(2.0 * math.pi / self._rate, length)
        gap = max(length / self._most - period, 0.0)
        while run.time < duration:
            before = run.time
            if gap > 0.0:
                run.advance_to(before + gap)
                run.advance_steps(1)
            start = run.time
            fault = self._take_over()
            run.advance_to(max(start + 0.999 * period, run.time))
            run.advance_steps(1)
            if self._others:
                self._count += 1
                try:
                    if fault is not None:
                        raise fault
                    self._compare(before, start)
                except SimulationError as error:
                    self._skip(f'the tighter run stopped: {error}')
                    if is_physical(str(error)):
                        self.stopped = self.stopped or str(error)
                    # One that has failed does not go on.
                    self._others = self._compiled()

    def result(self) -> Added:
        """What was added so far, and what may be."""
        return Added(
            self._error, self._tolerance * (self._run.time - self._start) + self._rounding,
            self._rounding,
            self._count, self._unjudged, self._why, self._broken)

    def _take_over(self) -> SimulationError | None:
        """
        Have the others begin where the run is; why they cannot.

        A run with a given step may be on its way to infinity, where none with chosen ones begins.
        It is for its next health check to see that.
        """
        for other in self._others:
            try:
                self._earlier = self._hand_over(self._run, other)
            except SimulationError as error:
                return error
        return None

    def _compiled(self) -> list[Simulation]:
        """Return the reference and the one that is displaced from it."""
        others = [compiled_reference(self._reference) for _ in range(2)]
        for other in others:
            other.should_stop = self._should_stop
        return others

    def _skip(self, why: str) -> None:
        self._unjudged += 1
        self._why = self._why or f'to t = {self._run.time:.6g} s: {why}'

    def _compare(self, before: float, start: float) -> None:
        run, (reference, mark) = self._run, self._others
        end = run.time - self._earlier
        reference.advance_to(end)
        one, two = run.snapshot(), reference.snapshot()
        error, length = distance_between(one, two, self._half_edge), run.time - start
        rounding = _ROUNDING * (1.0 + float(np.abs(one.position).max()) / self._half_edge)
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
                    # Displacements that are allowed may decide whether a connector breaks.
                    self._skip(f'{differing} connectors broke otherwise')
                elif not self._broken:
                    self._broken = (
                        f'{differing} connectors broke otherwise than in the tighter run by t = '
                        f'{run.time:.6g} s, where small displacements grow {growth.largest:.3g} '
                        'times')
                error = 0.0
            else:
                error /= max(1.0, growth.largest)
        # Windows stand for what lies before them, too.
        part = (run.time - before) / length
        self._error += error * part
        self._rounding += (rounding + self._finer * length) * part
