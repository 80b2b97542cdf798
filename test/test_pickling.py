# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Exceptions and results of the package survive pickle and copy, to the bit."""

import copy
import dataclasses
from importlib import import_module
import inspect
import pickle
import pkgutil

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.simulation.model.as_table import AsTable, Results
from icofabric_sim.simulation.model.body_force import BodyForce
import numpy as np
import pytest

WAYS = [copy.copy, copy.deepcopy, *(
    lambda value, protocol=protocol: pickle.loads(pickle.dumps(value, protocol))
    for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1))]
# Compiled code of a process, which copies do without.
COMPILED = {'body_force', 'external'}
FILLS = {str: 'connector.stiffness: -1 N/m', int: 7, bool: False}


def classes():
    """All classes of the package; modules that need a library which is not there are left out."""
    for module in pkgutil.walk_packages(ico.__path__, 'icofabric_sim.'):
        try:
            members = vars(import_module(module.name)).values()
        except ModuleNotFoundError as error:
            assert not (error.name or '').startswith('icofabric_sim'), module.name
            continue
        yield from (each for each in members if inspect.isclass(each)
                    and each.__module__ == module.name)


def same_bits(one, other, seen):
    """Compare all that two objects hold; `seen` has the pairs that were compared."""
    if one is other or (id(one), id(other)) in seen:
        return True
    seen[id(one), id(other)] = one, other
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray):
        return (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    if isinstance(one, float):
        return one.hex() == other.hex()
    if isinstance(one, dict):
        return list(one) == list(other) and all(same_bits(one[k], other[k], seen) for k in one)
    if isinstance(one, (list, tuple, Record)) and not all(
            len(one) == len(other) and same_bits(a, b, seen) for a, b in zip(one, other)):
        return False
    if isinstance(one, Record):
        return True
    if dataclasses.is_dataclass(one):
        return all(same_bits(getattr(one, field.name), getattr(other, field.name), seen)
                   for field in dataclasses.fields(one) if field.name not in COMPILED)
    if hasattr(one, '__dict__'):
        # What is computed when it is first read may be there in one of them only.
        mine, theirs = vars(one), vars(other)
        return all(same_bits(mine[k], theirs[k], seen) for k in mine.keys() & theirs.keys())
    return isinstance(one, (list, tuple)) or bool(one == other)


def push(time, position, orientation, linear_velocity, angular_velocity):
    """Act on all bodies, in Python."""
    return np.full(position.shape, 1e-3), np.zeros(position.shape)


@pytest.fixture(scope='module')
def results(tmp_path_factory):
    """One of each public result, and lists of them."""
    scene = make_scene((2, 2, 2), {
        'gravity': [0.0, 0.0, -9.81], 'groups.top': 'z_max', 'supports.ceiling.group': 'top',
        'connector.natural_length': 0.044})
    simulation = ico.compile_scene(scene, body_force=BodyForce(push, compiled=False))
    simulation.advance_to(0.01)
    slab = make_scene((3, 3, 3))
    found = [
        scene, scene.shell, BodyForce(push), simulation.snapshot(), simulation.checkpoint(),
        simulation.reactions(), simulation.contacts(), simulation.balance,
        ico.solve_equilibrium(scene), ico.solve_modes(scene), ico.homogenise(slab),
        ico.measure_growth(make_scene((2, 2, 2)), 0.01),
        ico.measure_curve(slab, 'shear', [0.01, 0.02]),
        ico.measure_moment_curve(slab, 'twist', [0.01]),
        ico.measure_cycles(slab, 'shear', [0.01, 0.02]),
        ico.sweep(slab, {'connector.stiffness': [400.0, 500.0]}, verbs='elasticity', workers=0,
                  store=tmp_path_factory.mktemp('sweep') / 'store')]
    for result in list(found):
        if isinstance(result, Results):
            found += result
    return found


def test_every_exception_is_the_same_after_pickle_and_copy():
    found = [each for each in classes() if issubclass(each, BaseException)]
    assert {ico.ParameterError, ico.SimulationError, ico.RankError} <= set(found)
    for each in found:
        own = each.__init__ is not each.__mro__[-2].__init__ and inspect.isfunction(each.__init__)
        arguments = [
            FILLS[parameter.annotation]
            for parameter in list(inspect.signature(each.__init__).parameters.values())[1:]
        ] if own else ['connector 3 broke at 0.5 s']
        error = each(*arguments)
        error.add_note('noted')
        for way in WAYS:
            again = way(error)
            assert type(again) is each and str(again) == str(error) and again.args == error.args
            assert vars(again) == vars(error) and again.__notes__ == ['noted']


def test_every_result_is_the_same_after_pickle_and_copy(results):
    public = [getattr(ico, name) for name in ico.__all__ if name != 'METHODS']
    kinds = {each for each in classes() if (
        issubclass(each, AsTable) or each in public
        or inspect.isfunction(row := vars(each).get('row')) and issubclass(each, tuple)
        and len(inspect.signature(row).parameters) == 1)
        and not issubclass(each, BaseException) and not inspect.isabstract(each)}
    assert kinds <= {type(result) for result in results} | {ico.Simulation, ico.Ranks}
    for result in results:
        # The derived values, too.
        derived = [name for name, value in inspect.getmembers(type(result))
                   if isinstance(value, property) or hasattr(value, 'attrname')]
        for way in WAYS:
            again = way(result)
            assert same_bits(result, again, {}), (type(result), way)
            for name in derived:
                assert same_bits(getattr(result, name), getattr(again, name), {}), name


def test_copies_of_snapshots_are_not_to_be_written_to(results):
    snapshot, = (result for result in results if isinstance(result, ico.Snapshot))
    for way in WAYS:
        with pytest.raises(ValueError, match='read-only'):
            way(snapshot).position[0, 0] = 1.0


@pytest.mark.parametrize('way', WAYS)
def test_what_belongs_to_a_process_refuses_and_names_checkpoint(way):
    simulation = ico.compile_scene(make_scene((2, 2, 2)))
    for thing in simulation, simulation.status, object.__new__(ico.Ranks):
        with pytest.raises(TypeError, match='(?i)checkpoint'):
            way(thing)
