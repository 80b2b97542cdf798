# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Named values by which the embedded Runge-Kutta pair controls its steps."""

from icofabric_sim.kernels.integrators import embedded
from icofabric_sim.simulation.stepping.named_numbers import At
import numpy as np


class EmbeddedControl:
    """An array that kernels read and write, see kernels/integrators/embedded.py."""

    __slots__ = ('numbers',)

    # The step in progress, and the next.
    start = At(embedded.START)  # [s]
    length = At(embedded.LENGTH)  # [s]
    next = At(embedded.NEXT)  # length [s]
    goal = At(embedded.GOAL)  # [s]
    has_last = At(embedded.HAS_LAST)
    resume = At(embedded.RESUME)  # length [s] after a contact
    # What steps may err by, and did.
    tolerance = At(embedded.TOLERANCE)  # [1/s]
    floor = At(embedded.FLOOR)  # [1/s]
    total = At(embedded.TOTAL)
    rate = At(embedded.RATE)  # [1/s]
    kinked = At(embedded.KINKED)  # [1/s^2]
    evaluations = At(embedded.EVALUATIONS)  # since `take_evaluations` was called last
    # Of the total, what was added in steps in which nothing could touch.
    clear_total = At(embedded.CLEAR_TOTAL)
    is_clear = At(embedded.IS_CLEAR)  # of the last step
    # Bounds of their length [s].
    shortest = At(embedded.SHORTEST_STEP)
    longest = At(embedded.LONGEST_STEP)
    close = At(embedded.CLOSE)  # where something may touch
    spare = At(embedded.SPARE)
    kink = At(embedded.KINK)

    def __init__(self, start: float) -> None:
        """Start at the time `start` [s] without a step."""
        self.numbers = np.zeros(embedded.CONTROL_COUNT)
        self.start = start

    def take_evaluations(self) -> int:
        """Return the number of force evaluations of kernels since the last call."""
        count, self.evaluations = int(self.evaluations), 0.0
        return count

    @property
    def scales(self) -> np.ndarray:
        """Factors (4,) of squared errors: of position, orientation, velocity and spin."""
        return self.numbers[embedded.SCALES:]
