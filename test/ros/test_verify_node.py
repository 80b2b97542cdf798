# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A real node, driven over the graph at random moments: each of its bags verifies identical."""
import signal
import time

from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.running.replay.verify import verify_run
import numpy as np
from ros_helpers import Client, NodeProcess, write_scene

SCENE = {
    'weave': {'size': [3, 3, 3], 'connector_angle': 0.3},
    'gravity': [0.0, 0.0, -9.81],
    'groups': {'wall': 'x_min', 'tip': 'x_max'},
    'supports': {'wall': {'group': 'wall'}},
    'loads': {'tip': {'group': 'tip', 'share': 'total', 'hold': 0.2}},
    'contact': {'mode': 'never'},
}


def verified(path):
    with RecordedRun(path) as run:
        result = verify_run(run)
    assert result.verdict == 'identical', result.lines()
    assert result.compared['~/poses'] > 5
    return result.repeated


def test_run_driven_over_the_graph_is_identical(tmp_path):
    scene = write_scene(tmp_path / 'scene.yaml', SCENE)
    parameters = {'record.path': str(tmp_path / 'bag'), 'step_count': 9}
    generator = np.random.default_rng(3)
    with NodeProcess(tmp_path / 'log', scene=scene, parameters=parameters) as node, \
            Client(node) as client:
        client.wait_until(10**8)
        for number in range(1, 61):
            force = 0.2 * generator.standard_normal(3)
            if generator.random() < 0.5:
                client.push('~/loads/tip', force=force)
            else:
                client.push('~/wrench', force=force, frame=f'icosahedron_{number % 14}')
            time.sleep(float(generator.uniform(0.0, 0.05)))
            if number % 15 == 0:
                client.set(**{'connector.stiffness': float(generator.uniform(300.0, 900.0))})
            if number % 20 == 0:
                client.pause()
                assert client.call('~/step').success
                client.pause(False)
            if number == 25:
                assert client.call('~/reset').success
            if number == 32:
                assert client.call('~/record', 'std_srvs/srv/SetBool', data=True).success
            if number == 40:
                client.set(**{'weave.size': [4, 3, 3]})
        node.send(signal.SIGINT)
        assert node.wait() == 0
    first, second = (verified(tmp_path / name) for name in ('bag', 'bag_1'))
    assert first['inputs'] > 20 and first['re-weaves'] >= 1 and first['resets'] == 1
    assert first['steps'] == 1 and second['steps'] == 2
    assert second['begun at a checkpoint'] == 1 and second['inputs'] > 15
    assert second['re-weaves'] >= 2


def test_renamed_topic_is_recorded_under_its_own_name(tmp_path):
    scene = write_scene(tmp_path / 'scene.yaml', SCENE)
    with NodeProcess(
        tmp_path / 'log', '--ros-args', '-r', '~/loads/tip:=/finger', scene=scene,
        parameters={'record.path': str(tmp_path / 'bag')},
    ) as node, Client(node) as client:
        client.wait_until(10**8)
        client.push('/finger', force=(0.0, 0.5, 0.0))
        client.settle()
        client.wait_until(client.clock + 3 * 10**8)
        node.send(signal.SIGINT)
        assert node.wait() == 0
    with RecordedRun(tmp_path / 'bag') as run:
        assert [entry.topic for entry in run.inputs()] == ['/icofabric/loads/tip']
    assert verified(tmp_path / 'bag')['inputs'] == 1
