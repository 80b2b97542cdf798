# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
What may end a step; each module of this folder is a kind of event, and no list names them.

A module has `why(scene)`, a sentence on why a scene needs steps that end where it happens ('': it
does not), and `make(pieces, step)`, which returns the locator; None where a run has none.
"""

from importlib import import_module
import pkgutil
from typing import Any

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.stepping.pieces import EventLocator, Pieces
from icofabric_sim.simulation.stepping.step_in_progress import StepInProgress


def events() -> list[Any]:
    """Return the modules of all events, by name."""
    names = sorted(module.name for module in pkgutil.iter_modules(__path__))
    return [import_module(f'{__name__}.{name}') for name in names]


def why_events(scene: Scene) -> str:
    """Say why the scene needs steps that end where an event happens; '': it does not."""
    return next((why for module in events() if (why := module.why(scene))), '')


def make_events(pieces: Pieces, step: StepInProgress) -> list[EventLocator]:
    """Return the locators of a run, which search the `step` in progress."""
    made = [module.make(pieces, step) for module in events()]
    return [event for event in made if event is not None]
