# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the replay: defaults, descriptions and validation."""

from collections.abc import Mapping
import difflib
import math
from typing import Any, NamedTuple

from icofabric_sim.bag.storage import STORAGES
from icofabric_sim.messages.schedule import NANOSECONDS

# Recorded times are integer nanoseconds in 63 bits.
_MAX_TIME_S = 9.2e9  # [s]


class Option(NamedTuple):
    """Replay parameter, with the type of its default."""

    default: Any
    description: str
    minimum: float | None = None
    maximum: float | None = None
    live: bool = False  # may change while the node runs


OPTIONS = {
    'bag': Option('', 'bag folder, or a bare .mcap or .db3 file; also as a plain argument'),
    'fabric': Option(
        '', 'name of the recorded node whose topics are played; empty: the first in the bag'),
    'rate': Option(
        1.0, 'ratio of recorded to wall time; 0: as fast as possible', 0.0, 1e6, live=True),
    'start_offset': Option(
        0.0, 'start offset into the bag [s]', 0.0, _MAX_TIME_S),
    'seek': Option(
        -1.0, 'recorded time [s] to jump to, or to start at; -1: no jump', -1.0, _MAX_TIME_S,
        live=True),
    'loop': Option(False, 'restart at the end', live=True),
    'stay': Option(False, 'pause at the end instead of ending the node', live=True),
    'start_paused': Option(False, 'start paused'),
    'inputs': Option(
        False, 'also publish the recorded wrenches and twists, on their topics'),
    'publish_clock': Option(True, 'publish /clock with the recorded time'),
    'clock_rate': Option(100.0, 'rate of /clock [Hz of recorded time]', 1e-3, 1e6),
    'record.path': Option(
        '', 'bag folder for the simulation that ~/continue starts; empty: no recording'),
    'record.storage': Option('mcap', 'storage of that bag: mcap or sqlite3'),
}


class ReplayParameterError(ValueError):
    """Invalid replay parameter; the message has name, value and remedy."""


def judge_option(name: str, value: Any) -> Any:
    """Return the value of one parameter, converted to its type."""
    option = OPTIONS.get(name)
    if option is None:
        near = difflib.get_close_matches(name, OPTIONS, 1)
        hint = f'did you mean {near[0]}? ' if near else ''
        raise ReplayParameterError(
            f'unknown parameter {name!r}; {hint}replay_node has {", ".join(OPTIONS)}; the '
            'parameters of the fabric are as recorded')
    kind = type(option.default)
    if kind is float and type(value) is int:
        value = float(value)
    if type(value) is not kind:
        words = {bool: 'true or false', float: 'a number', str: 'a text'}
        raise ReplayParameterError(f'{name} must be {words[kind]}, got {value!r}')
    if kind is float:
        low = -math.inf if option.minimum is None else option.minimum
        high = math.inf if option.maximum is None else option.maximum
        if not (math.isfinite(value) and low <= value <= high):
            raise ReplayParameterError(
                f'{name} must lie in {low:g} to {high:g}, got {value!r}: {option.description}')
    if name == 'record.storage' and value not in STORAGES:
        raise ReplayParameterError(
            f'record.storage must be one of {", ".join(STORAGES)}, got {value!r}')
    return value


def judge_options(given: Mapping[str, Any], bag: str | None = None) -> dict[str, Any]:
    """
    Return all parameters, with defaults for missing ones.

    `bag` is the plain argument of the command line.
    """
    options = {name: option.default for name, option in OPTIONS.items()}
    options.update({name: judge_option(name, value) for name, value in given.items()})
    if bag is not None:
        if options['bag'] not in ('', bag):
            raise ReplayParameterError(
                f'two bags given, {bag!r} and the parameter bag: {options["bag"]!r}; choose one')
        options['bag'] = bag
    if not options['bag']:
        raise ReplayParameterError(
            'no bag given; run replay_node BAG, or set the parameter bag')
    if options['seek'] >= 0.0 and options['start_offset'] > 0.0:
        raise ReplayParameterError(
            f'start_offset: {options["start_offset"]:g} s and seek: {options["seek"]:g} s both '
            'set the start; give only one')
    return options


def begin_of(options: Mapping[str, Any], start: int, end: int) -> int:
    """Return the recorded start time [ns] of the replay, in a bag from `start` to `end`."""
    if options['seek'] >= 0.0:
        return judge_seek(options['seek'], start, end)
    begin = start + round(options['start_offset'] * NANOSECONDS)
    if begin > end:
        raise ReplayParameterError(
            f'start_offset: {options["start_offset"]:g} s is beyond the end: the bag is '
            f'{(end - start) / NANOSECONDS:.9g} s long')
    return begin


def judge_seek(time: float, start: int, end: int) -> int:
    """Return the nanoseconds of a recorded `time` [s] to seek."""
    nanoseconds = round(time * NANOSECONDS)
    if not start <= nanoseconds <= end:
        raise ReplayParameterError(
            f'seek: {time:.9f} s is not in the bag, which goes from {start / NANOSECONDS:.9f} s '
            f'to {end / NANOSECONDS:.9f} s')
    return nanoseconds
