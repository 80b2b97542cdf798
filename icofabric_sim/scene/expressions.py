# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Expressions of place and time in parameters, such as `0, 0, 2*sin(2*pi*t)*exp(-x/0.1)`.

A text is parsed and checked against lists of operators, functions and names. Terms without a
variable become numbers. The checked expression is printed as the source of a function, so that
NumPy and compiled code evaluate the same formula.
"""

import ast
from collections.abc import Callable, Collection, Mapping
import keyword
import math
import operator
from typing import Any, NamedTuple, NoReturn

from icofabric_sim.parameters.validation import ParameterError, Parameters
import numpy as np

Function = Callable[..., tuple[Any, ...]]
# Arguments of the function of every expression.
VARIABLES = ('x', 'y', 'z', 't', 'xi', 'eta', 's')
_NUMBERS = {'pi': math.pi, 'e': math.e}
_MAX_LENGTH = 2000  # characters
_OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
    ast.Div: operator.truediv, ast.Pow: operator.pow, ast.USub: operator.neg,
    ast.UAdd: operator.pos, ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt,
    ast.GtE: operator.ge}


def _choose(condition: Any, first: Any, second: Any) -> Any:
    return first if condition else second


def _smaller(first: Any, second: Any) -> Any:
    """Return the smaller number, or NaN if one is NaN, as NumPy does."""
    return first if first < second or first != first else second


def _larger(first: Any, second: Any) -> Any:
    return first if first > second or first != first else second


# Functions of numbers, and the number of their arguments.
SCALAR_FUNCTIONS: dict[str, Callable[..., Any]] = {
    'abs': abs, 'min': _smaller, 'max': _larger, 'where': _choose, **{
        name: getattr(math, name) for name in (
            'sqrt', 'exp', 'log', 'sin', 'cos', 'tan', 'asin', 'acos', 'atan', 'atan2', 'sinh',
            'cosh', 'tanh', 'hypot')}}
_ARGUMENT_COUNTS = {'min': 2, 'max': 2, 'where': 3, 'atan2': 2, 'hypot': 2}
_ARRAY_FUNCTIONS = {
    **{name: getattr(np, name) for name in SCALAR_FUNCTIONS if hasattr(np, name)},
    'min': np.minimum, 'max': np.maximum, 'asin': np.arcsin, 'acos': np.arccos,
    'atan': np.arctan, 'atan2': np.arctan2}


class Expression(NamedTuple):
    """A checked expression of one or several components."""

    name: str  # of the parameter
    components: tuple[str, ...]  # sources
    variables: tuple[str, ...]  # that the components depend on

    def function(self, functions: Mapping[str, Callable[..., Any]]) -> Function:
        """Return a function of all `VARIABLES`, with these `functions`, that returns a tuple."""
        namespace: dict[str, Any] = {'__builtins__': {}, **functions}
        source = (
            f'def expression({", ".join(VARIABLES)}):\n    return ({", ".join(self.components)},)')
        exec(compile(source, f'<{self.name}>', 'exec'), namespace)
        function: Function = namespace['expression']
        return function

    def values(self, **arrays: np.ndarray) -> np.ndarray:
        """Return the components for arrays of its variables; not finite where undefined."""
        function = self.function(_ARRAY_FUNCTIONS)
        with np.errstate(all='ignore'):
            found = function(*(np.asarray(arrays.get(name, 0.0)) for name in VARIABLES))
        return np.stack(np.broadcast_arrays(*found, *arrays.values())[:len(found)]).astype(float)


def make_expression(
    parameters: Parameters, name: str, variables: Collection[str], counts: Collection[int]
) -> Expression | None:
    """
    Return the expression of the parameter `name`; None if the text is empty.

    `variables` are those that the expression may contain, `counts` its possible numbers of
    components. Raises ParameterError with the column of an error.
    """
    text = parameters[name]
    if not text.strip():
        return None
    checker = _Checker(name, text, variables, check_constants(parameters))
    if len(text) > _MAX_LENGTH:
        checker.fail(f'has {len(text):,} characters, and at most {_MAX_LENGTH:,} are allowed')
    if '#' in text:
        checker.fail('comments are not allowed', text.index('#') + 1)
    # Line breaks count as blanks.
    plain = text.replace('\n', ' ')
    checker.shift = len(plain) - len(plain.lstrip())
    try:
        tree = ast.parse(plain.strip(), mode='eval').body
        parts = tree.elts if isinstance(tree, ast.Tuple) else [tree]
        if len(parts) not in counts:
            checker.fail(
                f'must have {" or ".join(map(str, counts))} components separated by commas, and '
                f'has {len(parts)}')
        sources = tuple(ast.unparse(_node(checker.checked(part))) for part in parts)
    except SyntaxError as error:
        checker.fail(f'{error.msg}', error.offset)
    except ParameterError:
        raise
    except (RecursionError, MemoryError, ValueError):
        checker.fail('is nested too deeply, or has a character that is not allowed')
    return Expression(name, sources, tuple(sorted(checker.used)))


def check_constants(parameters: Parameters) -> dict[str, float]:
    """Return the constants that expressions may contain, with those of `constants.NAME`."""
    found = dict(_NUMBERS)
    for name in parameters.names('constants'):
        if name in (*VARIABLES, *SCALAR_FUNCTIONS, *_NUMBERS) or keyword.iskeyword(name):
            raise ParameterError(
                f'constants.{name}', f'constants.{name}: {name!r} has a meaning in expressions; '
                'choose another name')
        found[name] = parameters[f'constants.{name}']
    return found


class _Checker:
    """Checker of the parts of one expression; constant parts become numbers."""

    def __init__(
        self, name: str, text: str, variables: Collection[str], constants: Mapping[str, float]
    ) -> None:
        self.name, self.text, self.variables, self.constants = name, text, variables, constants
        self.used: set[str] = set()
        self.shift = 0  # blanks before the text

    def fail(self, what: str, column: int | None = None) -> NoReturn:
        where = '' if column is None else f' in column {self.shift + column}'
        shown = self.text if len(self.text) <= 80 else f'{self.text[:77]}...'
        raise ParameterError(
            self.name,
            f'{self.name} {shown!r}: {what}{where}; allowed are numbers, + - * / **, the '
            f'functions {", ".join(SCALAR_FUNCTIONS)}, the variables {", ".join(self.variables)} '
            f'and the constants {", ".join(self.constants)} (constants.NAME defines more)')

    def checked(self, node: ast.expr) -> ast.expr | float:
        """Return a checked copy of a part that is a number, or its value if it is constant."""
        match node:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                return self.computed(node, float, value)
            case ast.Name(id=name) if name in self.variables:
                self.used.add(name)
                return node
            case ast.Name(id=name) if name in self.constants:
                return self.constants[name]
            case ast.Name(id=name):
                self.fail(f'unknown name {name!r}', node.col_offset + 1)
            case ast.UnaryOp(op=ast.USub() | ast.UAdd() as sign, operand=operand):
                part = self.checked(operand)
                if isinstance(part, float):
                    return self.computed(node, _OPERATORS[type(sign)], part)
                return ast.UnaryOp(sign, part)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                parts = [self.checked(left), self.checked(right)]
                if _are_numbers(parts):
                    return self.computed(node, _OPERATORS[type(op)], *parts)
                if isinstance(op, ast.Div) and parts[1] == 0.0:
                    self.fail('division by zero', node.col_offset + 1)
                return ast.BinOp(_node(parts[0]), op, _node(parts[1]))
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if (
                    name in SCALAR_FUNCTIONS):
                return self.call(node, name, args)
        self.fail(f'{ast.unparse(node)!r} is not allowed', node.col_offset + 1)

    def call(self, node: ast.expr, name: str, args: list[ast.expr]) -> ast.expr | float:
        count = _ARGUMENT_COUNTS.get(name, 1)
        if len(args) != count:
            self.fail(
                f'{name} takes {count} argument{"s" if count > 1 else ""}, not {len(args)},',
                node.col_offset + 1)
        conditions = [self.condition(args[0])] if name == 'where' else []
        parts = conditions + [self.checked(part) for part in args[len(conditions):]]
        if _are_numbers(parts):
            return self.computed(node, SCALAR_FUNCTIONS[name], *parts)
        return ast.Call(ast.Name(name, ast.Load()), [_node(part) for part in parts], [])

    def condition(self, node: ast.expr) -> ast.expr | float:
        """Return a checked comparison, or 1.0 or 0.0 if it is constant."""
        match node:
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _OPERATORS:
                parts = [self.checked(left), self.checked(right)]
                if _are_numbers(parts):
                    return float(_OPERATORS[type(op)](*parts))
                return ast.Compare(_node(parts[0]), [op], [_node(parts[1])])
        self.fail(
            'the first argument of where must be a comparison by < <= > or >=',
            node.col_offset + 1)

    def computed(
        self, node: ast.expr, function: Callable[..., Any], *parts: Any
    ) -> float:
        """Return the value of a constant part."""
        try:
            value = function(*parts)
        except ZeroDivisionError:
            self.fail('division by zero', node.col_offset + 1)
        except (ValueError, OverflowError):
            value = math.nan
        if isinstance(value, complex) or not math.isfinite(value):
            self.fail(f'{ast.unparse(node)} is not a finite number', node.col_offset + 1)
        return float(value)


def _are_numbers(parts: list[ast.expr | float]) -> bool:
    return all(isinstance(part, float) for part in parts)


def _node(part: ast.expr | float) -> ast.expr:
    """Return the node of a part; a negative number has a sign, so that powers keep its value."""
    if not isinstance(part, float):
        return part
    number = ast.Constant(abs(part))
    return ast.UnaryOp(ast.USub(), number) if math.copysign(1.0, part) < 0.0 else number
