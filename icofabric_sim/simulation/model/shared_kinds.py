# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
Records without the terms that a kernel does not read, so that kinds of scenes share it.

The type of a record says which of its fields are None, and each type is compiled for.
"""

from typing import Generic, TypeVar

from icofabric_sim.kernels.records import Record

Kind = TypeVar('Kind', bound=Record)

# Terms of a model that neither springs nor moments of connectors depend on.
BESIDE_CONNECTORS = (
    'damping', 'drag', 'magnet', 'dipole', 'coulomb', 'shells', 'wrapping', 'contacts', 'masses',
    'maxwell', 'gyration')
# Terms without which it has the same accelerations, loads and losses apart.
BESIDE_ACCELERATIONS = ('damping', 'drag', 'magnet', 'shells', 'masses')
# All terms of a model but gravity and supports, which are of its type in any case.
TERMS = ('links', 'bending', 'twisting', *BESIDE_CONNECTORS)
# What acts and is not the path of a drive.
BESIDE_DRIVES = ('varying', 'tractions', 'anchors')


def without(record: Kind, *names: str) -> Kind:
    """Return the record with these fields None; itself where they are."""
    there = [name for name in names if getattr(record, name) is not None]
    return record._replace(**dict.fromkeys(there)) if there else record


class Without(Generic[Kind]):
    """The same of one record after another, each of which is asked for often."""

    def __init__(self, *names: str) -> None:
        """Leave out these fields."""
        self._names = names
        self._last: tuple[Kind, Kind] | None = None

    def __call__(self, record: Kind) -> Kind:
        """Return it without them."""
        last = self._last
        if last is None or last[0] is not record:
            self._last = last = record, without(record, *self._names)
        return last[1]
