# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Summary of `icofabric run`."""

import math

from icofabric_sim.bag import BagRecorder
from icofabric_sim.checks import counted
from icofabric_sim.messages.schedule import seconds
from icofabric_sim.running.run_monitor import RunMonitor
from icofabric_sim.running.run_records import Errors, Status, step_limit
from icofabric_sim.scene.summary import (
    amplification_text,
    evaluations_text,
    Row,
    size_text,
    vector,
)
from icofabric_sim.simulation.reports.divergence import Growth
from icofabric_sim.simulation.simulation import Simulation
from icofabric_sim.simulation.stepping.methods import facts_of
import numpy as np

# Shorter compilation times [s] are not reported.
_MIN_REPORTED_S = 0.5


def run_summary(
        name: str, simulation: Simulation, monitor: RunMonitor, status: Status, wall: float,
        growth_seconds: float, *, errors: Errors | None, growth: Growth | None,
        bag: BagRecorder | None, interrupted: bool, compiling: float = 0.0) -> list[Row]:
    """
    Return label and text of each line of the summary.

    `wall` is the wall time of the run [s], `growth_seconds` that of the growth measurement, and
    `compiling` that of the compiler, before and during the run.
    """
    scene = simulation.scene
    rows = [
        ('scene', f'{name}: {size_text(scene)}'),
        *method_rows(simulation),
        ('run', _speed_text(scene.body_count, status, wall, growth_seconds)),
        ('evaluations', evaluations_text(
            status.evaluations, status.estimations, status.shown,
            is_estimated=scene.parameters['solver.error_estimate'])),
        *_kept(monitor, status),
        *_compiler(compiling),
        *([] if errors is None else accuracy_rows(simulation, errors, growth)),
        ('energy', _energy(simulation, monitor, status)),
        ('', _balance(simulation)),
        *_momenta(simulation, monitor),
        ('strain', _strain(simulation, monitor)),
        *_breaks(simulation),
        ('motion', _displacement(simulation, monitor)),
        ('overlap', status.proximity or 'none beyond the intended contact overlap'),
        *([('', status.obstruction)] if status.obstruction else []),
    ]
    if status.failure:
        rows.append(('stopped', status.failure))
    elif interrupted:
        rows.append(('stopped', f'by the user at t = {seconds(status.time):.6g} s'))
    rows += _recorded(name, bag)
    return rows


def interrupted_summary(
        name: str, simulation: Simulation, status: Status, compiling: float, *,
        bag: BagRecorder | None) -> list[Row]:
    """
    Return label and text for a run that the user ended during a compilation or measurement.

    The last state is unknown.
    """
    return [
        ('scene', f'{name}: {size_text(simulation.scene)}'),
        *_compiler(compiling),
        ('stopped', f'by the user at t = {seconds(status.time):.6g} s, while kernels were being '
                    'compiled or the step was being measured: no results'),
        *_recorded(name, bag)]


def method_rows(simulation: Simulation) -> list[Row]:
    """Return the method, its step and its threads, with the reasons for them."""
    wanted = simulation.scene.parameters['solver.threads']
    threads = f'{simulation.status.thread_count}, ' + (
        f'of solver.threads {wanted}' if wanted else 'automatic (as many as speed up this scene)')
    return [
        ('method', f'{simulation.status.method_name}: {simulation.status.method_reason}'),
        ('step', step_reason(simulation)),
        _elsewhere(simulation) or ('threads', threads),
    ]


def _elsewhere(simulation: Simulation) -> Row | None:
    """Return the device or the ranks that take the steps, or None for this process alone."""
    status = simulation.status
    if status.device:
        return ('device', f'{status.device}; memory about '
                          f'{status.device_bytes / 1e6:.3g} MB')
    if status.rank_count == 1:
        return None
    return ('ranks', f'{status.rank_count} share the steps, one thread each; halo at most '
                     f'{status.halo_bytes / 1e3:.4g} kB for each force evaluation')


def accuracy_rows(
        simulation: Simulation, errors: Errors, growth: Growth | None) -> list[Row]:
    """Return the error estimate, the tolerance, and the meaning for the end of the run."""
    parameters = simulation.scene.parameters
    tolerance = parameters['solver.tolerance']
    given = parameters['solver.step'] > 0.0
    is_estimated = not math.isnan(errors.estimate)
    text = 'not estimated, because solver.error_estimate is false'
    if is_estimated:
        text = (f'error estimate {errors.estimate:.2g} in total, {errors.rate:.2g} per second at '
                'present (position over a, or rad)')
    text += f'; solver.tolerance is {tolerance:g} per second'
    if errors.rate > tolerance:
        text += ': exceeded with the given step' if given else ': exceeded'
    lacks = simulation.status.error_estimate_lacks if is_estimated else ''
    return [('accuracy', text), *([('', f'not included: {lacks}')] if lacks else []), *(
        [('growth', 'not measured')] if growth is None
        else growth_rows(growth, 0.0 if given else tolerance))]


def growth_rows(growth: Growth, tolerance: float) -> list[Row]:
    """Return the growth of a small disturbance and a verdict; `tolerance` 0: given step."""
    text = f'a small disturbance grew {amplification_text(growth.largest, growth.at_least)}'
    if growth.ended:
        text += f' until t = {growth.time[-1]:.6g} s, when {growth.ended}'
    until = growth.meaningful_until
    if math.isnan(until):
        return [('growth', f'{text}; the effect on errors is not known, because they were not '
                           'estimated')]
    if not growth.is_sensitive:
        basis = 'errors' if tolerance == 0.0 else 'tolerance x duration'
        end = 'the error at that time' if growth.ended else 'the final error'
        return [('growth', f'{text}: {end} stays below {growth.final_error(tolerance):.2g} '
                           f'({basis}, times growth)')]
    rows = [('growth', f'{text}: the motion is sensitive or chaotic')]
    if until == math.inf:
        rows.append(('', 'the amplified errors stay below a tenth of a half edge: the '
                         'trajectory is meaningful to the end'))
    else:
        rows.append(('', f'the trajectory is meaningful until t = {until:.4g} s, while amplified '
                         'errors are below a tenth of a half edge; after that only averages are'))
    return rows


def step_reason(simulation: Simulation) -> str:
    """Return the present step and the reason for it."""
    text = f'{simulation.status.step:.6g} s'
    rate, limit = simulation.status.largest_frequency, step_limit(simulation)
    if simulation.scene.parameters['solver.step'] > 0.0:
        return f'{text}, given as solver.step; the limit is {limit:.6g} s'
    if limit == math.inf and facts_of(simulation.status.method_name).adaptive:
        when = 'at the start' if simulation.status.step_count == 0 else (
            f'at the end, {simulation.time / simulation.status.step_count:.3g} s on average')
        return f'{text} {when}: adapted to the error'
    if rate > 0.0:
        return (
            f'{text}, automatic: step = {simulation.status.step * rate:.2g} / largest frequency '
            f'({rate:.6g} rad/s); the limit is {limit:.6g} s')
    return f'{text}, automatic: no connector limits the step'


def _recorded(name: str, bag: BagRecorder | None) -> list[Row]:
    if bag is None:
        return [('bag', 'not recorded')]
    if bag.error is not None:
        return [('bag', _bag(bag))]
    return [
        ('bag', _bag(bag)),
        ('next', f'icofabric info {bag.path}'),
        ('', f'icofabric render {bag.path} --sheet {name}.png')]


def _compiler(compiling: float) -> list[Row]:
    if compiling < _MIN_REPORTED_S:
        return []
    return [('', f'{compiling:.3g} s of additional wall time to load or compile kernels, before '
                 'and during the run')]


def _speed_text(body_count: int, status: Status, wall: float, growth_seconds: float) -> str:
    simulated = seconds(status.time)
    text = (f'{simulated:.6g} s of simulated time in {counted(status.step_count, "step")}, '
            f'{wall:.3g} s of wall time')
    if wall > 0.0 and status.step_count:
        each = wall / (status.step_count * body_count) * 1e9
        text += (f' (real-time factor {simulated / wall:.3g}, {each:,.0f} ns per body and step, '
                 'outputs included)')
    if growth_seconds > 0.0:
        text += f', and {growth_seconds:.3g} s to measure the growth'
    return text


def _kept(monitor: RunMonitor, status: Status) -> list[Row]:
    """Describe the times of the results of a failed run: outputs, steps, and the kept state."""
    if not status.failure:
        return []
    return [('', f'failed: outputs reach t = {seconds(status.time):.6g} s; steps and the energy '
                 'balance are those at the failure, energy and momentum those of the last '
                 f'valid state, t = {monitor.last.time:.6g} s')]


def _energy(simulation: Simulation, monitor: RunMonitor, status: Status) -> str:
    first, last = monitor.first.energy['total'], monitor.last.energy['total']
    end = f't = {monitor.last.time:.6g} s' if status.failure else 'the end'
    text = f'{first:.9g} J at the start, {last:.9g} J at {end}'
    if simulation.status.active_loads or simulation.scene.loads and _loads_act(simulation):
        return text
    if not monitor.energy_scale > 0.0:
        return text
    drift = (last - first) / monitor.energy_scale
    return (f'{text}; drift {drift:+.1e} of the largest exchanged energy '
            f'({monitor.energy_scale:.3g} J)')


def _balance(simulation: Simulation) -> str:
    balance = simulation.balance
    work = f', external work {balance.work:.3g} J' if balance.work != 0.0 else ''
    return (f'balance: largest error {balance.worst:.1e} of the largest energy stored, '
            f'exchanged or supplied ({balance.scale:.3g} J{work}); solver.energy_limit is '
            f'{balance.limit:g}')


def _loads_act(simulation: Simulation) -> bool:
    scene = simulation.scene
    return bool(scene.tractions or scene.expression_loads) or any(
        load.force.any() or load.torque.any() for load in scene.loads.values())


def _momenta(simulation: Simulation, monitor: RunMonitor) -> list[Row]:
    first, last = (monitor.momentum(state) for state in (monitor.first, monitor.last))
    rows = [('momentum', f'{vector(last.linear, "kg m/s")}, about the origin '
                         f'{vector(last.angular, "kg m^2/s")}')]
    scene = simulation.scene
    reasons = [word for word, acts in (
        ('supports', scene.supports is not None),
        ('drives', bool(scene.drives)),
        ('anchors', bool(scene.anchors)),
        ('gravity', any(scene.parameters['gravity'])),
        ('loads', _loads_act(simulation))) if acts]
    if reasons:
        rows.append(('', f'not conserved: {", ".join(reasons)}'))
        return rows
    parts = [
        f'{label} {float(np.linalg.norm(after - before)) / scale:.1e}'
        for label, before, after, scale in (
            ('linear', first.linear, last.linear, last.linear_scale),
            ('angular', first.angular, last.angular, last.angular_scale)) if scale > 0.0]
    if parts:
        rows.append(('', f'relative change: {", ".join(parts)} '
                         '(of the sum of magnitudes over the bodies)'))
    return rows


def _strain(simulation: Simulation, monitor: RunMonitor) -> str:
    parts = []
    for word, extreme in (('stretched', monitor.stretch), ('compressed', monitor.compression)):
        if extreme.number < 0:
            continue
        one, two = simulation.scene.connectors.bodies[extreme.number]
        parts.append(f'{word} by up to {100.0 * abs(extreme.value):.3g} % '
                     f'(bodies {one} and {two}, t = {extreme.time:.6g} s)')
    return ', '.join(parts) or 'none'


def _breaks(simulation: Simulation) -> list[Row]:
    """Return number, times and energy of broken connectors; nothing if none can break."""
    snapshot, scene = simulation.snapshot(), simulation.scene
    torn = np.flatnonzero(~snapshot.anchor_intact)
    if not scene.can_break and snapshot.intact.all():
        return []
    gone = np.flatnonzero(~snapshot.intact)
    lost = f'{snapshot.energy["lost_at_breaks"]:.3g} J dissipated'
    rows = []
    if len(gone):
        times = snapshot.break_time[gone]
        first = int(gone[np.argmin(times)])
        one, two = scene.connectors.bodies[first]
        rows.append(f'{len(gone):,} of {counted(len(snapshot.intact), "connector")}, from t = '
                    f'{times.min():.6g} s (connector {first}, bodies {one} and {two}) to t = '
                    f'{times.max():.6g} s; {lost}')
    if len(torn) and snapshot.anchors_broken_since is not None:
        names, since = list(scene.anchors), snapshot.anchors_broken_since
        rows.append(', '.join(
            f'anchors.{names[number]} at t = {since[number]:.6g} s' for number in torn) + (
                '' if len(gone) else f'; {lost}'))
    return [('' if number else 'broken', row) for number, row in enumerate(rows)] or [
        ('broken', 'none')]


def _displacement(simulation: Simulation, monitor: RunMonitor) -> str:
    extreme = monitor.displacement
    if extreme.number < 0:
        return 'none'
    pitch = simulation.scene.geometry.pitch
    return (f'up to {extreme.value:.4g} m from the start, {extreme.value / pitch:.3g} pitches '
            f'(body {extreme.number}, t = {extreme.time:.6g} s)')


def _bag(bag: BagRecorder) -> str:
    statistics = bag.statistics
    text = (f'{bag.path} ({counted(statistics.written, "message")}, '
            f'{statistics.written_bytes / 1e6:.3g} MB)')
    if bag.error is not None:
        text += f'; incomplete: {bag.error}'
    return text
