# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Random valid and invalid actions of a client, for soak.py."""

from collections import Counter
from collections.abc import Callable
import random
import struct
import time
from typing import Any

from icofabric_sim.messages import ERROR, WrenchStampedBytes
from icofabric_validation.robustness.soak_graph import Graph, NODE, Watch

LOADS = ('tip', 'all_of_it')
SCENE: dict[str, Any] = {
    'weave': {'size': [4, 3, 3], 'connector_angle': 0.66},
    'connector': {'stiffness': 1000.0},
    'contact': {'mode': 'never'},
    'gravity': [0.0, 0.0, -9.81],
    'groups': {'wall': 'x_min', 'tip': 'x_max', 'everything': 'all'},
    'supports': {'wall': {'group': 'wall', 'fix': 'all'}},
    'loads': {'tip': {'group': 'tip', 'share': 'total'},
              'all_of_it': {'group': 'everything', 'share': 'total', 'hold': 0.5}},
    'publish_rate': 60.0,
    'clock_rate': 100.0,
}
_WRENCH_TOPIC = f'{NODE}/wrench'
_FORCE = 0.02  # [N], about the weight of a shell
_OVERLOADS = (1e2, 1e4, 1e9, 1e300)  # [N]
_LAST_BODY = 20  # number of a body; some weaves have fewer
# Probability after each action without a bag that the next bag is started.
_RECORD_PROBABILITY = 0.1
# Number of equal reports to wait for, because the middleware may resend messages of a burst.
_BURST_REPORTS = 4
LONGEST_FRAME = 10_000  # characters
# Number of bursts that fill the queues, and messages in each.
_FILL_BURSTS, _FILL_MESSAGES = 5, 5000
# Range of the wall time between two actions [s].
_PAUSE_S = (0.01, 0.15)


def wrench(
    frame: str, force: tuple[float, ...] = (0.0, 0.0, 0.0),
    torque: tuple[float, ...] = (0.0, 0.0, 0.0), stamp: int = 0,
) -> bytes:
    """Return a serialised wrench."""
    message = WrenchStampedBytes(frame)
    message.force[:], message.torque[:] = force, torque
    return message.stamped(stamp)


class Driver:
    """
    A client that runs random actions and counts them.

    Wrenches are sent only while a bag is open, because the bag has the wrenches that acted.
    """

    def __init__(self, graph: Graph, watch: Watch, generator: random.Random) -> None:
        """Start while a bag is open and the simulation runs."""
        self.graph, self.watch, self.generator = graph, watch, generator
        self.done: Counter[str] = Counter()
        self.sent = 0
        # The middleware keeps the last messages of a burst longer than the queue.
        self.burst_count, self.displaced = 0, 0
        self.problems: list[str] = []
        self._recording = True
        self._actions: tuple[tuple[float, Callable[[], None]], ...] = (
            (40.0, self.push), (6.0, self.push_ahead), (8.0, self.reweave), (6.0, self.retune),
            (5.0, self.pause_and_step), (4.0, self.reset), (4.0, self.save), (3.0, self.restore),
            (1.5, self.switch_recording), (8.0, self.send_invalid), (1.0, self.burst),
            (3.0, self.set_invalid_parameter), (0.7, self.overload))

    def drive(self, until: Callable[[], bool], names: frozenset[str] = frozenset()) -> None:
        """Run all actions, or the named ones, until `until` returns True."""
        weighted = [(weight, action) for weight, action in self._actions
                    if not names or action.__name__ in names]
        weights, actions = zip(*weighted)
        # Each action once, then at random.
        for action in self.generator.sample(actions, len(actions)):
            if until():
                return
            self._do(action)
        while not until():
            self._do(self.generator.choices(actions, weights)[0])

    def _do(self, action: Callable[[], None]) -> None:
        action()
        self.done[action.__name__] += 1
        if not self._recording and self.generator.random() < _RECORD_PROBABILITY:
            self.switch_recording()
        time.sleep(self.generator.uniform(*_PAUSE_S))

    # Wrenches.

    def push(self) -> None:
        """Send up to ten wrenches on channels and single bodies."""
        if self._recording:
            for _ in range(self.generator.randint(1, 10)):
                self._push(0)

    def push_ahead(self) -> None:
        """Send wrenches with future and past stamps."""
        if self._recording:
            for _ in range(5):
                self._push(self.watch.now + self.generator.randint(-10**8, 3 * 10**8))

    def _push(self, stamp: int) -> None:
        force = tuple(self.generator.gauss(0.0, _FORCE) for _ in range(3))
        torque = tuple(self.generator.gauss(0.0, 1e-5) for _ in range(3))
        if self.generator.random() < 0.3:
            force = torque = (0.0, 0.0, 0.0)
        if self.generator.random() < 0.5:
            topic = f'{NODE}/loads/{self.generator.choice(LOADS)}'
            self._send(topic, wrench('', force, torque, max(stamp, 0)))
        else:
            body = self.generator.randint(0, _LAST_BODY)
            self._send(
                _WRENCH_TOPIC, wrench(f'icosahedron_{body}', force, torque, max(stamp, 0)))

    def _send(self, topic: str, data: bytes) -> None:
        self.graph.publish(topic, data)
        self.sent += 1

    def invalid_message(self) -> tuple[str, bytes]:
        """Return a topic, and a message that must be dropped."""
        generator, good = self.generator, wrench('icosahedron_0', (0.001, 0.0, 0.0))
        broken = bytearray(good)
        struct.pack_into('<I', broken, 12, generator.choice([0, 2**31, 2**32 - 1]))
        text = bytearray(wrench('icosahedron_0'))
        text[16:20] = b'\xff\xfe\x80\x00'
        return generator.choice([_WRENCH_TOPIC, f'{NODE}/loads/tip']), generator.choice([
            good[:generator.randint(4, len(good) - 9)],
            bytes(broken),
            bytes(text),
            wrench('moon'),
            wrench('x' * LONGEST_FRAME),
            wrench('icosahedron_999999999'),
            wrench('icosahedron_-1'),
            wrench('icosahedron_0', (float('nan'), 0.0, 0.0)),
            wrench('icosahedron_0', (0.0, 0.0, 0.0), (0.0, float('inf'), 0.0)),
            good + b'\1' * 1000,
            generator.randbytes(generator.randint(4, 200)),
        ])

    def send_invalid(self) -> None:
        """Send messages that must be dropped."""
        for _ in range(self.generator.randint(1, 5)):
            self._send(*self.invalid_message())

    def burst(self) -> None:
        """Send thousands of messages that must be dropped."""
        messages = [self.invalid_message() for _ in range(20)]
        self._burst(messages, self.generator.randint(2000, 5000))

    def fill_queues(self) -> None:
        """
        Send the longest message until all slots of the queues have had it.

        The middleware keeps for each of the 1,000 slots of a queue the memory of its longest
        message, so later growth has another cause.
        """
        longest = wrench('x' * LONGEST_FRAME)
        for topic in (_WRENCH_TOPIC, f'{NODE}/loads/tip'):
            for _ in range(_FILL_BURSTS):
                self._burst([(topic, longest)], _FILL_MESSAGES)

    def _burst(self, messages: list[tuple[str, bytes]], count: int) -> None:
        before = self.settle()
        for number in range(count):
            self._send(*messages[number % len(messages)])
        arrived = self.settle(_BURST_REPORTS) - before
        self.displaced += count - arrived
        self.burst_count += count
        if not 0 < arrived <= count:
            self.problems.append(f'{arrived} of a burst of {count} were dropped')

    def overload(self) -> None:
        """Send a huge force, which must be dropped or stop the simulation, and reset."""
        if not self._recording:
            return
        first, before = len(self.watch.events), self.settle()
        body = self.generator.randint(0, _LAST_BODY)
        force = self.generator.choice(_OVERLOADS)
        self._send(_WRENCH_TOPIC, wrench(f'icosahedron_{body}', (force, 0.0, 0.0)))
        reports = self.watch.next_reports(2)
        dropped = self.settle() > before
        failed = any(event['event'] == 'failed' for event in self.watch.events[first:])
        self.done['overload, dropped'] += dropped
        self.done['overload, failed'] += failed
        if failed and not any(status.level == ERROR for status in reports):
            self.problems.append('the simulation has failed without a report')
        self._send(_WRENCH_TOPIC, wrench(f'icosahedron_{body}'))
        self.expect('reset')

    # Requests to the run.

    def reweave(self) -> None:
        """Change the weave by one or several changes of parameters."""
        generator = self.generator
        values = {
            'weave__size': [generator.randint(2, 6), *generator.choices(range(2, 5), k=2)],
            'weave__variant': generator.randint(0, 3),
            'connector__stiffness': round(generator.uniform(300.0, 2000.0), 1),
            'shell__density': round(generator.uniform(600.0, 2400.0), 1)}
        changes: dict[str, Any] = {
            name: value for name, value in values.items() if generator.random() < 0.4}
        changes = changes or {'weave__variant': generator.randint(0, 3)}
        results, _ = self.graph.set(atomically=generator.random() < 0.6, **changes)
        for result in results:
            if not result.successful:
                self.problems.append(f'{changes} was refused: {result.reason}')

    def retune(self) -> None:
        """Change rates and other live parameters."""
        generator = self.generator
        results, _ = self.graph.set(
            publish_rate=generator.choice([30.0, 60.0, 97.0]),
            marker_rate=generator.choice([5.0, 10.0]), step_count=generator.randint(1, 50),
            reset_time=generator.random() < 0.5)
        if not results[0].successful:
            self.problems.append(f'rates were refused: {results[0].reason}')

    def pause_and_step(self) -> None:
        """Pause, send wrenches, step up to two times, and resume."""
        self.expect('pause', data=True)
        self.push()
        for _ in range(self.generator.randint(0, 2)):
            self.expect('step')
        time.sleep(self.generator.uniform(0.0, 1.0))
        self.expect('pause', data=False)

    def reset(self) -> None:
        """Reset the state, and the time if reset_time is set."""
        self.expect('reset')

    def save(self) -> None:
        """Save a checkpoint."""
        self.expect('save_checkpoint')

    def restore(self) -> None:
        """Restore the last checkpoint, which is refused if the fabric has changed."""
        answer, _ = self.graph.call('restore_checkpoint')
        self.done['restore, refused'] += not answer.success

    def switch_recording(self) -> None:
        """Start or stop recording."""
        if self._recording:
            self.settle()
            self._recording = False
            self.expect('record', data=False)
        else:
            self.expect('record', data=True)
            self._recording = True

    def set_invalid_parameter(self) -> None:
        """Request a change that must be refused."""
        name, value = self.generator.choice([
            ('weave.size', [1000, 1000, 1000]), ('weave.size', [0, 3, 3]),
            ('weave.size', [-2**62, 2**62, 3]), ('shell.density', float('nan')),
            ('connector.stiffness', -1.0), ('no.such.thing', 1), ('weave.variant', 7),
            ('groups.tip', 'x_mox'), ('groups.tip', '!!python/object/apply:os.system [true]'),
            ('clock_rate', 0.0), ('weave.size', 'many'), ('loads.a-b.group', 'tip')])
        results, _ = self.graph.set(
            atomically=self.generator.random() < 0.5, **{name.replace('.', '__'): value})
        if any(result.successful for result in results):
            self.problems.append(f'{name} = {value!r} was accepted')

    # Between actions.

    def expect(self, service: str, **fields: Any) -> None:
        """Call a service that must succeed."""
        answer, _ = self.graph.call(service, 'SetBool' if fields else 'Trigger', **fields)
        if not answer.success:
            self.problems.append(f'~/{service} {fields or ""}: {answer.message}')

    def settle(self, count: int = 1) -> int:
        """
        Wait until all messages have acted or were dropped; return the number of dropped ones.

        This is the case when `count` reports, one per second, equal the one before.
        """
        for _ in range(2):  # messages that arrive first are handled first
            self.graph.get('step_count')
        before, same = -1, 0
        while True:
            values = self.watch.next_reports()[0].values
            dropped = int(values['wrenches dropped'])
            same = same + 1 if dropped == before and values['loads waiting'] == '0' else 0
            if same >= count:
                return dropped
            before = dropped

    def finish(self) -> int:
        """Leave a bag open; return the number of dropped wrenches."""
        if not self._recording:
            self.switch_recording()
        return self.settle(_BURST_REPORTS)
