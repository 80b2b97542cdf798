# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Handlers of the services of `simulation_interfaces`.

Requests and responses are accessed by field names only, so this module needs neither that package
nor its type support. `messages` stands for `simulation_interfaces.msg`.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from geometry_msgs.msg import Vector3
from icofabric_sim.geometry.icosahedron import vertices
from icofabric_sim.messages.frames import body_frame
from icofabric_sim.messages.schedule import NANOSECONDS
from icofabric_sim.ros.answers import Answers, begin_aside
from icofabric_sim.running.entities import Box, checked_parts, Entities, Query, Sphere
from icofabric_sim.running.runner import Runner
from icofabric_sim.running.time_requests import StepRequest
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.model.snapshot import Snapshot
import numpy as np

# Features with the service or action that provides them; those missing in the installed release
# are left out.
FEATURES = {
    'GetEntities': ('ENTITY_TAGS', 'ENTITY_CATEGORIES', 'ENTITY_BOUNDS_BOX'),
    'GetEntityBounds': ('ENTITY_BOUNDS',),
    'GetEntityInfo': ('ENTITY_INFO_GETTING',),
    'GetEntityState': ('ENTITY_STATE_GETTING',),
    'SetEntityState': ('ENTITY_STATE_SETTING',),
    'ResetSimulation': (
        'SIMULATION_RESET', 'SIMULATION_RESET_TIME', 'SIMULATION_RESET_STATE'),
    'GetSimulationState': ('SIMULATION_STATE_GETTING',),
    'SetSimulationState': ('SIMULATION_STATE_SETTING', 'SIMULATION_STATE_PAUSE'),
    'StepSimulation': ('STEP_SIMULATION_SINGLE', 'STEP_SIMULATION_MULTIPLE'),
    'SimulateSteps': ('STEP_SIMULATION_MULTIPLE', 'STEP_SIMULATION_ACTION'),
}
_CUSTOM = (
    f'icofabric_sim: entities are the bodies {body_frame(0)}, ...; their tags are the groups '
    'of the scene. Time is reset only together with the state. Accelerations are NaN '
    'and cannot be set. A step is one solver step.')
# Objects of this many states take about 1 s to build and to send.
MAX_STATES = 10_000


class RequestError(Exception):
    """Request that is answered with a result code other than OK."""

    def __init__(self, code: int, text: str) -> None:
        super().__init__(text)
        self.code = code

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.code, *self.args), vars(self)


class View(NamedTuple):
    """State of the fabric at one time."""

    time: int  # [ns]
    scene: Scene
    snapshot: Snapshot


class StandardHandlers:
    """One coroutine for each service, named as in the package; run in the executor's thread."""

    def __init__(
        self, messages: Any, runner: Runner, answers: Answers, stop: Callable[[], None]
    ) -> None:
        """Answer for `runner`; `stop` ends the node."""
        self._messages, self._result = messages, messages.Result
        self._runner, self._answers, self._stop = runner, answers, stop
        self._frame_id = runner.parameters['frame_id']
        # Set when a client has stopped the simulation; valid until something else happens.
        self._stopped_at: tuple[int, int] | None = None
        self.offered: set[str] = set()

    async def handle(self, name: str, request: Any, response: Any) -> Any:
        """Answer any request of the service `name`."""
        code, text = self._result.RESULT_OK, ''
        try:
            text = await getattr(self, name)(request, response) or ''
        except RequestError as error:
            code, text = error.code, str(error)
        except KeyError as error:
            code, text = self._result.RESULT_NOT_FOUND, str(error.args[0])
        except Exception as error:  # noqa: BLE001 - the client gets the reason
            code, text = self._result.RESULT_OPERATION_FAILED, str(error) or repr(error)
        if hasattr(response, 'result'):
            response.result.result, response.result.error_message = code, text
        return response

    # Simulator services.

    async def GetSimulatorFeatures(self, request: Any, response: Any) -> None:
        """Return the offered features."""
        kind = self._messages.SimulatorFeatures
        names = {feature for name in self.offered for feature in FEATURES.get(name, ())}
        response.features.features = sorted(
            getattr(kind, name) for name in names if hasattr(kind, name))
        response.features.custom_info = _CUSTOM

    async def GetSimulationState(self, request: Any, response: Any) -> str:
        """Return whether time runs; a finished run is reported as stopped."""
        response.state.state = self._state()
        return self._end_reason()

    async def SetSimulationState(self, request: Any, response: Any) -> None:
        """Pause, resume, stop (pause and reset, time included) or quit."""
        kind, target = self._messages.SimulationState, request.state.state
        if target == kind.STATE_QUITTING:
            self._stop()
            return
        if target not in (kind.STATE_STOPPED, kind.STATE_PLAYING, kind.STATE_PAUSED):
            raise RequestError(
                self._result.RESULT_FEATURE_UNSUPPORTED,
                f'state {target} is not supported: only stopped, playing, paused and quitting are')
        if target == self._state():
            raise RequestError(response.ALREADY_IN_TARGET_STATE, 'already in this state')
        if target == kind.STATE_PLAYING:
            if self._end_reason():
                raise RequestError(response.STATE_TRANSITION_ERROR, self._end_reason())
            await self._answers.of(lambda: self._runner.set_paused(False), at_once=True)
            return
        await self._answers.of(lambda: self._runner.set_paused(True), at_once=True)
        self._stopped_at = None
        if target == kind.STATE_STOPPED:
            await self._answers.of(
                lambda: self._runner.reset(time_reset=True), at_once=True)
            self._stopped_at = self._progress()

    async def ResetSimulation(self, request: Any, response: Any) -> None:
        """Reset to the initial state, and to time 0 if the scope includes time."""
        scope = request.scope or request.SCOPE_ALL
        if not scope & request.SCOPE_STATE:
            raise RequestError(
                self._result.RESULT_FEATURE_UNSUPPORTED,
                'time is reset only together with the state, and spawning is not supported')
        with_time = bool(scope & request.SCOPE_TIME)
        await self._answers.of(
            lambda: self._runner.reset(time_reset=with_time), at_once=True)

    async def StepSimulation(self, request: Any, response: Any) -> None:
        """Take solver steps while paused; answer once they are taken."""
        await self.SimulateSteps(StepRequest(request.steps), response)

    async def SimulateSteps(self, request: StepRequest, response: Any) -> None:
        """Take solver steps for a request that reports progress."""
        if not request.count >= 1:
            raise ValueError(f'steps must be at least 1, got {request.count}')
        await self._answers.of(lambda: self._runner.take_steps(request))

    def end_steps(self) -> None:
        """Stop taking steps; the simulation stays paused."""
        self._runner.set_paused(True)

    # Entity services.

    async def GetEntities(self, request: Any, response: Any) -> None:
        """Return the names of the bodies that match the filters."""
        view = await self._view()
        response.entities = [
            body_frame(body) for body in await self._select(request.filters, view)]

    async def GetEntitiesStates(self, request: Any, response: Any) -> None:
        """Return the names and states of the bodies that match the filters."""
        view = await self._view()
        bodies = await self._select(request.filters, view)
        if len(bodies) > MAX_STATES:
            raise RequestError(
                self._result.RESULT_OPERATION_FAILED,
                f'{len(bodies)} states are too many for one answer ({MAX_STATES} at most): '
                'filter them, or subscribe to ~/state')
        response.entities = [body_frame(body) for body in bodies]
        response.states = await self._answers.of(lambda: begin_aside(
            lambda: [self._fill(self._messages.EntityState(), view, body) for body in bodies]))

    async def GetEntityState(self, request: Any, response: Any) -> None:
        """Return the pose and velocities of one body."""
        view = await self._view()
        self._fill(response.state, view, Entities(view.scene).number(request.entity))

    async def SetEntityState(self, request: Any, response: Any) -> None:
        """Set pose and velocities of a body; coordinates fixed by a support stay at rest."""
        view, state = await self._view(), request.state
        entities = Entities(view.scene)
        body = entities.number(request.entity)
        if state.header.frame_id not in ('', self._frame_id):
            raise ValueError(
                f'header.frame_id is {state.header.frame_id!r}, and must be empty or '
                f'{self._frame_id!r}')
        if request.set_acceleration:
            raise RequestError(
                self._result.RESULT_FEATURE_UNSUPPORTED,
                'accelerations cannot be set: send a wrench instead')
        parts: dict[str, list[float]] = {}
        if request.set_pose:
            pose = state.pose
            parts |= {'position': _numbers(pose.position, 'xyz'),
                      'orientation': _numbers(pose.orientation, 'xyzw')}
            if not abs(np.linalg.norm(parts['orientation']) - 1.0) <= 1e-3:
                raise RequestError(
                    getattr(response, 'INVALID_POSE', self._result.RESULT_OPERATION_FAILED),
                    f'orientation {parts["orientation"]} is not a unit quaternion')
        if request.set_twist:
            twist = state.twist
            parts |= {'linear_velocity': _numbers(twist.linear, 'xyz'),
                      'angular_velocity': _numbers(twist.angular, 'xyz')}
            if entities.held[body] and any(
                    parts['linear_velocity'] + parts['angular_velocity']):
                raise ValueError(f'{request.entity} is fixed by a support and cannot move')
        checked = checked_parts(parts)
        if checked:
            await self._answers.of(lambda: self._runner.set_body_state(body, checked))

    async def GetEntityInfo(self, request: Any, response: Any) -> None:
        """Describe an entity: shell, free or fixed by a support, and its groups."""
        view, kind = await self._view(), self._messages.EntityCategory
        entities, info = Entities(view.scene), response.info
        body = entities.number(request.entity)
        held = entities.held[body]
        masses = view.scene.masses.mass
        mass = masses[body if len(masses) > 1 else 0]
        info.category.category = (
            kind.CATEGORY_STATIC_OBJECT if held else kind.CATEGORY_DYNAMIC_OBJECT)
        info.description = (
            f'icosahedral shell {body} of {view.scene.body_count}: edge '
            f'{2.0 * view.scene.body_half_edges[body]:g} m, '
            f'mass {mass:g} kg{", fixed by a support" if held else ""}')
        info.tags = entities.tags(body)

    async def GetEntityBounds(self, request: Any, response: Any) -> None:
        """Return the bounding box of a shell in its body frame."""
        view = await self._view()
        body = Entities(view.scene).number(request.entity)
        corners = vertices(float(view.scene.body_half_edges[body]))
        response.bounds.type = self._messages.Bounds.TYPE_BOX
        response.bounds.points = [
            Vector3(x=float(x), y=float(y), z=float(z))
            for x, y, z in (corners.max(axis=0), corners.min(axis=0))]

    # Shared helpers.

    def _state(self) -> int:
        kind: Any = self._messages.SimulationState
        if self._stopped_at is not None and self._runner.paused and (
                self._stopped_at == self._progress()):
            return int(kind.STATE_STOPPED)
        stands = self._runner.paused or self._end_reason()
        return int(kind.STATE_PAUSED if stands else kind.STATE_PLAYING)

    def _progress(self) -> tuple[int, int]:
        return self._runner.now, self._runner.simulation.status.step_count

    def _end_reason(self) -> str:
        if self._runner.failure:
            return f'the simulation has stopped; reset it first: {self._runner.failure}'
        return 'the duration of the run has passed' if self._runner.finished else ''

    async def _view(self) -> View:
        runner = self._runner
        view: View = await self._answers.of(lambda: runner.post(
            lambda: View(runner.now, runner.simulation.scene, runner.simulation.snapshot())))
        return view

    async def _select(self, filters: Any, view: View) -> list[int]:
        query = self._query(filters)
        bodies: list[int] = await self._answers.of(lambda: begin_aside(
            partial(Entities(view.scene).select, query, view.snapshot.position)))
        return bodies

    def _query(self, filters: Any) -> Query:
        kind, bounds = self._messages.EntityCategory, self._messages.Bounds
        wanted = {category.category for category in filters.categories}
        ours = [kind.CATEGORY_DYNAMIC_OBJECT, kind.CATEGORY_STATIC_OBJECT]
        held: bool | None = None
        if wanted:
            fitting = [category for category in ours if category in wanted]
            if not fitting:
                raise RequestError(
                    self._result.RESULT_NOT_FOUND,
                    'entities are dynamic objects, or static objects if supports fix them')
            held = None if len(fitting) == 2 else fitting == ours[1:]
        region: Sphere | Box | None = None
        points = [np.array(_numbers(point, 'xyz')) for point in filters.bounds.points]
        shape = filters.bounds.type
        if shape in (bounds.TYPE_SPHERE, bounds.TYPE_BOX):
            if len(points) != 2 or not np.isfinite(points).all():
                raise ValueError('bounds need two finite points')
            region = Sphere(points[0], float(points[1][0]))
            if shape == bounds.TYPE_BOX:
                region = Box(np.minimum(*points), np.maximum(*points))
        elif shape != bounds.TYPE_EMPTY:
            raise RequestError(
                self._result.RESULT_FEATURE_UNSUPPORTED,
                f'bounds of type {shape} are not supported; use a sphere or a box')
        tags = filters.tags
        return Query(
            filters.filter, held, tuple(tags.tags),
            tags.filter_mode == self._messages.TagsFilter.FILTER_MODE_ALL, region)

    def _fill(self, state: Any, view: View, body: int) -> Any:
        header, snapshot = state.header, view.snapshot
        header.frame_id = self._frame_id
        header.stamp.sec, header.stamp.nanosec = divmod(view.time, NANOSECONDS)
        for field, names, values in (
            (state.pose.position, 'xyz', snapshot.position),
            (state.pose.orientation, 'xyzw', snapshot.orientation),
            (state.twist.linear, 'xyz', snapshot.linear_velocity),
            (state.twist.angular, 'xyz', snapshot.angular_velocity),
        ):
            for name, value in zip(names, values[body], strict=True):
                setattr(field, name, float(value))
        for field in (state.acceleration.linear, state.acceleration.angular):
            field.x = field.y = field.z = float('nan')
        return state


def _numbers(field: Any, names: str) -> list[float]:
    return [float(getattr(field, name)) for name in names]
