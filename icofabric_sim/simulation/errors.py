# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Why a simulation does not go on."""


class SimulationError(RuntimeError):
    """
    The run cannot go on; time, bodies and reason are in the message, the last good state is kept.
    """


class ElsewhereError(SimulationError):
    """What takes the steps beside this process has failed, and with it the run."""


class RankError(ElsewhereError):
    """A process of MPI that shares the steps has failed, and with it the run: which, and why."""


class DeviceError(ElsewhereError):
    """The device that takes the steps has failed, and with it the run: which, and why."""


class Interrupted(Exception):
    """`should_stop` ended an advance; the simulation stands at a step end and can go on."""


class KernelsAwaited(Interrupted):
    """
    The next step needs a kernel that is not compiled yet: the first contact, mostly.

    The simulation stands at a step end, and goes on once `contact_kernels.are_ready`; where it
    `is_for_contacts` is False it may be tried again before, when no other thread compiles.
    """

    def __init__(self, is_for_contacts: bool = True) -> None:
        """Say what the kernel is for."""
        super().__init__('a kernel is not compiled yet')
        self.is_for_contacts = is_for_contacts
