# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Errors that a method adds along a run, measured from outside, beside the run's own estimate.

The run is cut into windows of one shortest period. From the state at the beginning of each a far
tighter run goes to its end; how far apart the two are there is what the method added, growth
apart, and the windows are summed.
"""

import math
from typing import NamedTuple

import icofabric_sim as ico
from icofabric_sim.simulation.reports.divergence import distance_between
import numpy as np

# Tolerance of the reference: this part of the run's own, between these for each radian of the
# fastest motion; below, rounding rules.
_FINER, _LEAST, _MOST = 1e-2, 2e-13, 1e-11
# Where bands jump errors are far larger, and steps that find each jump closely take minutes.
_MOST_AT_JUMPS = 1e-9
# Windows in which the error is measured, at most; spread evenly over longer runs.
_WINDOWS = 150
# Steps for a tight tolerance, or across kinks, may take hours: such a run is followed for as many
# shortest periods as so many evaluations of the forces last, but for so many at least.
_MOST_EVALUATIONS, _FEWEST = 100_000, 3.0
KINDS = ('free', 'loaded', 'damped', 'kinked', 'contact', 'wrapped')


class Judged(NamedTuple):
    """What was found in one run: at moments along it, the estimate and what was added by then."""

    kind: str
    seed: int
    method: str
    given: float  # step in parts of the stability limit; 0: chosen
    periods: float  # shortest periods of the run
    times: np.ndarray  # [s]
    added: np.ndarray
    estimate: np.ndarray
    ended: str  # why the run ended early; '': it did not

    @property
    def ratio(self) -> float:
        """Estimate over what was added, at the end."""
        return float(self.estimate[-1] / self.added[-1])

    @property
    def falls(self) -> bool:
        """Whether the estimate was ever less than at an earlier time."""
        return bool((np.diff(self.estimate) < 0.0).any())

    @property
    def tells(self) -> bool:
        """Whether errors stand out above the rounding, and above those of the reference."""
        return len(self.times) > 2 and float(self.added[-1]) > 1e-10 * self.periods


def draw_scene(kind: str, seed: int) -> tuple[dict[str, object], float, np.random.Generator]:
    """
    Parameters of a random fabric, and how many shortest periods it is followed.

    Bodies of any size and stiffness, from gentle to wild; all scenes of a kind share kernels.
    """
    generator = np.random.default_rng([KINDS.index(kind), seed])
    uniform = generator.uniform
    edge, stiffness = 10.0 ** uniform(-2.7, -0.5), 10.0 ** uniform(1.5, 5.0)
    changes: dict[str, object] = {
        'weave.size': [int(n) for n in generator.integers(2, 4, 3)],
        'weave.variant': int(generator.integers(4)),
        'weave.connector_angle': uniform(0.14, 0.6),
        'shell.edge_length': edge, 'shell.thickness': 0.1 * edge,
        'connector.stiffness': stiffness, 'contact.mode': 'never',
        'connector.break_length_extension': 0.0, 'solver.threads': 1,
        'solver.tolerance': 10.0 ** uniform(-8.0, -3.0), 'solver.energy_limit': 1e9}
    scene = ico.Scene.from_parameters(changes)
    a, mass = scene.geometry.half_edge, scene.shell.mass
    rate = math.sqrt(stiffness / mass)
    speed, spin = 10.0 ** uniform(-3.0, -0.7, 2)
    changes |= {
        'initial_random.velocity_sigma': a * rate * speed,
        'initial_random.spin_sigma': rate * spin, 'initial_random.seed': seed}
    if uniform() < 0.5:
        changes['connector.natural_length'] = (
            scene.geometry.connector_length * uniform(0.85, 1.15))
    if kind == 'loaded':
        force = stiffness * a * 10.0 ** uniform(-3.0, -0.7)
        changes |= {
            'gravity': [float(x) for x in a * rate**2 * 1e-3 * generator.standard_normal(3)],
            'groups.held': 'z_max', 'groups.pushed': 'x_max', 'supports.s.group': 'held',
            'loads.l.group': 'pushed', 'loads.l.profile': 'half_sine',
            'loads.l.duration': 2.0 * math.pi / rate * uniform(2.0, 40.0),
            'loads.l.force': [float(x) for x in force * generator.standard_normal(3)]}
    elif kind == 'damped':
        decay = rate * 10.0 ** uniform(-2.0, 0.0, 3)
        changes |= {
            'drag.linear': mass * decay[0], 'drag.angular': scene.shell.inertia * decay[1],
            'connector.damping': 0.3 * mass * decay[2]}
    elif kind == 'kinked':
        changes['connector.stiffness_compression'] = stiffness * uniform(0.1, 0.9)
    elif kind == 'wrapped':
        changes |= {
            'connector.obstruction': 'wrap', 'weave.connector_angle': uniform(0.14, 0.3),
            'initial_random.spin_sigma': rate * max(spin, 0.05)}
    elif kind == 'contact':
        changes |= {'contact.mode': 'auto', 'contact.stiffness': stiffness * uniform(2.0, 10.0)}
        changes['initial_random.velocity_sigma'] = a * rate * max(speed, 0.03)
    return changes, 10.0 ** uniform(0.5, 2.2), generator


def judge(
    changes: dict[str, object], method: str, given: float, periods: float, *, kind: str = '',
    seed: int = 0, looks: bool = True
) -> Judged:
    """
    Follow one run from step end to step end, and measure what is added in each window.

    `given`: length of the steps in parts of the stability limit, 0: chosen. `looks`: whether the
    estimate is read at every window; else at the end only. Runs of many steps are followed for
    fewer periods; a TimeoutError on the way ends one, once a few windows are measured, and so do
    shells that pass through each other where connectors lie around them: no length is right then,
    and the motion jumps. Raises ValueError where a given step is refused.
    """
    changes = changes | {'solver.method': method, 'solver.step': 0.0}
    if given > 0.0:
        if changes.get('connector.obstruction') == 'wrap':
            # Some methods take given steps only; a tenth of a radian is one for all.
            run = ico.compile_scene(ico.Scene.from_parameters(changes | {'solver.method': 'dop8'}))
            changes['solver.step'] = 0.1 / run.status.largest_frequency
        run = ico.compile_scene(ico.Scene.from_parameters(changes))
        changes['solver.step'] = given * run.status.stability_limit
    run = ico.compile_scene(ico.Scene.from_parameters(changes))
    bands = run.packed.model.wrapping is not None
    rate = run.status.largest_frequency
    period = 2.0 * math.pi / rate
    reference = ico.compile_scene(ico.Scene.from_parameters(changes | {
        'solver.method': 'dop8', 'solver.step': 0.0, 'solver.tolerance': min(
            max(_FINER * run.scene.parameters['solver.tolerance'], _LEAST * rate),
            (_MOST_AT_JUMPS if bands else _MOST) * rate)}))
    steps = _MOST_EVALUATIONS / ico.METHODS[run.status.method_name].stages
    periods = min(periods, max(steps * run.status.step / period, _FEWEST))
    half_edge, end = run.scene.geometry.half_edge, periods * period
    # Windows without a measurement in between, so that there are not too many.
    gap = max(periods / _WINDOWS - 1.0, 0.0) * period
    times, added, estimate, ended = [0.0], [0.0], [0.0], ''
    error = 0.0
    try:
        while run.time < end:
            before = run.time
            run.advance_to(before + gap)
            if gap > 0.0:
                run.advance_steps(1)
            start = run.time
            reference.reset_time()
            reference.take_over(run, keep_motion=True)
            run.advance_to(max(start + 0.999 * period, run.time))
            run.advance_steps(1)
            reference.advance_to(run.time)
            here, there = run.snapshot(), reference.snapshot()
            if bands and (here.lost.any() or there.lost.any() or run.status.obstruction):
                ended = 'a connector finds no way around shells that pass through each other'
                break
            error = distance_between(here, there, half_edge)
            times.append(run.time)
            added.append(added[-1] + error * (run.time - before) / (run.time - start))
            if looks:
                estimate.append(run.error_estimate)
    except ico.SimulationError as reason:
        ended = str(reason)
        if looks and given > 0.0 and estimate[1:]:
            # What the last stretch of steps added is measured at the check that ended the run.
            estimate[-1] = max(estimate[-1], run.error_estimate)
    except TimeoutError as reason:
        if len(times) <= _FEWEST - 1:
            raise
        ended = str(reason)
    if not looks:
        estimate = [0.0] * (len(times) - 1) + [run.error_estimate]
    size = min(len(times), len(estimate))
    return Judged(
        kind, seed, method, given, periods, np.array(times[:size]), np.array(added[:size]),
        np.array(estimate[:size]), ended)
