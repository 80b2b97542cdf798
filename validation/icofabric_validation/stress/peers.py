# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Random scenes in other programs, under the same judge: windows beside tighter runs of ours.

What such a program can express is run there: springs, gravity, supports, loads of all profiles,
in MuJoCo dampers along the springs, too. It knows no tolerance, so its step is the one with which
its method keeps that of the scene on an oscillation; a given step is taken as it is. Where a load
jumps a step ends, as with ours. It says nothing of its errors, so what is more than three times
too large is silently wrong, as with ours.
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
from icofabric_validation.stress.judge import classed, Clock, judged_by, SECONDS
from icofabric_validation.stress.kinds import KINDS
from icofabric_validation.stress.lammps_run import LammpsRun
from icofabric_validation.stress.mujoco_run import MuJoCoRun
from icofabric_validation.stress.scenes import draw_scene, StressScene, version_of
from icofabric_validation.stress.verdict import Finding, Verdict
from icofabric_validation.stress.windows import far_tighter, rate_of, Windows
import numpy as np

# Part of the tolerance that is aimed at. At most so many radians in a step; and for damping.
_AIM, _LONGEST, _DAMPED = 0.5, 0.5, 0.5
# Parts of a step that are tried where it stops.
_SHORTER = (1 / 4, 1 / 16)
# Parts of the time for the windows, and for those and the run from the start.
_WINDOWS_PART, _WHOLE_PART = 0.6, 0.9
# A scene of which less than this part of the duration was simulated is judged alone.
_ENOUGH = 0.25
# The last version of seeds whose scenes have nothing beside the terms of their kinds.
_VERSION = 2


PeerRun = MuJoCoRun | LammpsRun


class Peer(NamedTuple):
    """Another program, and what it can express."""

    run: type[MuJoCoRun] | type[LammpsRun]
    method: str
    terms: frozenset[str]  # of kinds of scenes
    error: float  # in a radian of an oscillation, over step times frequency to the order
    order: int
    package: str
    install: str

    @property
    def is_installed(self) -> bool:
        """Whether it can be imported."""
        return find_spec(self.package) is not None

    def can_express(self, seed: int) -> bool:
        """Whether the scene of a seed is one that both can run: nothing is spoiled either."""
        if version_of(seed) > _VERSION:
            return False
        scene = draw_scene(seed)
        return not scene.spoiled and {*KINDS[scene.kind].terms} <= self.terms


PEERS: Final = {
    module.DISTRIBUTION: Peer(
        run, module.METHOD, frozenset(module.TERMS), module.ERROR, module.ORDER,
        module.DISTRIBUTION, module.INSTALL)
    for module, run in ((mujoco_run, MuJoCoRun), (lammps_run, LammpsRun))}


def judge_peer(name: str, stress: StressScene, *, seconds: float = SECONDS) -> Finding:
    """Run a scene in the program `name` within so much processor time [s], and class it."""
    return judged_by(stress, seconds, partial(_judge, PEERS[name]))


def _judge(
    peer: Peer, stress: StressScene, parameters: dict[str, Any], seconds: Clock
) -> Finding:
    try:
        scene = Scene.from_parameters(_expressible(parameters))
        rate = rate_of(compile_scene(scene.with_changes({
            'solver.step': 0.0, 'solver.method': 'dop8'})))
    except ValueError as error:
        # Ours refuses it: there is nothing to compare.
        return Finding(stress.seed, stress.kind, Verdict.REFUSED, ' '.join(str(error).split()))
    given = float(str(scene.parameters['solver.step']))
    step = given or _step(peer, scene, rate)
    run = peer.run(scene, step, rate)
    windows = Windows(
        run, rate, lambda: seconds.is_over(_WINDOWS_PART), hand_over=_put)
    failure = ''
    try:
        windows.follow(stress.duration)
    except SimulationError as error:
        failure = str(error)
    except Interrupted:
        if not run.time > _ENOUGH * stress.duration:
            return _alone(peer, stress, peer.run(scene, step, rate), rate, seconds)
    run.should_stop = None
    added = windows.result()
    found = Finding(
        stress.seed, stress.kind, Verdict.WITHIN, method=peer.method, bodies=scene.body_count,
        steps=run.step_count, is_given=given > 0.0, time=run.time, added=added.error,
        promised=added.promised, windows=added.windows, unjudged=added.unjudged)
    if failure:
        right = _goes_on(peer, scene, step, rate, stress.duration)
        return found._replace(
            verdict=Verdict.STOPPED if right else Verdict.WRONGLY_STOPPED, detail=failure)
    if other := _other_bits(peer, run, step, rate):
        return found._replace(verdict=Verdict.OTHER_BITS, compared=True, detail=other)
    growth, distance, reason = far_tighter(
        run, rate, run.time, lambda: seconds.is_over(_WHOLE_PART))
    found = found._replace(compared=True, growth=0.0 if growth is None else growth.largest)
    verdict = classed(found, '', growth, distance)
    why = added.why or (reason and f'the tighter run stopped: {reason}')
    if why and not verdict.is_fault:
        return verdict._replace(
            verdict=Verdict.UNJUDGED,
            detail=f'{added.unjudged} of {added.windows} windows; {why}')
    return verdict


def _alone(
    peer: Peer, stress: StressScene, run: PeerRun, rate: float, seconds: Clock
) -> Finding:
    """The class of a run beside which tighter ones took too long."""
    clock = seconds.another()
    run.should_stop = lambda: clock.is_over(_WINDOWS_PART)
    verdict, words = Verdict.UNJUDGED, 'the tighter run takes too long'
    try:
        run.advance_to(stress.duration)
    except SimulationError as error:
        right = _goes_on(peer, run.scene, run.step, rate, stress.duration)
        verdict, words = (
            Verdict.STOPPED if right else Verdict.WRONGLY_STOPPED), str(error)
    except Interrupted:
        verdict, words = Verdict.SLOW, (
            f'{run.step_count} steps of {run.step:.3g} s to t = {run.time:.6g} s of '
            f'{stress.duration:.6g} s')
    return Finding(
        stress.seed, stress.kind, verdict, words, method=peer.method, bodies=run.scene.body_count,
        steps=run.step_count, time=run.time)


def _expressible(parameters: dict[str, Any]) -> dict[str, Any]:
    """The scene without what only ours has: limits of its own health checks."""
    return {
        name: value for name, value in parameters.items()
        if name not in ('solver.energy_limit', 'connector.obstruction')}


def _step(peer: Peer, scene: Scene, rate: float) -> float:
    """The step [s] with which the method keeps the tolerance on an oscillation."""
    tolerance = float(str(scene.parameters['solver.tolerance'])) / rate
    step = min((_AIM * tolerance / peer.error) ** (1.0 / peer.order), _LONGEST) / rate
    damping = float(np.max(scene.connectors.damping, initial=0.0))
    if damping > 0.0:
        shell, width = scene.shell, 0.5 * scene.geometry.cube_width
        fastest = 24.0 * damping * (1.0 / shell.mass + width**2 / shell.inertia)
        step = min(step, _DAMPED / fastest)
    return step


def _put(run: Any, other: Simulation) -> float:
    """Have a tighter run begin where the other is; returns by how much its clock is behind [s]."""
    state, time = run.snapshot(), float(run.time)
    other.reset_time()
    other.reset(time=time)
    # Profiles count from the start of the run.
    other.inputs.adopt(Inputs(other.scene), time, anew=False)
    other.set_state(
        position=state.position, orientation=state.orientation,
        linear_velocity=state.linear_velocity, angular_velocity=state.angular_velocity)
    return 0.0


def _other_bits(peer: Peer, run: PeerRun, step: float, rate: float) -> str:
    """What a saved state in the middle changes, or other pieces of the run; '': nothing."""
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
        return f'stopped elsewhere: {error}'
    same = np.array_equal(run.saved(), second.saved(), equal_nan=True)
    return '' if same else f'the state at t = {run.time!r} s differs'


def _goes_on(
    peer: Peer, scene: Scene, step: float, rate: float, duration: float
) -> bool:
    """Whether it does not stop with a shorter step."""
    for part in _SHORTER:
        run = peer.run(scene, part * step, rate)
        if not math.isfinite(duration / run.step):
            return False
        try:
            run.advance_to(duration)
        except SimulationError:
            continue
        return True
    return False
