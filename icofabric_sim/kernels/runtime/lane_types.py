# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Numba types of a vector of doubles and of its mask, and the machine code of their operations.

Numba's own loops over several arrays are not vectorised, because it cannot prove that the arrays
do not overlap; with values of these types the vectors are written down. `lanes.py` has the
functions that kernels call.
"""

import operator
from typing import Any

from icofabric_sim.kernels.runtime.numba_private import (
    AbstractTemplate,
    cgutils,
    define_function,
    signature,
    target_setting,
)
from icofabric_sim.kernels.runtime.target import host_features
from llvmlite import ir
from numba import types
from numba.extending import lower_builtin, models, register_model


def _has_avx512() -> bool:
    """Check that code is made for a processor with AVX-512, see target.py."""
    name, features = target_setting()
    if name:
        return '+avx512f' in features
    return host_features().get('avx512f', False)


# Bodies that are computed together: the width of a register of doubles.
LANES = 8 if _has_avx512() else 4

_INDEX = ir.IntType(32)
_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_BITS = ir.VectorType(ir.IntType(1), LANES)


class Lanes(types.Type):
    """A vector of LANES doubles."""

    def __init__(self) -> None:
        super().__init__(name=f'Lanes({LANES})')


class Mask(types.Type):
    """A truth value for each lane."""

    def __init__(self) -> None:
        super().__init__(name=f'Mask({LANES})')


lanes_type, mask_type = Lanes(), Mask()


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):

    def __init__(self, manager: Any, front: Any) -> None:
        super().__init__(manager, front, _VECTOR)


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):

    def __init__(self, manager: Any, front: Any) -> None:
        super().__init__(manager, front, _BITS)


def _pointer(context: Any, builder: Any, sig: Any, args: Any, indices: list[int]) -> Any:
    """Return the address of the first lane: `args` are the array and its indices."""
    array_type = sig.args[0]
    array = context.make_array(array_type)(context, builder, args[0])
    places = [args[i] for i in indices]
    address = cgutils.get_item_pointer2(
        context, builder, array.data, cgutils.unpack_tuple(builder, array.shape),
        cgutils.unpack_tuple(builder, array.strides), array_type.layout, places,
        wraparound=False)
    return builder.bitcast(address, _VECTOR.as_pointer())


def load_row(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Load lanes of a 2-D array."""
    return builder.load(_pointer(context, builder, sig, args, [1, 2]), align=8)


def load_flat(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Load lanes of a 1-D array."""
    return builder.load(_pointer(context, builder, sig, args, [1]), align=8)


def load_pairs(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Load two adjacent numbers of a 1-D array of doubles for each lane."""
    data = context.make_array(sig.args[0])(context, builder, args[0]).data
    data = builder.gep(data, [args[3]])
    indices = ir.VectorType(_INDEX, LANES)
    factor = builder.insert_element(
        ir.Constant(indices, ir.Undefined),
        args[2], ir.Constant(_INDEX, 0))
    factor = builder.shuffle_vector(factor, factor, ir.Constant(indices, [0] * LANES))
    numbers = builder.mul(builder.fptosi(args[1], indices), factor)
    pair = ir.VectorType(ir.DoubleType(), 2)
    parts = []
    for i in range(LANES):
        place = builder.zext(
            builder.extract_element(numbers, ir.Constant(_INDEX, i)), ir.IntType(64))
        parts.append(builder.load(
            builder.bitcast(builder.gep(data, [place]), pair.as_pointer()), align=8))

    def shuffled(a: Any, b: Any, order: list[int]) -> Any:
        kind = ir.VectorType(_INDEX, len(order))
        return builder.shuffle_vector(a, b, ir.Constant(kind, order))

    # Every other lane in one register, so that one instruction of two registers gives each.
    even, odd = parts[::2], parts[1::2]
    while len(even) > 1:
        order = list(range(2 * even[0].type.count))
        even = [shuffled(a, b, order) for a, b in zip(even[::2], even[1::2])]
        odd = [shuffled(a, b, order) for a, b in zip(odd[::2], odd[1::2])]
    low = [i + k * LANES for i in range(0, LANES, 2) for k in range(2)]
    return context.make_tuple(builder, sig.return_type, [
        shuffled(even[0], odd[0], low), shuffled(even[0], odd[0], [i + 1 for i in low])])


def store_row(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Write lanes into a 2-D array."""
    builder.store(args[3], _pointer(context, builder, sig, args, [1, 2]), align=8)
    return context.get_dummy_value()


def store_flat(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Write lanes into a 1-D array."""
    builder.store(args[2], _pointer(context, builder, sig, args, [1]), align=8)
    return context.get_dummy_value()


def spread(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Copy a number into all lanes."""
    empty = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(empty, args[0], ir.Constant(_INDEX, 0))
    zeros = ir.Constant(ir.VectorType(_INDEX, LANES), [0] * LANES)
    return builder.shuffle_vector(first, empty, zeros)


def _call(builder: Any, name: str, arguments: list[Any], extra: list[Any] | None = None) -> Any:
    arguments = [*arguments, *(extra or [])]
    function_type = ir.FunctionType(_VECTOR, [argument.type for argument in arguments])
    function = cgutils.get_or_insert_function(builder.module, function_type, name)
    return builder.call(function, arguments)


def multiply_add(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Compute a b + c, rounded once if the processor can."""
    return _call(builder, f'llvm.fmuladd.v{LANES}f64', list(args))


def magnitude(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Compute absolute values."""
    return _call(builder, f'llvm.fabs.v{LANES}f64', list(args))


def square_root(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Compute square roots, correctly rounded."""
    return _call(builder, f'llvm.sqrt.v{LANES}f64', list(args))


def inverse_square_root(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """
    Compute 1 / sqrt(a) to about two units in the last place, for normal positive numbers.

    AVX-512 has a first guess y of 14 bits. With h = 1 - a y^2 the root is
    y (1 + h/2 + 3 h^2/8 + 5 h^3/16 + ...), whose next term is below 2^-53. A square root and a
    division take three times as long; other processors use them.
    """
    def constant(value: float) -> Any:
        return ir.Constant(_VECTOR, [value] * LANES)

    if LANES != 8:
        root = _call(builder, f'llvm.sqrt.v{LANES}f64', list(args))
        return builder.fdiv(constant(1.0), root)

    def fma(a: Any, b: Any, c: Any) -> Any:
        return _call(builder, f'llvm.fmuladd.v{LANES}f64', [a, b, c])

    guess = _call(
        builder, 'llvm.x86.avx512.rsqrt14.pd.512', [args[0]],
        [constant(0.0), ir.Constant(ir.IntType(8), 255)])
    zero = constant(0.0)
    product = builder.fmul(args[0], guess)
    h = fma(builder.fsub(zero, product), guess, constant(1.0))
    series = fma(h, fma(h, constant(0.3125), constant(0.375)), constant(0.5))
    return fma(builder.fmul(guess, h), series, guess)


def choose(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Select `a` where the mask is true, else `b`."""
    return builder.select(*args)


def unpack_bits(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Make a mask from the low bits of a byte, lane 0 first."""
    byte = args[0]
    if LANES < 8:
        byte = builder.trunc(byte, ir.IntType(LANES))
    return builder.bitcast(byte, _BITS)


def is_any(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Check that the mask is true in at least one lane."""
    word = ir.IntType(LANES)
    return builder.icmp_unsigned('!=', builder.bitcast(args[0], word), ir.Constant(word, 0))


def lane_of(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Return the number in one lane."""
    return builder.extract_element(*args)


def replace_lane(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Return the vector with another number in one lane."""
    return builder.insert_element(args[0], args[2], args[1])


def larger(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Return the larger of two numbers; the second where either is not a number."""
    return builder.select(builder.fcmp_ordered('>', *args), *args)


def define(function: Any, arguments: tuple[Any, ...], result: Any, emit: Any) -> None:
    """
    Define a function or an operator in compiled code, without a call.

    `arguments`: a type each, or the class of arrays; numbers are converted. `emit` writes the
    machine code, as Numba's lowering functions do.
    """
    class Template(AbstractTemplate):

        def generic(self, args: Any, keywords: Any) -> Any:
            if len(args) != len(arguments) or not all(map(_fits, args, arguments)):
                return None
            return signature(result, *(
                given if wanted is types.Array else wanted
                for given, wanted in zip(args, arguments)))

    define_function(function, Template)
    lower_builtin(function, *arguments)(emit)


def _fits(given: Any, wanted: Any) -> bool:
    if wanted is types.Array:
        return isinstance(given, types.Array)
    if isinstance(wanted, (Lanes, Mask)):
        return isinstance(given, type(wanted))
    return isinstance(given, (types.Number, types.Boolean))


def _define_operator(operation: Any, result: Any, emit: Any) -> None:
    define(operation, (lanes_type, lanes_type), result, (
        lambda context, builder, sig, args: emit(builder, *args)))


_define_operator(operator.add, lanes_type, lambda builder, a, b: builder.fadd(a, b))
_define_operator(operator.sub, lanes_type, lambda builder, a, b: builder.fsub(a, b))
_define_operator(operator.mul, lanes_type, lambda builder, a, b: builder.fmul(a, b))
_define_operator(operator.truediv, lanes_type, lambda builder, a, b: builder.fdiv(a, b))
# Ordered: false where either is not a number.
_define_operator(
    operator.lt, mask_type, lambda builder, a, b: builder.fcmp_ordered('<', a, b))
_define_operator(
    operator.gt, mask_type, lambda builder, a, b: builder.fcmp_ordered('>', a, b))
