# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Parts of a term: files in its folder, each with one function or record.

The name of the folder is the name of the field of `Model` that holds the record of the term. A
term without one of the files is absent from the function that is composed of them.

`record.py`
    The record of its constants, a class named like the folder.
`force.py`
    `add_force` returns the wrench of a block, force [N] and torque [N m], with that of the term.
`acceleration.py`
    `add_acceleration` returns its accelerations [m/s^2], [rad/s^2] with those of the term.
`velocity_force.py`
    `add_velocity_force` adds accelerations to slopes, and returns `spent` plus the power [W] that
    the term dissipates.
`bound.py`
    `add_bound` returns the bound of the squared frequency [1/s^2] and the energy [J] with those of
    the term.

The first parameter of such a function is the record of the term, or None if the scene lacks the
term. Numba then omits the code of the term. All other parameters are chosen by name: fields of
`Model` and `State`, and quantities of the function that calls the terms (kernels/composition.py).
"""

from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

_FOLDER = Path(__file__).parent


class Hook(NamedTuple):
    """A function that terms may have."""

    file: str
    function: str


HOOKS = {
    'force': Hook('force', 'add_force'),
    'acceleration': Hook('acceleration', 'add_acceleration'),
    'velocity_force': Hook('velocity_force', 'add_velocity_force'),
    'bound': Hook('bound', 'add_bound')}


class Term:
    """A term, whose files are imported on first use."""

    def __init__(self, name: str, *, energy: str = '') -> None:
        """
        Name the folder of the term, which is its field of `Model`, and the part of the energy.

        `energy` is the part of the energy of a health check that includes that of the term.
        """
        self.name, self.energy = name, energy

    def has(self, file: str) -> bool:
        """Check that the term has a file."""
        return (_FOLDER / self.name / f'{file}.py').is_file()

    def module(self, file: str) -> Any:
        """Import and return a file of the term."""
        return import_module(f'icofabric_sim.terms.{self.name}.{file}')

    @cached_property
    def record(self) -> type:
        """Class of the record."""
        kind: type = getattr(self.module('record'), self.name.capitalize())
        return kind

    def functions(self, hook: str) -> tuple[Any, ...]:
        """Return the function of the term for a hook, or no function."""
        file, name = HOOKS[hook]
        return (getattr(self.module(file), name),) if self.has(file) else ()
