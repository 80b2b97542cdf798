# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Runs one random scene and says to which class it belongs.

Beside the run go: references and displaced companions in windows (`windows.py`), one far tighter
run with a companion from the start, and the same run by two threads that goes on from a checkpoint
in its middle. Where parameters change while a scene runs, all of this is for the run after that,
and begins where the change found it.
"""

from collections.abc import Callable
import logging
import math
from pathlib import Path
import tempfile
import time
import traceback
from typing import Any, Final

from icofabric_sim.parameters.changes import restarts_motion
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.errors import Interrupted, SimulationError
from icofabric_sim.simulation.reports.divergence import Growth
from icofabric_sim.simulation.simulation import compile_scene, Simulation
from icofabric_sim.simulation.stepping.methods import facts_of
from icofabric_sim.simulation.stepping.thread_team import teams_of
from icofabric_validation.stress.refusals import (
    first_name,
    has_jumped,
    have_met,
    is_right_refusal,
    moment_of,
)
from icofabric_validation.stress.scenes import StressScene
from icofabric_validation.stress.verdict import Finding, Verdict
from icofabric_validation.stress.windows import (
    Added,
    compiled_reference,
    far_tighter,
    is_physical,
    rate_of,
    reference_scene,
    Windows,
)
from numba.core import event
import numpy as np

# Processor time [s] for a scene, without compiling; parts of it for the windows, and for those
# and the run from the start.
SECONDS: Final = 12.0
_WINDOWS_PART, _WHOLE_PART = 0.5, 0.75
# A scene of which less than this part of the duration was simulated is too slow.
_ENOUGH = 0.25
# Above the promise by more than this is not between; an estimate tells an error that is at most
# so many times as large.
FACTOR: Final = 3.0
# Tolerances for a radian of the fastest motion that no method reaches in double precision.
_BEYOND_REACH = 1e-12
# Parts of a given step that are tried where a run stopped for its step.
_SHORTER = (1 / 4, 1 / 16)
# Parts of a tolerance that are tried where a run with chosen steps stopped and advises a smaller
# one.
_FINER = (1e-1, 1e-2)
# Part of the duration for which a run goes on to see what the tighter one saw before its end.
_LATER = 0.1
# By how much a change of parameters may change the state, over the largest of its kind: rounding.
_SAME = 1e-12
_STATE = ('position', 'orientation', 'linear_velocity', 'angular_velocity', 'intact')


class _CompilerTime(event.Listener):  # type: ignore[misc]
    """Processor time of the compiler in this process; compilations may be nested."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._depth, self._began = 0, 0.0

    def on_start(self, happening: event.Event) -> None:
        if not self._depth:
            self._began = time.process_time()
        self._depth += 1

    def on_end(self, happening: event.Event) -> None:
        self._depth -= 1
        if not self._depth:
            self.seconds += time.process_time() - self._began


class Clock:
    """Processor time without that of the compiler, since it was made."""

    def __init__(self, limit: float, compiler: _CompilerTime) -> None:
        self._start, self._compiled = time.process_time(), compiler.seconds
        self._compiler, self.limit = compiler, limit

    @property
    def seconds(self) -> float:
        return time.process_time() - self._start - (self._compiler.seconds - self._compiled)

    def is_over(self, part: float = 1.0) -> bool:
        return self.seconds > part * self.limit

    def another(self) -> 'Clock':
        """Return a clock that begins now, with the same limit."""
        return Clock(self.limit, self._compiler)


def judge(stress: StressScene, *, seconds: float = SECONDS) -> Finding:
    """Run a scene within so much processor time [s], and class it."""
    return judged_by(
        stress, seconds,
        lambda scene, parameters, clock: _Judge(scene, clock, parameters).finding())


def judged_by(
    stress: StressScene, seconds: float,
    look: Callable[[StressScene, dict[str, Any], Clock], Finding]
) -> Finding:
    """
    What `look` finds of a scene with its parameters, by a clock of so much processor time [s].

    An error of the program is a crash.
    """
    compiler = _CompilerTime()
    clock = Clock(seconds, compiler)
    logger = logging.getLogger('icofabric_sim')
    handler = _Silent()
    logger.addHandler(handler)
    propagated, logger.propagate = logger.propagate, False
    try:
        with event.install_listener('numba:compile', compiler), (
                tempfile.TemporaryDirectory()) as folder:
            finding = look(stress, stress.placed(Path(folder)), clock)
    except Exception as error:  # noqa: BLE001 - what it finds are such errors
        place = traceback.extract_tb(error.__traceback__)[-1]
        finding = _finding(
            stress, Verdict.CRASH,
            f'{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})')
    finally:
        logger.removeHandler(handler)
        logger.propagate = propagated
    return finding._replace(seconds=clock.seconds)


class _Silent(logging.Handler):
    """Takes warnings of the library; what they say is read from the status of the run."""

    def emit(self, record: logging.LogRecord) -> None:
        return


def _finding(stress: StressScene, verdict: Verdict, detail: str) -> Finding:
    return Finding(stress.seed, stress.kind, verdict, ' '.join(detail.split()))


class _Judge:
    """One scene; each step of `finding` may end it."""

    def __init__(
        self, stress: StressScene, clock: Clock, parameters: dict[str, Any]
    ) -> None:
        self._stress, self._clock, self._parameters = stress, clock, parameters
        # The scene before its parameters changed, and when they did [s].
        self._before: Scene | None = None
        self._start = 0.0

    def finding(self) -> Finding:
        stress = self._stress
        spoiled = '' if stress.change else stress.spoiled
        try:
            scene = Scene.from_parameters(self._parameters)
            run = compile_scene(scene)
            if stress.change:
                spoiled = stress.spoiled
                self._find_start(run)
                earlier = run
                if self._before is not None:
                    scene = scene.with_changes(stress.change)
                run = self._begun(scene)
                if lost := self._lost(earlier, run):
                    return _finding(stress, Verdict.SILENT, lost)
            # Here it begins, or says that it cannot.
            run.warm_up()
        except ValueError as error:
            right = is_right_refusal(error, spoiled) or self._is_refused_anyway(error)
            return _finding(
                stress, Verdict.REFUSED if right else Verdict.WRONGLY_REFUSED, str(error))
        except SimulationError as error:
            # A connector is in its shell: the run cannot begin there, and a node keeps the one
            # before a change.
            had_to = 'connector.obstruction is stop' in str(error) and (
                scene.parameters['connector.obstruction'] == 'stop') or (
                self._was_too_long_before(str(error)))
            return _finding(stress, _stop(had_to), str(error))
        except Interrupted:
            return self._slow(run)
        # A single body has no step that is too long.
        if stress.spoiled and stress.spoiled != 'solver.step' and (
                self._before is not None or not stress.change):
            return _finding(
                stress, Verdict.SILENT, f'{stress.spoiled} had to be refused, and was not')
        rate = rate_of(run)
        # Where springs of friction have a past, no other run can take the state over.
        compares = not float(str(scene.parameters['contact.friction'])) > 0.0
        windows = Windows(
            run, rate, lambda: self._clock.is_over(_WINDOWS_PART), compare=compares)
        failure: SimulationError | None = None
        try:
            windows.follow(stress.duration)
        except SimulationError as error:
            failure = error
        except Interrupted:
            if not run.time - self._start > _ENOUGH * (stress.duration - self._start):
                return self._slow(run)
        run.should_stop = None
        added, end = windows.result(), run.time
        # Where the run stopped the other one has to come to what it stopped for, which may be in a
        # window that ends later than all.
        late = end + _LATER * stress.duration if end > stress.duration else stress.duration
        growth, distance, reason = far_tighter(
            run, rate, end if failure is None else late,
            lambda: self._clock.is_over(_WHOLE_PART),
            None if self._before is None else self._begun(scene))
        other, compared, shared = self._other_bits(run, end, failure)
        found = _finding(stress, Verdict.WITHIN, '')._replace(
            method=run.status.method_name, bodies=scene.body_count, steps=run.status.step_count,
            is_given=float(str(scene.parameters['solver.step'])) > 0.0, time=end,
            added=added.error, promised=added.promised, estimate=run.error_estimate,
            growth=0.0 if growth is None else growth.largest, compared=compared,
            windows=added.windows, unjudged=added.unjudged, shared=shared)
        if other:
            return found._replace(verdict=Verdict.OTHER_BITS, detail=other)
        if failure is not None:
            return self._stopped(found, str(failure), reason, run, rate)
        # From the start it may come to what a sensitive run does not come to.
        sensitive = growth is None or growth.is_sensitive or bool(growth.ended)
        if why := self._missed_stop(run, end, windows.stopped or ('' if sensitive else reason)):
            return found._replace(verdict=Verdict.SILENT, detail=why)
        if added.broken and not found.is_given:
            return found._replace(verdict=Verdict.SILENT, detail=added.broken)
        if growth is not None and not compares:
            # From its start alone.
            known = not (growth.is_sensitive or growth.ended or reason)
            found = found._replace(added=distance / max(growth.largest, 1.0) if known else 0.0)
            if not known:
                return found._replace(
                    verdict=Verdict.UNJUDGED,
                    detail=reason or growth.ended or (
                        f'small displacements grew {growth.largest:.3g} times, and no other run '
                        'can take over where springs of friction have a past'))
        elif not compares:
            return found._replace(
                verdict=Verdict.UNJUDGED, detail='there was no time for the tighter run')
        lacks = run.status.error_estimate_lacks
        verdict = classed(found, lacks, growth, distance)
        if verdict.verdict in (Verdict.SILENT, Verdict.BETWEEN) and compares:
            # Single windows may stand for many: look at all of them.
            again = self._all_windows(scene, rate, end)
            if again is not None:
                added = again
                verdict = classed(
                    found._replace(
                        added=again.error, promised=again.promised, windows=again.windows,
                        unjudged=again.unjudged), lacks, growth, distance)
        if verdict.is_fault or verdict.verdict is Verdict.BETWEEN:
            return verdict
        why = added.broken or added.why or (reason and f'the tighter run stopped: {reason}')
        if not why:
            return verdict
        return verdict._replace(
            verdict=Verdict.UNJUDGED,
            detail=f'{verdict.unjudged} of {verdict.windows} windows; {why}')

    def _find_start(self, run: Simulation) -> None:
        """Take a `run` to where parameters change; one that stops before is judged as it is."""
        start = self._stress.change_at * self._stress.duration
        run.should_stop = lambda: self._clock.is_over(_WINDOWS_PART)
        try:
            run.advance_to(start)
        except SimulationError:
            return
        self._before, self._start = run.scene, start

    def _lost(self, earlier: Simulation, run: Simulation) -> str:
        """What the change of parameters did to the state that it should not do; '': nothing."""
        if self._before is None:
            return ''
        one, two = earlier.snapshot(), run.snapshot()
        if restarts_motion(self._before.parameters, run.scene.parameters):
            one = compile_scene(run.scene).snapshot()
        if run.time != earlier.time:
            return f'time is {run.time!r} s after a change at {earlier.time!r} s'
        driven = np.concatenate(
            [drive.bodies for drive in run.scene.drives.values()] or [np.zeros(0, np.int32)])
        for name in _STATE:
            before, after = getattr(one, name), getattr(two, name)
            scale = 1.0 if before.dtype == bool else float(np.abs(before).max(initial=0.0))
            differs = ~(np.abs(after.astype(float) - before) <= _SAME * scale)
            if name != 'intact':
                # Where driven bodies are follows from their paths.
                differs = differs.any(axis=1)
                differs[driven] = False
            if differs.any():
                which = int(np.flatnonzero(differs)[0])
                return (f'a change of parameters changed {name}[{which}]: {before[which]}, '
                        f'then {after[which]}')
        return ''

    def _begun(self, scene: Scene) -> Simulation:
        """Compile a `scene`, and bring it to where it is judged from."""
        run = compile_scene(scene)
        if self._before is not None:
            earlier = compile_scene(self._before)
            earlier.advance_to(self._start)
            run.take_over(earlier, keep_motion=not restarts_motion(
                self._before.parameters, scene.parameters))
        return run

    def _was_too_long_before(self, text: str) -> bool | None:
        """
        Whether the run up to the change stopped for its given step, and a shorter one does not.

        Or stops for something else, as any run may have to. None: there was no time.
        """
        if self._before is None or 'solver.step' not in text:
            return False
        clock, step = self._clock.another(), float(str(self._before.parameters['solver.step']))
        for part in (*_SHORTER, 0.0) if step else ():
            run = compile_scene(self._before.with_changes({'solver.step': part * step}))
            run.should_stop = clock.is_over
            try:
                run.advance_to(self._start)
                run.snapshot()
            except SimulationError as error:
                if first_name(str(error)) == first_name(text):
                    continue
            except Interrupted:
                return None
            return True
        return False

    def _is_refused_anyway(self, refused: ValueError) -> bool:
        """Whether a spoiled scene is refused for the same without what was spoiled."""
        spoiled_with = self._stress.spoiled_with
        try:
            compile_scene(Scene.from_parameters({
                name: value for name, value in self._parameters.items()
                if name not in spoiled_with}))
        except ValueError as error:
            return str(error) == str(refused) and is_right_refusal(error, '')
        return False

    def _stopped(
        self, found: Finding, text: str, reason: str, run: Simulation, rate: float
    ) -> Finding:
        """The class of a `run` that stopped for `text`; the tighter one for `reason`."""
        scene = run.scene
        right = has_jumped(text, run) or have_met(
            text, run, lambda: compiled_reference(reference_scene(scene, rate))
        ) or self._is_right(text, reason, scene, rate)
        if right is False and not found.is_given and found.added <= found.promised:
            # It kept its promise until then, and what it advises may help.
            right = self._is_way_out(text, scene)
        verdict = _stop(right)
        if right is None:
            text = f'there was no time to try a shorter step; {text}'
        return found._replace(verdict=verdict, detail=' '.join(text.split()))

    def _missed_stop(
        self, run: Simulation, end: float, reason: str
    ) -> str:
        """What a run went on through that ended a tighter one, whatever the steps; '': none."""
        if not is_physical(reason):
            return ''
        # Health checks come every few steps: the run may be about to see it.
        run.should_stop = self._clock.another().is_over
        try:
            run.advance_to(end + _LATER * self._stress.duration)
        except SimulationError as error:
            if is_physical(str(error)):
                return ''
        except Interrupted:
            return ''
        return f'went on where a tighter run stopped: {reason}'

    def _all_windows(self, scene: Scene, rate: float, end: float) -> Added | None:
        """What a run adds to `end` [s], by windows everywhere; None where there is no time."""
        run, clock = self._begun(scene), self._clock.another()
        windows = Windows(run, rate, clock.is_over, most=math.inf)
        try:
            windows.follow(end)
        except (Interrupted, SimulationError):
            return None
        return windows.result()

    def _slow(self, run: Simulation) -> Finding:
        """Windows took too long: class the scene by a run without any."""
        alone, clock = self._begun(run.scene), self._clock.another()
        alone.should_stop = lambda: clock.is_over(_WINDOWS_PART)
        limit = run.status.fastest_term
        verdict, detail = Verdict.SLOW if limit else Verdict.HANG, (
            f'; the fastest motion is that of {limit}')
        try:
            alone.advance_to(self._stress.duration)
            verdict, detail = Verdict.UNJUDGED, (
                f' beside a tighter run; alone it takes {clock.seconds:.2g} s')
        except Interrupted:
            run = alone
        except SimulationError as error:
            run = alone
            verdict = Verdict.STOPPED if has_jumped(str(error), alone) else Verdict.UNJUDGED
            detail = f' beside a tighter run; alone it stops: {error}'
        return _finding(
            self._stress, verdict,
            f'{run.status.step_count} steps to t = {run.time:.6g} s of '
            f'{self._stress.duration:.6g} s{detail}')._replace(
                method=run.status.method_name, bodies=run.scene.body_count,
                steps=run.status.step_count, time=run.time)

    def _other_bits(
        self, run: Simulation, end: float, failure: SimulationError | None
    ) -> tuple[str, bool, bool]:
        """
        What two threads and a checkpoint change; whether it was compared, and by two threads.
        """
        with teams_of(2):
            threads = self._begun(run.scene)
        restored = compile_scene(run.scene)
        # Implicit steps take one thread whatever is asked for.
        wanted = 1 if facts_of(run.status.method_name).implicit else 2
        if threads.status.thread_count != wanted or restored.status.thread_count != 1:
            raise RuntimeError('the judge asked for two threads beside one, and has '
                               f'{threads.status.thread_count} and {restored.status.thread_count}')
        shared = threads.status.busy_thread_count == 2
        for simulation in (threads, restored):
            simulation.should_stop = self._clock.is_over
        try:
            try:
                threads.advance_to(0.5 * (self._start + end))
                data = threads.checkpoint().to_bytes()
                restored.restore(Checkpoint.from_bytes(data))
                # The run itself may have stopped in a whole step beyond its end.
                late = 2.0 * (self._stress.duration + run.status.step)
                restored.advance_to(end if failure is None else late)
            except SimulationError as error:
                said = '' if failure is None else str(failure)
                if str(error) != said:
                    text = f'stopped elsewhere: {error}; the run itself: {said or "went on"}'
                    return text, True, shared
                return '', True, shared
        except Interrupted:
            return '', False, False
        if failure is not None:
            return f'did not stop; the run itself: {failure}', True, shared
        one, two = run.snapshot(), restored.snapshot()
        for name in _STATE:
            if not np.array_equal(getattr(one, name), getattr(two, name), equal_nan=True):
                return f'{name} at t = {end!r} s differs', True, shared
        for name in ('error_estimate', 'step_count', 'step'):
            if getattr(run.status, name) != getattr(restored.status, name):
                return f'{name} at t = {end!r} s differs', True, shared
        return '', True, shared

    def _is_right(
        self, text: str, reason: str, scene: Scene, rate: float
    ) -> bool | None:
        """Whether a run had to stop for what it says; None: not known."""
        parameters = scene.parameters
        if parameters['connector.obstruction'] == 'stop' and (
                'connector.obstruction is stop' in text):
            return True
        tolerance = float(str(parameters['solver.tolerance']))
        step = float(str(parameters['solver.step']))
        if not step and 'solver.tolerance' in text and tolerance < _BEYOND_REACH * rate:
            return True
        # The far tighter run stops as well, and names the same.
        name = first_name(text)
        if name and name == first_name(reason):
            return True
        if not step or 'solver.step' not in text:
            return False
        return self._was_too_long(text, reason, scene, step)

    def _is_way_out(self, text: str, scene: Scene) -> bool | None:
        """Whether a smaller tolerance, which `text` advises, ends the stop; None: no time."""
        if 'a smaller solver.tolerance makes steps shorter' not in text:
            return False
        clock, tolerance = self._clock.another(), float(str(scene.parameters['solver.tolerance']))
        for part in _FINER:
            run = self._begun(scene.with_changes({'solver.tolerance': part * tolerance}))
            run.should_stop = clock.is_over
            try:
                run.advance_to(self._stress.duration)
            except SimulationError:
                continue
            except Interrupted:
                return None
            return True
        return False

    def _was_too_long(self, text: str, reason: str, scene: Scene, step: float) -> bool | None:
        """
        Whether a run with a shorter given step does not stop; None: there was no time.

        Or stops as the tighter one does, for its `reason`, or later than this one and for another
        reason: then the step was too long before the bodies came to what ends all runs. Or stops
        for a length that jumps, of which this one said that it may.
        """
        clock, moment = self._clock.another(), moment_of(text)
        # Given implicit steps leave the energy uncounted that dies out within one, short or long;
        # chosen ones are the other way out that they name.
        is_implicit = facts_of(compile_scene(scene).status.method_name).implicit
        may_jump = 'the forces of connectors around them jump' in text
        for part in (*_SHORTER, 0.0) if is_implicit or may_jump else _SHORTER:
            run = self._begun(scene.with_changes({'solver.step': part * step}))
            run.should_stop = clock.is_over
            try:
                run.advance_to(self._stress.duration)
            except SimulationError as error:
                if may_jump and has_jumped(str(error), run):
                    return True
                name = first_name(str(error))
                if name == first_name(text):
                    continue
                if run.time > moment or (name and name == first_name(reason)):
                    return True
                if not is_implicit:
                    return False
            except Interrupted:
                return None
            else:
                return True
        return False


def _stop(had_to: bool | None) -> Verdict:
    """The class of a run that stopped; None: it is not known whether it had to."""
    if had_to is None:
        return Verdict.UNJUDGED
    return Verdict.STOPPED if had_to else Verdict.WRONGLY_STOPPED


def classed(found: Finding, lacks: str, growth: Growth | None, distance: float) -> Finding:
    """
    The class of a run that came to its end.

    `lacks`: what its estimate may not cover; `distance` at the end from a tighter run, where small
    displacements had that `growth`.
    """
    added, promised = found.added, found.promised
    told = FACTOR * found.estimate >= added
    chaotic = growth is not None and (growth.is_sensitive or bool(growth.ended))
    if not added <= promised:
        ratio = f'{added:.3g} added, {promised:.3g} promised, {found.estimate:.3g} said'
        if not found.is_given and added <= FACTOR * promised:
            return found._replace(verdict=Verdict.BETWEEN, detail=ratio)
        if told:
            return found._replace(verdict=Verdict.SAID, detail=ratio)
        if lacks:
            return found._replace(verdict=Verdict.EXCUSED, detail=f'{ratio}; {lacks}')
        return found._replace(verdict=Verdict.SILENT, detail=ratio)
    if chaotic:
        return found._replace(verdict=Verdict.CHAOTIC)
    if growth is not None:
        # The bound that `icofabric run` prints.
        bound = max(promised, found.estimate) * growth.largest
        if not distance <= FACTOR * bound:
            said = f'{distance:.3g} at the end, {bound:.3g} said'
            if lacks:
                return found._replace(verdict=Verdict.EXCUSED, detail=f'{said}; {lacks}')
            return found._replace(verdict=Verdict.SILENT, detail=said)
    return found
