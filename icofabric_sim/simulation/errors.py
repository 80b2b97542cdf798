# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Reasons why a simulation stops."""


class SimulationError(RuntimeError):
    """
    A failed run; the message states time, bodies and reason, and the last sound state is kept.
    """


class ElsewhereError(SimulationError):
    """A failure of the ranks or the GPU that compute the steps."""


class RankError(ElsewhereError):
    """
    A failure of an MPI process that shares the steps; the message names the rank and the reason.
    """


class DeviceError(ElsewhereError):
    """
    A failure of the GPU that computes the steps; the message names the device and the reason.
    """


class Interrupted(Exception):
    """
    End of an advance by `should_stop`; the simulation is at the end of a step and can continue.
    """


class KernelsAwaited(Interrupted):
    """
    A kernel for the next step is still compiling, usually for the first contact.

    The simulation is at the end of a step and can continue once `contact_kernels.are_ready`. If
    `is_for_contacts` is False, the simulation may retry earlier, when no other thread compiles.
    """

    def __init__(self, is_for_contacts: bool = True) -> None:
        """Store the purpose of the kernel."""
        super().__init__('a kernel is not compiled yet')
        self.is_for_contacts = is_for_contacts
