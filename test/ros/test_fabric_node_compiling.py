# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A new term on a running node with an empty kernel cache: the clock runs while it compiles."""
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from ros_helpers import Client, NodeProcess, parameter, write_scene

SCENE = {
    'weave': {'size': [2, 2, 2]},
    'solver': {'method': 'dop8'},
    'contact': {'mode': 'never'},
    'initial_random': {'velocity_sigma': 0.01, 'spin_sigma': 0.5, 'seed': 3},
}


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    """Let the processes of the test begin without compiled kernels."""
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path / 'kernels'))
    monkeypatch.delenv('ICOFABRIC_COMPILE_AHEAD', raising=False)


def set_together(client, **values):
    wanted = [parameter(name, value) for name, value in values.items()]
    return client.set_messages(wanted, atomically=True)


def test_the_clock_runs_while_a_new_term_compiles_and_the_bag_verifies(tmp_path, empty_cache):
    scene = write_scene(tmp_path / 'scene.yaml', SCENE)
    bag, ticks = tmp_path / 'bag', []
    with NodeProcess(
            tmp_path / 'log', scene=scene, parameters={'record.path': str(bag)}) as node, \
            Client(node) as client:
        texts, clock, poses = (
            client.listen(topic) for topic in ('~/events', '/clock', '~/poses'))

        def events(*names):
            told = map(json.loads, list(texts))
            return [event for event in told if event['event'] in names]

        def swapped():
            if clock:
                ticks.append((time.monotonic(), clock[-1]))
            return events('reweave', 'change_refused')

        client.wait_until(10**8)
        began = time.monotonic()
        answer = set_together(client, drag__linear=0.01)
        assert answer.successful and answer.reason.startswith('drag.linear: accepted; ')
        # Both come while the first one compiles; one replaces its value.
        answer = set_together(client, drag__linear=0.02, gravity=[0.0, 0.0, -1.0])
        assert answer.successful and 'reweave' in answer.reason
        assert client.call('~/reset').success and not events('reweave')
        count = len(poses)
        client.wait_for(swapped, 'the changed fabric')
        took = time.monotonic() - began
        [change] = events('reweave', 'change_refused')
        assert change['changed'] == ['drag.linear', 'gravity'] and not change['restarts']
        assert len(node.lines('the old fabric continues until the kernels')) == 1
        assert client.get('drag.linear') == [0.02]
        # Wall times at which the clock had moved on.
        moves = [wall for (wall, now), (_, before) in zip(ticks[1:], ticks) if now > before]
        longest = max(np.diff([ticks[0][0], *moves, ticks[-1][0]]))
        print(f'\n{took:.1f} s of compilation, the clock stood still for at most {longest:.3f} s, '
              f'{len(poses) - count} poses')
        assert took > 0.5 and longest < 0.3 * took and len(poses) - count > 5.0 * took
        client.wait_until(client.clock + 3 * 10**8)
        node.send(signal.SIGINT)
        assert node.wait() == 0
    done = subprocess.run(
        [sys.executable, '-m', 'icofabric_sim.commands.main', 'verify', str(bag)],
        capture_output=True, text=True, env=os.environ, timeout=300)
    assert done.returncode == 0 and 'identical' in done.stdout, done.stdout + done.stderr
    assert '1 re-weave' in done.stdout, done.stdout
