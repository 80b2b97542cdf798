# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Removal of record terms that a kernel does not read, so that scenes share compiled kernels.

Numba compiles a kernel for each type of its records, and the type encodes which fields are None.
"""

from typing import Generic, TypeVar

from icofabric_sim.kernels.records import Record
from icofabric_sim.terms import registry as terms

Kind = TypeVar('Kind', bound=Record)

# Terms of a model that springs and moments of connectors do not depend on.
BESIDE_CONNECTORS = ('shells', 'masses', 'gyration', *(
    term.name for term in terms.TERMS if term.has('record') and term.name != 'gravity'
    and (term.energy == 'fields' or not term.has('tangent'))))
# Terms of a model that accelerations do not depend on, apart from loads and losses.
BESIDE_ACCELERATIONS = ('shells', 'masses', *(
    term.name for term in terms.TERMS if term.has('record') and term.has('velocity_force')
    and not term.has('force') and not term.has('bound')))
# All terms of a model except gravity and supports, which never change its type.
TERMS = ('links', 'bending', 'twisting', *BESIDE_CONNECTORS)
# Loads other than the paths of drives.
BESIDE_DRIVES = ('varying', 'tractions', 'anchors')


def without(record: Kind, *names: str) -> Kind:
    """Return the record with these fields set to None; the same object if they are None."""
    there = [name for name in names if getattr(record, name) is not None]
    return record._replace(**dict.fromkeys(there)) if there else record


class Without(Generic[Kind]):
    """Callable form of `without` that remembers the last record."""

    def __init__(self, *names: str) -> None:
        """Set these fields to None."""
        self._names = names
        self._last: tuple[Kind, Kind] | None = None

    def __call__(self, record: Kind) -> Kind:
        """Return the record without the fields."""
        last = self._last
        if last is None or last[0] is not record:
            self._last = last = record, without(record, *self._names)
        return last[1]
