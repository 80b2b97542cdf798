# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Functions that let each law of the registry replace numbers of the springs that follow that law.
"""

from typing import Any

from icofabric_sim.kernels.records import Laws
from icofabric_sim.terms.composition import compose
from icofabric_sim.terms.registry import LAWS


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
