# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Wrenches from topics on free bodies, against closed forms; what is dropped, and why.

Wrenches are sent while the fabric is paused, so the time at which they act is known.
"""
import struct
import time

import icofabric_sim as ico
from icofabric_sim.messages import WrenchStampedBytes
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

# Body axes of the loose body in the world: a turn about all three axes.
TURN = Rotation.from_rotvec([0.4, -1.1, 0.7])
POINT = [0.0, 0.005, -0.002]
SCENE = {
    'weave': {'size': [2, 2, 2], 'connected': False},
    'contact': {'mode': 'never'},
    'bodies': {'turned': {'position': [0.3, 0.0, 0.0], 'orientation': TURN.as_quat().tolist()}},
    'groups': {'pair': 'ids 0 1', 'last': 'ids 4'},
    'loads': {
        'each': {'group': 'pair'},
        'total': {'group': 'pair', 'share': 'total'},
        'follower': {'group': 'last', 'frame': 'body'},
        'brief': {'group': 'last', 'hold': 0.05},
        'handle': {'group': 'last', 'frame': 'body', 'point': POINT},
        'pin': {'group': 'last', 'point': POINT},
    },
}
FORCE, TORQUE = np.array([0.003, -0.002, 0.004]), np.array([2e-5, 4e-5, -1e-5])


@pytest.fixture(scope='module')
def scene():
    scene = ico.Scene.from_parameters(SCENE)
    assert scene.body_count == 5
    return scene


@pytest.fixture(scope='module')
def graph(graph):
    graph.listen('~/poses')
    # A first message may wait until both sides have found each other; later ones do not.
    topics = ['~/wrench', *(f'~/loads/{name}' for name in SCENE['loads'])]
    for topic in topics:
        graph.push(topic, frame='nothing of the kind')
    graph.health(lambda status: int(status.values['wrenches dropped']) == len(topics))
    return graph


@pytest.fixture
def client(graph):
    """The fabric paused at its initial state, without any load."""
    graph.pause()
    assert graph.call('~/reset').success
    yield graph
    graph.pause()


def wait_active(client, count):
    client.health(lambda status: int(status.values['loads active']) == count)


def dropped(client):
    return int(client.health().values['wrenches dropped'])


def run(client, seconds=0.15):
    """(time since now [s], poses) for a while of simulated time, and how long it was."""
    client.settle()
    poses = client.received['/icofabric/poses']
    start = client.pause(False)
    client.wait_until(start + round(seconds * 1e9))
    end = client.pause()
    found = [((pose.nanoseconds - start) * 1e-9, pose.values)
             for pose in poses if start < pose.nanoseconds <= end]
    assert len(found) > 5
    return found, (end - start) * 1e-9


def check_motion(values, scene, body, *, shift=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0), atol=1e-12):
    """
    Pose of `body` against the initial one, moved by `shift` and turned by `turn` (world axes).
    """
    np.testing.assert_allclose(
        values[body, :3], scene.position[body] + np.array(shift), rtol=0.0, atol=atol)
    expected = Rotation.from_rotvec(turn) * Rotation.from_quat(scene.orientation[body])
    error = (Rotation.from_quat(values[body, 3:]) * expected.inv()).magnitude()
    assert error < 1e-9


def check_others_at_rest(values, scene, moved):
    rest = np.setdiff1d(np.arange(scene.body_count), moved)
    assert (values[rest, :3] == scene.position[rest]).all()
    assert (values[rest, 3:] == scene.orientation[rest]).all()


def test_body_wrench_acts_on_the_axes_of_the_body(client, scene):
    """Force: x = F t^2 / 2 m along the body's own, turned axes. It does not turn the body."""
    client.push('~/wrench', FORCE, frame='icosahedron_4')
    for t, values in run(client)[0]:
        check_motion(values, scene, 4, shift=TURN.apply(FORCE) * t**2 / (2 * scene.shell.mass))
        check_others_at_rest(values, scene, [4])
    assert np.linalg.norm(TURN.apply(FORCE) - FORCE) > 1e-3


def test_body_torque_turns_about_the_axes_of_the_body(client, scene):
    """Angle tau t^2 / 2 I about the torque, which stays where it is on a sphere-like body."""
    client.push('~/wrench', torque=TORQUE, frame='icosahedron_4')
    for t, values in run(client)[0]:
        check_motion(values, scene, 4, turn=TURN.apply(TORQUE) * t**2 / (2 * scene.shell.inertia))
        check_others_at_rest(values, scene, [4])


def test_force_follows_the_body_as_it_turns(client, scene):
    """With a torque that turns the body by a good angle, the push of ~/wrench turns with it."""
    torque = np.array([0.0, 0.0, 1.2e-4])
    client.push('~/wrench', FORCE, torque, frame='icosahedron_0')
    t, values = run(client, 0.2)[0][-1]
    angles = np.linspace(0.0, t, 20001) ** 2 * torque[2] / (2 * scene.shell.inertia)
    assert angles[-1] > 1.0
    # Twice the integral of the turned force, by the trapezoidal rule.
    force = Rotation.from_rotvec(np.outer(angles, [0, 0, 1])).apply(FORCE) / scene.shell.mass
    dt = t / 20000
    velocity = np.vstack([np.zeros(3), np.cumsum(force[1:] + force[:-1], axis=0) * dt / 2])
    shift = (velocity[1:] + velocity[:-1]).sum(axis=0) * dt / 2
    check_motion(values, scene, 0, shift=shift, turn=[0.0, 0.0, angles[-1]],
                 atol=2e-3 * np.linalg.norm(shift))
    straight = FORCE * t**2 / (2 * scene.shell.mass)
    assert np.linalg.norm(shift - straight) > 0.1 * np.linalg.norm(shift)


def test_zero_clears_and_a_wrench_replaces(client, scene):
    client.push('~/wrench', FORCE, frame='icosahedron_1')
    client.push('~/wrench', 2 * FORCE, frame='icosahedron_1')
    client.push('~/wrench', FORCE, frame='icosahedron_2')
    wait_active(client, 2)
    poses, pushed = run(client)
    t, values = poses[-1]
    check_motion(values, scene, 1, shift=2 * FORCE * t**2 / (2 * scene.shell.mass))
    client.push('~/wrench', frame='icosahedron_1')
    client.push('~/wrench', frame='icosahedron_2')
    wait_active(client, 0)
    for t, values in run(client)[0]:
        # Uniform motion from then on.
        shift = FORCE * pushed / scene.shell.mass * (0.5 * pushed + t)
        check_motion(values, scene, 1, shift=2 * shift)
        check_motion(values, scene, 2, shift=shift)


def test_channels_in_world_axes_each_and_total(client, scene):
    client.push('~/loads/each', FORCE, frame='world')
    client.push('~/loads/total', 2 * FORCE, TORQUE)
    for t, values in run(client)[0]:
        for body in (0, 1):
            # F each, and 2 F and the torque shared out by two: channels add.
            check_motion(values, scene, body, shift=2 * FORCE * t**2 / (2 * scene.shell.mass),
                         turn=0.5 * TORQUE * t**2 / (2 * scene.shell.inertia))
        check_others_at_rest(values, scene, [0, 1])


def test_body_channel_and_point(client, scene):
    """A force off the centre adds r x F to the torque, on the body's own axes."""
    client.push('~/loads/handle', FORCE, TORQUE, frame='icosahedron')
    wait_active(client, 1)
    torque = TURN.apply(np.cross(POINT, FORCE) + TORQUE)
    for t, values in run(client)[0]:
        turn = torque * t**2 / (2 * scene.shell.inertia)
        expected = Rotation.from_rotvec(turn) * TURN
        assert (Rotation.from_quat(values[4, 3:]) * expected.inv()).magnitude() < 1e-9
    assert np.linalg.norm(turn) > 0.05


def test_body_channel_follows_the_body(client, scene):
    client.push('~/loads/follower', FORCE, frame='')
    for t, values in run(client)[0]:
        check_motion(values, scene, 4, shift=TURN.apply(FORCE) * t**2 / (2 * scene.shell.mass))


def test_world_channel_and_point(client, scene):
    """The point is in body axes, the force in world axes: at first the torque is (R r) x F."""
    client.push('~/loads/pin', FORCE)
    t, values = run(client, 0.1)[0][0]
    check_torque = np.cross(TURN.apply(POINT), FORCE)
    turn = (Rotation.from_quat(values[4, 3:]) * TURN.inv()).as_rotvec()
    np.testing.assert_allclose(
        turn, check_torque * t**2 / (2 * scene.shell.inertia), rtol=0.02, atol=1e-6)
    np.testing.assert_allclose(
        values[4, :3] - scene.position[4], FORCE * t**2 / (2 * scene.shell.mass), rtol=1e-9)


def test_hold_time_ends_the_wrench(client, scene):
    client.push('~/loads/brief', FORCE)
    for t, values in run(client)[0]:
        on = min(t, 0.05)
        shift = FORCE / scene.shell.mass * (0.5 * on**2 + on * (t - on))
        check_motion(values, scene, 4, shift=shift)
    wait_active(client, 0)


GARBAGE = bytes(np.random.default_rng(1).integers(0, 256, 4096, np.uint8))
WHOLE = WrenchStampedBytes('icosahedron_0').stamped(0)
NAN, INF = float('nan'), float('inf')

# Topic, what is sent, and what the warning must hold beside the topic.
BAD = {
    'no such body': ('~/wrench', {'frame': 'icosahedron_5'}, ['no body 5', '0 to 4']),
    'huge body': ('~/wrench', {'frame': 'icosahedron_99999999999'}, ['frame_id', '_99999999999']),
    'no body': ('~/wrench', {'frame': ''}, ['frame_id', "''", 'icosahedron_K']),
    'another digit': ('~/wrench', {'frame': 'icosahedron_\u0663'}, ['frame_id', '\u0663']),
    'endless frame': ('~/wrench', {'frame': 'x' * 200_000},
                      ['frame_id', "'" + 'x' * 100 + "...'"]),
    'NaN force': ('~/wrench', {'force': (NAN, 0, 0), 'frame': 'icosahedron_0'}, ['not finite']),
    'infinite torque': ('~/loads/each', {'torque': (0, INF, 0)}, ['not finite', 'inf']),
    'world frame': ('~/loads/each', {'frame': 'map'}, ["'map'", 'loads.each.frame', "'world'"]),
    'body in world': ('~/loads/total', {'frame': 'icosahedron'}, ['world']),
    'world in body': ('~/loads/follower', {'frame': 'world'}, ["'icosahedron'", 'body']),
    'huge force': ('~/wrench', {'force': (1e300, 0, 0), 'frame': 'icosahedron_0'},
                   ['too large', '1e+300', 'kg']),
    'huge torque': ('~/loads/each', {'torque': (0, 0, -1e30)}, ['too large']),
    'overflow': ('~/loads/pin', {'force': (1.7e308, 1.7e308, 1.7e308)}, ['too large']),
    'garbage': ('~/wrench', GARBAGE, ['not a geometry_msgs/msg/WrenchStamped']),
    'short': ('~/loads/each', b'\0\1\0\0\7', ['not a geometry_msgs/msg/WrenchStamped']),
    'cut off': ('~/loads/pin', WHOLE[:-8], ['not a geometry_msgs/msg/WrenchStamped']),
    'too long': ('~/loads/brief', WHOLE + bytes(64), ['64 bytes follow']),
    'no end of a name': ('~/wrench', WHOLE[:12] + b'\xff\xff\xff\x7f' + WHOLE[16:],
                         ['is needed']),
    'name of zeros': ('~/loads/handle', WHOLE[:16] + bytes(len(WHOLE) - 16), ['NUL']),
    'no UTF-8': ('~/loads/follower', WHOLE.replace(b'icosahedron', b'\xff\xfe\xfd\xfc0000000'),
                 ['UTF-8']),
    'other encoding': ('~/loads/total', b'\x00\x03' + WHOLE[2:], ['plain CDR']),
    'empty': ('~/loads/brief', b'\0\1\0\0', ['is needed']),
}


@pytest.fixture(scope='module')
def after_bad_inputs(node, graph):
    """(warnings, how many were dropped, poses before, poses after) of all bad inputs."""
    graph.pause()
    assert graph.call('~/reset').success
    start = dropped(graph)
    before = graph.next('~/poses').values
    said = set()
    for topic, what, words in BAD.values():
        kind = (topic, isinstance(what, bytes) or words[0][:4])
        if kind in said:
            time.sleep(1.1)  # one line a second for each topic and kind of reason
            said.clear()
        said.add(kind)
        if isinstance(what, bytes):
            graph.publisher(topic).publish(what)
        else:
            graph.push(topic, **{'force': FORCE, **what})
    graph.health(lambda status: int(status.values['wrenches dropped']) == start + len(BAD))
    graph.pause(False)
    after = graph.next('~/poses', lambda pose: pose.nanoseconds > 0).values
    graph.pause()
    return node.lines('dropped'), before, after


@pytest.mark.parametrize('name', BAD)
def test_bad_wrench_is_dropped_with_its_reason(after_bad_inputs, name):
    topic, _, words = BAD[name]
    warnings, _, _ = after_bad_inputs
    full = topic.replace('~', '/icofabric')
    found = [line for line in warnings
             if f'a wrench on {full} was dropped: ' in line and all(w in line for w in words)]
    assert found, warnings
    assert '[WARN]' in found[0]


def test_bad_wrenches_disturb_nothing(after_bad_inputs, client, scene):
    _, before, after = after_bad_inputs
    assert (before == after).all()
    client.push('~/wrench', FORCE, frame='icosahedron_0')
    wait_active(client, 1)


def test_flood_of_bad_wrenches_is_reported_once_a_second(client, node):
    """Ten thousand a second for three seconds, while the fabric runs and its services answer."""
    publisher = client.publisher('~/wrench')
    start, known, began = dropped(client), len(node.lines('dropped')), time.monotonic()
    before, number = client.pause(False), 0
    while (passed := time.monotonic() - began) < 3.0:
        while number < 10_000 * passed:
            publisher.publish(
                GARBAGE if number % 2 else WrenchStampedBytes('icosahedron_5').stamped(0))
            number += 1
        assert client.get('weave.variant') == [0]
    lines = len(node.lines('dropped')) - known
    assert 1 <= lines <= 2 * (time.monotonic() - began + 1.0)
    status = client.health(
        lambda status: int(status.values['wrenches dropped']) > start + 100)
    assert client.pause() > before
    print(f'\n{number} bad wrenches: {int(status.values["wrenches dropped"]) - start} dropped one '
          f'by one, real-time factor {status.values["real-time factor"]}')


def test_wrench_of_another_byte_order_acts(client, scene):
    """As a sender on another processor would write it: force (0, 0.004, 0) on body 2."""
    frame = b'icosahedron_2\0'
    data = b'\0\0\0\0' + struct.pack(f'>iII{len(frame)}s', 0, 0, len(frame), frame)
    data += bytes((4 - len(data)) % 8)  # numbers of eight bytes, counted from the fifth
    data += struct.pack('>6d', 0.0, 0.004, 0.0, 0.0, 0.0, 0.0)
    client.publisher('~/wrench').publish(data)
    wait_active(client, 1)
    for t, values in run(client)[0]:
        shift = np.array([0.0, 0.004, 0.0]) * t**2 / (2 * scene.shell.mass)
        check_motion(values, scene, 2, shift=shift)
        check_others_at_rest(values, scene, [2])


def test_flood_of_good_wrenches_all_act(client, scene):
    """The last of many acts, and nothing is left over."""
    start = dropped(client)
    for k in range(1, 400):
        client.push('~/wrench', FORCE * k, frame='icosahedron_2')
    client.push('~/wrench', FORCE, frame='icosahedron_2')
    client.push('~/wrench', frame='the last one')
    client.health(lambda status: int(status.values['wrenches dropped']) == start + 1)
    for t, values in run(client)[0]:
        check_motion(values, scene, 2, shift=FORCE * t**2 / (2 * scene.shell.mass))


def test_nothing_ended_the_executor(client, node):
    assert client.get('weave.variant') == [0]
    assert not node.lines('[ERROR]') and 'Traceback' not in node.log()
