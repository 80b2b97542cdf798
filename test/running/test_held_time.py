# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated time waits for kernels that are not ready; the node answers, and no bit changes."""

from concurrent.futures import ThreadPoolExecutor
import os
import threading
import time

import icofabric_sim as ico
from icofabric_sim.kernels.runtime.kernel_guard import _guard, guarded_alike, no_compiling
from icofabric_sim.messages import decode_clock, decode_diagnostic_array
from icofabric_sim.messages.schedule import seconds
from icofabric_sim.messages.topics import CLOCK, DIAGNOSTICS, POSES
from icofabric_sim.process.compile_notice import compile_notice, KernelsMissing
from icofabric_sim.running import runner as runner_module
from icofabric_sim.running import time_advance
from icofabric_sim.running.diagnostics import HealthReport
from icofabric_sim.running.runner import Runner
from icofabric_sim.simulation import simulation as simulation_module
from icofabric_sim.simulation.errors import KernelsAwaited
from icofabric_sim.simulation.precompile import ContactKernels
from icofabric_sim.simulation.stepping import driver as driver_module
from numba import njit
import pytest
from runner_helpers import Beside, ListSink, push

# It is some 8 cm above the floor at first.
SCENE = ico.load_scene('dropped_slab').with_changes({'duration': 0.2, 'real_time_factor': 0.0})
PUSH = (0.3, 0.0, 0.0)


@pytest.fixture(scope='module', autouse=True)
def _compiled():
    """Nothing has to be compiled while time is taken."""
    simulation = ico.compile_scene(SCENE)
    simulation.advance_to(0.15)
    assert simulation.status.has_contacts


class Kernels:
    """They are ready when the test says so."""

    def __init__(self, simulation):
        self._driver, self.are_ready, self.seconds = simulation._driver, False, 3.2
        self.hurried = 0
        simulation._driver.awaits_kernels = True

    def hurry(self):
        self.hurried += 1

    def finish(self):
        self._driver.awaits_kernels = False
        self.are_ready = True


@pytest.fixture
def held(monkeypatch):
    """Makes a live runner whose first contact finds no kernels."""
    monkeypatch.setattr(runner_module, '_IDLE_REFRESH', 0.05)
    monkeypatch.setattr(
        simulation_module.Simulation, 'prepare_contacts',
        lambda self, **_: setattr(self, 'contact_kernels', Kernels(self)))
    report = HealthReport('/icofabric')
    sink = ListSink(CLOCK, DIAGNOSTICS)
    return Runner(
        ico.compile_scene(SCENE), [sink], report=lambda status: report.bytes(status)), sink


def wait_until_held(beside):
    beside.wait_for(lambda: beside.runner.state.is_held)
    return beside.runner.simulation.contact_kernels


def final(runner, beside):
    beside.wait_for(lambda: runner.finished)
    return runner.post(runner.simulation.snapshot).result(60.0)


def test_it_goes_back_to_a_step_end_and_goes_on_with_the_same_bits():
    free, waiting = ico.compile_scene(SCENE), ico.compile_scene(SCENE)
    waiting._driver.awaits_kernels = True
    held_at = []
    for k in range(1, 31):
        free.advance_to(0.005 * k)
        while waiting.time < 0.005 * k:
            try:
                waiting.advance_to(0.005 * k)
            except KernelsAwaited:
                held_at.append(waiting.time)
                # It can be shown, and saved, as it stands.
                assert not waiting.status.has_contacts
                waiting.snapshot()
                waiting.restore(waiting.checkpoint())
                if len(held_at) == 3:
                    waiting._driver.awaits_kernels = False
        assert waiting.snapshot().position.tobytes() == free.snapshot().position.tobytes()
    # How many steps a call takes depends on the machine, so it may come nearer to the contact.
    assert len(held_at) == 3 and sorted(held_at) == held_at and 0.05 < held_at[0] < 0.15
    assert waiting.status.step_count == free.status.step_count


def test_an_input_that_ends_the_very_step_is_not_lost():
    free, waiting = ico.compile_scene(SCENE), ico.compile_scene(SCENE)
    for simulation in (free, waiting):
        # So many that all steps near the first contact end at one.
        for k in range(1, 301):
            simulation.apply_wrench('push', (0.001 * k, 0.0, 0.0), time=0.0005 * k)
    free.advance_to(0.15)
    assert free.status.has_contacts
    waiting._driver.awaits_kernels = True
    held = 0
    while waiting.time < 0.15:
        try:
            with no_compiling():
                waiting.advance_to(0.15)
        except KernelsAwaited:
            held += 1
            assert not waiting.status.has_contacts
            assert waiting._event_loop._cut_due == waiting.time
            waiting.snapshot()
            waiting.restore(waiting.checkpoint())
            waiting._driver.awaits_kernels = held < 3
    assert held == 3
    assert waiting.snapshot().position.tobytes() == free.snapshot().position.tobytes()


def test_requests_are_answered_while_simulated_time_waits(held, caplog):
    runner, sink = held
    caplog.set_level('INFO', 'icofabric_sim')
    direct = ico.compile_scene(SCENE)
    with Beside(runner) as beside:
        kernels = wait_until_held(beside)
        now = runner.now
        assert kernels.hurried == 1 and 50_000_000 < now < 150_000_000
        # Generous: another process may have the processor. The compiler takes a minute.
        assert runner.set_paused(True).result(5.0) == now
        assert runner.set_paused(False).result(5.0) == now
        assert runner.status().waits == 'compiling the kernels for contacts, for 3 s so far'
        push(runner, 'push', force=PUSH)
        advance = runner.advance()
        ticks, counted = len(sink.of(CLOCK)), compile_notice.seconds
        beside.wait_for(lambda: len(sink.of(CLOCK)) >= ticks + 3)
        assert {decode_clock(data) for _, data in sink.of(CLOCK)[ticks:]} == {now}
        beside.wait_for(lambda: any(
            'simulated time is waiting: compiling'
            in decode_diagnostic_array(data)[1][0].values['reasons']
            for _, data in sink.of(DIAGNOSTICS)))
        beside.wait_for(lambda: 'simulated time is waiting at t = ' in caplog.text)
        assert not advance.done() and runner.now == now
        # The wait is no part of the speed of a run.
        assert compile_notice.seconds > counted
        kernels.finish()
        assert advance.result(60.0) == now + 10_000_000
        assert 'simulated time has resumed' in caplog.text
        end = final(runner, beside)
        assert runner.status().waits == ''
    direct.advance_to(seconds(now))
    direct.apply_wrench('push', PUSH)
    direct.advance_to(0.2)
    assert end.position.tobytes() == direct.snapshot().position.tobytes()


def test_outputs_of_the_time_at_which_an_input_awaits_its_kernels_are_sent(held, monkeypatch):
    runner, sink = held
    sink.topics, sink.is_bag = (*sink.topics, POSES), True
    driver, free = runner.simulation._driver, threading.Event()
    cut = driver.stepping.cut

    def missing(time):
        if time > 0.0 and not free.is_set():
            raise KernelsMissing
        return cut(time)

    monkeypatch.setattr(driver.stepping, 'cut', missing)
    for module in (driver_module, time_advance):
        monkeypatch.setattr(module, 'is_compiler_free', free.is_set)
    push(runner, 'push', stamp=50_000_000, force=PUSH)
    with Beside(runner) as beside:
        kernels = wait_until_held(beside)
        assert runner.now == 50_000_000
        # Before the kernels are there: the state of that time needs none of them.
        beside.wait_for(lambda: 50_000_000 in dict(sink.of(POSES)))
        free.set()
        kernels.finish()
        final(runner, beside)
    assert [time for time, _ in sink.of(POSES)] == [round(k * 1e9 / 60) for k in range(13)]


def test_outputs_of_a_time_at_which_an_advance_is_broken_off_are_sent(held, monkeypatch):
    runner, sink = held
    sink.topics, sink.is_bag = (*sink.topics, POSES), True
    simulation, broken_off = runner.simulation, []
    advance_to = simulation.advance_to

    def interrupted(time):
        before = simulation.time
        advance_to(time)
        if before < time == 0.05 and not broken_off:
            broken_off.append(time)
            raise KernelsAwaited(False)

    monkeypatch.setattr(simulation, 'advance_to', interrupted)
    with Beside(runner) as beside:
        beside.wait_for(lambda: runner.now > 50_000_000)
        wait_until_held(beside).finish()
        final(runner, beside)
    assert broken_off and 50_000_000 in dict(sink.of(POSES))


def test_a_reset_ends_the_wait_and_steps_come_to_it_again(held):
    runner, _ = held
    with Beside(runner) as beside:
        kernels = wait_until_held(beside)
        runner.set_paused(True).result(5.0)
        runner.reset(time_reset=True).result(5.0)
        assert not runner.state.is_held and runner.now == 0
        runner.post(lambda: runner.state.parameters).result(5.0)
        steps = runner.take_steps()
        assert steps.result(60.0) > 0
        runner.set_paused(False).result(5.0)
        wait_until_held(beside)
        kernels.finish()
        assert final(runner, beside).time == 0.2


def test_a_guarded_thread_neither_compiles_nor_loads_and_others_do():
    fresh = njit(lambda x: x + 1)
    with no_compiling():
        with pytest.raises(KernelsMissing):
            fresh(1)
        with ThreadPoolExecutor(1) as pool:
            # The guarded one first: what is compiled once is there.
            with pytest.raises(KernelsMissing):
                pool.submit(guarded_alike(fresh, lambda: True), 1).result(60.0)
            assert pool.submit(fresh, 1).result(60.0) == 2
        assert fresh(2) == 3


def test_others_of_a_team_wait_for_a_kernel_that_its_first_thread_loads():
    """Else the first would wait for them in the kernel for ever."""
    loaded, failed = threading.Event(), threading.Event()

    def work():
        if not loaded.is_set():
            raise KernelsMissing
        return 'done'

    with no_compiling(loading=True), ThreadPoolExecutor(2) as pool:
        begun = pool.submit(guarded_alike(work, failed.is_set))
        with pytest.raises(TimeoutError):
            begun.result(0.05)
        loaded.set()
        assert begun.result(60.0) == 'done'
        loaded.clear()
        given_up = pool.submit(guarded_alike(work, failed.is_set))
        failed.set()
        with pytest.raises(KernelsMissing):
            given_up.result(60.0)


class Process:
    """A helper that ends when it is told to."""

    def __init__(self, returncode=0):
        self.ended, self.pid, self.returncode = threading.Event(), 2**22 + 1, returncode

    def wait(self):
        self.ended.wait(30.0)

    def poll(self):
        return 0 if self.ended.is_set() else None


def test_kernels_are_loaded_once_the_process_that_compiles_them_has_ended():
    process, loaded = Process(), []
    kernels = ContactKernels(
        process, pytest.fail, lambda: loaded.append(process.ended.is_set()))
    kernels.hurry()  # no such process: nothing happens
    assert not kernels.are_ready and not loaded
    process.ended.set()
    kernels.wait()
    assert kernels.are_ready and loaded == [True] and 0.0 < kernels.seconds < 60.0


def test_a_process_that_was_ended_for_another_is_begun_again():
    ended, second, made, told = Process(-9), Process(), [], []

    def load():
        made.append(len(made))
        if len(made) == 1:
            raise KernelsMissing

    kernels = ContactKernels(ended, lambda: second, load, lambda: told.append(len(made)))
    ended.ended.set()
    deadline = time.monotonic() + 60.0
    while not made:
        assert time.monotonic() < deadline
        time.sleep(0.001)
    time.sleep(0.02)
    assert len(made) == 1 and not told
    second.ended.set()
    kernels.wait()
    assert len(made) == 2 and told == [2]


def test_what_another_process_leaves_out_is_compiled_here_and_nothing_for_a_run_that_is_over():
    process, made = Process(), []

    def load():
        made.append(bool(_guard.forbids))
        if _guard.forbids:
            raise KernelsMissing

    process.ended.set()
    ContactKernels(process, pytest.fail, load).wait()
    assert made == [True, False]
    process, told = Process(), []
    kernels = ContactKernels(process, pytest.fail, pytest.fail, lambda: told.append(True))
    kernels.give_up()
    process.ended.set()
    kernels.wait()
    assert told == [True]


def test_what_the_first_contact_needs_is_loaded_ahead():
    simulation = ico.compile_scene(SCENE)
    simulation.warm_up()
    kernels = simulation.prepare_contacts()
    assert simulation.prepare_contacts() is kernels
    assert simulation._driver.awaits_kernels or kernels.are_ready
    kernels.wait()
    assert not simulation._driver.awaits_kernels
    deadline = time.monotonic() + 60.0
    while simulation.time < 0.15:
        assert time.monotonic() < deadline
        with no_compiling():
            simulation.advance_to(simulation.time + 0.005)
    assert simulation.status.has_contacts


def test_nothing_is_awaited_without_contacts_or_beside_a_function_of_the_user():
    with_force = ico.compile_scene(SCENE)
    with_force.body_force = 'a function'
    touching = ico.compile_scene(SCENE.with_changes({'contact.mode': 'always'}))
    alone = ico.compile_scene(SCENE)
    # Where no other process may compile, nothing is compiled before it is needed.
    alone._lacks_kernels = True
    assert os.environ['ICOFABRIC_COMPILE_AHEAD'] == '0' and alone.prepare_contacts() is None
    assert not alone._driver.awaits_kernels
    for simulation, load in ((with_force, True), (touching, True), (touching, False)):
        kernels = simulation.prepare_contacts(load=load)
        assert (kernels is None) == (simulation is with_force)
        assert not simulation._driver.awaits_kernels


def test_a_kernel_that_takes_a_moment_is_waited_for_only_while_another_thread_compiles(
        held, monkeypatch):
    runner, _ = held
    driver, taken = runner.simulation._driver, []
    run, free = driver.stepping.run, threading.Event()

    def missing_once(time, count):
        if not taken:
            taken.append(count)
            raise KernelsMissing
        run(time, count)

    monkeypatch.setattr(driver.stepping, 'run', missing_once)
    for module in (driver_module, time_advance):
        monkeypatch.setattr(module, 'is_compiler_free', free.is_set)
    with Beside(runner) as beside:
        beside.wait_for(lambda: runner.state.is_held)
        assert runner.now < 10_000_000
        assert runner.status().waits == 'compiling kernels, for 3 s so far'
        free.set()
        kernels = beside.runner.simulation.contact_kernels
        beside.wait_for(lambda: runner.now > 10_000_000)
        kernels.finish()
        final(runner, beside)
    # Where no other thread compiles it is compiled in place, and nothing waits.
    waiting = ico.compile_scene(SCENE)
    waiting._driver.awaits_kernels = True
    run, taken[:] = waiting._driver.stepping.run, []
    monkeypatch.setattr(waiting._driver.stepping, 'run', missing_once)
    waiting.advance_to(0.001)
    assert taken and waiting.time == 0.001


def test_a_second_try_does_not_compile_what_a_contact_needs(monkeypatch):
    """It goes farther than the first one did, and may come to the first contact."""
    free, waiting = ico.compile_scene(SCENE), ico.compile_scene(SCENE)
    driver, tries = waiting._driver, []
    driver.awaits_kernels = True
    run = driver.stepping.run

    def missing_first(time, count):
        tries.append(driver.contact.phase.contacts is not None)
        if len(tries) % 2:
            raise KernelsMissing
        run(time, count)

    monkeypatch.setattr(driver.stepping, 'run', missing_first)
    monkeypatch.setattr(driver_module, 'is_compiler_free', lambda: True)
    with pytest.raises(KernelsAwaited) as awaited:
        waiting.advance_to(0.15)
    assert awaited.value.is_for_contacts and len(tries) % 2 == 0 and not any(tries)
    assert not waiting.status.has_contacts and 0.05 < waiting.time < 0.15
    driver.awaits_kernels = False
    monkeypatch.setattr(driver.stepping, 'run', run)
    for simulation in (free, waiting):
        simulation.advance_to(0.15)
    assert waiting.snapshot().position.tobytes() == free.snapshot().position.tobytes()


@pytest.mark.parametrize('failing', [1, 2])
def test_steps_that_fail_while_kernels_are_awaited_leave_the_state_as_it_was(monkeypatch, failing):
    free, waiting = ico.compile_scene(SCENE), ico.compile_scene(SCENE)
    for simulation in (free, waiting):
        simulation.advance_to(0.02)
    driver, tries = waiting._driver, []
    driver.awaits_kernels = True
    run = driver.stepping.run

    def broken(time, count):
        tries.append(count)
        run(time, count)
        if len(tries) < failing:
            raise KernelsMissing
        raise MemoryError('no room for a kernel')

    monkeypatch.setattr(driver.stepping, 'run', broken)
    monkeypatch.setattr(driver_module, 'is_compiler_free', lambda: True)
    before = driver.state_tree()
    with pytest.raises(MemoryError):
        waiting.advance_to(0.03)
    assert len(tries) == failing and waiting.time == 0.02
    assert repr(driver.state_tree()) == repr(before)
    monkeypatch.setattr(driver.stepping, 'run', run)
    for simulation in (free, waiting):
        simulation.advance_to(0.03)
    assert waiting.snapshot().position.tobytes() == free.snapshot().position.tobytes()
