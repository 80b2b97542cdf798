# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Diagnostics: the figures, and the level and sentence that follow from them."""

import icofabric_sim as ico
from icofabric_sim.messages import decode_diagnostic_array, ERROR, OK, WARN
from icofabric_sim.messages.topics import DIAGNOSTICS
from icofabric_sim.running import real_time_factor
from icofabric_sim.running.diagnostics import (
    describe,
    describe_start,
    headline,
    HealthReport,
    NOT_TAKEN,
    RECORDER_DROPPED,
    RECORDER_LAG,
    WRENCHES_DROPPED,
)
from icofabric_sim.running.real_time_factor import RealTimeFactor
from icofabric_sim.running.run_records import Errors
from icofabric_sim.running.runner import Runner
import pytest
from runner_helpers import ListSink, make_runner, SCENE


def finished_runner(sink, **changes):
    dotted = {name.replace('__', '.'): value for name, value in changes.items()}
    scene = ico.Scene.from_parameters(SCENE)
    scene = ico.Scene.from_parameters(scene.parameters.with_changes(
        {'initial_random.velocity_sigma': 0.1, **dotted}))
    runner = Runner(
        ico.compile_scene(scene), [sink], report=HealthReport('/lab/fabric').bytes)
    runner.run(until_finished=True)
    return runner


@pytest.fixture
def status():
    return make_runner().status()


def test_figures_are_those_of_the_simulation():
    sink = ListSink(DIAGNOSTICS)
    runner = finished_runner(sink)
    simulation = runner.simulation
    nanoseconds, [message] = decode_diagnostic_array(sink.of(DIAGNOSTICS)[-1][1])
    assert nanoseconds == runner.now and message.name == '/lab/fabric'
    # Floppy as it is, some of its connectors end in shells.
    assert simulation.status.obstructed_ends > 0
    assert message.level == WARN and message.message == (
        f'{simulation.status.obstructed_ends} connector ends were in their own shells at the '
        'last health check')
    values = message.values
    assert values['method'] == simulation.status.method_name
    assert float(values['tolerance']) == 1e-6
    assert float(values['error per second']) == pytest.approx(
        simulation.status.error_rate, rel=5e-3)
    assert float(values['error estimate']) == pytest.approx(simulation.error_estimate, rel=5e-3)
    assert float(values['error estimate']) > 0.0
    balance = simulation.balance
    assert float(values['energy balance error']) == pytest.approx(
        balance.error / balance.scale, rel=5e-3)
    assert float(values['largest energy balance error']) == pytest.approx(
        balance.worst, rel=5e-3)
    assert float(values['stability margin']) > 1.0
    assert int(values['steps']) == simulation.status.step_count > 0
    assert int(values['evaluations of the forces']) == simulation.status.evaluation_count > 0
    assert 0 <= int(values['evaluations beside the trajectory']) <= (
        simulation.status.estimation_count)


def test_errors_of_a_given_step_are_said_too():
    sink = ListSink(DIAGNOSTICS)
    runner = finished_runner(sink, solver__step=1e-4)
    _, [message] = decode_diagnostic_array(sink.of(DIAGNOSTICS)[-1][1])
    estimate = runner.simulation.error_estimate
    assert float(message.values['error estimate']) == pytest.approx(estimate, rel=5e-3)
    assert float(message.values['error per second']) > 0.0 < estimate


def test_errors_that_are_not_estimated_are_said_to_be_so():
    sink = ListSink(DIAGNOSTICS)
    finished_runner(sink, solver__error_estimate=False)
    _, [message] = decode_diagnostic_array(sink.of(DIAGNOSTICS)[-1][1])
    assert message.values['error estimate'] == 'not estimated'
    assert message.values['error per second'] == 'not estimated'
    assert 'solver.error_estimate' in message.values['error estimate lacks']


def test_status_says_what_is_known_at_once(status):
    """Before the first report, and from any thread: nothing is measured."""
    assert status.errors is None and status.balance_worst == 0.0
    assert status.method in ico.METHODS and status.tolerance == 1e-6
    values = describe(status._replace(errors=Errors(2e-7, 3e-8)), '/x', {}, {}).values
    assert (values['error per second'], values['error estimate']) == ('2e-07', '3e-08')


@pytest.mark.parametrize(('changes', 'faults', 'level', 'words'), [
    ({}, {}, OK, 'running'),
    ({'paused': True}, {}, OK, 'paused'),
    ({'obstructed': 3}, {}, WARN, '3 connector ends were in their own shells'),
    ({'factor': 0.5, 'target_factor': 1.0}, {}, WARN, 'below the target real-time factor'),
    ({'factor': 0.5, 'target_factor': 0.0}, {}, OK, 'running'),
    ({'factor': 0.5, 'target_factor': 1.0, 'cause': 'the steps take it all'}, {}, WARN,
     'steps take it all'),
    ({'factor': 0.5, 'target_factor': 1.0, 'limited_by': 'accuracy (solver.tolerance 1e-06); '
      'fastest: contacts (contact.stiffness 4e+05 N/m), up to 1e+04 rad/s'}, {}, WARN,
     'remedies: a larger solver.tolerance, softer contact (a smaller contact.stiffness), '
     'fewer bodies (weave.size), a smaller real_time_factor'),
    ({'factor': 0.5, 'target_factor': 1.0, 'waits': 'compiling kernels'}, {}, WARN,
     'simulated time is waiting: compiling kernels'),
    ({'balance_error': 0.0051, 'energy_limit': 0.01}, {}, WARN, 'solver.energy_limit = 0.01'),
    ({'balance_error': 0.0049, 'energy_limit': 0.01}, {}, OK, 'running'),
    ({'step': 0.002, 'limit': 0.001}, {}, WARN, 'beyond the stability limit 0.001 s'),
    ({'finished': True, 'factor': 0.5, 'target_factor': 1.0}, {}, OK, 'finished'),
    ({}, {'rejected change': 'the last change could not be built: x'}, ERROR, 'not be built'),
    ({'factor': 0.5, 'target_factor': 1.0, 'paused': True}, {}, OK, 'paused'),
    ({'proximity': 'bodies 1 and 2 meet'}, {}, WARN, 'bodies 1 and 2 meet'),
    ({'proximity': 'bodies 1 and 2 meet'}, {'recording': 'disk full'}, ERROR, 'disk full'),
    ({'failure': 'the energy does not balance'}, {'recording': 'disk full'}, ERROR, 'balance'),
])
def test_level_and_sentence(status, changes, faults, level, words):
    message = describe(status._replace(**changes), '/x', faults, {'mine': '7'})
    assert message.level == level and len(message.message) <= 80
    assert words in (message.message if level == OK else message.values['reasons'])
    assert message.values['mine'] == '7' and faults.items() <= message.values.items()


def test_all_reasons_are_said(status):
    """The worst level, and everything of that level."""
    bad = status._replace(proximity='bodies 1 and 2 meet', balance_error=1.0, energy_limit=0.1)
    message = describe(bad, '/x', {}, {}, notes={'clock': '/clock is published twice'})
    assert message.level == WARN
    for words in ('bodies 1 and 2', 'energy balance', '/clock is published twice'):
        assert words in message.values['reasons']
    assert message.message == (
        'bodies 1 and 2 meet; the energy balance error is 1; /clock is published twice')
    assert message.values['clock'] == '/clock is published twice'
    message = describe(
        bad._replace(failure='it stopped'), '/x', {'recording': 'disk full'}, {})
    assert message.level == ERROR and message.message == 'it stopped; disk full'


@pytest.mark.parametrize(('sentences', 'expected'), [
    (['running'], 'running'),
    (['below the target (0.5 of 1): all of it; steps are short' + 60 * '.'],
     'below the target (0.5 of 1)'),
    (['one: ' + 80 * 'x', 'two; ' + 80 * 'y'], 'one; two'),
    ([60 * 'x', 'y' * 30], 60 * 'x' + ' (and 1 more)'),
    ([700 * 'x'], 76 * 'x' + ' ...'),
    (3 * [700 * 'x'], 63 * 'x' + ' ... (and 2 more)')])
def test_messages_have_at_most_80_characters(sentences, expected):
    assert headline(sentences) == expected and len(expected) <= 80


def test_a_report_is_made_without_listeners():
    """The node keeps its figures for a run that hangs, and for who listens then."""
    made = []
    runner = Runner(ico.compile_scene(ico.Scene.from_parameters(SCENE)), [ListSink()],
                    report=lambda status: made.append(status) or b'')
    runner.run(until_finished=True)
    assert made[0].time == 0 and made[-1].finished


def test_start_of_a_node():
    assert describe_start('/x', 0.0)[:3] == (OK, '/x', 'starting')
    status = describe_start('/x', 12.3)
    assert status.level == WARN and len(status.message) <= 80
    assert status.message.endswith('for 12 s so far') and status.values['compiling'] == (
        'for 12 s so far')


@pytest.mark.parametrize(('figure', 'words'), [
    (WRENCHES_DROPPED, 'wrenches were dropped'), (RECORDER_DROPPED, 'were not recorded'),
    (NOT_TAKEN, 'before all subscribers received them')])
def test_what_was_dropped_since_the_last_report(status, figure, words):
    report = HealthReport('/x')

    def told(count):
        _, [message] = decode_diagnostic_array(report.bytes(status, {}, {figure: str(count)}))
        assert message.values[figure] == str(count)
        return message.level, message.message

    assert told(0) == (OK, 'running')
    level, sentence = told(7)
    assert level == WARN and sentence.startswith('7 ') and words in sentence
    assert told(7) == (OK, 'running')
    assert told(9)[1].startswith('2 ')


def test_recorder_that_lags(status):
    assert describe(status, '/x', {}, {RECORDER_LAG: '0.900'}).level == OK
    message = describe(status, '/x', {}, {RECORDER_LAG: '2.300'})
    assert message.level == WARN and 'lags by 2.3 s' in message.message


def test_everything_that_a_user_wants_to_watch(status):
    values = describe(status, '/x', {}, {}).values
    assert {
        'real-time factor', 'target real-time factor', 'use of wall time', 'step [s]',
        'method',
        'stability margin', 'error per second', 'error estimate', 'energy balance error',
        'contacts', 'breaks', 'loads active', 'loads waiting', 'queue lag [s]', 'steps',
    } <= values.keys()
    assert values['contacts'] == values['breaks'] == values['loads waiting'] == '0'


# The real-time factor.


@pytest.fixture
def clock(monkeypatch):
    """Wall time and processor time that a test sets: clock[0], clock[1]."""
    now = [100.0, 0.0]
    monkeypatch.setattr(real_time_factor.wall, 'monotonic', lambda: now[0])
    monkeypatch.setattr(real_time_factor.wall, 'thread_time', lambda: now[1])
    return now


def spend(clock, kept, *, steps, rest, waits=0.0, share=1.0, turns=40):
    """Turns of a runner: steps are computed, messages sent, and time is waited for."""
    now = 0
    for _ in range(turns):
        kept.wait_time(now)
        clock[0] += steps
        now += 10_000_000
        kept.record_steps(10_000_000, steps)
        clock[0] += rest
        clock[1] += share * (steps + rest)
        if waits:
            assert kept.wait_time(now) > 0.0
            clock[0] += waits
    kept.wait_time(now)
    return kept.measure(now), kept.describe_time_use()


def test_cause_of_a_slow_run_is_the_steps(clock):
    factor, cause = spend(clock, RealTimeFactor(1.0), steps=0.018, rest=0.002)
    assert factor == pytest.approx(0.5, rel=0.05)
    assert cause.startswith('90% of the time is spent in steps, 10% in messages')
    assert 'shared' not in cause


def test_cause_of_a_slow_run_is_the_rest(clock):
    _, cause = spend(clock, RealTimeFactor(1.0), steps=0.005, rest=0.015)
    assert cause.startswith('25% of the time is spent in steps, 75% in messages')


def test_cause_of_a_slow_run_is_the_machine(clock):
    _, cause = spend(clock, RealTimeFactor(1.0), steps=0.018, rest=0.002, share=0.5)
    assert 'the processor is shared: this thread got 50% of a core' in cause


def test_time_that_is_waited_for_counts_for_nothing(clock):
    """Steps that take a tenth of the time that they simulate."""
    factor, cause = spend(clock, RealTimeFactor(1.0), steps=0.001, rest=0.0, waits=0.009)
    assert factor == pytest.approx(1.0, rel=0.02)
    assert cause.startswith('10% of the time is spent in steps, 0% in messages')
    assert 'shared' not in cause
