# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""std_srvs services of a fabric: pause, reset, step, advance, loads, record, checkpoints."""

from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from icofabric_sim.checks import counted
from icofabric_sim.messages.schedule import seconds
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.ros.answers import Answers
from icofabric_sim.running.checkpoint_files import path_to_restore, path_to_save
from icofabric_sim.running.runner import Runner
from icofabric_sim.running.time_requests import StepRequest
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

# Function that formats the result of an operation as a sentence.
Formatter = Callable[[Any], str]


class StdServices:
    """
    Services that answer after completion, with `success: true` or the reason for the failure.
    """

    def __init__(self, node: Node, runner: Runner, answers: Answers) -> None:
        """Offer the services of `node`, executed by `runner`."""
        self._runner, self._answers = runner, answers
        self._being_saved: set[Path] = set()
        # A request that waits for its answer must not block others.
        group = ReentrantCallbackGroup()
        for kind, name, callback in (
            (SetBool, '~/pause', self._pause),
            (Trigger, '~/reset', self._reset),
            (Trigger, '~/step', self._step),
            (Trigger, '~/advance', self._advance),
            (Trigger, '~/clear_loads', self._clear_loads),
            (Trigger, '~/solve_equilibrium', self._solve_equilibrium),
            (SetBool, '~/record', self._record),
            (Trigger, '~/save_checkpoint', self._save),
            (Trigger, '~/restore_checkpoint', self._restore),
        ):
            node.create_service(kind, name, callback, callback_group=group)

    async def _pause(
        self, request: SetBool.Request, response: SetBool.Response
    ) -> SetBool.Response:
        word = 'paused' if request.data else 'running'
        return await self._answer(
            response, lambda: self._runner.set_paused(request.data), _timed(word), at_once=True)

    async def _reset(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        return await self._answer(
            response, self._runner.reset, _timed('reset to the initial state'), at_once=True)

    async def _step(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        steps = StepRequest()
        return await self._answer(
            response, lambda: self._runner.take_steps(steps),
            lambda time: _timed(f'{counted(steps.count, "solver step")} taken')(time))

    async def _advance(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        return await self._answer(response, self._runner.advance, _timed('advanced'))

    async def _clear_loads(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        return await self._answer(
            response, self._runner.clear_loads, _timed('all wrenches cleared'), at_once=True)

    async def _solve_equilibrium(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        return await self._answer(response, self._runner.solve_equilibrium, str)

    async def _record(
        self, request: SetBool.Request, response: SetBool.Response
    ) -> SetBool.Response:
        return await self._answer(
            response, lambda: self._runner.set_recording(request.data), str)

    async def _save(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        chosen: list[Path] = []

        def choose(parameters: Parameters) -> Path:
            path = path_to_save(parameters, self._being_saved)
            chosen.append(path)
            self._being_saved.add(path)
            return path

        def begin() -> 'Future[Any]':
            future = self._runner.save_checkpoint(choose)
            future.add_done_callback(lambda _: self._being_saved.difference_update(chosen))
            return future

        return await self._answer(response, begin, lambda path: f'saved to {path}')

    async def _restore(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        chosen: list[Path] = []

        def choose(parameters: Parameters) -> Path:
            chosen.append(path_to_restore(parameters))
            return chosen[0]

        return await self._answer(
            response, lambda: self._runner.restore_checkpoint(choose),
            lambda time: f'restored from {chosen[0]}, t = {seconds(time):.9f} s')

    async def _answer(
        self,
        response: Any,
        begin: 'Callable[[], Future[Any]]',
        words: Formatter,
        *,
        at_once: bool = False,
    ) -> Any:
        try:
            result = await self._answers.of(begin, at_once=at_once)
        except Exception as error:  # noqa: BLE001 - the client gets the reason
            response.success = False
            response.message = str(error) or type(error).__name__
        else:
            response.success, response.message = True, words(result)
        return response


def _timed(word: str) -> Formatter:
    return lambda time: f'{word}, t = {seconds(time):.9f} s'
