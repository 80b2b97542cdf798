# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Functions that call all terms one after another, composed from the registry of terms.

The source of such a function has a line for each term that has the hook. A line passes the record
of the term as a separate argument, because Numba omits an absent term only then, and further
arguments by the names of the parameters.
"""

from collections.abc import Iterator
import inspect
from typing import Any

from icofabric_sim.kernels.connectors import add_connectors
from icofabric_sim.kernels.contact.forces import add_contact
from icofabric_sim.kernels.contact.losses import add_taken, losses_of
from icofabric_sim.kernels.maxwell import add_maxwell
from icofabric_sim.kernels.moments import add_bending, add_twisting
from icofabric_sim.kernels.records import Model, State
from icofabric_sim.kernels.runtime.compiled import inlined
from icofabric_sim.kernels.viscous import add_damping
from icofabric_sim.kernels.wrap.forces import add_wrapping
from icofabric_sim.kernels.wrap.rates import add_wrapped_damping, creep_around
from icofabric_sim.terms.registry import TERMS

# Functions of terms that are not folders of `terms` yet, by term and hook.
_OTHERS: dict[tuple[str, str], tuple[Any, ...]] = {
    ('links', 'force'): (add_connectors,),
    ('wrapping', 'force'): (add_wrapping,),
    ('bending', 'force'): (add_bending,),
    ('twisting', 'force'): (add_twisting,),
    ('contacts', 'force'): (add_contact,),
    ('damping', 'velocity_force'): (add_damping, add_wrapped_damping),
    ('maxwell', 'velocity_force'): (add_maxwell, creep_around),
    ('contacts', 'velocity_force'): (add_taken,)}
# Quantities that parameters of terms name, besides fields of `Model` and `State`.
_QUANTITIES = {'alive': 'model.blocks.alive[block]', 'losses': 'losses_of(model.contacts)'}


def compose(name: str, hook: str, arguments: str, carried: str, *, energy: str = '') -> Any:
    """
    Return a kernel that calls the function of each term for a hook, in the order of the registry.

    Parameters
    ----------
    name
        Name of the kernel.
    hook
        Key of `HOOKS` of `terms/interface.py`.
    arguments
        Names of its arguments, separated by commas.
    carried
        Names of the values that each term returns; those after it receive them.
    energy
        Name of the part of the energy, for terms of that part alone.
    """
    functions: dict[str, Any] = {}
    lines = [f'def {name}({arguments}):']
    for term, function in _functions(hook, energy):
        known = f'{term}_{hook}' + '_' * sum(one.startswith(f'{term}_{hook}') for one in functions)
        functions[known] = function
        values = ', '.join(_values(function, f'{arguments}, {carried}'))
        lines.append(f'    {carried} = {known}({values})')
    lines.append(f'    return {carried}')
    namespace = {'__name__': __name__, 'losses_of': losses_of, **functions}
    exec(compile('\n'.join(lines) + '\n', __file__, 'exec'), namespace)
    return inlined(namespace[name])


def _functions(hook: str, energy: str) -> Iterator[tuple[str, Any]]:
    """Yield the names of terms and their functions for a hook."""
    for term in TERMS:
        if energy in ('', term.energy):
            for function in term.functions(hook) or _OTHERS.get((term.name, hook), ()):
                yield term.name, function


def _values(function: Any, arguments: str) -> Iterator[str]:
    """
    Yield expressions for the parameters of a function of a term.

    Raises TypeError for a parameter that names no quantity.
    """
    given = arguments.split(', ')
    for name in inspect.signature(getattr(function, 'py_func', function)).parameters:
        if name in given:
            yield name
        elif name in Model._fields:
            yield f'model.{name}'
        elif name in State._fields:
            yield f'state.{name}'
        elif name in _QUANTITIES:
            yield _QUANTITIES[name]
        else:
            raise TypeError(
                f'{function.__module__}.{function.__name__}: the parameter {name} is none of '
                f'{arguments}, {", ".join(_QUANTITIES)}, and no field of Model or State')
