# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The runs of a sweep in a fixed order: cases vary slowest, then the grid, then samples.

In the grid the first name varies slowest. Samples are drawn by SciPy's qmc.
"""

from collections.abc import Mapping, Sequence
from itertools import product
import math
from typing import Any, NamedTuple

from icofabric_sim import checks
from icofabric_sim.checks import shown
from icofabric_sim.parameters.validation import (
    find_specification,
    make_parameters,
    ParameterError,
    Parameters,
)
from icofabric_sim.sweeps.values import (
    Name,
    parse_name,
    parse_values,
    Range,
    validated_value,
)
import numpy as np

SAMPLERS = ('sobol', 'halton', 'latin', 'random')
MAX_RUNS = 1_000_000
# Values that every run has. They change no result, and other values would give one run several
# keys.
FORCED: dict[str, Any] = {
    'solver.threads': 1, 'real_time_factor': 0.0, 'start_paused': False, 'record.path': '',
    'checkpoint.path': ''}


class Sample(NamedTuple):
    """Sampling method, count and seed for ranges without a count."""

    method: str
    point_count: int
    seed: int


class Plan(NamedTuple):
    """The runs of a sweep."""

    base: Parameters
    names: tuple[str, ...]  # varied parameters, columns of the table
    points: tuple[tuple[Any, ...], ...]  # values of each run; None: value of the base

    def changes(self, number: int) -> dict[str, Any]:
        """Parameters in which a run differs from the base."""
        found: dict[str, Any] = {}
        for text, value in zip(self.names, self.points[number]):
            if value is None:
                continue
            name = parse_name(text)
            if name.element is None:
                found[name.parameter] = value
            else:
                whole = list(found.get(name.parameter, _whole(self.base, name)))
                whole[name.element] = value
                found[name.parameter] = whole
        return found

    def parameters(self, number: int) -> Parameters:
        """All parameters of a run. Raise ParameterError that names the invalid parameter."""
        return make_parameters({**self.base.given(), **self.changes(number), **FORCED})

    def describe(self, number: int) -> str:
        """Return the values of a run, for a message."""
        words = ', '.join(
            f'{name} {value:.9g}' if isinstance(value, float) else f'{name} {shown(value)}'
            for name, value in zip(self.names, self.points[number]) if value is not None)
        return f'run {number} ({words})' if words else f'run {number}'


def make_plan(
    base: Parameters, *, vary: Mapping[str, Any] | None = None,
    cases: Sequence[Mapping[str, Any]] | None = None, sample: Any = None
) -> Plan:
    """Validate the variation. Raise ValueError that names the invalid parameter or argument."""
    given = {} if vary is None else dict(checks.mapping(
        'vary', vary, 'a dictionary of parameters and their values'))
    values = {name: parse_values(name, found) for name, found in given.items()}
    drawn = {name: found for name, found in values.items()
             if isinstance(found, Range) and found.value_count is None}
    wanted = _sample(sample, drawn)
    listed = {
        name: found.values(is_integer=parse_name(name).is_integer)
        if isinstance(found, Range) else found
        for name, found in values.items() if name not in drawn}
    together = _cases(cases)
    both = {name for case in together for name in case} & values.keys()
    if both:
        raise ValueError(f'cases: {min(both)} is also in vary; give it in one of them')
    names = [*dict.fromkeys(name for case in together for name in case), *listed, *drawn]
    _refuse_overlap(names)
    draws = [()] if wanted is None else draw(drawn, wanted)
    size = math.prod([max(len(together), 1), *map(len, listed.values()), len(draws)])
    if size > MAX_RUNS:
        raise ValueError(
            f'vary: {size:,} runs exceed the limit of {MAX_RUNS:,}; give fewer values')
    heads = [tuple(case.get(name) for name in names[:len(names) - len(values)])
             for case in together] or [()]
    points = tuple(
        (*head, *grid, *row) for head, grid, row in product(
            heads, product(*listed.values()), draws))
    return Plan(base, tuple(names), points)


def draw(ranges: Mapping[str, Range], sample: Sample) -> list[tuple[Any, ...]]:
    """Return sample points; except for `latin`, a small sample is a prefix of a larger one."""
    size = len(ranges)
    generator = np.random.default_rng(sample.seed)
    if sample.method == 'random':
        places = generator.random((sample.point_count, size))
    else:
        places = _points(sample, size)
    kinds = [parse_name(name).is_integer for name in ranges]
    return [
        tuple(one.at(float(place), is_integer=kind)
              for one, place, kind in zip(ranges.values(), row, kinds))
        for row in places.tolist()]


def _points(sample: Sample, size: int) -> np.ndarray:
    from scipy.stats import qmc
    kind = {'sobol': qmc.Sobol, 'halton': qmc.Halton, 'latin': qmc.LatinHypercube}[sample.method]
    generator = np.random.default_rng(sample.seed)
    try:
        engine = kind(d=size, rng=generator)
    except TypeError:
        # SciPy before 1.15.
        engine = kind(d=size, seed=generator)
    if sample.method == 'sobol':
        # SciPy warns of counts that are no power of two, because such samples are unbalanced.
        return np.asarray(engine.random_base2(
            math.ceil(math.log2(sample.point_count))))[:sample.point_count]
    return np.asarray(engine.random(sample.point_count))


def _sample(given: Any, drawn: Mapping[str, Range]) -> Sample | None:
    if given is None:
        if drawn:
            raise ValueError(
                f'vary: {next(iter(drawn))} has a range without a count: give one (0.1..0.7/13), '
                "or sample it: sample={'method': 'sobol', 'count': 64}")
        return None
    checks.mapping('sample', given, "a dictionary such as {'method': 'sobol', 'count': 64}")
    unknown = sorted(given.keys() - {'method', 'count', 'seed'})
    if unknown:
        raise ValueError(f'sample: unknown key {unknown[0]}; the keys are method, count and seed')
    if not drawn:
        raise ValueError('sample: vary needs at least one range without a count to sample from')
    method = checks.choice('sample: method', given.get('method', 'sobol'), SAMPLERS)
    if 'count' not in given:
        raise ValueError('sample: count, the number of points, is missing')
    count = checks.count('sample: count', given['count'], 1, MAX_RUNS)
    return Sample(method, count, checks.count('sample: seed', given.get('seed', 0), 0, 2**63 - 1))


def _cases(given: Any) -> list[dict[str, Any]]:
    if given is None:
        return []
    found = checks.items('cases', given, 'dictionaries of parameters and values')
    if not found:
        raise ValueError('cases must contain at least one dictionary of parameters and values')
    for number, case in enumerate(found):
        if not isinstance(case, Mapping) or not case:
            raise ValueError(
                f'cases: case {number} must be a dictionary of parameters and values, got '
                f'{shown(case)}')
    return [{name: validated_value(parse_name(name), value) for name, value in case.items()}
            for case in found]


def _refuse_overlap(names: Sequence[str]) -> None:
    """Refuse to vary a list together with one of its elements."""
    parsed = [parse_name(name) for name in names]
    whole = {name.parameter for name in parsed if name.element is None}
    for name in parsed:
        if name.element is not None and name.parameter in whole:
            raise ValueError(
                f'vary: {name.parameter} and {name.parameter}[{name.element}] cannot both vary')
        if name.parameter in FORCED:
            raise ParameterError(
                name.parameter,
                f'vary: {name.parameter} cannot vary: every run of a sweep uses '
                f'{FORCED[name.parameter]!r}, which does not change its result')


def _whole(base: Parameters, name: Name) -> list[Any]:
    """Return the full list of a parameter of which one element varies."""
    found = base.get(name.parameter, find_specification(name.parameter).default)
    return list(found)  # type: ignore[arg-type]
