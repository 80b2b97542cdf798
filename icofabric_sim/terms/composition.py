# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Kernels that call functions of terms one after another.

The source of such a kernel has a line for each function. A line passes the record of the term as a
separate argument, because Numba omits an absent term only then, and the other arguments by the
names of the parameters.
"""

from collections.abc import Iterable, Iterator, Mapping
import inspect
from typing import Any

from icofabric_sim.kernels.runtime.compiled import in_python, inlined

# Names of all composed kernels.
_NAMES: set[str] = set()


def compose(
    name: str, functions: Iterable[tuple[str, Any]], arguments: str, carried: str,
    known: Mapping[str, str], *, unless: str = ''
) -> Any:
    """
    Return a kernel that calls `functions` in their order.

    Parameters
    ----------
    name
        Name of the kernel.
    functions
        Names of terms with a function of each.
    arguments
        Names of the arguments of the kernel, separated by commas.
    carried
        Names of the values that each function returns, and receives if a parameter names them. A
        function that is annotated to return None changes none of them.
    known
        Expressions for parameters that are no arguments of the kernel.
    unless
        Name of an argument that is None if no term is present.

    Raises
    ------
    TypeError
        If a parameter of a function is neither an argument nor in `known`.
    ValueError
        If there is a kernel of this name, which the cache on disk would not tell from this one.
    """
    if name in _NAMES:
        raise ValueError(f'a kernel {name} has been composed')
    _NAMES.add(name)
    namespace: dict[str, Any] = {'__name__': __name__}
    lines = []
    for term, function in functions:
        call = f'{term}_{name}'
        while call in namespace:
            call += '_'
        namespace[call] = function
        values = ', '.join(_values(function, f'{arguments}, {carried}'.split(', '), known))
        returned = '' if _returns_nothing(function) else f'{carried} = '
        lines.append(f'{returned}{call}({values})')
    lines.append(f'return {carried}')
    if unless:
        lines = [
            f'if {unless} is None:', f'    return {carried}', 'else:',
            *(f'    {line}' for line in lines)]
    source = '\n    '.join([f'def {name}({arguments}):', *lines])
    exec(compile(source, __file__, 'exec'), namespace)
    return inlined(namespace[name])


def _returns_nothing(function: Any) -> bool:
    """Check that a function is annotated to return None."""
    return inspect.get_annotations(in_python(function)).get('return', '') is None


def _values(
    function: Any, arguments: Iterable[str], known: Mapping[str, str]
) -> Iterator[str]:
    """Yield expressions for the parameters of a function."""
    for name in inspect.signature(in_python(function)).parameters:
        if name not in arguments and name not in known:
            raise TypeError(
                f'{function.__module__}.{function.__name__}: the parameter {name} is none of '
                f'{", ".join([*arguments, *known])}')
        yield name if name in arguments else known[name]
