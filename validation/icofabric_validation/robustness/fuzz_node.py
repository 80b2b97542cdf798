# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Feed damaged and random input to a live `fabric_node`, and compare it with a simulation.

    .venv/bin/python -m icofabric_validation.robustness.fuzz_node [--bursts 100] \
        [--messages 1000] [--seed 0]
        [--folder DIR]

The node runs in a separate process, as `ros2 run` starts it. A burst has `--messages` messages of
raw bytes on its input topics, most of them damaged, and calls of its services in random order with
parameters of any value and type. After each burst the node is paused and reset, receives one valid
wrench, and advances. The published states must be bit-identical to those of a simulation in this
process. Number and seed determine a burst, except for the timing of the two processes.

Faults are: a missing answer or reason, a parameter that only one of scene and node refuses,
another motion, a traceback in the log, a node that ends, and growth of memory, threads or files.
The exit status is 1 if there is a fault.
"""

import argparse
from collections import Counter
from contextlib import suppress
import math
from pathlib import Path
import random
import sys
import tempfile
import time
from typing import Any

import icofabric_sim as ico
from icofabric_sim import messages
from icofabric_sim.messages import decode_float64_multi_array
from icofabric_sim.parameters.text import flatten_parameters
from icofabric_sim.parameters.validation import make_parameters
from icofabric_validation.benchmarks.machine import describe_machine
from icofabric_validation.robustness.fuzz_kinds import damaged
from icofabric_validation.robustness.soak_graph import (
    FabricProcess,
    free_domain,
    Graph,
    NODE,
    NodeError,
    wait_for,
)
import numpy as np

SCENE: dict[str, Any] = {
    'weave': {'size': [2, 2, 2]}, 'contact': {'mode': 'never'},
    'groups': {'tip': 'ids 1', 'moved': 'ids 0'}, 'loads': {'tip': {'group': 'tip'}},
    'drives': {'moved': {'group': 'moved'}}, 'solver': {'method': 'dop8'},
    'initial_random': {'velocity_sigma': 0.1}, 'start_paused': True, 'reset_time': True,
    'real_time_factor': 1.0, 'advance_duration': 0.05, 'publish_rate': 200.0}
# Values for parameters, some of them valid. No parameter adds a term to the scene, which would
# have to be compiled for a minute.
_EXTREME_VALUES: tuple[Any, ...] = (
    math.nan, math.inf, -1.0, 0.0, 1e308, -1e308, 5e-324, 1.5, 2, 0, -3, 2**62, True, 'off', '',
    'x' * 300, 'é', [1.0, math.nan], [0, 0, 0], [2, 2, 2], [1, 2], ['a'], [True], 800.0)
_NAMES = (
    'connector.stiffness', 'connector.natural_length', 'weave.size', 'weave.variant',
    'weave.connector_length', 'shell.density', 'shell.thickness', 'shell.edge_length', 'gravity',
    'solver.tolerance', 'solver.threads', 'initial_random.seed', 'real_time_factor',
    'publish_rate', 'marker_rate', 'clock_rate', 'step_count', 'advance_duration',
    'input_horizon', 'reset_time', 'frame_id', 'pull.strength', 'no.such', 'loads.tip.hold',
    'loads.new.group', 'groups.tip', 'initial_random.velocity_sigma')
# Parameters for which node and scene may differ.
_CHANGED_BY_NODE = ('frame_id', 'clock_rate', 'groups.tip', 'loads.new.group', 'no.such')
_MAX_BODIES = 500
_TRIGGERS = ('reset', 'step', 'advance', 'clear_loads', 'save_checkpoint', 'restore_checkpoint')
_MAX_MEMORY_GROWTH_MB = 64.0
_MAX_PRINTED_FAULTS = 20


class Fuzz:
    """One node that receives bursts of input."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.seed, self.done, self.faults = seed, Counter[str](), 0
        self._folder = folder
        domain = free_domain()
        self.process = FabricProcess(
            folder, SCENE, domain, checkpoint__path=str(folder / 'a.checkpoint'))
        try:
            self.process.wait_until_ready()
            self.graph = Graph(domain)
        except BaseException:
            self.process.process.kill()
            raise
        self._states: list[np.ndarray] = []
        self.graph.listen((f'{NODE}/state', 'std_msgs/msg/Float64MultiArray'), self._take)
        self._good = self._examples()
        self._parameters = flatten_parameters(SCENE)
        scene = ico.Scene.from_parameters(SCENE)
        run = ico.compile_scene(scene)
        run.apply_wrench('tip', force=(0.0, 0.0, 0.02), time=0.01)
        run.advance_to(0.05)
        snapshot = run.snapshot()
        self._expected = np.concatenate([
            snapshot.position, snapshot.orientation, snapshot.linear_velocity,
            snapshot.angular_velocity], axis=1)

    def burst(self, number: int, count: int) -> None:
        """Send `count` messages, call services meanwhile, and check the node."""
        chance = random.Random(f'{self.seed} {number}')
        calls = {chance.randrange(count) for _ in range(6)}
        self._call('pause', 'SetBool', number, data=False)
        for index in range(count):
            topic, type_name, good = chance.choice(self._good)
            if chance.random() < 0.1:
                good = chance.choice(self._good)[2]
            data = chance.randbytes(chance.randrange(4, 300)) if chance.random() < 0.02 else (
                damaged(good, chance))
            # The sender refuses messages shorter than the header of four bytes.
            if len(data) >= 4:
                self.graph.publish(topic, data, type_name)
                self.done['messages'] += 1
            if index in calls:
                self._disturb(chance, number)
        self._check(number)

    def end(self) -> None:
        """Stop the node, as a user does."""
        status, _ = self.process.stop()
        if status != 0:
            self._fault(-1, f'the node ended with status {status}')
        log = self.process.log()
        if 'Traceback' in log:
            at = log.index('Traceback')
            self._fault(-1, f'the node printed {log[at:at + 1500]}')
        with suppress(Exception):
            self.graph.close()

    def _disturb(self, chance: random.Random, number: int) -> None:
        action = chance.randrange(4)
        if action == 0:
            self._call(chance.choice(_TRIGGERS), 'Trigger', number)
        elif action == 1:
            self._call(
                chance.choice(('pause', 'record')), 'SetBool', number, data=chance.random() < 0.5)
        else:
            self._set(chance, number)

    def _call(self, service: str, kind: str, number: int, **fields: Any) -> Any:
        answer, _ = self.graph.call(service, kind, **fields)
        self.done['calls'] += 1
        self.done['calls refused'] += not answer.success
        if not answer.success and not answer.message:
            self._fault(number, f'~/{service} refuses without a reason')
        return answer

    def _set(self, chance: random.Random, number: int) -> None:
        """Set a parameter to any value; if the node accepts it, restore the old value."""
        name, value = chance.choice(_NAMES), chance.choice(_EXTREME_VALUES)
        before = self._parameters.get(name)
        expected = self._is_possible(name, value)
        values: dict[str, Any] = {name.replace('.', '__'): value}
        (result,), _ = self.graph.set(atomically=chance.random() < 0.5, **values)
        self.done['parameters'] += 1
        self.done['parameters refused'] += not result.successful
        if not result.successful and name not in result.reason and not any(
                word in result.reason for word in ('weave', 'shell', 'connector', 'solver')):
            self._fault(number, f'{name} = {value!r} is refused without its name: {result.reason}')
        if expected is not None and result.successful != expected:
            self._fault(
                number, f'{name} = {value!r} is {"accepted" if result.successful else "refused"} '
                f'by the node, not by a scene: {result.reason}')
        if result.successful:
            back = before if before is not None else make_parameters(self._parameters)[name]
            restored: dict[str, Any] = {name.replace('.', '__'): back}
            (result,), _ = self.graph.set(**restored)
            if not result.successful:
                self._fault(number, f'{name} cannot be restored to {back!r}: {result.reason}')

    def _is_possible(self, name: str, value: Any) -> bool | None:
        """Return True if a scene accepts the value; None: node and scene may differ."""
        if name in _CHANGED_BY_NODE:
            return None
        try:
            parameters = make_parameters({**self._parameters, name: value})
            if np.prod(np.array(parameters['weave.size'], float)) > _MAX_BODIES:
                return None
            run = ico.compile_scene(ico.Scene.from_parameters(parameters))
        except ValueError:
            return False
        try:
            run.advance_steps(1)
        except ico.SimulationError:
            # The node may find the error before it accepts the value.
            return None
        return True

    def _check(self, number: int) -> None:
        """Compare the motion by one valid wrench after a reset with that of a simulation."""
        graph = self.graph
        # Messages that are acknowledged before a call act before it.
        for topic, _, _ in self._good:
            graph.settle(topic)
        self._call('pause', 'SetBool', number, data=True)
        self._call('record', 'SetBool', number, data=False)
        for service in ('reset', 'clear_loads'):
            if not (answer := self._call(service, 'Trigger', number)).success:
                self._fault(number, f'~/{service} is refused: {answer.message}')
        wrench = messages.WrenchStampedBytes('')
        wrench.force[:] = 0.0, 0.0, 0.02
        self._states.clear()
        graph.publish(f'{NODE}/loads/tip', bytes(wrench.stamped(10_000_000)))
        graph.settle(f'{NODE}/loads/tip')
        answer = self._call('advance', 'Trigger', number)
        if not answer.success:
            self._fault(number, f'~/advance is refused: {answer.message}')
            return
        wait_for(lambda: any(
            state.shape == self._expected.shape and np.array_equal(state, self._expected)
            for state in [*self._states]), 'state of the simulation without a node', 20.0)
        self.done['checks'] += 1

    def _take(self, data: bytes) -> None:
        found = decode_float64_multi_array(data)
        self._states.append(np.array(getattr(found, 'values', found)))

    def _fault(self, number: int, text: str) -> None:
        self.faults += 1
        if self.faults <= _MAX_PRINTED_FAULTS:
            print(f'FAULT in burst {number} of seed {self.seed}: {text[:1500]}', flush=True)

    @staticmethod
    def _examples() -> list[tuple[str, str, bytes]]:
        found = []
        for number in range(3):
            for topic, kind, frame in (
                    ('wrench', messages.WrenchStampedBytes, f'icosahedron_{number}'),
                    ('loads/tip', messages.WrenchStampedBytes, ''),
                    ('drives/moved', messages.TwistStampedBytes, ''),
                    ('pull', messages.PointStampedBytes, f'icosahedron_{number}')):
                message = kind(frame)
                found.append(
                    (f'{NODE}/{topic}', kind.TYPE, bytes(message.stamped(number * 10**7))))
        return found


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n\n')[0].strip())
    parser.add_argument('--bursts', type=int, default=100)
    parser.add_argument('--messages', type=int, default=1000, help='in each burst')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--folder', type=Path, help='for files of the node (default: temporary)')
    arguments = parser.parse_args(argv)
    print(describe_machine())
    with tempfile.TemporaryDirectory(prefix='icofabric_fuzz_') as temporary:
        fuzz = Fuzz(arguments.folder or Path(temporary), arguments.seed)
        first = None
        began = time.monotonic()
        for number in range(arguments.bursts):
            try:
                fuzz.burst(number, arguments.messages)
            except NodeError as error:
                fuzz._fault(number, str(error))
                if fuzz.process.process.poll() is not None:
                    break
            if number == arguments.bursts // 4:
                first = fuzz.process.resources()
            if number % 10 == 9:
                print(f'{number + 1} bursts: {dict(fuzz.done)}, {fuzz.faults} faults', flush=True)
        last = fuzz.process.resources()
        if first is not None and last is not None:
            print(f'memory {first.memory:.0f} to {last.memory:.0f} MB, threads {first.threads} to '
                  f'{last.threads}, files {first.files} to {last.files}')
            if last.memory > first.memory + _MAX_MEMORY_GROWTH_MB or (
                    last.threads > first.threads + 2 or last.files > first.files + 4):
                fuzz._fault(-1, 'memory, threads or files grow')
        fuzz.end()
    print(f'{time.monotonic() - began:.0f} s: {dict(fuzz.done)}, {fuzz.faults} faults')
    return int(fuzz.faults > 0)


if __name__ == '__main__':
    sys.exit(main())
