# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Times at which loads by expressions change, so that no step skips a short pulse.

A part of an expression that is linear in time, within a function, power or comparison, gives the
time at which it is zero. Parts of `abs`, `min`, `max` and `where` that are linear between such
times give more. Before and after a zero within a smooth function, the times where the expression
changes most, per octave of the distance, are added. A sine within another function gives its rate
instead.
"""

import ast
from typing import NamedTuple

from icofabric_sim.scene.expressions import Expression, VARIABLES
import numpy as np

_PERIODIC, _KINKED = ('sin', 'cos', 'tan'), ('abs', 'min', 'max', 'where')
# Distances from the zero of a part at which smooth functions are compared.
_OFFSETS_S = 2.0 ** np.arange(-34, 8)
_MAX_TIMES = 1000  # of one expression
_ROUND_OFF_RATIO = 1e-12


class CriticalTimes(NamedTuple):
    """Times at which steps end, and a rate that steps resolve."""

    times: np.ndarray  # (k,) [s] after the start of the motion, increasing, above 0
    rate: float  # [rad/s] of the fastest sine within another function; 0 without one


def critical_times(expression: Expression, position: np.ndarray) -> CriticalTimes:
    """
    Return the critical times of an expression at the places of bodies.

    Parameters
    ----------
    expression
        Components that may depend on place and time.
    position
        Places [m], (m, 3), world frame.

    Returns
    -------
    CriticalTimes
        Times at one of the places, and the largest rate; at most 1000 times, evenly chosen.
    """
    search = _Search(expression, position)
    if 't' in expression.variables:
        for source in expression.components:
            search.visit(ast.parse(source, mode='eval').body)
    found = np.unique(search.times[np.isfinite(search.times) & (search.times > _ROUND_OFF_RATIO)])
    if len(found):
        found = found[np.append(True, np.diff(found) > _ROUND_OFF_RATIO * found[1:])]
    if len(found) > _MAX_TIMES:
        found = found[np.linspace(0, len(found) - 1, _MAX_TIMES).astype(int)]
    return CriticalTimes(found, search.rate)


class _Search:
    """Search for the critical times of all parts of one expression."""

    def __init__(self, expression: Expression, position: np.ndarray) -> None:
        self.expression, self.place = expression, dict(zip('xyz', position.T))
        self.times, self.rate = np.zeros((0, len(position))), 0.0
        self.depth = 0  # number of functions around the present part

    def visit(self, node: ast.expr) -> bool:
        """Search a part; return True if it is linear in time between the known times."""
        if not _depends(node):
            return True
        match node:
            case ast.Name():
                return True
            case ast.UnaryOp(operand=operand):
                return self.visit(operand)
            case ast.BinOp(left=left, op=op, right=right):
                keeps = isinstance(op, (ast.Add, ast.Sub, ast.Mult)) or (
                    isinstance(op, ast.Div) and not _depends(right))
                linear = self.visit_all([left, right], inside=not keeps)
                if keeps and not (
                        isinstance(op, ast.Mult) and _depends(left) and _depends(right)):
                    return all(linear)
                self.add_zeros([left, right], linear, is_smooth=True)
            case ast.Call(func=ast.Name(id=name), args=args):
                return self.visit_call(name, args)
        return False

    def visit_all(self, parts: list[ast.expr], *, inside: bool) -> list[bool]:
        self.depth += inside
        linear = [self.visit(part) for part in parts]
        self.depth -= inside
        return linear

    def visit_call(self, name: str, args: list[ast.expr]) -> bool:
        parts = list(args)
        if isinstance(args[0], ast.Compare):
            parts[:1] = [args[0].left, args[0].comparators[0]]
        linear = self.visit_all(parts, inside=True)
        if name not in _KINKED:
            if name in _PERIODIC and linear[0] and self.depth:
                self.rate = max(self.rate, self.largest_slope(parts[0]))
            elif name not in _PERIODIC:
                self.add_zeros(parts, linear, is_smooth=True)
            return False
        # The two sides are compared.
        sides = parts[:2] if name != 'abs' else [parts[0], ast.Constant(0.0)]
        self.add_zeros(
            [ast.BinOp(sides[0], ast.Sub(), sides[1])], [all(linear[:2])], is_smooth=False)
        return all(linear)

    def add_zeros(self, parts: list[ast.expr], linear: list[bool], *, is_smooth: bool) -> None:
        """Add the times at which the linear ones of some parts are zero."""
        for part, is_linear in zip(parts, linear):
            if not (is_linear and _depends(part)):
                continue
            first, second, start, end = self.segments()
            one, other = self.values(part, first), self.values(part, second)
            with np.errstate(all='ignore'):
                zero = first - one * (second - first) / (other - one)
            zero[~((start <= zero) & (zero <= end))] = np.nan
            self.times = np.sort(np.concatenate([self.times, zero]), axis=0)
            if is_smooth:
                for row in zero[np.isfinite(zero).any(axis=1)]:
                    self.add_neighbours(row)

    def add_neighbours(self, zero: np.ndarray) -> None:
        """Add the times before and after (m,) zeros at which the expression changes most."""
        for sign in (-1.0, 1.0):
            times = zero + sign * _OFFSETS_S[:, None]
            change = np.nan_to_num(np.abs(np.diff(self.expression.values(
                t=times, **self.place), axis=1)).sum(axis=0))
            largest = np.take_along_axis(times, change.argmax(axis=0)[None], axis=0)
            self.times = np.sort(np.concatenate([self.times, largest]), axis=0)

    def segments(self) -> tuple[np.ndarray, ...]:
        """Return two times within each interval between known times, its start and its end."""
        known = self.times[np.isfinite(self.times).any(axis=1)]
        if not len(known):
            known = np.zeros((1, self.times.shape[1]))
        start, end = known[:-1], known[1:]
        ends = np.full((1, known.shape[1]), np.inf)
        return (
            np.concatenate([known[:1] - 2.0, 0.75 * start + 0.25 * end, known[-1:] + 1.0]),
            np.concatenate([known[:1] - 1.0, 0.25 * start + 0.75 * end, known[-1:] + 2.0]),
            np.concatenate([-ends, known]), np.concatenate([known, ends]))

    def largest_slope(self, part: ast.expr) -> float:
        first, second, *_ = self.segments()
        with np.errstate(all='ignore'):
            slope = (self.values(part, second) - self.values(part, first)) / (second - first)
        return float(np.abs(slope[np.isfinite(slope)]).max(initial=0.0))

    def values(self, part: ast.expr, times: np.ndarray) -> np.ndarray:
        source = ast.unparse(ast.fix_missing_locations(part))
        return Expression(self.expression.name, (source,), VARIABLES).values(
            t=times, **self.place)[0]


def _depends(node: ast.AST) -> bool:
    """Return True if a part depends on time."""
    return any(isinstance(part, ast.Name) and part.id == 't' for part in ast.walk(node))
