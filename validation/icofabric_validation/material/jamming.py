# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Pre-tension and face contact, without bending stiffness.

Connectors shorter than the weave (D < L) pull shells together until faces are in contact. An
independent code verifies one result.
"""

import math
from typing import Any, Final

from icofabric_sim.scene.weave_geometry import MINIMUM_LENGTH_RATIO
from icofabric_validation.material.part import (
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

# D over L, and stiffness of contacts over that of connectors.
RATIOS: Final = (0.999, 0.99, 0.97, 0.95, 0.9, 0.8, 0.7)
CONTACTS: Final = (20.0, 200.0, 2000.0)
CONTACT: Final = 200.0
RATIO: Final = 0.97
_FREE_RATIOS = (1.05, 1.001, *RATIOS)
_MAP_ANGLES = (MIN_ANGLE, -0.34, -0.3, -0.25, -0.2, -0.1, 0.0)
_MAP_RATIOS = (0.999, 0.98, 0.95, 0.92, 0.88, 0.84, 0.8, 0.75)
_SHEAR = 'strength shear 0.001 1 x'
_MAX_STRAIN: Final = 0.3


def jamming_ratio(angle: float) -> float:
    """Return the D / L below which the shells of a free fabric are in contact: L_min / L."""
    geometry = woven(angle)
    return MINIMUM_LENGTH_RATIO * geometry.cube_width / geometry.connector_length


def tensioned(angle: float, ratio: float, **more: Any) -> dict[str, Any]:
    """Return parameters of a fabric with natural length D = ratio times L."""
    return {'weave.connector_angle': angle,
            'connector.natural_length': ratio * woven(angle).connector_length, **more}


def with_contact(stiffness: float) -> dict[str, Any]:
    """Return contact parameters for a stiffness over k; 0: no contact."""
    return {'contact.mode': 'auto' if stiffness else 'never', 'contact.stiffness': stiffness * K}


def _stages(level: Level) -> dict[str, Stage]:
    base = {'connector.stiffness': K}
    quick = level is Level.QUICK
    free_size = level.pick([3, 3, 3], [5, 5, 5], [7, 7, 7])
    slab = level.pick([5, 3, 3], [7, 5, 5], [9, 7, 7])
    short = level.pick([5, 3, 3], [5, 3, 3], [7, 5, 5])
    free_ratios = (1.05, RATIO) if quick else _FREE_RATIOS
    ratios = (0.999, RATIO, 0.9) if quick else RATIOS
    contacts = (0.0, CONTACT) if quick else (0.0, *CONTACTS)
    map_angles = _MAP_ANGLES[::3] if quick else _MAP_ANGLES
    map_ratios = _MAP_RATIOS[::4] if quick else _MAP_RATIOS
    sizes = [[5, 3, 3], [7, 3, 3], [5, 5, 5], [7, 5, 5], [9, 5, 5], [9, 7, 7], [13, 9, 9]]
    sizes = sizes[:level.pick(2, 5, 7)]
    points = level.pick(6, 10, 20)
    far = [f'strength {kind} {_MAX_STRAIN:g} {points} x' for kind in ('shear', 'push', 'pull')]
    free, held = ({**base, 'weave.size': size} for size in (free_size, slab))
    return {
        'free': Stage(
            [tensioned(MIN_ANGLE, ratio, **with_contact(stiffness))
             for stiffness in (0.0, CONTACT) for ratio in free_ratios],
            ('statics',), ('contacts', 'tension'), level.pick(0.2, 1.5, 20.0), free),
        'held': Stage(
            [tensioned(MIN_ANGLE, ratio, **with_contact(stiffness))
             for stiffness in contacts for ratio in ratios
             # The stiffest contacts at the smallest pre-tension have no equilibrium.
             if (stiffness, ratio) != (CONTACTS[-1], RATIOS[0])],
            ('curve',), (_SHEAR,), level.pick(0.5, 5.0, 40.0), held),
        'size': Stage(
            [tensioned(MIN_ANGLE, RATIO, **with_contact(stiffness), **{'weave.size': size})
             for stiffness in (0.0, CONTACT) for size in sizes],
            ('curve',), (_SHEAR,), level.pick(0.3, 3.0, 30.0), base),
        'map': Stage(
            [tensioned(angle, ratio, **with_contact(stiffness))
             for stiffness in (0.0, CONTACT) for angle in map_angles for ratio in map_ratios
             # Open weaves with the smallest pre-tension are slack.
             if angle == MIN_ANGLE or ratio != map_ratios[0]],
            ('curve',), (_SHEAR,), level.pick(0.3, 0.3, 5.0), {**base, 'weave.size': short}),
        'far': Stage(
            [tensioned(MIN_ANGLE, RATIO, **with_contact(stiffness))
             for stiffness in (0.0, CONTACT)],
            ('curve',), far, level.pick(5.0, 8.0, 200.0), {**base, 'weave.size': short}),
        'endless': Stage(
            [tensioned(angle, ratio, **with_contact(stiffness))
             for angle in (MIN_ANGLE, -0.3) for stiffness in contacts
             for ratio in (ratios if angle == MIN_ANGLE else [r for r in ratios if r < 0.96])],
            ('elasticity', 'bands'), ('moduli relaxed', f'gap {level.pick(2, 6, 12)} relaxed'),
            level.pick(0.3, 0.5, 1.5), {**base, 'weave.size': [5, 5, 5]})}


def contact_of(row: Row) -> float:
    """Return the contact stiffness over k; 0: no contact."""
    return float(row['contact.stiffness']) / K if row['contact.mode'] == 'auto' else 0.0


def ratio_of(row: Row) -> float:
    """Return D / L."""
    return round(float(row['connector.natural_length'])
                 / woven(row['weave.connector_angle']).connector_length, 9)


def shear_of(row: Row, which: str = 'modulus') -> float:
    """Return the shear modulus in k / W from 0.0001 to 0.0003, or `modulus_beyond`."""
    return float(row[f'curve.shear.x.{which}']) / modulus_unit(row['weave.connector_angle'])


def _size(row: Row) -> str:
    return 'x'.join(map(str, map(int, row['weave.size'])))


def _contact(stiffness: float) -> str:
    return f'K/k = {stiffness:g}' if stiffness else 'none'


def _tables(found: Results) -> list[Table]:
    free: dict[float, dict[float, Row]] = {}
    for row in found['free']:
        free.setdefault(ratio_of(row), {})[contact_of(row)] = row
    counted = [
        (f'{ratio:g}', _count(rows[0.0]), _count(rows[CONTACT]),
         rows[CONTACT]['statics.contact_pairs'],
         fixed(rows[CONTACT]['statics.overlap'] / 0.01, 4),
         fixed(rows[CONTACT]['statics.largest_tension'], 3)) for ratio, rows in free.items()]
    held: dict[float, dict[float, str]] = {}
    for row in found['held']:
        held.setdefault(contact_of(row), {})[ratio_of(row)] = _modulus_text(row)
    ratios = list(dict.fromkeys(ratio_of(row) for row in found['held']))
    size = [(_size(row), _contact(contact_of(row)), _modulus_text(row),
             row['curve.shear.x.contact_pairs'], row['curve.shear.x.verdict'])
            for row in found['size']]
    far = [(_contact(contact_of(row)), kind, *(row[f'curve.{kind}.x.{name}'] for name in (
        'buckles_at', 'contact_pairs', 'reached')),
        row[f'curve.{kind}.x.largest_stress'] / modulus_unit(MIN_ANGLE),
        row[f'curve.{kind}.x.strain_at_largest_stress']) for row in found['far']
        for kind in ('shear', 'push', 'pull')]
    return [
        Table('Free slabs at the least angle: mechanisms', (
            'D / L', 'without contact', f'with contact, K/k = {CONTACT:g}', 'pairs in contact',
            'largest overlap over a', 'largest tension [N]'), counted),
        Table('Shear modulus in k / W between two held ends, from a strain of 0.0001 to 0.0003, '
              'and to 0.001 if that differs',
              ('contact', *(f'D / L = {ratio:g}' for ratio in ratios)),
              [(_contact(stiffness), *(values.get(ratio, '-') for ratio in ratios))
               for stiffness, values in held.items()]),
        Table(f'By size, D / L = {RATIO:g}', (
            'positions', 'contact', 'G W / k', 'pairs in contact',
            'verdict'), size),
        Table(f'Shear modulus in k / W by angle [rad] and D / L, with contact (K/k = {CONTACT:g}) '
              'and without; "jams below" is L_min / L', *_map_table(found)),
        Table(f'Load cases, D / L = {RATIO:g}', (
            'contact', 'kind', 'first load drop', 'most pairs in contact', 'reached',
            'largest stress W / k', 'at'), far),
        Table('The periodic fabric at equilibrium', (
            'angle', 'contact', 'D / L', 'size over woven', 'C11 W / k', 'C12 W / k', 'C44 W / k',
            'neighbours in contact', 'zero-energy strains', 'waves'), [
                _endless_row(row) for row in found['endless']])]


def _endless_row(row: Row) -> tuple[Any, ...]:
    if row['state'] != 'done':
        return (fixed(row['weave.connector_angle'], 4), _contact(contact_of(row)), ratio_of(row),
                row['reason'], *('-',) * 6)
    # The unit of the woven fabric, although the fabric has shrunk.
    unit = modulus_unit(row['weave.connector_angle'])
    lowest, none = float(row['bands.grid.lowest']), 1e-6 * float(row['bands.highest'])
    waves = 'all cost energy' if lowest > none else (
        'some lower the energy' if lowest < -none else 'some cost none')
    return (
        fixed(row['weave.connector_angle'], 4), _contact(contact_of(row)), f'{ratio_of(row):g}',
        fixed(row['elasticity.length_ratio'], 4), *(
            _rounded(float(row[f'elasticity.stiffness.{pair}']) / unit)
            for pair in ('xx.xx', 'xx.yy', 'yz.yz')),
        2 * int(row['elasticity.contact_pairs']), int(row['elasticity.soft_strains']), waves)


def _count(row: Row) -> Any:
    return row['statics.mechanisms'] if row['state'] == 'done' else row['reason']


def map_of(found: Results, stiffness: float) -> dict[float, dict[float, float]]:
    """Return shear moduli in k / W by angle and D / L; NaN for slabs without equilibrium."""
    modulus: dict[float, dict[float, float]] = {}
    for row in found['map']:
        if contact_of(row) == stiffness:
            modulus.setdefault(row['weave.connector_angle'], {})[ratio_of(row)] = shear_of(row)
    return modulus


def _map_table(found: Results) -> tuple[tuple[str, ...], list[tuple[Any, ...]]]:
    closed, free = map_of(found, CONTACT), map_of(found, 0.0)
    ratios = sorted({ratio for row in closed.values() for ratio in row}, reverse=True)
    return (('angle', 'jams below', *(f'{ratio:g}' for ratio in ratios)), [
        (fixed(angle, 4), fixed(jamming_ratio(angle), 3), *(
            f'{_rounded(row[ratio])} ({_rounded(free[angle][ratio])})' if ratio in row else '-'
            for ratio in ratios))
        for angle, row in closed.items()])


def _modulus_text(row: Row) -> str:
    """Return the modulus, and that of the next strains if it differs by more than 5 %."""
    first, second = shear_of(row), shear_of(row, 'modulus_beyond')
    if abs(first - second) > 0.05 * max(abs(first), abs(second), 1e-3):
        return f'{_rounded(first)}, then {_rounded(second)}'
    return _rounded(first)


def _rounded(value: float) -> str:
    if not math.isfinite(value):
        return '-'
    return '0' if abs(value) < 1e-6 else f'{value:.2g}'


JAM = Part('jam', 'Pre-tension and face contact', _stages, _tables)


def _check(level: Level) -> dict[str, Stage]:
    points = level.pick(1, 1, 4)
    word = f'independent shear {0.001 * points:g} {points} x'
    return {'scipy': Stage(
        [tensioned(MIN_ANGLE, RATIO, **with_contact(CONTACT))], ('curve',), (word,),
        level.pick(40.0, 40.0, 160.0), {'connector.stiffness': K, 'weave.size': [3, 3, 3]})}


def _check_tables(found: Results) -> list[Table]:
    row, = found['scipy']
    strains = [name.split('.', 4)[4].removesuffix('.package') for name in row
               if name.startswith('curve.independent') and name.endswith('.package')]
    rows = []
    for strain in strains:
        name = f'curve.independent.shear.x.{strain}'
        rows.append((
            strain, f'{row[f"{name}.package"]:.11g}', f'{row[f"{name}.scipy"]:.11g}',
            f'{row[f"{name}.package_slope"]:.8g}', f'{row[f"{name}.scipy_slope"]:.8g}',
            f'{row[f"{name}.position_difference"]:.1g}', f'{row[f"{name}.gradient"]:.1g}',
            row[f'{name}.contact_pairs']))
    return [Table(
        'A slab of 3 x 3 x 3 positions sheared between held ends, D / L = 0.97, K/k = 200: the '
        'engine, and SciPy with independent energies', (
            'strain', 'energy [J]: engine', 'SciPy', 'derivative [J]: engine', 'SciPy',
            'distance of bodies over a', 'residual gradient', 'overlapping pairs'), rows)]


CHECK = Part('check', 'One figure by an independent code', _check, _check_tables)
