# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A client of the real `simulation_interfaces`, where that package is installed with type support.
"""
import pytest

pytest.importorskip(
    'simulation_interfaces.srv', reason='simulation_interfaces is not installed on this machine')

from action_msgs.msg import GoalStatus  # noqa: E402
from icofabric_sim.ros.standard_services import SERVICES, topic_name  # noqa: E402
from rclpy.action import ActionClient  # noqa: E402
from simulation_interfaces.action import SimulateSteps  # noqa: E402
from simulation_interfaces.msg import EntityState, Result, SimulationState  # noqa: E402

SCENE = {
    'weave': {'size': [3, 3, 3]},
    'contact': {'mode': 'never'},
    'solver': {'step': 1e-4},
    'start_paused': True,
}


def call(client, name, **fields):
    response = client.call(topic_name(name), f'simulation_interfaces/srv/{name}', **fields)
    if hasattr(response, 'result'):
        assert response.result.result == Result.RESULT_OK, response.result.error_message
    return response


def test_every_service_answers(client):
    assert len(call(client, 'GetEntities').entities) == 14
    entity = 'icosahedron_2'
    for name in SERVICES:
        fields = {'entity': entity} if name.startswith(('GetEntityS', 'GetEntityI', 'GetEntityB',
                                                        'SetEntity')) else {}
        if name != 'SetSimulationState':
            call(client, name, **fields)


def test_states_and_steps(client):
    states = SimulationState
    assert call(client, 'GetSimulationState').state.state == states.STATE_PAUSED
    call(client, 'StepSimulation', steps=10)
    assert client.clock >= 10**6
    call(client, 'SetSimulationState', state=states(state=states.STATE_PLAYING))
    client.next('~/poses', lambda pose: pose.nanoseconds > 10**7)
    call(client, 'SetSimulationState', state=states(state=states.STATE_STOPPED))
    assert call(client, 'GetSimulationState').state.state == states.STATE_STOPPED
    client.wait_for(lambda: client.clock == 0, 'time 0')


def test_state_of_a_body(client):
    state = EntityState()
    state.pose.position.x, state.pose.orientation.w, state.twist.linear.z = 0.5, 1.0, -0.25
    call(client, 'SetEntityState', entity='icosahedron_3', state=state, set_pose=True,
         set_twist=True)
    found = call(client, 'GetEntityState', entity='icosahedron_3').state
    assert found.pose.position.x == 0.5 and found.twist.linear.z == -0.25
    assert found.header.frame_id == 'world'
    pose = client.next('~/poses', lambda pose: pose.values[3, 0] == 0.5)
    assert pose.values[3, 1] == 0.0


@pytest.fixture
def action(client):
    action = ActionClient(client.node, SimulateSteps, '/icofabric/simulate_steps')
    client.wait_for(action.server_is_ready, 'the action server')
    yield action
    action.destroy()


def test_action_steps_and_tells_how_far(client, action):
    told = []
    sending = action.send_goal_async(
        SimulateSteps.Goal(steps=20_000), lambda message: told.append(message.feedback))
    client.wait_for(sending.done, 'acceptance')
    ending = sending.result().get_result_async()
    client.wait_for(ending.done, 'result')
    assert ending.result().status == GoalStatus.STATUS_SUCCEEDED
    assert ending.result().result.result.result == Result.RESULT_OK
    client.wait_for(lambda: told and told[-1].remaining_steps == 0, 'the last feedback')
    assert told[-1].completed_steps == 20_000 and len(told) > 1


def test_action_is_cancelled(client, action):
    sending = action.send_goal_async(SimulateSteps.Goal(steps=10**12))
    client.wait_for(sending.done, 'acceptance')
    goal = sending.result()
    ending = goal.get_result_async()
    client.next('/clock')
    # Other services answer meanwhile.
    assert call(client, 'GetSimulationState').state.state == SimulationState.STATE_PAUSED
    client.wait_for(goal.cancel_goal_async().done, 'acceptance of the end')
    client.wait_for(ending.done, 'the end')
    assert ending.result().status == GoalStatus.STATUS_CANCELED
    assert 'of 1000000000000 solver steps' in ending.result().result.result.error_message


def test_quitting(client, node):
    states = SimulationState
    call(client, 'SetSimulationState', state=states(state=states.STATE_QUITTING))
    assert node.wait() == 0
    assert 'Traceback' not in node.log()
