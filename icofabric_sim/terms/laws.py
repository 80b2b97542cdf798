# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Laws of connectors: their records, and functions that let each replace numbers of springs."""

from typing import Any

from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.terms.composition import compose
from icofabric_sim.terms.registry import LAWS


class Laws(Record, parts={law.name: law.record for law in LAWS}):
    """Laws that replace springs, those of the registry; None: no connector follows it."""


def _compose(hook: str, arguments: str, carried: str) -> Any:
    """Return a kernel that calls the function of each law for a hook, if there are laws."""
    return compose(
        hook, [(law.name, function) for law in LAWS for function in law.functions(hook)],
        f'laws, variety, link, s, {arguments}, {carried}', carried,
        {name: f'laws.{name}' for name in Laws._fields}, unless='laws')


replace_factor = _compose('replace_factor', 'square, there', 'factor')
replace_pull = _compose('replace_pull', 'length', 'pull')
replace_slope = _compose('replace_slope', 'length', 'slope')
replace_largest_slope = _compose('replace_largest_slope', 'length', 'slope')
replace_energy = _compose('replace_energy', 'length', 'energy')
replace_alone = _compose('replace_alone', 'length', 'law')
