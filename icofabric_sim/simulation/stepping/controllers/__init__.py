# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The step-size controllers; each module of this folder is one, and no list names them.

A module has `RANK`, `suits(choice)` and `make(pieces, choice)`. Of those that suit a run the one
of the highest rank is taken.
"""

from importlib import import_module
import pkgutil
from typing import Any

from icofabric_sim.simulation.stepping.pieces import Pieces, StepChoice, StepController


def controllers() -> list[Any]:
    """Return the modules of all controllers, by name."""
    names = sorted(module.name for module in pkgutil.iter_modules(__path__))
    return [import_module(f'{__name__}.{name}') for name in names]


def make_controller(pieces: Pieces, choice: StepChoice) -> StepController:
    """Return the controller that suits `choice`, of those that do the one of the highest rank."""
    suited = [module for module in controllers() if module.suits(choice)]
    controller: StepController = max(suited, key=lambda module: module.RANK).make(pieces, choice)
    return controller
