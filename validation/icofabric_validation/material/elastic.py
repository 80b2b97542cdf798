# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Elastic constants and Poisson's ratio: the periodic fabric, and slabs between two ends."""

from collections.abc import Iterable
import math
from typing import Any, Final

from icofabric_validation.material.part import (
    angles,
    BENDING_UNIT,
    closed_form_ratio,
    fixed,
    K,
    Level,
    modulus_unit,
    Part,
    Results,
    Row,
    Stage,
    Table,
)

# Bending stiffness over k a^2.
BENDINGS: Final = (0.0, 0.01, 0.1, 1.0)
_TABLE_ANGLES = 5
# Connector angles of slabs [rad].
SLAB_ANGLES: Final = (-0.3, 0.3)
SLAB_BENDING: Final = 0.1
_QUICK_SIZES = ((5, 3, 3), (7, 3, 3))
_SIZES = (*_QUICK_SIZES, (11, 3, 3), (7, 5, 5), (11, 5, 5), (9, 7, 7), (13, 7, 7))
_LARGE_SIZES = (*_SIZES, (15, 9, 9), (21, 11, 11), (27, 15, 15))


def _endless(level: Level) -> dict[str, Stage]:
    cases = [
        {'weave.connector_angle': angle, 'connector.bending_stiffness': ratio * BENDING_UNIT}
        for ratio in BENDINGS for angle in angles(level.pick(6, 24, 60), 0.75)]
    return {'endless': Stage(
        cases, ('elasticity',), ('moduli',), 0.05,
        {'weave.size': [3, 3, 3], 'connector.stiffness': K})}


def constants_of(row: Row) -> dict[str, float]:
    """Return C11, C12, C44 and moduli in k / W, and Poisson's ratio along an axis."""
    unit = modulus_unit(row['weave.connector_angle'])
    c11, c12, c44 = (
        row[f'elasticity.stiffness.{name}'] / unit for name in ('xx.xx', 'xx.yy', 'yz.yz'))
    return {
        'angle': row['weave.connector_angle'],
        'bending': row['connector.bending_stiffness'] / BENDING_UNIT,
        'C11': c11, 'C12': c12, 'C44': c44, 'nu': c12 / (c11 + c12), 'K': (c11 + 2 * c12) / 3,
        **{name: row[f'elasticity.young.{name}.tension'] / unit for name in ('x', 'xy', 'xyz')}}


def largest_difference(found: Iterable[dict[str, float]]) -> float:
    """Return the largest error of Poisson's ratio of point springs from the closed form."""
    return max((abs(one['nu'] - closed_form_ratio(one['angle'])) for one in found
                if one['bending'] == 0.0), default=math.nan)


def _endless_tables(found: Results) -> list[Table]:
    every = [constants_of(row) for row in found['endless']]
    there = sorted({one['angle'] for one in every})
    chosen = [there[round(place * (len(there) - 1) / (_TABLE_ANGLES - 1))]
              for place in range(_TABLE_ANGLES)]
    rows = [
        (f'{one["bending"]:g}', fixed(one['angle'], 4), *(fixed(one[name], 3) for name in (
            'C11', 'C12', 'C44', 'nu')), fixed(closed_form_ratio(one['angle']), 3),
         *(fixed(one[name], 3) for name in ('K', 'x', 'xy', 'xyz')))
        for one in every if one['angle'] in chosen]
    return [Table(
        'Elastic constants of the periodic fabric in k / W', (
            'bending / (k a^2)', 'angle [rad]', 'C11', 'C12', 'C44', 'ratio along an axis',
            'closed form without bending', 'K', 'E along x', 'E along xy', 'E along xyz'), rows,
        f'Point springs at {len(there)} angles: the ratio differs from the closed form by at most '
        f'{largest_difference(every):.1g}.')]


CONSTANTS = Part(
    'constants', 'Elastic constants of the periodic fabric', _endless, _endless_tables)


def _slabs(level: Level) -> dict[str, Stage]:
    common: dict[str, Any] = {
        'connector.stiffness': K, 'connector.bending_stiffness': SLAB_BENDING * BENDING_UNIT}
    kinds = [{'weave.kind': kind, 'weave.connector_angle': angle}
             for kind in ('orthogonal', 'bias') for angle in SLAB_ANGLES]
    sizes = level.pick(_QUICK_SIZES, _SIZES, _LARGE_SIZES)
    cases = [{**kind, 'weave.size': list(size)} for kind in kinds for size in sizes]
    return {
        'pulled': Stage(
            cases, ('curve',), ('strength pull 0.001 1 x',), level.pick(0.2, 0.5, 10.0), common),
        'endless': Stage(
            kinds, ('elasticity',), ('moduli',), 0.05, {**common, 'weave.size': [5, 5, 5]})}


def slab_rows(found: Results) -> list[dict[str, Any]]:
    """Return slabs compared with the periodic fabric in the same direction."""
    endless = {(row['weave.kind'], row['weave.connector_angle']): row
               for row in found['endless']}
    rows = []
    for row in found['pulled']:
        kind, angle = row['weave.kind'], row['weave.connector_angle']
        whole = endless[kind, angle]
        young = whole['elasticity.young.x.tension']
        rows.append({
            'kind': kind, 'angle': angle, 'size': 'x'.join(map(str, map(int, row['weave.size']))),
            'young': row['curve.pull.x.modulus'] / young,
            'curved': row['curve.pull.x.modulus_beyond'] / row['curve.pull.x.modulus'] - 1,
            'y': row['curve.pull.x.poisson.y'], 'z': row['curve.pull.x.poisson.z'],
            'endless': young / modulus_unit(angle), **_ratios(whole)})
    return rows


def _ratios(row: Row) -> dict[str, float]:
    """Return Poisson's ratios for tension along x, from all 21 elastic constants."""
    import numpy as np
    order = ('xx', 'yy', 'zz', 'yz', 'xz', 'xy')
    stiffness = np.zeros((6, 6))
    for first in range(6):
        for second in range(first, 6):
            stiffness[first, second] = stiffness[second, first] = row[
                f'elasticity.stiffness.{order[first]}.{order[second]}']
    strain = np.linalg.solve(stiffness, np.eye(6)[0])
    return {'endless_y': float(-strain[1] / strain[0]), 'endless_z': float(-strain[2] / strain[0])}


def _slab_tables(found: Results) -> list[Table]:
    return [Table(
        f'Slabs between two held ends, bending stiffness {SLAB_BENDING:g} k a^2, pulled along x '
        'by 0.0001 to 0.0003', (
            'weave', 'angle [rad]', 'positions', 'E over that of the periodic fabric',
            'change by 0.001', 'ratio across y', 'across z', 'periodic: E W / k', 'across y',
            'across z'),
        [(row['kind'], row['angle'], row['size'], fixed(row['young'], 3), f'{row["curved"]:.1g}',
          fixed(row['y'], 3), fixed(row['z'], 3), fixed(row['endless'], 3),
          fixed(row['endless_y'], 3), fixed(row['endless_z'], 3)) for row in slab_rows(found)])]


SLABS = Part('slabs', 'Slabs between two held ends and the periodic fabric', _slabs,
             _slab_tables)
