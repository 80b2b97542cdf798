# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""MPI processes that share the steps of one fabric: the public interface."""

from contextlib import suppress
from importlib import import_module
import signal
from types import TracebackType
from typing import Any, NoReturn, Self

from icofabric_sim import checks
from icofabric_sim.libraries import install_command
from icofabric_sim.process.compile_notice import compile_notice
from icofabric_sim.scene.available_memory import share_among
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.devices.refusals import require_shareable
from icofabric_sim.simulation.devices.server import Server
from icofabric_sim.simulation.devices.transport import Transport
from icofabric_sim.simulation.errors import RankError

__all__ = ['RankError', 'Ranks']


class Ranks:
    """
    Ranks of a communicator; the first rank leads, the others take part in its steps.

        with ico.Ranks() as ranks:
            if ranks.leads:
                simulation = ico.compile_scene(scene, ranks=ranks)
                simulation.advance_to(0.5)

    All processes reach the end of the block: the other ranks serve there until the first rank has
    left the block. A failure of a rank raises RankError in all ranks.
    """

    def __init__(self, communicator: Any = None) -> None:
        """Take the processes of an mpi4py `communicator`; without one those of the launcher."""
        try:
            mpi = import_module('mpi4py.MPI')
        except (ImportError, RuntimeError) as error:
            raise RankError(
                f'ranks need mpi4py, and an MPI library that it finds: {error}; install both: '
                + install_command('mpi4py')) from error
        communicator = mpi.COMM_WORLD if communicator is None else checks.instance(
            'communicator', communicator, mpi.Intracomm, 'mpi4py.MPI.COMM_WORLD is one')
        self._transport = Transport(communicator)
        # With which all ranks are to end, as the first one says: a launcher reports any of theirs.
        self.exit_status = 0
        self._shared_before = 1
        self._is_entered = False

    def __reduce__(self) -> NoReturn:
        """Raise TypeError: ranks cannot be pickled or copied."""
        raise TypeError(
            'Ranks cannot be pickled or copied: they are processes of MPI; a Checkpoint of their '
            'simulation can')

    @property
    def rank(self) -> int:
        """Number of this process, from 0."""
        return self._transport.rank

    @property
    def size(self) -> int:
        """Number of processes."""
        return self._transport.size

    @property
    def leads(self) -> bool:
        """True on the first process, which has the simulation."""
        return self._transport.rank == 0

    def finalize(self) -> None:
        """
        Leave MPI, unless a rank has failed; this process can share nothing afterwards.

        For programs that skip the normal end of the interpreter, such as nodes: a launcher reports
        a process that has not left MPI as crashed.
        """
        if not self._transport.has_failed:
            import_module('mpi4py.MPI').Finalize()

    def __enter__(self) -> Self:
        """Start the block that all processes run."""
        self._shared_before, self._is_entered = share_among(self.size), True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None
    ) -> None:
        """Let the other ranks serve until the first process arrives."""
        share_among(self._shared_before)
        if self.leads:
            if kind is None:
                self._transport.end(self.exit_status)
                return
            with suppress(RankError):
                self._transport.end(self.exit_status or 1)
            return
        if error is not None:
            self._transport.fail(error)
            return
        # The first rank decides when a run ends.
        signals = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
        before = {number: signal.signal(number, signal.SIG_IGN) for number in signals}
        try:
            # One rank speaks.
            with compile_notice.shown_by(lambda text: None):
                self.exit_status = Server(self._transport).serve()
        except RankError:
            raise
        except BaseException as failure:
            self._transport.fail(failure)
            self._transport.require_health()
            raise
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


def transport_for(
    ranks: Ranks, scene: Scene, *, cosines: bool, body_force: bool
) -> Transport | None:
    """
    Return the transport of a simulation shared by ranks; None for one process.

    Raises ParameterError or ValueError where it cannot be shared.
    """
    checks.instance('ranks', ranks, Ranks, 'with ico.Ranks() as ranks: makes them')
    transport = ranks._transport
    if not ranks.leads:
        error = ValueError(
            f'a simulation is made on the first rank, not on rank {ranks.rank}: put it after '
            "'if ranks.leads:'")
        # The first one waits for this rank's answers.
        transport.fail(error)
        raise error
    if not ranks._is_entered:
        raise ValueError(
            "the other ranks serve within the block of 'with ico.Ranks() as ranks:' only: put "
            'compile_scene(scene, ranks=ranks) into it')
    if transport.has_ended:
        raise ValueError("the ranks have ended with their 'with' block")
    if ranks.size == 1:
        return None
    require_shareable(scene, cosines=cosines, body_force=body_force)
    return transport
