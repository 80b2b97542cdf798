# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
The bag of a run: which topics go in, under which names, and what it says about itself.
"""

from collections.abc import Callable
from importlib import metadata
import json
from pathlib import Path
import platform
from typing import Any

from icofabric_sim.bag import BagError, BagRecorder, next_free_path
from icofabric_sim.growth import Growth
from icofabric_sim.outputs import Topic, TOPICS
from icofabric_sim.parameter_text import dump_parameters
from icofabric_sim.parameters import Parameters
from icofabric_sim.run_records import Status
from icofabric_sim.simulation import Simulation

_LIBRARIES = ('numpy', 'scipy', 'numba', 'llvmlite', 'rosbags')


def describe_run(
    simulation: Simulation, parameters: Parameters | None = None
) -> dict[str, str]:
    """
    What a bag must hold beside messages, so that its run can be repeated.

    `parameters` are those in force: rates and pace may have changed since the scene was built.
    """
    in_force = simulation.scene.parameters if parameters is None else parameters
    from icofabric_sim import __version__

    return {
        'scene': dump_parameters(dict(in_force)),
        'version': __version__,
        'method': simulation.method_name,
        'method_reason': simulation.method_reason,
        'tolerance': repr(in_force['solver.tolerance']),
        'threads': str(simulation.thread_count),
        'step': repr(simulation.step),
        'processor': host_processor(),
        'libraries': json.dumps({name: metadata.version(name) for name in _LIBRARIES}),
        'python': platform.python_version(),
    }


def summarise_run(status: Status) -> dict[str, str]:
    """
    What a bag says at its end about the run that it holds.
    """
    said = {
        'proximity': status.proximity or 'none',
        'failure': status.failure or 'none',
        'wrenches_dropped': str(status.dropped),
        'balance_worst': repr(status.balance_worst),
    }
    if status.errors is not None:
        said['error_rate'], said['error_estimate'] = map(repr, status.errors)
    return said


def summarise_growth(growth: Growth) -> dict[str, str]:
    """
    What a bag says of the growth of a small disturbance in its run.
    """
    return {
        'growth': repr(growth.largest),
        'growth_is_at_least': 'true' if growth.at_least else 'false',
        'growth_ended': growth.ended or 'none',
        'meaningful_until': repr(growth.meaningful_until),
    }


def host_processor() -> str:
    """
    Name of the processor that kernels are compiled for.
    """
    from llvmlite import binding

    return str(binding.get_host_cpu_name())


class BagSink:
    """
    A bag as a sink of the runner.
    """

    def __init__(
        self,
        path: str | Path,
        simulation: Simulation,
        *,
        storage: str,
        live: bool,
        name: str = '/icofabric',
        on_error: Callable[[BagError], None] | None = None,
        summarise: Callable[[Status], dict[str, str]] = summarise_run,
    ) -> None:
        """
        Open the bag; raises BagError (a ValueError) naming `record.path` where that fails.

        A `live` run drops and counts messages when the disk is too slow; otherwise the run waits
        for the disk. `summarise` makes the last words of a bag that a jump of time ends.
        """
        self._summarise = summarise
        self.base = Path(path)
        self.name = name
        self._options: dict[str, Any] = {
            'storage': storage,
            'overflow': 'drop' if live else 'wait',
            'on_error': on_error,
        }
        self.recorder = self._open(self.base, describe_run(simulation))

    def _open(self, path: Path, custom: dict[str, str]) -> BagRecorder:
        recorder = BagRecorder(path, custom=custom, **self._options)
        for topic in TOPICS:
            if topic.recorded:
                recorder.add_topic(
                    self.resolve(topic.name), topic.type, latched=topic.latched, depth=topic.depth
                )
        self._inputs: set[str] = set()
        return recorder

    @property
    def is_bag(self) -> bool:
        """
        Whether messages are kept.
        """
        return True

    def resolve(self, name: str) -> str:
        """
        Full name of a private (~/) or absolute topic name.
        """
        return self.name + name[1:] if name.startswith('~') else name

    def wants(self, topic: Topic) -> bool:
        """
        Whether the topic goes into the bag.
        """
        return topic.recorded and self.recorder.error is None

    def send(self, topic: Topic, nanoseconds: int, data: bytes) -> None:
        """
        Record an output; a scene is never dropped.
        """
        self.recorder.write(self.resolve(topic.name), nanoseconds, data, essential=topic.latched)

    def send_input(self, topic: str, type_name: str, nanoseconds: int, data: bytes) -> None:
        """
        Record an input at the time it acts; never dropped.
        """
        if topic not in self._inputs:
            self._inputs.add(topic)
            self.recorder.add_topic(topic, type_name, latched=False, depth=100)
        self.recorder.write(topic, nanoseconds, data, essential=True)

    def time_jumped_back(
        self, simulation: Simulation, parameters: Parameters, ended: Status
    ) -> None:
        """
        Close this bag with the summary of the run that `ended`, and open the next: PATH_1, ...

        Where that is not possible the run goes on without one, as after any error of the disk.
        """
        self.close(summary=self._summarise(ended))
        try:
            self.recorder = self._open(
                next_free_path(self.base), describe_run(simulation, parameters)
            )
        except BagError as error:
            self.recorder.error = error
            if self._options['on_error'] is not None:
                self._options['on_error'](error)

    def close(self, *, summary: dict[str, str] | None = None) -> None:
        """
        Write what is queued and close the bag, with a `summary` in its custom data.
        """
        for key, value in (summary or {}).items():
            self.recorder.set_custom(key, value)
        self.recorder.close()
