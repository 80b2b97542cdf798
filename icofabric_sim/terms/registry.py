# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
All terms of the equations of motion, in the order in which they are added, and connector laws.
"""

from icofabric_sim.terms.interface import Law, Term

# Terms without a folder are in kernels/composition.py.
TERMS = (
    Term('links'),
    Term('wrapping'),
    Term('bending'),
    Term('twisting'),
    Term('dipole', energy='fields'),
    Term('coulomb', energy='fields'),
    Term('damping'),
    Term('maxwell'),
    Term('drag'),
    Term('contacts'),
    Term('magnet'),
    Term('gravity'),
)

# Laws of connectors that replace springs, in the order in which they are tried.
LAWS = (
    Law('tables'),
    Law('exponential'),
)
