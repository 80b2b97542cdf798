# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
How strongly connectors pull and push: one law for all, or groups of connectors with their own.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.law_tables import LawTable, read_law
import numpy as np

# Properties of a group that say nothing at these values: those of `connector.*` hold.
_UNSAID = {
    'stiffness': -1.0, 'stiffness_extension': -1.0, 'stiffness_compression': -1.0,
    'natural_length': 0.0}


# k_e, k_c, D and the table; natural lengths may be those of each connector, (c,).
_Law = tuple[float, float, float | np.ndarray, LawTable | None]


class ConnectorLaws(NamedTuple):
    """Eq 2 for every connector; arrays of shape (c,), or (1,) where all are alike."""

    extension: np.ndarray  # k_e [N/m], above the natural length
    compression: np.ndarray  # k_c [N/m], below it
    natural_length: np.ndarray  # D [m]

    @property
    def plain(self) -> bool:
        """Whether all connectors are the same symmetric spring (eq 1)."""
        return len(self.extension) == 1 and bool(self.extension[0] == self.compression[0])

    def kink_count(self, connectors: int) -> int:
        """Of how many of all `connectors` the slope of the tension jumps at the natural length."""
        kinked = self.extension != self.compression
        return connectors if len(kinked) == 1 and kinked[0] else int(kinked.sum())


class ConnectorTables(NamedTuple):
    """Laws by table, instead of eq 2; their largest slopes stand for its stiffnesses."""

    tables: tuple[LawTable, ...]
    of: np.ndarray  # (c,) int, which of them each connector follows, -1: none; (0,) without any
    stops: np.ndarray = np.zeros(0, bool)  # (c,) whether a run stops beyond it; (0,) likewise

    def describe_beyond(self, length: np.ndarray, bodies: np.ndarray) -> tuple[str, bool]:
        """
        Describe the connector that is farthest beyond its table, and return whether it stops.

        `length` (c,) [m], NaN of broken ones; `bodies` (c, 2). Those that stop come first; '':
        none is beyond.
        """
        low = np.array([table.rows[1, 0] for table in self.tables] + [-np.inf])[self.of]
        high = np.array([table.rows[-1, 0] for table in self.tables] + [np.inf])[self.of]
        excess = np.maximum(length - high, low - length)
        beyond = excess > 0.0
        if not beyond.any():
            return '', False
        stops = bool((beyond & self.stops).any())
        number = int(np.argmax(np.where(beyond & (self.stops | ~np.bool_(stops)), excess, -1.0)))
        one, two = bodies[number]
        return (
            f'connector {number}, between bodies {one} and {two}, is {length[number]:.6g} m long, '
            f'beyond its table {self.tables[self.of[number]].file} ({low[number]:.6g} to '
            f'{high[number]:.6g} m)'), stops


NO_TABLES = ConnectorTables((), np.zeros(0, np.int64))


def make_laws(
    parameters: Parameters, length: float | np.ndarray, members: Mapping[str, np.ndarray],
    count: int
) -> tuple[ConnectorLaws, ConnectorTables]:
    """
    Laws of all `count` connectors, and those by table.

    `length` [m] is the woven one, L, of all, or of each, (c,). `members`: which connectors belong
    to each of `connector_groups`, (c,) bool; of several groups the last counts.
    """
    general = _law(parameters, 'connector', length, None)
    if not members and not isinstance(general[2], np.ndarray) and general[3] is None:
        return ConnectorLaws(*(np.array([value]) for value in general[:3])), NO_TABLES
    laws = ConnectorLaws(*(np.full(count, value) for value in general[:3]))
    files = [general[3]]
    stops = np.full(count, parameters['connector.law_beyond'] == 'stop')
    table_of = np.zeros(count, np.int32)
    for name, chosen in members.items():
        own = _law(parameters, f'connector_groups.{name}', length, general)
        for array, value in zip(laws, own[:3]):
            array[chosen] = value[chosen] if isinstance(value, np.ndarray) else value
        table_of[chosen] = len(files)
        if said := parameters[f'connector_groups.{name}.law_beyond']:
            stops[chosen] = said == 'stop'
        files.append(own[3])
    if not any(files):
        return laws, NO_TABLES
    tables = {table.file: table for table in files if table is not None}
    number = np.array([
        -1 if table is None else list(tables).index(table.file) for table in files])
    return laws, ConnectorTables(tuple(tables.values()), number[table_of], stops)


def spread_over(
    parameters: Parameters, name: str, members: Mapping[str, np.ndarray], count: int
) -> np.ndarray:
    """
    Value of `connector.NAME` for every connector, (c,), or (1,) where no group has its own.

    `connector_groups.*.NAME` counts where it is not negative.
    """
    value = parameters[f'connector.{name}']
    said = {group: parameters[f'connector_groups.{group}.{name}'] for group in members}
    said = {group: own for group, own in said.items() if not own < 0.0}
    if not said:
        return np.array([value])
    values = np.full(count, value)
    for group, own in said.items():
        values[members[group]] = own
    return values


def spring_law(
    parameters: Parameters, prefix: str, length: float
) -> tuple[float, float, float]:
    """
    k_e, k_c [N/m] and D [m] of `PREFIX.*`, those of `connector.*` where it says nothing.

    Without tables; `length` [m] is the woven one, L.
    """
    general = _law(parameters, 'connector', length, None, tabled=False)
    extension, compression, rest, _ = _law(parameters, prefix, length, general, tabled=False)
    assert not isinstance(rest, np.ndarray)
    return extension, compression, rest


def _law(
    parameters: Parameters, prefix: str, length: float | np.ndarray, general: _Law | None, *,
    tabled: bool = True
) -> _Law:
    """
    Stiffness in extension and in compression, natural length, table; unsaid ones as in general.
    """
    def said(name: str) -> Any:
        value = parameters[f'{prefix}.{name}']
        unsaid = value < 0.0 if _UNSAID[name] < 0.0 else value == 0.0
        return None if unsaid else value

    stiffness, rest = said('stiffness'), said('natural_length')
    table = law_of(parameters, prefix) if tabled else None
    if table is not None:
        most = table.largest_slope
        return most, most, table.natural_length or length, table
    if general is not None and general[3] is not None and all(
            said(name) is None for name in _UNSAID):
        return general
    values = []
    for place, name in enumerate(('stiffness_extension', 'stiffness_compression')):
        value = said(name)
        if value is None:
            value = stiffness
        if value is None:
            assert general is not None
            value = (general[0], general[1])[place]
        values.append(value)
    if rest is None:
        rest = length if general is None else general[2]
    return values[0], values[1], rest, None


def law_of(parameters: Parameters, prefix: str) -> LawTable | None:
    """The table that `PREFIX.law` names, None where it names none."""
    file = parameters[f'{prefix}.law']
    if not file:
        return None
    given = parameters[f'{prefix}.natural_length']
    if given > 0.0:
        raise ParameterError(
            f'{prefix}.natural_length',
            f'{prefix}.natural_length {given!r} m: the table {prefix}.law {file!r} says at which '
            'length there is no force; leave one of them out')
    return read_law(f'{prefix}.law', file)
