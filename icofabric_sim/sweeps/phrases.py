# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Phrases that say what is kept of a run, and the columns that they become."""

from typing import NamedTuple

from icofabric_sim import checks
from icofabric_sim.checks import shown

_CURVES = ('pull', 'push', 'shear', 'hydrostatic', 'inflation')
_AXES = ('x', 'y', 'z')
# Ends along the first axis, displaced along the second one.
_SHEARS = ('xy', 'xz', 'yx', 'yz', 'zx', 'zy')


class Column(NamedTuple):
    """One value of a run."""

    name: str
    unit: str
    value: float | int | str


class Phrase(NamedTuple):
    """A word that says what is kept, and its arguments."""

    word: str
    arguments: tuple[str, ...]

    def __str__(self) -> str:
        """Return the text of the phrase."""
        return ' '.join((self.word, *self.arguments))


class Failed(Exception):
    """The physics of a run says no; the message is the reason."""


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
    # A push or pressure leaves nothing at a strain of 1.
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
