# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
What friction between faces changes, and connectors that lie around their shells.

Dense fabric is pressed together by its connectors (jamming.py): what presses sticks until it
slips. And a connector that runs into its shell goes around it in place of through it.
"""

from typing import Any, Final

from icofabric_validation.material.jamming import (
    CONTACT,
    contact_of,
    RATIO,
    ratio_of,
    tight,
    touching,
)
from icofabric_validation.material.part import (
    BENDING_UNIT,
    fixed,
    Found,
    K,
    LEAST,
    Level,
    modulus_unit,
    Part,
    Row,
    Stage,
    Table,
    woven,
)
from icofabric_validation.material.strength import BENDING, BREAKS_AT, KINDS

COEFFICIENTS: Final = (0.0, 0.1, 0.3, 0.6, 1.0)
_STICKS: Final = 0.3
_RATIOS: Final = (0.999, RATIO, 0.9)
_CONTACTS: Final = (20.0, CONTACT, 2000.0)
# Shears of a slab up to a strain, in equal steps; and one way there and back.
FAR: Final = 0.01
STEPS: Final = 4
# Strains of slabs whose connectors go around shells.
_STRAIN: Final = 0.3
_ANGLES: Final = (LEAST, -0.3, 0.0, 0.3)


def _rubbing(angle: float, ratio: float, stiffness: float, friction: float) -> dict[str, Any]:
    return tight(angle, ratio, **touching(stiffness), **{'contact.friction': friction})


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
            [_rubbing(angle, ratio, stiffness, friction)
             for angle, ratio in [*((LEAST, ratio) for ratio in _RATIOS), *open_weave][
                 :level.pick(2, 5, 5)]
             for stiffness in (_CONTACTS[1:2] if quick else _CONTACTS)
             for friction in (0.0, _STICKS)],
            ('elasticity', 'bands'), ('moduli relaxed', f'gap {level.pick(2, 6, 12)} relaxed'),
            level.pick(0.4, 0.6, 2.0), {**base, 'weave.size': [5, 5, 5]}),
        'slab': Stage(
            [_rubbing(LEAST, ratio, CONTACT, friction)
             for ratio in ratios for friction in coefficients],
            ('curve',), (f'strength shear {FAR:g} {steps} x',), level.pick(4.0, 4.0, 80.0),
            {**base, 'weave.size': slab}),
        'cycles': Stage(
            [_rubbing(LEAST, ratio, CONTACT, friction)
             for ratio in ratios for friction in coefficients],
            ('curve',), (f'cycle shear {FAR:g} {steps} x',), level.pick(6.0, 6.0, 120.0),
            {**base, 'weave.size': slab}),
        'finer': Stage(
            [_rubbing(LEAST, RATIO, CONTACT, friction) for friction in (0.1, _STICKS)],
            ('curve',), (f'cycle shear {FAR:g} {2 * steps} x',),
            level.pick(15.0, 15.0, 300.0), {**base, 'weave.size': slab}),
        'around': Stage(
            [{'weave.connector_angle': angle, 'connector.obstruction': obstruction,
              'connector.break_length_extension': BREAKS_AT * woven(angle).connector_length}
             for angle in (_ANGLES[1:2] if quick else _ANGLES)
             for obstruction in ('warn', 'wrap')],
            ('curve',), [f'strength {kind} {_STRAIN:g} {points} x' for kind in KINDS],
            level.pick(8.0, 8.0, 100.0), {
                **base, 'weave.size': level.pick([5, 3, 3], [5, 3, 3], [7, 5, 5]),
                'connector.stiffness_compression': 0.0,
                'connector.bending_stiffness': BENDING * BENDING_UNIT})}


def friction_of(row: Row) -> float:
    """Coefficient of friction."""
    return float(row['contact.friction'])


def _endless_rows(found: Found) -> list[tuple[Any, ...]]:
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


def lost_of(row: Row) -> float:
    """Energy lost in a cycle over the work of its way there."""
    return float(row['curve.cycle.shear.x.lost']) / float(row['curve.cycle.shear.x.work'])


def _slab_row(row: Row, cycle: Row) -> tuple[Any, ...]:
    # A path there and back may end where no rest is found.
    whole = cycle['state'] == 'done'
    name, unit = 'curve.shear.x', modulus_unit(LEAST)
    stress = float(row[f'{name}.stresses'].split()[-1])
    return (
        f'{ratio_of(row):g}', friction_of(row), row[f'{name}.modulus'] / unit,
        row[f'{name}.modulus_beyond'] / unit, stress / FAR / unit
        if row[f'{name}.reached'] > 0.999 * FAR else '-',
        row[f'{name}.slips_at'], 1e6 * cycle['curve.cycle.shear.x.work'] if whole else '-',
        fixed(lost_of(cycle), 4) if whole else '-')


def _around_rows(found: Found) -> list[tuple[Any, ...]]:
    rows = []
    for row in found['around']:
        angle = row['weave.connector_angle']
        way = 'around' if row['connector.obstruction'] == 'wrap' else 'through'
        for kind in KINDS:
            name = f'curve.{kind}.x'
            rows.append((
                fixed(angle, 4), kind, way, row[f'{name}.obstructed_at'], row[f'{name}.breaks_at'],
                row[f'{name}.broken'], row[f'{name}.most'] / modulus_unit(angle),
                row[f'{name}.most_at'], row[f'{name}.reached']))
    return sorted(rows, key=lambda each: (float(each[0]), KINDS.index(each[1])))


def _tables(found: Found) -> list[Table]:
    finer = {friction_of(row): lost_of(row) for row in found['finer'] if row['state'] == 'done'}
    note = ', '.join(f'{friction:g}: {fixed(lost, 4)}' for friction, lost in finer.items())
    return [
        Table('The periodic fabric at equilibrium, without and with friction: pairs in '
              'contact stick, whatever the coefficient', (
                  'angle', 'K/k', 'D / L', 'C11 W / k', 'with', 'C12 W / k', 'with', 'C44 W / k',
                  'with', 'highest frequency, with over without', 'all waves cost energy'),
              _endless_rows(found)),
        Table(f'Slabs between two held ends at the least angle, K/k = {CONTACT:g}, sheared by '
              f'{FAR:g} in {STEPS} steps, and back', (
                  'D / L', 'coefficient', 'G W / k', 'beyond 0.0003', f'up to {FAR:g}',
                  'first slip', 'work [uJ]', 'dissipated over work'),
              [_slab_row(*both) for both in zip(found['slab'], found['cycles'], strict=True)],
              f'Dissipated over work at D / L = {RATIO:g} in twice as many steps, by coefficient: '
              f'{note}.'),
        Table(f'Connectors without stiffness in compression, bending stiffness {BENDING:g} k a^2, '
              f'break at {BREAKS_AT:g} L: through shells, and wrapped over them', (
                  'angle', 'kind', 'way', 'first connector at a shell', 'first break',
                  'broken at the end', 'largest stress W / k', 'at', 'reached'),
              _around_rows(found))]


FRICTION = Part(
    'friction', 'Friction and connectors wrapped over shells', _stages, _tables)
