# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Random scenes in other programs, judged by windows with reference runs of this project.

The programs run scenes of springs, gravity, supports and loads of all profiles; MuJoCo also runs
dampers along the springs. They have no tolerance, so the step is the one with which the method
keeps the tolerance of the scene on an oscillation, or the given step. A step ends where a load
jumps. The programs report no errors, so an error of more than three times the promise is silently
wrong.
"""

from functools import partial
from importlib.util import find_spec
import math
from typing import Any, Final, NamedTuple

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.errors import Interrupted, SimulationError
from icofabric_sim.simulation.inputs.inputs import Inputs
from icofabric_sim.simulation.simulation import compile_scene, Simulation
from icofabric_validation.stress import lammps_run, mujoco_run
from icofabric_validation.stress.judge import (
    classify_by_clock,
    classify_end,
    Clock,
    PROCESSOR_TIME_S,
)
from icofabric_validation.stress.kinds import KINDS
from icofabric_validation.stress.lammps_run import LammpsRun
from icofabric_validation.stress.mujoco_run import MuJoCoRun
from icofabric_validation.stress.peer_run import PeerRun
from icofabric_validation.stress.scenes import draw_scene, kind_of, StressScene
from icofabric_validation.stress.verdict import Finding, Verdict
from icofabric_validation.stress.windows import fastest_rate, run_reference, Windows
import numpy as np

# Target error as a fraction of the tolerance. Longest step over the inverse rate of the fastest
# vibration, and over the shortest damping time.
_TARGET_ERROR_RATIO, _MAX_STEP_RAD, _MAX_DAMPED_STEP_RATIO = 0.5, 0.5, 0.5
# Fractions of a step that are tried if the run stops.
_SHORTER_STEP_RATIOS = (1 / 4, 1 / 16)
# Fractions of the processor time for the windows, and for these and the run from the start.
_WINDOWS_TIME_RATIO, _ALL_RUNS_TIME_RATIO = 0.6, 0.9
# A scene is judged without windows if less than this fraction of its duration was simulated.
_MIN_SIMULATED_RATIO = 0.25
# Parameters that the programs do not support.
_UNSUPPORTED = ('masses.',)


class Peer(NamedTuple):
    """Another program, with the terms that it supports."""

    run: type[MuJoCoRun] | type[LammpsRun]
    method: str
    terms: frozenset[str]  # supported terms of kinds
    error: float  # in a radian of an oscillation, over (step times frequency)^order
    order: int
    package: str
    install: str

    @property
    def is_installed(self) -> bool:
        """True if the program can be imported."""
        return find_spec(self.package) is not None

    def can_express(self, seed: int) -> bool:
        """Return True if both programs can run the scene of a seed, and no value is spoiled."""
        if not {*KINDS[kind_of(seed)].terms} <= self.terms:
            return False
        scene = draw_scene(seed)
        return not (scene.spoiled or scene.change or any(
            name.startswith(_UNSUPPORTED) for name in scene.parameters))


PEERS: Final = {
    module.DISTRIBUTION: Peer(
        run, module.METHOD, frozenset(module.TERMS), module.ERROR, module.ORDER,
        module.DISTRIBUTION, module.INSTALL)
    for module, run in ((mujoco_run, MuJoCoRun), (lammps_run, LammpsRun))}


def judge_peer(name: str, stress: StressScene, *, seconds: float = PROCESSOR_TIME_S) -> Finding:
    """Run a scene in the program `name` within a processor time of `seconds`; classify it."""
    return classify_by_clock(stress, seconds, partial(_judge, PEERS[name]))


def _judge(
    peer: Peer, stress: StressScene, parameters: dict[str, Any], seconds: Clock
) -> Finding:
    try:
        scene = Scene.from_parameters(_without_health_checks(parameters))
        rate = fastest_rate(compile_scene(scene.with_changes({
            'solver.step': 0.0, 'solver.method': 'dop8'})))
    except ValueError as error:
        # Without a reference there is nothing to compare.
        return Finding(stress.seed, stress.kind, Verdict.REFUSED, ' '.join(str(error).split()))
    given = float(str(scene.parameters['solver.step']))
    step = given or _choose_step(peer, scene, rate)
    run = peer.run(scene, step, rate)
    windows = Windows(
        run, rate, lambda: seconds.is_over(_WINDOWS_TIME_RATIO), hand_over=_hand_over_state)
    failure = ''
    try:
        windows.follow(stress.duration)
    except SimulationError as error:
        failure = str(error)
    except Interrupted:
        if not run.time > _MIN_SIMULATED_RATIO * stress.duration:
            return _classify_alone(peer, stress, peer.run(scene, step, rate), rate, seconds)
    run.should_stop = None
    added = windows.result()
    found = Finding(
        stress.seed, stress.kind, Verdict.WITHIN, method=peer.method, bodies=scene.body_count,
        steps=run.step_count, is_given=given > 0.0, time=run.time, added=added.error,
        promised=added.promised, windows=added.windows, unjudged=added.unjudged)
    if failure:
        right = _does_shorter_step_help(peer, scene, step, rate, stress.duration)
        return found._replace(
            verdict=Verdict.STOPPED if right else Verdict.WRONGLY_STOPPED, detail=failure)
    if other := _find_bit_difference(peer, run, step, rate):
        return found._replace(verdict=Verdict.NOT_BIT_IDENTICAL, compared=True, detail=other)
    growth, distance, reason = run_reference(
        run, rate, run.time, lambda: seconds.is_over(_ALL_RUNS_TIME_RATIO))
    found = found._replace(compared=True, growth=0.0 if growth is None else growth.largest)
    verdict = classify_end(found, '', growth, distance)
    why = added.why or (reason and f'the reference run stopped: {reason}')
    if why and not verdict.is_fault:
        return verdict._replace(
            verdict=Verdict.UNJUDGED,
            detail=f'{added.unjudged} of {added.windows} windows; {why}')
    return verdict


def _classify_alone(
    peer: Peer, stress: StressScene, run: PeerRun, rate: float, seconds: Clock
) -> Finding:
    """Classify a run whose reference runs took too long."""
    clock = seconds.another()
    run.should_stop = lambda: clock.is_over(_WINDOWS_TIME_RATIO)
    verdict, words = Verdict.UNJUDGED, 'the reference run takes too long'
    try:
        run.advance_to(stress.duration)
    except SimulationError as error:
        right = _does_shorter_step_help(peer, run.scene, run.step, rate, stress.duration)
        verdict, words = (
            Verdict.STOPPED if right else Verdict.WRONGLY_STOPPED), str(error)
    except Interrupted:
        verdict, words = Verdict.SLOW, (
            f'{run.step_count} steps of {run.step:.3g} s to t = {run.time:.6g} s of '
            f'{stress.duration:.6g} s')
    return Finding(
        stress.seed, stress.kind, verdict, words, method=peer.method, bodies=run.scene.body_count,
        steps=run.step_count, time=run.time)


def _without_health_checks(parameters: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters without those of health checks, which other programs lack."""
    return {
        name: value for name, value in parameters.items()
        if name not in ('solver.energy_limit', 'connector.obstruction')}


def _choose_step(peer: Peer, scene: Scene, rate: float) -> float:
    """Return the step [s] with which the method keeps the tolerance on an oscillation."""
    tolerance = float(str(scene.parameters['solver.tolerance'])) / rate
    target = (_TARGET_ERROR_RATIO * tolerance / peer.error) ** (1.0 / peer.order)
    step = min(target, _MAX_STEP_RAD) / rate
    damping = float(np.max(scene.connectors.damping, initial=0.0))
    if damping > 0.0:
        shell, width = scene.shell, 0.5 * scene.geometry.cube_width
        fastest = 24.0 * damping * (1.0 / shell.mass + width**2 / shell.inertia)
        step = min(step, _MAX_DAMPED_STEP_RATIO / fastest)
    return step


def _hand_over_state(run: Any, other: Simulation) -> float:
    """Set a reference to the state of a run; return by how much its clock is behind [s]."""
    state, time = run.snapshot(), float(run.time)
    other.reset_time()
    other.reset(time=time)
    # Profiles count from the start of the run.
    other.inputs.adopt(Inputs(other.scene), time, anew=False)
    other.set_state(
        position=state.position, orientation=state.orientation,
        linear_velocity=state.linear_velocity, angular_velocity=state.angular_velocity)
    return 0.0


def _find_bit_difference(peer: Peer, run: PeerRun, step: float, rate: float) -> str:
    """Return the difference after a restart or other batches of steps, or an empty string."""
    first, second = (peer.run(run.scene, step, rate) for _ in range(2))
    half = run.step_count // 2
    try:
        first.advance_steps(half)
        if isinstance(second, MuJoCoRun):
            second.restore(first.saved(), half)
        else:
            second.advance_steps(half)
        second.advance_steps(run.step_count - half)
    except SimulationError as error:
        return f'stopped at another time: {error}'
    same = np.array_equal(run.saved(), second.saved(), equal_nan=True)
    return '' if same else f'the state at t = {run.time!r} s differs'


def _does_shorter_step_help(
    peer: Peer, scene: Scene, step: float, rate: float, duration: float
) -> bool:
    """Return True if a run with a shorter step does not stop."""
    for part in _SHORTER_STEP_RATIOS:
        run = peer.run(scene, part * step, rate)
        if not math.isfinite(duration / run.step):
            return False
        try:
            run.advance_to(duration)
        except SimulationError:
            continue
        return True
    return False
