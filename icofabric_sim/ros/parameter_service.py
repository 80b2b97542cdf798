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
"""
The standard parameter services, with an answer to every request, that hold up no other.

A request is worked off in turns with all else that the node is asked for, and waits for the build
of the changed fabric, so that a change that cannot be built is refused where it was asked for.
"""

from concurrent.futures import Future
import re
import time
from typing import Any
import weakref

from icofabric_sim.ros.answers import Answers
from icofabric_sim.running.complaints import shortened
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService
from rclpy.qos import qos_profile_parameters

# What one request can hold: all of them are judged together, which takes about a second then.
MOST_AT_ONCE = 1000
# How long an answer waits for the changed fabric [s]. What takes longer is on ~/events.
BUILD_WAIT = 1.0
# So long [s] parameters are judged before others have their turn.
_TURN = 0.02


class GuardedParameterService(ParameterService):
    """Refuses what rclpy's own service breaks off on, e.g. a type code that does not exist."""

    def __init__(self, node: Node, answers: Answers) -> None:
        """
        Serve the parameters of `node`, whose other requests wait in `answers`.

        A node whose changes are built aside keeps in `build` what will hold the outcome of the
        last one.
        """
        self._node_weak_ref = weakref.ref(node)
        self._answers = answers
        # As rclpy's own, but that requests to set something let others pass.
        together, turns = node.default_callback_group, ReentrantCallbackGroup()
        for kind, callback, group in (
            (DescribeParameters, self._describe_parameters_callback, together),
            (GetParameters, self._get_parameters_callback, together),
            (GetParameterTypes, self._get_parameter_types_callback, together),
            (ListParameters, self._list_parameters_callback, together),
            (SetParameters, self._set_each, turns),
            (SetParametersAtomically, self._set_together, turns),
        ):
            words = re.findall('[A-Z][a-z]+', kind.__name__)
            node.create_service(
                kind, '~/' + '_'.join(words).lower(), callback,
                qos_profile=qos_profile_parameters, callback_group=group)

    async def _set_each(self, request: Any, response: Any) -> Any:
        messages = request.parameters
        if len(messages) > MOST_AT_ONCE:
            response.results = [_too_many(len(messages))] * len(messages)
            return response
        results, builds = [], []
        last_turn = time.monotonic()
        for message in messages:
            result, build = self._set([message])
            results.append(result)
            builds.append(build)
            if time.monotonic() - last_turn > _TURN:
                await self._answers.turn()
                last_turn = time.monotonic()
        # A later one of them may make up for an earlier one: what counts is the last build.
        reason = await self._outcome(next((one for one in reversed(builds) if one), None))
        response.results = [
            _refusal(f'{message.name}: {reason}') if reason and build else result
            for message, result, build in zip(messages, results, builds, strict=True)]
        return response

    async def _set_together(self, request: Any, response: Any) -> Any:
        if len(request.parameters) > MOST_AT_ONCE:
            response.result = _too_many(len(request.parameters))
            return response
        response.result, build = self._set(request.parameters)
        reason = await self._outcome(build)
        if reason:
            names = ', '.join(message.name for message in request.parameters)
            response.result = _refusal(f'{names}: {reason}')
        return response

    def _set(self, messages: Any) -> 'tuple[SetParametersResult, Future[str] | None]':
        """Judge one change; beside the result, what will hold the reason why it is taken back."""
        wanted = []
        for message in messages:
            try:
                wanted.append(Parameter.from_parameter_msg(message))
            except Exception as error:  # noqa: BLE001 - the client gets the reason
                return _refusal(f'{message.name}: {error}'), None
        node = self._get_node()
        node.build = None
        try:
            return node.set_parameters_atomically(wanted), node.build
        except Exception as error:  # noqa: BLE001 - the client gets the reason
            names = ', '.join(parameter.name for parameter in wanted)
            return _refusal(f'{names}: {error}'), None

    async def _outcome(self, build: 'Future[str] | None') -> str:
        """Why a change could not be built, as far as that is known soon; '': it was, or may be."""
        if build is None or not await self._answers.within(build, BUILD_WAIT):
            return ''
        return build.result()


def _refusal(reason: str) -> SetParametersResult:
    return SetParametersResult(successful=False, reason=shortened(reason))


def _too_many(count: int) -> SetParametersResult:
    return _refusal(
        f'{count} parameters in one request are too many, and none was set: send at most '
        f'{MOST_AT_ONCE}, and the rest in another one')
