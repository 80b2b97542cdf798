# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Recorded runs that are driven from outside while they run, as the node is, but without ROS."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from icofabric_sim.messages.topics import CLOCK
from icofabric_sim.parameters.changes import rebuilds
from icofabric_sim.running.recording import BagSink, summarise_run
from icofabric_sim.running.runner import Runner
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.simulation import compile_scene
import numpy as np
from recorded_runs import swing_scene, wrench

MILLISECOND = 1_000_000
Act = Callable[['Drive'], Any]


class Drive:
    """A runner with a bag, and a script of what is done to it at which simulated time."""

    is_bag = False

    def __init__(self, path: Path, scene: Scene, script: list[tuple[int, Act]], **options: Any):
        """Record to `path`; the script names times [ms] on /clock, ascending."""
        simulation = compile_scene(scene)
        simulation.warm_up()
        self.folder = path.parent
        self.bag = BagSink(path, simulation, live=False, **options)
        self.runner = Runner(
            simulation, [self, self.bag], on_rebuilt=self._rebuilt)
        self.script = list(script)
        self.answers: list[Any] = []
        self.refused: list[str] = []
        self._building = False

    def run(self) -> 'Drive':
        """Run to the end of the duration, and close the bag."""
        self.runner.run(until_finished=True)
        assert not self.script
        self.close()
        return self

    def close(self) -> None:
        """Close the bag, and see that all that was asked for was done."""
        self.bag.close(summary=summarise_run(self.runner.status()))
        assert not self._building
        for answer in self.answers:
            answer.result(10.0)

    # What a script may do.

    def push(self, key: str | int, force: Any, *, after: float = 0.0) -> None:
        """Send a wrench that acts at once, or `after` so many seconds."""
        topic, frame = f'~/loads/{key}', ''
        if isinstance(key, int):
            topic, frame = '~/wrench', f'icosahedron_{key}'
        stamp = self.runner.now + round(after * 1e9) if after else 0
        self.runner.inputs.receive(*wrench(topic, stamp, force, frame))

    def change(self, **changes: Any) -> None:
        """
        Change parameters; time stands still until that is done, so that the run does not end.
        """
        dotted = {name.replace('__', '.'): value for name, value in changes.items()}
        before = self.runner.changes.wanted or self.runner.parameters
        wanted = before.with_changes(dotted)
        if not rebuilds(before, wanted):
            self.answers.append(self.runner.change(wanted))
            return
        self.runner.set_paused(True)
        self._building = True
        self.runner.change(wanted)

    def pause_and_step(self) -> None:
        """Pause, take steps, and go on."""
        self.runner.set_paused(True)
        taken = self.runner.take_steps()
        self.answers.append(taken)
        taken.add_done_callback(lambda _: self.runner.set_paused(False))

    def save(self) -> None:
        """Save a checkpoint beside the bag; time stands still until it is on the disk."""
        self.runner.set_paused(True)
        saved = self.runner.save_checkpoint(self.folder / 'saved.checkpoint')
        self.answers.append(saved)
        saved.add_done_callback(lambda _: self.runner.set_paused(False))

    def restore(self) -> None:
        """Go back to it."""
        self.answers.append(self.runner.restore_checkpoint(self.folder / 'saved.checkpoint'))

    def record(self, on: bool) -> None:
        """Switch the recording."""
        self.answers.append(self.runner.set_recording(on))

    def reset(self) -> None:
        """Go back to the initial state."""
        self.answers.append(self.runner.reset())

    def _rebuilt(self, wanted: Any, reason: str) -> None:
        if reason:
            self.refused.append(reason)
        # Changes that came while another was built are one.
        if self.runner.changes.wanted is None:
            self._building = False
            self.runner.set_paused(False)

    # A sink of the runner that looks at the clock.

    def wants(self, topic: Any) -> bool:
        return topic is CLOCK

    def send(self, topic: Any, nanoseconds: int, data: bytes) -> None:
        while self.script and nanoseconds >= self.script[0][0] * MILLISECOND:
            self.script.pop(0)[1](self)

    def send_input(self, topic: str, type_name: str, nanoseconds: int, data: bytes) -> None:
        pass

    def time_jumped_back(self, simulation: Any, parameters: Any, ended: Any) -> None:
        pass


def lively_scene(**changes: Any) -> Scene:
    """
    A slab in random motion that is driven hard: hold times, a channel on the body, a steady load.
    """
    return swing_scene(**{
        'contact.mode': 'never',
        'initial_random.velocity_sigma': 0.2,
        'initial_random.spin_sigma': 5.0,
        'loads.tip.hold': 0.03,
        'loads.side.group': 'tip',
        'loads.side.frame': 'body',
        'loads.side.point': [0.0, 0.01, -0.004],
        'loads.side.force': [0.0, 0.1, 0.0],
        'clock_rate': 1000.0,
        'duration': 0.4,
        **changes,
    })


def random_pushes(seed: int, count: int, end: int) -> list[tuple[int, Act]]:
    """Wrenches at random moments up to `end` [ms], on channels and bodies, some ahead of time."""
    generator = np.random.default_rng(seed)
    keys: list[str | int] = ['tip', 'side', 0, 3, 9]

    def one() -> tuple[int, Act]:
        key = keys[generator.integers(len(keys))]
        force = 0.3 * generator.standard_normal(3) * (generator.random() > 0.2)
        after = float(generator.random() > 0.5) * generator.uniform(1e-4, 0.02)
        return int(generator.integers(end)), lambda drive: drive.push(key, force, after=after)

    return [one() for _ in range(count)]


def in_order(*scripts: list[tuple[int, Act]]) -> list[tuple[int, Act]]:
    """One script of several."""
    return sorted((entry for script in scripts for entry in script), key=lambda entry: entry[0])
