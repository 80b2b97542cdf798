# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Force laws of connectors: one law for all connectors, or separate laws for groups."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.law_tables import LawTable, read_law
from icofabric_sim.terms.interface import Curve
from icofabric_sim.terms.registry import LAWS
import numpy as np

# Values of a group's properties that mean: use the property of `connector.*`.
_DEFAULT_MARKERS = {
    'stiffness': -1.0, 'stiffness_extension': -1.0, 'stiffness_compression': -1.0,
    'natural_length': 0.0}


# k_e, k_c, D and the curve that replaces the spring; D may be an array (c,) over connectors.
_Law = tuple[float, float, float | np.ndarray, Curve | None]
# Laws that parameters name; all other names are files of tables.
NAMED_LAWS = {law.name: law for law in LAWS if law.has('parameters')}


class ConnectorLaws(NamedTuple):
    """Coefficients of eq 2 of all connectors; arrays of shape (c,), or (1,) if all are equal."""

    extension: np.ndarray  # stiffness k_e [N/m] above the natural length
    compression: np.ndarray  # stiffness k_c [N/m] below it
    natural_length: np.ndarray  # D [m]

    @property
    def is_single_linear_spring(self) -> bool:
        """True if all connectors are the same symmetric spring (eq 1)."""
        return len(self.extension) == 1 and bool(self.extension[0] == self.compression[0])

    def kink_count(self, connectors: int) -> int:
        """Count those of `connectors` whose stiffness jumps at the natural length."""
        kinked = self.extension != self.compression
        return connectors if len(kinked) == 1 and kinked[0] else int(kinked.sum())


class ConnectorCurves(NamedTuple):
    """
    Laws that replace eq 2.

    `ConnectorLaws` then holds k and D of these laws, for tables their largest slope.
    """

    curves: tuple[Curve, ...]
    of: np.ndarray  # (c,) int, index in `curves` of each connector, -1: none; (0,) without curves
    stops: np.ndarray = np.zeros(0, bool)  # (c,) the run stops beyond a table; (0,) likewise

    @property
    def tables(self) -> tuple[LawTable, ...]:
        """Tabulated laws."""
        return tuple(curve for curve in self.curves if isinstance(curve, LawTable))

    @property
    def table_of(self) -> np.ndarray:
        """Index in `tables` of each connector, -1 without a table; (c,)."""
        number = np.cumsum([isinstance(curve, LawTable) for curve in self.curves]) - 1
        number[[not isinstance(curve, LawTable) for curve in self.curves]] = -1
        return np.append(number, -1)[self.of]

    @property
    def has_corners(self) -> bool:
        """True if the slope of some law has corners."""
        return any(curve.has_corners for curve in self.curves)

    def replace(
        self, quantity: str, spring: np.ndarray, length: np.ndarray, stiffness: np.ndarray,
        natural_length: np.ndarray
    ) -> np.ndarray:
        """
        Return `spring` (c,) with values of the curves at lengths [m], (c,), where these apply.

        `quantity` is tension, energy or slope. `stiffness` [N/m] and `natural_length` [m] are
        those of springs in extension, (c,) or (1,).
        """
        for number, curve in enumerate(self.curves):
            chosen = self.of == number
            k, rest = (
                np.broadcast_to(values, chosen.shape)[chosen]
                for values in (stiffness, natural_length))
            if quantity == 'slope':
                spring[chosen] = curve.slope(length[chosen], k, rest)
            else:
                spring[chosen] = curve.evaluate(
                    length[chosen], k, rest)[quantity == 'energy']
        return spring

    def describe_beyond(self, length: np.ndarray, bodies: np.ndarray) -> tuple[str, bool]:
        """
        Return a description of the connector farthest beyond its table, and whether the run stops.

        `length` (c,) [m] is NaN for broken connectors; `bodies` is (c, 2). Connectors that stop
        the run take precedence. The description is '' if all are within their tables.
        """
        low, high = np.array(
            [curve.limits for curve in self.curves] + [(-np.inf, np.inf)])[self.of].T
        excess = np.maximum(length - high, low - length)
        beyond = excess > 0.0
        if not beyond.any():
            return '', False
        stops = bool((beyond & self.stops).any())
        number = int(np.argmax(np.where(beyond & (self.stops | ~np.bool_(stops)), excess, -1.0)))
        one, two = bodies[number]
        return (
            f'connector {number}, between bodies {one} and {two}, is {length[number]:.6g} m long, '
            f'beyond {self.curves[self.of[number]].text} ({low[number]:.6g} to '
            f'{high[number]:.6g} m)'), stops


NO_CURVES = ConnectorCurves((), np.zeros(0, np.int64))


def strain_of(length: np.ndarray, natural_length: np.ndarray | float) -> np.ndarray:
    """Return the strains (l - D) / D of connectors, (c,); 0 for hinges, whose D is 0."""
    rest = np.broadcast_to(natural_length, length.shape)
    ratio: np.ndarray = np.divide(length, rest, out=np.ones(length.shape), where=rest > 0.0)
    return ratio - 1.0


def make_laws(
    parameters: Parameters, length: float | np.ndarray, members: Mapping[str, np.ndarray],
    count: int
) -> tuple[ConnectorLaws, ConnectorCurves]:
    """
    Return the springs of all `count` connectors, and the laws that replace them.

    `length` [m] is the woven length L of all connectors, or of each, (c,). `members` are the masks
    (c,) of `connector_groups`; later groups take precedence.
    """
    _require_effect(parameters, ['connector', *(f'connector_groups.{name}' for name in members)])
    general = _law(parameters, 'connector', length, None)
    if not members and not isinstance(general[2], np.ndarray) and general[3] is None:
        return ConnectorLaws(*(np.array([value]) for value in general[:3])), NO_CURVES
    laws = ConnectorLaws(*(np.full(count, value) for value in general[:3]))
    curves = [general[3]]
    stops = np.full(count, parameters['connector.law_beyond'] == 'stop')
    curve_of = np.zeros(count, np.int32)
    for name, chosen in members.items():
        own = _law(parameters, f'connector_groups.{name}', length, general)
        for array, value in zip(laws, own[:3]):
            array[chosen] = value[chosen] if isinstance(value, np.ndarray) else value
        curve_of[chosen] = len(curves)
        if said := parameters[f'connector_groups.{name}.law_beyond']:
            stops[chosen] = said == 'stop'
        curves.append(own[3])
    if not any(curve is not None for curve in curves):
        return laws, NO_CURVES
    found = {curve.text: curve for curve in curves if curve is not None}
    number = np.array([
        -1 if curve is None else list(found).index(curve.text) for curve in curves])
    return laws, ConnectorCurves(tuple(found.values()), number[curve_of], stops)


def _require_effect(parameters: Parameters, prefixes: list[str]) -> None:
    """Raise ParameterError for a value that only a law reads which these connectors lack."""
    for name, law in NAMED_LAWS.items():
        users = [prefix for prefix in prefixes if parameters[f'{prefix}.law'] == name]
        for key, _, unit, _ in law.module('parameters').PARAMETERS:
            for prefix in prefixes:
                value = parameters[f'{prefix}.{key}']
                # Groups with the law take what they lack from connector.*.
                if value and prefix not in users and not (users and prefix == 'connector'):
                    raise ParameterError(
                        f'{prefix}.{key}',
                        f'{prefix}.{key} {value!r} {unit} has no effect without the law: set '
                        f'{prefix}.law to {name}, or leave out {key}')


def property_by_connector(
    parameters: Parameters, name: str, members: Mapping[str, np.ndarray], count: int
) -> np.ndarray:
    """
    Return `connector.NAME` of every connector, (c,), or (1,) if no group overrides the value.

    Values of `connector_groups.*.NAME` override it unless they are negative.
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
    Return k_e, k_c [N/m] and D [m] of `PREFIX.*`, by default those of `connector.*`.

    Ignores tables; `length` [m] is the woven length L.
    """
    general = _law(parameters, 'connector', length, None, tabled=False)
    extension, compression, rest, _ = _law(parameters, prefix, length, general, tabled=False)
    assert not isinstance(rest, np.ndarray)
    return extension, compression, rest


def _law(
    parameters: Parameters, prefix: str, length: float | np.ndarray, general: _Law | None, *,
    tabled: bool = True
) -> _Law:
    """Return the law of `PREFIX.*`; properties not given there are those of `general`."""
    def said(name: str) -> Any:
        value = parameters[f'{prefix}.{name}']
        unsaid = value < 0.0 if _DEFAULT_MARKERS[name] < 0.0 else value == 0.0
        return None if unsaid else value

    stiffness, rest = said('stiffness'), said('natural_length')
    if tabled and parameters[f'{prefix}.law'] in NAMED_LAWS:
        k = stiffness if general is None or stiffness is not None else parameters[
            'connector.stiffness']
        if rest is None:
            rest = length if general is None else general[2]
        return k, k, rest, curve_of_law(parameters, prefix)
    table = table_of_law(parameters, prefix) if tabled else None
    if table is not None:
        most = table.largest_slope
        return most, most, table.natural_length or length, table
    if general is not None and general[3] is not None and all(
            said(name) is None for name in _DEFAULT_MARKERS):
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


def curve_of_law(parameters: Parameters, prefix: str) -> Curve:
    """Return the law that `PREFIX.law` names, with the values of its parameters."""
    name = parameters[f'{prefix}.law']
    for side in ('stiffness_extension', 'stiffness_compression'):
        if parameters[f'{prefix}.{side}'] >= 0.0:
            raise ParameterError(
                f'{prefix}.{side}',
                f'{prefix}.{side} {parameters[f"{prefix}.{side}"]!r} N/m: the law {name} has one '
                f'stiffness; give {prefix}.stiffness')
    values = {
        key: parameters[f'{prefix}.{key}'] or parameters[f'connector.{key}']
        for key, *_ in NAMED_LAWS[name].module('parameters').PARAMETERS}
    try:
        curve: Curve = NAMED_LAWS[name].module('curve').make_curve(values)
    except ValueError as error:
        raise ParameterError(f'{prefix}.law', f'{prefix}.law {name}: {error}') from None
    return curve


def table_of_law(parameters: Parameters, prefix: str) -> LawTable | None:
    """Return the table that `PREFIX.law` names, or None."""
    file = parameters[f'{prefix}.law']
    if not file or file in NAMED_LAWS:
        return None
    given = parameters[f'{prefix}.natural_length']
    if given > 0.0:
        raise ParameterError(
            f'{prefix}.natural_length',
            f'{prefix}.natural_length {given!r} m: the table {prefix}.law {file!r} already '
            'determines the length without force; leave one of them out')
    return read_law(f'{prefix}.law', file)
