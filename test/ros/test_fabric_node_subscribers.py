# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Subscribers that are slow, stuck or gone: the simulation and the others go on, drops are counted.
"""
from contextlib import contextmanager
import os
import signal
import subprocess
import sys
import time

from icofabric_sim.messages import WARN
from icofabric_sim.running.diagnostics import NOT_TAKEN
import numpy as np
import pytest
from ros_helpers import Client, domain, next_line, NodeProcess, reasons, ROOT, write_scene

# 1,000 bodies: messages of 56 to 200 kB.
SCENE = {
    'weave': {'size': [13, 13, 12]},
    'contact': {'mode': 'never'},
    'initial_random': {'velocity_sigma': 0.001},
    'solver': {'method': 'leapfrog', 'step': 0.0004},
    'real_time_factor': 0.5,
}


@pytest.fixture(scope='module')
def client(client):
    client.listen('~/poses')
    client.listen('/clock')
    return client


@contextmanager
def listening(offset=0):
    """Another process that has heard every topic once."""
    with subprocess.Popen(
            [sys.executable, str(ROOT / 'test' / 'stuck_subscriber.py')], cwd=ROOT, text=True,
            stdout=subprocess.PIPE,
            env={**os.environ, 'ROS_DOMAIN_ID': str(domain(offset)), 'PYTHONPATH': str(ROOT)},
    ) as process:
        try:
            # The middleware may have lines of its own.
            assert any(next_line(process) == 'hears all\n' for _ in range(5))
            yield process
        finally:
            process.kill()


@pytest.fixture
def other():
    with listening() as process:
        yield process


def count(status):
    return int(status.values[NOT_TAKEN])


def rhythm(client, seconds):
    """Longest wall time [s] between two poses, and how many came, for a while."""
    poses, times, known = client.received['/icofabric/poses'], [], 0
    known, end = len(poses), time.monotonic() + seconds
    first = known
    while time.monotonic() < end:
        if len(poses) > known:
            known = len(poses)
            times.append(time.monotonic())
        time.sleep(0.002)
    gaps = [late - early for early, late in zip(times, times[1:])]
    return max(gaps, default=seconds), known - first


def test_healthy_subscribers_take_everything(client, other):
    time.sleep(12.0)  # longer than it takes to be thought stuck
    assert count(client.health()) == 0


def test_stuck_subscriber_holds_nobody_up(client, other):
    """
    Stopped in the middle of things, it takes nothing, and says nothing either.

    The middleware may need a second to notice; what it drops meanwhile, it drops for everyone.
    """
    gap, number = rhythm(client, 3.0)
    poses, before = client.received['/icofabric/poses'], client.clock
    other.send_signal(signal.SIGSTOP)
    began = time.monotonic()
    time.sleep(2.0)
    noticed = len(poses)
    status = client.health(lambda status: count(status) > 0)
    assert status.level == WARN and 'all subscribers' in reasons(status)
    # However busy the machine is, the other one goes on to receive poses.
    end = time.monotonic() + 30.0
    while len(poses) <= noticed + 60 and time.monotonic() < end:
        time.sleep(0.05)
    passed = time.monotonic() - began
    grid = [round(pose.nanoseconds * 60 / 1e9) for pose in poses[noticed:]]
    assert len(grid) > 60 and (np.diff(grid) > 0).all()
    assert client.clock > before
    print(f'\nposes: {number / 3.0:.1f} a second, longest gap {1e3 * gap:.0f} ms; beside a stuck '
          f'subscriber real-time factor {(client.clock - before) * 1e-9 / passed:.3f} of 0.5; '
          f'{count(status)} counted')
    other.send_signal(signal.SIGCONT)
    client.health(lambda status: 'all subscribers' not in reasons(status))


def test_subscribers_that_die_are_forgotten(client):
    """
    Killed in the middle of reading, they keep what they had not read for a while.

    With 512 kB of shared memory the others then heard nothing for 12 s.
    """
    poses = client.listen('~/poses')
    for _ in range(4):
        with listening() as other:
            other.kill()
            known = len(poses)
            client.wait_for(lambda known=known: len(poses) > known + 30, 'poses')
    stamps = [pose.nanoseconds for pose in poses]
    assert (np.diff(stamps) > 0).all()
    print(f'\nlongest step between two poses {np.diff(stamps).max() * 1e-6:.0f} ms')


def test_end_does_not_wait_for_a_stuck_subscriber(tmp_path):
    scene = write_scene(tmp_path / 'scene.yaml', SCENE)
    with NodeProcess(tmp_path / 'log', scene=scene, offset=1) as node, \
            Client(node, offset=1) as client, listening(1) as other:
        client.listen('~/poses')
        other.send_signal(signal.SIGSTOP)
        client.next('~/poses')
        began = time.monotonic()
        assert node.stop() == 0
        print(f'\nthe node ended within {time.monotonic() - began:.2f} s')
