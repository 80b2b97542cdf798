# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Diagnostics: the figures, and the level and sentence that follow from them.
"""

import icofabric_sim as ico
from icofabric_sim.health import describe, HealthReport
from icofabric_sim.messages import decode_diagnostic_array, ERROR, OK, WARN
from icofabric_sim.outputs import DIAGNOSTICS
from icofabric_sim.run_records import Errors
from icofabric_sim.runner import Runner
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
    assert (message.level, message.message) == (OK, 'finished')
    values = message.values
    assert values['method'] == simulation.method_name
    assert float(values['tolerance']) == 1e-6
    assert float(values['error per second']) == pytest.approx(simulation.error_rate, rel=5e-3)
    assert float(values['error estimate']) == pytest.approx(simulation.error_estimate, rel=5e-3)
    assert float(values['error estimate']) > 0.0
    balance = simulation.balance
    assert float(values['energy balance error']) == pytest.approx(
        balance.error / balance.scale, rel=5e-3)
    assert float(values['largest energy balance error']) == pytest.approx(
        balance.worst, rel=5e-3)
    assert float(values['stability margin']) > 1.0
    assert int(values['steps']) == simulation.step_count > 0


def test_errors_of_a_given_step_are_not_measured_while_it_runs(monkeypatch):
    """
    That would take a good part of the time of a small fabric, every second.
    """
    def never(self):
        raise AssertionError('measured')

    monkeypatch.setattr(ico.Simulation, 'error_rate', property(never))
    monkeypatch.setattr(ico.Simulation, 'error_estimate', property(never))
    sink = ListSink(DIAGNOSTICS)
    finished_runner(sink, solver__step=1e-4)
    _, [message] = decode_diagnostic_array(sink.of(DIAGNOSTICS)[-1][1])
    assert message.values['error per second'].startswith('not measured: solver.step')
    assert message.values['error estimate'].startswith('not measured: solver.step')
    assert float(message.values['step [s]']) == 1e-4


def test_status_says_what_is_known_at_once(status):
    """
    Before the first report, and from any thread: nothing is measured.
    """
    assert status.errors is None and status.balance_worst == 0.0
    assert status.method in ico.METHODS and status.tolerance == 1e-6
    values = describe(status._replace(errors=Errors(2e-7, 3e-8)), '/x', {}, {}).values
    assert (values['error per second'], values['error estimate']) == ('2e-07', '3e-08')


@pytest.mark.parametrize(('changes', 'faults', 'level', 'words'), [
    ({}, {}, OK, 'running'),
    ({'paused': True}, {}, OK, 'paused'),
    ({'factor': 0.5, 'wanted_factor': 1.0}, {}, WARN, 'slower than wanted'),
    ({'factor': 0.5, 'wanted_factor': 1.0, 'paused': True}, {}, OK, 'paused'),
    ({'proximity': 'bodies 1 and 2 meet'}, {}, WARN, 'bodies 1 and 2 meet'),
    ({'proximity': 'bodies 1 and 2 meet'}, {'recording': 'disk full'}, ERROR, 'disk full'),
    ({'failure': 'the energy does not balance'}, {'recording': 'disk full'}, ERROR, 'balance'),
])
def test_level_and_sentence(status, changes, faults, level, words):
    message = describe(status._replace(**changes), '/x', faults, {'mine': '7'})
    assert message.level == level and words in message.message
    assert message.values['mine'] == '7' and faults.items() <= message.values.items()
