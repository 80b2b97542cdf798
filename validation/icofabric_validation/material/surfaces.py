# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Floppy surfaces: number and location of mechanisms in slabs."""

import math
from typing import Any, Final

from icofabric_validation.material.part import (
    fixed,
    K,
    Level,
    MIN_ANGLE,
    Part,
    Results,
    Row,
    Stage,
    Table,
)

_SIZES = ((3, 3, 3), (5, 5, 5), (7, 7, 7), (9, 9, 9), (9, 5, 3), (4, 6, 8), (9, 9, 2))
_QUICK_SIZES = ((3, 3, 3), (5, 5, 5), (4, 6, 8))
_LARGE_SIZES = (*_SIZES, (10, 10, 9), (21, 7, 5), (13, 13, 3))
ANGLES: Final = (MIN_ANGLE, 0.0, 0.4)
_BIAS_SIZES = ((6, 6, 6), (8, 8, 8), (10, 10, 6))
PLACES: Final = ('corner', 'edge', 'face', 'within')
LAYERS: Final = 4


def expected(size: tuple[int, int, int]) -> tuple[int, int]:
    """
    Return 6 N - C of a slab of variant 0, and the term that is proportional to its faces.

    Every unit square of a grid plane has one diagonal with a connector. N is half the number of
    positions, rounded up.
    """
    x, y, z = size
    odd = x * y * z % 2
    faces = 2 * (x * y + y * z + z * x)
    return faces - (x + y + z) + 3 * odd, faces


def surface_mechanisms(normal: tuple[float, float, float]) -> float:
    """
    Return the mechanisms of a free surface per W^2: half the number of cut connectors.

    With twelve neighbours at W (1, +-1, 0) and permutations, and a volume of 2 W^3 per body, they
    are (2 n1 + n2) / 2 for a unit normal with n1 >= n2 >= n3 >= 0.
    """
    first, second, _ = sorted(map(abs, normal), reverse=True)
    return (2.0 * first + second) / (2.0 * math.hypot(*normal))


def _stages(level: Level) -> dict[str, Stage]:
    sizes = level.pick(_QUICK_SIZES, _SIZES, _LARGE_SIZES)
    return {
        'slabs': Stage(
            [{'weave.size': list(size), 'weave.connector_angle': angle}
             for size in sizes for angle in ANGLES], ('mechanisms',), ('places',),
            level.pick(0.1, 0.6, 1.5), {'connector.stiffness': K}),
        'bias': Stage(
            [{'weave.size': list(size), 'weave.kind': 'bias', 'weave.connector_angle': 0.0}
             for size in level.pick(_BIAS_SIZES[:1], _BIAS_SIZES, _BIAS_SIZES)], ('mechanisms',),
            ('places',), 1.0, {'connector.stiffness': K})}


def _size(row: Row) -> tuple[int, int, int]:
    x, y, z = map(int, row['weave.size'])
    return x, y, z


def _share(row: Row) -> float:
    return float(row['mechanisms.rotation_content'] / row['mechanisms.count'])


def _tables(found: Results) -> list[Table]:
    rows: list[tuple[Any, ...]] = []
    for row in found['slabs']:
        size = _size(row)
        rows.append((
            'x'.join(map(str, size)), fixed(row['weave.connector_angle'], 4),
            row['mechanisms.degrees_of_freedom'], row['mechanisms.connectors'],
            row['mechanisms.count'], expected(size)[0], row['mechanisms.self_stresses'],
            fixed(_share(row), 2),
            *(fixed(row[f'mechanisms.at.{place}'], 2) for place in PLACES)))
    bias = [(
        'x'.join(map(str, _size(row))), row['mechanisms.degrees_of_freedom'],
        row['mechanisms.connectors'], row['mechanisms.count'], row['mechanisms.self_stresses'],
        fixed(_all_surfaces(row), 0))
        for row in found['bias']]
    surfaces = [
        (name, fixed(surface_mechanisms(normal), 3)) for name, normal in (
            ('(111), the top of bias', (1.0, 1.0, 1.0)), ('(100), a face of a slab', (1, 0, 0)),
            ('(110)', (1, 1, 0)), ('(211)', (2, 1, 1)), ('(210), the most', (2, 1, 0)))]
    return [
        Table('Mechanisms of orthogonal slabs, and degrees of freedom of a body (of 6) in them', (
            'positions', 'angle [rad]', 'degrees of freedom', 'connectors', 'mechanisms',
            '2 (xy + yz + zx) - (x + y + z) + 3 if all odd', 'self-stresses',
            'fraction of rotations', *PLACES), rows),
        Table('Bias slabs: sum over all surfaces, without edges', (
            'positions', 'degrees of freedom', 'connectors', 'mechanisms', 'self-stresses',
            'surface formula'), bias),
        Table('Mechanisms of a free surface per W^2', ('surface', '(2 n1 + n2) / 2'), surfaces)]


def _all_surfaces(row: Row) -> float:
    """Return the mechanisms of the six faces of a bias slab, (111), (1 -1 0) and (1 1 -2)."""
    x, y, z = _size(row)
    top = surface_mechanisms((1.0, 1.0, 1.0))
    # Both sides of the base are equal.
    sides = surface_mechanisms((1.0, -1.0, 0.0)) + surface_mechanisms((1.0, 1.0, -2.0))
    return 2.0 * (x * y * top + x * z * sides)


SURFACES = Part('surfaces', 'Which surfaces are floppy', _stages, _tables)
