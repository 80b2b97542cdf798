# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Friction between faces, and connectors wrapped over shells.

Connectors press the faces of dense fabric together (jamming.py), and pairs in contact stick until
they slip. Wrapped connectors pass over a shell instead of through it.
"""

from typing import Any, Final

from icofabric_validation.material.jamming import (
    CONTACT,
    contact_of,
    RATIO,
    ratio_of,
    tensioned,
    with_contact,
)
from icofabric_validation.material.part import (
    BENDING_UNIT,
    fixed,
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
from icofabric_validation.material.strength import BENDING, BREAK_RATIO, KINDS

COEFFICIENTS: Final = (0.0, 0.1, 0.3, 0.6, 1.0)
_STICKS: Final = 0.3
_RATIOS: Final = (0.999, RATIO, 0.9)
_CONTACTS: Final = (20.0, CONTACT, 2000.0)
# Shear of a slab up to a strain in equal steps, and a cycle to this strain and back.
SHEAR_STRAIN: Final = 0.01
STEPS: Final = 4
# Largest strain of slabs with wrapped connectors.
_STRAIN: Final = 0.3
_ANGLES: Final = (MIN_ANGLE, -0.3, 0.0, 0.3)


def _rough(angle: float, ratio: float, stiffness: float, friction: float) -> dict[str, Any]:
    return tensioned(angle, ratio, **with_contact(stiffness), **{'contact.friction': friction})


def _stages(level: Level) -> dict[str, Stage]:
    quick = level is Level.QUICK
    base = {'connector.stiffness': K}
    slab = level.pick([5, 3, 3], [5, 3, 3], [7, 5, 5])
    ratios = (RATIO,) if quick else (RATIO, 0.9)
    coefficients = COEFFICIENTS[::2] if quick else COEFFICIENTS
    steps = level.pick(STEPS, STEPS, 2 * STEPS)
    open_weave = [(-0.3, 0.95), (-0.3, 0.9)]
    points = level.pick(6, 6, 12)
    return {
        'endless': Stage(
            [_rough(angle, ratio, stiffness, friction)
             for angle, ratio in [*((MIN_ANGLE, ratio) for ratio in _RATIOS), *open_weave][
                 :level.pick(2, 5, 5)]
             for stiffness in (_CONTACTS[1:2] if quick else _CONTACTS)
             for friction in (0.0, _STICKS)],
            ('elasticity', 'bands'), ('moduli relaxed', f'gap {level.pick(2, 6, 12)} relaxed'),
            level.pick(0.4, 0.6, 2.0), {**base, 'weave.size': [5, 5, 5]}),
        'slab': Stage(
            [_rough(MIN_ANGLE, ratio, CONTACT, friction)
             for ratio in ratios for friction in coefficients],
            ('curve',), (f'strength shear {SHEAR_STRAIN:g} {steps} x',),
            level.pick(4.0, 4.0, 80.0), {**base, 'weave.size': slab}),
        'cycles': Stage(
            [_rough(MIN_ANGLE, ratio, CONTACT, friction)
             for ratio in ratios for friction in coefficients],
            ('curve',), (f'cycle shear {SHEAR_STRAIN:g} {steps} x',), level.pick(6.0, 6.0, 120.0),
            {**base, 'weave.size': slab}),
        'finer': Stage(
            [_rough(MIN_ANGLE, RATIO, CONTACT, friction) for friction in (0.1, _STICKS)],
            ('curve',), (f'cycle shear {SHEAR_STRAIN:g} {2 * steps} x',),
            level.pick(15.0, 15.0, 300.0), {**base, 'weave.size': slab}),
        'around': Stage(
            [{'weave.connector_angle': angle, 'connector.obstruction': obstruction,
              'connector.break_length_extension': BREAK_RATIO * woven(angle).connector_length}
             for angle in (_ANGLES[1:2] if quick else _ANGLES)
             for obstruction in ('warn', 'wrap')],
            ('curve',), [f'strength {kind} {_STRAIN:g} {points} x' for kind in KINDS],
            level.pick(8.0, 8.0, 100.0), {
                **base, 'weave.size': level.pick([5, 3, 3], [5, 3, 3], [7, 5, 5]),
                'connector.stiffness_compression': 0.0,
                'connector.bending_stiffness': BENDING * BENDING_UNIT})}


def friction_of(row: Row) -> float:
    """Return the friction coefficient."""
    return float(row['contact.friction'])


def _endless_rows(found: Results) -> list[tuple[Any, ...]]:
    pairs: dict[tuple[float, float, float], dict[float, Row]] = {}
    for row in found['endless']:
        key = row['weave.connector_angle'], contact_of(row), ratio_of(row)
        pairs.setdefault(key, {})[friction_of(row)] = row
    rows = []
    for (angle, stiffness, ratio), both in sorted(
            pairs.items(), key=lambda each: (each[0][0], each[0][1], -each[0][2])):
        unit = modulus_unit(angle)
        smooth, rough = both[0.0], both[_STICKS]
        rows.append((
            fixed(angle, 4), f'{stiffness:g}', f'{ratio:g}', *(
                float(row[f'elasticity.stiffness.{pair}']) / unit
                for pair in ('xx.xx', 'xx.yy', 'yz.yz') for row in (smooth, rough)),
            float(rough['bands.highest']) / float(smooth['bands.highest']),
            'yes' if float(rough['bands.grid.lowest']) > 1e-6 * float(
                rough['bands.highest']) else 'no'))
    return rows


def dissipated(row: Row) -> float:
    """Return the energy dissipated in a cycle over the work of loading."""
    return (float(row['curve.cycle.shear.x.loop_area'])
            / float(row['curve.cycle.shear.x.loading_work']))


def _slab_row(row: Row, cycle: Row) -> tuple[Any, ...]:
    # A cycle may end at a strain without equilibrium.
    whole = cycle['state'] == 'done'
    name, unit = 'curve.shear.x', modulus_unit(MIN_ANGLE)
    stress = float(row[f'{name}.stresses'].split()[-1])
    return (
        f'{ratio_of(row):g}', friction_of(row), row[f'{name}.modulus'] / unit,
        row[f'{name}.modulus_beyond'] / unit, stress / SHEAR_STRAIN / unit
        if row[f'{name}.reached'] > 0.999 * SHEAR_STRAIN else '-',
        row[f'{name}.slips_at'], 1e6 * cycle['curve.cycle.shear.x.loading_work'] if whole else '-',
        fixed(dissipated(cycle), 4) if whole else '-')


def _around_rows(found: Results) -> list[tuple[Any, ...]]:
    rows = []
    for row in found['around']:
        angle = row['weave.connector_angle']
        way = 'around' if row['connector.obstruction'] == 'wrap' else 'through'
        for kind in KINDS:
            name = f'curve.{kind}.x'
            rows.append((
                fixed(angle, 4), kind, way, row[f'{name}.obstructed_at'], row[f'{name}.breaks_at'],
                row[f'{name}.broken'], row[f'{name}.largest_stress'] / modulus_unit(angle),
                row[f'{name}.strain_at_largest_stress'], row[f'{name}.reached']))
    return sorted(rows, key=lambda each: (float(each[0]), KINDS.index(each[1])))


def _tables(found: Results) -> list[Table]:
    finer = {friction_of(row): dissipated(row) for row in found['finer'] if row['state'] == 'done'}
    note = ', '.join(f'{friction:g}: {fixed(lost, 4)}' for friction, lost in finer.items())
    return [
        Table('The periodic fabric at equilibrium, without and with friction: pairs in '
              'contact stick, whatever the coefficient', (
                  'angle', 'K/k', 'D / L', 'C11 W / k', 'with', 'C12 W / k', 'with', 'C44 W / k',
                  'with', 'highest frequency, with over without', 'all waves cost energy'),
              _endless_rows(found)),
        Table(f'Slabs between two held ends at the least angle, K/k = {CONTACT:g}, sheared by '
              f'{SHEAR_STRAIN:g} in {STEPS} steps, and back', (
                  'D / L', 'coefficient', 'G W / k', 'beyond 0.0003', f'up to {SHEAR_STRAIN:g}',
                  'first slip', 'work [uJ]', 'dissipated over work'),
              [_slab_row(*both) for both in zip(found['slab'], found['cycles'], strict=True)],
              f'Dissipated over work at D / L = {RATIO:g} in twice as many steps, by coefficient: '
              f'{note}.'),
        Table(f'Connectors without stiffness in compression, bending stiffness {BENDING:g} k a^2, '
              f'break at {BREAK_RATIO:g} L: through shells, and wrapped over them', (
                  'angle', 'kind', 'way', 'first connector at a shell', 'first break',
                  'broken at the end', 'largest stress W / k', 'at', 'reached'),
              _around_rows(found))]


FRICTION = Part(
    'friction', 'Friction and connectors wrapped over shells', _stages, _tables)
