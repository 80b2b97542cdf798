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
Runs one random scene and says to which class it belongs.

Beside the run go: references and displaced companions in windows (`windows.py`), one far tighter
run with a companion from the start, and the same run by two threads that goes on from a checkpoint
in its middle.
"""

import logging
import math
from pathlib import Path
import re
import tempfile
import time
import traceback
from typing import Final

from icofabric_sim.kernels.runtime.compile_notice import compile_notice
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.checkpoint import Checkpoint
from icofabric_sim.simulation.divergence import Companion, distance_between, Growth
from icofabric_sim.simulation.errors import Interrupted, SimulationError
from icofabric_sim.simulation.simulation import compile_scene, Simulation
from icofabric_sim.studies.stress.scenes import StressScene
from icofabric_sim.studies.stress.verdict import Finding, Verdict
from icofabric_sim.studies.stress.windows import Added, rate_of, reference_scene, Windows
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
_STATE = ('position', 'orientation', 'linear_velocity', 'angular_velocity', 'intact')


class _Clock:
    """Processor time without that of the compiler, since it was made."""

    def __init__(self, limit: float) -> None:
        self._start, self._compiled = time.process_time(), compile_notice.seconds
        self.limit = limit

    @property
    def seconds(self) -> float:
        compiled = compile_notice.seconds - self._compiled
        return max(time.process_time() - self._start - compiled, 0.0)

    def is_over(self, part: float = 1.0) -> bool:
        return self.seconds > part * self.limit


def judge(stress: StressScene, *, seconds: float = SECONDS) -> Finding:
    """Run a scene within so much processor time [s], and class it."""
    clock = _Clock(seconds)
    logger = logging.getLogger('icofabric_sim')
    handler = _Silent()
    logger.addHandler(handler)
    propagated, logger.propagate = logger.propagate, False
    try:
        with tempfile.TemporaryDirectory() as folder:
            finding = _Judge(stress, clock, Path(folder)).finding()
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

    def __init__(self, stress: StressScene, clock: _Clock, folder: Path) -> None:
        self._stress, self._clock = stress, clock
        self._parameters = stress.placed(folder)

    def finding(self) -> Finding:
        stress = self._stress
        try:
            scene = Scene.from_parameters(self._parameters)
            run = compile_scene(scene)
        except ValueError as error:
            return _finding(stress, self._refusal(error), str(error))
        # A single body has no step that is too long.
        if stress.spoiled and stress.spoiled != 'solver.step':
            return _finding(
                stress, Verdict.SILENT, f'{stress.spoiled} had to be refused, and was not')
        run.warm_up()
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
            if not run.time > _ENOUGH * stress.duration:
                return self._slow(run)
        run.should_stop = None
        added, end = windows.result(), run.time
        # Where the run stopped the other one has to come to what it stopped for.
        growth, distance, reason = self._whole(
            run, rate, end if failure is None else self._stress.duration)
        other, compared = self._other_bits(run, end, failure)
        found = _finding(stress, Verdict.WITHIN, '')._replace(
            method=run.status.method_name, bodies=scene.body_count, steps=run.status.step_count,
            is_given=float(str(scene.parameters['solver.step'])) > 0.0, time=end,
            added=added.error, promised=added.promised, estimate=run.error_estimate,
            growth=0.0 if growth is None else growth.largest, compared=compared)
        if other:
            return found._replace(verdict=Verdict.OTHER_BITS, detail=other)
        if failure is not None:
            right = self._is_right(str(failure), reason, scene, rate)
            return found._replace(
                verdict=Verdict.STOPPED if right else Verdict.WRONGLY_STOPPED,
                detail=' '.join(str(failure).split()))
        if growth is not None and not compares:
            # From its start alone.
            known = not (growth.is_sensitive or growth.ended)
            found = found._replace(added=distance / max(growth.largest, 1.0) if known else 0.0)
        verdict = self._classed(found, run, growth, distance)
        if verdict.verdict not in (Verdict.SILENT, Verdict.BETWEEN) or not compares:
            return verdict
        # Single windows may stand for many: look at all of them.
        again = self._all_windows(scene, rate)
        return verdict if again is None else self._classed(
            found._replace(added=again.error, promised=again.promised), run, growth, distance)

    def _all_windows(self, scene: Scene, rate: float) -> Added | None:
        """What a run adds, with windows everywhere; None where there is no time for it."""
        run, clock = compile_scene(scene), _Clock(self._clock.limit)
        windows = Windows(run, rate, clock.is_over, most=math.inf)
        try:
            windows.follow(self._stress.duration)
        except (Interrupted, SimulationError):
            return None
        return windows.result()

    def _refusal(self, error: ValueError) -> Verdict:
        """Whether a refusal names a parameter that was given, and the one that was spoiled."""
        text, given = str(error), self._parameters
        names = [name for name in given if _names(text, name)]
        if isinstance(error, ParameterError) and error.name in given:
            names.append(error.name)
        if not names:
            return Verdict.WRONGLY_REFUSED
        return Verdict.REFUSED

    def _slow(self, run: Simulation) -> Finding:
        limit = run.status.fastest_term
        detail = (
            f'{run.status.step_count} steps to t = {run.time:.6g} s of '
            f'{self._stress.duration:.6g} s; the fastest motion is that of {limit}')
        return _finding(
            self._stress, Verdict.SLOW if limit else Verdict.HANG, detail)._replace(
                method=run.status.method_name, bodies=run.scene.body_count,
                steps=run.status.step_count, time=run.time)

    def _whole(
        self, run: Simulation, rate: float, end: float
    ) -> tuple[Growth | None, float, str]:
        """A far tighter run from the start: growth, distance at the end, and why it stopped."""
        reference = compile_scene(reference_scene(run.scene, rate))
        reference.should_stop = lambda: self._clock.is_over(_WHOLE_PART)
        companion = Companion(reference)
        try:
            for part in range(1, 9):
                reference.advance_to(end * part / 8.0)
                companion.look()
        except SimulationError as error:
            return None, 0.0, str(error)
        except Interrupted:
            return None, 0.0, ''
        distance = distance_between(
            run.snapshot(), reference.snapshot(), run.scene.geometry.half_edge)
        return companion.result(), distance, ''

    def _other_bits(
        self, run: Simulation, end: float, failure: SimulationError | None
    ) -> tuple[str, bool]:
        """What two threads and a checkpoint change; and whether it was compared."""
        scene = run.scene
        threads = compile_scene(scene.with_changes({'solver.threads': 2}))
        restored = compile_scene(scene)
        for simulation in (threads, restored):
            simulation.should_stop = self._clock.is_over
        try:
            try:
                threads.advance_to(0.5 * end)
                data = threads.checkpoint().to_bytes()
                restored.restore(Checkpoint.from_bytes(data))
                restored.advance_to(end if failure is None else 2.0 * self._stress.duration)
            except SimulationError as error:
                said = '' if failure is None else str(failure)
                if str(error) != said:
                    return f'stopped elsewhere: {error}; the run itself: {said or "went on"}', True
                return '', True
        except Interrupted:
            return '', False
        if failure is not None:
            return f'did not stop; the run itself: {failure}', True
        one, two = run.snapshot(), restored.snapshot()
        for name in _STATE:
            if not np.array_equal(getattr(one, name), getattr(two, name), equal_nan=True):
                return f'{name} at t = {end!r} s differs', True
        for name in ('error_estimate', 'step_count', 'step'):
            if getattr(run.status, name) != getattr(restored.status, name):
                return f'{name} at t = {end!r} s differs', True
        return '', True

    def _is_right(self, text: str, reason: str, scene: Scene, rate: float) -> bool:
        """Whether a run had to stop for what it says."""
        if float(str(scene.parameters['solver.step'])) > 0.0 and 'solver.step' in text:
            return True
        if scene.parameters['connector.obstruction'] == 'stop' and (
                'connector.obstruction is stop' in text):
            return True
        tolerance = float(str(scene.parameters['solver.tolerance']))
        if 'solver.tolerance' in text and tolerance < _BEYOND_REACH * rate:
            return True
        # The far tighter run stops as well, and names the same.
        return bool(reason) and _first_name(text) == _first_name(reason)

    def _classed(
        self, found: Finding, run: Simulation, growth: Growth | None, distance: float
    ) -> Finding:
        """The class of a run that came to its end."""
        added, promised, lacks = found.added, found.promised, run.status.error_estimate_lacks
        told = FACTOR * found.estimate >= added
        chaotic = growth is not None and (growth.is_sensitive or bool(growth.ended))
        if not added <= promised:
            ratio = f'{added:.3g} added, {promised:.3g} promised, {found.estimate:.3g} said'
            if not found.is_given and added <= FACTOR * promised:
                return found._replace(verdict=Verdict.BETWEEN, detail=ratio)
            if told or lacks:
                return found._replace(
                    verdict=Verdict.SAID, detail=f'{ratio}; {lacks}' if lacks else ratio)
            return found._replace(verdict=Verdict.SILENT, detail=ratio)
        if chaotic:
            return found._replace(verdict=Verdict.CHAOTIC)
        if growth is not None:
            # The bound that `icofabric run` prints.
            bound = max(promised, found.estimate) * growth.largest
            if not distance <= FACTOR * bound and not lacks:
                return found._replace(
                    verdict=Verdict.SILENT,
                    detail=f'{distance:.3g} at the end, {bound:.3g} said')
        return found


def _names(text: str, name: str) -> bool:
    return re.search(rf'(?<![\w.]){re.escape(name)}(?![\w])', text) is not None


def _first_name(text: str) -> str:
    """The first parameter that a sentence names; '': none."""
    found = re.search(r'\b[a-z]+(?:_[a-z]+)*\.[a-z_]+(?:\.[a-z_]+)*\b', text)
    return found.group() if found else ''
