# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Strength: first load drop, first break, largest stress; energy dissipated and absorbed."""

import math
from typing import Any, Final

from icofabric_sim.scene.scene import Scene
from icofabric_validation.material.part import (
    BENDING_UNIT,
    fixed,
    HALF_EDGE,
    K,
    Level,
    MIN_ANGLE,
    modulus_unit,
    Part,
    Results,
    Row,
    Stage,
    Table,
    woven,
)

ANGLES: Final = (MIN_ANGLE, -0.3, 0.0, 0.3)
_FEW_ANGLES = (-0.3, 0.3)
BENDING: Final = 0.1
# Length over the woven length at which connectors break.
BREAK_RATIO: Final = 1.1
KINDS: Final = ('pull', 'push', 'shear')
STRAIN: Final = 0.3
# Largest strain of a cycle.
CYCLE_STRAIN: Final = 0.15
# Impact speed of a fall [m/s], and simulated times [s].
SPEED: Final = 1.0
_DURATION, _LARGE_DURATION = 0.06, 0.15
_GAP = 1e-4  # [m] between the slab and the floor at the start
# Relaxation times [s] of connectors in a fall, and stiffness of Maxwell arms over k.
_TIMES = (3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 1e-1)
_ARM = 1.0


def _fabric(angle: float, **more: Any) -> dict[str, Any]:
    return {
        'weave.connector_angle': angle,
        'connector.break_length_extension': BREAK_RATIO * woven(angle).connector_length, **more}


def _base(size: list[int]) -> dict[str, Any]:
    return {'weave.size': size, 'connector.stiffness': K,
            'connector.bending_stiffness': BENDING * BENDING_UNIT}


def _stages(level: Level) -> dict[str, Stage]:
    there = level.pick(_FEW_ANGLES, ANGLES, ANGLES)
    points = level.pick(6, 6, 12)
    keep = [f'strength {kind} {STRAIN:g} {points} x' for kind in KINDS]
    cycles = [f'cycle {kind} {CYCLE_STRAIN:g} {points // 2} x' for kind in ('pull', 'push')]
    size = level.pick([5, 3, 3], [5, 3, 3], [9, 5, 5])
    found = {
        'curves': Stage(
            [_fabric(angle, **{'weave.kind': kind}) for kind, chosen in (
                ('orthogonal', there), ('bias', _FEW_ANGLES))
             for angle in chosen], ('curve',), keep, level.pick(2.5, 2.5, 60.0), _base(size)),
        'cycles': Stage(
            [_fabric(angle) for angle in there], ('curve',), cycles, level.pick(1.5, 1.5, 30.0),
            _base(size))}
    # For one angle: more points, a larger slab, other contact stiffnesses.
    doubled = [f'strength {kind} {STRAIN:g} {2 * points} x' for kind in KINDS]
    angle = _FEW_ANGLES[0]
    found['finer'] = Stage(
        [_fabric(angle)], ('curve',), doubled, level.pick(4.0, 4.0, 120.0), _base(size))
    found['others'] = Stage(
        [_fabric(angle, **{'weave.size': level.pick([7, 3, 3], [7, 3, 3], [11, 7, 7])}),
         _fabric(angle, **{'weave.size': size, 'contact.stiffness': 20.0 * K}),
         _fabric(angle, **{'weave.size': size, 'contact.stiffness': 2000.0 * K})],
        ('curve',), keep, level.pick(15.0, 15.0, 200.0),
        {name: value for name, value in _base(size).items() if name != 'weave.size'})
    return found


def curve_of(row: Row, kind: str) -> tuple[list[float], list[float]]:
    """Return strains, and stresses in k / W."""
    unit = modulus_unit(row['weave.connector_angle'])
    strains, stresses = (
        [float(word) for word in row[f'curve.{kind}.x.{name}'].split()]
        for name in ('strains', 'stresses'))
    return [0.0, *strains], [0.0, *(stress / unit for stress in stresses)]


def events_of(row: Row, kind: str) -> list[Any]:
    """Return the strains of events, and the largest stress in k / W."""
    name = f'curve.{kind}.x'
    return [
        *(row[f'{name}.{what}'] for what in (
            'contact_at', 'obstructed_at', 'buckles_at', 'breaks_at', 'broken')),
        row[f'{name}.largest_stress'] / modulus_unit(row['weave.connector_angle']),
        row[f'{name}.strain_at_largest_stress'], row[f'{name}.reached']]


_EVENTS = ('first contact', 'first connector through a shell', 'first load drop (buckling)',
           'first break', 'broken at the end', 'largest stress W / k', 'at', 'reached')


def _tables(found: Results) -> list[Table]:
    rows = [
        (row['weave.kind'], fixed(row['weave.connector_angle'], 4), kind, *events_of(row, kind))
        for row in found['curves'] for kind in KINDS]
    checks: list[tuple[Any, ...]] = []
    angle = found['finer'][0]['weave.connector_angle']
    plain = next(row for row in found['curves'] if row['weave.connector_angle'] == angle)
    for name, row in (('as above', plain), ('twice the points', found['finer'][0]), *zip(
            ('larger slab', 'K/k = 20', 'K/k = 2000'), found['others'])):
        checks += [(name, kind, *events_of(row, kind)) for kind in KINDS]
    cycles = []
    for row in found['cycles']:
        for kind in ('pull', 'push'):
            name = f'curve.cycle.{kind}.x'
            cycles.append((
                fixed(row['weave.connector_angle'], 4), kind, *(
                    fixed(1e3 * row[f'{name}.{what}'], 2) for what in (
                        'loading_work', 'unloading_work', 'loop_area', 'released_energy',
                        'energy_gain')),
                fixed(row[f'{name}.loop_area'] / row[f'{name}.loading_work'], 2),
                row[f'{name}.broken']))
    return [
        Table(f'Slabs between two held ends, bending stiffness {BENDING:g} k a^2, connectors that '
              f'break at {BREAK_RATIO:g} L: strains of events',
              ('weave', 'angle [rad]', 'kind', *_EVENTS), rows),
        Table(f'Sensitivity at {angle:g} rad', ('', 'kind', *_EVENTS), checks),
        Table(f'Cycle to a strain of {CYCLE_STRAIN:g} [mJ]', (
            'angle [rad]', 'kind', 'work', 'recovered', 'dissipated', 'by breaks',
            'left in the slab', 'dissipated over work', 'broken'), cycles)]


STRENGTH = Part('strength', 'Strength and energy dissipated in a cycle', _stages, _tables)


def _falling(angle: float, size: list[int], **more: Any) -> dict[str, Any]:
    """Return the parameters of a slab just above a floor."""
    scene = Scene.from_parameters({'weave.size': size, 'weave.connector_angle': angle})
    floor = float(scene.position[:, 2].min()) - 0.5 * woven(angle).cube_width - _GAP
    return {'weave.connector_angle': angle, 'planes.floor.offset': floor, 'weave.size': size,
            **more}


def _falls(level: Level) -> dict[str, Stage]:
    there = level.pick(_FEW_ANGLES, ANGLES, ANGLES)
    size = level.pick([5, 3, 3], [5, 3, 3], [7, 7, 7])
    base = {
        'connector.stiffness': K, 'connector.bending_stiffness': BENDING * BENDING_UNIT,
        'planes.floor.normal': [0.0, 0.0, 1.0], 'groups.whole': 'all',
        'initial.throw.group': 'whole', 'initial.throw.linear_velocity': [0.0, 0.0, -SPEED],
        'duration': level.pick(_DURATION, _DURATION, _LARGE_DURATION), 'solver.energy_limit': 0.05}
    seconds = level.pick(10.0, 10.0, 120.0)
    keep = ('centre', 'energies', 'extremes')
    angle = there[-1]
    return {
        'falls': Stage(
            [_falling(angle, size) for angle in there], ('run',), keep, seconds, base),
        'finer': Stage(
            [_falling(angle, size, **{'solver.tolerance': 1e-8}),
             _falling(angle, level.pick([7, 3, 3], [7, 3, 3], [9, 9, 9]))],
            ('run',), keep, 2.0 * seconds, base),
        'relaxing': Stage(
            [_falling(angle, size, **{'connector.maxwell_time': time})
             for time in level.pick(_TIMES[3:4], _TIMES, _TIMES)],
            ('run',), keep, seconds, {**base, 'connector.maxwell_stiffness': _ARM * K})}


def absorbed(row: Row) -> float:
    """Return the fraction of the impact energy that is not in the motion of the centre."""
    share = _rebound(row)
    return 1.0 - share * share


def _rebound(row: Row) -> float:
    """Return the rebound speed over the impact speed."""
    return float(row['run.centre.velocity.z']) / SPEED


def _fall_row(name: str, row: Row) -> tuple[Any, ...]:
    return (name, fixed(row['weave.connector_angle'], 4), fixed(_rebound(row), 3),
            fixed(absorbed(row), 3), fixed(row['run.stretch'], 3),
            fixed(row['run.compression'], 3),
            f'{row["run.balance_worst"]:.1g}' if math.isfinite(row['run.balance_worst']) else '-')


def _fall_tables(found: Results) -> list[Table]:
    rows = [_fall_row('', row) for row in found['falls']]
    rows += [_fall_row(name, row) for name, row in zip(
        ('tolerance 1e-8', 'larger slab'), found['finer'])]
    angle = found['relaxing'][0]['weave.connector_angle']
    return [
        Table(
            f'Slabs thrown at a floor at {SPEED:g} m/s, without any damping', (
                '', 'angle [rad]', 'rebound over impact speed', 'energy absorbed',
                'largest stretch', 'largest compression', 'energy balance'), rows,
            f'Shells of 2a = {2e3 * HALF_EDGE:g} mm, k = {K:g} N/m, bending stiffness '
            f'{BENDING:g} k a^2; without dissipation: the absorbed energy is in vibrations.'),
        Table(
            f'The slab of {angle:g} rad with Maxwell arms of {_ARM:g} k', (
                'relaxation time [ms]', 'rebound over impact speed', 'energy absorbed',
                'dissipated by the end', 'largest stretch', 'energy balance'),
            [_relaxing_row(row) for row in found['relaxing']],
            'Standard linear solids: the absorbed energy includes the dissipated energy.')]


def _relaxing_row(row: Row) -> tuple[Any, ...]:
    # No other work is done: remaining and dissipated energy add up to the impact energy.
    lost = row['run.energy.dissipated']
    return (
        f'{1e3 * row["connector.maxwell_time"]:g}', fixed(_rebound(row), 3),
        fixed(absorbed(row), 3),
        fixed(lost / (row['run.energy.total'] + lost), 3), fixed(row['run.stretch'], 3),
        f'{row["run.balance_worst"]:.1g}')


FALL = Part('fall', 'Energy absorbed in a fall', _falls, _fall_tables)
