# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Phrases that name the results to keep of a run, and the columns of these results."""

from typing import NamedTuple

from icofabric_sim import checks
from icofabric_sim.checks import shown

_CURVES = ('pull', 'push', 'shear', 'hydrostatic', 'inflation')
_AXES = ('x', 'y', 'z')
# Ends along the first axis, displaced along the second one.
_SHEARS = ('xy', 'xz', 'yx', 'yz', 'zx', 'zy')


class Column(NamedTuple):
    """One value of a run, in a column of the table."""

    name: str
    unit: str
    value: float | int | str


class Phrase(NamedTuple):
    """A kind of result and its arguments, such as `displacement tip`."""

    word: str
    arguments: tuple[str, ...]

    def __str__(self) -> str:
        """Return the text of the phrase."""
        return ' '.join((self.word, *self.arguments))


class RunFailed(Exception):
    """The run has no result for a physical reason (the message), such as no equilibrium."""


class SlabCurve(NamedTuple):
    """A load case of a slab."""

    kind: str
    strains: list[float]
    axis: int  # from end to end
    along: list[float] | None  # direction of the displacement; None: that of the load case
    name: str  # of its columns


def curve_arguments(phrase: Phrase) -> SlabCurve:
    """Return the load case of a phrase such as `curve shear 0.1 10 xz`."""
    kind, largest, points, axes = (*phrase.arguments, *('10', 'x')[len(phrase.arguments) - 2:])
    name = f'keep: {phrase.word}'
    checks.choice(f'{name}: KIND', kind, _CURVES)
    checks.choice(f'{name}: AXIS', axes, (*_AXES, *(_SHEARS if kind == 'shear' else ())))
    try:
        strain = float(largest)
    except ValueError:
        raise ValueError(f'{name}: STRAIN must be a number, got {shown(largest)}') from None
    # At a compressive strain of 1 nothing of the slab is left.
    checks.number(
        f'{name}: STRAIN', strain, above=0.0,
        below=1.0 if kind in ('push', 'hydrostatic') else 100.0)
    if not points.isdecimal() or not 1 <= int(points) <= 1000:
        raise ValueError(
            f'{name}: POINTS must be an integer from 1 to 1000, got {shown(points)}')
    count = int(points)
    strains = [strain * number / count for number in range(1, count + 1)]
    along = [float(axis == axes[1]) for axis in _AXES] if len(axes) == 2 else None
    return SlabCurve(kind, strains, _AXES.index(axes[0]), along, f'{kind}.{axes}')
