# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Gaps between translational and rotational waves."""

import math
from typing import Final

from icofabric_validation.material.part import (
    angles,
    BENDING_UNIT,
    fixed,
    K,
    Level,
    Part,
    Results,
    Row,
    Stage,
    Table,
)

BENDINGS: Final = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
_QUICK_BENDINGS = (0.1, 1.0, 10.0)
# Wave vectors along each axis of the Brillouin zone, for the map and for its check.
_SAMPLES, _FINE_SAMPLES = 6, 14
# Index of the third band, below the gap: three bands are translational, three rotational.
_BAND_BELOW_GAP = 2


def _stages(level: Level) -> dict[str, Stage]:
    base = {'weave.size': [3, 3, 3], 'connector.stiffness': K}

    def cases(count: int, bendings: tuple[float, ...]) -> list[dict[str, float]]:
        return [{'weave.connector_angle': angle,
                 'connector.bending_stiffness': ratio * BENDING_UNIT}
                for ratio in bendings for angle in angles(count, 0.7)]

    return {
        'map': Stage(
            level.pick(cases(5, _QUICK_BENDINGS), cases(14, BENDINGS), cases(50, BENDINGS)),
            ('bands',), (f'gap {_SAMPLES}',), 0.02, base),
        'finer': Stage(
            cases(3, level.pick((1.0,), (0.1, 1.0, 10.0), BENDINGS)), ('bands',),
            (f'gap {_FINE_SAMPLES}',), 0.05, base)}


def gap_of(row: Row) -> float:
    """Return the gap above the third band over its centre frequency; 0: the bands overlap."""
    below = row[f'bands.{_BAND_BELOW_GAP}.highest']
    above = row[f'bands.{_BAND_BELOW_GAP + 1}.lowest']
    return max(0.0, float((above - below) / (0.5 * (above + below))))


def _point(row: Row) -> tuple[float, float]:
    return (round(row['connector.bending_stiffness'] / BENDING_UNIT, 9),
            round(row['weave.connector_angle'], 9))


def gap_uncertainty(found: Results) -> float:
    """Return the largest change of the relative gap by a finer sampling of wave vectors."""
    coarse = {_point(row): gap_of(row) for row in found['map']}
    return max((abs(coarse[_point(row)] - gap_of(row)) for row in found['finer']
                if _point(row) in coarse), default=math.nan)


def _tables(found: Results) -> list[Table]:
    by_angle: dict[float, dict[float, float]] = {}
    for row in found['map']:
        bending, angle = _point(row)
        by_angle.setdefault(angle, {})[bending] = gap_of(row)
    bendings = sorted({bending for gaps in by_angle.values() for bending in gaps})
    return [Table(
        'Gap above the third band over its centre frequency, by bending stiffness / (k a^2)',
        ('angle [rad]', *(f'{bending:g}' for bending in bendings)),
        [(fixed(angle, 3), *(fixed(gaps[bending], 3) for bending in bendings))
         for angle, gaps in sorted(by_angle.items())],
        f'{_FINE_SAMPLES} waves along each axis of the zone instead of {_SAMPLES} change it by at '
        f'most {gap_uncertainty(found):.1g}: the edges of the bands lie on the path along its '
        'symmetries.')]


WAVES = Part('waves', 'Gaps between translational and rotational waves', _stages, _tables)
