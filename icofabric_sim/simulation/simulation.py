# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A compiled scene that advances in time."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
import logging
import subprocess
from typing import NoReturn, TYPE_CHECKING

from icofabric_sim import checks
from icofabric_sim.checks import counted, renamed_attributes
from icofabric_sim.parameters.table import ROTATIONS
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.process.interrupts import DeferredInterrupt
from icofabric_sim.scene.initial import hold_still, InitialState
from icofabric_sim.scene.scene import require_scene, Scene
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.errors import Interrupted, SimulationError
from icofabric_sim.simulation.event_loop import EventLoop
from icofabric_sim.simulation.inputs.given_state import complete_state
from icofabric_sim.simulation.inputs.input_types import (
    BodyTarget,
    ChannelTarget,
    DriveTarget,
    PlaneTarget,
    Pull,
    PullTarget,
    require_target,
    Target,
    Twist,
    Value,
    Vector,
    Wrench,
)
from icofabric_sim.simulation.model.body_force import as_body_force, BodyForce, Force
from icofabric_sim.simulation.model.expression_force import with_expressions
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.precompile import (
    compile_ahead,
    ContactKernels,
    kinds_of_steps,
    MAX_BODY_COUNT,
    may_compile_elsewhere,
)
from icofabric_sim.simulation.reports.load_cells import (
    ContactForces,
    LoadCells,
    Reactions,
    tensions_of,
)
from icofabric_sim.simulation.reports.status import SimulationStatus
from icofabric_sim.simulation.stepping.driver import Driver
from icofabric_sim.simulation.stepping.ledger import EnergyBalance
from icofabric_sim.simulation.stepping.trajectory import Trajectory
import numpy as np

if TYPE_CHECKING:
    from icofabric_sim.simulation.devices.ranks import Ranks

__all__ = ['compile_scene', 'Interrupted', 'Simulation', 'SimulationError']

_LOGGER = logging.getLogger('icofabric_sim')
_REMEDY_TEXT = 'compile_scene(scene) makes one'
# Force of an input that ends a step.
_FORCE_N = (1e-6, 0.0, 0.0)


def compile_scene(
    scene: Scene, *, rotation: str | None = None,
    body_force: BodyForce | Force | None = None, ranks: 'Ranks | None' = None
) -> 'Simulation':
    """
    Compile a scene into a simulation at its initial state.

    Parameters
    ----------
    scene
        The scene.
    rotation
        Equations of rotation, instead of `solver.rotation` of the scene: 'quaternion' (eqs 21-27,
        10 N equations) or 'direction_cosines' (eqs 16-20, 15 N).
    body_force
        A BodyForce, or a Python function for one, that acts on all bodies in addition to the
        forces of the scene.
    ranks
        MPI processes that share the bodies of the scene.

    Returns
    -------
    Simulation
        Simulation at time 0, ready to run.

    Raises
    ------
    ParameterError
        A ValueError: `solver.step` is beyond the stability limit, or `ranks` or `solver.device` do
        not support a parameter, which the message names.
    """
    return Simulation(scene, rotation=rotation, body_force=body_force, ranks=ranks)


def use_all_kernels(simulation: 'Simulation') -> None:
    """
    Call every kernel of a run: steps, steps that end at an input, and reports.

    The `simulation` advances by half a step.
    """
    simulation.warm_up()
    begin, step = simulation.time, simulation.status.step
    simulation.advance_to(begin + 0.25 * step)
    for body in reversed(range(simulation.scene.body_count)):
        # A body that no drive moves.
        with suppress(ValueError):
            simulation.apply_body_wrench(body, force=_FORCE_N)
            break
    simulation.advance_to(begin + 0.5 * step)
    simulation.status.fastest_place()
    snapshot = simulation.snapshot()
    # Computed for their kernels.
    _ = snapshot.energy, snapshot.obstructed, simulation.balance


def measure_forces(scene: Scene, rotation: str | None = None) -> None:
    """Measure the reactions in the initial state of a scene, to load or compile the kernels."""
    Simulation(scene.with_changes({'solver.threads': 1}), rotation=rotation).reactions()


@renamed_attributes(take_over='continue_from', break_like='copy_breaks')
class Simulation:
    """Motion of one scene from its initial state; only one thread may use it at a time."""

    def __init__(
        self, scene: Scene, *, rotation: str | None = None,
        body_force: BodyForce | Force | None = None, ranks: 'Ranks | None' = None
    ) -> None:
        """Compile a scene, see `compile_scene`."""
        require_scene(scene)
        rotation = str(scene.parameters['solver.rotation']) if rotation is None else rotation
        checks.choice('rotation', rotation, ROTATIONS)
        cosines = rotation == 'direction_cosines'
        # Of the caller, without loads by expressions of the scene.
        self.body_force = as_body_force(body_force)
        force = with_expressions(scene, self.body_force)
        if cosines and force is not None:
            raise ParameterError(
                'solver.rotation',
                f"{force.label} is given quaternions: solver.rotation must be 'quaternion', got "
                f'{rotation!r}')
        transport = None
        if ranks is not None:
            # Imported here, because most simulations do not need it.
            from icofabric_sim.simulation.devices.ranks import transport_for
            transport = transport_for(
                ranks, scene, cosines=cosines, body_force=body_force is not None)
        device = None
        if scene.parameters['solver.device'] != 'cpu':
            # Imported here, too.
            from icofabric_sim.simulation.devices.refusals import require_on_device
            require_on_device(
                scene, cosines=cosines, body_force=body_force is not None,
                shared=transport is not None)
            from icofabric_sim.simulation.devices.gpu.opening import open_device
            device = open_device(scene.parameters['solver.device'])
        self.scene, self.rotation = scene, rotation
        self.ranks = ranks  # also shared by a scene that follows this one
        self.packed = pack_scene(scene, cosines=cosines, body_force=force)
        self._deferred = DeferredInterrupt()
        # Called every 25 to 50 ms of computing; True ends the advance with Interrupted.
        self.should_stop: Callable[[], bool] | None = None
        self._event_loop = EventLoop(
            scene, self.packed, on_pause=self._pause, ranks=transport, device=device)
        # Inputs that act now or later. A validated input of `inputs.put` acts in the next advance
        # that reaches its time, which may be the present one.
        self.inputs = self._event_loop.inputs
        self._status = SimulationStatus(self._event_loop, self.packed)
        # Kernels of the first contact, once requested.
        self.contact_kernels: ContactKernels | None = None
        self._lacks_kernels = False
        self._cached: Snapshot | None = None
        self._cached_at = 0
        self._cells: LoadCells | None = None

    def __repr__(self) -> str:
        """Return time, size, method and step in words."""
        return (f'<Simulation at t = {self.time:.9g} s: {counted(self.scene.body_count, "body")}, '
                f'{counted(self.scene.connector_count, "connector")}, {self.status.method_name}, '
                f'steps of {self.status.step:.6g} s>')

    def __reduce__(self) -> NoReturn:
        """Raise TypeError: a simulation cannot be pickled or copied."""
        raise TypeError(
            'a Simulation cannot be pickled or copied: its compiled code and threads belong to '
            'this process; a Checkpoint can: simulation.checkpoint() makes one, and restore() of '
            'another compile_scene(scene) continues from it')

    @property
    def _driver(self) -> Driver:
        return self._event_loop.driver

    @property
    def _trajectory(self) -> Trajectory:
        return self._event_loop.driver.trajectory

    @property
    def time(self) -> float:
        """Simulated time [s], as last requested."""
        return self._event_loop.time

    @property
    def status(self) -> SimulationStatus:
        """Status of the run: method, step, errors, contacts, breaks, loads."""
        return self._status

    @property
    def error_estimate(self) -> float:
        """Estimated error since the start, without amplification: position over a, or rad."""
        return self._status.error_estimate

    @property
    def balance(self) -> EnergyBalance:
        """Energy balance at the health checks."""
        return self._status.balance

    def advance_to(self, time: float) -> None:
        """
        Advance to a time; several calls give the bits of a single one.

        Parameters
        ----------
        time
            Simulated time [s], not before the present one.

        Raises
        ------
        ValueError
            The time is in the past.
        SimulationError
            The run failed; the simulation is at the last sound state.
        Interrupted
            `should_stop` returned True.
        """
        time = checks.number('time', time, unit='s')
        if time < self.time:
            raise ValueError(
                f'time must not be in the past: cannot advance to {time!r} s from {self.time!r} s'
                '; reset_time() goes back to the start')
        with self._deferred:
            self._event_loop.advance(time)

    def advance_steps(self, count: int) -> int:
        """
        Take solver steps; an input that acts in between ends a step, which counts as one.

        Parameters
        ----------
        count
            Number of steps.

        Returns
        -------
        int
            Number of steps taken: more than `count` if the last one had to be repeated.
        """
        count = checks.count('count', count, 1)
        with self._deferred:
            self._event_loop.settle_inputs()
            before = self._status.step_count
            goal = before + count
            while self._status.step_count < goal:
                self._event_loop.take_step(goal - self._status.step_count, self._pause)
            return self._status.step_count - before

    def snapshot(self) -> Snapshot:
        """Return a copy of the state at the present time."""
        if self._cached is None or self._cached_at != self._event_loop.changes:
            there = self._event_loop.state()
            state, rest = self.packed.layout.unpack(there), self.packed.rest_lengths(there)
            for array in state if rest is None else (*state, rest):
                array.flags.writeable = False
            self._cached = Snapshot(
                self.time, *state, self.scene.connector_count, self.packed,
                self._energy_terms(state), self._trajectory.broken.since, self._anchors(),
                None if self.inputs.anchor_breaks is None else (
                    self.inputs.anchor_breaks.since.copy()), rest)
            self._cached_at = self._event_loop.changes
        return self._cached

    def reactions(self) -> Reactions:
        """Return the reactions of supports, drives, anchors and planes at the present time."""
        with self._deferred:
            state = self._event_loop.state()
            return self._load_cells.reactions(
                self._driver, state, self.time, self.inputs.anchor_points(self.time),
                self.inputs.plane_displacements(self.time))

    def contacts(self) -> ContactForces:
        """Return the contacts at the present time: points and forces, damping and friction too."""
        with self._deferred:
            return self._load_cells.contacts(self._driver, self._event_loop.state())

    def tensions(self) -> np.ndarray:
        """
        Return the forces [N] along the connectors at the present time, (c,), positive in tension.

        Sums of their laws and dampers, without bending and twisting moments. Broken connectors
        have 0, damped ones that are wrapped over a shell NaN.

        Returns
        -------
        ndarray
            Tensions (c,) [N].
        """
        return tensions_of(self.scene, self.snapshot())

    @property
    def _load_cells(self) -> LoadCells:
        if self._cells is None:
            self._cells = LoadCells(self.scene, self.packed)
        return self._cells

    def apply_wrench(
        self,
        channel: str,
        force: Vector = (0.0, 0.0, 0.0),
        torque: Vector = (0.0, 0.0, 0.0),
        *,
        time: float | None = None,
    ) -> float:
        """
        Apply a wrench to a load channel, until another one replaces it.

        Parameters
        ----------
        channel
            NAME of `loads.NAME.*`, which define frame, point, share and hold time.
        force
            Force [N], (3,).
        torque
            Torque [N m], (3,).
        time
            Start [s], not in the past; None: the present time.

        Returns
        -------
        float
            Time [s] at which the wrench starts to act.
        """
        target = ChannelTarget(checks.text('channel', channel))
        return self._apply(target, Wrench.checked(force, torque), time)

    def apply_body_wrench(
        self,
        body: int,
        force: Vector = (0.0, 0.0, 0.0),
        torque: Vector = (0.0, 0.0, 0.0),
        *,
        time: float | None = None,
    ) -> float:
        """
        Apply a wrench to one body, until another one replaces it; zero removes it.

        Parameters
        ----------
        body
            Index of the body, 0 to n - 1.
        force
            Force [N], (3,), body axes, at the centre.
        torque
            Torque [N m], (3,), body axes.
        time
            Start [s], not in the past; None: the present time.

        Returns
        -------
        float
            Time [s] at which the wrench starts to act.
        """
        target = BodyTarget(checks.count('body', body, 0, self.scene.body_count - 1))
        return self._apply(target, Wrench.checked(force, torque), time)

    def apply_twist(
        self,
        drive: str,
        linear: Vector = (0.0, 0.0, 0.0),
        angular: Vector = (0.0, 0.0, 0.0),
        *,
        time: float | None = None,
    ) -> float:
        """
        Move the bodies of a drive as one rigid body, until another twist or a reset.

        Parameters
        ----------
        drive
            NAME of `drives.NAME.*`.
        linear
            Velocity of the mean position of its bodies [m/s], (3,), world axes.
        angular
            Angular velocity about the mean position [rad/s], (3,), world axes.
        time
            Start [s], not in the past; None: the present time.

        Returns
        -------
        float
            Time [s] at which the twist starts to act.
        """
        target = DriveTarget(checks.text('drive', drive))
        return self._apply(target, Twist.checked(linear, angular), time)

    def move_plane(self, plane: str, linear: Vector, *, time: float | None = None) -> float:
        """
        Move a plane with a constant velocity, until another one or a reset.

        Parameters
        ----------
        plane
            NAME of `planes.NAME.*`, whose motion is not `fixed`.
        linear
            Velocity [m/s], (3,), world axes.
        time
            Start [s], not in the past; None: the present time.

        Returns
        -------
        float
            Time [s] at which the motion starts.
        """
        target = PlaneTarget(checks.text('plane', plane))
        return self._apply(target, Twist.checked(linear, np.zeros(3)), time)

    def pull(self, body: int, point: Vector) -> None:
        """
        Pull a body towards a point by a spring with limited force and a damper.

        Acts until `release` or a reset; a second call moves the point. The law, in
        simulation/inputs/pulls.py, is scaled to the fabric and by `pull.strength`.

        Parameters
        ----------
        body
            Index of the body, 0 to n - 1.
        point
            Target of its centre [m], (3,), world frame.
        """
        target = PullTarget(checks.count('body', body, 0, self.scene.body_count - 1))
        self._apply(target, Pull(checks.array('point', point, (3,))), None)

    def release(self, body: int) -> None:
        """
        End the pull of a body, if any.

        Parameters
        ----------
        body
            Index of the body, 0 to n - 1.
        """
        target = PullTarget(checks.count('body', body, 0, self.scene.body_count - 1))
        self._apply(target, Pull(np.full(3, np.nan)), None)

    def set_state(
        self,
        *,
        position: np.ndarray | None = None,
        orientation: np.ndarray | None = None,
        linear_velocity: np.ndarray | None = None,
        angular_velocity: np.ndarray | None = None,
        relaxed: bool = False,
    ) -> None:
        """
        Replace parts of the state at the present time; broken connectors stay broken.

        Parameters
        ----------
        position
            Centres [m], (n, 3), world frame. None, here and below: unchanged.
        orientation
            Unit quaternions x, y, z, w, (n, 4), from body to world axes.
        linear_velocity
            Velocities [m/s], (n, 3), world frame.
        angular_velocity
            Angular velocities [rad/s], (n, 3), world frame.
        relaxed
            True: Maxwell arms carry no force at this state. False: their dashpots keep their
            lengths.
        """
        snapshot, relaxed = self.snapshot(), checks.flag('relaxed', relaxed)
        state = complete_state(snapshot, {
            'position': position, 'orientation': orientation, 'linear_velocity': linear_velocity,
            'angular_velocity': angular_velocity}, self.scene.geometry.half_edge)
        self._jump(
            hold_still(state, self.scene.supports), None if relaxed else snapshot.rest_length)

    def reset(self, *, time: float | None = None) -> None:
        """
        Return to the initial state, with all connectors whole and without received wrenches.

        Parameters
        ----------
        time
            Simulated time [s] at which the motion restarts, not in the past; None: the present
            time, which after a failure is that of the last sound state.
        """
        if time is not None:
            time = checks.number('time', time, unit='s')
            if time < self.time:
                raise ValueError(
                    f'time must not be in the past: a reset cannot be at {time!r} s, the time is '
                    f'{self.time!r} s; reset_time() goes back to the start')
            self._event_loop.time = time
        self.inputs.reset(self._event_loop.time)
        self._trajectory.broken.mend()
        self._jump(self.scene.initial)

    def reset_time(self) -> None:
        """Return to the initial state and to time 0."""
        self._event_loop.time = 0.0
        self._event_loop.driver.forget()
        self.reset()

    def continue_from(self, previous: 'Simulation', *, keep_motion: bool) -> None:
        """
        Continue from the time and the wrenches of a simulation of an earlier scene.

        Parameters
        ----------
        previous
            The simulation to continue.
        keep_motion
            True: continue from its state and broken connectors, too. Maxwell arms continue where
            connectors join the same edges; others start without force. False: start from the
            initial state.

        Raises
        ------
        ValueError
            `keep_motion` with another number of bodies.
        """
        checks.instance('previous', previous, Simulation, _REMEDY_TEXT)
        keep_motion = checks.flag('keep_motion', keep_motion)
        if keep_motion and previous.scene.body_count != self.scene.body_count:
            raise ValueError(
                f'the motion of {previous.scene.body_count} bodies cannot continue with '
                f'{self.scene.body_count}'
            )
        self.inputs.adopt(previous.inputs, previous.time, anew=not keep_motion)
        if keep_motion:
            # The same motion: warnings are not repeated.
            self._driver.contact.phase.take_over(previous.status.proximity)
            self._trajectory.broken.adopt(previous._trajectory.broken)
            obstruction = self._driver.monitor.obstruction
            if not obstruction.stops:
                obstruction.found = previous.status.obstruction
            self._event_loop.time = previous.time
            snapshot = previous.snapshot()
            state = _as_initial(snapshot, self.scene)
            self._jump(state, self.packed.carry(previous.packed, snapshot.rest_length, state))
            self._driver.adopt(previous._driver)
        else:
            self._event_loop.begin_at(previous.time)

    def copy_breaks(self, other: 'Simulation') -> None:
        """
        Break the connectors and anchors that are broken in another simulation; repair all others.

        Parameters
        ----------
        other
            A simulation of the same fabric.
        """
        checks.instance('other', other, Simulation, _REMEDY_TEXT)
        if other.scene.connector_count != self.scene.connector_count:
            raise ValueError(
                f'other must be a simulation of the same fabric: it has '
                f'{other.scene.connector_count} connectors, this one '
                f'{self.scene.connector_count}')
        self._trajectory.broken.mend()
        self._trajectory.broken.adopt(other._trajectory.broken)
        if self.inputs.anchor_breaks is not None:
            self.inputs.anchor_breaks.mend()
            self.inputs.anchor_breaks.adopt(other.inputs.anchor_breaks)
            self._event_loop.renew_loads()
        self._event_loop.changes += 1

    def warm_up(self) -> None:
        """
        Compile or load every kernel that a step needs, without taking a step.

        Another process compiles kernels that contacts and inputs may need later.
        """
        self._event_loop.settle_loads()
        self._driver.warm_up()
        # For a larger scene, another process and this check would need as much memory again.
        self._lacks_kernels = (
            self.scene.body_count <= MAX_BODY_COUNT and not self._is_elsewhere
            and not self._event_loop.is_ready())
        if self.body_force is None and self._lacks_kernels:
            self._compile_ahead()

    def prepare_contacts(self, *, load: bool = True) -> ContactKernels | None:
        """
        Compile the kernels of the first contact in another process, never in the run itself.

        Call it after `warm_up`. Until these kernels are ready, an advance that needs them raises
        KernelsAwaited.

        Parameters
        ----------
        load
            True: load kernels from disk, too, and those of reports.

        Returns
        -------
        ContactKernels or None
            None if nothing is to be compiled, no process can compile it, or the scene has a body
            force, ranks or a device. The first contact then compiles what it needs.
        """
        load = checks.flag('load', load)
        if self._is_elsewhere or self.body_force is not None:
            return None
        if self.contact_kernels is None and (
                self._lacks_kernels or load and self.scene.body_count <= MAX_BODY_COUNT):
            if self._lacks_kernels and not may_compile_elsewhere(self.scene):
                return None
            process = self._compile_ahead() if self._lacks_kernels else None
            contact = self._driver.contact
            may_touch = contact.phase.is_possible and contact.phase.contacts is None
            self._driver.awaits_kernels = self._lacks_kernels or may_touch
            self.contact_kernels = ContactKernels(
                process, self._compile_ahead, partial(self._load_kernels, may_touch),
                lambda: self._driver.await_no_kernels())
        return self.contact_kernels

    @property
    def _is_elsewhere(self) -> bool:
        """True if ranks or a device take the steps."""
        return self._trajectory.executor.is_remote

    def _compile_ahead(self) -> subprocess.Popen[bytes] | None:
        return compile_ahead(
            self.scene, method=self._event_loop.touching_method,
            present=self._status.method_name, rotation=self.rotation)

    def _load_kernels(self, may_touch: bool) -> None:
        """Call all kernels by simulations with the same kernel variants."""
        kinds = kinds_of_steps(
            self._event_loop.touching_method, present=self._status.method_name,
            may_touch=may_touch)
        # The run has called most kernels of the first variant and loads the others quickly.
        for changes in kinds[1:] or kinds:
            use_all_kernels(Simulation(
                self.scene.with_changes(changes) if changes else self.scene,
                rotation=self.rotation))

    def checkpoint(self) -> Checkpoint:
        """Return a checkpoint of the present time; the run is unchanged."""
        with self._deferred:
            return Checkpoint.of(self, self._event_loop.state_tree())

    def restore(self, checkpoint: Checkpoint) -> None:
        """
        Continue from a checkpoint of the same scene, bit-identical to the run that made it.

        That run may have had other numbers of threads, rates or bags. With another processor or
        other libraries, the last bits may differ; a warning is logged.

        Parameters
        ----------
        checkpoint
            From `checkpoint()` or `Checkpoint.load`.

        Raises
        ------
        ValueError
            The checkpoint is damaged or of another scene; nothing has changed.
        """
        checks.instance(
            'checkpoint', checkpoint, Checkpoint,
            'simulation.checkpoint() makes one, Checkpoint.load(path) reads one')
        before, time = self._event_loop.state_tree(), self.time
        method = self._status.method_name
        with self._deferred:
            fits = False
            try:
                # Another method may have been active at the time of the checkpoint.
                self._event_loop.take_method(str(checkpoint.header['method']))
                checkpoint.require_fit(self)
                fits = True
                self._event_loop.load_state(checkpoint.state_tree(), checkpoint.time)
            except BaseException as error:
                self._event_loop.take_method(method)
                self._event_loop.load_state(StateTree(before), time)
                if not fits or not isinstance(error, ValueError):
                    raise
                raise ValueError(
                    f'the checkpoint is damaged, nothing was restored: {error}') from error
        unlike = checkpoint.unlike_machine()
        if unlike:
            _LOGGER.warning(
                'the checkpoint of t = %.9g s was made on another machine, so the last bits of '
                'this run may differ from those of the original run: %s', self.time, unlike)

    def _anchors(self) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        anchors = self.scene.anchors.values()
        if not anchors:
            return None
        return (
            np.array([anchor.body for anchor in anchors]),
            np.array([anchor.arm for anchor in anchors]), self.inputs.anchor_points(self.time))

    def _apply(self, target: Target, value: Value, time: float | None) -> float:
        require_target(self.scene, target)
        at = self.time if time is None else checks.number('time', time, unit='s')
        if at < self.time:
            raise ValueError(
                f'time must not be in the past: {" and ".join(value._fields)} cannot act at '
                f'{at!r} s, the time is {self.time!r} s')
        with self._deferred:
            self._event_loop.apply(target, value, at)
        return at

    def _energy_terms(self, state: InitialState) -> dict[str, float]:
        """Return the energies and works [J] that the balance of a snapshot needs."""
        shown, ledger, force = (
            self._driver.shown, self._trajectory.ledger, self.packed.body_force)
        terms = {
            'work_in': shown.work, 'spent': shown.spent, 'start': ledger.base,
            'lost_at_breaks': ledger.lost, 'potential': 0.0,
            'anchors': shown.anchors, 'contact': shown.contact}
        if force is not None and force.potential is not None:
            terms['potential'] = force.energy(self.time, state.position, state.orientation)
            terms['start'] += shown.potential_start
        else:
            terms['work_in'] += shown.given
        return terms

    def _jump(self, state: InitialState, rest: np.ndarray | None = None) -> None:
        with self._deferred:
            self._event_loop.jump(state, rest)

    def _pause(self) -> None:
        self._deferred.check()
        if self.should_stop is not None and self.should_stop():
            raise Interrupted


def _as_initial(snapshot: Snapshot, scene: Scene) -> InitialState:
    velocity, spin = snapshot.linear_velocity.copy(), snapshot.angular_velocity.copy()
    state = InitialState(snapshot.position, snapshot.orientation, velocity, spin)
    return hold_still(state, scene.supports)
