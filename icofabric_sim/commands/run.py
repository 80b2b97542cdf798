# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric run SCENE`."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager, ExitStack
from pathlib import Path
import signal
import time
from typing import TYPE_CHECKING

import icofabric_sim as ico
from icofabric_sim.commands.report import add_json_argument, print_report
from icofabric_sim.commands.scenes import add_scene_arguments, read_parameters
from icofabric_sim.process.interrupts import exit_request
from icofabric_sim.simulation.devices.launcher import (
    launched_ranks,
    lead_or_serve,
    require_alone,
)
from icofabric_sim.terminal import bad_input, InputError, notes, Progress, require_place, say

if TYPE_CHECKING:
    from icofabric_sim.parameters.validation import Parameters
    from icofabric_sim.running.recording import BagSink
    from icofabric_sim.running.run_records import Errors
    from icofabric_sim.running.runner import Runner

_NAME = 'icofabric run'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    add_scene_arguments(parser)
    parser.add_argument(
        '--duration', type=float, metavar='S',
        help='simulated time [s]; required if the scene has no duration')
    record = parser.add_mutually_exclusive_group()
    record.add_argument(
        '--record', metavar='PATH',
        help='folder of the new bag (default: record.path of the scene, else runs/SCENE)')
    record.add_argument('--no-record', action='store_true', help='record nothing')
    parser.add_argument(
        '--storage', choices=('mcap', 'sqlite3'),
        help='storage of the bag (default: record.storage of the scene)')
    parser.add_argument(
        '--no-growth', action='store_true',
        help='do not measure error growth: a second run from a displaced start, '
             'which doubles the work (two more runs, which triple the work, if steps are '
             'automatic and solver.tolerance is above 4e-9 per radian of the fastest vibration)')
    parser.add_argument(
        '--ranks', action='store_true',
        help='share the steps among the MPI processes that were started together: mpiexec -n 4 '
             'icofabric run SCENE --ranks; the first one records. Bit-identical to one process. '
             'Without error growth; docs/howto/ranks.md lists what ranks support')
    add_json_argument(parser)
    parser.add_argument(
        '--cross-check', action='store_true',
        help='record nothing; integrate with quaternions and with direction cosines '
             'and report the differences')


def main(arguments: argparse.Namespace) -> int:
    """Simulate to the end of the duration; finish the bag in any case."""
    if not arguments.ranks:
        with bad_input():
            require_alone()
        return _simulate(arguments, None)
    if arguments.cross_check:
        raise InputError('--cross-check runs in one process: remove --ranks')
    with bad_input():
        ranks = launched_ranks()

    def lead() -> int:
        # Until the run is set up, bad input ends it with an exception.
        ranks.exit_status = 2
        return _simulate(arguments, ranks)

    return lead_or_serve(_NAME, ranks, lead)


def _simulate(arguments: argparse.Namespace, ranks: 'ico.Ranks | None') -> int:
    name, parameters = read_parameters(arguments)
    parameters = _complete(arguments, parameters)
    if arguments.cross_check:
        from icofabric_sim.commands.cross_check_report import report_cross_check
        return report_cross_check(name, parameters)
    from icofabric_sim.scene.summary import size_text

    path = _bag_path(arguments, name, parameters)
    with bad_input():
        scene = ico.Scene.from_parameters(parameters)
        say(f'{name}: {size_text(scene)}')
        simulation = ico.compile_scene(scene, ranks=ranks)
    is_shared = ranks is not None and ranks.size > 1
    if is_shared and not arguments.no_growth:
        say('error growth is not measured with --ranks; run in one process to measure it')
    simulation.warm_up()
    with ExitStack() as stack:
        progress = stack.enter_context(Progress(parameters['duration'], 's'))
        stack.enter_context(notes(progress, _NAME))
        return _Run(
            name, simulation, progress, path, with_growth=not (arguments.no_growth or is_shared),
            as_json=arguments.json).run()


class _Run:
    """One run from its start to its summary."""

    def __init__(
            self, name: str, simulation: 'ico.Simulation', progress: Progress,
            bag_path: Path | None, *, with_growth: bool, as_json: bool = False) -> None:
        from icofabric_sim.running.run_monitor import RunMonitor
        self.name, self.progress, self.as_json = name, progress, as_json
        self.simulation = simulation
        self.monitor = RunMonitor(simulation, with_growth=with_growth)
        self.bag = None if bag_path is None else self._open(bag_path)
        self.interrupted = False
        self.runner: Runner | None = None
        self.errors: Errors | None = None
        self.growth: ico.Growth | None = None

    def run(self) -> int:
        from icofabric_sim.commands.run_summary import interrupted_summary, run_summary
        from icofabric_sim.process.compile_notice import compile_notice
        from icofabric_sim.running.diagnostics import HealthReport
        from icofabric_sim.running.runner import Runner

        runner = Runner(
            self.simulation, [self.monitor] if self.bag is None else [self.monitor, self.bag],
            report=HealthReport('/icofabric').bytes)
        self.runner = runner
        growth_seconds, compiled = self._growth_seconds(), compile_notice.seconds
        started = time.monotonic()
        try:
            with self._stopped_by_signals(runner):
                try:
                    runner.run(until_finished=True, progress=self.progress.update)
                    wall = time.monotonic() - started - (compile_notice.seconds - compiled)
                    growth_seconds = self._growth_seconds() - growth_seconds
                    self._estimate_accuracy(runner)
                finally:
                    # A signal must not leave a damaged bag.
                    self._close()
                self.progress.clear()
                status = runner.status()
                # An interrupt after the last step does not count.
                interrupted = self.interrupted and not (status.finished or status.failure)
                rows = run_summary(
                    self.name, self.simulation, self.monitor, status, wall - growth_seconds,
                    growth_seconds,
                    errors=self.errors, growth=self.growth,
                    bag=None if self.bag is None else self.bag.recorder,
                    interrupted=interrupted, compiling=compile_notice.seconds)
        except KeyboardInterrupt:
            if not self.interrupted:
                raise
            # The state is not known in the middle of a compilation.
            self.progress.clear()
            print_report(interrupted_summary(
                self.name, self.simulation, runner.status(), compile_notice.seconds,
                bag=None if self.bag is None else self.bag.recorder), as_json=self.as_json)
            return 130
        lost = '' if self.bag is None or self.bag.error is None else str(self.bag.error)
        print_report(rows, as_json=self.as_json)
        if interrupted and not lost:
            return 130
        return 1 if status.failure or lost else 0

    def _growth_seconds(self) -> float:
        companion = self.monitor.companion
        return 0.0 if companion is None else companion.seconds

    def _estimate_accuracy(self, runner: 'Runner') -> None:
        """Estimate the accuracy of the run."""
        from icofabric_sim.running.run_records import errors_of
        self.errors = errors_of(self.simulation)
        companion = self.monitor.companion
        if companion is not None:
            if runner.finished:
                companion.look()
            self.growth = companion.result()

    def _open(self, path: Path) -> 'BagSink':
        from icofabric_sim.running.recording import BagSink
        with bad_input():
            path.parent.mkdir(parents=True, exist_ok=True)
            return BagSink(
                path, self.simulation, live=False, on_error=self._bag_failed,
                storage=self.simulation.scene.parameters['record.storage'])

    def _bag_failed(self, error: Exception) -> None:
        # Recording was requested, so the run ends when it fails.
        if self.runner is not None:
            self.progress.note(f'{_NAME}: {error}; the run is stopped')
            self.runner.stop()

    def _close(self) -> None:
        if self.bag is None or self.runner is None:
            return
        from icofabric_sim.running.recording import summarise_growth, summarise_run
        status = self.runner.status()
        self.bag.close(summary={
            **summarise_run(status._replace(errors=self.errors or status.errors)),
            **({} if self.growth is None else summarise_growth(self.growth)),
            'interrupted': 'true' if self.interrupted and not status.finished else 'false'})

    @contextmanager
    def _stopped_by_signals(self, runner: 'Runner') -> Iterator[None]:
        def stop(number: int, frame: object) -> None:
            self.interrupted = True
            runner.stop()
            # Code that does not poll for signals, mainly the compiler, is interrupted.
            exit_request.request()

        before = {number: signal.signal(number, stop)
                  for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
                  if signal.getsignal(number) is not signal.SIG_IGN}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
            exit_request.withdraw()


def _complete(arguments: argparse.Namespace, parameters: 'Parameters') -> 'Parameters':
    """Apply real-time factor, duration and storage of the command line to the parameters."""
    changes: dict[str, object] = {}
    given = {rule.partition(':=')[0] for rule in arguments.parameter}
    if 'real_time_factor' not in given:
        changes['real_time_factor'] = 0.0
    # No service could resume a paused run.
    changes['start_paused'] = False
    if arguments.duration is not None:
        changes['duration'] = arguments.duration
    if arguments.storage is not None:
        changes['record.storage'] = arguments.storage
    with bad_input():
        parameters = parameters.with_changes(changes)
    if not parameters['duration'] > 0.0:
        raise InputError(
            'duration required: give --duration S, the simulated time in seconds (above 0)')
    return parameters


def _bag_path(
        arguments: argparse.Namespace, name: str, parameters: 'Parameters') -> Path | None:
    from icofabric_sim.bag import next_free_path
    if arguments.no_record:
        return None
    if arguments.record is not None:
        return require_place('--record', Path(arguments.record).expanduser())
    if parameters['record.path']:
        return require_place('record.path', Path(parameters['record.path']).expanduser())
    return next_free_path(Path('runs') / name)
