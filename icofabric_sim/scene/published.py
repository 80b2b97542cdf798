# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Bodies whose poses are published and recorded, and bodies with a tf2 frame."""

from collections.abc import Mapping
import re

from icofabric_sim.checks import shown
from icofabric_sim.parameters.validation import ParameterError, Parameters
import numpy as np

_BODY_FRAME = re.compile('icosahedron(_[0-9]+)?')


def published_bodies(
    parameters: Parameters, groups: Mapping[str, np.ndarray]
) -> np.ndarray | None:
    """Return the sorted bodies that `publish.group` and `publish.stride` choose; None: all."""
    stride = parameters['publish.stride']
    chosen = _bodies_of(parameters, 'publish.group', groups, 'all bodies')
    if chosen is None:
        return None if stride == 1 else np.sort(groups['all'])[::stride]
    return chosen[::stride]


def framed_bodies(
    parameters: Parameters, groups: Mapping[str, np.ndarray]
) -> np.ndarray | None:
    """Return the sorted bodies with a tf2 frame (`tf.group`); None: no frames."""
    return _bodies_of(parameters, 'tf.group', groups, 'none')


def check_frame(parameters: Parameters) -> None:
    """Refuse a `frame_id` that tf2 cannot resolve, or that is the frame of a body."""
    frame, reason = parameters['frame_id'], ''
    if frame.startswith('/'):
        reason = 'tf2 refuses a leading /'
    elif _BODY_FRAME.fullmatch(frame):
        reason = 'this is the frame of a body'
    elif not frame and parameters['tf.group']:
        reason = 'tf2 refuses an empty parent frame for the frames of tf.group'
    if reason:
        raise ParameterError(
            'frame_id', f'frame_id is {shown(frame)}: {reason}; choose a name such as world')


def _bodies_of(
    parameters: Parameters, key: str, groups: Mapping[str, np.ndarray], empty: str
) -> np.ndarray | None:
    name = parameters[key]
    if not name:
        return None
    chosen = np.sort(groups[name])
    if not len(chosen):
        raise ParameterError(
            key, f"{key} {name!r} has no bodies; name a group that has some, or '' for {empty}")
    return chosen


def spread(chosen: np.ndarray | None, published: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """
    Return rows (n, k) of all bodies: `published` (m, k) for the `chosen` bodies, else `rest`.

    Raises ValueError if the number of published rows is wrong.
    """
    expected = len(rest) if chosen is None else len(chosen)
    if len(published) != expected:
        raise ValueError(f'{len(published):,} bodies where {expected:,} are published')
    if chosen is None:
        return published
    whole = np.array(rest, dtype=float)
    whole[chosen] = published
    return whole
