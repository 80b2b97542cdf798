# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Changes of a running scene: how builds follow each other, and which wrenches end."""
from queue import SimpleQueue
import time

import icofabric_sim as ico
from icofabric_sim.kernels.runtime.kernel_guard import _guard
from icofabric_sim.process.compile_notice import KernelsMissing
from icofabric_sim.running import reweave
from icofabric_sim.running.parameter_change import ParameterChange
from icofabric_sim.running.real_time_factor import RealTimeFactor
from icofabric_sim.running.reweave import lost_wrenches, Reweaver, SwapPostponed
import pytest

BASE = ico.Scene.from_parameters({
    'weave': {'size': [2, 2, 2]}, 'groups': {'tip': 'x_max'},
    'loads': {'tip': {'group': 'tip'}}}).parameters


class Runner:
    """Stands for the runner: takes what is posted on demand, and keeps results."""

    def __init__(self, *, has_time=True):
        self.posted, self.results = SimpleQueue(), []
        self.reweaver = Reweaver(
            self.posted.put, lambda *result: self.results.append(result[:3]),
            has_time=lambda: has_time)

    def run_one(self):
        self.posted.get(timeout=60.0)()

    def is_idle(self):
        return self.posted.empty()


@pytest.fixture
def builds(monkeypatch):
    """Scenes that were built, by the density of their shells."""
    found = []
    compile_scene = reweave.compile_scene

    def compile_and_note(scene, **options):
        found.append(scene.parameters['shell.density'])
        return compile_scene(scene, **options)

    monkeypatch.setattr(reweave, 'compile_scene', compile_and_note)
    return found


def with_density(density):
    return BASE.with_changes({'shell.density': density})


def change_to(parameters):
    return ParameterChange(BASE, parameters)


def want_all(reweaver, *wanted):
    changes = [change_to(parameters) for parameters in wanted]
    for change in changes:
        reweaver.want(change)
    return changes


def outcomes(changes):
    """Return the futures, which identify changes."""
    return [change.outcome for change in changes]


def test_result_is_a_simulation_of_the_wanted_scene():
    runner = Runner()
    wanted = BASE.with_changes({'weave.size': [3, 3, 3]})
    runner.reweaver.want(change_to(wanted))
    assert runner.results == []
    runner.run_one()
    [(parameters, simulation, reason)] = runner.results
    assert parameters is wanted and reason == ''
    assert simulation.scene.parameters is wanted
    assert simulation.time == 0.0 and simulation.status.step_count == 0


def test_failure_is_a_reason():
    runner = Runner()
    runner.reweaver.want(change_to(BASE.with_changes({'solver.step': 1.0})))
    runner.run_one()
    [(_, simulation, reason)] = runner.results
    assert simulation is None and 'solver.step' in reason
    # The next change has its turn.
    runner.reweaver.want(change_to(with_density(2.0)))
    runner.run_one()
    assert runner.results[1][1].scene.parameters['shell.density'] == 2.0


def test_any_error_while_building_is_a_reason(monkeypatch):
    def fail(parameters):
        raise MemoryError

    monkeypatch.setattr(reweave.Scene, 'from_parameters', fail)
    runner = Runner()
    runner.reweaver.want(change_to(BASE))
    runner.run_one()
    assert runner.results[0][1:] == (None, 'MemoryError')


def test_changes_during_a_build_become_one_more(builds):
    runner = Runner()
    for density in (2.0, 3.0, 4.0, 5.0):
        runner.reweaver.want(change_to(with_density(density)))
    runner.run_one()
    assert runner.results == []  # superseded while it was built
    runner.run_one()
    assert [result[0]['shell.density'] for result in runner.results] == [5.0]
    assert builds == [2.0, 5.0]
    assert runner.is_idle()


def test_a_change_that_cannot_be_built_takes_no_other_with_it(builds):
    # One is built, another and a wrong one come meanwhile, and rates.
    answers, posted = [], SimpleQueue()
    reweaver = Reweaver(posted.put, lambda *answer: answers.append(answer))
    good = with_density(2.0)
    better = with_density(3.0)
    wrong = better.with_changes({'solver.step': 1.0})
    changes = want_all(reweaver, good, better, wrong)
    reweaver.amend(wrong.with_changes({'publish_rate': 7.0}))
    while reweaver.wanted is not None:
        posted.get(timeout=60.0)()
    assert builds == [2.0, 3.0, 3.0]
    (wanted, simulation, reason, first), (refused, none, why, last) = answers
    assert wanted['shell.density'] == simulation.scene.parameters['shell.density'] == 3.0
    assert wanted['publish_rate'] == 7.0 and wanted['solver.step'] == 0.0
    assert reason == '' and outcomes(first) == outcomes(changes[:2])
    assert refused['solver.step'] == 1.0 and none is None
    assert outcomes(last) == outcomes(changes[2:])
    assert 'solver.step' in why
    # What was built first is there where all that came later is wrong.
    answers.clear()
    changes = want_all(reweaver, good, wrong)
    while reweaver.wanted is not None:
        posted.get(timeout=60.0)()
    assert [
        (answer[0]['shell.density'], answer[2] == '', outcomes(answer[3])) for answer in answers
    ] == [(2.0, True, outcomes(changes[:1])), (3.0, False, outcomes(changes[1:]))]
    # One that mends the wrong one is built.
    answers.clear()
    changes = want_all(reweaver, wrong, with_density(4.0))
    while reweaver.wanted is not None:
        posted.get(timeout=60.0)()
    (wanted, simulation, reason, answered), = answers
    assert simulation.scene.parameters['shell.density'] == 4.0
    assert outcomes(answered) == outcomes(changes)


def test_rates_reach_a_build_under_way(builds):
    runner = Runner()
    runner.reweaver.want(change_to(with_density(2.0)))
    runner.reweaver.amend(with_density(2.0).with_changes({'publish_rate': 7.0}))
    # No second build: the fabric is the same.
    runner.run_one()
    assert [result[0]['publish_rate'] for result in runner.results] == [7.0]
    assert len(builds) == 1 and runner.is_idle() and runner.reweaver.wanted is None


def test_wrenches_without_a_place_are_named():
    simulation = ico.compile_scene(ico.Scene.from_parameters(BASE))
    last = simulation.scene.body_count - 1
    simulation.apply_wrench('tip', (0.0, 0.0, 1.0))
    for body in (0, last):
        simulation.apply_body_wrench(body, (0.0, 0.0, 1.0))
    smaller = ico.Scene.from_parameters(BASE.with_changes({'weave.size': [2, 2, 1]}))
    assert lost_wrenches(simulation, smaller) == [f'body {last}']
    assert lost_wrenches(simulation, simulation.scene) == []
    given = {name: value for name, value in BASE.given().items() if not name.startswith('loads')}
    assert lost_wrenches(simulation, ico.Scene.from_parameters(given)) == ['loads.tip']


def test_amending_nothing_builds_nothing(builds):
    runner = Runner()
    runner.reweaver.amend(with_density(2.0))
    assert builds == [] and runner.is_idle()


def test_kernels_that_are_missing_are_compiled_by_another_process(monkeypatch):
    """The thread that builds neither compiles them nor keeps the run from loading others."""
    asked, compile_scene = [], reweave.compile_scene

    def missing_at_first(scene, **options):
        if not asked:
            raise KernelsMissing
        return compile_scene(scene, **options)

    monkeypatch.setattr(reweave, 'compile_scene', missing_at_first)
    monkeypatch.setattr(
        reweave, 'compile_elsewhere', lambda scene, **_: asked.append(scene))
    runner = Runner()
    runner.reweaver.want(change_to(with_density(900.0)))
    runner.run_one()
    [(wanted, simulation, reason)] = runner.results
    assert reason == '' and simulation.scene.parameters['shell.density'] == 900.0
    [scene] = asked
    assert scene.parameters == wanted


class Kernels:
    """Kernels for contacts; counts how often they were waited for."""

    waits = 0

    def wait(self):
        Kernels.waits += 1


@pytest.fixture
def contact_kernels(monkeypatch):
    """Whether kernels were loaded, for each simulation whose contacts were prepared."""
    loads = []
    monkeypatch.setattr(Kernels, 'waits', 0)
    monkeypatch.setattr(
        reweave.Simulation, 'prepare_contacts',
        lambda self, *, load: loads.append(load) or Kernels())
    return loads


def test_a_postponed_swap_is_tried_again_with_another_simulation(builds, contact_kernels):
    answers, posted, simulations = [], SimpleQueue(), []

    def swap(wanted, simulation, reason, answered):
        if simulation is not None:
            simulations.append(simulation)
        if len(simulations) == 1:
            raise SwapPostponed
        answers.append((wanted['shell.density'], reason, outcomes(answered)))

    reweaver = Reweaver(posted.put, swap)
    good, wrong = with_density(2.0), with_density(2.0).with_changes({'solver.step': 1.0})
    changes = want_all(reweaver, good, wrong)
    while reweaver.wanted is not None:
        posted.get(timeout=60.0)()
    # The refused change is refused only once the other one is in force.
    assert answers[0] == (2.0, '', outcomes(changes[:1]))
    _, reason, answered = answers[1]
    assert 'solver.step' in reason and answered == outcomes(changes[1:]) and len(answers) == 2
    assert simulations[0] is not simulations[1] and builds == [2.0, 2.0, 2.0]
    assert contact_kernels == [False, True] and Kernels.waits == 1


def test_a_swap_is_postponed_a_few_times_and_then_compiles(contact_kernels):
    posted, tries = SimpleQueue(), []

    def swap(wanted, simulation, reason, answered):
        with reweaver.postponing():
            tries.append(bool(_guard.forbids))
            if _guard.forbids:
                raise KernelsMissing

    reweaver = Reweaver(posted.put, swap)
    for number in (1, 2):
        reweaver.want(change_to(with_density(2.0 + number)))
        while reweaver.wanted is not None:
            posted.get(timeout=60.0)()
        # Each change starts its own count.
        assert tries == number * [True, True, False]


@pytest.mark.parametrize('has_touched', [False, True])
def test_a_swap_waits_for_contacts_where_shells_have_been_near(contact_kernels, has_touched):
    posted, answers = SimpleQueue(), []
    reweaver = Reweaver(
        posted.put, lambda *answer: answers.append(answer), has_touched=lambda: has_touched)
    reweaver.want(change_to(with_density(2.0)))
    posted.get(timeout=60.0)()
    assert len(answers) == 1 and contact_kernels == [False] and Kernels.waits == has_touched


@pytest.mark.parametrize('mode', ['never', 'auto'])
def test_forces_are_measured_before_the_swap_while_they_have_receivers(
        monkeypatch, contact_kernels, mode):
    measured, asked, posted = [], [], SimpleQueue()

    def measure(scene):
        measured.append(scene.parameters['contact.mode'])
        if len(measured) == 1:
            raise KernelsMissing

    monkeypatch.setattr(reweave, 'measure_forces', measure)
    monkeypatch.setattr(
        reweave, 'compile_elsewhere', lambda scene, **options: asked.append(options))
    is_measured = True
    reweaver = Reweaver(
        posted.put, lambda *answer: None, has_touched=lambda: True,
        is_measured=lambda: is_measured)
    reweaver.want(change_to(BASE.with_changes({'contact.mode': mode})))
    posted.get(timeout=60.0)()
    assert measured == 2 * ['never' if mode == 'never' else 'always']
    assert asked == [{'is_measured': True}]
    is_measured = False
    reweaver.want(change_to(with_density(2.0)))
    posted.get(timeout=60.0)()
    assert len(measured) == 2


def test_many_changes_a_second_become_few_builds(builds):
    """A slider does not take the processor from the run; its last value comes into force."""
    runner = Runner()
    runner.reweaver.want(change_to(with_density(1000.0)))
    runner.run_one()
    for k in range(1, 31):
        runner.reweaver.want(change_to(with_density(1000.0 + k)))
        if not runner.is_idle():
            runner.run_one()
        time.sleep(0.002)
    while runner.reweaver.wanted is not None:
        runner.run_one()
    assert len(builds) < 12
    assert runner.results[-1][1].scene.parameters['shell.density'] == 1030.0


def test_a_run_that_has_no_time_is_changed_less_often(monkeypatch):
    free_at = {}
    monkeypatch.setattr(reweave, '_PAUSE', (1e6, 1.0))
    monkeypatch.setattr(reweave, '_BUSY_PAUSE', (1e6, 100.0))
    for has_time in (True, False):
        runner, now = Runner(has_time=has_time), time.monotonic()
        runner.reweaver.want(change_to(with_density(1000.0)))
        runner.run_one()
        free_at[has_time] = runner.reweaver._free_at - now
    assert 1.0 <= free_at[True] < 60.0 < 100.0 <= free_at[False]
    # A run that reaches its target factor waits; one without a target never does.
    for factor, has_time in ((1.0, True), (0.0, False)):
        real_time, simulated = RealTimeFactor(factor), 0
        real_time.restart(0)
        until = time.monotonic() + 0.3
        while time.monotonic() < until:
            simulated += 10_000_000
            time.sleep(real_time.wait_time(simulated))
            time.sleep(0.001)
        assert real_time.has_spare_time() == has_time
