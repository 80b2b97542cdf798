# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Compiled kernels on disk: never stale, never in the package, and a wait for them is explained.

Each case runs small kernels in new processes, in a copy of the package.
"""

import json
import os
from pathlib import Path
import shutil
import subprocess
import sys
import threading
import time
from typing import NamedTuple

import icofabric_sim
from icofabric_sim.kernels.runtime import disk_cache
from icofabric_sim.kernels.runtime.compiled import _NoCache, compiled
from icofabric_sim.kernels.runtime.target import host_levels, settings_of, target
from icofabric_sim.process import wait_notice
from package_imports import imports_of, MODULES
import pytest

CALLEE = """
from icofabric_sim.kernels.runtime.compiled import compiled

@compiled
def weight(value):
    return 2.0 * value
"""
CALLER = """
from typing import NamedTuple
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.trial_callee import weight

class Pair(NamedTuple):
    first: float
    second: float

@compiled
def total(pair):
    return weight(pair.first) + pair.second

make = Pair
"""
# Short compilations are explained, too: a moment is over at once.
RUN = """
import json
{prelude}
from icofabric_sim.process import wait_notice
wait_notice._FIRST_NOTICE_S = 0.0
from icofabric_sim.kernels import trial_caller
{action}
value = trial_caller.total(trial_caller.make(1.0, 10.0))
stats = getattr(trial_caller.total, 'stats', None)
print(json.dumps({{
    'value': value,
    'hits': stats and sum(stats.cache_hits.values()),
    'misses': stats and sum(stats.cache_misses.values()),
    'folder': stats and stats.cache_path}}))
"""


class Ran(NamedTuple):
    """What a process found."""

    value: float
    hits: int | None
    misses: int | None
    folder: str | None
    said: str = ''


class Copy:
    """
    A copy of the package with two more kernels, a user's home, and processes that use them.

    It takes the bytecode along: without it each process would read all sources anew.
    """

    def __init__(self, folder, *, of=None):
        self.folder, self.home = folder, folder / 'home'
        self.home.mkdir()
        self.kernels = folder / 'icofabric_sim' / 'kernels'
        self.cache = self.home / '.cache' / 'icofabric_sim' / 'kernels'
        if of is not None:
            shutil.copytree(of.kernels.parent, self.kernels.parent)
            shutil.copytree(of.cache, self.cache)
            return
        shutil.copytree(
            Path(icofabric_sim.__file__).parent, self.kernels.parent)
        self.write('callee', CALLEE)
        self.write('caller', CALLER)

    def write(self, name, text):
        """Write a source file; its time says nothing about whether it has changed."""
        path = self.kernels / f'trial_{name}.py'
        path.write_text(text)
        os.utime(path, (1.7e9, 1.7e9))

    def start(self, prelude='', action='', **changes):
        """Run the kernels in a new process."""
        environment = {
            name: value for name, value in os.environ.items()
            if not name.startswith('NUMBA_') and name != 'XDG_CACHE_HOME'}
        # Python's own cache of sources goes by time and size, which here stay.
        environment |= {
            'HOME': str(self.home), 'PYTHONDONTWRITEBYTECODE': '1', **changes}
        return subprocess.run(
            [sys.executable, '-c', RUN.format(prelude=prelude, action=action)], env=environment,
            cwd=self.folder, capture_output=True, text=True, timeout=300)

    def run(self, prelude='', action='', **changes):
        """Run the kernels in a new process and read what it found."""
        done = self.start(prelude, action, **changes)
        assert done.returncode == 0, done.stderr
        return Ran(**json.loads(done.stdout), said=done.stderr)

    def files(self, ending='nb?'):
        """Return the cache files of the two kernels."""
        return sorted(self.cache.glob(f'*/kernels/trial_*.{ending}'))

    def entries(self, ending='nb?'):
        """Return their names with times of writing."""
        return {path.name: path.stat().st_mtime_ns for path in self.files(ending)}


@pytest.fixture
def copy(tmp_path):
    return Copy(tmp_path)


@pytest.fixture(scope='module')
def used_once(tmp_path_factory):
    copy = Copy(tmp_path_factory.mktemp('used'))
    assert copy.run().misses == 1 and len(copy.entries()) == 5
    return copy


@pytest.fixture
def used(used_once, tmp_path):
    """A copy whose kernels are compiled; test_each_target_has_its_own_entry finds them there."""
    return Copy(tmp_path, of=used_once)


def test_edited_callee_in_another_file_gives_the_new_result(copy):
    first = copy.run()
    assert first.value == 12.0 and (first.hits, first.misses) == (0, 1)
    assert Path(first.folder).parents[1] == copy.cache
    written = copy.entries()
    # An index for each, and entries of what Python calls, of its part, and of the callee's.
    assert len(written) == 5
    again = copy.run()
    assert again.value == 12.0 and (again.hits, again.misses) == (1, 0)
    assert copy.entries() == written and not again.said
    copy.write('callee', CALLEE.replace('2.0', '3.0'))
    edited = copy.run()
    assert edited.value == 13.0 and edited.misses == 1
    # The kernels of the first source are kept for a copy that still has it.
    assert len(copy.entries('nbc')) == 6
    copy.write('callee', CALLEE)
    assert copy.run().hits == 1


# Both have a function of the same name and type in them: an overload made by a lambda.
PARTS = """
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fabs, lane, splat, sqrt

@compiled
def size(x):
    return lane(fabs(splat(x)), 0)

@compiled
def root(x):
    return lane(sqrt(splat(x)), 0)

@compiled
def one(x):
    return size(x)

@compiled
def other(x):
    return root(x)

@compiled
def total(x):
    return size(x) + 10.0 * root(x)

make = lambda *unused: 9.0
"""


def test_parts_that_several_processes_have_compiled_are_told_apart(copy):
    copy.write('caller', PARTS)
    for name, value in (('one', 9.0), ('other', 3.0)):
        found = copy.run(action=f'trial_caller.total = trial_caller.{name}')
        assert found.value == value
    # Linked from parts on disk.
    found = copy.run()
    assert found.value == 9.0 + 10.0 * 3.0 and found.misses == 1


@pytest.mark.parametrize('way', ['begun', 'forked'])
def test_no_two_processes_number_functions_alike(way):
    number = (
        'from icofabric_sim.kernels.runtime import parts; '
        'from numba.core.bytecode import FunctionIdentity as F; import os, sys; ')
    tell = 'print(next(F._unique_ids), flush=True)'
    if way == 'forked':
        code = number + (
            f'child = os.fork(); status = os.wait()[1] if child else 0; {tell}; sys.exit(status)')
        said = subprocess.run(
            [sys.executable, '-c', code], capture_output=True, text=True, timeout=300,
            check=True).stdout
    else:
        said = ''.join(subprocess.run(
            [sys.executable, '-c', number + tell], capture_output=True, text=True, timeout=300,
            check=True).stdout for _ in range(2))
    first, second = map(int, said.split())
    # Farther apart than what a process compiles.
    assert abs(first - second) > 10**6


ROOM = Path(icofabric_sim.__file__).parent
FOLDERS = sorted({
    str(path.parent.relative_to(ROOM)) for room in disk_cache._STAMPED
    for path in (ROOM / room).rglob('*.py')})


@pytest.mark.parametrize('folder', FOLDERS)
def test_an_edit_in_any_folder_of_kernels_compiles_anew(folder, used):
    with open(used.folder / 'icofabric_sim' / folder / '__init__.py', 'a') as file:
        file.write('\n# edited\n')
    edited = used.run()
    assert edited.value == 12.0 and (edited.hits, edited.misses) == (0, 1)


def test_the_stamp_covers_all_that_kernels_are_made_of():
    """
    Modules with compiled functions, and all that these import, lie in the stamped rooms.

    Or Numba's own stamp of their file covers what is not: they import nothing else. The rooms
    `checks` and `process` are for Python code alone.
    """
    def room_of(module):
        return module.split('.')[1] if '.' in module else ''

    compiled = [name for name, path in MODULES.items() if '\n@compiled\n' in path.read_text()]
    assert len(compiled) > 40
    outside = [name for name in compiled if room_of(name) not in ('kernels', 'terms')]
    assert sorted(outside) == [
        'icofabric_sim.simulation.contact.curvature',
        'icofabric_sim.simulation.devices.rank_kernels']
    for name in MODULES:
        if room_of(name) in disk_cache._STAMPED or name in outside:
            assert {room_of(target.module) for target in imports_of(name)} \
                <= {*disk_cache._STAMPED, 'checks', 'process'}, name


def test_files_of_terms_outside_the_stamp_are_not_compiled():
    """Other files of terms belong to the stamp, whatever their names."""
    terms = [name for name in MODULES if name.startswith('icofabric_sim.terms.')]
    stamped = {Path(path) for path, _ in disk_cache._FILES}
    outside = {name for name in terms if MODULES[name] not in stamped}
    assert outside == {
        name for name in terms if MODULES[name].name in disk_cache._NOT_COMPILED}
    for name in outside:
        assert 'compiled' not in MODULES[name].read_text()
    for name in MODULES:
        if MODULES[name] in stamped:
            assert not outside & {target.module for target in imports_of(name)}, name


GENERIC = {'NUMBA_CPU_NAME': 'generic', 'NUMBA_CPU_FEATURES': ''}
OTHER_HOST = """
from llvmlite import binding
features = binding.get_host_cpu_features()
features['avx512f'] = not features.get('avx512f')
binding.get_host_cpu_features = lambda: features
"""


def test_each_target_has_its_own_entry(used):
    """Machines of one level share entries, however else their processors differ."""
    generic = used.run(**GENERIC)
    assert generic.value == 12.0 and (generic.hits, generic.misses) == (0, 1)
    assert used.run(OTHER_HOST, **GENERIC).hits == 1
    native = used.run(ICOFABRIC_NATIVE='1')
    assert native.value == 12.0 and (native.hits, native.misses) == (0, 1)
    # Beside each other, e.g. in a home folder that several machines share.
    assert used.run().hits == used.run(**GENERIC).hits == 1


def test_settings_of_a_level_give_its_entries(used):
    """`make wheel` compiles for both levels on a processor of the higher one."""
    if not target().level:
        pytest.skip('this processor has no level')
    assert used.run(**settings_of(target().level)).hits == 1
    for level in host_levels():
        ran = used.run(**settings_of(level))
        assert ran.value == 12.0 and ran.hits == (level == target().level)


@pytest.fixture
def wheel(used):
    """A copy whose compiled kernels lie in the package, as in a wheel."""
    stamp, = (path for path in used.cache.iterdir() if list(path.glob('kernels/trial_*')))
    used.shipped = used.kernels / 'compiled' / stamp.name
    shutil.copytree(stamp, used.shipped, ignore=shutil.ignore_patterns('*.lock'))
    shutil.rmtree(used.home / '.cache')
    return used


def contents(folder):
    """Return the files in a folder with their content."""
    return {path: path.read_bytes() for path in folder.rglob('*') if path.is_file()}


FORBIDDEN = """
from icofabric_sim.process.compile_notice import compile_notice
compile_notice.is_forbidden = True
"""
INTEGERS = 'trial_caller.make = lambda *_: trial_caller.Pair(1, 10)'


@pytest.mark.parametrize('home', ['writable', 'blocked'])
def test_kernels_of_a_wheel_are_loaded_without_the_compiler(home, wheel):
    if home == 'blocked':
        block(wheel.home / '.cache')
    before = contents(wheel.kernels / 'compiled')
    ran = wheel.run(FORBIDDEN, NO_COMPILER)
    assert (ran.value, ran.hits, ran.misses, ran.said) == (12.0, 1, 0, '')
    # Other arguments, which the wheel has no kernel for.
    assert 'KernelsMissing' in wheel.start(FORBIDDEN, INTEGERS).stderr
    for hits in (0, 1):
        ran = wheel.run(action=INTEGERS)
        assert (ran.value, ran.misses) == (12.0, 1 if home == 'blocked' else 1 - hits)
        assert ('every start' in ran.said) == (home == 'blocked')
    assert contents(wheel.kernels / 'compiled') == before
    assert bool(wheel.entries()) == (home == 'writable')


@pytest.mark.parametrize('change', ['target', 'numba', 'source', 'damage'])
def test_other_kernels_than_those_of_a_wheel_are_compiled(change, wheel):
    prelude, changes = '', {}
    if change == 'target':
        changes = GENERIC
    elif change == 'numba':
        prelude = "import numba; numba.__version__ = '0.0'"
    elif change == 'source':
        wheel.write('callee', CALLEE + '\n')
    else:
        for path in wheel.shipped.rglob('*.nb?'):
            path.write_bytes(path.read_bytes()[:100])
    before = contents(wheel.kernels / 'compiled')
    ran = wheel.run(prelude, **changes)
    assert (ran.value, ran.misses) == (12.0, 1)
    assert contents(wheel.kernels / 'compiled') == before and wheel.entries()


def test_where_numba_was_first_its_target_stands_and_this_is_said(used):
    late = used.run('import numba')
    assert late.value == 12.0 and (late.hits, late.misses) == (0, 1)
    assert 'Numba was imported before icofabric_sim' in late.said
    # The same entry as where the processor at hand was asked for.
    assert used.run(ICOFABRIC_NATIVE='1').hits == 1


@pytest.mark.parametrize('module', ['numba', 'llvmlite'])
def test_another_compiler_compiles_anew(module, used):
    other = used.run(f"import {module}; {module}.__version__ = '0.0'")
    assert other.value == 12.0 and (other.hits, other.misses) == (0, 1)


def test_nothing_is_written_into_the_package(copy):
    """Files that pip did not install stay behind and shadow an editable install."""
    before = sorted(copy.kernels.parent.rglob('*'))
    assert copy.run(PYTHONDONTWRITEBYTECODE='').misses == 1 and copy.entries()
    new = set(copy.kernels.parent.rglob('*')) - set(before)
    assert {path.suffix for path in new} <= {'.pyc', ''}


def test_copies_of_one_source_share_their_kernels(used, tmp_path):
    other = tmp_path / 'other'
    other.mkdir()
    shutil.copytree(used.kernels.parent, other / 'icofabric_sim')
    again = subprocess.run(
        [sys.executable, '-c', RUN.format(prelude='', action='')], cwd=other, check=True,
        env={**os.environ, 'HOME': str(used.home), 'XDG_CACHE_HOME': ''}, capture_output=True,
        text=True, timeout=300)
    assert Ran(**json.loads(again.stdout)).hits == 1


def test_kernels_of_sources_long_unused_are_removed(used):
    """The most recently used are kept, and folders of other names."""
    for number in range(disk_cache._MAX_STAMP_COUNT + 3):
        folder = used.cache / f'{number:016x}'
        folder.mkdir()
        os.utime(folder, (1.6e9 + number, 1.6e9 + number))
    (used.cache / 'notes').mkdir()
    used.write('callee', CALLEE.replace('2.0', '3.0'))
    assert used.run().value == 13.0
    kept = {path.name for path in used.cache.iterdir()}
    # The new source, that of `used`, and the latest of the others.
    assert len(kept) == disk_cache._MAX_STAMP_COUNT + 1 and 'notes' in kept
    assert f'{disk_cache._MAX_STAMP_COUNT + 2:016x}' in kept and f'{4:016x}' not in kept
    assert len(used.entries('nbc')) == 6


def block(folder):
    """Make `folder` impossible to create: permissions would not bind root."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.parent.mkdir(exist_ok=True)
    folder.write_text('not a folder')


def test_another_cache_folder_can_be_named(copy):
    for name in ('NUMBA_CACHE_DIR', 'XDG_CACHE_HOME'):
        ran = copy.run(**{name: str(copy.folder / name)})
        assert Path(ran.folder).is_relative_to(copy.folder / name) and ran.misses == 1
    assert not copy.entries()


@pytest.mark.parametrize('home', ['blocked', 'missing'])
def test_run_without_any_folder_to_write_says_so_and_works(home, copy):
    block(copy.home / '.cache')
    changes = {} if home == 'blocked' else {'HOME': '/dev/null/home'}
    for _ in range(2):
        ran = copy.run(**changes)
        assert ran.value == 12.0 and ran.folder is None
        assert ran.said.count('\n') == 1
        assert 'every start' in ran.said and 'NUMBA_CACHE_DIR' in ran.said


# Index files are shorter, entries longer.
FULL_DISK = 'import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (1024, 1024))'


def test_full_disk_is_no_end_of_a_run(copy):
    full = copy.run(action=FULL_DISK)
    assert full.value == 12.0 and not copy.entries('nbc')
    assert full.said.count('cannot be kept on disk') == 1
    after = copy.run()
    assert after.value == 12.0 and after.misses == 1
    assert copy.run().hits == 1


@pytest.mark.parametrize(
    ('caller', 'callee'), [({'nbi': 0.5}, {'nbc': 0.0}), ({'nbc': 0.5}, {'nbi': 0.0})])
def test_damaged_files_are_compiled_anew(caller, callee, used):
    for path in used.files():
        share = (caller if 'caller' in path.name else callee).get(path.name[-3:], 1.0)
        path.write_bytes(path.read_bytes()[:int(share * path.stat().st_size)])
    ran = used.run()
    assert ran.value == 12.0 and ran.misses == 1
    assert len(used.entries('nbc')) == 3


def test_index_that_names_a_record_which_is_gone_is_compiled_anew(used):
    used.write('caller', CALLER.replace('Pair', 'Couple'))
    ran = used.run()
    assert ran.value == 12.0 and ran.misses == 1


ENDED = """
import os
from icofabric_sim.kernels.runtime import disk_cache
disk_cache._CacheFile._save_data = lambda *_: os._exit(7)
"""


def test_process_that_ends_while_it_writes_leaves_nothing_stale(used):
    """Numba writes the index first, and would name the entry of the older source in it."""
    used.write('callee', CALLEE.replace('2.0', '5.0'))
    assert used.start(action=ENDED).returncode == 7
    assert used.run().value == 15.0


WRITTEN = """
from pathlib import Path
from icofabric_sim.kernels.runtime import disk_cache
callee = Path('icofabric_sim/kernels/trial_callee.py')
callee.write_text(callee.read_text().replace('2.0', '5.0'))
"""


def test_what_is_compiled_from_a_source_written_meanwhile_is_not_kept(copy):
    """It has the stamp of the source before, which comes back."""
    assert copy.run(prelude=WRITTEN).value == 15.0
    assert not copy.entries()
    copy.write('callee', CALLEE)
    assert copy.run().value == 12.0


NO_COMPILER = """
import os
from numba.core.registry import cpu_target
cpu_target.target_context.load_additional_registries = lambda: os._exit(9)
"""


def test_a_kernel_on_disk_is_loaded_without_the_compiler(used):
    loaded = used.run(action=NO_COMPILER)
    assert (loaded.value, loaded.hits) == (12.0, 1)
    used.write('callee', CALLEE.replace('2.0', '3.0'))
    assert used.start(action=NO_COMPILER).returncode == 9


def test_plain_twin_needs_no_cache(copy):
    block(copy.home / '.cache')
    ran = copy.run(NUMBA_DISABLE_JIT='1')
    assert ran.value == 12.0 and ran.hits is None and not ran.said


OTHER_KERNEL = """
import numba
@numba.njit
def of_the_user(x):
    return sum([x, x])
of_the_user(1.0)
"""


def test_who_has_set_up_logging_decides_what_to_see(copy):
    setting = 'import logging; logging.basicConfig(level=logging.{})'
    assert not copy.run(setting.format('WARNING')).said
    copy.write('callee', CALLEE + '\n')
    assert copy.run(setting.format('INFO')).said.startswith('INFO:icofabric_sim:compiling')
    # Not what else Numba compiles.
    assert not copy.run(action=OTHER_KERNEL).said


PLAIN = 'import icofabric_sim as ico; ico.compile_scene(ico.Scene.from_parameters({}))'
VERB = ['-m', 'icofabric_sim.commands.main', 'run', 'free_slab', '--no-record', '--duration', '1']


@pytest.mark.parametrize('arguments', [['-c', PLAIN], VERB], ids=['python', 'icofabric run'])
def test_first_run_says_what_it_waits_for(arguments, tmp_path):
    environment = {**os.environ, 'NUMBA_CACHE_DIR': str(tmp_path / 'cache')}
    log = tmp_path / 'log'
    with log.open('wb') as file, subprocess.Popen(
            [sys.executable, *arguments], env=environment, stdout=file,
            cwd=Path(icofabric_sim.__file__).parents[1], stderr=subprocess.STDOUT) as process:
        try:
            deadline = time.monotonic() + 60.0
            while b'compiling the kernels' not in log.read_bytes():
                assert process.poll() is None and time.monotonic() < deadline, log.read_text()
                time.sleep(0.05)
        finally:
            process.kill()


class Clock:
    """A clock and its timers."""

    def __init__(self):
        self.now, self.intervals = 100.0, []

    def monotonic(self):
        return self.now

    def timer(self, interval, call):
        self.intervals.append(interval)
        self.call, self.due = call, self.now + interval
        return self

    def start(self):
        pass

    def cancel(self):
        self.due = float('inf')

    def wait(self, seconds):
        end = self.now + seconds
        while self.due <= end:
            self.now = self.due
            self.cancel()
            self.call()
        self.now = end


def test_pieces_of_a_wait_add_up(monkeypatch):
    clock, told = Clock(), []
    monkeypatch.setattr(wait_notice.time, 'monotonic', clock.monotonic)
    monkeypatch.setattr(wait_notice.threading, 'Timer', clock.timer)
    waiting = wait_notice.WaitNotice(told.append)
    clock.due = float('inf')

    def piece(seconds, pause):
        waiting.begin()
        clock.wait(seconds)
        waiting.end()
        clock.wait(pause)

    piece(0.75, 0.25)
    assert not told
    piece(0.5, 1.0)
    assert told == [1.0] and clock.intervals == [1.0, 0.25, 10.0]
    # Again while it goes on.
    piece(5.0, 1.0)
    assert len(told) == 1
    piece(15.0, 60.0)
    assert told == [1.0, 11.0, 21.0]
    # A new wait.
    piece(0.75, 60.0)
    piece(0.75, 60.0)
    assert len(told) == 3
    piece(2.0, 0.0)
    assert told[3:] == [1.0]
    assert waiting.seconds == 24.75


def test_a_kernel_is_compiled_once_for_numbers_of_the_source_and_others():
    @compiled
    def doubled(number):
        return 2 * number

    @compiled
    def added(number, is_more):
        return doubled(number) + doubled(3) + doubled(-7 if is_more else 5)

    # From disk nothing would be compiled.
    for kernel in (doubled, added):
        kernel._kept = kernel._as_part()._kept = _NoCache()
    assert added(4, True) == 8 + 6 - 14 and added(4, False) == 8 + 6 + 10
    assert len(doubled._as_part().overloads) == 1


def test_a_kernel_keeps_its_machine_code_while_another_thread_compiles():
    """Else it would be called at address 0."""
    from icofabric_sim.kernels.runtime import parts
    entered, made = threading.Event(), threading.Event()

    def other():
        with parts.compiling('other'):
            entered.set()
            made.wait(60.0)

    thread = threading.Thread(target=other)
    with parts.compiling('kernel'):
        thread.start()
        assert entered.wait(60.0)
        kernel, part = (parts._library_class(name) for name in ('kernel', 'part'))
    made.set()
    thread.join()
    assert kernel is parts.KernelLibrary and part is parts.PartLibrary
    # Other functions that are compiled in this process are left alone.
    assert parts._library_class('theirs') is None


def test_import_of_kernels_spares_scipy_and_leaves_blas_to_others():
    script = """
import sys
import icofabric_sim.simulation.simulation
assert 'scipy.linalg' not in sys.modules
import numba
import numpy as np

@numba.njit
def dot(a):
    return np.dot(a, a)

assert np.array_equal(dot(2.0 * np.eye(2)), 4.0 * np.eye(2))
"""
    done = subprocess.run(
        [sys.executable, '-c', script], text=True, capture_output=True, check=False,
        env={**os.environ, 'PYTHONPATH': str(Path(icofabric_sim.__file__).parents[1])})
    assert done.returncode == 0, done.stderr
