# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Select the connectors of `connector_groups.NAME` by two groups of bodies or by an edge pair.

Connectors have three directions, by the edges that they join (Table 5): up and down, north and
south, west and east. Each direction has four connectors at every inner body.
"""

from collections.abc import Mapping
from typing import Any

from icofabric_sim.geometry.icosahedron import NAMED_EDGES
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.weave import Weave
import numpy as np

# Codes of opposite edges differ in the last bit.
DIRECTIONS = tuple(
    f'{one} {other}' for one, other in zip(NAMED_EDGES[::2], NAMED_EDGES[1::2]))


def check_connector_groups(parameters: Parameters) -> None:
    """Refuse connector groups that name neither groups of bodies nor an edge pair."""
    for name in parameters.names('connector_groups'):
        prefix = f'connector_groups.{name}'
        _direction(parameters, prefix)
        if parameters[f'{prefix}.between'].strip():
            parse_two_groups(parameters, f'{prefix}.between')
        elif not parameters[f'{prefix}.direction'].strip():
            raise ParameterError(
                f'{prefix}.between',
                f'{prefix}.between is missing: {prefix} needs it (two groups, whose bodies the '
                f'connectors join), or {prefix}.direction, one of {_direction_list()}')


def differ_by_direction_only(parameters: Parameters) -> bool:
    """Return True if connector groups select by direction only, so that the fabric is periodic."""
    return all(
        parameters[f'connector_groups.{name}.between'].split() in ([], ['all', 'all'])
        for name in parameters.names('connector_groups'))


def grouped_connectors(
    parameters: Parameters, groups: Mapping[str, np.ndarray], weave: Weave
) -> dict[str, np.ndarray]:
    """
    Return masks (c,) of the connectors in each of `connector_groups`, sorted by name.

    A connector of the `weave` belongs to a group if it joins the two groups of bodies and has the
    direction, as far as these are given. A connector in several groups follows the last one.
    """
    members: dict[str, np.ndarray] = {}
    if not parameters.names('connector_groups'):
        return members
    bodies, edges = weave.connector_bodies, weave.connector_edges
    for name in parameters.names('connector_groups'):
        prefix = f'connector_groups.{name}'
        chosen, said = np.ones(len(bodies), bool), []
        if parameters[f'{prefix}.between'].strip():
            first, second = parse_two_groups(parameters, f'{prefix}.between')
            chosen &= connectors_between(groups[first], groups[second], bodies)
            said.append('leads from one to the other')
        pair = _direction(parameters, prefix)
        if pair is not None:
            chosen &= edges[:, 0] >> 1 == pair
            said.append(f'joins {DIRECTIONS[pair]}')
        if not chosen.any():
            key = f'{prefix}.between' if len(said) > 1 or pair is None else f'{prefix}.direction'
            way = 'name two groups that are joined' if pair is None else (
                'choose another direction, or a larger fabric')
            raise ParameterError(
                key, f'{key} {parameters[key]!r}: no connector {" and ".join(said)}; {way}')
        members[name] = chosen
    return members


def _direction(parameters: Parameters, prefix: str) -> int | None:
    """Return the number in DIRECTIONS of the named edge pair (in either order), or None."""
    key = f'{prefix}.direction'
    words = parameters[key].split()
    if not words:
        return None
    for number, pair in enumerate(DIRECTIONS):
        if sorted(words) == sorted(pair.split()):
            return number
    raise ParameterError(
        key, f'{key} must name two opposite edges, {_direction_list()}, got {parameters[key]!r}')


def _direction_list() -> str:
    return ', '.join(DIRECTIONS[:-1]) + ' or ' + DIRECTIONS[-1]


def parse_two_groups(parameters: Parameters, key: str) -> tuple[str, str]:
    """Return the two groups that the parameter `key` names, or raise ParameterError."""
    words = parameters[key].split()
    if len(words) != 2:
        raise ParameterError(
            key, f'{key} must name two groups, separated by a space, got {parameters[key]!r}; '
            "for connectors within one group name it twice, and 'all' for any body")
    for word in words:
        if word != 'all' and f'groups.{word}' not in parameters:
            known = ', '.join(['all', *parameters.names('groups')])
            raise ParameterError(
                key, f'{key}: there is no group {word!r}; known: {known}. '
                f'Define it with groups.{word}')
    return words[0], words[1]


def chosen_connectors(
    parameters: Parameters, key: str, groups: Mapping[str, np.ndarray], connections: Any
) -> np.ndarray | None:
    """
    Return the numbers of the connectors between the two groups of `key`.

    None means all connectors: the parameter is empty.
    """
    if not parameters[key].strip():
        return None
    first, second = parse_two_groups(parameters, key)
    chosen = np.flatnonzero(connectors_between(
        groups[first], groups[second], connections.whole.bodies))
    if not len(chosen):
        raise ParameterError(
            key, f'{key} {first!r} {second!r}: no connector leads from one to the other; name two '
            'groups that are joined')
    return chosen


def connectors_between(first: np.ndarray, second: np.ndarray, bodies: np.ndarray) -> np.ndarray:
    """Return the mask (c,) of connectors that join a body of `first` to a body of `second`."""
    count = int(bodies.max(initial=-1)) + 1
    sides = []
    for group in (first, second):
        member = np.zeros(count, bool)
        member[group[group < count]] = True
        sides.append(member[bodies])
    (a, b), (c, d) = sides[0].T, sides[1].T
    return (a & d) | (b & c)
