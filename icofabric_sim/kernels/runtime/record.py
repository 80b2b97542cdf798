# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Records that kernels take: immutable, their fields packed for compiled code when they are made.

    class Meter(Record):
        power: np.ndarray
        done: np.ndarray

A field is an array, a number, a truth value, another record, or None. The type of a kernel's
argument states which fields are None, and Numba omits the code that only those fields need.

Kernels test a class with a method `absent` at run time instead:

    class Fuel(Record):
        mass: np.ndarray

        @classmethod
        def absent(cls) -> 'Fuel':
            return cls(np.zeros(0))

A field that may hold such a record or None has one type in both cases, so one compiled kernel
serves both. `is None` then reads a word of the record. Use such a class where the branch costs a
kernel little for each block, and another compilation would take seconds. The annotation of such a
field names the class itself: a name in quotes is not looked up.
"""

from collections.abc import Iterator, Mapping
import ctypes
from functools import cache
import inspect
import struct
from typing import Any, ClassVar, dataclass_transform, get_args, Self

from icofabric_sim.kernels.runtime.numba_private import is_compiling_disabled
from icofabric_sim.kernels.runtime.record_types import RecordType, register
import numba
from numba import types
import numpy as np

_MISSING = object()


class _Address(ctypes.Structure):
    """
    Base with a buffer interface, by which Numba's dispatcher recognises a record.

    The dispatcher looks up an object with a buffer by its class alone, in a tenth of the time of a
    query in Python.
    """

    _fields_ = (('_address', ctypes.c_void_p),)


class _Common(_Address):
    """The first fields of a record, see `Record.common`."""

    _numba_type: ClassVar[RecordType]

    @classmethod
    def numba_type(cls) -> RecordType:
        """Return the Numba type of the first fields."""
        return cls._numba_type


register(_Common)


@dataclass_transform(frozen_default=True)
class Record(_Address):
    """Base of all records; fields are the annotations of a class, which may have defaults."""

    _fields: ClassVar[tuple[str, ...]] = ()
    _defaults: ClassVar[dict[str, Any]] = {}
    _kinds: ClassVar[dict[Any, type]] = {}
    # Classes of the fields in which a record stands for None, tested at run time.
    _absent: ClassVar[dict[str, 'type[Record]']] = {}
    _is_optional: ClassVar[bool] = False
    # The first field whose type differs between records, and classes for the fields before one.
    _first_varying: ClassVar[str] = ''
    _common_kinds: ClassVar[dict[str, type[_Common]]]
    # Set in a class that belongs to one combination of field types.
    _numba_type: ClassVar[RecordType | None] = None
    _places: ClassVar[dict[str, tuple[int, int, int]] | None] = None

    def __init_subclass__(
        cls, *, parts: 'Mapping[str, type[Record]] | None' = None, **options: Any
    ) -> None:
        """
        Read the fields; classes for one type of the fields inherit them.

        `parts` are further fields, each a record of the named class or None, which is the default.
        """
        super().__init_subclass__(**options)
        if '_numba_type' in cls.__dict__:
            return
        parts = parts or {}
        own = inspect.get_annotations(cls)
        cls._defaults = {name: cls.__dict__[name] for name in own if name in cls.__dict__}
        for name in cls._defaults:
            delattr(cls, name)
        cls._defaults |= dict.fromkeys(parts)
        own |= {name: part | None for name, part in parts.items()}
        cls._fields = tuple(own)
        cls._kinds = {}
        cls._is_optional = 'absent' in cls.__dict__
        cls._absent = {
            name: part for name, hint in own.items() for part in get_args(hint)
            if isinstance(part, type) and issubclass(part, Record) and part._is_optional}
        cls._first_varying = next((
            name for name, hint in own.items() if name not in cls._absent and _may_vary(hint)), '')
        register(cls)

    def __new__(cls, *values: Any, **named: Any) -> Self:
        """Make a record of its fields, in order or by name."""
        base = cls._base()
        if len(values) > len(base._fields):
            raise TypeError(f'{base.__name__} has {len(base._fields)} fields, not {len(values)}')
        fields = dict(zip(base._fields, values))
        fields.update(named)
        if len(fields) != len(base._fields) or len(values) + len(named) != len(fields):
            fields = {**base._defaults, **fields}
            wrong = set(base._fields) ^ set(fields)
            if wrong or len(values) + len(named) > len(fields):
                raise TypeError(f'{base.__name__}: wrong or missing fields {sorted(wrong)}')
        ordered = {name: fields[name] for name in base._fields}
        packed = ordered
        if base._absent:
            packed = {
                name: _absent(base._absent[name])
                if value is None and name in base._absent else value
                for name, value in ordered.items()}
        key = tuple(_kind_of(value) for value in packed.values())
        try:
            kind = base._kinds[key]
        except KeyError:
            kind = base._kinds[key] = _kind(base, packed)
        record: Any = super().__new__(kind)
        words = [1] if base._is_optional else []
        for value in packed.values():
            _pack(value, words)
        buffer = np.array(words, dtype=np.int64)
        # The words are addresses of the values in `packed`.
        vars(record).update(ordered, _buffer=buffer, _packed=tuple(packed.values()))
        record._address = buffer.ctypes.data
        return record

    def __init__(self, *values: Any, **named: Any) -> None:
        """Do nothing: `__new__` sets the fields."""

    def __setattr__(self, name: str, value: Any) -> None:
        """Raise AttributeError; kernels have read the fields."""
        if name != '_address':
            raise AttributeError(f'{self._base().__name__}.{name} cannot be changed')
        super().__setattr__(name, value)

    def __iter__(self) -> Iterator[Any]:
        """Yield the values of the fields."""
        values = vars(self)
        return iter([values[name] for name in self._fields])

    def __len__(self) -> int:
        """Count the fields."""
        return len(self._fields)

    def __getitem__(self, place: Any) -> Any:
        """Return the value of a field by its place, or those of a slice."""
        return tuple(self)[place]

    def __repr__(self) -> str:
        """Return the fields by name."""
        fields = ', '.join(f'{name}={value!r}' for name, value in self._asdict().items())
        return f'{self._base().__name__}({fields})'

    def __reduce__(self) -> Any:
        """Pickle and copy by the fields: the address is of this process."""
        return self._base(), tuple(self)

    def _asdict(self) -> dict[str, Any]:
        values = vars(self)
        return {name: values[name] for name in self._fields}

    def _replace(self, **changed: Any) -> Self:
        """Return the record with other values; unchanged fields are not packed again."""
        kind, values = type(self), vars(self)
        places = kind._find_places(values['_packed'])
        unknown = set(changed) - set(places)
        if unknown:
            raise ValueError(f'{self._base().__name__} has no fields {sorted(unknown)}')
        packed, buffer = list(values['_packed']), values['_buffer'].copy()
        for name, value in changed.items():
            if value is None and name in self._absent:
                value = _absent(self._absent[name])
            number, first, last = places[name]
            if _kind_of(value) != _kind_of(packed[number]):
                return self._base()(**{**self._asdict(), **changed})
            words: list[int] = []
            _pack(value, words)
            packed[number], buffer[first:last] = value, words
        record: Any = super().__new__(kind)
        vars(record).update(values)
        vars(record).update(changed, _buffer=buffer, _packed=tuple(packed))
        record._address = buffer.ctypes.data
        return record

    @classmethod
    def _find_places(cls, packed: tuple[Any, ...]) -> dict[str, tuple[int, int, int]]:
        """
        Return the number, first and last word of each field, equal for all records of a class.
        """
        if cls._places is None:
            places, words = {}, [1] if cls._is_optional else []
            for number, (name, value) in enumerate(zip(cls._fields, packed)):
                first = len(words)
                _pack(value, words)
                places[name] = number, first, len(words)
            cls._places = places
        return cls._places

    def common(self, end: str = '') -> Any:
        """
        Return this record for kernels that serve many records of the class: only its first fields.

        Those are the fields before the field `end`; '': before the first that may be None. The
        address is that of the record, so a kernel can hand it on to one that reads all fields. The
        caller keeps the record.
        """
        if is_compiling_disabled():
            return self
        kind, end = type(self), end or self._first_varying
        if end not in kind._common_kinds:
            all_fields = kind.numba_type().fields
            names = list(all_fields)
            names = names[:names.index(end)] if end else names
            kind._common_kinds[end] = type(f'{kind.__name__}Common', (_Common,), {
                '_numba_type': RecordType(
                    f'{kind.__name__}Common', tuple((name, all_fields[name]) for name in names),
                    optional=self._is_optional)})
        common: Any = kind._common_kinds[end]()
        common._address = self._address
        return common

    @classmethod
    def numba_type(cls) -> RecordType:
        """Return the Numba type of all records of this class, which must have a type."""
        assert cls._numba_type is not None
        return cls._numba_type

    @classmethod
    def _base(cls) -> type[Self]:
        """Return the class that names the fields."""
        return cls if cls._numba_type is None else cls.__mro__[1]


def _may_vary(hint: Any) -> bool:
    """Return True if fields with this annotation may be None, or anything."""
    if isinstance(hint, str):
        return 'None' in hint
    return hint is Any or type(None) in get_args(hint)


@cache
def _absent(kind: type[Record]) -> Any:
    """Return the record that stands for None in fields of this class; one for the process."""
    make: Any = kind
    record = make.absent()
    record._buffer[0] = 0
    return record


def _kind_of(value: Any) -> Any:
    """Return a key that is equal for values whose fields have the same type; fast."""
    kind = type(value)
    if kind is np.ndarray:
        flags = value.flags
        return value.dtype, value.ndim, flags.c_contiguous, flags.f_contiguous, flags.writeable
    return kind


def _kind(base: type[Record], fields: dict[str, Any]) -> type:
    """Return the class of records with fields of such types."""
    kinds = tuple((name, _field_type(base, name, value)) for name, value in fields.items())
    return type(base.__name__, (base,), {
        '_numba_type': RecordType(base.__name__, kinds, optional=base._is_optional),
        '_common_kinds': {}})


def _field_type(base: type[Record], name: str, value: Any) -> types.Type:
    if value is None:
        return types.none
    if isinstance(value, (Record, _Common)):
        return type(value).numba_type()
    if isinstance(value, (bool, np.bool_)):
        return types.boolean
    if isinstance(value, (int, np.integer)):
        return types.int64
    if isinstance(value, (float, np.floating)):
        return types.float64
    if isinstance(value, np.ndarray):
        return numba.typeof(value)
    raise TypeError(f'{base.__name__}.{name} must not be a {type(value).__name__}')


def _pack(value: Any, words: list[int]) -> None:
    """Add the words of a field, as `RecordType` lays them out."""
    if value is None:
        return
    if isinstance(value, (Record, _Common)):
        words.append(value._address)
    elif isinstance(value, np.ndarray):
        words += (value.ctypes.data, value.size, value.itemsize, *value.shape, *value.strides)
    elif isinstance(value, (float, np.floating)):
        words += struct.unpack('<q', struct.pack('<d', value))
    else:
        words.append(int(value))
