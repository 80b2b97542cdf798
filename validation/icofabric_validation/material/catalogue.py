# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""All parts of the material study, and their runs as studies in the sweep store."""

from collections.abc import Mapping
import os
from typing import Final

from icofabric_sim.parameters.validation import make_parameters
from icofabric_sim.sweeps.sweep import Study
from icofabric_validation.material.elastic import CONSTANTS, SLABS
from icofabric_validation.material.friction import FRICTION
from icofabric_validation.material.jamming import CHECK, JAM
from icofabric_validation.material.part import Part, Stage
from icofabric_validation.material.strength import FALL, STRENGTH
from icofabric_validation.material.surfaces import SURFACES
from icofabric_validation.material.waves import WAVES

PARTS: Final[Mapping[str, Part]] = {
    part.name: part for part in (
        CONSTANTS, SLABS, WAVES, SURFACES, JAM, FRICTION, STRENGTH, FALL, CHECK)}


def make_study(stage: Stage, store: str | os.PathLike[str]) -> Study:
    """Return the study of a stage, with validated parameters."""
    return Study.from_parameters(
        make_parameters(stage.base), cases=stage.cases, verbs=stage.verbs, keep=stage.keep,
        store=store)
