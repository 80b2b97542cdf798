# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""What the judgement of a change hands on: the parameters, and the scene that it has built."""

from icofabric_sim.parameters.validation import make_parameters
from icofabric_sim.ros.ros_parameters import ParameterGate
import pytest
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter


@pytest.mark.parametrize(('changes', 'builds'), [
    ({'connector.stiffness': 300.0}, True),
    ({'weave.size': [2, 2, 1], 'publish_rate': 10.0}, True),
    ({'publish_rate': 10.0}, False),
    ({'weave.size': [60, 60, 60]}, False)])
def test_scene_that_judges_a_change_is_handed_on(changes, builds):
    heard = []
    gate = ParameterGate(
        make_parameters({'weave.size': [2, 2, 2]}), lambda *change: heard.append(change),
        lambda: 1.0)
    result = gate.set_atomically(
        [Parameter(name, value=value) for name, value in changes.items()],
        lambda stored: SetParametersResult(successful=True))
    assert result.successful, result.reason
    [(parameters, scene)] = heard
    assert all(parameters[name] == value for name, value in changes.items())
    assert (scene is not None) == builds and gate.accepted is parameters
    if builds:
        assert scene.parameters == parameters
