# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Lengths at which connectors break, in extension (eq 3) and in compression."""

from collections.abc import Mapping
from typing import NamedTuple

from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.connector_laws import ConnectorLaws
import numpy as np

BREAK_LENGTH_NAMES = ('break_length_extension', 'break_length_compression')


class BreakLimits(NamedTuple):
    """Lengths at which connectors break; arrays of shape (c,), or (1,) if all are equal."""

    longest: np.ndarray  # L_e [m], infinite: never in extension
    shortest: np.ndarray  # L_c [m], 0: never in compression


def make_limits(
    parameters: Parameters, length: float | np.ndarray, members: Mapping[str, np.ndarray],
    count: int, laws: ConnectorLaws,
) -> BreakLimits | None:
    """
    Return the limits of all `count` connectors of woven `length` L [m]; None if none can break.

    `members` are those of `make_laws`; later groups take precedence.
    """
    chosen = {f'connector_groups.{name}': mask for name, mask in members.items()}
    limits = []
    for name, never in zip(BREAK_LENGTH_NAMES, (np.inf, 0.0)):
        own = {
            prefix: mask for prefix, mask in chosen.items()
            if parameters[f'{prefix}.{name}'] >= 0.0}
        values = np.full(count if own else 1, parameters[f'connector.{name}'])
        source = np.zeros(len(values), np.int64)
        for number, (prefix, mask) in enumerate(own.items(), start=1):
            values[mask] = parameters[f'{prefix}.{name}']
            source[mask] = number
        keys = [f'{prefix}.{name}' for prefix in ('connector', *own)]
        _check_limits(name, keys, source, values, laws.natural_length, length)
        limits.append(np.where(values > 0.0, values, never))
    result = BreakLimits(*limits)
    if not count or not (np.isfinite(result.longest).any() or result.shortest.any()):
        return None
    return result


def _check_limits(
    name: str, keys: list[str], source: np.ndarray, values: np.ndarray, rest: np.ndarray,
    woven: float | np.ndarray
) -> None:
    """Refuse limits at which a connector would break at its natural or its woven length."""
    given = values > 0.0
    side, ways = ('above', 'raise it') if name == BREAK_LENGTH_NAMES[0] else ('below', 'lower it')
    for other, what in ((rest, 'natural length'), (np.atleast_1d(woven), 'woven length')):
        wrong = given & (values <= other if side == 'above' else values >= other)
        if not wrong.any():
            continue
        place = int(np.argmax(wrong))
        key = keys[source[place if len(source) > 1 else 0]]
        limit = float(values[place if len(values) > 1 else 0])
        length = float(other[place if len(other) > 1 else 0])
        raise ParameterError(
            key, f'{key} {limit!r} m must be {side} the {what} of its connectors, {length!r} m, '
            f'at which they would break at once: it is a length from end to end, not a change of '
            f'length; {ways}, or set 0 for connectors that never break')
