# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A live node against a plain model: what its services answer, and what its clock then shows."""
import math

import pytest

pytest.importorskip('hypothesis', reason='requirements-test.txt lists it')

from hypothesis import strategies as st  # noqa: E402
from hypothesis.stateful import (  # noqa: E402
    rule,
    RuleBasedStateMachine,
    run_state_machine_as_test,
)
from state_machines import examples  # noqa: E402

SCENE = {
    'weave': {'size': [2, 2, 2]}, 'contact': {'mode': 'never'},
    'groups': {'tip': 'ids 1'}, 'loads': {'tip': {'group': 'tip'}},
    'initial_random': {'velocity_sigma': 0.1}, 'start_paused': True, 'reset_time': True,
}


def machine_of(client, folder):
    """Class of machines that share one node, which each of them resets."""

    class NodeMachine(RuleBasedStateMachine):

        def __init__(self):
            super().__init__()
            client.pause()
            client.set(reset_time=True, connector__stiffness=500.0)
            assert client.call('~/reset').success
            self.now, self.saved = 0, None
            self.stiffness, self.recording = 500.0, False
            client.call('~/record', 'std_srvs/srv/SetBool', data=False)
            self._shown()

        def _shown(self):
            """The clock of a paused node repeats the time of the model."""
            client.next('/clock', lambda time: time == self.now)

        def _event(self, name, act):
            kept = client.listen('~/events')
            before = len(kept)
            answer = act()
            client.wait_for(
                lambda: any(f'"{name}"' in text for text in kept[before:]), f'event {name}')
            return answer

        @rule()
        def pause_again(self):
            assert self._event('pause', client.pause) == self.now

        @rule(milliseconds=st.integers(1, 5))
        def advance(self, milliseconds):
            client.set(advance_duration=1e-3 * milliseconds)
            answer = self._event('advanced', lambda: client.call('~/advance'))
            assert answer.success, answer.message
            self.now += milliseconds * 10**6
            self._shown()

        @rule(count=st.integers(1, 3))
        def step(self, count):
            client.set(step_count=count)
            answer = self._event('step', lambda: client.call('~/step'))
            assert answer.success, answer.message
            time = client.pause()
            assert time > self.now
            self.now = time
            self._shown()

        @rule()
        def go_on_for_a_moment(self):
            assert client.pause(False) == self.now
            answer = client.call('~/step')
            assert not answer.success and 'only while paused' in answer.message
            time = client.pause()
            assert time >= self.now
            self.now = time
            self._shown()

        @rule(reset_time=st.booleans())
        def reset(self, reset_time):
            client.set(reset_time=reset_time)
            assert self._event('reset', lambda: client.call('~/reset')).success
            self.now = 0 if reset_time else self.now
            self._shown()

        @rule(force=st.sampled_from([0.0, 0.01, -0.02, math.nan, math.inf]))
        def push(self, force):
            client.push('~/loads/tip', (0.0, 0.0, force))
            client.settle()
            self._shown()

        @rule()
        def clear(self):
            assert self._event('loads_cleared', lambda: client.call('~/clear_loads')).success

        @rule(stiffness=st.sampled_from([300.0, 500.0, 800.0]))
        def change(self, stiffness):
            client.set(connector__stiffness=stiffness)
            self.stiffness = stiffness
            assert client.get('connector.stiffness') == [stiffness]
            self._shown()

        @rule(wrong=st.sampled_from([
            {'connector__stiffness': -1.0}, {'connector__stiffness': math.nan},
            {'weave__size': [0, 1, 1]}, {'no__such': 1}, {'record__path': 3}]))
        def refuse(self, wrong):
            [result] = client.set_each(**wrong)
            assert not result.successful
            assert next(iter(wrong)).replace('__', '.') in result.reason
            assert client.get('connector.stiffness') == [self.stiffness]
            self._shown()

        @rule(on=st.booleans())
        def record(self, on):
            answer = client.call('~/record', 'std_srvs/srv/SetBool', data=on)
            assert answer.success, answer.message
            assert ('recording to' in answer.message) == on

        @rule()
        def save(self):
            answer = client.call('~/save_checkpoint')
            assert answer.success, answer.message
            self.saved = self.now, self.stiffness

        @rule()
        def restore(self):
            answer = client.call('~/restore_checkpoint')
            if self.saved is None:
                # An earlier machine may have left one.
                self.now = client.pause()
            elif self.saved[1] == self.stiffness:
                assert answer.success, answer.message
                self.now = self.saved[0]
            else:
                assert not answer.success and 'connector.stiffness' in answer.message
            self._shown()

    return NodeMachine


@pytest.mark.examples
def test_services_in_any_order_answer_as_the_model_says(client, folder):
    client.set(checkpoint__path=str(folder / 'a.checkpoint'), record__path=str(folder / 'bag'))
    run_state_machine_as_test(machine_of(client, folder), settings=examples(3, 8))
