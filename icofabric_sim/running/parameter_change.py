# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""One change of parameters, from its validation by a service to its effect on the run."""

from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import cached_property

from icofabric_sim.parameters.changes import changed_names, effect_of
from icofabric_sim.parameters.table import Change
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class ParameterChange:
    """Requested parameters with all changes accepted before, and the future of their outcome."""

    before: Parameters  # in force, or accepted and still being built
    after: Parameters
    scene: Scene | None = None  # of `after`, if its validation has built it
    # Completes with '' once `after` is in force, or with the reason why it cannot be.
    outcome: 'Future[str]' = field(default_factory=Future)
    number: int = 0  # order among the changes that need a build

    @cached_property
    def names(self) -> set[str]:
        """Names of the changed parameters."""
        return changed_names(self.before, self.after)

    @cached_property
    def effect(self) -> Change:
        """Most severe effect of the changed parameters."""
        return effect_of(self.before, self.after)

    @property
    def rebuilds(self) -> bool:
        """True if the change needs a new simulation, whether the motion is kept or not."""
        return self.effect in (Change.REBUILDS, Change.RESTARTS)

    def compared_with(self, before: Parameters) -> 'ParameterChange':
        """Return this change relative to other parameters, with the same outcome."""
        return self if before is self.before else replace(self, before=before)
