# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Differences of two checkpoints as text."""

from collections.abc import Mapping, Sequence
from typing import Any

from icofabric_sim.kernels.records import State
from icofabric_sim.parameters.changes import affects_motion
from icofabric_sim.parameters.named_files import extract_files, with_recorded_files
from icofabric_sim.parameters.sections import ParameterSet
from icofabric_sim.parameters.validation import make_parameters, Parameters
import numpy as np

_MAX_NAMED_COUNT = 5
# Differences of these names come first.
_FIRST_NAMED = ('time', *(f'stepper.state.{name}' for name in State._fields))


def scene_parameters(header: Mapping[str, Any]) -> Parameters:
    """
    Return the parameters of the scene in a header; raise ValueError if they are not accepted.
    """
    try:
        known = ParameterSet('/icofabric')
        known.add_file(header['scene'].encode(), 'the scene of the checkpoint')
        return with_recorded_files(make_parameters(known.parameters()), header['scene'])
    except ValueError as error:
        raise ValueError(
            f'the checkpoint holds a scene that this version cannot take: {error}') from error


def material(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters that the motion depends on."""
    return {
        name: value for name, value in parameters.items()
        if affects_motion(name) and name != 'solver.threads'}


def scene_difference(
    a: Mapping[str, Any], b: Mapping[str, Any], words: tuple[str, str]
) -> str:
    """
    Return a text on the differences of scenes, methods and versions in two headers.

    `words` name the two headers in the text.
    """
    def told(name: str, first: Any, second: Any) -> str:
        return f'{name} is {first} {words[0]} and {second} {words[1]}'

    for name in ('version', 'rotation'):
        if a[name] != b[name]:
            return told(name, f'{a[name]!r:.60}', f'{b[name]!r:.60}')
    if a['scene'] != b['scene']:
        first, second = (material(scene_parameters(each)) for each in (a, b))
        names = sorted(name for name in {*first, *second} if first.get(name) != second.get(name))
        listing = [told(name, _shown(first, name), _shown(second, name)) for name in names]
        files = [extract_files(each['scene']) for each in (a, b)]
        for name in sorted(files[0].keys() & files[1].keys()):
            if files[0][name].total != files[1][name].total:
                listing.append(told(f'the SHA-256 of {name!r}', *(
                    f'{each[name].total[:12]}...' for each in files)))
        if listing:
            more = len(listing) - _MAX_NAMED_COUNT
            tail = f'; and {more} more' if more > 0 else ''
            return '; '.join(listing[:_MAX_NAMED_COUNT]) + tail
    for name, unit in (('mass', 'kg'), ('inertia', 'kg m^2'), ('body_count', ''),
                       ('connector_count', ''), ('method', '')):
        if a[name] != b[name]:
            return told(name, *(f'{each[name]!r:.60} {unit}'.rstrip() for each in (a, b)))
    return ''


def _shown(parameters: Mapping[str, Any], name: str) -> str:
    return f'{parameters[name]!r:.60}' if name in parameters else 'not set'


def memory_difference(
    pair: Sequence[tuple[Mapping[str, Any], Mapping[str, np.ndarray]]], words: tuple[str, str]
) -> str:
    """
    Return a text on the first difference of the states of two runs; `pair` has headers, arrays.
    """
    a, b = (
        {'time': header['time'], **arrays, **_leaves(header['memory'])}
        for header, arrays in pair)
    names = [*_FIRST_NAMED, *sorted({*a, *b} - {*_FIRST_NAMED})]
    for name in names:
        first, second = a.get(name), b.get(name)
        place, label = '', name.removeprefix('stepper.').removeprefix('state.')
        if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
            if first.shape == second.shape:
                unlike = np.argwhere(
                    np.ascontiguousarray(first).view(np.int64)
                    != np.ascontiguousarray(second).view(np.int64))
                if not len(unlike):
                    continue
                index = tuple(int(k) for k in unlike[0])
                first, second = float(first[index]), float(second[index])
                # Most arrays are sorted by bodies.
                by_body = a[name].shape[0] == pair[0][0]['body_count'] and len(index) > 1
                place = f' of body {index[0]}' if by_body else f' at {list(index)}'
            else:
                place, first, second = ' by shape', first.shape, second.shape
        # Zeros of different sign differ.
        if repr(first) != repr(second):
            return (
                f'{label}{place} is {first!r:.80} {words[0]} and {second!r:.80} {words[1]}')
    return ''


def _leaves(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return all values by their path."""
    leaves: dict[str, Any] = {}
    parts = [('', values)]
    while parts:
        place, part = parts.pop()
        for name, value in part.items():
            if isinstance(value, Mapping):
                parts.append((f'{place}{name}.', value))
            else:
                leaves[place + name] = value
    return leaves
