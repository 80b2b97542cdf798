# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Time factors (functions of t in eqs 15 and 47) of the loads and tractions of a scene.

A profile is a sequence of smooth pieces. The factor or its slope may jump between pieces, so the
integrator ends a step exactly there and keeps its order.
"""

from bisect import bisect_right
import math
from typing import NamedTuple

from icofabric_sim.checks import number_in
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.tables import read_numeric_table

_KINDS = ('steady', 'ramp', 'half_sine', 'sine', 'table')
# Above about 1e9 rad/s no time step could resolve the profile.
_MAX_FREQUENCY_HZ = 1e8  # [Hz]
_PROFILE_FORMS = 'steady, ramp, half_sine, sine FREQUENCY or table FILE'


class Piece(NamedTuple):
    """Smooth factor s(t) = value + slope (t - start) + height sin(rate (t - start))."""

    start: float  # [s] from the start of the run
    value: float = 0.0
    slope: float = 0.0  # [1/s]
    height: float = 0.0
    rate: float = 0.0  # [rad/s]
    peak: float = 0.0  # the largest |s| until the next piece begins

    @property
    def is_zero(self) -> bool:
        """True if the factor is 0."""
        return self.value == self.slope == self.height == 0.0

    @property
    def is_plain(self) -> bool:
        """True if the factor is a constant 0 or 1."""
        return self.slope == self.height == 0.0 and self.value in (0.0, 1.0)

    def at(self, time: float) -> float:
        """Return the factor at a `time` [s] after the run began."""
        after = time - self.start
        return self.value + self.slope * after + self.height * math.sin(self.rate * after)


class Profile(NamedTuple):
    """Pieces in order of time; the first starts with the run."""

    pieces: tuple[Piece, ...]

    @property
    def is_plain(self) -> bool:
        """True if the factor is always 0 or 1."""
        return all(piece.is_plain for piece in self.pieces)

    @property
    def strongest(self) -> Piece:
        """Piece with the largest factor."""
        return max(self.pieces, key=lambda piece: piece.peak)

    def begun(self, time: float) -> int:
        """Return the number of the piece that applies from a `time` [s] on."""
        return bisect_right(self.pieces, time, key=lambda piece: piece.start) - 1

    def at(self, time: float) -> float:
        """Return the factor at a `time` [s] after the run began."""
        return self.pieces[self.begun(time)].at(time)


STEADY_PROFILE = Profile((Piece(0.0, 1.0, peak=1.0),))


def make_profile(parameters: Parameters, prefix: str) -> Profile:
    """
    Return the profile that `prefix` (loads.NAME, tractions.NAME or field) describes.

    All times count from the profile's start; a duration of 0 means without end.

    - `steady`: 1 for its duration.
    - `ramp`: from 0 to 1 in its duration, then 1.
    - `half_sine`: sin(pi x), with x from 0 to 1 over its duration.
    - `sine F`: sin(2 pi F t) with F in Hz, for its duration.
    - `table FILE`: linear between rows of time and factor; 0 before the first row, the last
      factor after the last row.
    """
    kind, word = check_profile(parameters, prefix)
    start, duration = parameters[f'{prefix}.start'], parameters[f'{prefix}.duration']
    end = start + duration
    if kind == 'steady':
        pieces = [Piece(start, 1.0, peak=1.0)]
        if duration > 0.0:
            pieces.append(Piece(end))
    elif kind == 'ramp':
        pieces = [Piece(start, 0.0, 1.0 / duration, peak=1.0), Piece(end, 1.0, peak=1.0)]
    elif kind == 'half_sine':
        pieces = [
            Piece(start, height=1.0, rate=math.pi / duration, peak=1.0), Piece(end)]
    elif kind == 'sine':
        pieces = [Piece(start, height=1.0, rate=2.0 * math.pi * float(word), peak=1.0)]
        if duration > 0.0:
            pieces.append(Piece(end))
    else:
        pieces = _table(f'{prefix}.profile', word, start)
    if pieces[0].start > 0.0:
        pieces.insert(0, Piece(0.0))
    return Profile(tuple(pieces))


def check_profile(parameters: Parameters, prefix: str) -> tuple[str, str]:
    """
    Return the kind of a profile, and the file of its table or the frequency [Hz] of its sine.

    Raises ParameterError if the profile is invalid.
    """
    name = f'{prefix}.profile'
    kind, _, word = parameters[name].strip().partition(' ')
    word = word.strip()
    if kind not in _KINDS or (kind in ('table', 'sine')) != bool(word):
        raise ParameterError(name, f'{name} must be {_PROFILE_FORMS}, got {parameters[name]!r}')
    if kind == 'sine' and not 0.0 < _number(word) <= _MAX_FREQUENCY_HZ:
        raise ParameterError(
            name, f'{name} must be sine FREQUENCY with a frequency above 0 Hz and at most '
            f'{_MAX_FREQUENCY_HZ:g} Hz, such as sine 5.0, got {parameters[name]!r}')
    duration = parameters[f'{prefix}.duration']
    if kind in ('ramp', 'half_sine') and not duration > 0.0:
        raise ParameterError(
            f'{prefix}.duration',
            f'{prefix}.duration must be above 0 s for the profile {kind}, got {duration!r} s')
    if kind == 'table' and duration != 0.0:
        raise ParameterError(
            f'{prefix}.duration',
            f'{prefix}.duration must be 0 s for a table, got {duration!r} s: the table gives the '
            'times; let it end with the factor 0')
    start = parameters[f'{prefix}.start']
    if duration > 0.0 and not start + duration > start:
        raise ParameterError(
            f'{prefix}.duration',
            f'{prefix}.duration {duration!r} s is below the round-off of {prefix}.start '
            f'{start!r} s; make it longer')
    return kind, word


def _number(word: str) -> float:
    try:
        return number_in(word)
    except ValueError:
        return math.nan


def _table(name: str, file: str, start: float) -> list[Piece]:
    table = read_numeric_table(name, file, {2: 'two columns, time [s] and factor'})
    times, factors = (start + table[:, 0]).tolist(), table[:, 1].tolist()
    pieces = []
    for t, u, f, g in zip(times, times[1:], factors, factors[1:]):
        if not u > t:
            raise ParameterError(
                name, f'{name}: steps of time in {file!r} are below the round-off of the start '
                f'{start!r} s')
        pieces.append(Piece(t, f, (g - f) / (u - t), peak=max(abs(f), abs(g))))
    pieces.append(Piece(times[-1], factors[-1], peak=abs(factors[-1])))
    return pieces
