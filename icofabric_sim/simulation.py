# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
A compiled scene that advances in time.
"""

from collections.abc import Callable, Sequence
import math
import operator

from icofabric_sim.adaptive_stepper import AdaptiveStepper
from icofabric_sim.crew import Crew
from icofabric_sim.faults import too_fast
from icofabric_sim.icosahedron import inscribed_radius
from icofabric_sim.initial import hold_still, InitialState
from icofabric_sim.inputs import Inputs, Key, Wrench
from icofabric_sim.integrators.automatic import choose_method
from icofabric_sim.integrators.methods import METHODS
from icofabric_sim.interrupts import DeferredInterrupt
from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.records import Loads
from icofabric_sim.ledger import EnergyBalance
from icofabric_sim.model import expected_liveliness, load_rate, pack_scene
from icofabric_sim.proximity import Proximity, ProximityWatch
from icofabric_sim.scene import Scene
from icofabric_sim.snapshot import Snapshot
from icofabric_sim.stability import largest_frequency
from icofabric_sim.stepper import SimulationError, Stepper
import numpy as np

__all__ = ['compile_scene', 'Interrupted', 'Simulation', 'SimulationError']

Vector = Sequence[float] | np.ndarray


def compile_scene(
    scene: Scene, *, rotation: str = 'quaternion', body_wrenches: bool = False
) -> 'Simulation':
    """
    Turn a scene into something fast, once.

    `rotation` chooses the formulation: 'quaternion' (eqs 21-27, 10 N) or 'direction_cosines'
    (eqs 16-20, 15 N). `body_wrenches` prepares for wrenches on single bodies, so that the first
    one need not wait for a kernel.
    Raises ValueError where `solver.step` is beyond the stability limit.
    """
    return Simulation(scene, rotation=rotation, body_wrenches=body_wrenches)


class Interrupted(Exception):
    """
    `should_stop` ended an advance; the simulation stands at a step end and can go on.
    """


class Simulation:
    """
    Motion of one scene from its initial state on; not for use by several threads at once.
    """

    def __init__(
        self, scene: Scene, *, rotation: str = 'quaternion', body_wrenches: bool = False
    ) -> None:
        """
        See `compile_scene`.
        """
        if rotation not in ('quaternion', 'direction_cosines'):
            raise ValueError(
                f"rotation must be 'quaternion' or 'direction_cosines', got {rotation!r}"
            )
        self.scene = scene
        self.packed = pack_scene(scene, cosines=rotation == 'direction_cosines')
        self._body_wrenches = body_wrenches
        self._time = 0.0
        self._inputs = Inputs(scene)
        self._size = scene.geometry.cube_width
        self._stale_loads = False
        self._deferred = DeferredInterrupt()
        # Asked every 25 to 50 ms of computing; True ends the advance with Interrupted.
        self.should_stop: Callable[[], bool] | None = None
        watch = None
        if scene.parameters['contact.mode'] != 'never':
            watch = ProximityWatch(
                2.0 * inscribed_radius(scene.geometry.half_edge), self.packed.layout)
        loads = self._loads()
        state = self.packed.layout.pack(scene.initial)
        frequency = largest_frequency(self.packed, state)
        if not frequency.rate < math.inf:
            raise ValueError(f'this scene cannot start: {too_fast(self._time)}')
        # Name of the method in METHODS, and why it was chosen.
        self.method_name = scene.parameters['solver.method']
        self.method_reason = 'given as solver.method'
        if self.method_name == 'auto':
            fixed = scene.parameters['solver.step']
            self.method_name, self.method_reason = choose_method(
                scene.parameters['solver.tolerance'],
                expected_liveliness(scene, self.packed.model, loads, frequency.rate),
                fixed_ratio=fixed * frequency.rate if fixed > 0.0 else None)
        try:
            method = METHODS[self.method_name]
            adaptive = method.adaptive and not scene.parameters['solver.step'] > 0.0
            self._stepper = (AdaptiveStepper if adaptive else Stepper)(
                self.packed,
                method,
                state,
                loads,
                frequency,
                origin=self._time,
                fixed_step=scene.parameters['solver.step'],
                tolerance=scene.parameters['solver.tolerance'],
                energy_limit=scene.parameters['solver.energy_limit'],
                load_rate=self._load_rate(loads),
                half_edge=scene.geometry.half_edge,
                crew=Crew(scene.parameters['solver.threads'], self.packed),
                watch=watch,
                on_pause=self._pause,
            )
        except SimulationError as error:
            raise ValueError(f'this scene cannot start: {error}') from error
        self._cached: Snapshot | None = None

    @property
    def time(self) -> float:
        """
        Simulated time [s] that was asked for last.
        """
        return self._time

    @property
    def step(self) -> float:
        """
        Step [s] in use.
        """
        return self._stepper.step

    @property
    def step_count(self) -> int:
        """
        Steps taken so far.
        """
        return self._stepper.step_count

    @property
    def largest_frequency(self) -> float:
        """
        Largest frequency [rad/s] of the fabric in the configuration looked at last.
        """
        return self._stepper.frequency.rate

    @property
    def stability_limit(self) -> float:
        """
        Longest stable step [s] in that configuration.
        """
        return self._stepper.limit

    @property
    def error_rate(self) -> float:
        """
        Error that the method adds for each second, measured last: position over a, or rad.
        """
        return self._stepper.error_rate()

    @property
    def error_estimate(self) -> float:
        """
        Errors added since the start, as if none of them had grown: position over a, or rad.
        """
        return self._stepper.error_estimate()

    @property
    def balance(self) -> EnergyBalance:
        """
        How well the energy balanced when it was looked at.
        """
        return self._stepper.ledger.balance

    @property
    def thread_count(self) -> int:
        """
        Threads that share a step.
        """
        return self._stepper.crew.size

    @property
    def proximity(self) -> Proximity | None:
        """
        The first two bodies that came closer than their shells allow, if any.
        """
        watch = self._stepper.watch
        return None if watch is None else watch.found

    @property
    def active_loads(self) -> dict[Key, Wrench]:
        """
        Wrenches that act now, by channel name or body number.
        """
        return dict(self._inputs.active)

    def advance_to(self, time: float) -> None:
        """
        Advance to `time` [s]; in pieces it gives the same bits as in one go.
        """
        if not self._time <= time < math.inf:
            raise ValueError(
                f'cannot advance to {time!r} s from {self._time!r} s: times must be finite and '
                'not in the past; reset_time() goes back to the start'
            )
        with self._deferred:
            self._handle_events(time)
            self._reach(time)

    def advance_steps(self, count: int) -> None:
        """
        Take `count` solver steps; an input that acts in between ends a step, which counts.
        """
        count = operator.index(count)
        if not count >= 1:
            raise ValueError(f'count must be at least 1 step, got {count!r}')
        goal = self.step_count + count
        with self._deferred:
            while self.step_count < goal:
                queue = self._inputs.queue
                due = queue[0].time if queue else math.inf
                self._settle_loads()
                try:
                    done = self._stepper.advance_steps(goal - self.step_count, until=due)
                    self._pause()
                except SimulationError:
                    self._time = -math.inf  # the last good state may be older
                    raise
                finally:
                    self._time = max(self._time, self._stepper.time)
                    self._cached = None
                if done == 0:
                    self._handle_events(due)

    def snapshot(self) -> Snapshot:
        """
        Copy of the state at the present time.
        """
        if self._cached is None:
            state = self.packed.layout.unpack(self._stepper.state_at(self._time))
            for array in state:
                array.flags.writeable = False
            self._cached = Snapshot(
                self._time, *state, self.scene.connector_count, self.packed,
                {'work_in': self._stepper.work_at_state(),
                 'start': self._stepper.ledger[monitor.BASE]})
        return self._cached

    def apply_wrench(
        self,
        channel: str,
        force: Vector = (0.0, 0.0, 0.0),
        torque: Vector = (0.0, 0.0, 0.0),
        *,
        time: float | None = None,
    ) -> float:
        """
        Put a wrench [N], [N m] on the load channel `channel`, from now or a later `time` [s] on.

        Frame, point, share and hold time are the channel's (`loads.NAME.*`). Returns the time from
        which it acts.
        """
        if channel not in self.scene.loads:
            known = ', '.join(self.scene.loads) or 'none'
            raise ValueError(
                f'there is no load channel {channel!r}; known: {known}. Define it with '
                f'loads.{channel}.group'
            )
        return self._apply(channel, force, torque, time)

    def apply_body_wrench(
        self,
        body: int,
        force: Vector = (0.0, 0.0, 0.0),
        torque: Vector = (0.0, 0.0, 0.0),
        *,
        time: float | None = None,
    ) -> float:
        """
        Put a wrench [N], [N m] on one body, on its own axes as they turn, about its centre.

        Held until replaced; zero clears. Returns the time from which it acts.
        """
        body = operator.index(body)
        if not 0 <= body < self.scene.body_count:
            raise ValueError(
                f'there is no body {body}; bodies are 0 to {self.scene.body_count - 1}'
            )
        self._body_wrenches = True
        return self._apply(body, force, torque, time)

    def set_state(
        self,
        *,
        position: np.ndarray | None = None,
        orientation: np.ndarray | None = None,
        linear_velocity: np.ndarray | None = None,
        angular_velocity: np.ndarray | None = None,
    ) -> None:
        """
        Replace parts of the state at the present time; (n, 3) and (n, 4), world frame, SI units.
        """
        now = self.snapshot()
        count = self.scene.body_count
        values = []
        for name, given, width in (
            ('position', position, 3),
            ('orientation', orientation, 4),
            ('linear_velocity', linear_velocity, 3),
            ('angular_velocity', angular_velocity, 3),
        ):
            array = np.array(getattr(now, name) if given is None else given, dtype=float)
            if array.shape != (count, width):
                raise ValueError(
                    f'{name} must have the shape ({count}, {width}), got {array.shape}'
                )
            if not np.isfinite(array).all():
                body = int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
                raise ValueError(f'{name} of body {body} is not finite: {array[body]}')
            values.append(array)
        length = np.linalg.norm(values[1], axis=1, keepdims=True)
        if not (abs(length - 1.0) <= 1e-3).all():
            body = int(np.argmax(abs(length - 1.0)))
            raise ValueError(
                f'orientation of body {body} is not a unit quaternion: {values[1][body]}'
            )
        values[1] = np.where(abs(length - 1.0) <= 4e-16, values[1], values[1] / length)
        self._jump(hold_still(InitialState(*values), self.scene.supports))

    def reset(self) -> None:
        """
        Go back to the initial state; the time runs on, and all received wrenches are forgotten.
        """
        self._inputs.reset()
        self._jump(self.scene.initial)

    def reset_time(self) -> None:
        """
        Go back to the initial state and to time 0.
        """
        self._time = 0.0
        self.reset()

    def take_over(self, previous: 'Simulation', *, keep_motion: bool) -> None:
        """
        Go on where a run of an earlier scene stands: its time, and its wrenches where they fit.

        With `keep_motion` also its state, which needs the same number of bodies; else from the
        initial state.
        """
        if keep_motion and previous.scene.body_count != self.scene.body_count:
            raise ValueError(
                f'the motion of {previous.scene.body_count} bodies cannot go on with '
                f'{self.scene.body_count}'
            )
        self._time = previous.time
        self._inputs.adopt(previous._inputs)
        if keep_motion:
            if self._stepper.watch is not None:
                # The same motion: what was said once is not said again.
                self._stepper.watch.take_over(previous.proximity)
            self._jump(_as_initial(previous.snapshot(), self.scene))
        else:
            self._stepper.rebase(self._time)
            self._stale_loads = True
            self._settle_loads()
            self._cached = None

    def warm_up(self) -> None:
        """
        Make every kernel that a step needs ready, without taking one.
        """
        self._settle_loads()
        self._stepper.state_at(self._stepper.time + 0.5 * self._stepper.step)

    @property
    def next_step_time(self) -> float:
        """
        Time [s] at which the step in progress ends, unless an input ends it before.
        """
        return self._stepper.next_step_time

    def _apply(self, key: Key, force: Vector, torque: Vector, time: float | None) -> float:
        wrench = Wrench(
            *(_vector(name, value) for name, value in (('force', force), ('torque', torque)))
        )
        at = self._time if time is None else float(time)
        if not self._time <= at < math.inf:
            raise ValueError(f'a wrench cannot act at {at!r} s: the time is {self._time!r} s')
        self._inputs.schedule(at, key, wrench)
        if at == self._time:
            with self._deferred:
                self._handle_events(at)
        return at

    def _handle_events(self, until: float) -> None:
        queue = self._inputs.queue
        while queue and queue[0].time <= until:
            # Reached before it is taken out: an interrupt on the way loses nothing.
            time = queue[0].time
            self._reach(time)
            event = self._inputs.take()
            if self._inputs.apply(event):
                self._settle_loads_before(time)
                self._stepper.cut(time)
                self._stale_loads = True
                self._cached = None

    def _reach(self, time: float) -> None:
        try:
            self._settle_loads_before(time)
            self._stepper.advance(time)
        except SimulationError:
            # The last good state may be older than what was seen of the run.
            self._time = self._stepper.time
            self._cached = None
            raise
        except BaseException:
            self._time = max(self._time, self._stepper.time)
            self._cached = None
            raise
        if time != self._time:
            self._time = time
            self._cached = None

    def _jump(self, state: InitialState) -> None:
        self._cached = None
        self._stale_loads = False
        loads = self._loads()
        with self._deferred:
            self._stepper.jump(
                self._time, self.packed.layout.pack(state), loads, self._load_rate(loads))

    def _pause(self) -> None:
        self._deferred.check()
        if self.should_stop is not None and self.should_stop():
            raise Interrupted

    def _settle_loads_before(self, time: float) -> None:
        if time > self._stepper.time:
            self._settle_loads()

    def _settle_loads(self) -> None:
        """
        Tell the stepper what acts now: once, however many wrenches have changed at this time.
        """
        if self._stale_loads:
            loads = self._loads()
            self._stale_loads = False
            self._stepper.set_loads(loads, self._load_rate(loads))

    def _load_rate(self, loads: Loads | None) -> float:
        return load_rate(loads, self.packed.model, self._size)

    def _loads(self) -> Loads | None:
        if not (self.scene.loads or self._body_wrenches):
            return None
        name = self.scene.parameters['solver.method']
        symplectic = name == 'auto' or METHODS[name].symplectic
        return self._inputs.pack(self.packed.layout, stages=0 if symplectic else 16)


def _vector(name: str, value: Vector) -> np.ndarray:
    vector = np.array(value, dtype=float)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f'{name} must be three finite numbers, got {value!r}')
    return vector


def _as_initial(snapshot: Snapshot, scene: Scene) -> InitialState:
    velocity, spin = snapshot.linear_velocity.copy(), snapshot.angular_velocity.copy()
    state = InitialState(snapshot.position, snapshot.orientation, velocity, spin)
    return hold_still(state, scene.supports)
