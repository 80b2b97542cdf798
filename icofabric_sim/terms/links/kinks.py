# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Jumps of the slope of connectors, within one step."""

from icofabric_sim.kernels.runtime.record import Record
import numpy as np


class Kinks(Record):
    """
    Connectors whose slope jumps at their natural length, within one step; see kernels/kinks.py.

    Rows by connectors at each body, as those of a `Variety`. Between steps only a state is stored
    in which no connector was near its kink: the state saves work, and changes no bit.
    """

    extension: np.ndarray  # (12, s) k_e [N/m]
    compression: np.ndarray  # (12, s) k_c [N/m]
    natural_length: np.ndarray  # (12, s) D [m]
    slope: np.ndarray  # (12, s) [N/m] of the side on which the step began
    # (48, s) [N] coefficients of powers of the time, as a fraction of the step, of the tension
    # that crossings add; after the stages (24, s) [N s] the remaining impulses at the end and half
    # a step before
    forces: np.ndarray
    start: np.ndarray  # (36, s) [m] stretch, h times its rate, h^2 / 2 times its derivative
    active: np.ndarray  # (b, 12) uint8: some lane has a crossing there
    before: np.ndarray  # (6, s) velocities [m/s] and spins [rad/s] before a kick
    rates: np.ndarray  # (18 s,) velocities [m/s] of the attachment points
    seconds: np.ndarray  # (18 s,) accelerations [m/s^2] of the attachment points
    found: np.ndarray  # (8 t,) whether a thread has found crossings in this step
    ranges: np.ndarray  # (8 t,) [m] results of each thread, see kernels/kinks.py
    # (3,) k_e and k_c [N/m] and natural length [m] if all connectors are alike; else zeros
    uniform: np.ndarray
    # (2,) stiffness [N/m] and natural length [m] of all connectors in this step; 0: not alike
    alike: np.ndarray
    # (3,) least distance [m] of a connector from its kink in the stored state, 0: no state is
    # stored; 1 or -1 if all were longer, or all shorter, than the natural length; and the number
    # of steps with crossings, each of which evaluates the forces once more
    margin: np.ndarray
    kept_position: np.ndarray  # (3, s) [m]
    kept_orientation: np.ndarray  # (4, s) or (9, s)
