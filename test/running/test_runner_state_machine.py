# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A runner against a plain model: random calls in random order, and every bag verifies as identical.

The run stands paused between the calls, so that the model knows its time to the nanosecond.
"""
from pathlib import Path
import shutil
import tempfile

import pytest

pytest.importorskip('hypothesis', reason='requirements-test.txt lists it')

from hypothesis import strategies as st  # noqa: E402
from hypothesis.stateful import (  # noqa: E402
    rule,
    RuleBasedStateMachine,
    run_state_machine_as_test,
)
import icofabric_sim as ico  # noqa: E402
from icofabric_sim.bag.recorded_run import RecordedRun  # noqa: E402
from icofabric_sim.parameters.validation import ParameterError  # noqa: E402
from icofabric_sim.running.parameter_change import ParameterChange
from icofabric_sim.running.recording import BagSink, summarise_run  # noqa: E402
from icofabric_sim.running.replay.verify import verify_run  # noqa: E402
from icofabric_sim.running.runner import Runner  # noqa: E402
from icofabric_sim.running.time_requests import AdvanceRequest, StepRequest  # noqa: E402
from runner_helpers import Beside, push, SCENE  # noqa: E402
from state_machines import examples  # noqa: E402

SPANS = st.integers(0, 4_000_000)  # ns
FORCES = st.integers(-5, 5).map(lambda number: (0.0, 0.0, 0.01 * number))
LIMIT = 60.0


class RunnerMachine(RuleBasedStateMachine):
    """What services of a node may ask of its run."""

    def __init__(self):
        super().__init__()
        self.folder = Path(tempfile.mkdtemp(prefix='icofabric_runner_'))
        simulation = ico.compile_scene(ico.Scene.from_parameters({
            **SCENE, 'start_paused': True, 'duration': 0.0, 'publish_rate': 500.0,
            'clock_rate': 1000.0, 'initial_random': {'velocity_sigma': 0.1},
            'record': {'path': str(self.folder / 'bag')}}))
        self.bag = BagSink(self.folder / 'bag', simulation, live=False)
        self.runner = Runner(simulation, [self.bag])
        self.beside = Beside(self.runner)
        self.beside.__enter__()
        self.now, self.saved = 0, {}
        # (time, key, force) of what was sent since all loads were last taken off.
        self.sent = []

    def _stands(self):
        assert self.runner.post(lambda: self.runner.now).result(LIMIT) == self.now
        assert self.runner.paused and self.runner.failure == ''

    @rule(count=st.integers(1, 5))
    def step(self, count):
        before = self.runner.simulation.status.step_count
        time = self.runner.take_steps(StepRequest(count)).result(LIMIT)
        assert time > self.now
        assert self.runner.simulation.status.step_count - before >= count
        self.now = time
        self._stands()

    @rule(span=SPANS)
    def advance(self, span):
        assert self.runner.advance(AdvanceRequest(span + 1)).result(LIMIT) == self.now + span + 1
        self.now += span + 1
        self._stands()

    @rule()
    def go_on_for_a_moment(self):
        assert self.runner.set_paused(False).result(LIMIT) == self.now
        with pytest.raises(RuntimeError, match='only while paused'):
            self.runner.take_steps().result(LIMIT)
        time = self.runner.set_paused(True).result(LIMIT)
        assert time >= self.now
        self.now = time
        self._stands()

    @rule(key=st.sampled_from(['tip', 2]), force=FORCES, ahead=SPANS, then=SPANS)
    def push(self, key, force, ahead, then):
        dropped = self.runner.dropped
        push(self.runner, key, stamp=self.now + ahead, force=force)
        self.sent.append((self.now + ahead, key, force))
        self._stands()
        self.advance(then)
        assert self.runner.dropped == dropped
        acting = self.runner.simulation.status.active_loads
        # What acts last rules; of one time, what was sent last.
        _, _, force = max(
            (item for item in reversed(self.sent) if item[1] == key and item[0] <= self.now),
            key=lambda item: item[0], default=(0, key, None))
        if force is not None:
            assert (acting[key].force.tolist() if key in acting else [0.0] * 3) == list(force)

    @rule(data=st.binary(max_size=60))
    def push_nonsense(self, data):
        dropped = self.runner.dropped
        self.runner.inputs.receive('~/loads/tip', data)
        self._stands()
        assert self.runner.dropped == dropped + 1

    @rule()
    def clear(self):
        assert self.runner.clear_loads().result(LIMIT) == self.now
        self.sent.clear()
        assert self.runner.simulation.status.active_loads == {}
        assert self.runner.status().loads_waiting == 0

    @rule(time_reset=st.booleans())
    def reset(self, time_reset):
        time = self.runner.reset(time_reset=time_reset).result(LIMIT)
        assert time == (0 if time_reset else self.now)
        self.now = time
        self.sent.clear()
        assert self.runner.simulation.status.active_loads == {}
        self._stands()

    @rule(wanted=st.sampled_from([
        {'connector.stiffness': 300.0}, {'shell.density': 1100.0}, {'weave.variant': 1},
        {'weave.variant': 0}, {'publish_rate': 250.0}, {'gravity': [0.0, 0.0, -1.0]}]))
    def change(self, wanted):
        before = self.runner.parameters
        change = ParameterChange(before, before.with_changes(wanted))
        self.runner.apply_change(change).result(LIMIT)
        assert change.outcome.result(LIMIT) == ''
        self._stands()
        assert all(self.runner.parameters[name] == value for name, value in wanted.items())

    @rule(wrong=st.sampled_from([
        ('connector.stiffness', -1.0), ('weave.size', [0, 1, 1]), ('nothing', 1),
        ('record.compression', 'zip'), ('solver.threads', 2)]))
    def refuse(self, wrong):
        name, value = wrong
        before = self.runner.parameters
        try:
            self.runner.change(before.with_changes({name: value})).result(LIMIT)
        except ParameterError as error:
            assert name in str(error)
            assert self.runner.parameters is before
        else:
            assert name == 'solver.threads'
        self._stands()

    @rule(number=st.integers(0, 3))
    def save(self, number):
        path = self.folder / f'{number}.checkpoint'
        assert self.runner.save_checkpoint(path).result(LIMIT) == str(path)
        self.saved[number] = self.now, dict(self.runner.simulation.scene.parameters)
        self._stands()

    @rule(number=st.integers(0, 4))
    def restore(self, number):
        time, scene = self.saved.get(number, (None, None))
        restored = self.runner.restore_checkpoint(self.folder / f'{number}.checkpoint')
        if time is None:
            with pytest.raises(OSError, match='No such file'):
                restored.result(LIMIT)
        else:
            try:
                assert restored.result(LIMIT) == time
                self.now = time
                self.sent.clear()
            except ValueError as error:
                assert 'cannot be restored here' in str(error)
                assert scene != dict(self.runner.simulation.scene.parameters)
        self._stands()

    @rule(on=st.booleans())
    def record(self, on):
        said = self.runner.set_recording(on).result(LIMIT)
        assert ('recording to' in said) == on
        assert self.bag.is_recording == on
        self._stands()

    def teardown(self):
        self.beside.__exit__(None, None, None)
        self.bag.close(summary=summarise_run(self.runner.status()))
        bags = [path for path in sorted(self.folder.iterdir()) if path.is_dir()]
        assert bags
        for path in bags:
            with RecordedRun(path, '/icofabric') as run:
                found = verify_run(run)
            assert found.verdict == 'identical', (path.name, found.lines())
        shutil.rmtree(self.folder)


@pytest.mark.examples
def test_any_requests_in_any_order_do_what_the_model_says_and_verify():
    run_state_machine_as_test(RunnerMachine, settings=examples(12, 15))
