# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels that call all terms of the registry one after another."""

from typing import Any

from icofabric_sim.kernels.records import Model, State
from icofabric_sim.terms.composition import compose
from icofabric_sim.terms.loads import Loads
from icofabric_sim.terms.registry import changes_of, LOADS, TERMS

# Quantities that parameters of terms name, besides fields of `Model` and `State`.
_EXPRESSIONS = {
    **{name: f'model.{name}' for name in Model._fields},
    **{name: f'state.{name}' for name in State._fields},
    'alive': 'model.blocks.alive[block]'}


def compose_terms(hook: str, arguments: str, carried: str, *, energy: str = '') -> Any:
    """
    Return a kernel that calls the function of each term for a hook, in their order.

    `arguments` and `carried`: see `compose`. `energy` selects terms of that part of the energy.
    """
    return compose(
        f'{hook}_{energy}' if energy else hook, [
            (term.name, function) for term in TERMS if energy in ('', term.energy)
            for function in (*term.functions(hook), *changes_of(term, hook))],
        arguments, carried, _EXPRESSIONS)


def compose_loads(hook: str, arguments: str, carried: str = '') -> Any:
    """Return a kernel that calls the function of each load for a hook, see `compose`."""
    return compose(
        hook, [(load.name, function) for load in LOADS for function in load.functions(hook)],
        arguments, carried, _EXPRESSIONS | {name: f'loads.{name}' for name in Loads._fields})
