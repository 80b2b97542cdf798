# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Records of kernels: what Python sees of them, and that compiled code reads the same fields."""

import copy
import gc
import pickle

from fabrics import make_scene
from icofabric_sim.kernels.records import Loads, Model, Supports
from icofabric_sim.kernels.runtime import record
from icofabric_sim.kernels.runtime.compiled import compiled, compiled_for
from icofabric_sim.kernels.runtime.outlined import address_of, call_float
from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.simulation.model.packing import pack_loads, pack_scene, WrenchRow
from icofabric_sim.terms.drag.record import Drag
from icofabric_sim.terms.meters import Meter
from icofabric_sim.terms.registry import TERMS
import numpy as np
import pytest


class Inner(Record):
    weights: np.ndarray
    count: int


class Outer(Record):
    name: int
    factor: float
    is_on: bool
    grid: np.ndarray
    lacking: np.ndarray | None
    inner: Inner | None = None
    code: np.ndarray | None = None


class Fuel(Record):
    mass: np.ndarray
    spare: Inner | None = None

    @classmethod
    def absent(cls) -> 'Fuel':
        return cls(np.zeros(0))


class Tank(Record):
    size: float
    fuel: Fuel | None


@compiled
def filled(tank):
    """What a tank and its fuel weigh; the fuel's 1,000 times."""
    return tank.size + weight_of(tank.fuel)


@compiled
def weight_of(fuel):
    """Masses added up."""
    result = 0.0
    if fuel is None:
        return result
    else:
        for mass in fuel.mass:
            result += 1000.0 * mass
        return result + (-1.0 if fuel is None else 0.0)


@compiled
def total(outer):
    """Sum over everything that the record holds."""
    result = outer.factor * outer.name
    if outer.is_on:
        result += 1000.0
    for i in range(outer.grid.shape[0]):
        for j in range(outer.grid.shape[1]):
            result += (i + 1) * outer.grid[i, j]
    return result + size_of(outer.lacking) + weighted(outer.inner) + first_of(outer.code)


# What is None has to be an argument of its own to be left out.
@compiled
def size_of(lacking):
    """A million for each element."""
    if lacking is None:
        return 0.0
    else:
        return 1e6 * lacking.size


@compiled
def first_of(code):
    """The first number."""
    if code is None:
        return 0.0
    else:
        return float(code[0])


@compiled
def weighted(inner):
    """Weights added up, the record handed on by itself."""
    result = 0.0
    if inner is None:
        return result
    else:
        for i in range(inner.count):
            result += inner.weights[i]
        return result


@compiled
def write(outer, value):
    """Write into an array of the record."""
    outer.grid[0, 1] = value


GRID = np.arange(6.0).reshape(2, 3)
# 0 + 1 + 2 + 2 (3 + 4 + 5)
GRID_SUM = 27.0


def test_compiled_code_reads_every_kind_of_field():
    assert total(Outer(3, 0.5, True, GRID, None)) == 1.5 + 1000.0 + GRID_SUM
    inner = Inner(np.array([1.0, 2.0, 4.0]), 2)
    whole = Outer(-3, 0.5, False, GRID, np.zeros((2, 2)), inner, np.array([-7], np.int8))
    assert total(whole) == -1.5 + GRID_SUM + 4e6 + 3.0 - 7.0
    # Strides count, not only shapes; read-only arrays are read.
    turned = GRID.T.copy().T
    turned.flags.writeable = False
    assert not turned.flags.c_contiguous
    assert total(whole._replace(grid=turned)) == total(whole)
    assert total(whole._replace(grid=np.zeros((0, 3)))) == total(whole) - GRID_SUM


def test_what_may_be_absent_at_run_time_needs_no_other_code():
    full, empty = Tank(0.5, Fuel(np.array([1.0, 2.0]))), Tank(0.25, None)
    assert filled(full) == 3000.5 and filled(empty) == 0.25
    assert type(full) is type(empty) and len(filled.overloads) == 1
    # To Python it is None as any other, also in copies.
    assert empty.fuel is None and full.fuel is not None
    assert filled(full._replace(fuel=None)) == 0.5
    assert filled(empty._replace(fuel=full.fuel)) == 3000.25
    for other in (copy.deepcopy(empty), pickle.loads(pickle.dumps(empty))):
        assert other.fuel is None and filled(other) == 0.25
    # Nothing of it, and none of it, are two things.
    assert filled(Tank(0.0, Fuel(np.zeros(0)))) == 0.0
    # What the record itself leaves out by its type makes another kind, as everywhere.
    assert type(Tank(0.0, Fuel(np.zeros(1), Inner(np.ones(1), 1)))) is not type(full)


def test_a_record_keeps_what_stands_for_none_in_it():
    # Another thread may make the one that is kept for later records.
    empty = Tank(0.25, None)
    record._absent.cache_clear()
    gc.collect()
    other = Tank(0.5, None)
    kept = [part for part in empty._packed if isinstance(part, Fuel)]
    assert len(kept) == 1 and kept[0] is not other._packed[1]
    assert empty._buffer[1] == kept[0]._address and filled(empty) == 0.25


@pytest.mark.parametrize('terms', [
    {'gravity': [0.0, 0.0, -9.81]}, {'groups.top': 'z_max', 'supports.top.group': 'top'}],
    ids=str)
def test_scenes_with_and_without_common_terms_are_one_kind(terms):
    plain, other = (pack_scene(make_scene((2, 2, 2), {
        'contact.mode': 'never', **changes})) for changes in ({}, terms))
    kind = plain.model.numba_type()
    assert other.model.numba_type() == kind
    damped = pack_scene(make_scene((2, 2, 2), {'contact.mode': 'never', 'drag.linear': 1e-3}))
    assert damped.model.numba_type() != kind
    kinds = {
        pack_loads(rows, plain.layout, stages=stages, varying=varying).numba_type()
        for rows in ((), [WrenchRow(np.array([1], np.int32), False, np.ones(3), np.zeros(3))])
        for stages in (0, 16) for varying in (False, True)}
    assert len(kinds) == 1


def test_arrays_are_shared_and_numbers_are_not():
    grid = GRID.copy()
    outer = Outer(0, 0.0, False, grid, None)
    write(outer, 100.0)
    assert grid[0, 1] == outer.grid[0, 1] == 100.0
    grid[0, 1] = 1.0
    assert total(outer) == GRID_SUM


def test_a_record_is_a_sequence_of_named_fields_that_do_not_change():
    outer = Outer(name=1, factor=2.0, is_on=True, grid=GRID, lacking=None)
    assert list(outer) == [1, 2.0, True, outer.grid, None, None, None]
    assert outer._asdict()['factor'] == 2.0 and isinstance(outer, Outer)
    assert repr(Inner(np.zeros(1), 2)) == 'Inner(weights=array([0.]), count=2)'
    changed = outer._replace(factor=3.0)
    assert changed.factor == 3.0 and outer.factor == 2.0 and changed.grid is outer.grid
    with pytest.raises(AttributeError, match=r'Outer\.factor cannot be changed'):
        outer.factor = 4.0
    with pytest.raises(ValueError, match="no fields .'speed'."):
        outer._replace(speed=1.0)
    with pytest.raises(TypeError, match='Inner'):
        Inner(np.zeros(1))
    with pytest.raises(TypeError, match='Inner'):
        Inner(np.zeros(1), 2, weights=np.zeros(1))
    with pytest.raises(TypeError, match='Inner has 2 fields, not 3'):
        Inner(np.zeros(1), 2, 3)
    with pytest.raises(TypeError, match=r'Inner\.count must not be a str'):
        Inner(np.zeros(1), 'two')


def test_copies_hold_their_own_arrays():
    outer = Outer(2, 0.5, False, GRID.copy(), None, Inner(np.ones(2), 2))
    for other in (copy.deepcopy(outer), pickle.loads(pickle.dumps(outer))):
        assert isinstance(other, Outer) and total(other) == total(outer)
        write(other, 50.0)
        assert other.grid[0, 1] == 50.0 and outer.grid[0, 1] == 1.0


def test_only_what_is_none_and_the_kinds_of_arrays_make_another_type():
    drag = Drag(1.0, 2.0)
    assert type(drag) is type(Drag(3.0, 4.0))
    meter = Meter(np.zeros((16, 8)), np.zeros((2, 8)))
    assert type(meter) is type(Meter(np.ones((16, 80)), np.ones((2, 80))))
    assert type(meter) is not type(Meter(np.ones((16, 8), np.float32), np.ones((2, 8))))
    assert type(Outer(1, 1.0, True, GRID, None)) is not type(Outer(1, 1.0, True, GRID, GRID))
    # Annotations are fields, in their order, then records of terms; defaults are of the class.
    assert Model._fields[:3] == ('inverse_mass', 'inverse_inertia', 'blocks')
    # Terms that only act on velocities come last, after contacts.
    last = Model._fields[Model._fields.index('contacts') + 1:]
    assert {'damping', 'drag'} <= {*last}
    assert not any(term.has('bound') for term in TERMS if term.name in last)
    assert Model._defaults['gravity'] is None
    assert Model._defaults['contacts'] is None and 'blocks' not in Model._defaults
    assert Supports._fields == ('inverse_mass', 'inverse_inertia')
    assert Loads._fields[-3:] == ('tractions', 'anchors', 'drives')


@compiled
def halved(tank):
    """Half the size, from the first fields of a tank or from all."""
    return 0.5 * tank.size


@compiled
def weight_by(address, tank):
    """What `filled` returns, called by its address with the first fields of a tank."""
    return call_float(address, (tank,))


def test_first_fields_have_one_type_and_the_address_of_all():
    class Cargo(Record):
        size: float
        inner: Inner | None
        after: float

    without, within = Cargo(2.0, None, 5.0), Cargo(3.0, Inner(np.ones(2), 2), 5.0)
    assert type(without) is not type(within)
    kinds = {type(cargo.common())._numba_type for cargo in (without, within)}
    assert len(kinds) == 1 and list(kinds.pop().fields) == ['size']
    assert (halved(without.common()), halved(within.common())) == (1.0, 1.5)
    assert len(halved.overloads) == 1
    for cargo in (without, within):
        assert weight_by(address_of(sized, cargo), cargo.common()) == cargo.size + 5.0
    assert len(weight_by.overloads) == 1 and len(sized.overloads) == 2


@compiled_for(tank='after')
def doubled_size(tank, factor):
    """Twice the size times a factor, from the fields before `after`."""
    return 2.0 * tank.size * factor


def test_records_that_differ_in_fields_that_are_not_read_share_a_kernel():
    class Load(Record):
        size: float
        inner: Inner | None
        after: float | None
        last: np.ndarray | None = None

    inner = Inner(np.ones(2), 2)
    assert doubled_size(Load(2.0, None, None), 3.0) == 12.0
    assert doubled_size(Load(2.0, None, 5.0, np.ones(1)), 3.0) == 12.0
    assert len(doubled_size.overloads) == 1
    assert doubled_size(Load(2.5, inner, None), 3.0) == 15.0
    assert address_of(doubled_size, Load(2.0, inner, 7.0), 3.0) != 0
    assert doubled_size.is_ready(Load(4.0, inner, 7.0, np.ones(3)), 3.0)
    assert len(doubled_size.overloads) == 2


@compiled
def sized(cargo):
    """The sum of the fields before and after the one that may be None."""
    return cargo.size + cargo.after


def test_a_record_that_never_varies_is_common_as_a_whole():
    tank = Tank(1.0, Fuel(np.full(2, 4.0)))
    assert list(type(tank.common())._numba_type.fields) == ['size', 'fuel']
    assert filled(tank.common()) == filled(tank)
