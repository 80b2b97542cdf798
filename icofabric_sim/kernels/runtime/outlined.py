# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Kernels that others call by address: compiled once, and not inlined into their callers.

The compiler of machine code optimises a kernel anew in each kernel variant that calls it. The
contact of two shells is longer than the rest of a step. A call by address takes some nanoseconds,
so it suits work of a microsecond and more. The address is a number in a record of the scene, so
kernels on disk do not contain it.
"""

from typing import Any

from icofabric_sim.kernels.runtime.numba_private import cgutils
from numba import types
from numba.extending import intrinsic, overload

# Functions by their addresses minus one, if compilation is disabled.
_plain: list[Any] = []


def address_of(kernel: Any, *arguments: Any) -> int:
    """
    Return the address of a kernel for arguments of such types; compile or load it if necessary.

    The address is valid as long as the process runs. Raise KernelsMissing if this thread must not
    compile.
    """
    if not hasattr(kernel, 'overloads'):
        if kernel not in _plain:
            _plain.append(kernel)
        return 1 + _plain.index(kernel)
    kinds = kernel.types_of(arguments)
    if kinds not in kernel.overloads:
        kernel.compile(kinds)
    found = kernel.overloads[kinds]
    return int(found.library.get_pointer_to_function(found.fndesc.llvm_func_name))


def _calls(result: types.Type) -> Any:
    """
    Return the intrinsic that calls an address with a tuple of arguments, for one type of result.
    """
    @intrinsic
    def emitted(typingctx: Any, address: Any, arguments: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            kinds = tuple(signature.args[1])
            form = context.call_conv.get_function_type(result, kinds)
            function = builder.inttoptr(values[0], form.as_pointer())
            # Kernels raise nothing.
            _, answer = context.call_conv.call_function(
                builder, function, result, kinds, cgutils.unpack_tuple(builder, values[1]))
            return answer
        return result(address, arguments), generate
    return emitted


emit_int, emit_float, emit_none = map(_calls, (types.int64, types.float64, types.none))


def call_int(address: int, arguments: tuple[Any, ...]) -> int:
    """Call the kernel at an address, whose result is an integer."""
    answer: int = _plain[address - 1](*arguments)
    return answer


def call_float(address: int, arguments: tuple[Any, ...]) -> float:
    """Call the kernel at an address, whose result is a float."""
    answer: float = _plain[address - 1](*arguments)
    return answer


def call_none(address: int, arguments: tuple[Any, ...]) -> None:
    """Call the kernel at an address, which returns nothing."""
    _plain[address - 1](*arguments)


overload(call_int)(lambda address, arguments: lambda address, arguments: emit_int(
    address, arguments))
overload(call_float)(lambda address, arguments: lambda address, arguments: emit_float(
    address, arguments))
overload(call_none)(lambda address, arguments: lambda address, arguments: emit_none(
    address, arguments))
