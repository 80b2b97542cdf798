# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Records in kernels: a pointer to packed fields, which are read where they are used.

Numba passes its own tuples field by field. A call of a kernel had some thousand arguments, each
array with a reference to count, which took most of the compile time. A record is immutable and
its caller keeps it. A kernel therefore reads the fields by pointer and counts nothing, and the
optimiser may treat loaded fields as constants.
"""

from collections.abc import Iterable
import hashlib
import operator
from typing import Any

from icofabric_sim.kernels.runtime.numba_private import (
    add_after_declaring,
    AttributeTemplate,
    cgutils,
)
from llvmlite import ir
from numba import types
from numba.extending import (
    infer_getattr,
    lower_builtin,
    lower_getattr_generic,
    models,
    NativeValue,
    register_model,
    typeof_impl,
    unbox,
)

_WORD_TYPE = ir.IntType(64)


class RecordType(types.Type):
    """
    A record whose fields have these types; fields that are None have Numba's type of None.

    Words of 8 bytes: a number or the address of a record takes one, an array its address, the
    number of its elements, the size of one, its shape and its strides; None takes none. Where
    `optional`, a word before the fields is 0 in the record that stands for None, else 1.
    """

    def __init__(
        self, record: str, fields: tuple[tuple[str, types.Type], ...], *, optional: bool = False
    ) -> None:
        """Take the name of the record and its fields in their order."""
        digest = hashlib.sha256(
            ' '.join(f'{name} {kind}' for name, kind in fields).encode()).hexdigest()[:16]
        super().__init__(name=f'{record}.{digest}')
        self.fields = dict(fields)
        self.optional = optional
        self.places: dict[str, int] = {}
        place = int(optional)
        for name, kind in fields:
            self.places[name] = place
            place += words_of(kind)
        # [B]
        self.size = 8 * max(place, 1)

    def can_convert_to(self, typingctx: Any, other: Any) -> None:
        """Return None: no record converts to another one."""
        return


def words_of(kind: types.Type) -> int:
    """Return the number of words that a field takes."""
    if isinstance(kind, types.NoneType):
        return 0
    if isinstance(kind, types.Array):
        return 3 + 2 * kind.ndim
    return 1


@register_model(RecordType)
class _RecordModel(models.OpaqueModel):
    """A pointer that owns nothing."""


@infer_getattr
class _RecordFields(AttributeTemplate):
    """Types of the fields."""

    key = RecordType

    def generic_resolve(self, value: Any, attr: Any) -> Any:  # type: ignore[override]
        return value.fields.get(attr)


@lower_getattr_generic(RecordType)
def _read_field(context: Any, builder: Any, record: RecordType, pointer: Any, name: str) -> Any:
    kind, place = record.fields[name], record.places[name]
    if isinstance(kind, types.NoneType):
        return context.get_dummy_value()
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder)
        array.meminfo = array.meminfo.type(None)
        array.parent = array.parent.type(None)
        array.data = _load(builder, pointer, place, array.data.type)
        array.nitems = _load(builder, pointer, place + 1, _WORD_TYPE)
        array.itemsize = _load(builder, pointer, place + 2, _WORD_TYPE)
        place += 3
        for part in ('shape', 'strides'):
            words = [_load(builder, pointer, place + k, _WORD_TYPE) for k in range(kind.ndim)]
            setattr(array, part, cgutils.pack_array(builder, words, ty=_WORD_TYPE))
            place += kind.ndim
        return array._getvalue()
    wanted = context.get_value_type(kind)
    if isinstance(kind, RecordType):
        inner = _load(builder, pointer, place, wanted)
        size = ir.Constant(_WORD_TYPE, kind.size)
        inner.set_metadata('dereferenceable', builder.module.add_metadata([size]))
        inner.set_metadata('nonnull', builder.module.add_metadata([]))
        return inner
    if kind is types.float64:
        return _load(builder, pointer, place, wanted)
    value = _load(builder, pointer, place, _WORD_TYPE)
    return builder.trunc(value, wanted) if wanted.width < _WORD_TYPE.width else value


@lower_builtin(operator.is_, RecordType, types.NoneType)
def _is_absent(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    """
    Lower `record is None`: read the first word, or return False if the record is not optional.
    """
    if not signature.args[0].optional:
        return cgutils.false_bit
    present = _load(builder, values[0], 0, _WORD_TYPE)
    return builder.icmp_unsigned('==', present, ir.Constant(_WORD_TYPE, 0))


def _load(builder: Any, pointer: Any, place: int, kind: Any) -> Any:
    """Load a word of a record: as a constant, because nothing writes into a record."""
    address = builder.gep(
        builder.bitcast(pointer, _WORD_TYPE.as_pointer()), [ir.Constant(ir.IntType(32), place)])
    value = builder.load(builder.bitcast(address, kind.as_pointer()))
    value.set_metadata('invariant.load', builder.module.add_metadata([]))
    return value


def _mark_records(arguments: dict[str, Any], kinds: Iterable[tuple[str, Any]]) -> None:
    """
    Mark the arguments of a function that are records: they can be read anywhere in the function.

    The optimiser may then read a field before a loop, though only some rounds of the loop need it.
    """
    for name, kind in kinds:
        if isinstance(kind, RecordType) and name in arguments:
            arguments[name].attributes.dereferenceable = kind.size
            arguments[name].attributes.add('nonnull')


add_after_declaring(_mark_records)


@unbox(RecordType)
def _address_of(kind: RecordType, record: Any, context: Any) -> NativeValue:
    number = context.pyapi.object_getattr_string(record, '_address')
    pointer = context.pyapi.long_as_voidptr(number)
    context.pyapi.decref(number)
    return NativeValue(pointer, is_error=cgutils.is_not_null(
        context.builder, context.pyapi.err_occurred()))


def register(record: type) -> None:
    """Make `typeof` recognise instances of a class of records by their `_numba_type`."""
    typeof_impl.register(record)(lambda value, context: value._numba_type)
