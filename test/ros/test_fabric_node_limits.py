# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Requests that would take long, and values that no step could follow: nothing else waits."""
import time

from icofabric_sim.messages import ERROR
import pytest
from ros_helpers import Client, NodeProcess, parameter, SCENES, write_scene

SCENE = {
    'weave': {'size': [3, 3, 3]},
    'contact': {'mode': 'never'},
    'groups': {'tip': 'x_max'},
    'loads': {'tip': {'group': 'tip'}},
}
EACH = '~/set_parameters', 'rcl_interfaces/srv/SetParameters'
TOGETHER = '~/set_parameters_atomically', 'rcl_interfaces/srv/SetParametersAtomically'


def groups(count, first=0, text='x_min and y_min'):
    return [parameter(f'groups.g{number}', text) for number in range(first, first + count)]


@pytest.mark.parametrize('atomically', [False, True], ids=['each', 'atomically'])
@pytest.mark.parametrize(('name', 'value', 'words'), [
    ('solver.step', 1e-300, 'at least 1e-12'),
    ('solver.tolerance', 1e-300, 'at least 1e-15'),
    ('connector.stiffness', 1e300, 'at a rate of'),
    ('connector.damping', 1e300, 'at a rate of'),
    ('contact.stiffness', 1e300, 'at a rate of'),
    ('gravity', [0.0, 0.0, 1e300], 'at a rate of')])
def test_values_that_no_step_follows_spoil_no_later_ones(client, name, value, words, atomically):
    result = client.set_messages([parameter(name, value)], atomically=atomically)
    result = result if atomically else result[0]
    assert not result.successful
    assert name in result.reason and words in result.reason
    client.set(connector__stiffness=600.0 if atomically else 700.0)
    assert client.get('connector.stiffness') == [600.0 if atomically else 700.0]


def test_too_many_at_once_are_refused(client):
    for kind, one in ((EACH, False), (TOGETHER, True)):
        answer = client.call(*kind, parameters=groups(8000))
        results = [answer.result] if one else answer.results
        assert len(results) == (1 if one else 8000)
        assert all(not result.successful and '8000 parameters' in result.reason
                   for result in results)


@pytest.mark.parametrize(('name', 'text'), [
    ('groups.tip', 'x_min or ' * 45_000 + 'x_max'),
    ('groups.tip', 'not ' * 100_000 + 'x_max'),
    ('groups.tip', 'ids ' + '0 ' * 200_000),
    ('weave.region', 'x' * 400_000),
    ('g' * 400_000, 'x')], ids=['or', 'not', 'ids', 'region', 'name'])
def test_long_texts_are_refused(client, name, text):
    [result] = client.set_messages([parameter(name, text)])
    assert not result.successful and 'characters' in result.reason
    assert len(result.reason) < 2000


def test_texts_that_are_long_together_are_refused(client):
    result = client.set_messages(groups(100, text='x_min or ' * 200 + 'x_max'), atomically=True)
    assert not result.successful and 'characters' in result.reason


def test_others_are_answered_beside_a_long_request(client, node):
    """Each of the parameters is judged by building the scene; the others take turns with that."""
    with Client(node) as other:
        other.get('step_count')
        future, turns = client.begin(*EACH, parameters=groups(150)), 0
        before = client.clock
        while not future.done():
            began = time.monotonic()
            assert other.get('step_count') == [1]
            print(f'{time.monotonic() - began:.3f} s', end=' ')
            turns += 1
        assert turns >= 3
        assert client.clock > before
    assert all(result.successful for result in future.result().results)
    client.set_messages([parameter(f'groups.g{number}', None) for number in range(150)],
                        atomically=True)


def test_end_of_the_node_does_not_wait_for_a_long_request(tmp_path):
    scene = write_scene(tmp_path / 'scene.yaml', {**SCENE, 'weave': {'size': [9, 9, 9]}})
    with NodeProcess(tmp_path / 'log', scene=scene, offset=1) as node, Client(
            node, offset=1) as client:
        future = client.begin(*EACH, parameters=groups(1000))
        client.wait_for(lambda: client.get('groups.g2') != [None], 'the first of them')
        began = time.monotonic()
        assert node.stop() == 0
        print(f'\nended within {time.monotonic() - began:.2f} s')
        assert not future.done()


def test_force_that_is_too_large_ends_in_a_stop_with_the_reason(tmp_path):
    """6.5 kN on a shell of 7 g: the run says why it stands, and a reset lets it continue."""
    with NodeProcess(tmp_path / 'log', scene=SCENES / 'hanging_slab.yaml', offset=2) as node, (
            Client(node, offset=2)) as client:
        client.push('~/wrench', (0.0, 6500.0, 0.0), frame='icosahedron_5')
        status = client.health(lambda status: status.level == ERROR)
        reasons = status.values['reasons']
        assert 'reset the run' in reasons or 'overlap by' in reasons
        assert len(status.message) <= 80
        before = client.clock
        assert client.call('~/reset').success
        client.wait_until(before + 10**8)
        assert node.stop() == 0
