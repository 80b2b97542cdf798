# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Supports: bodies whose translation or rotation is fixed in world axes."""

from collections.abc import Mapping
from typing import NamedTuple

from icofabric_sim.parameters.validation import ParameterError, Parameters
import numpy as np

FREEDOMS = ('tx', 'ty', 'tz', 'rotation')


class Supports(NamedTuple):
    """Fixed degrees of freedom of every body."""

    translation: np.ndarray  # (n, 3) bool, world axes
    rotation: np.ndarray  # (n,) bool


def fixed_freedoms(parameters: Parameters, name: str) -> set[str]:
    """Return the degrees of freedom that `supports.NAME` fixes: some of tx, ty, tz, rotation."""
    key = f'supports.{name}.fix'
    return named_freedoms(key, parameters[key])


def named_freedoms(key: str, text: str) -> set[str]:
    """Return the degrees of freedom that the value `text` of the parameter `key` names."""
    words = text.split()
    single = [word for word in words if word in ('rx', 'ry', 'rz')]
    if single:
        raise ParameterError(
            key, f'{key} {text!r}: {single[0]} is not supported, because a single component of '
            'the angular velocity is no coordinate: take rotation, which prescribes all three, '
            'or leave it free')
    unknown = [word for word in words if word not in (*FREEDOMS, 'all')]
    if unknown or not words:
        raise ParameterError(
            key, f'{key} must name some of tx ty tz rotation, or all, separated by spaces, got '
            f'{text!r}')
    return set(FREEDOMS) if 'all' in words else set(words)


def make_supports(
    parameters: Parameters, groups: Mapping[str, np.ndarray], body_count: int
) -> Supports | None:
    """Return the fixed degrees of freedom of all bodies; None if the scene has no supports."""
    names = parameters.names('supports')
    if not names:
        return None
    supports = Supports(np.zeros((body_count, 3), dtype=bool), np.zeros(body_count, dtype=bool))
    for name in names:
        fixed = fixed_freedoms(parameters, name)
        bodies = groups[parameters[f'supports.{name}.group']]
        for axis, word in enumerate(FREEDOMS[:3]):
            supports.translation[bodies, axis] |= word in fixed
        supports.rotation[bodies] |= 'rotation' in fixed
    return supports
