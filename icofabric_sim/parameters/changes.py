# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Effect of a change from one parameter set to another on a run (the column `change` of the table).

The effect depends only on the two sets, so a recording that holds both can be simulated again.
"""

from collections.abc import Iterable

from icofabric_sim.parameters.table import Change
from icofabric_sim.parameters.validation import find_specification, ParameterError, Parameters

_BY_SEVERITY = tuple(Change)


def changed_names(before: Parameters, after: Parameters) -> set[str]:
    """Return the names whose values differ or that only one of the sets has."""
    return {name for name in {*before, *after} if before.get(name) != after.get(name)}


def affects_motion(name: str) -> bool:
    """Return True if the motion depends on the parameter, False if only its output does."""
    return find_specification(name).change in (Change.REBUILDS, Change.RESTARTS)


def effect_of(before: Parameters, after: Parameters) -> Change:
    """Return the most severe effect of the changed parameters."""
    names = changed_names(before, after)
    effects = [find_specification(name).change for name in names]
    # A drive starts with the motion, so a drive of other bodies needs a restart.
    driven = {f'groups.{after[f"drives.{name}.group"]}' for name in after.names('drives')}
    if names & driven:
        effects.append(Change.RESTARTS)
    return max(effects, key=_BY_SEVERITY.index, default=Change.AT_ONCE)


def rebuilds(before: Parameters, after: Parameters) -> bool:
    """Return True if the change needs a new simulation, whether the motion is kept or not."""
    return effect_of(before, after) in (Change.REBUILDS, Change.RESTARTS)


def restarts_motion(before: Parameters, after: Parameters) -> bool:
    """Return True if the new simulation starts from its initial state."""
    return effect_of(before, after) is Change.RESTARTS


def with_immediate_changes(current: Parameters, wanted: Parameters) -> Parameters:
    """Return the `current` set with those of the `wanted` values that need no new simulation."""
    changes = {
        name: wanted[name] for name in changed_names(current, wanted)
        if not affects_motion(name)}
    return current.with_changes(changes) if changes else current


def require_changeable(names: Iterable[str]) -> None:
    """Raise ParameterError if one of the parameters cannot change during a run."""
    for name in names:
        change = find_specification(name).change
        if change is Change.FIXED:
            raise ParameterError(
                name, f'{name} is {change.value}; start again with the other value')
