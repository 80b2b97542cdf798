# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Twists that take over drives: when they act, that records repeat them, and what is dropped."""

import icofabric_sim as ico
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.messages import TwistStampedBytes
from icofabric_sim.running.replay.verify import verify_run
from icofabric_sim.running.runner import Runner
import numpy as np
import pytest
from recorded_runs import DRIVEN_SCENE, record_run, Sent
from runner_helpers import Beside

LINEAR, ANGULAR = np.array([0.02, 0.0, -0.01]), np.array([0.0, 0.5, 0.0])


def twist(stamp, linear=LINEAR, angular=ANGULAR, drive='top'):
    message = TwistStampedBytes('')
    message.linear[:], message.angular[:] = linear, angular
    return Sent(f'~/drives/{drive}', message.stamped(stamp))


def test_record_with_twists_is_identical(tmp_path):
    scene = ico.Scene.from_parameters({
        **DRIVEN_SCENE, 'real_time_factor': 0.0, 'duration': 0.3})
    record_run(tmp_path / 'bag', scene, twist(60_000_000), twist(
        123_456_789, -2.0 * LINEAR, np.zeros(3)))
    with RecordedRun(tmp_path / 'bag') as run:
        result = verify_run(run)
        assert result.verdict == 'identical' and not result.difference, result.lines()
        assert result.repeated['inputs'] == 2
    simulation = ico.compile_scene(scene)
    simulation.apply_twist('top', LINEAR, ANGULAR, time=0.06)
    simulation.apply_twist('top', -2.0 * LINEAR, time=0.123456789)
    simulation.advance_to(0.3)
    bodies = scene.drives['top'].bodies
    way = simulation.snapshot().position[bodies].mean(axis=0) - scene.drives['top'].middle
    moved = LINEAR * (0.123456789 - 0.06) - 2.0 * LINEAR * (0.3 - 0.123456789)
    assert way == pytest.approx(moved, abs=1e-12)


def test_twist_for_a_drive_that_is_gone_is_dropped():
    scene = ico.Scene.from_parameters(DRIVEN_SCENE)
    runner = Runner(ico.compile_scene(scene), [])
    with Beside(runner) as beside:
        runner.inputs.receive(*twist(0, drive='other'))
        beside.wait_for(lambda: runner.status().dropped == 1)
