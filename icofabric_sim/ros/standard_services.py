# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The services and the action of `simulation_interfaces`, if that package is installed.

Source: ros-simulation/simulation_interfaces 1.5 to 2.1. Names are private to the node, so that
several fabrics fit into one graph: `~/get_entities` for GetEntities, and so on.
"""

from collections.abc import Callable
from functools import partial
from importlib import import_module
import re
from typing import Any

from icofabric_sim.ros.answers import Answers
from icofabric_sim.ros.standard_handlers import StandardHandlers
from icofabric_sim.running.runner import Runner
from icofabric_sim.running.time_requests import StepRequest
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

PACKAGE = 'simulation_interfaces'
SERVICES = (
    'GetSimulatorFeatures', 'GetSimulationState', 'SetSimulationState', 'ResetSimulation',
    'StepSimulation', 'GetEntities', 'GetEntitiesStates', 'GetEntityState', 'SetEntityState',
    'GetEntityInfo', 'GetEntityBounds')
ACTION = 'SimulateSteps'
# Wall time between feedback messages of the action [s].
_FEEDBACK_INTERVAL_S = 0.05


def topic_name(type_name: str) -> str:
    """Return the private service name of a type: `~/get_entities` for GetEntities."""
    return '~/' + re.sub(r'(?<!^)(?=[A-Z])', '_', type_name).lower()


def offer_standard_services(
    node: Node, runner: Runner, answers: Answers, stop: Callable[[], None]
) -> StandardHandlers | None:
    """Offer the services of the installed release of the package; return None if it is missing."""
    try:
        messages, services = (import_module(f'{PACKAGE}.{part}') for part in ('msg', 'srv'))
    except ImportError:
        return None
    handlers = StandardHandlers(messages, runner, answers, stop)
    group = ReentrantCallbackGroup()
    for name in SERVICES:
        kind = getattr(services, name, None)
        if kind is not None:
            node.create_service(
                kind, topic_name(name), partial(handlers.handle, name), callback_group=group)
            handlers.offered.add(name)
    try:
        action = getattr(import_module(f'{PACKAGE}.action'), ACTION)
    except (ImportError, AttributeError):
        return handlers
    StepsAction(node, handlers, action, group)
    handlers.offered.add(ACTION)
    return handlers


class StepsAction:
    """The action SimulateSteps: solver steps with feedback and cancellation."""

    def __init__(
        self, node: Node, handlers: StandardHandlers, kind: Any, group: ReentrantCallbackGroup
    ) -> None:
        """Serve the action of type `kind`."""
        from rclpy.action import ActionServer, CancelResponse

        self._node, self._handlers, self._kind = node, handlers, kind
        self._server = ActionServer(
            node, kind, topic_name(ACTION), execute_callback=self.execute,
            cancel_callback=lambda goal: CancelResponse.ACCEPT, callback_group=group)

    async def execute(self, goal: Any) -> Any:
        """Take the steps of a goal; return its result."""
        request, result = StepRequest(goal.request.steps), self._kind.Result()
        feedback = self._kind.Feedback()

        def watch() -> None:
            feedback.completed_steps = request.taken
            feedback.remaining_steps = max(request.count - request.taken, 0)
            goal.publish_feedback(feedback)
            if goal.is_cancel_requested:
                self._handlers.end_steps()

        timer = self._node.create_timer(
            _FEEDBACK_INTERVAL_S, watch, clock=Clock(clock_type=ClockType.STEADY_TIME))
        try:
            await self._handlers.handle(ACTION, request, result)
            watch()
        finally:
            self._node.destroy_timer(timer)
        if result.result.result == result.result.RESULT_OK:
            goal.succeed()
        elif goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.abort()
        return result
