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
"""The standard parameter services, with an answer to every request."""

from collections.abc import Iterable
from typing import Any

from icofabric_sim.running.complaints import shortened
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService


class GuardedParameterService(ParameterService):
    """Refuses what rclpy's own service breaks off on, e.g. a type code that does not exist."""

    def _set_parameters_callback(self, request: Any, response: Any) -> Any:
        response.results = [self._set([message]) for message in request.parameters]
        return response

    def _set_parameters_atomically_callback(self, request: Any, response: Any) -> Any:
        response.result = self._set(request.parameters)
        return response

    def _set(self, messages: Iterable[ParameterMessage]) -> SetParametersResult:
        wanted = []
        for message in messages:
            try:
                wanted.append(Parameter.from_parameter_msg(message))
            except Exception as error:  # noqa: BLE001 - the client gets the reason
                return _refusal(f'{message.name}: {error}')
        try:
            return self._get_node().set_parameters_atomically(wanted)
        except Exception as error:  # noqa: BLE001 - the client gets the reason
            names = ', '.join(parameter.name for parameter in wanted)
            return _refusal(f'{names}: {error}')


def _refusal(reason: str) -> SetParametersResult:
    return SetParametersResult(successful=False, reason=shortened(reason))
