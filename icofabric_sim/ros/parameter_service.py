# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Standard parameter services that answer every request without blocking others.

Requests are processed in turns with all other callbacks of the node. The answer waits for the
build of the changed fabric, so that a change that cannot be built is rejected in the response.
"""

from concurrent.futures import Future
import re
import time
from typing import Any
import weakref

from icofabric_sim.ros.answers import Answers
from icofabric_sim.running.rate_limited_log import shortened
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

# Largest number of parameters in one request; validating that many together takes about 1 s.
MAX_PARAMETERS_PER_REQUEST = 1000
# Time that an answer waits for the changed fabric [s]. Later results are published on ~/events.
BUILD_WAIT_S = 1.0
# Time for which parameters are validated before other callbacks run [s].
_TURN_S = 0.02
# Reason of a change that is accepted, and still being built when the answer is due.
PENDING = (
    'accepted; the old fabric continues until the changed one is built and its kernels are '
    'compiled; ~/events reports the result (reweave or change_refused)')


class GuardedParameterService(ParameterService):
    """
    Parameter services that reject requests on which rclpy's own would fail, e.g. unknown types.
    """

    def __init__(self, node: Node, answers: Answers) -> None:
        """
        Serve the parameters of `node`; `answers` holds its pending requests.

        A node that builds changes in another thread stores the future of the last build in
        `node.build`.
        """
        self._node_weak_ref = weakref.ref(node)
        self._answers = answers
        # Like rclpy, except that requests to set parameters let other callbacks run.
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
        if len(messages) > MAX_PARAMETERS_PER_REQUEST:
            response.results = [_too_many(len(messages))] * len(messages)
            return response
        results, builds = [], []
        last_turn = time.monotonic()
        for message in messages:
            result, build = self._set([message])
            results.append(result)
            builds.append(build)
            if time.monotonic() - last_turn > _TURN_S:
                await self._answers.turn()
                last_turn = time.monotonic()
        # A later parameter may correct an earlier one, so the last build decides.
        outcome = await self._outcome(next((one for one in reversed(builds) if one), None))
        response.results = [
            _with_outcome(message.name, outcome) if outcome.reason and build else result
            for message, result, build in zip(messages, results, builds, strict=True)]
        return response

    async def _set_together(self, request: Any, response: Any) -> Any:
        if len(request.parameters) > MAX_PARAMETERS_PER_REQUEST:
            response.result = _too_many(len(request.parameters))
            return response
        response.result, build = self._set(request.parameters)
        outcome = await self._outcome(build)
        if outcome.reason:
            names = ', '.join(message.name for message in request.parameters)
            response.result = _with_outcome(names, outcome)
        return response

    def _set(self, messages: Any) -> 'tuple[SetParametersResult, Future[str] | None]':
        """Validate one change; return the result, and a future of why its build failed, or ''."""
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

    async def _outcome(self, build: 'Future[str] | None') -> SetParametersResult:
        """Return why a change could not be built, or that it is still being built."""
        if build is None:
            return SetParametersResult(successful=True)
        if not await self._answers.within(build, BUILD_WAIT_S):
            return SetParametersResult(successful=True, reason=PENDING)
        reason = build.result()
        return SetParametersResult(successful=not reason, reason=reason)


def _with_outcome(names: str, outcome: SetParametersResult) -> SetParametersResult:
    return SetParametersResult(
        successful=outcome.successful, reason=shortened(f'{names}: {outcome.reason}'))


def _refusal(reason: str) -> SetParametersResult:
    return SetParametersResult(successful=False, reason=shortened(reason))


def _too_many(count: int) -> SetParametersResult:
    return _refusal(
        f'{count} parameters in one request are too many, and none was set: send at most '
        f'{MAX_PARAMETERS_PER_REQUEST}, and the rest in another one')
