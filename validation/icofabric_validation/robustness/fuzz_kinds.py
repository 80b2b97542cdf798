# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Kinds of input for fuzz.py: their cases, and the expected results."""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, redirect_stderr, redirect_stdout
import hashlib
import io
from pathlib import Path
import random
import shutil
import struct
from typing import Any, NamedTuple, Protocol

import icofabric_sim as ico
from icofabric_sim import messages
from icofabric_sim.bag import BagError, BagReader, BagRecorder, recover_bag
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.bag.summary import summarise_bag
from icofabric_sim.commands.main import main as icofabric
from icofabric_sim.messages import input_topics
from icofabric_sim.parameters.example_scenes import example_scenes
from icofabric_sim.parameters.file import (
    check_ros_arguments,
    dump_parameters,
    load_parameter_file,
    ParameterFileError,
)
from icofabric_sim.parameters.table import BY_NAME
from icofabric_sim.parameters.validation import make_parameters, ParameterError
from icofabric_sim.running.recording import BagSink, summarise_run
from icofabric_sim.running.replay.verify import verify_run
from icofabric_sim.running.runner import Runner
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.errors import SimulationError
import numpy as np

REFUSED, ACCEPTED = 'refused', 'accepted'
SCENE: dict[str, Any] = {
    'weave.size': [2, 2, 2], 'contact.mode': 'never', 'groups.tip': 'ids 1',
    'groups.moved': 'ids 0', 'loads.tip.group': 'tip', 'drives.moved.group': 'moved',
    'solver.method': 'srkn4', 'real_time_factor': 0.0, 'duration': 0.03,
    'publish_rate': 300.0, 'initial_random.velocity_sigma': 0.1}
# Largest number of bodies in a scene that is built.
_MAX_BODIES = 2000
_EXTREME_WORDS = (0, 1, 3, 0x7F, 0x80, 0xFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
_TEXTS = ('0', '-1', '1e308', '-1e308', '1e-320', '.nan', '.inf', '0x10', '1_0', '99999999999',
          '1.5', 'true', 'off', 'null', '~', '""', '[]', '[1, 2]', '{}', '1:30', "'", '\\', '@',
          '9' * 400, 'é', '\0', '!!python/object:os.system', '&a [*a]', '- 1', '%', '\t')


class Fault(Exception):
    """A wrong result."""


class Subject(Protocol):
    """A reader that receives the cases of one kind."""

    def run_case(self, chance: random.Random) -> str:
        """Run one case and return REFUSED or ACCEPTED; exceptions are faults."""

    def end(self) -> str:
        """Return the fault after all cases, or an empty string."""


def damaged(data: bytes, chance: random.Random) -> bytes:
    """Return data that is cut, extended, reordered, flipped, with absurd lengths, or equal."""
    found = bytearray(data)
    for _ in range(chance.choice((1, 1, 1, 2, 4))):
        size = len(found)
        place = chance.randrange(size + 1)
        action = chance.randrange(8)
        if action == 0:
            del found[place:]
        elif action == 1:
            found[place:place] = chance.randbytes(chance.choice((1, 4, 8, 200)))
        elif action == 2 and size:
            found[place % size] ^= 1 << chance.randrange(8)
        elif action == 3 and size >= 4:
            struct.pack_into('<I', found, place % (size - 3) & ~3, chance.choice(_EXTREME_WORDS))
        elif action == 4:
            length = chance.choice((1, 4, 16))
            piece = found[place:place + length]
            del found[place:place + length]
            other = chance.randrange(len(found) + 1)
            found[other:other] = piece
        elif action == 5 and size >= 8:
            struct.pack_into('<d', found, place % (size - 7) & ~3, chance.choice(
                (float('nan'), float('inf'), -0.0, 1e308, 5e-324)))
        elif action == 6:
            found += bytes(chance.choice((1, 3, 7, 8, 1000)))
        elif size:
            found[place % size] = chance.randrange(256)
    return bytes(found)


class _Messages:
    """All decoders of messages."""

    def __init__(self, folder: Path) -> None:
        self._good: list[tuple[str, Callable[[bytes], Any], bytes]] = []
        wrench = messages.WrenchStampedBytes('icosahedron_1')
        wrench.force[:], wrench.torque[:] = (1.0, 2.0, 3.0), (4.0, 5.0, 6.0)
        twist = messages.TwistStampedBytes('world')
        twist.linear[:] = 1.0
        point = messages.PointStampedBytes('icosahedron_2')
        point.point[:] = 0.5
        poses = messages.PoseArrayBytes('world', 3)
        poses.values[:] = np.arange(21.0).reshape(3, 7)
        # Recorded messages of a run.
        bag = _record(folder / 'bag')
        with BagReader(bag) as reader:
            kept = {topic: (reader.topics[topic].type_name, data)
                    for topic, _, data in reader.messages()}
        status = messages.DiagnosticStatus(1, 'fabric', 'slow', 'x', {'step': '1e-6'})
        decoders: dict[str, Callable[[bytes], Any]] = {
            'geometry_msgs/msg/PoseArray': messages.decode_pose_array,
            'visualization_msgs/msg/Marker': messages.decode_marker_points,
            'std_msgs/msg/Float64MultiArray': messages.decode_float64_multi_array,
            'std_msgs/msg/String': messages.decode_string,
            'std_msgs/msg/UInt8MultiArray': messages.decode_uint8_multi_array,
            'rosgraph_msgs/msg/Clock': messages.decode_clock,
            'diagnostic_msgs/msg/DiagnosticArray': messages.decode_diagnostic_array,
            'geometry_msgs/msg/WrenchStamped': input_topics.decode_wrench_stamped,
            'geometry_msgs/msg/TwistStamped': input_topics.decode_twist_stamped,
            'geometry_msgs/msg/PointStamped': input_topics.decode_point_stamped}
        examples = [*kept.values(), (wrench.TYPE, wrench.stamped(5)),
                    (twist.TYPE, twist.stamped(6)), (point.TYPE, point.stamped(7)),
                    (poses.TYPE, poses.stamped(8)),
                    (messages.DiagnosticArrayBytes.TYPE,
                     messages.DiagnosticArrayBytes().stamped(9, [status]))]
        for type_name, data in examples:
            if type_name in decoders:
                self._good.append((type_name, decoders[type_name], data[:4000]))

    def run_case(self, chance: random.Random) -> str:
        type_name, decode, good = chance.choice(self._good)
        if chance.random() < 0.1:
            good = chance.choice(self._good)[2]
        data = chance.randbytes(chance.randrange(300)) if chance.random() < 0.02 else damaged(
            good, chance)
        try:
            found = decode(data)
        except ValueError as error:
            if not str(error).startswith(f'not a {type_name}: '):
                raise
            return REFUSED
        if repr(decode(data)) != repr(found):
            raise Fault(f'two readings of a {type_name} differ')
        return ACCEPTED

    def end(self) -> str:
        return ''


class _Inputs:
    """Messages on the topics of a run, each of which acts, waits or is dropped."""

    def __init__(self, folder: Path) -> None:
        self._runner = Runner(_simulation(), [])
        self._inputs = self._runner.inputs
        self._good = []
        for topic in ('~/wrench', '~/loads/tip', '~/drives/moved', '~/pull'):
            for number in range(3):
                frame = f'icosahedron_{number}' if topic in ('~/wrench', '~/pull') else ''
                kind = {'~/pull': messages.PointStampedBytes,
                        '~/drives/moved': messages.TwistStampedBytes}.get(
                            topic, messages.WrenchStampedBytes)
                message = kind(frame)
                data = bytearray(message.stamped(number * 10**8))
                self._good.append((topic, bytes(data)))

    def run_case(self, chance: random.Random) -> str:
        topic, data = chance.choice(self._good)
        if chance.random() < 0.1:
            topic = chance.choice(self._good)[0]
        inputs = self._inputs
        before = inputs.dropped, inputs.acted, len(inputs)
        inputs.take(topic, damaged(data, chance))
        dropped, acted, waiting = (
            now - then for now, then in zip(
                (inputs.dropped, inputs.acted, len(inputs)), before, strict=True))
        if dropped + acted + waiting != 1:
            raise Fault(
                f'one message counts as {dropped} dropped, {acted} acted, {waiting} waiting')
        if self._runner.failure:
            raise Fault(self._runner.failure)
        if waiting and len(inputs) > 50:
            inputs.drop_waiting('the case is over')
        return REFUSED if dropped else ACCEPTED

    def end(self) -> str:
        finite = np.isfinite(self._runner.simulation.snapshot().position).all()
        return '' if finite and self._runner.now == 0 else 'the state has changed'


class _Checkpoints:
    """Files of checkpoints, with wrong or corrected checksums."""

    def __init__(self, folder: Path) -> None:
        self._simulation, self._path = _simulation(), folder / 'a.checkpoint'
        self._simulation.advance_to(0.01)
        self._simulation.apply_wrench('tip', (0.0, 0.0, 0.01), time=0.02)
        self._good = self._simulation.checkpoint().to_bytes()
        other = ico.compile_scene(ico.Scene.from_parameters({'weave.size': [3, 2, 2]}))
        self._foreign = other.checkpoint().to_bytes()

    def run_case(self, chance: random.Random) -> str:
        data = damaged(self._foreign if chance.random() < 0.05 else self._good, chance)
        if chance.random() < 0.7 and len(data) > 64:
            body = bytearray(data[:-32])
            struct.pack_into('<Q', body, 16, len(data))
            data = bytes(body) + hashlib.sha256(body).digest()
        self._path.write_bytes(data)
        simulation = self._simulation
        try:
            checkpoint = Checkpoint.load(self._path)
        except ValueError as error:
            if str(self._path) not in str(error):
                raise Fault(f'the error does not name the file: {error}') from error
            return REFUSED
        try:
            simulation.restore(checkpoint)
        except ValueError as error:
            if 'checkpoint' not in str(error):
                raise Fault(f'the error does not name the checkpoint: {error}') from error
            if simulation.checkpoint().to_bytes() != self._good:
                raise Fault('a refused checkpoint has changed the run') from error
            return REFUSED
        if data == self._good:
            return ACCEPTED
        # A complete other state: the run continues, or raises the reason why not.
        try:
            simulation.advance_to(simulation.time + 1e-5)
        except SimulationError:
            pass
        finally:
            simulation.restore(Checkpoint.from_bytes(self._good))
        return ACCEPTED

    def end(self) -> str:
        same = self._simulation.checkpoint().to_bytes() == self._good
        return '' if same else 'the run has changed'


class _Scenes:
    """Parameter files."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / 'scene.yaml'
        self._good = [path.read_text(encoding='utf-8') for path in example_scenes().values()]
        self._names = list(BY_NAME)

    def run_case(self, chance: random.Random) -> str:
        self._path.write_bytes(self._case(chance))
        try:
            given = load_parameter_file(self._path)
            scene = make_parameters(given)
            size = scene['weave.size']
            if np.prod(np.array(size, float)) <= _MAX_BODIES and not any(scene['weave.box']):
                ico.Scene.from_parameters(scene)
        except ParameterFileError as error:
            if str(self._path) not in str(error):
                raise Fault(f'the error does not name the file: {error}') from error
            return REFUSED
        except ParameterError as error:
            if error.name not in str(error):
                raise Fault(f'the error does not name {error.name}: {error}') from error
            return REFUSED
        except ValueError as error:
            if str(error).split()[0].rstrip(':') not in self._names:
                raise
            return REFUSED
        self._path.write_text(dump_parameters(given), encoding='utf-8')
        again = load_parameter_file(self._path)
        if repr(sorted(again.items())) != repr(sorted(given.items())):
            raise Fault('the parameters change when they are written and read again')
        return ACCEPTED

    def _case(self, chance: random.Random) -> bytes:
        text = chance.choice(self._good)
        action = chance.randrange(4)
        if action == 0:
            return damaged(text.encode(), chance)
        lines = text.splitlines()
        for _ in range(chance.choice((1, 1, 3))):
            place = chance.randrange(len(lines))
            if action == 1 and ':' in lines[place]:
                name = lines[place].partition(':')[0]
                lines[place] = f'{name}: {chance.choice(_TEXTS)}'
            elif action == 2:
                name = chance.choice(self._names)
                lines.append(f'    {name}: {chance.choice(_TEXTS)}')
            else:
                other = chance.randrange(len(lines))
                lines[place], lines[other] = lines[other], lines[place]
        return '\n'.join(lines).encode()

    def end(self) -> str:
        return ''


class _Arguments:
    """Command lines of the node and of verbs that only read."""

    _WORDS = ('--ros-args', '-p', '--params-file', '-r', '--', '__node:=x', '__ns:=/y', ':=', 'a',
              'weave.size:=[2, 2, 2]', 'weave.size:=[2', 'gravity:=down', '/**:a:=1', '-e', '',
              'no/such.yaml', '--log-level', '\0', 'é:=ü', ':' * 50, 'x:=' + '[' * 3000,
              'duration:=1e999', '--param', '__name:=1', '-r __ns:=//')
    _VERBS = ('info', 'verify', 'plot', 'recover', 'new', 'render', 'completion', 'fly', 'tables',
              'statics', 'modes', '--version')
    _MORE = ('--json', '--start', '--stop', '--threads', '-1', 'nan', '1e400', '', 'no/such',
             '.', '/dev/null', 'hanging_slab', '--node', '-p', 'weave.size:=x', '--frames', '0',
             '--size', '\udcff', '5', '99', '--help', '--output', '/proc/none/x', 'energy')

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def run_case(self, chance: random.Random) -> str:
        if chance.random() < 0.99:
            words = [self._word(chance) for _ in range(chance.randrange(8))]
            if chance.random() < 0.8:
                words.insert(0, '--ros-args')
            try:
                check_ros_arguments(words)
            except (ParameterFileError, ParameterError):
                return REFUSED
            return ACCEPTED
        words = [chance.choice(self._VERBS), *(
            chance.choice(self._MORE) for _ in range(chance.randrange(5)))]
        if words[0] in ('statics', 'modes', 'render', 'plot') and 'hanging_slab' in words:
            words.remove('hanging_slab')
        said, results = io.StringIO(), io.StringIO()
        status: str | int | None
        try:
            with redirect_stderr(said), redirect_stdout(results):
                status = icofabric(words)
        except SystemExit as error:
            status = error.code
        if status not in (0, 1, 2):
            raise Fault(f'{words}: exit status {status}')
        if status and not said.getvalue().startswith('icofabric') or 'Traceback' in (
                said.getvalue()):
            raise Fault(f'{words}: {said.getvalue()[:300]!r}')
        return REFUSED if status else ACCEPTED

    def _word(self, chance: random.Random) -> str:
        word = chance.choice(self._WORDS)
        if chance.random() < 0.3 and word:
            place = chance.randrange(len(word))
            word = word[:place] + chance.choice(_TEXTS) + word[place + chance.randrange(2):]
        return word

    def end(self) -> str:
        return ''


class _Bags:
    """Recorded runs, which must have the recorded messages if they verify as identical."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._bag = folder, _record(folder / 'bag')
        self._sqlite = _record(folder / 'other', **{'record.storage': 'sqlite3'})
        self._foreign = folder / 'foreign'
        with BagRecorder(self._foreign) as recorder:
            recorder.add_topic('/icofabric/poses', messages.PoseArrayBytes.TYPE)
            recorder.write(
                '/icofabric/poses', 0, messages.PoseArrayBytes('world', 4).stamped(0))
        self._content = {path: _content(path) for path in (
            self._bag, self._sqlite, self._foreign)}

    def run_case(self, chance: random.Random) -> str:
        source = chance.choices(
            (self._bag, self._sqlite, self._foreign), (16, 3, 1))[0]
        path = self._folder / 'case'
        shutil.rmtree(path, ignore_errors=True)
        action = chance.random()
        if action < 0.4:
            self._write_changed(source, path, chance)
        else:
            shutil.copytree(source, path)
            files = sorted(path.iterdir())
            file = chance.choice(files)
            file.write_bytes(damaged(file.read_bytes(), chance))
            if chance.random() < 0.1:
                chance.choice(files).unlink()
        try:
            summarise_bag(path)
        except BagError as error:
            _require_name(error, path)
        if chance.random() < 0.2:
            whole = self._folder / 'whole'
            shutil.rmtree(whole, ignore_errors=True)
            try:
                recover_bag(path, whole)
            except BagError as error:
                _require_name(error, path, whole)
            else:
                path = whole
        return self._verify(source, path)

    def _verify(self, source: Path, path: Path) -> str:
        try:
            with RecordedRun(path, '/icofabric') as run:
                result = verify_run(run)
        except BagError as error:
            _require_name(error, path)
            return REFUSED
        if result.verdict == 'identical':
            content, lists = _content(path)
            before, lists_before = self._content[source]
            # A recovery may cut messages at the end.
            if path.name == 'whole':
                before = before[:len(content)]
                lists_before = lists_before & lists
            if (content, lists) != (before, lists_before):
                raise Fault('it verifies as identical, but holds other messages: ' + next(
                    (f'{one[:2]} is {other[:2]}' for one, other in zip(before, content)
                     if one != other),
                    f'{len(content)} of {len(before)}, {lists.total()} of '
                    f'{lists_before.total()} lists of connectors'))
            return ACCEPTED
        return REFUSED

    def _write_changed(self, source: Path, path: Path, chance: random.Random) -> None:
        """Write a changed bag with right checksums, as another tool would."""
        with BagReader(source) as reader:
            topics, custom, found = reader.topics, reader.custom, list(reader.messages())
        place, other = chance.randrange(len(found)), chance.randrange(len(found))
        topic, time, data = found[place]
        action = chance.randrange(6) if custom else 5
        if action == 0:
            del found[place]
        elif action == 1:
            found.insert(other, found[place])
        elif action == 2:
            found[place] = topic, max(0, time + chance.randrange(-10**7, 10**7)), data
        elif action == 3:
            found[place], found[other] = (topic, time, found[other][2]), (
                found[other][0], found[other][1], data)
        elif action == 4:
            custom[chance.choice(sorted(custom))] = chance.choice(_TEXTS).replace('\0', '')
        else:
            found[place] = topic, time, damaged(data, chance)
        known = {name: kind.type_name for name, kind in topics.items()}
        with BagRecorder(path) as recorder:
            for name in known:
                recorder.add_topic(
                    name, known[name], latched=topics[name].latched,
                    depth=topics[name].depth or None)
            for name, at, item in found:
                recorder.write(name, at, item)
            for key, value in custom.items():
                if action == 4:
                    recorder.set_custom(key, value)

    def end(self) -> str:
        return ''


def _require_name(error: BagError, *paths: Path) -> None:
    if not any(str(path) in str(error) for path in paths):
        raise Fault(f'the error does not name the bag: {error}') from error


def _content(path: Path) -> tuple[list[tuple[str, int, Any]], Counter[tuple[str, int, Any]]]:
    """
    Return the messages of the run in order, and lists of connectors.

    Messages of the recorder and of saved checkpoints are left out. Some messages are compared by
    values instead of bytes, because padding is arbitrary and slightly different forces may give a
    bit-identical run. The order of lists of connectors at one time is arbitrary.
    """
    with BagReader(path) as reader:
        found = [(topic, time, _values(topic, data)) for topic, time, data in reader.messages()
                if topic != '/icofabric/recording' and b'checkpoint_saved' not in data]
    return ([item for item in found if item[0] != '/icofabric/connectors'],
            Counter(item for item in found if item[0] == '/icofabric/connectors'))


def _values(topic: str, data: bytes) -> Any:
    try:
        if topic == '/clock':
            return messages.decode_clock(data)
        if topic.startswith(('/icofabric/wrench', '/icofabric/loads/')):
            _, frame, force, torque = input_topics.decode_wrench_stamped(data)
            return frame, [f'{number:.9f}' for number in (*force, *torque)]
        if topic in ('/icofabric/weave', '/icofabric/events'):
            return messages.decode_string(data)
    except ValueError:
        pass
    return data


def _simulation(**changes: Any) -> ico.Simulation:
    return ico.compile_scene(ico.Scene.from_parameters({**SCENE, **changes}))


def _record(path: Path, **changes: Any) -> Path:
    """Record a short run with wrenches and a checkpoint."""
    simulation = _simulation(**changes)
    bag = BagSink(path, simulation, live=False)
    runner = Runner(simulation, [bag])
    for number in range(4):
        message = messages.WrenchStampedBytes('icosahedron_2' if number % 2 else '')
        message.force[:] = 0.01 * number
        runner.inputs.receive(
            '~/wrench' if number % 2 else '~/loads/tip', message.stamped(7 * 10**6 * number))
    runner.save_checkpoint(path.with_suffix('.checkpoint'))
    runner.run(until_finished=True)
    bag.close(summary=summarise_run(runner.status()))
    return path


class Kind(NamedTuple):
    """A kind of input, with its default number of cases."""

    subject: Callable[[Path], AbstractContextManager[Subject]]
    cases: int


def _plain(made: Callable[[Path], Subject]) -> Callable[[Path], AbstractContextManager[Subject]]:
    @contextmanager
    def opened(folder: Path) -> Iterator[Subject]:
        yield made(folder)

    return opened


KINDS = {
    'messages': Kind(_plain(_Messages), 1_000_000),
    'inputs': Kind(_plain(_Inputs), 200_000),
    'checkpoints': Kind(_plain(_Checkpoints), 50_000),
    'scenes': Kind(_plain(_Scenes), 10_000),
    'arguments': Kind(_plain(_Arguments), 30_000),
    'bags': Kind(_plain(_Bags), 3_000),
}
