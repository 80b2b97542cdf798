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
"""When simulated time counts as standing still: slow, and by steps much shorter than at first."""
from icofabric_sim.running import stall
from icofabric_sim.running.stall import StallWatch
import pytest
from runner_helpers import Beside, ListSink, make_runner


@pytest.mark.parametrize(('speed', 'step', 'stalls'), [
    (1e-3, 1e-8, True), (1e-3, 1e-5, False), (0.5, 1e-8, False)])
def test_slow_by_short_steps_is_a_stall(speed, step, stalls):
    watch = StallWatch()
    watch.begin(1e-3)
    said = [watch.note(0.1 * speed, 0.1, step) for _ in range(100)]
    assert any(said) == stalls
    if stalls:
        first = next(text for text in said if text)
        assert '1e-08 s' in first and '100,000 times shorter' in first and 'reset' in first
        # A motion that begins anew is judged by its own steps.
        watch.begin(1e-8)
        assert not any(watch.note(0.1 * speed, 0.1, step) for _ in range(100))


def test_run_that_stalls_stops_and_goes_on_after_a_reset(monkeypatch):
    monkeypatch.setattr(stall, '_WINDOW', 0.0)
    monkeypatch.setattr(stall, '_SLOWEST', 1e9)
    runner = make_runner(ListSink(), duration=0.0, start_paused=True)
    assert runner._time.stall is None  # who runs it to its end is patient
    runner._time.stall = StallWatch()
    with Beside(runner) as beside:
        runner._time.stall.begin(1e3)
        future = runner.advance()
        with pytest.raises(RuntimeError, match='advanced by.*nearly still'):
            future.result(60.0)
        assert 'nearly still' in runner.failure
        runner.reset().result(60.0)
        assert not runner.failure
        runner.set_paused(False)
        before = runner.now
        beside.wait_for(lambda: runner.now > before + 10**7)
        assert not runner.failure
