# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The services of `simulation_interfaces`, with stubs of its types."""
import asyncio
import math
import re
import sys
import threading

import icofabric_sim as ico
from icofabric_sim.geometry.icosahedron import TAU
import numpy as np
import pytest
from runner_helpers import Beside

pytest.importorskip('rclpy', reason='rclpy is not installed on this machine')

from geometry_msgs.msg import Vector3  # noqa: E402
from icofabric_sim.ros.answers import begin_aside  # noqa: E402
from icofabric_sim.ros.standard_handlers import StandardHandlers  # noqa: E402
from icofabric_sim.ros.standard_services import offer_standard_services, SERVICES  # noqa: E402
from icofabric_sim.running.runner import Runner  # noqa: E402
from simulation_interfaces_stubs import (  # noqa: E402
    FEATURES,
    install,
    Messages,
    Services,
    SimulateSteps,
)

STEP = 1e-4  # s
SCENE = {
    'weave': {'size': [3, 3, 3]},
    'contact': {'mode': 'never'},
    'gravity': [0.0, 0.0, -2.0],
    'groups': {'wall': 'x_min', 'tip': 'x_max', 'corner': 'ids 0'},
    'supports': {'wall': {'group': 'wall'}},
    'solver': {'step': STEP},
    'initial_random': {'velocity_sigma': 0.05, 'seed': 2},
    'frame_id': 'lab',
}
OK, UNSUPPORTED, NOT_FOUND, FAILED = (
    Messages.Result.RESULT_OK, Messages.Result.RESULT_FEATURE_UNSUPPORTED,
    Messages.Result.RESULT_NOT_FOUND, Messages.Result.RESULT_OPERATION_FAILED)
STOPPED, PLAYING, PAUSED, QUITTING, NO_WORLD, LOADING = range(6)


class Waiting:
    """Stands for the node's answers: no executor, so it just waits."""

    async def of(self, begin, *, at_once=False):
        return begin().result(60.0)


@pytest.fixture(scope='module')
def scene():
    return ico.Scene.from_parameters(SCENE)


@pytest.fixture(scope='module')
def running(scene):
    with Beside(Runner(ico.compile_scene(scene), [])) as beside:
        yield beside


@pytest.fixture
def runner(running):
    """Paused at the initial state, at time 0."""
    runner = running.runner
    runner.set_paused(True).result(60.0)
    runner.reset(time_reset=True).result(60.0)
    return runner


class Simulator:
    """Calls handlers as the node's services would."""

    def __init__(self, runner):
        self.ended = threading.Event()
        self.handlers = StandardHandlers(Messages, runner, Waiting(), self.ended.set)

    def call(self, name, **fields):
        kind = getattr(Services, name)
        return asyncio.run(self.handlers.handle(name, kind.Request(**fields), kind.Response()))

    def result(self, name, **fields):
        result = self.call(name, **fields).result
        return result.result, result.error_message

    def set_state(self, state):
        return self.result('SetSimulationState', state=Messages.SimulationState(state=state))

    def state(self):
        answer = self.call('GetSimulationState')
        assert answer.result.result == OK
        return answer.state.state


@pytest.fixture
def simulator(runner):
    return Simulator(runner)


def filters(*, expression='', categories=(), tags=(), mode=0, bounds=None):
    return Messages.EntityFilters(
        filter=expression,
        categories=[Messages.EntityCategory(category=value) for value in categories],
        tags=Messages.TagsFilter(tags=list(tags), filter_mode=mode),
        bounds=bounds or Messages.Bounds())


def bounds(kind, *points):
    return Messages.Bounds(
        type=kind, points=[Vector3(x=x, y=y, z=z) for x, y, z in points])


# Features.


class FakeNode:
    """Keeps what is offered."""

    def __init__(self):
        self.services = {}

    def create_service(self, kind, name, callback, *, callback_group):
        self.services[name] = (kind, callback)


@pytest.fixture
def actions(monkeypatch):
    kept = {}

    class ActionServer:

        def __init__(self, node, kind, name, execute_callback, **words):
            kept[name] = (kind, execute_callback)

    monkeypatch.setattr('rclpy.action.ActionServer', ActionServer)
    return kept


def offered_features(handlers):
    response = Services.GetSimulatorFeatures.Response()
    asyncio.run(handlers.handle('GetSimulatorFeatures', None, response))
    by_number = {number: name for name, number in FEATURES.items()}
    assert 'icosahedron_0' in response.features.custom_info
    assert response.features.spawn_formats == []
    return {by_number[number] for number in response.features.features}


def test_everything_is_offered_under_private_names(monkeypatch, actions, runner):
    install(monkeypatch)
    node = FakeNode()
    handlers = offer_standard_services(node, runner, Waiting(), lambda: None)
    assert len(node.services) == len(SERVICES)
    assert set(node.services) >= {'~/get_simulator_features', '~/get_entities_states',
                                  '~/set_entity_state', '~/reset_simulation'}
    assert list(actions) == ['~/simulate_steps']
    assert offered_features(handlers) == {
        'ENTITY_TAGS', 'ENTITY_CATEGORIES', 'ENTITY_BOUNDS_BOX', 'ENTITY_BOUNDS',
        'ENTITY_INFO_GETTING', 'ENTITY_STATE_GETTING', 'ENTITY_STATE_SETTING', 'SIMULATION_RESET',
        'SIMULATION_RESET_TIME', 'SIMULATION_RESET_STATE', 'SIMULATION_STATE_GETTING',
        'SIMULATION_STATE_SETTING', 'SIMULATION_STATE_PAUSE', 'STEP_SIMULATION_SINGLE',
        'STEP_SIMULATION_MULTIPLE', 'STEP_SIMULATION_ACTION'}


def test_features_are_those_of_the_release_that_is_installed(monkeypatch, actions, runner):
    install(monkeypatch, without=('SimulateSteps', 'SetEntityState', 'GetEntityBounds'))
    node = FakeNode()
    features = offered_features(
        offer_standard_services(node, runner, Waiting(), lambda: None))
    assert not actions and '~/set_entity_state' not in node.services
    assert not features & {'STEP_SIMULATION_ACTION', 'ENTITY_STATE_SETTING', 'ENTITY_BOUNDS'}
    assert {'STEP_SIMULATION_MULTIPLE', 'ENTITY_STATE_GETTING'} <= features


def test_nothing_without_the_package(monkeypatch, runner):
    for name in ('simulation_interfaces', 'simulation_interfaces.msg'):
        monkeypatch.setitem(sys.modules, name, None)
    node = FakeNode()
    assert offer_standard_services(node, runner, Waiting(), lambda: None) is None
    assert not node.services


# The state of the simulation.


def test_states(simulator, runner):
    assert simulator.state() == PAUSED
    assert simulator.set_state(PLAYING) == (OK, '')
    assert simulator.state() == PLAYING and not runner.paused
    code, text = simulator.set_state(PLAYING)
    assert code == Services.SetSimulationState.Response.ALREADY_IN_TARGET_STATE and text
    assert simulator.set_state(PAUSED)[0] == OK and runner.paused
    assert simulator.set_state(STOPPED)[0] == OK
    assert simulator.state() == STOPPED and runner.now == 0 and runner.paused
    assert simulator.set_state(STOPPED)[0] == 101
    assert simulator.set_state(PAUSED)[0] == OK and simulator.state() == PAUSED


def test_stopped_is_over_once_something_happens(simulator, runner):
    simulator.set_state(STOPPED)
    assert simulator.result('StepSimulation', steps=1)[0] == OK
    assert simulator.state() == PAUSED and runner.now > 0


@pytest.mark.parametrize('state', [NO_WORLD, LOADING, 77])
def test_states_that_a_fabric_does_not_have(simulator, state):
    assert simulator.set_state(state)[0] == UNSUPPORTED


def test_quitting_ends_the_node(simulator):
    assert simulator.set_state(QUITTING)[0] == OK and simulator.ended.is_set()


def test_failed_simulation_cannot_be_played(simulator, runner):
    runner.state.failure = 'the energy does not balance'
    code, text = simulator.set_state(PLAYING)
    assert code == Services.SetSimulationState.Response.STATE_TRANSITION_ERROR
    assert 'does not balance' in text and 'reset' in text
    assert simulator.state() == PAUSED
    assert simulator.result('ResetSimulation', scope=2)[0] == OK
    assert simulator.set_state(PLAYING)[0] == OK


@pytest.mark.parametrize(('scope', 'time'), [(0, True), (255, True), (3, True), (2, False)])
def test_reset(simulator, runner, scene, scope, time):
    simulator.result('StepSimulation', steps=20)
    before = runner.now
    assert simulator.result('ResetSimulation', scope=scope)[0] == OK
    assert runner.now == (0 if time else before) and before > 0
    assert (runner.simulation.snapshot().position == scene.position).all()


@pytest.mark.parametrize('scope', [1, 4, 5])
def test_reset_of_time_alone_is_refused(simulator, runner, scope):
    simulator.result('StepSimulation', steps=3)
    before = runner.now
    code, text = simulator.result('ResetSimulation', scope=scope)
    assert code == UNSUPPORTED and 'together with the state' in text and runner.now == before


# Steps.


def test_steps(simulator, runner):
    assert simulator.result('StepSimulation', steps=7) == (OK, '')
    assert runner.now == pytest.approx(7 * STEP * 1e9, abs=1.0)
    assert runner.simulation.status.step_count >= 7
    assert simulator.result('StepSimulation', steps=0)[0] == FAILED


def test_steps_are_refused_while_running(simulator):
    simulator.set_state(PLAYING)
    code, text = simulator.result('StepSimulation')
    assert code == FAILED and 'paused' in text


class Goal:
    """Stands for the goal of an action."""

    def __init__(self, steps):
        self.request = SimulateSteps.Goal(steps=steps)
        self.is_cancel_requested = False
        self.ended, self.told = [], []

    def publish_feedback(self, feedback):
        self.told.append((feedback.completed_steps, feedback.remaining_steps))

    def __getattr__(self, name):
        assert name in ('succeed', 'abort', 'canceled')
        return lambda: self.ended.append(name)


class TimerNode(FakeNode):
    """Its timers fire in a thread."""

    def create_timer(self, interval, callback, *, clock):
        over = threading.Event()

        def fire():
            while not over.wait(0.001):
                callback()

        threading.Thread(target=fire, daemon=True).start()
        return over

    def destroy_timer(self, over):
        over.set()


def do_steps(monkeypatch, actions, runner, goal):
    install(monkeypatch)
    offer_standard_services(TimerNode(), runner, Waiting(), lambda: None)
    kind, execute = actions['~/simulate_steps']
    assert kind is SimulateSteps
    return asyncio.run(execute(goal)).result


def test_action(monkeypatch, actions, runner):
    goal = Goal(500)
    assert do_steps(monkeypatch, actions, runner, goal).result == OK
    assert goal.ended == ['succeed'] and goal.told[-1] == (500, 0)
    assert all(done + left == 500 for done, left in goal.told)
    assert runner.now == pytest.approx(500 * STEP * 1e9, abs=1.0)


def test_action_is_cancelled(monkeypatch, actions, runner):
    goal = Goal(10**9)
    goal.is_cancel_requested = True
    result = do_steps(monkeypatch, actions, runner, goal)
    assert result.result == FAILED and 'of 1000000000 solver steps' in result.error_message
    assert goal.ended == ['canceled'] and runner.paused


def test_action_while_running(monkeypatch, actions, runner):
    runner.set_paused(False).result(60.0)
    goal = Goal(3)
    result = do_steps(monkeypatch, actions, runner, goal)
    assert result.result == FAILED and 'paused' in result.error_message
    assert goal.ended == ['abort']


# Entities.


def entities(simulator, **words):
    answer = simulator.call('GetEntities', filters=filters(**words))
    assert answer.result.result == OK, answer.result.error_message
    return [int(name.removeprefix('icosahedron_')) for name in answer.entities]


def test_all_entities(simulator, scene):
    assert entities(simulator) == list(range(scene.body_count))


def test_entities_by_name(simulator):
    assert entities(simulator, expression='_1$') == [1]
    assert entities(simulator, expression='^icosahedron_[0-9]$') == list(range(10))
    assert entities(simulator, expression='robot') == []


@pytest.mark.parametrize('expression', ['(', '[', '(a)\\1', 'a' * 300, 'x{900}{900}'])
def test_bad_or_costly_expressions(simulator, expression):
    code, text = simulator.result('GetEntities', filters=filters(expression=expression))
    assert code == FAILED and re.search('regular expression|too much|too complex', text)


def test_entities_by_category_and_tags(simulator, scene):
    wall, tip = scene.groups['wall'].tolist(), scene.groups['tip'].tolist()
    free = [body for body in range(scene.body_count) if body not in wall]
    assert entities(simulator, categories=[5]) == wall
    assert entities(simulator, categories=[4]) == free
    assert entities(simulator, categories=[4, 5]) == list(range(scene.body_count))
    assert entities(simulator, tags=['tip']) == tip
    assert entities(simulator, tags=['wall', 'tip']) == sorted(wall + tip)
    assert entities(simulator, tags=['wall', 'corner'], mode=1) == [0]
    assert entities(simulator, tags=['nobody']) == []
    code, _ = simulator.result('GetEntities', filters=filters(categories=[2]))
    assert code == NOT_FOUND


def test_entities_by_bounds(simulator, scene):
    kind, radius = Messages.Bounds, scene.geometry.half_edge * math.sqrt(TAU + 2.0)
    far = scene.position[-1]
    reach = radius + 1e-4
    sphere = bounds(kind.TYPE_SPHERE, far, (1e-5, 0.0, 0.0))
    assert entities(simulator, bounds=sphere) == [scene.body_count - 1]
    box = bounds(kind.TYPE_BOX, far + reach, far - 1e-5)
    near = np.flatnonzero((scene.position >= far - reach - 1e-5).all(axis=1)).tolist()
    assert set(entities(simulator, bounds=box)) <= set(near)
    assert scene.body_count - 1 in entities(simulator, bounds=box)
    outside = bounds(kind.TYPE_BOX, far + 1.0 + reach, far + 1.0)
    assert entities(simulator, bounds=outside) == []
    hull = bounds(kind.TYPE_CONVEX_HULL, far, far, far)
    assert simulator.result('GetEntities', filters=filters(bounds=hull))[0] == UNSUPPORTED
    broken = bounds(kind.TYPE_SPHERE, far)
    assert simulator.result('GetEntities', filters=filters(bounds=broken))[0] == FAILED


def test_states_of_entities(simulator, runner):
    simulator.result('StepSimulation', steps=40)
    snapshot = runner.simulation.snapshot()
    answer = simulator.call('GetEntitiesStates', filters=filters())
    assert answer.result.result == OK and len(answer.states) == len(snapshot.position)
    for body, state in enumerate(answer.states):
        check_state(state, snapshot, body, runner.now)
    assert abs(snapshot.linear_velocity).max() > 1e-3


def check_state(state, snapshot, body, time):
    assert state.header.frame_id == 'lab'
    assert state.header.stamp.sec * 10**9 + state.header.stamp.nanosec == time
    for field, names, values in (
            (state.pose.position, 'xyz', snapshot.position),
            (state.pose.orientation, 'xyzw', snapshot.orientation),
            (state.twist.linear, 'xyz', snapshot.linear_velocity),
            (state.twist.angular, 'xyz', snapshot.angular_velocity)):
        assert [getattr(field, name) for name in names] == values[body].tolist()
    # Not given, and not a number that could be taken for one.
    assert math.isnan(state.acceleration.linear.x)


def test_too_many_states_for_one_answer(simulator, monkeypatch):
    monkeypatch.setattr('icofabric_sim.ros.standard_handlers.MAX_STATES', 3)
    code, text = simulator.result('GetEntitiesStates', filters=filters())
    assert code == FAILED and '~/state' in text


def test_state_info_and_bounds_of_one(simulator, runner, scene):
    answer = simulator.call('GetEntityState', entity='icosahedron_4')
    check_state(answer.state, runner.simulation.snapshot(), 4, runner.now)
    held, free = (simulator.call('GetEntityInfo', entity=f'icosahedron_{body}').info
                  for body in (0, scene.groups['tip'][0]))
    assert held.category.category == 5 and free.category.category == 4
    assert held.tags == ['corner', 'wall'] and free.tags == ['tip']
    assert 'edge 0.02 m' in free.description
    box = simulator.call('GetEntityBounds', entity='icosahedron_1').bounds
    assert box.type == Messages.Bounds.TYPE_BOX
    upper, lower = ([point.x, point.y, point.z] for point in box.points)
    assert upper == pytest.approx([0.01 * TAU] * 3) and lower == pytest.approx([-0.01 * TAU] * 3)


@pytest.mark.parametrize('service', ['GetEntityState', 'GetEntityInfo', 'GetEntityBounds',
                                     'SetEntityState'])
@pytest.mark.parametrize('name', ['', 'icosahedron_', 'icosahedron_9999', 'icosahedron_01',
                                  'robot', 'icosahedron_-1'])
def test_unknown_entity(simulator, service, name):
    code, text = simulator.result(service, entity=name)
    assert code == NOT_FOUND and repr(name) in text


def new_state(*, position=(0.1, 0.2, 0.3), orientation=(0.0, 0.6, 0.0, 0.8),
              linear=(1.0, -2.0, 0.5), angular=(3.0, 4.0, -5.0), frame=''):
    state = Messages.EntityState()
    state.header.frame_id = frame
    for field, names, values in (
            (state.pose.position, 'xyz', position), (state.pose.orientation, 'xyzw', orientation),
            (state.twist.linear, 'xyz', linear), (state.twist.angular, 'xyz', angular)):
        for name, value in zip(names, values):
            setattr(field, name, value)
    return state


@pytest.mark.parametrize(('pose', 'twist'), [(True, True), (True, False), (False, True)])
def test_set_state_of_one(simulator, runner, scene, pose, twist):
    body = int(scene.groups['tip'][0])
    simulator.result('StepSimulation', steps=5)
    before, state = runner.simulation.snapshot(), new_state()
    assert simulator.result(
        'SetEntityState', entity=f'icosahedron_{body}', state=state, set_pose=pose,
        set_twist=twist) == (OK, '')
    after = runner.simulation.snapshot()
    wanted = {'position': (0.1, 0.2, 0.3), 'orientation': (0.0, 0.6, 0.0, 0.8),
              'linear_velocity': (1.0, -2.0, 0.5), 'angular_velocity': (3.0, 4.0, -5.0)}
    for name, values in wanted.items():
        old, new = getattr(before, name), getattr(after, name)
        others = np.arange(len(old)) != body
        assert (old[others] == new[others]).all()
        changed = pose if name in ('position', 'orientation') else twist
        expected = values if changed else old[body]
        np.testing.assert_allclose(new[body], expected, rtol=0.0, atol=1e-15)


REFUSED = {
    'frame': ({'state': new_state(frame='map'), 'set_pose': True}, FAILED, "'map'"),
    'acceleration': ({'set_acceleration': True, 'set_pose': True}, UNSUPPORTED, 'wrench'),
    'orientation': ({'state': new_state(orientation=(0.0, 0.0, 0.0, 0.0)), 'set_pose': True},
                    101, 'quaternion'),
    'NaN': ({'state': new_state(position=(math.nan, 0.0, 0.0)), 'set_pose': True}, FAILED,
            'finite'),
    'huge': ({'state': new_state(position=(1e200, 0.0, 0.0)), 'set_pose': True}, FAILED, ''),
    'huge spin': ({'state': new_state(angular=(1e200, 0.0, 0.0)), 'set_twist': True}, FAILED, ''),
}


@pytest.mark.parametrize('name', REFUSED)
def test_states_that_are_refused_change_nothing(simulator, runner, scene, name):
    fields, expected, words = REFUSED[name]
    before, body = runner.simulation.snapshot(), scene.groups['tip'][0]
    code, text = simulator.result(
        'SetEntityState', **{'entity': f'icosahedron_{body}', 'state': new_state(), **fields})
    assert code == expected and words in text and text
    after = runner.simulation.snapshot()
    for name in ('position', 'orientation', 'linear_velocity', 'angular_velocity'):
        assert (getattr(before, name) == getattr(after, name)).all()
    assert not runner.failure
    assert simulator.result('StepSimulation', steps=2)[0] == OK


def test_held_body_cannot_be_set_in_motion(simulator):
    code, text = simulator.result(
        'SetEntityState', entity='icosahedron_0', state=new_state(), set_twist=True)
    assert code == FAILED and 'fixed by a support' in text


def test_work_aside_hands_on_its_error():
    assert begin_aside(lambda: 7).result(10.0) == 7
    with pytest.raises(ValueError, match='no'):
        begin_aside(lambda: int('no')).result(10.0)
