# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Private interfaces of Numba and llvmlite: the one module that names them.

Other modules use `numba`, `numba.types`, `numba.extending`, `llvmlite.ir` and `llvmlite.binding`,
and import all else from this module. test/kernels/test_numba_private.py checks each interface, and
docs/numba.md explains how to replace each. This module also imports Numba, and sets its compile
target before Numba makes its code generator; see target.py.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache
import itertools
import os
import sys
from typing import Any

from icofabric_sim.kernels.runtime.target import target
from llvmlite import binding
from llvmlite.binding import ffi


@contextmanager
def _importing_numba() -> Iterator[None]:
    """
    Import Numba without features that only its reports need.

    Numba imports the package coverage if it is installed, a tenth of the import time. Numba also
    records an event for timers at each call of LLVM, a fifteenth of the compile time.
    """
    bars = 'coverage' not in sys.modules and (
        os.environ.get('NUMBA_JIT_COVERAGE', '0') in ('', '0'))
    register = ffi.register_lock_callback
    ffi.register_lock_callback = lambda *_: None
    if bars:
        sys.modules['coverage'] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        ffi.register_lock_callback = register
        if bars:
            del sys.modules['coverage']


with _importing_numba():
    from numba.core import config

# Untyped: Numba sets its configuration at run time.
_config: Any = config
if target().level:
    _config.CPU_NAME, _config.CPU_FEATURES = target().level, target().features

# cgutils: helpers that emit machine code. event: reports of what the compiler does.
from numba import types  # noqa: E402 - after its settings
from numba.core import cgutils, event  # noqa: E402
from numba.core.bytecode import FunctionIdentity  # noqa: E402
from numba.core.caching import (  # noqa: E402
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    NullCache,
)
from numba.core.codegen import JITCodeLibrary  # noqa: E402
from numba.core.compiler import CompilerBase, DefaultPassBuilder  # noqa: E402
from numba.core.compiler_lock import global_compiler_lock  # noqa: E402
from numba.core.compiler_machinery import PassManager  # noqa: E402
from numba.core.registry import cpu_target, CPUDispatcher  # noqa: E402
from numba.core.runtime.nrt import _nrt  # noqa: E402

# Returns the type of a literal number as that of any other number.
from numba.core.types import unliteral  # noqa: E402

# Typing rules of attributes and operators of new types.
from numba.core.typing.templates import (  # noqa: E402
    AbstractTemplate,
    AttributeTemplate,
    infer_global,
    signature,
)

__all__ = [
    'AbstractTemplate', 'add_after_declaring', 'AttributeTemplate', 'cache_folder_setting',
    'cache_of', 'CacheFile', 'cgutils', 'COMPILE_EVENT', 'compiler_lock', 'define_function',
    'DiskCache', 'Dispatcher', 'event', 'is_compiling_disabled', 'KernelLibrary', 'LOCK_EVENT',
    'NullCache', 'number_functions_from', 'PartLibrary', 'PASS_EVENT', 'processor_features',
    'set_up_compiler', 'signature', 'target_setting', 'unliteral', 'use_libraries']

# Events: a function is compiled or loaded; a pass of the compiler; the compiler's lock is awaited.
COMPILE_EVENT, PASS_EVENT, LOCK_EVENT = (
    'numba:compile', 'numba:run_pass', 'numba:compiler_lock')
# Held by the thread that compiles or loads kernels.
compiler_lock = global_compiler_lock._lock


# -- settings ---------------------------------------------------------------------------------

def is_compiling_disabled() -> bool:
    """Return True if NUMBA_DISABLE_JIT is set, so that kernels are plain Python."""
    return bool(getattr(_config, 'DISABLE_JIT', 0))


def cache_folder_setting() -> str:
    """Return NUMBA_CACHE_DIR, '' if not set."""
    return str(getattr(_config, 'CACHE_DIR', '') or '')


def target_setting() -> tuple[str, str]:
    """Return the name of the target processor and its features; '' if Numba detects them."""
    name = _config.CPU_NAME or ''
    return ('' if name == 'host' else name), _config.CPU_FEATURES or ''


def processor_features() -> str:
    """Return the features of the target processor, as LLVM writes them."""
    _, _, features = cpu_target.target_context.codegen().magic_tuple()
    return str(features)


# -- compiled functions -----------------------------------------------------------------------

# Passes for what kernels do not use: `with` blocks, closures, calls that ask for literals, loops
# over tuples of several types, inlining and fusion of array expressions, listings, checks.
_UNUSED_PASSES = {
    'WithLifting', 'InlineClosureLikes', 'RewriteDynamicRaises', 'MakeFunctionToJitFunction',
    'InlineInlinables', 'FindLiterallyCalls', 'LiteralUnroll', 'LiteralPropagationSubPipelinePass',
    'InlineOverloads', 'NopythonRewrites', 'NoPythonSupportedFeatureValidation', 'AnnotateTypes',
    'DumpParforDiagnostics'}


class _KernelCompiler(CompilerBase):
    """Numba's compiler without the passes that kernels do not need."""

    def define_pipelines(self) -> list[PassManager]:
        """Return the passes, in Numba's order."""
        kept = PassManager('kernel')
        for kind, why in DefaultPassBuilder.define_nopython_pipeline(self.state).passes:
            if kind.__name__ not in _UNUSED_PASSES:
                kept.add_pass(kind, why)
        kept.finalize()
        return [kept]


class Dispatcher(CPUDispatcher):
    """A compiled function that opens its cache on first use."""

    _compiler: Any

    def __init__(self, function: Callable[..., Any], **options: Any) -> None:
        super().__init__(function, pipeline_class=_KernelCompiler, **options)

    def find_cache(self) -> Any:
        """Return the cache of this function; called at each access."""
        raise NotImplementedError

    @property
    def _cache(self) -> Any:
        return self.find_cache()

    @_cache.setter
    def _cache(self, unused: Any) -> None:
        """Ignore the empty cache that Numba sets at first."""

    def _compilation_chain_init_hook(self) -> None:
        """
        Skip the types of other packages, which Numba loads before it reads those of arguments.
        """

    def add_before_compiling(self, prepare: Callable[[], None]) -> None:
        """Call `prepare` before each compilation, but not before a kernel is loaded."""
        compile_it = self._compiler.compile

        def prepared(arguments: Any, result: Any) -> Any:
            prepare()
            return compile_it(arguments, result)

        self._compiler.compile = prepared


def cache_of(dispatcher: Any) -> Any:
    """Return the cache of a compiled function, None if its class has no caches."""
    return getattr(dispatcher, '_cache', None)


# -- caches on disk ---------------------------------------------------------------------------

class CacheFile(IndexDataCacheFile):
    """
    The index of a function and its entries in a folder, with methods that subclasses replace.
    """

    def __init__(self, folder: str, name: str, stamp: Any) -> None:
        super().__init__(folder, name, stamp)
        self.folder, self.name = folder, name

    def holds(self, key: Any) -> bool:
        """Return True if the index has the key."""
        return key in self.read_index()

    def read_index(self) -> Any:
        """Return the file name of each entry by its key; empty if the stamp differs."""
        return super()._load_index()

    def write_index(self, names: Any) -> None:
        """Write the file name of each entry."""
        super()._save_index(names)

    def read_entry(self, name: str) -> Any:
        """Return the content of an entry. Raise OSError if there is no such file."""
        return super()._load_data(name)

    def entry_name(self, number: int) -> str:
        """Return the file name of a new entry, for increasing numbers until the name is unused."""
        return super()._data_name(number)

    def _load_index(self) -> Any:
        return self.read_index()

    def _save_index(self, overloads: Any) -> None:
        self.write_index(overloads)

    def _load_data(self, name: str) -> Any:
        return self.read_entry(name)

    def _data_name(self, number: int) -> str:
        return self.entry_name(number)


class _Entries(CompileResultCacheImpl):
    """Entries of a kernel on disk, reduced to the data that a call needs."""

    def reduce(self, cres: Any) -> Any:
        """
        Omit the text of the types, and empty environments.

        Numba keeps an environment for each function that went into the code, some fifty a kernel.
        To load an environment, Numba imports the module of its function.
        """
        *kept, reload_init, environments = super().reduce(cres._replace(type_annotation=''))
        return (*kept, reload_init, tuple(one for one in environments if one.consts))


class DiskCache(FunctionCache):
    """
    The entries of one function on disk; a subclass names its class of locators.

    A locator has the methods of Numba's locators: see `disk_cache._Locator`.
    """

    def __init_subclass__(cls, *, locator: type) -> None:
        """Store the entries where `locator` says."""
        entries: Any = type('_EntriesOf', (_Entries,), {'_locator_classes': [locator]})
        cls._impl_class = entries

    def __init__(self, function: Callable[..., Any]) -> None:
        """Raise RuntimeError if the class of locators returns None for the function."""
        super().__init__(function)
        self._cache_file: CacheFile = self.open_file(
            self._cache_path, self._impl.filename_base, self.locator.get_source_stamp())

    @property
    def locator(self) -> Any:
        """The locator of this function."""
        return self._impl.locator

    def open_file(self, folder: str, name: str, source_stamp: Any) -> CacheFile:
        """Return the index and the entries of this function."""
        return CacheFile(folder, name, source_stamp)

    def key_parts(self) -> tuple[Any, ...]:
        """Return what the key of an entry has beside argument types, target and bytecode."""
        return ()

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return *super()._index_key(sig, codegen), *self.key_parts()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """
        Load a compiled function, or return None if the cache has none.

        The method of Numba sets the compiler up first; machine code needs only its runtime
        library.
        """
        _provide_runtime()
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)

    def holds(self, types: tuple[Any, ...], target_context: Any) -> bool:
        """Return True if there is an entry for arguments of such types."""
        return self._cache_file.holds(self._index_key(types, target_context.codegen()))


@cache
def _provide_runtime() -> None:
    """
    Give the linker the addresses of Numba's runtime library, as setting up the compiler does.
    """
    for name, address in _nrt.c_helpers.items():
        binding.add_symbol(name if name.startswith('_') else f'NRT_{name}', address)


# -- machine code -----------------------------------------------------------------------------

_PART_FORMAT, _KERNEL_FORMAT = 'part', 'kernel'
_codegen = cpu_target.target_context.codegen()


class PartLibrary(JITCodeLibrary):
    """Code that is linked into kernels only."""

    def finalize(self) -> None:
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            if hasattr(library, '_reload_init'):
                # From Numba 0.59 on.
                self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._final_module.verify()
        self._finalize_final_module()

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0: a part has no machine code."""
        self._ensure_finalized()
        return 0

    def serialize_using_object_code(self) -> tuple[str, str, bytes]:
        """Return the content of a cache entry: the bitcode for linking."""
        self._ensure_finalized()
        return self.name, _PART_FORMAT, self._get_module_for_linking().as_bitcode()


class KernelLibrary(JITCodeLibrary):
    """
    Code that only Python calls: stored as machine code, with nothing to link.

    Reading code for linking took half of the time of loading.
    """

    def _optimize_final_module(self) -> None:
        # One run: Numba's first run removes reference counts, which kernels hardly have.
        full = self._codegen._module_pass_manager()
        if isinstance(full, tuple):
            manager, builder = full
            manager.run(self._final_module, builder)
        else:
            # Numba versions before LLVM's new pass managers.
            super()._optimize_final_module()

    def serialize_using_object_code(self) -> tuple[str, str, tuple[bytes, tuple[str, ...]]]:
        """Return the content of a cache entry: machine code, and the names that it defines."""
        self._ensure_finalized()
        module = self._final_module
        names = (
            one.name for kind in (module.functions, module.global_variables) for one in kind
            if not one.is_declaration)
        return self.name, _KERNEL_FORMAT, (self._get_compiled_object(), tuple(names))


def _load_library(serialized: Any) -> Any:
    """Return the library of a cache entry of a part or a kernel."""
    name, kind, data = serialized
    library: Any
    if kind == _PART_FORMAT:
        library = PartLibrary(_codegen, name)
        library._final_module = library._shared_module = binding.parse_bitcode(data)
    else:
        library = KernelLibrary(_codegen, name)
        code, names = data
        library.enable_object_caching()
        library._set_compiled_object(code)
        _codegen._engine._defined_symbols.update(names)
    library._finalize_final_module()
    return library


def use_libraries(class_of: Callable[[str], type | None]) -> None:
    """
    Make the code generator store code in libraries of the class `class_of(name)`, None: Numba's.
    """
    create, set_environment, load = (
        _codegen.create_library, _codegen.set_env, _codegen.unserialize_library)

    def create_library(name: str, **options: Any) -> Any:
        library = class_of(name)
        return create(name, **options) if library is None else library(_codegen, name, **options)

    def load_library(serialized: Any) -> Any:
        is_ours = serialized[1] in (_PART_FORMAT, _KERNEL_FORMAT)
        return (_load_library if is_ours else load)(serialized)

    def set_environment_of(name: str, environment: Any) -> None:
        # A part has no symbol for an environment.
        if _codegen._engine.is_symbol_defined(name):
            set_environment(name, environment)

    _codegen.create_library = create_library
    _codegen.unserialize_library = load_library
    _codegen.set_env = set_environment_of


def _fix_target() -> None:
    """
    Keep the target for the whole process.

    Numba reads its settings again when one of its environment variables changes. Without the fixed
    value, it would then treat cached code as code for another processor.
    """
    magic = _codegen.magic_tuple()
    _codegen.magic_tuple = lambda: magic


_fix_target()


def number_functions_from(first: int) -> None:
    """Count the next functions that Numba compiles, of one name and type, from `first` on."""
    FunctionIdentity._unique_ids = itertools.count(first)


def add_after_declaring(mark: Callable[[dict[str, Any], Iterable[tuple[str, Any]]], None]) -> None:
    """
    Call `mark` after each declaration of a function in machine code.

    `mark` receives the arguments of the function in LLVM by name, and the names and types of the
    arguments to Numba. LLVM has no arguments if the module has the declaration already.
    """
    context = cpu_target.target_context
    declare = context.declare_function

    def declare_and_mark(module: Any, description: Any) -> Any:
        function = declare(module, description)
        arguments = {
            argument.name.removeprefix('arg.'): argument for argument in function.args
            if argument.name.startswith('arg.')}
        mark(arguments, zip(description.args, description.argtypes))
        return function

    context.declare_function = declare_and_mark


# -- the compiler -----------------------------------------------------------------------------

# Templates of `define_function`.
_first: dict[Any, Any] = {}


def define_function(function: Any, template: Any) -> None:
    """
    Define the types of a function or operator in compiled code by a `template`.

    Numba tries this template first. It tries others in the order of definition, and those of its
    operators for arrays take long to refuse other types.
    """
    infer_global(function)(template)
    _first[function] = template


def _put_first(function: Any, template: Any) -> None:
    context = cpu_target.typing_context
    known = context._lookup_global(function)
    ordered = sorted(known.templates, key=lambda one: not issubclass(one, template))
    context._remove_global(function)
    context.insert_global(function, types.Function(ordered))


@cache
def set_up_compiler() -> None:
    """
    Load all that Numba can compile; an empty cache spends a tenth of a node's start on the load.
    """
    with _without_blas_check():
        cpu_target.typing_context.refresh()
        cpu_target.target_context.refresh()
    for function, template in _first.items():
        _put_first(function, template)


@contextmanager
def _without_blas_check() -> Iterator[None]:
    """
    Spare Numba the import of scipy.linalg, which takes a fifth of the import time of this package.

    Numba imports scipy.linalg to check for BLAS. This package requires SciPy, so BLAS is
    available; code that calls BLAS imports it when the code is compiled.
    """
    from numba.np import linalg

    if 'numba.np.arraymath' in sys.modules:  # Numba has checked for BLAS already
        yield
        return
    check, linalg.ensure_blas = linalg.ensure_blas, lambda: None
    try:
        yield
    finally:
        linalg.ensure_blas = check
        arraymath = sys.modules.get('numba.np.arraymath')
        if arraymath is not None:
            arraymath.ensure_blas = check  # type: ignore[attr-defined]
