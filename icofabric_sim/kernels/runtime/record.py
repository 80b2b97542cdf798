# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Records that kernels take: immutable, their fields packed for compiled code when they are made.

    class Meter(Record):
        power: np.ndarray
        done: np.ndarray

A field is an array, a number, a truth value, another record, or None: the type of a kernel's
argument says which fields are None, and Numba leaves out what they would need.

A class with a method `absent` is asked for while kernels run instead:

    class Fuel(Record):
        mass: np.ndarray

        @classmethod
        def absent(cls) -> 'Fuel':
            return cls(np.zeros(0))

A field that may hold such a record or None has one type, whichever it holds, so kernels compiled
for one serve the other. `is None` reads a word of the record then. For what costs a kernel less
than a branch for each block, and for which another compilation would take seconds. The annotation
of such a field names the class itself: one in quotes is not looked up.
"""

from collections.abc import Iterator
import ctypes
from functools import cache
import inspect
import struct
from typing import Any, ClassVar, dataclass_transform, get_args, Self

from icofabric_sim.kernels.runtime.record_types import RecordType, register
import numba
from numba.core import types
import numpy as np

_MISSING = object()


class _Address(ctypes.Structure):
    """
    What Numba's dispatcher sees of a record.

    It knows the type of an object that has a buffer by its class alone, in a tenth of the time
    that asking Python takes.
    """

    _fields_ = (('_address', ctypes.c_void_p),)


@dataclass_transform(frozen_default=True)
class Record(_Address):
    """Base of all records; fields are the annotations of a class, which may have defaults."""

    _fields: ClassVar[tuple[str, ...]] = ()
    _defaults: ClassVar[dict[str, Any]] = {}
    _kinds: ClassVar[dict[Any, type]] = {}
    # What stands for None in a field, of the classes that kernels ask at run time.
    _absent: ClassVar[dict[str, 'type[Record]']] = {}
    _is_optional: ClassVar[bool] = False
    # Of a class that belongs to one type of the fields: made when first asked for.
    _numba_type: ClassVar[RecordType | None] = None
    _places: ClassVar[dict[str, tuple[int, int, int]] | None] = None

    def __init_subclass__(cls, **options: Any) -> None:
        """Read the fields; classes for one type of the fields inherit them."""
        super().__init_subclass__(**options)
        if '_numba_type' in cls.__dict__:
            return
        own = inspect.get_annotations(cls)
        cls._fields = tuple(own)
        cls._defaults = {name: cls.__dict__[name] for name in own if name in cls.__dict__}
        for name in cls._defaults:
            delattr(cls, name)
        cls._kinds = {}
        cls._is_optional = 'absent' in cls.__dict__
        cls._absent = {
            name: part for name, hint in own.items() for part in get_args(hint)
            if isinstance(part, type) and issubclass(part, Record) and part._is_optional}
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
        # Its words are addresses of what is in `packed`.
        vars(record).update(ordered, _buffer=buffer, _packed=tuple(packed.values()))
        record._address = buffer.ctypes.data
        return record

    def __init__(self, *values: Any, **named: Any) -> None:
        """Leave all to `__new__`."""

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse; kernels have read the fields."""
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
        """Return the record with other values; what stays is not packed again."""
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
        """Number, first word and last of each field, the same for all records of a class."""
        if cls._places is None:
            places, words = {}, [1] if cls._is_optional else []
            for number, (name, value) in enumerate(zip(cls._fields, packed)):
                first = len(words)
                _pack(value, words)
                places[name] = number, first, len(words)
            cls._places = places
        return cls._places

    @classmethod
    def numba_type(cls) -> RecordType:
        """Return the type of records of a class that has one: of every instance."""
        assert cls._numba_type is not None
        return cls._numba_type

    @classmethod
    def _base(cls) -> type[Self]:
        """Return the class that names the fields."""
        return cls if cls._numba_type is None else cls.__mro__[1]


@cache
def _absent(kind: type[Record]) -> Any:
    """Make the record that stands for None in fields of this class; kept for good."""
    make: Any = kind
    record = make.absent()
    record._buffer[0] = 0
    return record


def _kind_of(value: Any) -> Any:
    """What the type of a field depends on, quickly."""
    kind = type(value)
    if kind is np.ndarray:
        flags = value.flags
        return value.dtype, value.ndim, flags.c_contiguous, flags.f_contiguous, flags.writeable
    return kind


def _kind(base: type[Record], fields: dict[str, Any]) -> type:
    """Make the class of records with fields of such types."""
    kinds = tuple((name, _field_type(base, name, value)) for name, value in fields.items())
    return type(base.__name__, (base,), {
        '_numba_type': RecordType(base.__name__, kinds, optional=base._is_optional)})


def _field_type(base: type[Record], name: str, value: Any) -> types.Type:
    if value is None:
        return types.none
    if isinstance(value, Record):
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
    if isinstance(value, Record):
        words.append(value._address)
    elif isinstance(value, np.ndarray):
        words += (value.ctypes.data, value.size, value.itemsize, *value.shape, *value.strides)
    elif isinstance(value, (float, np.floating)):
        words += struct.unpack('<q', struct.pack('<d', value))
    else:
        words.append(int(value))
