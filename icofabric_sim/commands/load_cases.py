# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Load cases of a slab in words and rows, for `icofabric elasticity`."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from icofabric_sim.statics.stretching import CurvePoint
    from icofabric_sim.statics.turning import TurnPoint

BREAK_COLUMNS = (
    'kind', 'strain_or_angle_rad', 'connector', 'side', 'length_m', 'released_j')


def curve_text(curves: Mapping[str, Sequence['CurvePoint']], axis: int) -> list[str]:
    """Lines for the terminal; strains across `axis` are those of the middle of the slab."""
    lines = []
    for kind, points in curves.items():
        sides = [number for number in range(3) if number != axis]
        head = ''.join(f'{"strain " + 2 * "xyz"[side]:>11}' for side in sides)
        lines.append(
            f'  {kind:11} {"strain":>10} {"stress [Pa]":>14} {"stress/strain":>14}{head}')
        for point in points:
            lines.append(
                f'              {point.strain:10.5g} {point.stress:14.6g} '
                f'{_over(point.stress, point.strain):>14}' + ''.join(
                    f'{point.middle_strain[side]:11.3g}' for side in sides)
                + f'  {point.verdict}{_more(point)}')
    return lines


def turn_text(turns: Mapping[str, Sequence['TurnPoint']]) -> list[str]:
    """Lines for the terminal."""
    lines = []
    for kind, points in turns.items():
        stiffness = 'EI [N m^2]' if kind == 'bend' else 'GJ [N m^2]'
        lines.append(f'  {kind:11} {"angle [rad]":>11} {"moment [N m]":>14} {stiffness:>14}')
        for point in points:
            rigidity = f'{point.rigidity:14.6g}' if point.angle else f'{"":14}'
            lines.append(
                f'              {point.angle:10.5g} {point.moment:14.6g} {rigidity}'
                f'  {point.verdict}{_more(point)}')
    return lines


def break_rows(
    cases: Iterable[tuple[str, Sequence['CurvePoint | TurnPoint']]]
) -> list[list[object]]:
    """Rows of `BREAK_COLUMNS`: what broke in each case, in its order."""
    return [
        [kind, each.amount, each.connector, each.side, each.length, each.released]
        for kind, points in cases for point in points for each in point.breaks]


def _over(stress: float, strain: float) -> str:
    return f'{stress / strain:.6g}' if strain else ''


def _more(point: 'CurvePoint | TurnPoint') -> str:
    """What is to be known of a state beside its verdict."""
    parts = [
        f'  {count} {words}' for count, words in (
            (point.obstructed, 'obstructed'), (point.broken, 'broken'),
            (point.touching, 'pairs touch'), (point.at_kink, 'at their kink'),
            (point.past_kink, 'past it')) if count]
    return ''.join(parts)
