# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Each private interface of Numba that kernels use does what kernels/runtime/numba_private.py needs.

A failure names the feature of icofabric_sim that is lost; docs/numba.md says how to replace it.
"""

import ast
from contextlib import contextmanager
import ctypes
import itertools
import json
import operator
import os
from pathlib import Path
import re
import subprocess
import sys
import threading

import icofabric_sim
from icofabric_sim.kernels.runtime import disk_cache, numba_private
from icofabric_sim.kernels.runtime.borrowed import borrowed
from icofabric_sim.kernels.runtime.compiled import _NoCache, compiled
from icofabric_sim.kernels.runtime.lanes import lane, splat
from icofabric_sim.kernels.runtime.numba_private import (
    CacheFile,
    cgutils,
    COMPILE_EVENT,
    compiler_lock,
    DiskCache,
    Dispatcher,
    event,
    LOCK_EVENT,
    NullCache,
    PASS_EVENT,
)
from icofabric_sim.kernels.runtime.outlined import address_of, call_float
from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.kernels.runtime.target import target
import numba
from numba import types
from numba.extending import intrinsic
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]


@contextmanager
def interface(name, feature):
    """Fail with the feature that is lost if the test of an interface fails."""
    try:
        yield
    except (Exception, pytest.fail.Exception) as error:
        raise AssertionError(
            f'Numba {numba.__version__} has another `{name}`. Lost: {feature}. '
            f'docs/numba.md says how to replace it. {type(error).__name__}: {error}') from error


def uncached(function):
    """Return the kernel of `function`, compiled in this process."""
    kernel = compiled(function)
    kernel._kept = kernel._as_part()._kept = _NoCache()
    return kernel


def double(x):
    return 2.0 * x


class Listener(event.Listener):
    """The events of a kind, with their data."""

    def __init__(self, fault=None):
        self.started, self.ended, self.fault = [], [], fault

    def on_start(self, happening):
        self.started.append(happening)
        if self.fault is not None:
            raise self.fault

    def on_end(self, happening):
        self.ended.append(happening)


IMPORTED = """
import json, sys

class Asked:
    names = []
    def find_spec(self, name, path=None, target=None):
        self.names.append(name)

sys.meta_path.insert(0, Asked())
import icofabric_sim.kernels.runtime.compiled
from icofabric_sim.kernels.runtime import numba_private
from llvmlite.binding import ffi
print(json.dumps({
    'callbacks': len(ffi.lib._lock._cblist), 'coverage': 'coverage' in Asked.names,
    'target': numba_private._codegen.magic_tuple()[1:],
    'rules': len(numba_private.cpu_target.target_context._getattrs),
    'scipy': 'scipy.linalg' in sys.modules}))
numba_private.set_up_compiler()
from numba.np import arraymath, linalg
print(json.dumps({
    'rules': len(numba_private.cpu_target.target_context._getattrs),
    'scipy': 'scipy.linalg' in sys.modules, 'same': arraymath.ensure_blas is linalg.ensure_blas,
    'real': linalg.ensure_blas.__name__}))
"""


@pytest.fixture(scope='module')
def imported():
    """Facts of a process after the import of kernels, and after the compiler is set up."""
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith('NUMBA_')}
    done = subprocess.run(
        [sys.executable, '-c', IMPORTED], text=True, capture_output=True, timeout=120,
        env={**environment, 'PYTHONPATH': str(Path(icofabric_sim.__file__).parents[1])})
    assert done.returncode == 0, done.stderr
    first, second = map(json.loads, done.stdout.splitlines())
    return first, second


def test_lock_callbacks_of_llvm(imported):
    with interface('ffi.register_lock_callback', 'compiling without an event at each LLVM call'):
        assert imported[0]['callbacks'] == 0


def test_import_of_coverage(imported):
    with interface('import of coverage', 'a start without the package coverage'):
        assert not imported[0]['coverage']


def test_target_settings(imported):
    with interface('config.CPU_NAME, CPU_FEATURES', 'kernels for a level of x86-64'):
        if target().level:
            assert imported[0]['target'] == [target().level, target().features]
        name, features = numba_private.target_setting()
        assert isinstance(name, str) and isinstance(features, str)


def test_other_settings(monkeypatch):
    with interface('config.CACHE_DIR, DISABLE_JIT', 'NUMBA_CACHE_DIR and NUMBA_DISABLE_JIT'):
        for code, variable in (
                ('cache_folder_setting() == "/a"', 'NUMBA_CACHE_DIR=/a'),
                ('is_compiling_disabled()', 'NUMBA_DISABLE_JIT=1')):
            name, _, value = variable.partition('=')
            subprocess.run(
                [sys.executable, '-c', 'from icofabric_sim.kernels.runtime import numba_private; '
                 f'assert numba_private.{code}'], check=True, timeout=120, env={
                     **os.environ, name: value,
                     'PYTHONPATH': str(Path(icofabric_sim.__file__).parents[1])})


# Numba 0.58 warns of exceptions in listeners.
@pytest.mark.filterwarnings('ignore:Code using Numba extension API')
def test_events_of_the_compiler():
    with interface('event', 'notices and interruption of compilations, `no_compiling`'):
        listeners = {kind: Listener() for kind in (COMPILE_EVENT, PASS_EVENT, LOCK_EVENT)}
        kernel = uncached(lambda x: 3.0 * x)
        with registered(listeners):
            assert kernel(2.0) == 6.0
        assert all(heard.started and heard.ended for heard in listeners.values())
        assert kernel in [one.data['dispatcher'] for one in listeners[COMPILE_EVENT].started]
        assert listeners[LOCK_EVENT].started[0].kind == LOCK_EVENT
        # An exception of a listener ends the compilation, and leaves the lock free.
        for kind in (COMPILE_EVENT, PASS_EVENT, LOCK_EVENT):
            kernel = uncached(lambda x: 4.0 * x)
            with registered({kind: Listener(KeyError(kind))}), pytest.raises(KeyError):
                kernel(2.0)
            assert not compiler_lock._is_owned() and kernel(2.0) == 8.0


@contextmanager
def registered(listeners):
    """Register listeners by kind."""
    for kind, listener in listeners.items():
        event.register(kind, listener)
    try:
        yield
    finally:
        for kind, listener in listeners.items():
            event.unregister(kind, listener)


def test_lock_of_the_compiler():
    with interface('global_compiler_lock._lock', 'a node that steps while kernels compile'):
        held = []

        class Held(Listener):
            def on_start(self, happening):
                thread = threading.Thread(
                    target=lambda: held.append(not compiler_lock.acquire(blocking=False)))
                thread.start()
                thread.join(60.0)

        with registered({PASS_EVENT: Held()}):
            uncached(lambda x: 5.0 * x)(1.0)
        assert held and all(held)


def test_cache_of_a_dispatcher():
    with interface('CPUDispatcher._cache', 'caches of kernels, opened on first use'):
        opened = []

        class Watched(Dispatcher):
            def find_cache(self):
                opened.append(self)
                return NullCache()

        watched = Watched(double, targetoptions={'nopython': True})
        assert not opened
        assert watched(2.0) == 4.0 and opened
        assert isinstance(numba_private.cache_of(watched), NullCache)
        assert isinstance(numba_private.cache_of(numba.njit(double)), NullCache)


def test_null_cache():
    with interface('NullCache', 'kernels without a folder to write'):
        none = NullCache()
        assert none.load_overload(None, None) is None
        none.save_overload(None, None)


def test_types_of_other_packages():
    with interface('_compilation_chain_init_hook', 'a start without entry points of packages'):
        calls = []

        class Watched(Dispatcher):
            def find_cache(self):
                return NullCache()

            def _compilation_chain_init_hook(self):
                calls.append(self)

        assert Watched(double, targetoptions={'nopython': True})(2.0) == 4.0 and calls


def test_compiler_of_a_dispatcher():
    with interface('_compiler.compile', 'kernels on disk that load without their parts'):
        calls = []
        kernel = uncached(lambda x: 6.0 * x)
        kernel.add_before_compiling(lambda: calls.append(1))
        assert (kernel(1.0), kernel(1.0), calls) == (6.0, 6.0, [1])


def passes_of(dispatcher):
    found, = dispatcher.overloads.values()
    (_, times), = found.metadata['pipeline_times'].items()
    return [name.split('_', 1)[1] for name in times]


def test_passes_of_the_compiler():
    with interface('DefaultPassBuilder, PassManager', 'a shorter compile time'):
        kernel, usual = uncached(lambda x: 2.0 * x), numba.njit(lambda x: 2.0 * x)
        assert kernel(1.0) == usual(1.0)
        ours, all_passes = passes_of(kernel._as_part()), passes_of(usual)
        assert ours == [name for name in all_passes if name in ours]
        assert len(all_passes) - len(ours) == len(numba_private._UNUSED_PASSES)


def test_order_of_templates():
    with interface('_lookup_global, _remove_global', 'a shorter compile time'):
        assert uncached(lambda x: lane(splat(x) * splat(3.0), 0))(2.0) == 6.0
        found = numba_private.cpu_target.typing_context._lookup_global(operator.mul).templates
        assert issubclass(found[0], numba_private._first[operator.mul])
        assert not any(issubclass(one, numba_private._first[operator.mul]) for one in found[1:])


def test_calls_between_kernels():
    with interface(
            'get_call_template, get_overload', 'one compilation for Python, kernels and literals'):
        inner = uncached(lambda x: 2 * x)
        outer = uncached(lambda x: inner(x) + inner(7))
        assert outer(3) == 20
        assert list(inner._as_part().overloads) == [(types.int64,)]
        assert not inner.overloads


def test_address_of_a_kernel():
    with interface(
            'overloads, get_pointer_to_function', 'kernels that others call by their address'):
        kernel = uncached(lambda x: 7.0 * x)
        address = address_of(kernel, 1.0)
        assert address and address_of(kernel, 1.0) == address

        @uncached
        def calls(number, x):
            return call_float(number, (x,))

        assert calls(address, 2.0) == 14.0


def test_files_of_a_cache(tmp_path):
    with interface('IndexDataCacheFile', 'a cache that survives other processes and damage'):
        class Named(CacheFile):
            def entry_name(self, number):
                return f'entry{number}'

        file = Named(str(tmp_path), 'name', 'stamp')
        assert file.read_index() == {} and file.load('key') is None
        file.save('key', 'content')
        assert file.read_index() == {'key': 'entry1'} and file.read_entry('entry1') == 'content'
        assert {path.name for path in tmp_path.iterdir()} == {'name.nbi', 'entry1'}
        assert Named(str(tmp_path), 'name', 'stamp').load('key') == 'content'
        assert Named(str(tmp_path), 'name', 'other').read_index() == {}
        file.read_index = lambda: {'key': 'gone'}
        assert file.load('key') is None
        with pytest.raises(OSError):
            file.read_entry('gone')


class Locator(disk_cache._Locator):
    """A locator in a folder of the test."""

    folder = ''

    def __init__(self, function, path):
        self._path, self._line, self._folder = path, 1, self.folder


class Cache(DiskCache, locator=Locator):
    """A cache in a folder of the test."""

    extra = ('extra',)

    def key_parts(self):
        return self.extra


def cached(cache):
    """Return a dispatcher of `double` with this cache."""
    class Kept(Dispatcher):
        def find_cache(self):
            return cache

    return Kept(double, targetoptions={'nopython': True})


def test_cache_of_a_function(tmp_path, monkeypatch):
    with interface('FunctionCache', 'keys of the number of lanes; loading without the compiler'):
        monkeypatch.setattr(Locator, 'folder', str(tmp_path))
        cache = Cache(double)
        kept = cached(cache)
        context = kept.targetctx
        assert not cache.holds((types.float64,), context)
        assert cache.load_overload((types.float64,), context) is None
        assert kept(2.0) == 4.0 and cache.holds((types.float64,), context)
        assert not cache.holds((types.int64,), context)
        assert cache.cache_path == str(tmp_path)
        # Without the compiler.
        monkeypatch.setattr(context, 'refresh', lambda: pytest.fail('the compiler is set up'))
        again = cached(Cache(double))
        monkeypatch.setattr(again._compiler, 'compile', lambda *_: pytest.fail('compiled'))
        assert again(2.0) == 4.0 and sum(again.stats.cache_hits.values()) == 1
        monkeypatch.setattr(Cache, 'extra', ('other',))
        assert not Cache(double).holds((types.float64,), context)


def test_entries_of_a_cache(tmp_path, monkeypatch):
    with interface('CompileResultCacheImpl', 'small entries, in folders by source'):
        monkeypatch.setattr(Locator, 'folder', str(tmp_path))
        monkeypatch.setattr(Locator, 'from_function', classmethod(lambda *_: None))
        with pytest.raises(RuntimeError):
            Cache(double)
        monkeypatch.undo()
        monkeypatch.setattr(Locator, 'folder', str(tmp_path))
        cache = Cache(double)
        reduced = []
        monkeypatch.setattr(cache._cache_file, 'save', lambda key, data: reduced.append(data))
        assert cached(cache)(2.0) == 4.0
        (*_, text, reload_init, environments), = reduced
        assert (text, tuple(reload_init), environments) == ('', (), ())


def test_runtime_library():
    with interface('_nrt.c_helpers', 'kernels on disk that load without the compiler'):
        helpers = numba_private._nrt.c_helpers
        assert {'Allocate', 'Free'} <= set(helpers)
        assert all(isinstance(address, int) and address for address in helpers.values())


def test_libraries_of_machine_code():
    with interface('JITCodeLibrary', 'parts without machine code; kernels optimised once'):
        inner = uncached(lambda x: 8.0 * x)
        outer = uncached(lambda x: inner(x))
        assert outer(1.0) == 8.0
        part, = inner._as_part().overloads.values()
        kernel, = outer.overloads.values()
        assert type(part.library) is numba_private.PartLibrary
        assert type(kernel.library) is numba_private.KernelLibrary
        assert part.library.get_pointer_to_function(part.fndesc.llvm_func_name) == 0
        name, kind, data = part.library.serialize_using_object_code()
        assert kind == 'part' and data[:2] == b'BC'
        loaded = numba_private._codegen.unserialize_library((name, kind, data))
        assert type(loaded) is numba_private.PartLibrary


def test_libraries_of_the_code_generator():
    with interface(
            'create_library, unserialize_library, set_env', 'parts and kernels on disk'):
        assert numba.njit(lambda x: 9.0 * x)(1.0) == 9.0
        theirs = numba_private._codegen.create_library('theirs')
        assert not isinstance(
            theirs, (numba_private.PartLibrary, numba_private.KernelLibrary))
        # A symbol that no code defines.
        numba_private._codegen.set_env('icofabric_no_symbol', None)


def test_symbols_of_loaded_code():
    with interface('_engine._defined_symbols', 'machine code that loads without its bitcode'):
        kernel = uncached(lambda x: 10.0 * x)
        kernel(1.0)
        found, = kernel.overloads.values()
        _, kind, (code, names) = found.library.serialize_using_object_code()
        assert kind == 'kernel' and code[:4] == b'\x7fELF'
        engine = numba_private._codegen._engine
        assert found.fndesc.llvm_func_name in names
        assert set(names) <= engine._defined_symbols
        assert engine.is_symbol_defined(names[0])


def test_target_of_the_code_generator(monkeypatch):
    with interface('magic_tuple', 'one target for the whole process'):
        before = numba_private._codegen.magic_tuple()
        triple, name, features = before
        assert all(isinstance(part, str) for part in before)
        monkeypatch.setattr(numba_private._config, 'CPU_NAME', 'generic')
        assert numba_private._codegen.magic_tuple() == before
        assert numba_private.processor_features() == features


def test_numbers_of_functions(monkeypatch):
    with interface('FunctionIdentity._unique_ids', 'kernels linked from parts of two processes'):
        identity = numba_private.FunctionIdentity
        before = next(identity._unique_ids)
        assert before > 10**6
        monkeypatch.setattr(identity, '_unique_ids', itertools.count(before + 1000))
        assert identity.from_function(double).unique_id == before + 1000


class Point(Record):
    """A record."""

    x: float
    y: float


def test_declaration_of_functions():
    with interface('declare_function', 'loops whose reads of records move out'):
        kernel = uncached(lambda point: point.x - point.y)
        assert kernel(Point(3.0, 1.0)) == 2.0
        part, = kernel._as_part().overloads.values()
        heard = []
        context = numba_private.cpu_target.target_context
        module = numba_private._codegen.create_library('declared').create_ir_module('declared')
        function = context.declare_function(module, part.fndesc)
        assert 'dereferenceable(16)' in str(function) and 'nonnull' in str(function)
        declare = context.declare_function
        numba_private.add_after_declaring(lambda *found: heard.append(found))
        try:
            module = numba_private._codegen.create_library('again').create_ir_module('again')
            context.declare_function(module, part.fndesc)
        finally:
            context.declare_function = declare
        (arguments, kinds), = heard
        assert list(arguments) == ['point'] and [name for name, _ in kinds] == ['point']


def test_types_of_records():
    with interface('typeof of buffers', 'fast calls of kernels with records'):
        kernel = uncached(lambda point: point.x + point.y)
        first, second = Point(1.0, 2.0), Point(3.0, 4.0)
        assert isinstance(first, ctypes.Structure) and kernel(first) == 3.0
        assert numba.typeof(first) == type(first).numba_type()
        # Numba finds the type by the class of the object.
        seen = []
        kernel.typeof_pyval = seen.append
        assert kernel(second) == 7.0 and not seen


def test_setting_up_the_compiler(imported):
    with interface(
            'typing_context.refresh, target_context.refresh', 'kernels that load in milliseconds'):
        before, after = imported[0]['rules'], imported[1]['rules']
        assert before == 0 < after


def test_import_of_scipy(imported):
    with interface('linalg.ensure_blas', 'a start without the import of scipy.linalg'):
        assert not imported[0]['scipy'] and not imported[1]['scipy']
        assert imported[1]['same'] and imported[1]['real'] == 'ensure_blas'


@intrinsic
def second_of(typingctx, pair):
    """Return the second number of a pair."""
    def generate(context, builder, sig, args):
        one, other = cgutils.unpack_tuple(builder, args[0])
        return context.cast(builder, other, sig.args[0][1], sig.return_type)
    return types.float64(pair), generate


def test_helpers_of_machine_code():
    with interface('cgutils', 'vectors, records, teams of threads'):
        assert {
            'false_bit', 'get_item_pointer2', 'get_or_insert_function', 'is_not_null',
            'pack_array', 'unpack_tuple'} <= set(vars(cgutils))
        assert uncached(lambda x: second_of((x, 3)))(1.0) == 3.0


def test_typing_rules():
    with interface('typing.templates', 'operators of vectors, fields of records'):
        assert uncached(lambda x: lane(splat(x) + splat(1.0), 0))(2.0) == 3.0
        assert uncached(lambda point: point.y)(Point(1.0, 2.0)) == 2.0


def test_lowering():
    with interface('call_conv, make_array, make_tuple, cast', 'vectors, borrowed arrays, calls'):
        assert uncached(lambda a: borrowed(a)[1])(np.arange(3.0)) == 1.0


def test_the_page_explains_each_interface():
    page = (ROOT / 'docs' / 'numba.md').read_text()
    rows = re.findall(r'^\| `?([^|`]+)`? \|', page, re.M)
    tested = [
        node.args[0].value for node in ast.walk(ast.parse(Path(__file__).read_text()))
        if isinstance(node, ast.Call) and getattr(node.func, 'id', '') == 'interface']
    assert len(tested) > 22
    assert sorted(rows) == sorted({*tested, 'Interface'} - {'any'})


def test_a_lost_feature_is_named():
    with pytest.raises(AssertionError, match='Lost: something. docs/numba.md'), \
            interface('any', 'something'):
        raise AttributeError('any')
