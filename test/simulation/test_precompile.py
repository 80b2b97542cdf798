# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels with contact are made ready beside a run that has none yet."""

import io
import pickle
import threading

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.process.compile_notice import compile_notice
from icofabric_sim.simulation import precompile, precompile_process
from icofabric_sim.simulation.simulation import use_all_kernels
from icofabric_sim.simulation.stepping.uniform_stepping import UniformStepping
import pytest

CHANGES = {'contact.mode': 'auto', 'solver.method': 'leapfrog', 'solver.step': 1e-5}


class FakeProcess:
    """Keeps what it is given."""

    def __init__(self, begun, arguments):
        begun.append(self)
        self.arguments, self.stdin, self.task, self.ended = arguments, io.BytesIO(), b'', False
        self.stdin.close = lambda: setattr(self, 'task', self.stdin.getvalue())

    def poll(self):
        return None

    def kill(self):
        self.ended = True

    def wait(self):
        assert self.ended


@pytest.fixture
def begun(monkeypatch):
    found = []
    monkeypatch.setenv('ICOFABRIC_COMPILE_AHEAD', '1')
    monkeypatch.setattr(precompile, '_processes', {})
    # This process does not end with the test.
    monkeypatch.setattr(precompile, '_ending', threading.Event())
    monkeypatch.setattr(precompile, 'end_compiling', lambda: None)
    monkeypatch.setattr(
        precompile.subprocess, 'Popen', lambda arguments, **options: FakeProcess(found, arguments))
    return found


def test_kernels_with_contact_are_ready_after_the_task_of_the_other_process(begun, monkeypatch):
    simulation = ico.compile_scene(make_scene((2, 2, 2), CHANGES))
    monkeypatch.setattr(simulation._driver, 'is_ready', lambda: False)
    simulation.warm_up()
    process, = begun
    assert process.arguments[1:] == ['-m', 'icofabric_sim.simulation.precompile_process']
    task = pickle.loads(process.task)
    present, touching = task[0]
    assert present == simulation.scene.parameters.given()
    assert touching['contact.mode'] == 'always' and touching['solver.method'] == 'leapfrog'
    precompile_process._compile(task)
    fresh = ico.compile_scene(make_scene((2, 2, 2), CHANGES))
    assert fresh._driver.contact.phase.contacts is None
    assert fresh._driver.is_ready()
    fresh.warm_up()
    assert len(begun) == 1
    precompile._end()
    assert process.ended


def test_nothing_is_begun_where_it_is_not_wanted(begun, monkeypatch):
    for changes, forbidden in (
            ({'contact.mode': 'never'}, '1'), ({'contact.mode': 'always'}, '1'),
            ({'contact.mode': 'auto'}, '0')):
        monkeypatch.setenv('ICOFABRIC_COMPILE_AHEAD', forbidden)
        ico.compile_scene(make_scene((2, 2, 2), {**CHANGES, **changes})).warm_up()
    assert not begun
    monkeypatch.setenv('ICOFABRIC_COMPILE_AHEAD', '1')
    monkeypatch.setattr(precompile, 'MAX_BODY_COUNT', 1)
    simulation = ico.compile_scene(make_scene((2, 2, 2), CHANGES))
    monkeypatch.setattr(simulation._driver, 'is_ready', lambda: False)
    simulation.warm_up()
    assert not begun


def test_a_parameter_that_is_moved_compiles_once_and_other_kinds_replace_the_oldest(begun):
    def ask(**changes):
        scene = make_scene((2, 2, 2), {**CHANGES, **changes})
        precompile.compile_ahead(
            scene, method='leapfrog', present='leapfrog', rotation='quaternion')

    for stiffness in (100.0, 110.0, 120.0):
        ask(**{'connector.stiffness': stiffness})
    ask(**{'connector.stiffness': 100.0, 'gravity': [0.0, 0.0, -9.81]})
    ask(**{'connector.stiffness': 100.0, 'groups.top': 'z_max', 'supports.top.group': 'top'})
    assert len(begun) == 1
    ask(**{'connector.damping': 1e-3})
    assert len(begun) == 2 and not begun[0].ended
    ask(**{'drag.linear': 1e-3})
    assert len(begun) == 3 and [process.ended for process in begun] == [True, False, False]
    ask(**{'drag.linear': 2e-3})
    assert len(begun) == 3
    # One that has ended makes room, and may be asked for again.
    begun[1].poll = lambda: 0
    ask(**{'connector.damping': 2e-3})
    assert len(begun) == 4 and not begun[2].ended


def test_a_scene_is_compiled_elsewhere_at_normal_priority_unless_that_is_forbidden(
        begun, monkeypatch):
    monkeypatch.setattr(FakeProcess, 'wait', lambda self: setattr(self, 'waited', True))
    scene = make_scene((2, 2, 2), {**CHANGES, 'solver.rotation': 'direction_cosines'})
    compiled = compile_notice.seconds
    precompile.compile_elsewhere(scene)
    process, = begun
    [given], rotation, is_measured, niceness = pickle.loads(process.task)
    assert given == scene.parameters.given() and niceness == 0 and not is_measured
    assert rotation == 'direction_cosines' and process.waited
    assert not compile_notice.is_compiling and compile_notice.seconds >= compiled
    monkeypatch.setattr(precompile, 'MAX_BODY_COUNT', 1)
    precompile.compile_elsewhere(scene)
    monkeypatch.setattr(precompile, 'MAX_BODY_COUNT', 100)
    monkeypatch.setenv('ICOFABRIC_COMPILE_AHEAD', '0')
    precompile.compile_elsewhere(scene)
    assert len(begun) == 1


def test_the_other_process_measures_forces_instead_of_stepping(monkeypatch):
    """The kernels of measured forces are those that a rotation of the scene needs."""
    measured, reactions = [], ico.Simulation.reactions
    monkeypatch.setattr(
        ico.Simulation, 'reactions',
        lambda self: measured.append((self.rotation, self.time)) or reactions(self))
    scene = make_scene((2, 2, 2), CHANGES)
    for rotation in ('quaternion', 'direction_cosines'):
        precompile_process._compile(([scene.parameters.given()], rotation, True, 0))
    assert measured == [('quaternion', 0.0), ('direction_cosines', 0.0)]


def test_a_step_that_ends_at_an_input_is_among_the_kernels_of_a_run(monkeypatch):
    cuts, take = [], UniformStepping.take
    monkeypatch.setattr(
        UniformStepping, 'take', lambda self, *step: cuts.append(step) or take(self, *step))
    # The last body is driven: no wrench acts on it.
    simulation = ico.compile_scene(make_scene((2, 2, 2), {
        'solver.method': 'dop8', 'groups.last': 'z_max', 'drives.up.group': 'last',
        'drives.up.motion': 'velocity', 'drives.up.linear': [0.0, 0.0, 0.01]}))
    use_all_kernels(simulation)
    [(step, count)] = cuts
    assert count == 1 and 0.0 < step < simulation.status.step and 0.0 < simulation.time


def test_a_run_whose_method_changes_needs_the_other_one_with_and_without_contact():
    assert precompile.kinds_of_steps('dop8', present='srkn6', may_touch=False) == [{}]
    same = precompile.kinds_of_steps('dop8', present='dop8', may_touch=True)
    assert same == [{}, {'contact.mode': 'always', 'solver.method': 'dop8'}]
    other = precompile.kinds_of_steps('dop8', present='srkn6', may_touch=True)
    assert other == [*same, {'solver.method': 'dop8'}]
