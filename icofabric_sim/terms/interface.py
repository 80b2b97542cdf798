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
`external_force.py`
    `add_external_force` adds accelerations to slopes, and returns `given` plus the power [W] that
    comes from outside.
`tangent.py`
    `add_product` returns the product of the Hessian with a motion, with that of the term.
`bound.py`
    `add_bound` returns the bound of the squared frequency [1/s^2] and the energy [J] with those of
    the term. `add_limited_bound` has the magnitudes of tensions [N], too, and is called last: up
    to the `limit` [1/s^2] a coarse bound suffices.
`parameters.py`
    `PARAMETERS` and `GROUP_PARAMETERS`: rows of the table of parameters (name, default, unit,
    description, range), the second for `connector_groups.NAME`.

A term may change what another one has added. Its functions `change_NAME`, in the files of those
functions, directly follow those of the term NAME.

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

A load acts on the bodies of its rows of `Loads`, each for one block. Its record is a field of
`Loads`. Its files:

`record.py`
    As above.
`kick.py`
    `kick_row` changes velocities by the load over a time; `kick_row_again` directly after that;
    `add_row_slope` adds accelerations to slopes, and stores the power [W]. They return the number
    of the wrench of the row and the factor of its profile, which consecutive rows share.
`work.py`
    `work_row` adds the work [J] over a drift.
`path.py`
    `place_row` places bodies at a time, `stop_row` stops them before a drift to their place.
`reaction.py`
    `resist_row` returns accelerations without those along paths; `bear_row` restores the
    `velocities_before` the loads there. `resist_row_slope` and `keep_row_turning` do so in slopes.
`bound.py`
    `add_row_bound`, as `add_bound`.
`energy.py`
    `add_driven_energy` returns the kinetic energy [J] that paths supply, with that of the load.

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
        return self._kernels(self.files[name], name)

    def _kernels(self, file: str, name: str) -> tuple[Any, ...]:
        """Return the kernel of a file, or no kernel."""
        found = getattr(self.module(file), name, None) if self.has(file) else None
        return () if found is None else (found,)


class Term(Part):
    """A term of the equations of motion."""

    files = {
        'add_force': 'force', 'add_acceleration': 'acceleration',
        'add_velocity_force': 'velocity_force', 'add_bound': 'bound', 'add_limited_bound': 'bound',
        'add_product': 'tangent', 'add_external_force': 'external_force'}

    def __init__(
        self, name: str, *, energy: str = '', changes: Collection[str] = (),
        lacks: Collection[str] = ()
    ) -> None:
        """
        Name the folder, the part of the energy of a health check, and what does not compute it.

        `changes` names terms whose functions are followed by functions of this one.
        """
        super().__init__(name, lacks=lacks)
        self.energy, self.changes = energy, frozenset(changes)

    def changing(self, name: str, hook: str) -> tuple[Any, ...]:
        """Return the kernel that changes what the function of the term `name` has added."""
        return self._kernels(self.files[hook], f'change_{name}')


class Load(Part):
    """A load on the bodies of rows."""

    files = {
        'kick_row': 'kick', 'kick_row_again': 'kick', 'add_row_slope': 'kick',
        'work_row': 'work', 'place_row': 'path', 'stop_row': 'path', 'resist_row': 'reaction',
        'velocities_before': 'reaction', 'bear_row': 'reaction', 'resist_row_slope': 'reaction',
        'keep_row_turning': 'reaction', 'add_row_bound': 'bound', 'add_driven_energy': 'energy'}


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
