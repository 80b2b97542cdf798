# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
All terms of the equations of motion, in the order in which they are added, loads and laws.
"""

from typing import Any

from icofabric_sim.terms.interface import Law, Load, PLACES, Term

# Terms without a folder are in kernels/composition.py.
TERMS = (
    Term('links'),
    Term('ties', energy='moments', lacks=('ranks', 'GPU', 'implicit')),
    Term(
        'wrapping', energy='wrapped', changes=('damping', 'maxwell'),
        lacks=('ranks', 'GPU', 'implicit')),
    Term('bending', energy='moments'),
    Term('twisting', energy='moments'),
    Term('dipole', energy='fields', lacks=('implicit',)),
    Term('coulomb', energy='fields', lacks=('ranks', 'GPU', 'implicit')),
    Term('damping', lacks=('splitting',)),
    Term('maxwell', energy='arms', lacks=('GPU', 'implicit', 'splitting')),
    Term('drag', lacks=('splitting',)),
    Term('contacts'),
    Term('magnet', lacks=('GPU', 'implicit', 'splitting')),
    Term('gravity'),
    Term('body_force', lacks=PLACES),
)

# Loads on named bodies, in rows (terms/loads.py), in the order in which they are tried.
LOADS = (
    Load('tractions'),
    Load('wrenches'),
    Load('anchors'),
    Load('drives'),
    Load('platens', lacks=('ranks', 'GPU', 'implicit')),
)

# Laws of connectors that replace springs, in the order in which they are tried.
LAWS = (
    Law('tables', lacks=('GPU',)),
    Law('exponential'),
)


def changes_of(term: Term, hook: str) -> tuple[Any, ...]:
    """Return the functions of other terms that change what a function of a term has added."""
    return tuple(
        function for other in TERMS if term.name in other.changes
        for function in other.changing(term.name, hook))


def support_rows() -> list[str]:
    """Return a row of a table for each term, load and law that some of `PLACES` lack."""
    return [
        f'| {part.name} | {", ".join(place for place in PLACES if place in part.lacks)} |'
        for part in (*TERMS, *LOADS, *LAWS) if part.lacks]
