# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Checkpoints as bytes and files: whole ones come back as they were, others are refused."""

import hashlib
import json
import os
import tracemalloc

from fabrics import make_scene, RANDOM
import icofabric_sim as ico
from icofabric_sim.parameters.table import BY_NAME, Change
from icofabric_sim.simulation.checkpoints import checkpoint as module
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.checkpoints.difference import material
from icofabric_sim.simulation.checkpoints.encoding import HEAD
from icofabric_sim.simulation.errors import Interrupted
import numpy as np
import pytest

CHECKSUM = 32


def make_run(method='srkn4'):
    """A run in the middle of a step, with loads that act and loads that are to come."""
    scene = make_scene((2, 2, 2), {
        'solver.method': method, 'groups.tip': 'ids 0 2', 'loads.tip.group': 'tip',
        'loads.tip.hold': 0.1, 'solver.tolerance': 1e-4}, **RANDOM)
    run = ico.compile_scene(scene)
    run.advance_steps(3)
    run.apply_wrench('tip', (0.1, 0.2, 0.3))
    run.apply_body_wrench(1, (0.1, 0.2, 0.3), time=run.time + 1.0)
    run.advance_steps(2)
    run.advance_to(run.time + 0.4 * run.status.step)
    return run


@pytest.fixture(scope='module')
def run():
    return make_run()


@pytest.fixture(scope='module')
def data(run):
    return run.checkpoint().to_bytes()


def packed(text, arrays=b'', *, total=None, length=None):
    """Bytes with a right checksum around a text and what is said to be arrays."""
    if not isinstance(text, bytes):
        text = json.dumps(text).encode()
    text += b' ' * (-(HEAD + len(text)) % 64)
    size = HEAD + len(text) + len(arrays) + CHECKSUM
    head = b'icofabric-state\n' + (size if total is None else total).to_bytes(8, 'little')
    head += (len(text) if length is None else length).to_bytes(8, 'little')
    body = head + text + arrays
    return body + hashlib.sha256(body).digest()


def taken_apart(data):
    """Text and arrays of the bytes of a checkpoint."""
    length = int.from_bytes(data[HEAD - 8:HEAD], 'little')
    return json.loads(data[HEAD:HEAD + length]), data[HEAD + length:-CHECKSUM]


def test_bytes_come_back_as_they_were(run, data):
    checkpoint = run.checkpoint()
    again = Checkpoint.from_bytes(data)
    assert again.to_bytes() == data and again.header == checkpoint.header
    assert again.arrays.keys() == checkpoint.arrays.keys()
    for name, array in checkpoint.arrays.items():
        assert again.arrays[name].tobytes() == np.ascontiguousarray(array).tobytes()
    assert again.time == run.time > 0.0
    for other in (bytearray(data), memoryview(data)):
        assert Checkpoint.from_bytes(other).difference(checkpoint) == ''
    assert packed(*taken_apart(data)) != data  # other blanks, and yet
    assert Checkpoint.from_bytes(packed(*taken_apart(data))).difference(checkpoint) == ''


def test_header_says_what_it_is_of(run):
    header = run.checkpoint().header
    assert header['version'] == ico.__version__ and header['method'] == 'srkn4'
    assert header['body_count'] == 4 and header['time'] == run.time
    assert "method: 'srkn4'" in header['scene'] and header['processor']
    assert set(header['libraries']) == {'numpy', 'scipy', 'numba', 'llvmlite'}


def test_files_come_back_and_are_replaced_whole(run, data, tmp_path, monkeypatch):
    path = tmp_path / 'one.checkpoint'
    run.checkpoint().save(path)
    assert path.read_bytes() == data and os.listdir(tmp_path) == [path.name]
    assert Checkpoint.load(str(path)).difference(run.checkpoint()) == ''
    later = make_run()
    later.advance_to(later.time + 0.01)
    later.checkpoint().save(str(path))
    assert Checkpoint.load(path).time == later.time
    kept = path.read_bytes()

    def full(header, arrays):
        yield b'half of it'
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(module, 'encode', full)
    with pytest.raises(OSError, match='No space left'):
        run.checkpoint().save(path)
    # What was there is there still, and nothing else.
    assert path.read_bytes() == kept and os.listdir(tmp_path) == [path.name]


def test_files_that_cannot_be_written_or_read_are_errors_of_the_system(run, tmp_path):
    for path in (tmp_path / 'nowhere' / 'x', tmp_path, '/proc/x'):
        with pytest.raises(OSError):
            run.checkpoint().save(path)
    assert os.listdir(tmp_path) == []
    for path in (tmp_path / 'nowhere', tmp_path):
        with pytest.raises(OSError):
            Checkpoint.load(path)


def test_what_is_no_file_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / 'pipe')
    for path in ('/dev/zero', tmp_path / 'pipe'):
        with pytest.raises(ValueError, match=f'{path}: this is not an ordinary file'):
            Checkpoint.load(path)


def test_huge_files_are_not_read(data, tmp_path):
    path = tmp_path / 'sparse'
    with path.open('wb') as file:
        file.write(b'icofabric-state\n' + (2**42).to_bytes(8, 'little') + b'\0' * 8)
        file.truncate(2**42)
    tracemalloc.start()
    with pytest.raises(ValueError, match='more than the memory of this machine'):
        Checkpoint.load(path)
    path.write_bytes(data[:16] + (2**40).to_bytes(8, 'little') + data[24:])
    with pytest.raises(ValueError, match='bytes instead of 1,099,511,627,776'):
        Checkpoint.load(path)
    assert tracemalloc.get_traced_memory()[1] < 10**6
    tracemalloc.stop()


def test_what_is_cut_short_or_goes_on_is_refused(data, tmp_path):
    for count in [*range(100), *range(100, len(data), 37), len(data) - 1]:
        with pytest.raises(ValueError, match='not a checkpoint that can be read: it is cut short|'
                                             'it is not a checkpoint of icofabric_sim'):
            Checkpoint.from_bytes(data[:count])
    with pytest.raises(ValueError, match='followed by something else'):
        Checkpoint.from_bytes(data + b'x')
    path = tmp_path / 'cut'
    path.write_bytes(data[:-100])
    with pytest.raises(ValueError, match=rf'cut: it has {len(data) - 100:,} bytes instead of'):
        Checkpoint.load(path)


def test_every_flipped_bit_is_found(data):
    generator = np.random.default_rng(0)
    for place in [*range(HEAD), *generator.integers(HEAD, len(data), 300)]:
        changed = bytearray(data)
        changed[place] ^= 1 << generator.integers(8)
        with pytest.raises(ValueError, match='not a checkpoint that can be read'):
            Checkpoint.from_bytes(changed)


@pytest.mark.parametrize('junk', [
    b'', b'\0' * 1000, b'\x80\x04\x95.', b'PK\x03\x04' * 50, b'icofabric-state\n' * 30])
def test_something_else_is_refused(junk):
    with pytest.raises(ValueError, match='not a checkpoint that can be read'):
        Checkpoint.from_bytes(junk)


@pytest.mark.parametrize('text, words', [
    (b'\xff\xfe', 'its text cannot be read'),
    (b'{"header": {}, "arrays": []', 'its text cannot be read'),
    (b'[' * 100_000, 'its text cannot be read: nested too deeply'),
    (b'{"header": {"a": NaN}, "arrays": []}', 'NaN is not a number'),
    (b'9' * 10_000, 'its text cannot be read'),
    ([], 'not an object with a header and arrays'),
    ({'header': {}, 'arrays': [], 'more': 1}, 'not an object with a header and arrays'),
    ({'header': [], 'arrays': []}, 'its header is not an object'),
    ({'header': {}, 'arrays': {}}, 'arrays are not a list'),
    ({'header': {}, 'arrays': [5]}, 'other than a name with a shape'),
    ({'header': {}, 'arrays': [['../x', [0]]]}, 'a name that is wrong or used'),
    ({'header': {}, 'arrays': [['a', [0]], ['a', [0]]]}, 'a name that is wrong or used'),
    ({'header': {}, 'arrays': [['a', [-1]]]}, 'an invalid shape'),
    ({'header': {}, 'arrays': [['a', [True]]]}, 'an invalid shape'),
    ({'header': {}, 'arrays': [['a', [1.5]]]}, 'an invalid shape'),
    ({'header': {}, 'arrays': [['a', 3]]}, 'an invalid shape'),
    ({'header': {}, 'arrays': [['a', [2**40, 2**40]]]}, 'claims to have .* 16 are left'),
    ({'header': {}, 'arrays': [['a', [3]]]}, 'claims to have 24 bytes, but 16 are left'),
    ({'header': {}, 'arrays': [['a', [0, 2**40]]]}, '16 of its bytes belong to no array'),
    ({'header': {}, 'arrays': [['a', [1]]]}, '8 of its bytes belong to no array'),
    ({'header': {}, 'arrays': [['a', [2]]]}, 'header.format is missing'),
    ({'header': {'format': 3}, 'arrays': [['a', [2]]]}, 'its format is 3'),
    ({'header': {'format': '1'}, 'arrays': [['a', [2]]]}, "must be a whole number .*, got '1'"),
    ({'header': {'format': 2, 'version': 1}, 'arrays': [['a', [2]]]}, 'version must be a text'),
])
def test_hostile_texts_with_a_right_checksum_are_refused(text, words):
    tracemalloc.start()
    with pytest.raises(ValueError, match=f'not a checkpoint that can be read: .*{words}'):
        Checkpoint.from_bytes(packed(text, b'\0' * 16))
    assert tracemalloc.get_traced_memory()[1] < 10**7
    tracemalloc.stop()


def test_hostile_lengths_with_a_right_checksum_are_refused(data):
    text, arrays = taken_apart(data)
    for length in (2**63, 2 * len(data), 2**20):
        with pytest.raises(ValueError, match='the length of its text is given as'):
            Checkpoint.from_bytes(packed(text, arrays, length=length))
    with pytest.raises(ValueError, match='fewer than any checkpoint'):
        Checkpoint.from_bytes(b'icofabric-state\n' + (32).to_bytes(8, 'little') + b'\0' * 8)


def test_hostile_scene_is_refused_without_being_executed(run, data, tmp_path):
    text, arrays = taken_apart(data)
    target = tmp_path / 'executed'
    for scene in (
        f'!!python/object/apply:os.system ["touch {target}"]',
        '/**:\n  ros__parameters:\n    weave: {size: [1000000000, 1000000000, 1000000000]}\n',
        'a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]\n', '\0', '[' * 5000,
    ):
        text['header']['scene'] = scene
        checkpoint = Checkpoint.from_bytes(packed(text, arrays))
        with pytest.raises(ValueError):
            run.restore(checkpoint)
    assert not target.exists()
    assert run.checkpoint().to_bytes() == data


NASTY = (None, 'x', 'nan', 'inf', True, -1, 0, 3, 2**70, -0.5, 1e-320, 1e300, [], [None], {})


def spots(value, path=()):
    """Paths of everything in the memory of a header."""
    yield path
    inner = value.items() if isinstance(value, dict) else (
        enumerate(value) if isinstance(value, list) else ())
    for key, entry in inner:
        yield from spots(entry, (*path, key))


@pytest.mark.parametrize('method', ['srkn4', 'dop8'])
def test_hostile_memory_is_refused_or_runs_and_ends(method):
    victim = make_run(method)
    untouched = victim.checkpoint().to_bytes()
    good = Checkpoint.from_bytes(untouched)
    refused = taken = 0

    def try_it(text, arrays):
        nonlocal refused, taken
        try:
            victim.restore(Checkpoint.from_bytes(packed(text, arrays)))
        except ValueError as error:
            refused += 1
            assert 'damaged' in str(error) or 'not a checkpoint that can be' in str(error)
            assert victim.checkpoint().to_bytes() == untouched
            return
        taken += 1
        answers = iter([False] * 20)
        victim.should_stop = lambda: next(answers, True)
        try:
            victim.snapshot()
            victim.advance_steps(1)
            if taken % 3 == 0:
                raise Interrupted  # before the next look, which finds what is not finite
            victim.advance_to(victim.time + 5 * min(victim.status.step, 1.0))
            victim.advance_steps(2)
        except (Interrupted, ico.SimulationError, ValueError, OverflowError):
            pass
        victim.should_stop = None
        # Nothing of it is left.
        victim.restore(good)
        assert victim.checkpoint().to_bytes() == untouched
        victim.advance_to(end)
        assert victim.checkpoint().to_bytes() == expected
        victim.restore(good)

    victim.advance_to(end := victim.time + 3.3 * victim.status.step)
    expected = victim.checkpoint().to_bytes()
    victim.restore(good)
    text, arrays = taken_apart(untouched)
    whole = json.dumps(text)
    for path in spots({'memory': text['header']['memory'], 'time': 0.0}):
        if not path:
            continue
        # Half of the values for each method: places that both methods have get all of them.
        for value in NASTY[(len(path) + len(str(path[-1])) + (method == 'dop8')) % 2::2]:
            changed = json.loads(whole)
            place = changed['header']
            for key in path[:-1]:
                place = place[key]
            place[path[-1]] = value
            try_it(changed, arrays)
    for number, (name, shape) in enumerate(text['arrays']):
        start = 8 * sum(int(np.prod(each)) for _, each in text['arrays'][:number])
        size = 8 * int(np.prod(shape))
        for value in (np.nan, np.inf, -1e300, 0.0):
            filled = np.full(size // 8, value).tobytes()
            try_it(json.loads(whole), arrays[:start] + filled + arrays[start + size:])
        for other in ([size // 8, 1], [1, *shape], [size // 8]):
            changed = json.loads(whole)
            changed['arrays'][number][1] = other
            try_it(changed, arrays)
        changed = json.loads(whole)
        changed['arrays'][number][0] = f'{name}.x' if number % 2 else 'header'
        try_it(changed, arrays)
    assert refused > 350 and taken > 10


def test_what_acts_at_once_does_not_keep_checkpoints_from_other_runs():
    immaterial = BY_NAME.keys() - material(dict.fromkeys(BY_NAME, 0)).keys()
    assert immaterial == {'solver.threads'} | {
        name for name, entry in BY_NAME.items()
        if entry.change in (Change.AT_ONCE, Change.FIXED)}
    assert {'publish_rate', 'frame_id', 'record.path'} < immaterial
