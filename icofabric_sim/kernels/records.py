# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Records that kernels take: packed constants, the evolving state, the inputs.

Arrays have their slots last: slot s of a body is its index in all of them (layout.py). Bodies that
are computed together are therefore adjacent. A term that a scene lacks is None and not compiled.
If its class has a method `absent`, the term is compiled and skipped at run time.
"""

from typing import Any, TYPE_CHECKING

from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.kernels.runtime.team import Sweep as Sweep
from icofabric_sim.kernels.runtime.team import Team as Team
from icofabric_sim.terms.body_force.external_force import External
from icofabric_sim.terms.gyration import Gyration
from icofabric_sim.terms.interface import Term
from icofabric_sim.terms.links.kinks import Kinks
from icofabric_sim.terms.loads import Loads as Loads
from icofabric_sim.terms.masses import Masses
from icofabric_sim.terms.meters import Meter
from icofabric_sim.terms.registry import TERMS
from icofabric_sim.terms.shared import Blocks, Links, Supports, Trail
from icofabric_sim.terms.shared import State as State
from icofabric_sim.terms.shells import Shells
import numpy as np


class Moments(Record):
    """Bending and twisting by connectors; stiffnesses have shape (c,), or (1,) for all alike."""

    bodies: np.ndarray  # (c, 2) int32
    bending: np.ndarray  # [N m/rad]
    twisting: np.ndarray  # [N m/rad]
    # (c, 3) in the weave, from the first end, unit vectors: in body axes, or world axes where
    # woven orientations differ. The energy then takes rotations since then for orientations.
    direction: np.ndarray
    woven: np.ndarray | None  # (n, 4) woven orientations, where they differ


class Breakage(Record):
    """
    Lengths at which the connectors at each body break (eq 3), and arrays to detect the moment.

    Rows are (12, s), as those of a `Variety`.
    """

    longest: np.ndarray  # L_e [m], infinite: never
    shortest: np.ndarray  # L_c [m], 0: never
    length: np.ndarray  # [m] at the start of the step in progress, then at its end
    rate: np.ndarray  # [m/s] likewise
    excess: np.ndarray  # [m] beyond a limit within the last step, about; below 0: not reached
    moving: np.ndarray  # (18 s,) velocities [m/s] of the attachment points


class SecondDerivatives(Record):
    """Second derivatives of the energy in blocks, of bodies or of pairs."""

    slots: np.ndarray  # (m,) or (m, 2)
    values: np.ndarray  # (m, 6, 6) or (m, 12, 12)


def _place_of(term: Term) -> int:
    """Return 0 for terms with a bound or an acceleration, then 1 for other forces, else 2."""
    return 0 if term.has('bound') or term.has('acceleration') else 2 - term.has('force')


class Model(Record, parts={
        term.name: term.record for term in sorted(TERMS, key=_place_of) if term.has('record')}):
    """
    Constants of a compiled scene; the record of each term of the registry is a field, too.

    Terms that have an energy come first, then contacts, last terms that only act on velocities.
    Kernels that do not read the last ones serve scenes with and without them (`compiled_for`).
    """

    inverse_mass: float  # [1/kg] of all bodies, or of the lightest: see `masses`
    inverse_inertia: float  # [1/(kg m^2)] likewise; of the smallest principal moment
    blocks: Blocks
    links: Links | None
    supports: Supports | None
    shells: Shells | None = None
    masses: Masses | None = None
    gyration: Gyration | None = None

    if TYPE_CHECKING:
        def __getattr__(self, name: str) -> Any: ...


class Work(Record):
    """
    Quantities that depend on the state: attachment points, and accelerations at the end of a call.
    """

    # Attachment points [m], (18 s,): coordinate k of edge e of slot s at (3 e + k) stride + s,
    # where the stride is the number of slots; empty without links.
    points: np.ndarray
    acceleration: np.ndarray  # (6, s) linear [m/s^2], angular [rad/s^2]; without loads
    # Difference of the last positions and orientations at step ends, (7 or 12, m LANES) for m
    # blocks spread over the fabric, and its weights, see monitor.sample.
    difference: np.ndarray
    weights: np.ndarray
    # Sums of a health check, of each group of blocks and of all blocks (kernels/figures.py).
    figures: np.ndarray  # (g + 1, FIGURE_COUNT)
    group: int  # number of blocks in a group
    # Velocities of the attachment points [m/s], laid out like `points`; empty without damping.
    speeds: np.ndarray
    spent: Meter | None  # energy dissipated by forces
    given: Meter | None  # work of external forces
    trail: Trail | None  # for Runge-Kutta methods
    external: External | None
    breakage: Breakage | None  # if connectors can break
    kinks: Kinks | None = None  # for methods that keep their order if slopes jump
