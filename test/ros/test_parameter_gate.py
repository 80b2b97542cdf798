# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What the judgement of a change hands on: the parameters, and the scene that it has built."""

from icofabric_sim.parameters.file import load_parameter_file
from icofabric_sim.parameters.validation import make_parameters
from icofabric_sim.ros.ros_parameters import ParameterGate, restore_type
from icofabric_sim.running.replay.replay_parameters import OPTIONS
import pytest
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter, parameter_dict_from_yaml_file


@pytest.mark.parametrize(('changes', 'builds'), [
    ({'connector.stiffness': 300.0}, True),
    ({'weave.size': [2, 2, 1], 'publish_rate': 10.0}, True),
    ({'publish_rate': 10.0}, False),
    ({'weave.size': [60, 60, 60]}, False)])
def test_scene_that_judges_a_change_is_handed_on(changes, builds):
    heard = []
    gate = ParameterGate(
        make_parameters({'weave.size': [2, 2, 2]}), heard.append,
        lambda: 1.0)
    result = gate.set_atomically(
        [Parameter(name, value=value) for name, value in changes.items()],
        lambda stored: SetParametersResult(successful=True))
    assert result.successful, result.reason
    [change] = heard
    parameters, scene = change.after, change.scene
    assert change.rebuilds == (builds or 'weave.size' in changes)
    assert all(parameters[name] == value for name, value in changes.items())
    assert (scene is not None) == builds and gate.accepted is parameters
    if builds:
        assert scene.parameters == parameters


@pytest.mark.parametrize('values', [(120.0, 60.0), (60.0, 120.0)])
def test_of_two_values_in_one_request_the_later_rules(values):
    heard = []
    gate = ParameterGate(
        make_parameters({'publish_rate': 60.0}), lambda change: heard.append(change.after),
        lambda: 1.0)
    result = gate.set_atomically(
        [Parameter('publish_rate', value=value) for value in values],
        lambda stored: SetParametersResult(successful=True))
    assert result.successful, result.reason
    assert gate.accepted['publish_rate'] == values[-1]
    assert all(parameters['publish_rate'] == values[-1] for parameters in heard)


def test_a_file_that_is_loaded_live_means_what_it_means_at_the_start(tmp_path):
    """`ros2 param load` sends numbers, lists and truth values that YAML 1.1 does not know."""
    path = tmp_path / 'scene.yaml'
    path.write_text("""/icofabric:
  ros__parameters:
    advance_duration: 1E-05
    publish_rate: 1.5E3
    marker_rate: .5e3
    clock_rate: +1e3
    drag: {linear: 0x1p-4, angular: 5e-1}
    gravity: [0.0, 0.0, -1e-05]
    field: {electric: [1e3, 1E2, 0x1p3], magnetic: [ 1.0,2e0 ,3.]}
    record.measured: y
    contact.mode: N
""")
    gate = ParameterGate(make_parameters({}), lambda change: None, lambda: 1.0)
    for message in parameter_dict_from_yaml_file(str(path)).values():
        result = gate.set_atomically(
            [Parameter.from_parameter_msg(message)],
            lambda stored: SetParametersResult(successful=True))
        assert result.successful, result.reason
    expected = make_parameters(load_parameter_file(path))
    assert dict(gate.accepted) == dict(expected)
    assert gate.accepted['gravity'] == [0.0, 0.0, -1e-5]
    assert gate.accepted['contact.mode'] == 'never'


def test_an_option_of_a_replay_is_taken_as_a_text():
    assert restore_type('1E-01', OPTIONS['rate'].default) == 0.1
    assert restore_type('y', OPTIONS['loop'].default) is True
    assert restore_type('on', OPTIONS['bag'].default) == 'on'


@pytest.mark.parametrize('text', ['[1e, 0, 0]', '[--, 0, 0]', '[., 0, 0]'])
def test_a_text_that_is_no_list_of_numbers_is_refused_as_a_text(text):
    gate = ParameterGate(make_parameters({}), lambda change: None, lambda: 1.0)
    result = gate.set_atomically(
        [Parameter('gravity', value=text)], lambda stored: SetParametersResult(successful=True))
    assert not result.successful and 'gravity must be' in result.reason
