# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Several fabrics in one graph, one clock, and a fabric that is set to follow simulated time itself.
"""
import time

from icofabric_sim.messages import WARN
import pytest
from ros_helpers import Client, NodeProcess, reasons, wait_for, write_scene

SCENE = {
    'weave': {'size': [2, 2, 2]},
    'contact': {'mode': 'never'},
    'gravity': [0.0, 0.0, -1.0],
    'groups': {'tip': 'x_max'},
    'loads': {'tip': {'group': 'tip'}},
}


def in_namespace(folder, name, *, offset=0, **parameters):
    """A fabric `/name/icofabric`."""
    scene = write_scene(folder / 'scene.yaml', SCENE)
    return NodeProcess(folder / f'{name}.log', '-r', f'__ns:=/{name}', scene=scene,
                       parameters=parameters, offset=offset)


def status_of(client, name, condition=lambda status: True):
    found = client.next('/diagnostics', lambda message: message[1][0].name == name and condition(
        message[1][0]))
    return found[1][0]


@pytest.fixture(scope='module')
def pair(tmp_path_factory):
    """Two fabrics, the left one with the clock, and a client."""
    folder = tmp_path_factory.mktemp('pair')
    with in_namespace(folder, 'left') as left, \
            in_namespace(folder, 'right', publish_clock='false') as right, Client(left) as client:
        wait_for(lambda: right.lines(right.READY), 'the right node', node=right)
        yield left, right, client
        assert right.stop() == 0
        assert left.stop() == 0


def test_two_fabrics_share_a_graph_and_one_clock(pair):
    left, right, client = pair
    for name in ('left', 'right'):
        assert client.next(f'/{name}/icofabric/poses').values.shape == (4, 7)
        assert status_of(client, f'/{name}/icofabric').values['bodies'] == '4'
    publishers = client.node.get_publishers_info_by_topic('/clock')
    assert [info.node_namespace for info in publishers] == ['/left']
    # Nobody complains, although everyone has had the time to.
    time.sleep(2.5)
    assert not left.lines('/clock') and not right.lines('/clock')


def test_only_the_clock_and_the_diagnostics_are_absolute(pair):
    _, _, client = pair
    names = [name for name, _ in client.node.get_topic_names_and_types()]
    names += [name for name, _ in client.node.get_service_names_and_types()]
    ours = [name for name in names if not name.startswith('/test_client')]
    shared = {'/clock', '/diagnostics', '/rosout', '/parameter_events'}
    assert {name for name in ours if not name.startswith(('/left/', '/right/'))} <= shared
    assert '/right/icofabric/loads/tip' in ours and '/right/icofabric/pause' in ours


def test_each_fabric_has_its_own_services_and_loads(pair):
    _, _, client = pair
    answer = client.call('/right/icofabric/pause', 'std_srvs/srv/SetBool', data=True)
    assert answer.success
    status_of(client, '/right/icofabric', lambda status: status.message == 'paused')
    before = client.clock
    client.push('/right/icofabric/loads/tip', (0.0, 0.01, 0.0))
    status_of(client, '/right/icofabric', lambda status: status.values['loads active'] == '1')
    found = status_of(client, '/left/icofabric')
    assert found.values['loads active'] == '0' and found.message != 'paused'
    client.wait_for(lambda: client.clock > before, 'the clock of the left one')
    assert client.call('/right/icofabric/pause', 'std_srvs/srv/SetBool', data=False).success


def test_a_second_clock_is_told_by_both(tmp_path):
    """The log says it once for each other one, the diagnostics as long as it lasts."""
    with in_namespace(tmp_path, 'one', offset=1) as one, Client(one, offset=1) as client, \
            in_namespace(tmp_path, 'two', offset=1) as two:
        status = status_of(client, '/two/icofabric', lambda status: 'clock' in status.values)
        assert '/one/icofabric' in status.values['clock']
        assert 'publish_clock' in status.values['clock']
        # On a busy machine, other reports also say that the run is slow.
        status = status_of(
            client, '/one/icofabric',
            lambda status: reasons(status) == status.values.get('clock'))
        assert '/two/icofabric' in status.values['clock']
        assert status.message == '/clock is also published by /two/icofabric'
        assert status.level == WARN
        for node, other in ((one, '/two/icofabric'), (two, '/one/icofabric')):
            # The log is written beside the diagnostics.
            found = client.wait_for(lambda node=node: node.lines('/clock is also published by'),
                                    f'the line that names {other}')
            assert len(found) == 1 and other in found[0] and '[WARN]' in found[0]
        assert two.stop() == 0
        status_of(client, '/one/icofabric', lambda status: 'clock' not in status.values)
        assert one.stop() == 0


def test_fabric_told_to_use_simulated_time_runs_the_same(tmp_path):
    """It is the clock itself: it must not wait for a time that it has not published yet."""
    scene = write_scene(tmp_path / 'scene.yaml', SCENE)
    parameters = {'use_sim_time': 'true', 'start_paused': 'true'}
    with NodeProcess(tmp_path / 'log', scene=scene, parameters=parameters, offset=1) as node, \
            Client(node, offset=1) as client:
        assert client.get('use_sim_time') == [True]
        # Its timers and services work while simulated time stands still, and afterwards.
        client.health(lambda status: status.message == 'paused')
        client.set(marker_rate=5.0)
        assert client.call('~/step').success
        client.pause(False)
        client.next('~/poses', lambda pose: pose.nanoseconds > 2 * 10**8)
        client.health(lambda status: float(status.values['real-time factor']) > 0.0)
        before = client.clock
        client.push('~/loads/tip', (0.0, 0.01, 0.0), stamp=before + 10**8)
        client.health(lambda status: status.values['loads active'] == '1')
        assert client.pause() >= before + 10**8
        assert node.stop() == 0
        told = [line for line in node.lines('[WARN]') if 'connector.obstruction' not in line]
        assert not told and not node.lines('[ERROR]')


def test_clock_of_a_fabric_that_is_paused_at_the_start_is_0_until_its_first_step(tmp_path):
    scene = write_scene(tmp_path / 'scene.yaml', SCENE)
    with NodeProcess(tmp_path / 'log', scene=scene, parameters={'start_paused': 'true'},
                     offset=1) as node, Client(node, offset=1) as client:
        ticks = client.listen('/clock')
        client.wait_for(lambda: len(ticks) > 2, 'repeated ticks')
        assert set(ticks) == {0}
        [said] = node.lines('started paused')
        assert '[INFO]' in said and '/clock stays at 0 until ~/pause' in said
        assert client.call('~/step').success
        client.wait_for(lambda: ticks[-1] > 0, 'a time')
        assert node.stop() == 0


def test_clock_ticks_are_whole_nanoseconds_without_drift(tmp_path):
    """At a rate that no binary fraction holds, none is missed or repeated."""
    scene = write_scene(tmp_path / 'scene.yaml', SCENE)
    parameters = {'clock_rate': 333.3, 'real_time_factor': 0.5, 'start_paused': 'true',
                  'duration': 1.5}
    with NodeProcess(tmp_path / 'log', scene=scene, parameters=parameters, offset=1) as node, \
            Client(node, offset=1) as client:
        ticks = client.listen('/clock')
        client.wait_for(lambda: ticks, 'a first tick')
        client.pause(False)
        assert node.wait() == 0
        client.wait_for(lambda: len(set(ticks)) == 500, 'all ticks')
    # The first ones are repeated while it is paused.
    assert sorted(ticks) == ticks
    assert sorted(set(ticks)) == [round(k * 1e9 / 333.3) for k in range(500)]
