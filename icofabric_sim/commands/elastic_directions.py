# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Elastic moduli by direction as text, rows and numbers, for `icofabric elasticity`."""

from collections.abc import Iterator, Sequence
from typing import Any

from icofabric_sim.statics.directional import Directional
from icofabric_sim.statics.periodic import Elasticity
from icofabric_sim.terminal import bad_input
import numpy as np

# Axes, face diagonals and space diagonals of a cube, one of each opposite pair.
_DIRECTIONS = {
    'x': (1, 0, 0), 'y': (0, 1, 0), 'z': (0, 0, 1),
    'xy': (1, 1, 0), 'x-y': (1, -1, 0), 'yz': (0, 1, 1), 'y-z': (0, 1, -1),
    'xz': (1, 0, 1), 'x-z': (1, 0, -1),
    'xyz': (1, 1, 1), '-x+y+z': (-1, 1, 1), 'x-y+z': (1, -1, 1), 'x+y-z': (1, 1, -1)}
# Directions shown in the terminal; by symmetry they represent all of an orthogonal fabric.
_SHOWN = ('x', 'xy', 'xyz')
COLUMNS = (
    'direction', 'x', 'y', 'z', 'young_modulus_pa',
    *(f'{size}_{name}' for size in ('least', 'largest') for name in (
        'poisson_ratio', 'poisson_across_x', 'poisson_across_y', 'poisson_across_z')),
    *(f'{size}_{name}' for size in ('least', 'largest') for name in (
        'shear_modulus_pa', 'shear_along_x', 'shear_along_y', 'shear_along_z')),
    'undefined')


def by_direction(
    constants: Elasticity, more: Sequence[Sequence[float]]
) -> list[tuple[str, Directional]]:
    """Return the moduli of thirteen named directions, and of the directions in `more`."""
    named: dict[str, Sequence[float]] = dict(_DIRECTIONS)
    named.update({' '.join(f'{part:g}' for part in one): one for one in more})
    with bad_input():
        return [
            (name, constants.directional_moduli(np.array(one, float)))
            for name, one in named.items()]


def text(found: Sequence[tuple[str, Directional]]) -> list[str]:
    """Return lines for the terminal: three named directions and all directions of the user."""
    lines = []
    for name, one in found:
        if name in _DIRECTIONS and name not in _SHOWN:
            continue
        if one.undefined:
            ratio = f"no Poisson's ratio: {one.undefined}"
        else:
            ratio = "Poisson's ratio " + _range(one.poisson_ratio, one.poisson_across, '')
        if name not in _DIRECTIONS:
            ratio = f"Young's modulus {one.young_modulus:.6g} Pa, {ratio}"
        lines.append(f'  along {name}: {ratio}')
        lines.append('    shear modulus on planes normal to this direction ' + _range(
            one.shear_modulus, one.shear_along, ' Pa'))
    return lines


def _range(values: tuple[float, float], where: Any, unit: str) -> str:
    """Format the smallest and largest value with their directions, or the common value."""
    least, largest = (f'{value + 0.0:.5g}{unit}' for value in values)
    if least == largest:
        return f'{least} in all directions'
    first, second = (' '.join(f'{part:.3g}' for part in one.tolist()) for one in where)
    return f'{least} ({first}) to {largest} ({second})'


def rows(found: Sequence[tuple[str, Directional]]) -> Iterator[list[object]]:
    """Yield rows of `COLUMNS`; undefined Poisson's ratios are empty."""
    for name, one in found:
        row: list[object] = [name, *one.direction.tolist(), one.young_modulus]
        for ratio, across in zip(one.poisson_ratio, one.poisson_across.tolist()):
            row += ['', '', '', ''] if one.undefined else [ratio, *across]
        for modulus, along in zip(one.shear_modulus, one.shear_along.tolist()):
            row += [modulus, *along]
        yield [*row, one.undefined]


def numbers(found: Sequence[tuple[str, Directional]]) -> dict[str, Any]:
    """Return the moduli by direction, for JSON."""
    return {name: {
        'direction': one.direction, 'young_modulus_pa': one.young_modulus,
        'poisson_ratio': one.poisson_ratio, 'poisson_across': one.poisson_across,
        'shear_modulus_pa': one.shear_modulus, 'shear_along': one.shear_along,
        'undefined': one.undefined} for name, one in found}
