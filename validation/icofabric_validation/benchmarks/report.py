# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Tables, CSV files and picture of the benchmarks."""

from collections.abc import Sequence
import math
from pathlib import Path

from icofabric_sim.commands.report import write_csv
from icofabric_sim.pictures.precision_picture import draw_work_precision, HEADER, read_points
from icofabric_validation.benchmarks.machine import machine_lines
from icofabric_validation.benchmarks.solver import StepSolver
from icofabric_validation.benchmarks.step_speed import CHECKED, STEP, StepSpeed
from icofabric_validation.benchmarks.timing import Spread
from icofabric_validation.benchmarks.work_precision import TARGETS, WorkPrecision

# Largest deviation of an observed order without a remark.
_ORDER_TOLERANCE = 0.3


def work_precision_lines(result: WorkPrecision) -> list[str]:
    """Return tables for a terminal."""
    scene, reference = result.scene, result.reference
    lines = [
        f'Work against precision, {scene.name}: {scene.body_count} bodies, '
        f'{scene.connector_count} connectors, {reference.duration:g} s; {result.rounds} rounds',
        *machine_lines(result.contestants.distributions),
        f'reference: direction cosines, extrapolation of order 16; uncertain by '
        f'{reference.uncertainty:.0e}' + (
            f'; every one of {reference.crossings:,} kinks located' if reference.crossings else
            ''),
        f'a small displacement grows {reference.growth:.3g} times over the run',
        'error: largest distance over a, or angle in rad, of any body at the end', '']
    if result.contestants.missing:
        lines += [*result.contestants.missing, '']
    lines += table(_convergence_rows(result))
    for target in TARGETS:
        rows = [[f'time at an error of {target:.0e}', 'median (range)   ',
                 'over our fastest', '']]
        for curve in result.curves:
            spread, beyond = result.times(curve, target)
            if not math.isfinite(spread.median):
                continue
            ratio = result.ratios(curve, target)
            rows.append([
                curve.solver.label, _time(spread), '-' if ratio is None else ratio.text(),
                'extrapolated at its order' if beyond else
                'ours' if curve is result.own_best(target) else ''])
        lines += ['', *table(rows)]
    remarks = [f'{curve.solver.label}: {curve.remark}' for curve in result.curves if curve.remark]
    return lines + ([''] + remarks if remarks else [])


def step_speed_lines(result: StepSpeed) -> list[str]:
    """Return a table for a terminal."""
    scene = result.scene
    rows = [['plain step', 'evaluations', 'ns per connector and step, median (range)',
             'over our cheapest', f'error after {CHECKED:g} s']]
    for row in result.rows:
        ratio = result.ratios(row)
        rows.append([
            row.solver.label, str(row.solver.evaluations), row.per_connector(scene).text(),
            '-' if ratio is None else ratio.text(), f'{row.error:.1e}'])
    lines = [
        f'Plain steps of {STEP:g} s, {scene.name}: {scene.body_count:,} bodies, '
        f'{scene.connector_count:,} connectors; {result.rounds} rounds',
        *machine_lines(result.contestants.distributions), '',
        *table(rows)]
    remarks = [*result.contestants.missing, *result.remarks]
    return lines + ([''] + remarks if remarks else [])


def write_work_precision(result: WorkPrecision, folder: Path) -> list[Path]:
    """Write points, times at equal error and the picture into `folder`; return their paths."""
    name = 'work_precision' + result.scene.name.removeprefix('S1').replace(' ', '_')
    points = write_csv(folder / f'{name}.csv', HEADER, (
        [curve.solver.label, curve.solver.tool,
         'steps' if isinstance(curve.solver, StepSolver) else 'tolerance', f'{point.setting:g}',
         f'{point.error:.6e}', *(f'{v:.6e}' for v in Spread.of(point.times)), len(point.times)]
        for curve in result.curves for point in curve.points))
    rows = []
    for curve in result.curves:
        for target in TARGETS:
            spread, beyond = result.times(curve, target)
            ratio = result.ratios(curve, target)
            if math.isfinite(spread.median):
                rows.append([
                    curve.solver.label, f'{target:g}', *(f'{v:.6e}' for v in spread),
                    int(beyond), *('' if ratio is None else [f'{v:.4g}' for v in ratio])])
    targets = write_csv(
        folder / f'{name}_targets.csv',
        ('solver', 'error', 'time_s', 'time_low_s', 'time_high_s', 'extrapolated',
         'over_our_fastest', 'ratio_low', 'ratio_high'), rows)
    if not any(curve.points for curve in result.curves):
        return [points, targets]
    picture = folder / f'{name}.png'
    draw_work_precision(
        read_points(points), picture,
        title=f'{result.scene.name}: {result.scene.body_count} bodies, '
              f'{result.reference.duration:g} s')
    return [points, targets, picture]


def write_step_speed(result: StepSpeed, folder: Path) -> list[Path]:
    """Write the times into `folder`; return the path."""
    return [write_csv(
        folder / 'step_speed.csv',
        ('solver', 'tool', 'evaluations', 'ns_per_connector_step', 'low', 'high',
         'over_our_cheapest', 'ratio_low', 'ratio_high', 'error', 'rounds'), (
            [row.solver.label, row.solver.tool, row.solver.evaluations,
             *(f'{value:.4g}' for value in row.per_connector(result.scene)),
             *(f'{value:.4g}' for value in result.ratios(row) or ()),
             f'{row.error:.3e}', result.rounds]
            for row in result.rows))]


def _convergence_rows(result: WorkPrecision) -> list[list[str]]:
    rows = [['the same motion?', 'points', 'smallest error', 'order: stated', 'observed', '']]
    for curve in result.curves:
        solver, order = curve.solver, curve.observed_order()
        errors = [point.error for point in curve.points]
        if not errors:
            rows.append([solver.label, '0', '-', str(solver.order), '-', 'no motion'])
            continue
        verdict = 'converges to the reference'
        if isinstance(solver, StepSolver):
            if math.isnan(order):
                verdict = 'too few points for an order'
            elif order < solver.order - _ORDER_TOLERANCE:
                verdict = 'below its order'
        elif not min(errors) < 1e-3 * max(errors):
            verdict = 'does not follow its tolerance'
        rows.append([
            solver.label, str(len(errors)), f'{min(errors):.1e}', str(solver.order or '-'),
            '-' if math.isnan(order) else f'{order:.2f}', verdict])
    return rows


def _time(spread: Spread) -> str:
    factor, unit = (1.0, 's') if spread.median >= 1.0 else (1e3, 'ms')
    return f'{Spread(*(value * factor for value in spread)).text()} {unit:2}'


def table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return aligned columns, the first one to the left, numbers to the right."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    last = len(widths) - 1
    return ['  '.join(
        cell.ljust(width) if k in (0, last) else cell.rjust(width)
        for k, (cell, width) in enumerate(zip(row, widths))).rstrip() for row in rows]
