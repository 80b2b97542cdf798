# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Run one random scene and classify it.

The run is compared with references and displaced companions in windows (`windows.py`), with one
run of much smaller tolerance and a companion from the start, and with the same run by two threads
that continues from a checkpoint in its middle. If parameters change during the run, only the
interval after the change is judged, and it starts from the state at the change.
"""

from collections.abc import Callable
import logging
import math
from pathlib import Path
import tempfile
import time
import traceback
from typing import Any, Final

from icofabric_sim.kernels.runtime.numba_private import COMPILE_EVENT, event
from icofabric_sim.parameters.changes import restarts_motion
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.errors import Interrupted, SimulationError
from icofabric_sim.simulation.reports.divergence import Growth
from icofabric_sim.simulation.simulation import compile_scene, Simulation
from icofabric_sim.simulation.stepping.methods import facts_of
from icofabric_sim.simulation.stepping.thread_team import teams_of
from icofabric_validation.stress.refusals import (
    did_charges_pass,
    did_length_jump,
    first_parameter,
    is_right_refusal,
    stop_time,
)
from icofabric_validation.stress.scenes import StressScene
from icofabric_validation.stress.verdict import Finding, Verdict
from icofabric_validation.stress.windows import (
    AddedError,
    compile_reference,
    fastest_rate,
    is_physical_stop,
    reference_scene,
    run_reference,
    Windows,
)
import numpy as np

# Processor time [s] for a scene, without compiling; fractions of it for the windows, and for the
# windows together with the run from the start.
PROCESSOR_TIME_S: Final = 12.0
_WINDOWS_TIME_RATIO, _ALL_RUNS_TIME_RATIO = 0.5, 0.75
# A scene is too slow if less than this fraction of its duration was simulated.
_MIN_SIMULATED_RATIO = 0.25
# Largest error over the promised one in the class "between", and largest ratio of an error to an
# estimate that reports it.
MAX_ERROR_RATIO: Final = 3.0
# Smallest tolerance for a radian of the fastest motion that double precision allows.
_MIN_TOLERANCE_PER_RADIAN = 1e-12
# Fractions of a given step that are tried if a run stopped for its step.
_SHORTER_STEP_RATIOS = (1 / 4, 1 / 16)
# Fractions of a tolerance that are tried if a run with adaptive steps stopped and advises a
# smaller tolerance.
_SMALLER_TOLERANCE_RATIOS = (1e-1, 1e-2)
# Fraction of the duration by which a run continues, so that its health check can stop it as well.
_EXTRA_DURATION_RATIO = 0.1
# Largest round-off in the state at a change of parameters, over the largest value of the array.
_MAX_STATE_CHANGE_RATIO = 1e-12
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
    """Processor time since its creation, without the time of the compiler."""

    def __init__(self, limit: float, compiler: _CompilerTime) -> None:
        self._start, self._compiled = time.process_time(), compiler.seconds
        self._compiler, self.limit = compiler, limit

    @property
    def seconds(self) -> float:
        return time.process_time() - self._start - (self._compiler.seconds - self._compiled)

    def is_over(self, part: float = 1.0) -> bool:
        return self.seconds > part * self.limit

    def another(self) -> 'Clock':
        """Return a clock that starts now, with the same limit."""
        return Clock(self.limit, self._compiler)


def judge(stress: StressScene, *, seconds: float = PROCESSOR_TIME_S) -> Finding:
    """Run a scene within a processor time of `seconds`, and classify it."""
    return classify_by_clock(
        stress, seconds,
        lambda scene, parameters, clock: _Judge(scene, clock, parameters).finding())


def classify_by_clock(
    stress: StressScene, seconds: float,
    classify: Callable[[StressScene, dict[str, Any], Clock], Finding]
) -> Finding:
    """
    Return the finding of `classify` for a scene, with a clock of `seconds` of processor time.

    `classify` gets the scene, its parameters with paths of files, and the clock. An exception that
    it raises is a finding of the class CRASH.
    """
    compiler = _CompilerTime()
    clock = Clock(seconds, compiler)
    logger = logging.getLogger('icofabric_sim')
    handler = _Silent()
    logger.addHandler(handler)
    propagated, logger.propagate = logger.propagate, False
    try:
        with event.install_listener(COMPILE_EVENT, compiler), (
                tempfile.TemporaryDirectory()) as folder:
            finding = classify(stress, stress.write_files(Path(folder)), clock)
    except Exception as error:  # noqa: BLE001 - any exception is a finding
        place = traceback.extract_tb(error.__traceback__)[-1]
        finding = _make_finding(
            stress, Verdict.CRASH,
            f'{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})')
    finally:
        logger.removeHandler(handler)
        logger.propagate = propagated
    return finding._replace(seconds=clock.seconds)


class _Silent(logging.Handler):
    """A handler that drops warnings of the library: the status of the run has the same facts."""

    def emit(self, record: logging.LogRecord) -> None:
        return


def _make_finding(stress: StressScene, verdict: Verdict, detail: str) -> Finding:
    return Finding(stress.seed, stress.kind, verdict, ' '.join(detail.split()))


class _Judge:
    """The judge of one scene."""

    def __init__(
        self, stress: StressScene, clock: Clock, parameters: dict[str, Any]
    ) -> None:
        self._stress, self._clock, self._parameters = stress, clock, parameters
        # The scene before its parameters changed, and the time of the change [s].
        self._before: Scene | None = None
        self._start = 0.0

    def finding(self) -> Finding:
        """Run all comparisons, and return the first fault or the class of the run."""
        stress = self._stress
        spoiled = '' if stress.change else stress.spoiled
        try:
            scene = Scene.from_parameters(self._parameters)
            run = compile_scene(scene)
            if stress.change:
                spoiled = stress.spoiled
                self._advance_to_change(run)
                earlier = run
                if self._before is not None:
                    scene = scene.with_changes(stress.change)
                run = self._start_run(scene)
                if lost := self._find_wrong_change(earlier, run):
                    return _make_finding(stress, Verdict.SILENT, lost)
            # The run starts here, or raises the reason why it cannot.
            run.warm_up()
        except ValueError as error:
            right = is_right_refusal(error, spoiled) or self._is_refused_anyway(error)
            return _make_finding(
                stress, Verdict.REFUSED if right else Verdict.WRONGLY_REFUSED, str(error))
        except SimulationError as error:
            # A connector is inside its shell, so the run cannot start. A node keeps the run before
            # the change.
            had_to = 'connector.obstruction is stop' in str(error) and (
                scene.parameters['connector.obstruction'] == 'stop') or (
                self._was_step_too_long_before_change(str(error)))
            return _make_finding(stress, _stop_verdict(had_to), str(error))
        except Interrupted:
            return self._classify_slow(run)
        # No step is too long for a single body.
        if stress.spoiled and stress.spoiled != 'solver.step' and (
                self._before is not None or not stress.change):
            return _make_finding(
                stress, Verdict.SILENT, f'{stress.spoiled} had to be refused but was accepted')
        rate = fastest_rate(run)
        # No other run can continue a state with friction springs, which depend on the past.
        compares = not float(str(scene.parameters['contact.friction'])) > 0.0
        windows = Windows(
            run, rate, lambda: self._clock.is_over(_WINDOWS_TIME_RATIO), compare=compares)
        failure: SimulationError | None = None
        try:
            windows.follow(stress.duration)
        except SimulationError as error:
            failure = error
        except Interrupted:
            if not run.time - self._start > _MIN_SIMULATED_RATIO * (stress.duration - self._start):
                return self._classify_slow(run)
        run.should_stop = None
        added, end = windows.result(), run.time
        # If the run stopped, the reference has to reach the reason, which may be in a window that
        # ends after the duration.
        late = stress.duration
        if end > late:
            late = end + _EXTRA_DURATION_RATIO * stress.duration
        growth, distance, reason = run_reference(
            run, rate, end if failure is None else late,
            lambda: self._clock.is_over(_ALL_RUNS_TIME_RATIO),
            None if self._before is None else self._start_run(scene))
        other, compared, shared = self._find_bit_difference(run, end, failure)
        found = _make_finding(stress, Verdict.WITHIN, '')._replace(
            method=run.status.method_name, bodies=scene.body_count, steps=run.status.step_count,
            is_given=float(str(scene.parameters['solver.step'])) > 0.0, time=end,
            added=added.error, promised=added.promised, estimate=run.error_estimate,
            growth=0.0 if growth is None else growth.largest, compared=compared,
            windows=added.windows, unjudged=added.unjudged, shared=shared)
        if other:
            return found._replace(verdict=Verdict.NOT_BIT_IDENTICAL, detail=other)
        if failure is not None:
            return self._classify_stop(found, str(failure), reason, run, rate)
        # A sensitive run may miss a stop that the reference reaches from the start.
        sensitive = growth is None or growth.is_sensitive or bool(growth.ended)
        seen = windows.stopped or ('' if sensitive else reason)
        if why := self._find_missed_stop(run, end, seen):
            return found._replace(verdict=Verdict.SILENT, detail=why)
        if added.broken and not found.is_given:
            return found._replace(verdict=Verdict.SILENT, detail=added.broken)
        if growth is not None and not compares:
            # Only the comparison from the start is possible.
            known = not (growth.is_sensitive or growth.ended or reason)
            found = found._replace(added=distance / max(growth.largest, 1.0) if known else 0.0)
            if not known:
                return found._replace(
                    verdict=Verdict.UNJUDGED,
                    detail=reason or growth.ended or (
                        f'small displacements grew {growth.largest:.3g} times, and no other run '
                        'can continue a state with friction springs'))
        elif not compares:
            return found._replace(
                verdict=Verdict.UNJUDGED, detail='no time was left for the reference run')
        lacks = run.status.error_estimate_lacks
        verdict = classify_end(found, lacks, growth, distance)
        if verdict.verdict in (Verdict.SILENT, Verdict.BETWEEN) and compares:
            # A window may represent several: compare all of them.
            again = self._compare_all_windows(scene, rate, end)
            if again is not None:
                added = again
                verdict = classify_end(
                    found._replace(
                        added=again.error, promised=again.promised, windows=again.windows,
                        unjudged=again.unjudged), lacks, growth, distance)
        if verdict.is_fault or verdict.verdict is Verdict.BETWEEN:
            return verdict
        why = added.broken or added.why or (reason and f'the reference run stopped: {reason}')
        if not why:
            return verdict
        return verdict._replace(
            verdict=Verdict.UNJUDGED,
            detail=f'{verdict.unjudged} of {verdict.windows} windows; {why}')

    def _advance_to_change(self, run: Simulation) -> None:
        """Advance a `run` to the change of its parameters, unless it stops before."""
        start = self._stress.change_at * self._stress.duration
        run.should_stop = lambda: self._clock.is_over(_WINDOWS_TIME_RATIO)
        try:
            run.advance_to(start)
        except SimulationError:
            return
        self._before, self._start = run.scene, start

    def _find_wrong_change(self, earlier: Simulation, run: Simulation) -> str:
        """Return the wrong change of the state at a change of parameters, or an empty string."""
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
            differs = ~(np.abs(after.astype(float) - before) <= _MAX_STATE_CHANGE_RATIO * scale)
            if name != 'intact':
                # Paths determine the poses of driven bodies.
                differs = differs.any(axis=1)
                differs[driven] = False
            if differs.any():
                which = int(np.flatnonzero(differs)[0])
                return (f'a change of parameters changed {name}[{which}] from {before[which]} '
                        f'to {after[which]}')
        return ''

    def _start_run(self, scene: Scene) -> Simulation:
        """Compile a `scene`, and advance it to the start of the judged interval."""
        run = compile_scene(scene)
        if self._before is not None:
            earlier = compile_scene(self._before)
            earlier.advance_to(self._start)
            run.continue_from(earlier, keep_motion=not restarts_motion(
                self._before.parameters, scene.parameters))
        return run

    def _was_step_too_long_before_change(self, text: str) -> bool | None:
        """
        Return True if the given step of the run up to the change was too long.

        A run with a shorter step then does not stop, or stops for another reason. None: time ran
        out.
        """
        if self._before is None or 'solver.step' not in text:
            return False
        clock, step = self._clock.another(), float(str(self._before.parameters['solver.step']))
        for part in (*_SHORTER_STEP_RATIOS, 0.0) if step else ():
            run = compile_scene(self._before.with_changes({'solver.step': part * step}))
            run.should_stop = clock.is_over
            try:
                run.advance_to(self._start)
                run.snapshot()
            except SimulationError as error:
                if first_parameter(str(error)) == first_parameter(text):
                    continue
            except Interrupted:
                return None
            return True
        return False

    def _is_refused_anyway(self, refused: ValueError) -> bool:
        """Return True if a scene is refused for the same reason without its spoiled values."""
        spoiled_with = self._stress.spoiled_with
        try:
            compile_scene(Scene.from_parameters({
                name: value for name, value in self._parameters.items()
                if name not in spoiled_with}))
        except ValueError as error:
            return str(error) == str(refused) and is_right_refusal(error, '')
        return False

    def _classify_stop(
        self, found: Finding, text: str, reason: str, run: Simulation, rate: float
    ) -> Finding:
        """Classify a `run` that stopped for `text`; the reference run stopped for `reason`."""
        scene = run.scene
        right = did_length_jump(text, run) or did_charges_pass(
            text, run, lambda: compile_reference(reference_scene(scene, rate))
        ) or self._had_to_stop(text, reason, scene, rate)
        if right is False and not found.is_given and found.added <= found.promised:
            # The run kept its promise until the stop, and its advice may help.
            right = self._does_advice_help(text, scene)
        verdict = _stop_verdict(right)
        if right is None:
            text = f'no time was left to try a shorter step; {text}'
        return found._replace(verdict=verdict, detail=' '.join(text.split()))

    def _find_missed_stop(self, run: Simulation, end: float, reason: str) -> str:
        """Return the reason for which a run should have stopped, or an empty string."""
        if not is_physical_stop(reason):
            return ''
        # The next health check may still stop the run.
        run.should_stop = self._clock.another().is_over
        try:
            run.advance_to(end + _EXTRA_DURATION_RATIO * self._stress.duration)
        except SimulationError as error:
            if is_physical_stop(str(error)):
                return ''
        except Interrupted:
            return ''
        return f'continued where a reference run stopped: {reason}'

    def _compare_all_windows(self, scene: Scene, rate: float, end: float) -> AddedError | None:
        """Return the errors added until `end` [s] in windows without gaps; None: time ran out."""
        run, clock = self._start_run(scene), self._clock.another()
        windows = Windows(run, rate, clock.is_over, max_windows=math.inf)
        try:
            windows.follow(end)
        except (Interrupted, SimulationError):
            return None
        return windows.result()

    def _classify_slow(self, run: Simulation) -> Finding:
        """Classify a scene by a run without windows, because windows took too long."""
        alone, clock = self._start_run(run.scene), self._clock.another()
        alone.should_stop = lambda: clock.is_over(_WINDOWS_TIME_RATIO)
        limit = run.status.fastest_term
        verdict, detail = Verdict.SLOW if limit else Verdict.HANG, (
            f'; the fastest motion is that of {limit}')
        try:
            alone.advance_to(self._stress.duration)
            verdict, detail = Verdict.UNJUDGED, (
                f' with a reference run; alone it takes {clock.seconds:.2g} s')
        except Interrupted:
            run = alone
        except SimulationError as error:
            run = alone
            verdict = Verdict.STOPPED if did_length_jump(str(error), alone) else Verdict.UNJUDGED
            detail = f' with a reference run; alone it stops: {error}'
        return _make_finding(
            self._stress, verdict,
            f'{run.status.step_count} steps to t = {run.time:.6g} s of '
            f'{self._stress.duration:.6g} s{detail}')._replace(
                method=run.status.method_name, bodies=run.scene.body_count,
                steps=run.status.step_count, time=run.time)

    def _find_bit_difference(
        self, run: Simulation, end: float, failure: SimulationError | None
    ) -> tuple[str, bool, bool]:
        """
        Repeat a run by two threads and from a checkpoint, and compare bit by bit.

        Returns the difference or an empty string, whether the runs were compared, and whether
        both threads had bodies.
        """
        with teams_of(2):
            threads = self._start_run(run.scene)
        restored = compile_scene(run.scene)
        # Implicit steps always use one thread.
        wanted = 1 if facts_of(run.status.method_name).implicit else 2
        if threads.status.thread_count != wanted or restored.status.thread_count != 1:
            raise RuntimeError('the judge requested two threads and one thread, and got '
                               f'{threads.status.thread_count} and {restored.status.thread_count}')
        shared = threads.status.busy_thread_count == 2
        for simulation in (threads, restored):
            simulation.should_stop = self._clock.is_over
        try:
            try:
                threads.advance_to(0.5 * (self._start + end))
                data = threads.checkpoint().to_bytes()
                restored.restore(Checkpoint.from_bytes(data))
                # The run may have stopped in the last step, which ends after the duration.
                late = 2.0 * (self._stress.duration + run.status.step)
                restored.advance_to(end if failure is None else late)
            except SimulationError as error:
                said = '' if failure is None else str(failure)
                if str(error) != said:
                    text = f'stopped elsewhere: {error}; the original run: {said or "no stop"}'
                    return text, True, shared
                return '', True, shared
        except Interrupted:
            return '', False, False
        if failure is not None:
            return f'did not stop; the original run: {failure}', True, shared
        one, two = run.snapshot(), restored.snapshot()
        for name in _STATE:
            if not np.array_equal(getattr(one, name), getattr(two, name), equal_nan=True):
                return f'{name} at t = {end!r} s differs', True, shared
        for name in ('error_estimate', 'step_count', 'step'):
            if getattr(run.status, name) != getattr(restored.status, name):
                return f'{name} at t = {end!r} s differs', True, shared
        return '', True, shared

    def _had_to_stop(
        self, text: str, reason: str, scene: Scene, rate: float
    ) -> bool | None:
        """Return True if the reason of a stop is right, and None if time ran out."""
        parameters = scene.parameters
        if parameters['connector.obstruction'] == 'stop' and (
                'connector.obstruction is stop' in text):
            return True
        tolerance = float(str(parameters['solver.tolerance']))
        step = float(str(parameters['solver.step']))
        smallest = _MIN_TOLERANCE_PER_RADIAN * rate
        if not step and 'solver.tolerance' in text and tolerance < smallest:
            return True
        # The reference run stops as well, and names the same parameter.
        name = first_parameter(text)
        if name and name == first_parameter(reason):
            return True
        if not step or 'solver.step' not in text:
            return False
        return self._was_step_too_long(text, reason, scene, step)

    def _does_advice_help(self, text: str, scene: Scene) -> bool | None:
        """Return True if the tolerance that `text` advises avoids the stop; None: time ran out."""
        if 'a smaller solver.tolerance makes steps shorter' not in text:
            return False
        clock, tolerance = self._clock.another(), float(str(scene.parameters['solver.tolerance']))
        for part in _SMALLER_TOLERANCE_RATIOS:
            run = self._start_run(scene.with_changes({'solver.tolerance': part * tolerance}))
            run.should_stop = clock.is_over
            try:
                run.advance_to(self._stress.duration)
            except SimulationError:
                continue
            except Interrupted:
                return None
            return True
        return False

    def _was_step_too_long(self, text: str, reason: str, scene: Scene, step: float) -> bool | None:
        """
        Return True if a given step was too long, and None if time ran out.

        A run with a shorter step then does not stop; or stops for the `reason` of the reference
        run; or stops later and for another reason, which ends all runs; or stops for a jump of a
        length that `text` announces.
        """
        clock, moment = self._clock.another(), stop_time(text)
        # Given implicit steps cannot account for energy that is dissipated within one step. Their
        # messages advise adaptive steps instead.
        is_implicit = facts_of(compile_scene(scene).status.method_name).implicit
        may_jump = 'the forces of connectors around them jump' in text
        for ratio in (*_SHORTER_STEP_RATIOS, *([0.0] if is_implicit or may_jump else [])):
            run = self._start_run(scene.with_changes({'solver.step': ratio * step}))
            run.should_stop = clock.is_over
            try:
                run.advance_to(self._stress.duration)
            except SimulationError as error:
                if may_jump and did_length_jump(str(error), run):
                    return True
                name = first_parameter(str(error))
                if name == first_parameter(text):
                    continue
                if run.time > moment or (name and name == first_parameter(reason)):
                    return True
                if not is_implicit:
                    return False
            except Interrupted:
                return None
            else:
                return True
        return False


def _stop_verdict(had_to: bool | None) -> Verdict:
    """Return the class of a run that stopped; None: not known whether it had to."""
    if had_to is None:
        return Verdict.UNJUDGED
    return Verdict.STOPPED if had_to else Verdict.WRONGLY_STOPPED


def classify_end(found: Finding, lacks: str, growth: Growth | None, distance: float) -> Finding:
    """
    Classify a run that reached its end.

    `lacks` lists errors that its estimate may not cover. `distance` is that from the reference run
    at the end, and `growth` is the growth of small displacements in the reference run.
    """
    added, promised = found.added, found.promised
    told = MAX_ERROR_RATIO * found.estimate >= added
    chaotic = growth is not None and (growth.is_sensitive or bool(growth.ended))
    if not added <= promised:
        ratio = f'{added:.3g} added, {promised:.3g} promised, {found.estimate:.3g} reported'
        if not found.is_given and added <= MAX_ERROR_RATIO * promised:
            return found._replace(verdict=Verdict.BETWEEN, detail=ratio)
        if told:
            return found._replace(verdict=Verdict.REPORTED, detail=ratio)
        if lacks:
            return found._replace(verdict=Verdict.EXCUSED, detail=f'{ratio}; {lacks}')
        return found._replace(verdict=Verdict.SILENT, detail=ratio)
    if chaotic:
        return found._replace(verdict=Verdict.CHAOTIC)
    if growth is not None:
        # The bound that `icofabric run` prints.
        bound = max(promised, found.estimate) * growth.largest
        if not distance <= MAX_ERROR_RATIO * bound:
            said = f'{distance:.3g} at the end, {bound:.3g} reported'
            if lacks:
                return found._replace(verdict=Verdict.EXCUSED, detail=f'{said}; {lacks}')
            return found._replace(verdict=Verdict.SILENT, detail=said)
    return found
