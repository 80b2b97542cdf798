# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The standard parameter services of the node: descriptions, refusals, and changes while it runs.
"""
import time

import icofabric_sim as ico
from icofabric_sim.messages import ERROR
from icofabric_sim.parameters.table import Change, STATIC
from icofabric_sim.ros.parameter_service import BUILD_WAIT_S
import numpy as np
import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rclpy.parameter import parameter_dict_from_yaml_file
from ros_helpers import parameter
import yaml

DELETEALL = 3  # visualization_msgs/Marker
# Falls freely, so that its centre of mass follows a parabola whatever the connectors do.
GRAVITY = np.array([0.0, 0.0, -0.2])
SCENE = {
    'weave': {'size': [3, 3, 3]},
    'connector': {'stiffness': 300.0},
    'contact': {'mode': 'never'},
    'gravity': GRAVITY.tolist(),
    'groups': {'tip': 'x_max', 'corner': 'ids 0'},
    'loads': {'tip': {'group': 'tip', 'force': [0.0, 0.0, 0.0]}},
    'initial_random': {'velocity_sigma': 0.01, 'spin_sigma': 0.5, 'seed': 3},
}


@pytest.fixture(scope='module')
def client(client):
    client.listen('~/weave', latched=True)
    client.listen('~/poses')
    return client


def parameters_in_force(client, tmp_path):
    """What the latest ~/weave says, read as a scene file."""
    kept = client.received['/icofabric/weave']
    client.wait_for(lambda: kept, '~/weave')
    (tmp_path / 'weave.yaml').write_text(kept[-1])
    return ico.load_scene(tmp_path / 'weave.yaml')


def wait_for_weave(client, word):
    """Wait until ~/weave, which comes with every change, holds `word`."""
    kept = client.received['/icofabric/weave']
    client.wait_for(lambda: kept and word in kept[-1], f'{word!r} on ~/weave')


def held(client):
    """Name: value of all parameters that the node holds, `use_sim_time` and the like left out."""
    names = client.call('~/list_parameters', 'rcl_interfaces/srv/ListParameters').result.names
    own = sorted(name for name in names if name in BY_NAME or name.split('.')[0] in SCENE)
    return dict(zip(own, map(plain, client.get(*own))))


def plain(value):
    return value.tolist() if hasattr(value, 'tolist') else value


BY_NAME = {entry.name: entry for entry in STATIC}


def test_every_parameter_has_a_description_and_its_range(client):
    descriptors = client.call(
        '~/describe_parameters', 'rcl_interfaces/srv/DescribeParameters',
        names=[*BY_NAME, 'loads.tip.hold', 'groups.tip']).descriptors
    assert len(descriptors) == len(BY_NAME) + 2
    ranges = 0
    for descriptor in descriptors:
        assert descriptor.description, descriptor.name
        entry = BY_NAME.get(descriptor.name)
        # Only those of named families can be deleted.
        assert descriptor.dynamic_typing == (entry is None)
        if entry is None:
            continue
        assert descriptor.read_only == (entry.change is Change.FIXED)
        assert entry.unit in descriptor.description
        assert descriptor.description.endswith(entry.change.value)
        for choice in entry.choices:
            assert str(choice) in descriptor.additional_constraints
        if entry.minimum is not None and not isinstance(entry.default, list):
            found = descriptor.floating_point_range or descriptor.integer_range
            assert found[0].from_value == entry.minimum
            assert entry.maximum is None or found[0].to_value == entry.maximum
            ranges += 1
    assert ranges > 15
    assert descriptors[-2].floating_point_range[0].from_value == 0.0


def test_values_are_those_of_the_scene(client, tmp_path):
    expected = ico.Scene.from_parameters(SCENE).parameters
    values = held(client)
    assert values == dict(expected)
    assert dict(parameters_in_force(client, tmp_path).parameters) == dict(expected)
    assert {name: type(value) for name, value in values.items()} == {
        name: type(value) for name, value in expected.items()}


def raw(name, **fields):
    return ParameterMessage(name=name, value=ParameterValue(**fields))


# What is sent, and what the reason must hold beside the parameter's name.
REFUSED = {
    'below the range': (parameter('shell.edge_length', -0.02), ['above 0', 'm', '-0.02']),
    'at an open end': (parameter('publish_rate', 0.0), ['above 0', 'Hz']),
    'a little below': (parameter('connector.stiffness', -1e-9), ['at least 0']),
    'above the range': (parameter('clock_rate', 2e6), ['at most 1e+06']),
    'element of a list': (parameter('weave.size', [3, 0, 3]), ['at least 1', '[3, 0, 3]']),
    'choice': (parameter('weave.variant', 4), ['0, 1, 2, 3', '4']),
    'unknown': (parameter('weave.sise', [3, 3, 3]), ['not a parameter', 'weave.size']),
    'unknown family': (parameter('springs.tip.group', 'tip'), ['not a parameter']),
    'field missing': (parameter('planes.tip.offset', 0.0), ['planes.tip.normal is missing']),
    'unknown field': (parameter('loads.tip.forse', [0.0, 0.0, 1.0]), ['loads.tip.force']),
    'bad NAME': (parameter('groups.a-b', 'all'), ["'a-b'"]),
    'long NAME': (parameter(f'groups.{"a" * 300}', 'all'), ['at most 100']),
    'text for number': (parameter('connector.stiffness', '300'), ['a number', "'300'"]),
    'float for integer': (parameter('weave.variant', 1.0), ['an integer', '1.0']),
    'bool for number': (parameter('connector.stiffness', True), ['a number', 'True']),
    'number for bool': (parameter('weave.connected', 1), ['true or false', '1']),
    'scalar for list': (parameter('gravity', 1.0), ['list of 3']),
    'short list': (parameter('gravity', [0.0, 1.0]), ['list of 3', '[0.0, 1.0]']),
    'texts for numbers': (parameter('gravity', ['0', '0', '1']), ['a number']),
    'NaN': (parameter('shell.density', float('nan')), ['finite', 'nan']),
    'infinity in a list': (parameter('gravity', [0.0, 0.0, float('inf')]), ['finite', 'inf']),
    'out of range': (parameter('contact.friction', -0.5), ['at least', '-0.5']),
    'read only': (parameter('frame_id', 'map'), [Change.FIXED.value, 'start again']),
    'too thick': (parameter('shell.thickness', 0.5), ['eq 41']),
    'too short': (parameter('weave.connector_length', 0.001), ['eq 54']),
    'too steep': (parameter('weave.connector_angle', 1.0), ['1.0']),
    'beyond the limit': (parameter('solver.step', 1.0), ['stability limit']),
    'too many bodies': (parameter('weave.size', [30000, 30000, 30000]), []),
    'a billion bodies': (parameter('weave.size', [1260, 1260, 1260]), ['1000188000 bodies']),
    'endless text': (parameter('weave.kind', 'x' * 10**6), ['xx...xx']),
    'no such group': (parameter('loads.tip.group', 'nobody'), ["'nobody'", 'tip']),
    'bad selector': (parameter('groups.tip', 'x_middle'), ['x_middle']),
    'empty selection': (parameter('groups.tip', 'level 99'), ['level 99']),
    'edge too short for the thickness': (parameter('shell.edge_length', 0.001),
                                         ['shell.thickness', 'eq 41']),
    'missing group': (parameter('loads.other.force', [1.0, 0.0, 0.0]), ['loads.other.group']),
    'empty numbers': (raw('gravity', type=8), ['list of 3']),
    'empty integers': (raw('weave.size', type=7), ['list of 3']),
    'empty bytes': (raw('weave.size', type=5), ['list of 3']),
    'empty texts': (raw('groups.tip', type=9), ['a text']),
    'bytes': (raw('gravity', type=5, byte_array_value=[b'a', b'b', b'c']), ['a number']),
    'code 99': (raw('gravity', type=99), ['99']),
    'deleted': (raw('connector.stiffness', type=0), ['cannot be deleted']),
    'deleted from use': (raw('groups.tip', type=0), ["no group 'tip'"]),
    'deleted, never there': (raw('groups.ghost', type=0), ['not set']),
    'no name': (raw('', type=1), ['without a name']),
    'dots': (raw('...', type=3, double_value=1.0), ['not a parameter']),
    'odd characters': (parameter('loads.tip\n.force', [0.0, 0.0, 0.0]), ['not a valid name']),
    'ROS parameter': (parameter('use_sim_time', 'yes'), []),
}


@pytest.fixture(scope='module')
def before_refusals(client):
    return held(client)


@pytest.mark.parametrize('atomically', [False, True], ids=['each', 'atomically'])
@pytest.mark.parametrize('name', REFUSED)
def test_refusal_names_the_parameter_and_the_reason(client, before_refusals, name, atomically):
    message, words = REFUSED[name]
    result = client.set_messages([message], atomically=atomically)
    result = result if atomically else result[0]
    assert not result.successful
    for word in (message.name, *words):
        assert word in result.reason
    assert 'array(' not in result.reason


def test_refusals_changed_nothing(client, before_refusals, node, tmp_path):
    assert held(client) == before_refusals
    assert len(client.received['/icofabric/weave']) == 1
    assert 'a callback failed' not in node.log()


def test_atomic_change_is_refused_as_a_whole(client, before_refusals):
    wanted = [parameter('connector.stiffness', 400.0), parameter('shell.density', -1.0),
              parameter('marker_rate', 5.0)]
    result = client.set_messages(wanted, atomically=True)
    assert not result.successful and 'shell.density' in result.reason
    assert held(client) == before_refusals


def test_each_change_is_judged_on_its_own(client):
    wanted = [parameter('marker_rate', 5.0), parameter('shell.density', -1.0),
              parameter('clock_rate', 50)]
    results = client.set_messages(wanted)
    assert [result.successful for result in results] == [True, False, True]
    assert client.get('marker_rate', 'shell.density', 'clock_rate') == [5.0, 1200.0, 50.0]
    wait_for_weave(client, 'clock_rate: 50.0')
    client.set(marker_rate=10, clock_rate=100.0)


def dumped(client, path):
    """A file as `ros2 param dump` writes it, with every parameter that the node holds."""
    names = client.call('~/list_parameters', 'rcl_interfaces/srv/ListParameters').result.names
    tree = {}
    for name, value in zip(names, client.get(*names)):
        *words, last = name.split('.')
        branch = tree
        for word in words:
            branch = branch.setdefault(word, {})
        branch[last] = plain(value)
    path.write_text(yaml.dump({'/icofabric': {'ros__parameters': tree}}))
    return names


def loaded(client, path):
    """Results of what `ros2 param load` sends."""
    wanted = parameter_dict_from_yaml_file(str(path), target_nodes=['/icofabric'])
    return wanted, client.set_messages(list(wanted.values()))


def test_what_is_dumped_can_be_loaded(client, before_refusals, tmp_path):
    client.set(advance_duration=1e-6)
    names = dumped(client, tmp_path / 'dump.yaml')
    before = held(client)
    wanted, results = loaded(client, tmp_path / 'dump.yaml')
    assert {*wanted} == {*names} and 'frame_id' in names and 'use_sim_time' in names
    assert [result.reason for result in results if not result.successful] == []
    assert held(client) == before
    # Some of it comes as texts, which is why.
    assert wanted['advance_duration'].value.string_value == '1e-06'
    text = (tmp_path / 'dump.yaml').read_text()
    (tmp_path / 'dump.yaml').write_text(text.replace('duration: 1.0e-06', 'duration: 2.0e-06'))
    wanted, results = loaded(client, tmp_path / 'dump.yaml')
    assert all(result.successful for result in results)
    assert client.get('advance_duration') == [2e-6]
    # A fixed one cannot be set to anything else.
    [refused] = client.set_each(frame_id='map')
    assert not refused.successful and Change.FIXED.value in refused.reason
    [taken] = client.set_each(gravity='[1e-06, 0.0, -0.2]')
    assert taken.successful and plain(client.get('gravity')[0]) == [1e-6, 0.0, -0.2]
    client.set(advance_duration=0.01, gravity=GRAVITY.tolist())


def test_integers_are_taken_for_floats(client):
    client.set(publish_rate=50, gravity=[0, 0, -1])
    values = client.get('publish_rate', 'gravity')
    assert values[0] == 50.0 and isinstance(values[0], float)
    assert plain(values[1]) == [0.0, 0.0, -1.0]
    stamps = [client.next('~/poses').nanoseconds]

    def at_fifty_hertz():
        stamps[:] = [pose.nanoseconds for pose in client.received['/icofabric/poses'][-4:]]
        return len(stamps) == 4 and set(np.diff(stamps)) == {20_000_000} and (
            stamps[0] % 20_000_000 == 0)

    client.wait_for(at_fifty_hertz, 'poses at 50 Hz')
    client.set(publish_rate=60.0, gravity=GRAVITY.tolist())
    wait_for_weave(client, 'gravity: [0.0, 0.0, -0.2]')


def centre(pose):
    return pose.values[:, :3].mean(axis=0)


@pytest.mark.parametrize('atomically', [False, True], ids=['each', 'atomically'])
def test_weave_change_restarts_the_motion(client, tmp_path, atomically):
    markers, poses = client.listen('~/connectors'), client.received['/icofabric/poses']
    known, before = len(markers), client.next('~/poses').nanoseconds
    size = [2, 4, 2] if atomically else [4, 2, 2]
    client.set(atomically=atomically, weave__size=size, weave__variant=1, shell__thickness=0.003)
    wait_for_weave(client, f'size: {size}')
    wait_for_weave(client, 'thickness: 0.003')
    wait_for_weave(client, 'variant: 1')
    scene = parameters_in_force(client, tmp_path)
    assert held(client) == dict(scene.parameters)
    assert scene.shell.mass > ico.Scene.from_parameters(SCENE).shell.mass
    # The markers of the old fabric go, and the new one is seen from its initial state on.
    connectors = 2 * scene.connector_count

    def show_all():
        cleared = [k for k, marker in enumerate(markers) if marker.action == DELETEALL]
        new = markers[cleared[-1] + 1:] if cleared and cleared[-1] >= known else []
        at_once = [marker for marker in new if marker.nanoseconds == new[0].nanoseconds]
        return sum(len(marker.points) for marker in at_once) == connectors and at_once[0]

    began = client.wait_for(show_all, 'all markers after DELETEALL').nanoseconds
    assert began >= before

    def first_pose():
        return next((pose for pose in reversed(poses) if pose.nanoseconds == began
                     and len(pose.values) == scene.body_count), None)

    pose = client.wait_for(first_pose, 'the first pose of the new fabric')
    assert (pose.values[:, :3] == scene.position).all()
    assert (pose.values[:, 3:] == scene.orientation).all()
    client.set(atomically=True, weave__size=[3, 3, 3], weave__variant=0, shell__thickness=0.002)
    wait_for_weave(client, 'size: [3, 3, 3]')


def test_live_change_keeps_the_motion(client):
    """
    The parabola of the centre of mass goes on through changes of stiffness and natural length.
    """
    poses = client.received['/icofabric/poses']
    start, known = client.pause(), len(poses)
    assert client.call('~/reset').success
    client.pause(False)
    client.next('~/poses', lambda pose: pose.nanoseconds > start + 1e8)
    client.set(connector__stiffness=450)
    wait_for_weave(client, 'stiffness: 450.0')
    client.next('~/poses', lambda pose: pose.nanoseconds > start + 2e8)
    client.set(atomically=True, connector__stiffness=300.0, connector__natural_length=0.0322)
    wait_for_weave(client, 'natural_length: 0.0322')
    client.next('~/poses', lambda pose: pose.nanoseconds > start + 3e8)
    client.set(connector__natural_length=0.0)
    wait_for_weave(client, 'natural_length: 0.0\n')
    scene = ico.Scene.from_parameters(SCENE)
    drift = scene.initial.linear_velocity.mean(axis=0)
    fell = [pose for pose in poses[known:] if pose.nanoseconds > start]
    assert len(fell) > 15 and fell[-1].nanoseconds > start + 3e8
    for pose in fell:
        t = (pose.nanoseconds - start) * 1e-9
        expected = scene.position.mean(axis=0) + drift * t + GRAVITY * t**2 / 2
        np.testing.assert_allclose(centre(pose), expected, rtol=0.0, atol=1e-11)
    for one, two in zip(fell, fell[1:]):
        # No body jumps: speeds stay below 1 m/s.
        simulated = (two.nanoseconds - one.nanoseconds) * 1e-9
        assert abs(two.values[:, :3] - one.values[:, :3]).max() <= 1.0 * simulated


def test_change_that_fails_when_built_is_taken_back(client, node, tmp_path):
    """A step that the softer fabric allows, then a stiffness that does not allow it."""
    client.set(solver__step=0.0005)
    wait_for_weave(client, 'step: 0.0005')
    before = held(client)
    known, events = len(client.received['/icofabric/weave']), client.listen('~/events')
    # Judged in a moment, built aside: the answer waits for that, but no longer than BUILD_WAIT_S.
    asked = time.monotonic()
    [result] = client.set_each(connector__stiffness=1e7)
    assert not result.successful or time.monotonic() - asked >= BUILD_WAIT_S
    for word in ('connector.stiffness', 'solver.step', 'stability limit'):
        assert result.successful or word in result.reason
    status = client.health(lambda status: status.level == ERROR)
    assert status.message == 'the last change could not be built'
    for word in ('could not be built', 'solver.step', 'stability limit'):
        assert word in status.values['reasons']
    assert held(client) == before
    assert len(client.received['/icofabric/weave']) == known
    assert parameters_in_force(client, tmp_path).parameters['connector.stiffness'] == 300.0
    assert len(node.lines('the old fabric continues')) == 1
    client.wait_for(lambda: any('change_refused' in text for text in events), 'the event')
    # The fabric runs on, and an accepted change clears the error.
    client.next('~/poses')
    client.set(solver__step=0.0)
    client.health(lambda status: status.level != ERROR)
    assert client.get('solver.step', 'connector.stiffness') == [0.0, 300.0]


def test_good_change_right_after_one_that_fails(client, tmp_path):
    """Whatever comes in between: in the end the node says what runs."""
    client.set(solver__step=0.0005)
    futures = [
        client.begin('~/set_parameters', 'rcl_interfaces/srv/SetParameters',
                     parameters=[parameter(name, value)])
        for name, value in (('connector.stiffness', 1e7), ('marker_rate', 9.0),
                            ('solver.step', 0.0), ('shell.density', 1300.0))]
    for future in futures:
        client.wait_for(future.done, 'answer')

    def agree():
        return held(client) == dict(parameters_in_force(client, tmp_path).parameters)

    client.health()
    client.wait_for(agree, 'agreement of the parameters and ~/weave')
    client.set(atomically=True, connector__stiffness=300.0, marker_rate=10.0, solver__step=0.0,
               shell__density=1200.0)
    wait_for_weave(client, 'density: 1200.0')
    client.wait_for(agree, 'agreement of the parameters and ~/weave')


def test_named_parameters_come_and_go(client):
    """A new load brings its topic; without it the topic and its parameters are gone."""
    added = {'groups__head': 'z_max', 'loads__head__group': 'head', 'loads__head__hold': 1}
    client.set(atomically=True, **added)
    wait_for_weave(client, 'head:')
    publisher = client.publisher('~/loads/head')
    assert client.get('loads.head.hold', 'loads.head.share') == [1.0, 'each']
    client.push('~/loads/head', (0.0, 0.0, 0.01))
    client.health(lambda status: status.values['loads active'] == '1')
    gone = [raw(name.replace('__', '.'), type=0) for name in added]
    assert client.set_messages(gone, atomically=True).successful
    client.wait_for(lambda: publisher.get_subscription_count() == 0, 'end of ~/loads/head')
    assert not any('head' in name for name in held(client))
    client.health(lambda status: status.values['loads active'] == '0')


def test_what_the_scene_file_named_can_go_too(client):
    """Declared at the start, and gone on request; a field that is not needed falls back."""
    before = held(client)
    assert client.set_messages([raw('loads.tip.force', type=0), raw('groups.corner', type=0)],
                               atomically=True).successful
    client.set(loads__tip__hold=2.0)
    assert client.set_messages([raw('loads.tip.hold', type=0)])[0].successful
    client.wait_for(lambda: client.get('loads.tip.hold') == [0.0], 'the default hold')
    # The last fields and the group that they need.
    gone = [raw(name, type=0) for name in ('loads.tip.group', 'groups.tip')]
    assert client.set_messages(gone, atomically=True).successful
    client.wait_for(
        lambda: not any('tip' in name or 'corner' in name for name in held(client)), 'their end')
    client.set(atomically=True, groups__tip='x_max', groups__corner='ids 0',
               loads__tip__group='tip', loads__tip__force=[0.0, 0.0, 0.0])
    assert held(client) == before


def test_parameters_answer_while_ten_thousand_bodies_run(client):
    """Latencies are printed, not judged: a test cannot know what else the machine does."""
    client.set(weave__size=[27, 27, 28])
    client.next('~/poses', lambda pose: len(pose.values) > 10_000)
    latencies = []
    for k in range(30):
        began = time.perf_counter()
        if k % 2:
            client.set(step_count=1 + k)
        else:
            assert client.get('step_count') == [max(k, 1)]
        latencies.append(1e3 * (time.perf_counter() - began))
    status = client.health()
    assert int(status.values['bodies']) > 10_000 and int(status.values['steps']) > 0
    print(f'\nget or set beside {status.values["bodies"]} bodies (real-time factor '
          f'{status.values["real-time factor"]}): median {np.median(latencies):.1f} ms, '
          f'largest {max(latencies):.1f} ms')


def test_nothing_ended_the_executor(client, node):
    assert client.pause() > 0
    assert 'Traceback' not in node.log() and 'a callback failed' not in node.log()
