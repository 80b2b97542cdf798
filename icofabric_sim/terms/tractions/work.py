# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Work of surface forces over a drift."""

from icofabric_sim.kernels.runtime.compiled import inlined
from icofabric_sim.terms.loads import add_row_work, Loads
from icofabric_sim.terms.profiles import factors_over, Five, Varying
from icofabric_sim.terms.shared import State
from icofabric_sim.terms.tractions.record import Tractions
from icofabric_sim.terms.tractions.sums import mean_traction_power
import numpy as np


@inlined
def work_row(
    tractions: Tractions | None, varying: Varying | None, loads: Loads, state: State, m: int,
    s: int, time: float, h: float, known: int, factors: Five
) -> tuple[int, Five]:
    """
    Add the work [J] of row `m` on a block over a drift of `h` [s], before the block moves.

    Return the number of the wrench and the factors of its profile during the drift.
    """
    if tractions is None:
        return known, factors
    else:
        if loads.wrench[m] >= tractions.first:
            if loads.wrench[m] != known:
                known = np.int64(loads.wrench[m])  # type: ignore[assignment]
                factors = factors_over(varying, known, time, h)
            add_row_work(loads, m, h, mean_traction_power(
                tractions.sliding, tractions, varying, loads.wrench[m], state,
                tractions.place[m], s, h, factors))
        return known, factors
