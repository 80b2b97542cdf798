# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Parts of terms and of connector laws: files in a folder, each with one function or record.

A term or law without one of the files is absent from the functions that are composed of all
(composition.py). Files of a term, whose folder has the name of its field of `Model`:

`record.py`
    The record of its constants, a class named like the folder.
`force.py`
    `add_force` returns the wrench of a block, force [N] and torque [N m], with that of the term.
`acceleration.py`
    `add_acceleration` returns its accelerations [m/s^2], [rad/s^2] with those of the term.
`velocity_force.py`
    `add_velocity_force` adds accelerations to slopes, and returns `spent` plus the power [W] that
    the term dissipates.
`tangent.py`
    `add_product` returns the product of the Hessian with a motion, with that of the term.
`bound.py`
    `add_bound` returns the bound of the squared frequency [1/s^2] and the energy [J] with those of
    the term.

A law determines the tension of connectors instead of eq 1. Its record is a field of `Laws`.
Its files:

`record.py`
    As above; the fields are arrays of shape (12, s), by connectors at each body.
`law.py`
    `replace_factor`, `replace_pull`, `replace_slope`, `replace_largest_slope` and `replace_energy`
    return tension over length [N/m], tension [N], slopes [N/m] and energy [J] of connectors of a
    block, by the law where they follow it. `replace_alone` returns tension, energy and largest
    slope of one connector.
`curve.py`
    `make_curve` returns the law of some connectors for NumPy, a `Curve`; `rows` returns the fields
    of the record for several curves.
`parameters.py`
    `PARAMETERS`, which `connector.*` and `connector_groups.NAME.*` have for the law.
`device.py`
    `replace_pull`, `replace_slope` and `replace_energy` for Warp.

The first parameter of a function of kernels is the record of the term, or None if the scene lacks
the term. Numba then omits the code of the term. All other parameters are chosen by name: fields of
`Model` and `State`, and quantities of the function that calls the terms.
"""

from collections.abc import Collection
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

_FOLDER = Path(__file__).parent
# Ways of computing a scene that may lack a term: ranks of MPI, GPUs, implicit steps, methods with
# steps of one length.
PLACES = ('ranks', 'GPU', 'implicit', 'splitting')


class Part:
    """A folder of `terms`, whose files are imported on first use."""

    # Files of functions.
    files: dict[str, str]

    def __init__(self, name: str, *, lacks: Collection[str] = ()) -> None:
        """Name the folder, and those of `PLACES` that do not compute the term."""
        self.name, self.lacks = name, frozenset(lacks)
        assert self.lacks <= {*PLACES}

    def has(self, file: str) -> bool:
        """Check that the folder has a file."""
        return (_FOLDER / self.name / f'{file}.py').is_file()

    def module(self, file: str) -> Any:
        """Import and return a file."""
        return import_module(f'icofabric_sim.terms.{self.name}.{file}')

    @cached_property
    def record(self) -> type:
        """Class of the record."""
        kind: type = getattr(self.module('record'), self.name.capitalize())
        return kind

    def functions(self, name: str) -> tuple[Any, ...]:
        """Return the kernel of this name, or no kernel."""
        file = self.files[name]
        found = getattr(self.module(file), name, None) if self.has(file) else None
        return () if found is None else (found,)


class Term(Part):
    """A term of the equations of motion."""

    files = {
        'add_force': 'force', 'add_acceleration': 'acceleration',
        'add_velocity_force': 'velocity_force', 'add_bound': 'bound', 'add_product': 'tangent'}

    def __init__(self, name: str, *, energy: str = '', lacks: Collection[str] = ()) -> None:
        """
        Name the folder, the part of the energy of a health check, and what does not compute it.
        """
        super().__init__(name, lacks=lacks)
        self.energy = energy


class Law(Part):
    """A connector law."""

    files = dict.fromkeys((
        'replace_factor', 'replace_pull', 'replace_slope', 'replace_largest_slope',
        'replace_energy', 'replace_alone'), 'law')


class Curve(Protocol):
    """The law of some connectors, with stiffness k [N/m] and natural length D [m] of each."""

    @property
    def law(self) -> str:
        """Name of the law in the registry."""

    @property
    def text(self) -> str:
        """Description for messages."""

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest length [m] that the law describes."""

    @property
    def has_corners(self) -> bool:
        """True if the slope of the tension has corners."""

    def evaluate(
        self, length: 'np.ndarray', stiffness: 'np.ndarray', natural_length: 'np.ndarray'
    ) -> 'tuple[np.ndarray, np.ndarray]':
        """Return tensions [N] and energies [J] at lengths [m]."""

    def slope(
        self, length: 'np.ndarray', stiffness: 'np.ndarray', natural_length: 'np.ndarray'
    ) -> 'np.ndarray':
        """Return slopes of the tension [N/m] at lengths [m]."""
