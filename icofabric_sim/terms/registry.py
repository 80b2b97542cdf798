# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
All terms of the equations of motion, in the order in which they are added, and connector laws.
"""

from icofabric_sim.terms.interface import Law, PLACES, Term

# Terms without a folder are in kernels/composition.py.
TERMS = (
    Term('links'),
    Term('wrapping', lacks=('ranks', 'GPU', 'implicit')),
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
)

# Laws of connectors that replace springs, in the order in which they are tried.
LAWS = (
    Law('tables', lacks=('GPU',)),
    Law('exponential'),
)


def support_rows() -> list[str]:
    """Return a row of a table for each term and law that some of `PLACES` lack."""
    return [
        f'| {part.name} | {", ".join(place for place in PLACES if place in part.lacks)} |'
        for part in (*TERMS, *LAWS) if part.lacks]
