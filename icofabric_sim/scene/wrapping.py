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
"""What goes with connectors that lie around their shells."""

from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.attachments import are_given
from icofabric_sim.scene.maxwell import has_arms

# It restores the angle at which a connector leaves its body, which a shell decides here.
_UNFIT = 'bending_stiffness'


def check_wrapping(parameters: Parameters) -> None:
    """Refuse what a connector around a shell cannot do."""
    name = 'connector.obstruction'
    if parameters[name] != 'wrap':
        return
    if are_given(parameters) or parameters['connector.attachment_scale'] != 1.0:
        raise ParameterError(
            name, f'{name} wrap has geodesics from edge midpoints only: leave out '
            'connector.attachment_scale and connector.attachment.*, or take warn')
    arm = has_arms(parameters)
    if arm:
        raise ParameterError(
            name, f'{name} wrap does not go with {arm} {parameters[arm]!r}: a Maxwell arm follows '
            'the straight way yet; set it to 0 (damping can stay), or take warn')
    prefixes = ['connector'] + [
        f'connector_groups.{group}' for group in parameters.names('connector_groups')]
    for prefix in prefixes:
        own = f'{prefix}.{_UNFIT}'
        if parameters[own] > 0.0:
            raise ParameterError(
                name, f'{name} wrap does not go with {own} {parameters[own]!r}: bending restores '
                'the angle between connector and body, and around a shell that is the angle of '
                'the shell; set it to 0 (twisting_stiffness can stay), or take warn')
