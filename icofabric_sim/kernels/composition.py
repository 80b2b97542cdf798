# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels that call all terms of the registry one after another."""

from typing import Any

from icofabric_sim.kernels.connectors import add_connectors
from icofabric_sim.kernels.contact.forces import add_contact
from icofabric_sim.kernels.contact.losses import add_taken, losses_of
from icofabric_sim.kernels.records import Model, State
from icofabric_sim.kernels.wrap.forces import add_wrapping
from icofabric_sim.kernels.wrap.rates import add_wrapped_damping, creep_around
from icofabric_sim.terms.composition import compose
from icofabric_sim.terms.registry import TERMS

# Functions outside `terms`, by term and hook, called after those of the folder.
_OTHERS: dict[tuple[str, str], tuple[Any, ...]] = {
    ('links', 'add_force'): (add_connectors,),
    ('wrapping', 'add_force'): (add_wrapping,),
    ('contacts', 'add_force'): (add_contact,),
    ('damping', 'add_velocity_force'): (add_wrapped_damping,),
    ('maxwell', 'add_velocity_force'): (creep_around,),
    ('contacts', 'add_velocity_force'): (add_taken,)}
# Quantities that parameters of terms name, besides fields of `Model` and `State`.
_EXPRESSIONS = {
    **{name: f'model.{name}' for name in Model._fields},
    **{name: f'state.{name}' for name in State._fields},
    'alive': 'model.blocks.alive[block]', 'losses': 'losses_of(model.contacts)'}


def compose_terms(hook: str, arguments: str, carried: str, *, energy: str = '') -> Any:
    """
    Return a kernel that calls the function of each term for a hook, in their order.

    `arguments` and `carried`: see `compose`. `energy` selects terms of that part of the energy.
    """
    return compose(
        f'{hook}_{energy}' if energy else hook, [
            (term.name, function) for term in TERMS if energy in ('', term.energy)
            for function in (*term.functions(hook), *_OTHERS.get((term.name, hook), ()))],
        arguments, carried, _EXPRESSIONS, helpers={'losses_of': losses_of})
