# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Errors that a method adds during a run, compared with the error estimate of the run.

The run is cut into windows of one shortest period. From the state at the start of each window a
run of much smaller tolerance advances to the end of the window. The distance of the two runs there
is the error added in the window, without its growth.
"""

import math
from typing import NamedTuple

import icofabric_sim as ico
from icofabric_sim.simulation.reports.divergence import distance_between
import numpy as np

# Tolerance of the reference: this fraction of that of the run, within limits for each radian of
# the fastest motion. Round-off dominates below the lower limit.
_REFERENCE_TOLERANCE_RATIO = 1e-2
_MIN_TOLERANCE_PER_RADIAN, _MAX_TOLERANCE_PER_RADIAN = 2e-13, 1e-11
# Upper limit for wrapped connectors whose lengths jump: errors are larger, and steps that locate
# each jump take minutes.
_MAX_TOLERANCE_AT_JUMPS_PER_RADIAN = 1e-9
# Largest number of measured windows, which are spread evenly over longer runs.
_MAX_WINDOWS = 150
# Largest number of evaluations of the forces, which limits the number of shortest periods, and the
# smallest number of periods: small tolerances and kinks would take hours.
_MAX_EVALUATIONS, _MIN_PERIODS = 100_000, 3.0
KINDS = ('free', 'loaded', 'damped', 'kinked', 'contact', 'wrapped')


class RunErrors(NamedTuple):
    """The results of one run: times, error estimates and added errors."""

    kind: str
    seed: int
    method: str
    given: float  # step over the stability limit; 0: adaptive steps
    periods: float  # shortest periods of the run
    times: np.ndarray  # [s]
    added: np.ndarray
    estimate: np.ndarray
    ended: str  # reason of an early end; '': none

    @property
    def ratio(self) -> float:
        """Final estimate over the final added error."""
        return float(self.estimate[-1] / self.added[-1])

    @property
    def decreases(self) -> bool:
        """True if the estimate ever decreased."""
        return bool((np.diff(self.estimate) < 0.0).any())

    @property
    def is_measurable(self) -> bool:
        """True if errors exceed round-off and errors of the reference."""
        return len(self.times) > 2 and float(self.added[-1]) > 1e-10 * self.periods


def draw_scene(kind: str, seed: int) -> tuple[dict[str, object], float, np.random.Generator]:
    """
    Return parameters of a random fabric, its number of shortest periods, and the generator.

    Bodies have any size and stiffness, and motions are gentle to wild. All scenes of a kind share
    kernels.
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
) -> RunErrors:
    """
    Follow one run from step end to step end, and measure the error added in each window.

    `given` is the step over the stability limit, or 0 for adaptive steps. With `looks` the
    estimate is read in every window, otherwise only at the end. Runs of many steps have fewer
    periods. A TimeoutError ends a run after a few windows. So do shells that pass through each
    other under wrapped connectors, because no length is then right and the motion jumps. Raises
    ValueError if a given step is refused.
    """
    changes = changes | {'solver.method': method, 'solver.step': 0.0}
    if given > 0.0:
        if changes.get('connector.obstruction') == 'wrap':
            # Some methods need given steps; a tenth of a radian suits all methods.
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
            max(_REFERENCE_TOLERANCE_RATIO * run.scene.parameters['solver.tolerance'],
                _MIN_TOLERANCE_PER_RADIAN * rate),
            (_MAX_TOLERANCE_AT_JUMPS_PER_RADIAN if bands else _MAX_TOLERANCE_PER_RADIAN) * rate)}))
    steps = _MAX_EVALUATIONS / ico.METHODS[run.status.method_name].stages
    periods = min(periods, max(steps * run.status.step / period, _MIN_PERIODS))
    half_edge, end = run.scene.geometry.half_edge, periods * period
    # Intervals without a measurement limit the number of windows.
    gap = max(periods / _MAX_WINDOWS - 1.0, 0.0) * period
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
            reference.continue_from(run, keep_motion=True)
            run.advance_to(max(start + 0.999 * period, run.time))
            run.advance_steps(1)
            reference.advance_to(run.time)
            here, there = run.snapshot(), reference.snapshot()
            if bands and (here.without_geodesic.any() or there.without_geodesic.any()
                          or run.status.obstruction):
                ended = 'a connector has no path over shells that pass through each other'
                break
            error = distance_between(here, there, half_edge)
            times.append(run.time)
            added.append(added[-1] + error * (run.time - before) / (run.time - start))
            if looks:
                estimate.append(run.error_estimate)
    except ico.SimulationError as reason:
        ended = str(reason)
        if looks and given > 0.0 and estimate[1:]:
            # The check that ended the run has measured the last interval.
            estimate[-1] = max(estimate[-1], run.error_estimate)
    except TimeoutError as reason:
        if len(times) <= _MIN_PERIODS - 1:
            raise
        ended = str(reason)
    if not looks:
        estimate = [0.0] * (len(times) - 1) + [run.error_estimate]
    size = min(len(times), len(estimate))
    return RunErrors(
        kind, seed, method, given, periods, np.array(times[:size]), np.array(added[:size]),
        np.array(estimate[:size]), ended)
