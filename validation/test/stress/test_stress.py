# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The generator, the judge and its classes, and scenes that are run within the suite."""

import csv
from dataclasses import replace
import json
import math
import os
from pathlib import Path
import time
from types import SimpleNamespace

import icofabric_sim as ico
from icofabric_sim.commands.main import main
from icofabric_sim.kernels.integrators.splitting import splitting
from icofabric_sim.kernels.integrators.sweep import Splitting
from icofabric_sim.parameters.text import flatten_parameters
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.errors import Interrupted, SimulationError
from icofabric_sim.simulation.reports.divergence import Growth
from icofabric_sim.simulation.reports.status import SimulationStatus
from icofabric_sim.simulation.simulation import compile_scene, Simulation
from icofabric_sim.simulation.stepping import thread_team
from icofabric_sim.simulation.stepping.methods import IMPLICIT, METHODS
from icofabric_sim.simulation.stepping.scene_kernel import SceneKernel
from icofabric_validation.stress import judge as judge_module
from icofabric_validation.stress import refusals, report, windows, workers
from icofabric_validation.stress import shrink as shrink_module
from icofabric_validation.stress.judge import judge
from icofabric_validation.stress.kinds import Kind, KINDS, MAX_KINDS, TERMS
from icofabric_validation.stress.refusals import (
    did_charges_pass,
    did_length_jump,
    first_parameter,
    is_right_refusal,
    stop_time,
)
from icofabric_validation.stress.scenes import draw_scene, kind_of, seeds_of, StressScene
from icofabric_validation.stress.shrink import shrink
from icofabric_validation.stress.verdict import Finding, Verdict
from icofabric_validation.stress.windows import AddedError, compile_reference, Windows
from icofabric_validation.stress.workers import judge_all, judge_scenes
import numpy as np
import pytest
from state_machines import FACTOR
import yaml

# Free fabrics and dop8, which other tests compile, too.
PLAIN = StressScene(0, KINDS.index(Kind('dop8')), {
    'weave.size': [2, 2, 2], 'contact.mode': 'never', 'solver.method': 'dop8',
    'solver.threads': 1, 'solver.tolerance': 1e-4, 'initial_random.velocity_sigma': 0.05,
    'initial_random.spin_sigma': 5.0, 'initial_random.seed': 1, 'duration': 0.02}, {})


def stored_scene(name):
    """A scene of an earlier generator, in which the judge or the program had a fault."""
    path = Path(__file__).parent / 'scenes' / f'{name}.json'
    stored = json.loads(path.read_text())
    return StressScene(0, **stored | {'spoiled_with': tuple(stored['spoiled_with'])})


def with_values(**changes):
    """The plain scene with other values; names with __ for dots."""
    return replace(PLAIN, parameters=PLAIN.parameters | {
        name.replace('__', '.'): value for name, value in changes.items()})


def test_a_seed_is_one_scene():
    drawn = [draw_scene(seed) for seed in range(200)]
    for seed, scene in enumerate(drawn):
        again = draw_scene(seed)
        assert again.text() == scene.text() and again.files == scene.files
        assert scene.kind == kind_of(seed)
        # What is written is what is run.
        assert flatten_parameters(yaml.safe_load(scene.text())).keys() == scene.parameters.keys()
    assert len({scene.text() for scene in drawn}) == 200
    assert list(seeds_of(3, 5, {7, 9})) == [
        seed for seed in range(3, 1000) if kind_of(seed) in (7, 9)][:5]


def test_every_kind_is_drawn():
    assert {kind_of(seed) for seed in range(2000)} == {*range(len(KINDS))}
    assert [scene.kind for scene in map(draw_scene, range(50))] == [*map(kind_of, range(50))]


def test_kinds_are_few_and_their_terms_are_known():
    assert len({*KINDS}) == len(KINDS) <= MAX_KINDS
    for kind in KINDS:
        assert kind.method in ('auto', *ico.METHODS, *IMPLICIT)
        assert [*kind.terms] == [term for term in TERMS if term in kind.terms], kind
    assert {term for kind in KINDS for term in kind.terms} == {*TERMS}


def test_scenes_reach_all_of_the_physics():
    findings = [Finding(seed, kind_of(seed), Verdict.WITHIN) for seed in range(6000)]
    rows = dict(reversed(line.split()) for line in report.coverage_lines(findings))
    never = {name for name, count in rows.items() if int(count) == 0}
    # Each of these is another way to say, or to fill, what is drawn.
    assert never <= {
        'shell.mass', 'weave.box', 'connector_groups.NAME.law', 'loads.NAME.hold',
        'connector.law_beyond', 'connector_groups.NAME.law_beyond', 'connector.alpha',
        'connector_groups.NAME.alpha',
        'connector_groups.NAME.stiffness_extension', 'solver.threads',
        'connector_groups.NAME.stiffness_compression',
        'connector_groups.NAME.break_length_extension',
        'connector_groups.NAME.break_length_compression', 'anchors.NAME.file',
        'bodies.NAME.orientation', 'contact.mode', 'solver.device', 'solver.error_estimate',
        'solver.rotation', 'initial.NAME.file',
        'masses.NAME.principal_inertia', 'bodies.NAME.principal_inertia',
        # The function of an expression is compiled for each scene.
        'charge.expression', 'charges.NAME.expression', 'constants.NAME',
        'field.electric_expression', 'loads.NAME.expression', 'tractions.NAME.expression',
        'charge.layers', 'charges.NAME.layers',
        # Motions of anchors are those of drives; their damping is a kernel variant.
        'anchors.NAME.damping', 'anchors.NAME.duration', 'anchors.NAME.frequency',
        'anchors.NAME.linear', 'anchors.NAME.motion', 'anchors.NAME.phase', 'anchors.NAME.start',
        } | {
        name for name in rows
        if name.startswith(('connectors.NAME.', 'line_loads.NAME.', 'planes.NAME.'))
        or name.endswith('.expression')} - {
        'planes.NAME.normal', 'planes.NAME.offset'}, never
    assert sum(int(count) for count in rows.values()) > 20_000


def test_a_plain_scene_is_within_the_promise():
    finding = judge(PLAIN)
    assert finding.verdict is Verdict.WITHIN, finding
    assert finding.compared and finding.method == 'dop8' and finding.steps > 5
    assert finding.windows > 0 == finding.unjudged
    assert 0.0 < finding.added < finding.promised and finding.growth >= 1.0


def test_wild_motion_is_called_chaotic():
    finding = judge(with_values(
        initial_random__velocity_sigma=0.6, initial_random__spin_sigma=60.0, duration=0.15,
        solver__tolerance=1e-6))
    assert finding.verdict is Verdict.CHAOTIC and finding.growth > 100.0, finding


def test_refusals_name_what_was_given():
    for scene, verdict in (
            (replace(with_values(weave__size=[2, 0, 2]), spoiled='weave.size'), Verdict.REFUSED),
            (with_values(weave__size=[2, 0, 2]), Verdict.WRONGLY_REFUSED),
            (with_values(solver__step=1.0, solver__method='leapfrog'), Verdict.REFUSED),
            (replace(with_values(), spoiled='gravity'), Verdict.SILENT)):
        assert judge(scene).verdict is verdict


@pytest.mark.parametrize('spoiled, error, right', [
    ('gravity', ParameterError('gravity', 'gravity must be finite'), True),
    ('gravity', ValueError('gravity must be finite'), True),
    ('gravity', ValueError('solver.tolerance must be larger'), False),
    ('gravity', ValueError('the duration cannot be'), False),
    ('weave.size', ValueError('the duration cannot be'), False),
    ('weave.connector_length', ValueError('weave.connector_angle is 4 rad'), True),
    ('weave.size', ParameterError('solver.step', 'solver.step is beyond the stability limit'),
     False),
    ('', ValueError('the duration cannot be'), False),
    ('', ValueError('solver.tolerance must be larger'), False),
    ('', ValueError('solver.step 3 s is beyond the stability limit'), True),
    ('', ValueError('they overlap; move them apart, or set contact.mode never'), True),
    ('', ParameterError('groups.low', 'groups.low: z_min selects no body of the 3'), True)])
def test_refusals_are_right_for_what_was_spoiled(spoiled, error, right):
    assert is_right_refusal(error, spoiled) is right


def test_a_spoiled_scene_may_be_refused_for_what_is_impossible_without_it_too():
    scene = replace(
        with_values(weave__size=[1, 1, 1], gravity=[0.0, float('inf'), 0.0], groups__low='ids 99'),
        spoiled='drag.linear', spoiled_with=('gravity',))
    assert judge(scene).verdict is Verdict.WRONGLY_REFUSED
    scene = replace(
        with_values(groups__low='y_min', drag__linear=1.0, weave__size=[1, 1, 1],
                    weave__variant=1), spoiled='drag.linear', spoiled_with=('drag.linear',))
    finding = judge(scene)
    assert finding.verdict is Verdict.REFUSED and 'no icosahedron' in finding.detail, finding


def test_refusals_of_another_name_are_found(plant):
    def refuse(parameters):
        raise ParameterError('solver.tolerance', 'solver.tolerance must be larger')

    plant(judge_module.Scene, 'from_parameters', refuse)
    for spoiled in ('gravity', ''):
        finding = judge(replace(PLAIN, spoiled=spoiled))
        assert finding.verdict is Verdict.WRONGLY_REFUSED, finding


@pytest.mark.parametrize('text, name', [
    ('give e.g. less than 1.5 s.', ''), ('energy is lost', ''), ('the a.b is', ''),
    ('see e.g. solver.step.', 'solver.step'), ('loads.push.force is', 'loads.push.force')])
def test_names_in_sentences_are_those_of_parameters(text, name):
    assert first_parameter(text) == name


def test_stops_are_right_where_they_were_asked_for():
    finding = judge(with_values(
        connector__obstruction='stop', initial_random__spin_sigma=200.0))
    assert finding.verdict is Verdict.STOPPED and 'connector.obstruction' in finding.detail


@pytest.mark.long
def test_a_length_that_jumps_between_overlapping_shells_is_a_right_reason(monkeypatch):
    # Two bodies, one of which turns through the other.
    found = judge(stored_scene('length_jump'))
    assert found.verdict is Verdict.STOPPED and 'connector 0 ' in found.detail
    # The first row of the table in docs/stability.md.
    assert 'energy by -9.58e-05 J' in found.detail, found.detail
    run = compile_scene(ico.Scene.from_parameters(stored_scene('length_jump').parameters))
    assert not did_length_jump(found.detail, run)
    with pytest.raises(SimulationError) as caught:
        run.advance_to(0.03)
    assert did_length_jump(str(caught.value), run)
    assert not did_length_jump('the energy does not balance', run)
    monkeypatch.setattr(refusals, 'depths_of', lambda *poses: np.array([-1e-9]))
    assert not did_length_jump(str(caught.value), run)


@pytest.mark.long
def test_a_given_step_too_long_for_lengths_that_jump_is_a_right_reason(monkeypatch):
    for number in (1, 2):
        found = judge(stored_scene(f'step_too_long_for_jumps_{number}'))
        assert found.verdict is Verdict.STOPPED and 'around them jump' in found.detail
    # It is the runs with shorter steps that say so.
    monkeypatch.setattr(judge_module, 'did_length_jump', lambda text, run: False)
    assert judge(stored_scene('step_too_long_for_jumps_1')).verdict is Verdict.WRONGLY_STOPPED


@pytest.mark.long
def test_charges_that_meet_are_a_right_reason(monkeypatch):
    scene = stored_scene('charges_pass')
    found = judge(scene)
    assert found.verdict is Verdict.STOPPED and 'bodies 16 and 21, whose charges' in found.detail
    run = compile_scene(ico.Scene.from_parameters(scene.parameters))
    with pytest.raises(SimulationError) as caught:
        run.advance_to(scene.duration)

    def reference():
        return compile_reference(windows.reference_scene(run.scene, windows.fastest_rate(run)))

    assert did_charges_pass(str(caught.value), run, reference)
    monkeypatch.setattr(refusals, 'depths_of', lambda *poses: np.array([-1e-9]))
    assert not did_charges_pass(str(caught.value), run, reference)


@pytest.mark.long
def test_steps_through_forces_of_bands_that_jump_are_within_the_promise():
    """As at kinks, their estimates are up to twice too small: 1.8 times the promise was added."""
    finding = judge(stored_scene('wrapped_steps'))
    assert finding.verdict is Verdict.WITHIN and finding.unjudged == 0 < finding.windows, finding


def changed_while_it_runs(**change):
    """The plain scene, of which some values change after a third of its duration."""
    return replace(PLAIN, change_at=0.3, change={
        name.replace('__', '.'): value for name, value in change.items()})


@pytest.mark.parametrize('change, bodies', [
    ({'connector__stiffness': 700.0}, 4), ({'weave__size': [3, 2, 1], 'weave__variant': 2}, 3)])
def test_a_scene_that_changes_while_it_runs_is_judged_from_there(change, bodies):
    scene = changed_while_it_runs(**change)
    found = judge(scene)
    assert found.verdict is Verdict.WITHIN and found.compared, found
    assert found.bodies == bodies
    assert 'After 0.006 s: ' in scene.text()
    # What may be added is the tolerance times the time after the change, and rounding.
    length = found.time - 0.3 * PLAIN.duration
    assert found.promised == pytest.approx(length * PLAIN.parameters['solver.tolerance'], rel=0.03)


def test_a_change_that_cannot_be_is_refused_with_its_name():
    found = judge(replace(changed_while_it_runs(weave__size=[3, 0, 2]), spoiled='weave.size'))
    assert found.verdict is Verdict.REFUSED and 'weave.size' in found.detail
    found = judge(replace(changed_while_it_runs(weave__variant=1), spoiled='weave.variant'))
    assert found.verdict is Verdict.SILENT and 'weave.variant had to be refused' in found.detail


def test_a_change_that_loses_the_motion_is_found(plant):
    scene = changed_while_it_runs(connector__stiffness=700.0)
    continue_from = Simulation.continue_from
    plant(Simulation, 'continue_from', lambda run, previous, keep_motion: continue_from(
        run, previous, keep_motion=False))
    found = judge(scene)
    assert found.verdict is Verdict.SILENT and 'changed position[0]' in found.detail, found


@pytest.mark.long
def test_steps_that_contacts_to_come_kept_short_are_measured_before_they_grow():
    """They became four times as long, with an error that was that of the short ones."""
    found = judge(stored_scene('steps_before_contacts'))
    assert found.verdict is Verdict.WITHIN and found.added < 0.5 * found.promised, found


@pytest.mark.parametrize('name', ['refused_change_1', 'refused_change_2'])
def test_refusals_that_chance_brings_in_changes_are_right(name):
    assert judge(stored_scene(name)).verdict is Verdict.REFUSED


@pytest.mark.long
@pytest.mark.parametrize('name', ['stop_before_change_1', 'stop_before_change_2'])
def test_a_run_up_to_a_change_that_has_too_long_a_step_stops(name):
    """
    The first went on from places that are not finite, into an error of the factorisation.

    The second has a connector in a shell with shorter steps, which ends any run.
    """
    found = judge(stored_scene(name))
    assert found.verdict is Verdict.STOPPED and 'solver.step' in found.detail, found


def test_scenes_change_while_they_run():
    drawn = [draw_scene(seed) for seed in range(400)]
    changing = [scene for scene in drawn if scene.change]
    assert 0.6 < len(changing) / len(drawn) < 0.8
    assert 0.02 < sum(bool(scene.spoiled) for scene in changing) / len(changing) < 0.15
    assert all(0.1 <= scene.change_at <= 0.7 for scene in changing)
    names = {name for scene in changing for name in scene.change}
    assert {'weave.size', 'weave.variant', 'connector.stiffness', 'gravity'} < names
    some = next(scene for scene in changing if len(scene.change) == 3 and not scene.spoiled)
    smaller = [scene.change.keys() for scene in shrink_module._all_smaller(some, 0.0)]
    assert smaller.count(some.change.keys()) == len(smaller) - 4 > 0 and {}.keys() in smaller
    assert all(some.change.keys() - {name} in smaller for name in some.change)


def test_what_takes_too_long_says_what_limits_it():
    finding = judge(with_values(duration=2000.0), seconds=0.3)
    assert finding.verdict is Verdict.SLOW and 'the fastest motion' in finding.detail


# Faults, planted one at a time; each must be seen.


@pytest.fixture
def plant(monkeypatch):
    """Put something wrong in the place of a name of an object."""
    return monkeypatch.setattr


def test_an_estimate_that_is_zero_is_found(plant):
    for owner in (SimulationStatus, Simulation):
        plant(owner, 'error_estimate', property(lambda one: 0.0))
    finding = judge(with_values(solver__step=1.2e-3, solver__tolerance=1e-9))
    assert finding.verdict is Verdict.SILENT, finding


def test_what_the_same_step_says_without_the_fault():
    finding = judge(with_values(solver__step=1.2e-3, solver__tolerance=1e-9))
    assert finding.verdict is Verdict.REPORTED and finding.added > 3.0 * finding.promised, finding


def test_a_lost_unit_of_the_tolerance_is_found(plant):
    def loosely(given):
        if given.parameters['solver.energy_limit'] != 0.5:
            return compile_scene(given)
        tolerance = given.parameters['solver.tolerance']
        run = compile_scene(given.with_changes({'solver.tolerance': 1e3 * tolerance}))
        run.scene = given
        return run

    plant(judge_module, 'compile_scene', loosely)
    plant(SimulationStatus, 'error_estimate', property(lambda status: 1e-12))
    finding = judge(with_values(solver__energy_limit=0.5, solver__tolerance=1e-6))
    assert finding.verdict is Verdict.SILENT, finding


def test_a_sign_in_the_weights_of_a_method_is_found(monkeypatch):
    scene = with_values(solver__method='srkn6', solver__tolerance=1e-4)
    assert judge(scene).verdict is Verdict.WITHIN
    right = METHODS['srkn6']
    kicks = np.array(right.kicks)
    kicks[[2, -3]] *= -1.0
    monkeypatch.setitem(
        METHODS, 'srkn6',
        right._replace(advance=SceneKernel(
            splitting, Splitting(kicks, np.array(right.drifts)))))
    finding = judge(scene)
    assert finding.is_fault, finding


def test_a_checkpoint_that_loses_a_bit_is_found(plant):
    of = Checkpoint.of.__func__

    def stale(cls, simulation, tree):
        made = of(cls, simulation, tree)
        for name, array in made.arrays.items():
            if 'linear_velocity' in name:
                made.arrays[name] = np.nextafter(array, np.inf)
        return made

    plant(Checkpoint, 'of', classmethod(stale))
    finding = judge(PLAIN)
    assert finding.verdict is Verdict.NOT_BIT_IDENTICAL, finding


def test_a_refusal_without_a_name_and_a_stop_without_a_reason_are_found(plant):
    with pytest.MonkeyPatch.context() as monkeypatch:
        def refuse(parameters):
            raise ValueError('this cannot be')

        monkeypatch.setattr(judge_module.Scene, 'from_parameters', refuse)
        assert judge(PLAIN).verdict is Verdict.WRONGLY_REFUSED

    def stopping(given):
        run = compile_scene(given)
        if given.parameters['solver.energy_limit'] == 0.5:
            def stop(time):
                raise SimulationError('the energy does not balance')

            run.advance_to = stop
        return run

    plant(judge_module, 'compile_scene', stopping)
    finding = judge(with_values(solver__energy_limit=0.5))
    assert finding.verdict is Verdict.WRONGLY_STOPPED, finding


def test_two_threads_have_the_work_of_one_between_them(plant):
    # Steps of few bodies are one thread's alone, unless two are asked for.
    scene = with_values(weave__size=[4, 4, 3], solver__method='srkn6')
    finding = judge(scene)
    assert finding.verdict is Verdict.WITHIN and finding.shared, finding

    def alike(self, member):
        # Both push the blocks of the first.
        own, pushes = team(self, member), team(self, 0).sweep.pushes
        return own._replace(sweep=own.sweep._replace(
            pushes=np.resize(pushes, own.sweep.pushes.shape)))

    team = thread_team.ThreadTeam.team
    plant(thread_team.ThreadTeam, 'team', alike)
    finding = judge(scene)
    assert finding.verdict is Verdict.NOT_BIT_IDENTICAL, finding


def test_without_two_threads_there_is_nothing_to_compare(plant):
    plant(thread_team, 'size_for', lambda wanted, count, **others: 1)
    finding = judge(PLAIN)
    assert finding.verdict is Verdict.CRASH and 'requested two threads' in finding.detail


NOT_SHORT = 'no step is short enough for solver.tolerance'
OBSTRUCTED = 'a connector is in its own shell, and connector.obstruction is stop'


@pytest.mark.parametrize('text, verdict', [
    (NOT_SHORT, Verdict.UNJUDGED), (OBSTRUCTED, Verdict.SILENT)])
def test_windows_whose_reference_stops_are_not_within(text, verdict, plant):
    def fail(self, before, start):
        raise SimulationError(text)

    plant(Windows, '_compare', fail)
    finding = judge(PLAIN)
    assert finding.verdict is verdict and text in finding.detail, finding
    assert finding.unjudged == finding.windows > 0


@pytest.mark.parametrize('text, verdict', [
    (NOT_SHORT, Verdict.UNJUDGED), (OBSTRUCTED, Verdict.SILENT)])
def test_a_run_that_goes_on_where_the_tighter_one_stops_is_not_within(text, verdict, plant):
    calm = Growth(np.zeros(1), np.ones(1), np.zeros(1), False, '')
    plant(judge_module, 'run_reference', lambda *words: (calm, 0.0, text))
    finding = judge(PLAIN)
    assert finding.verdict is verdict and text in finding.detail, finding


def test_a_stop_after_the_end_is_right_where_the_tighter_run_comes_to_it_too():
    """The last window ends after the run; there the bodies sink too deep into a soft floor."""
    finding = judge(stored_scene('late_stop'))
    assert finding.verdict is Verdict.STOPPED and 'plane floor overlap' in finding.detail, finding
    assert finding.time > stored_scene('late_stop').duration


def test_a_given_step_that_is_too_long_before_a_stop_of_the_bodies_is_no_wrong_reason():
    """A shorter one comes to what ends the tighter run: shells of 0.4 km, deep in each other."""
    scene = stored_scene('deep_overlap')
    # It drew more inertia than its mass can have.
    finding = judge(replace(scene, parameters={**scene.parameters, 'shell.inertia': 3e16}))
    assert finding.verdict is Verdict.STOPPED and 'solver.step' in finding.detail, finding


class Aside:
    """A run in the place of a simulation, whose connectors are as given."""

    def __init__(self, scene, intact):
        self.scene, self.time, self.intact = scene, 0.0, np.array(intact)

    def advance_to(self, time):
        self.time = max(self.time, time)

    def snapshot(self):
        return SimpleNamespace(
            position=np.full((2, 3), float(self.intact.sum())), intact=self.intact,
            orientation=np.tile([0.0, 0.0, 0.0, 1.0], (2, 1)))

    def advance_steps(self, count):
        return

    def reset_time(self):
        return

    def continue_from(self, other, keep_motion):
        self.time = other.time


@pytest.mark.parametrize('growth, tolerance, broken', [
    (2.0, 1e-9, True), (1e5, 1e-9, False), (2.0, 1e9, False)])
def test_connectors_that_break_otherwise_are_wrong_where_growth_is_small(
        growth, tolerance, broken, monkeypatch):
    found = Growth(np.zeros(1), np.array([growth]), np.zeros(1), False, '')
    scene = ico.Scene.from_parameters(PLAIN.parameters | {'solver.tolerance': tolerance})
    monkeypatch.setattr(windows, 'compile_scene', lambda scene: Aside(scene, [True, False]))
    monkeypatch.setattr(windows, 'Companion', lambda simulation: SimpleNamespace(
        look=lambda: None, result=lambda: found))
    monkeypatch.setattr(windows, 'distance_between', lambda *words: 1e12)
    judged = Windows(Aside(scene, [True, True]), 1e4, lambda: False)
    judged.follow(0.001)
    added = judged.result()
    assert bool(added.broken) is broken and (added.unjudged == 0) is broken, added
    assert added.windows > 0 and '1 connectors broke differently' in added.broken + added.why


def test_what_broke_otherwise_is_silent(plant):
    found = AddedError(0.0, 1.0, 0.0, 3, 0, '', '1 broke differently')
    plant(Windows, 'result', lambda self: found)
    finding = judge(PLAIN)
    assert finding.verdict is Verdict.SILENT and finding.detail == '1 broke differently'


def test_what_is_excused_is_not_what_was_said(plant):
    for owner in (SimulationStatus, Simulation):
        plant(owner, 'error_estimate', property(lambda one: 0.0))
    plant(SimulationStatus, 'error_estimate_lacks', property(lambda status: 'it lacks much'))
    finding = judge(with_values(solver__step=1.2e-3, solver__tolerance=1e-9))
    assert finding.verdict is Verdict.EXCUSED and 'it lacks much' in finding.detail, finding
    factor = finding.added / finding.promised
    [line] = [line for line in report.class_lines([finding]) if 'excused' in line]
    assert f'by up to {factor:.3g} times (seed 0)' in line


@pytest.mark.parametrize('longest, verdict', [
    (4e-4, Verdict.STOPPED), (0.0, Verdict.WRONGLY_STOPPED)])
def test_a_stop_for_a_given_step_is_right_where_a_shorter_one_goes_on(longest, verdict, plant):
    def stopping(given):
        run = compile_scene(given)
        if given.parameters['solver.step'] > longest:
            def stop(time):
                raise SimulationError('out of balance; give a smaller solver.step')

            run.advance_to = stop
        return run

    plant(judge_module, 'compile_scene', stopping)
    finding = judge(with_values(solver__step=1.2e-3))
    assert finding.verdict is verdict, finding


@pytest.mark.parametrize('moment, verdict', [
    ('5e-3', Verdict.STOPPED), ('0.015', Verdict.WRONGLY_STOPPED)])
def test_a_stop_for_a_given_step_is_right_where_a_shorter_one_stops_later(moment, verdict, plant):
    """And for another reason: what ends all runs came after the step was too long."""
    def stopping(given):
        run = compile_scene(given)
        if step := given.parameters['solver.step']:
            advance = run.advance_to

            def stop(time):
                if step == 1.2e-3:
                    raise SimulationError(f'solver.step has become unsafe at t = {moment} s')
                advance(0.01)
                raise SimulationError('Give a larger contact.stiffness')

            run.advance_to = stop
        return run

    plant(judge_module, 'compile_scene', stopping)
    finding = judge(with_values(solver__step=1.2e-3))
    assert finding.verdict is verdict, finding


@pytest.mark.parametrize('method, verdict', [
    ('sdirk4', Verdict.STOPPED), ('dop8', Verdict.WRONGLY_STOPPED)])
def test_a_stop_of_implicit_steps_is_right_where_chosen_ones_go_on(method, verdict, plant):
    def stopping(given):
        run = compile_scene(given)
        if given.parameters['solver.step'] > 0.0:
            def stop(time):
                raise SimulationError('no solution; take a smaller solver.step, or 0')

            run.advance_to = stop
        return run

    plant(judge_module, 'compile_scene', stopping)
    finding = judge(with_values(solver__step=1.2e-3, solver__method=method))
    assert finding.verdict is verdict, finding


@pytest.mark.parametrize('text, moment', [
    ('unsafe at t = 0.00311721759 s: the', 0.00311721759), ('from t = 1e-05 s on', 1e-5),
    ('the time = 3 s', math.inf), ('t = soon', math.inf)])
def test_moments_in_sentences_are_those_of_stops(text, moment):
    assert stop_time(text) == moment


def test_a_run_that_no_other_can_take_over_is_left_to_its_own_checks(monkeypatch):
    """On the way to infinity: chosen steps cannot begin there, which is no stop of the run."""
    class Refusing(Aside):
        def continue_from(self, other, keep_motion):
            raise SimulationError('the motion is too fast for any step')

    scene = ico.Scene.from_parameters(PLAIN.parameters)
    monkeypatch.setattr(windows, 'compile_scene', lambda scene: Refusing(scene, [True]))
    run = Aside(scene, [True])
    judged = Windows(run, 1e4, lambda: False)
    judged.follow(0.001)
    added = judged.result()
    assert run.time >= 0.001 and added.unjudged == added.windows > 0 and 'too fast' in added.why


def test_what_was_run_in_part_is_judged_again_to_there(plant):
    follow, asked = Windows.follow, []

    def half(self, duration):
        asked.append(duration)
        follow(self, 0.5 * duration if len(asked) == 1 else duration)
        if len(asked) == 1:
            raise Interrupted

    plant(Windows, 'follow', half)
    plant(Windows, 'result', lambda self: AddedError(1.0, 1e-9, 0.0, 3, 0, '', ''))
    finding = judge(PLAIN)
    assert finding.verdict is Verdict.SILENT
    assert asked == [PLAIN.duration, finding.time] and finding.time < 0.8 * PLAIN.duration


def test_time_of_the_compiler_is_processor_time(monkeypatch):
    times = iter([10.0, 1.0, 3.0, 4.0, 4.5, 20.0])
    monkeypatch.setattr(judge_module.time, 'process_time', lambda: next(times))
    compiler = judge_module._CompilerTime()
    clock = judge_module.Clock(1.0, compiler)
    compiler.on_start(None)
    compiler.on_start(None)
    compiler.on_end(None)
    compiler.on_end(None)
    assert compiler.seconds == 2.0
    compiler.on_start(None)
    compiler.on_end(None)
    assert compiler.seconds == 2.5 and clock.seconds == 20.0 - 10.0 - 2.5


def test_an_error_of_the_program_is_a_crash(plant):
    def fail(given):
        raise ZeroDivisionError('a division')

    plant(judge_module, 'compile_scene', fail)
    finding = judge(PLAIN)
    assert finding.verdict is Verdict.CRASH and 'ZeroDivisionError' in finding.detail


def die_or_hang(scene):
    """In a process of its own: die, stay away, or answer."""
    if scene.seed == 1:
        os.abort()
    while scene.seed == 2:
        time.sleep(0.1)
    return Finding(scene.seed, scene.kind, Verdict.WITHIN)


def test_a_process_that_dies_and_one_that_hangs_are_seen_from_outside():
    scenes = [replace(PLAIN, seed=seed) for seed in range(4)]
    found = {finding.seed: finding for finding in judge_scenes(
        scenes, processes=1, judge_one=die_or_hang, hangs_after=3.0)}
    assert [found[seed].verdict for seed in range(4)] == [
        Verdict.WITHIN, Verdict.CRASH, Verdict.HANG, Verdict.WITHIN]
    assert 'SIGABRT' in found[1].detail


def test_a_process_that_goes_slowly_is_waited_for():
    class Slow:
        exitcode = None

        def join(self, timeout=1e9):
            self.exitcode = -11 if timeout > 5.0 else None

        def kill(self):
            return

    worker = object.__new__(workers._Worker)
    worker._process, worker.connection = Slow(), SimpleNamespace(close=lambda: None)
    assert worker.wait_for_exit() == 'the process was ended by SIGSEGV'


def test_a_scene_is_made_minimal():
    asked = []

    def judge_one(scene):
        asked.append(scene)
        bad = scene.parameters.get('initial_random.spin_sigma', 0.0) > 0.0
        return Finding(scene.seed, scene.kind, Verdict.SILENT if bad else Verdict.WITHIN)

    scene = with_values(**{
        'groups.one': 'ids 0', 'initial.kick.group': 'one', 'gravity': [0.0, 0.0, -9.81]})
    small, finding = shrink(scene, judge_one)
    assert finding.verdict is Verdict.SILENT
    assert 'initial_random.spin_sigma' in small.parameters
    assert not {*small.parameters} & {'gravity', 'initial.kick.group', 'solver.tolerance'}
    # It ends because nothing is left to take away.
    assert small.duration == scene.duration / 1024 and len(asked) < 200


def test_a_spoiled_scene_keeps_what_spoils_it():
    def judge_one(scene):
        return Finding(scene.seed, scene.kind, Verdict.SILENT)

    for name in ('loads.lost.group', 'solver.method', 'shell.thickness'):
        seed = next(
            seed for seed in range(9000) if draw_scene(seed).spoiled == name
            and not draw_scene(seed).change)
        scene = draw_scene(seed)
        small, _ = shrink(scene, judge_one)
        assert {name, *scene.spoiled_with} <= {*small.parameters} < {*scene.parameters}


def test_a_minimal_scene_overwrites_no_files(tmp_path, capsys, monkeypatch):
    finding = Finding(0, 0, Verdict.SILENT)
    monkeypatch.setattr(
        'icofabric_validation.stress.shrink.shrink', lambda scene, *words, **more: (
            scene, finding))
    seed = next(seed for seed in range(9000) if 'law.csv' in draw_scene(seed).files)
    words = ['stress', '--seed', str(seed), '--shrink', '--output']
    (tmp_path / 'law.csv').write_text('mine')
    assert main([*words, str(tmp_path / 'one.yaml')]) == 1
    assert (tmp_path / 'law.csv').read_text() == 'mine'
    assert (tmp_path / 'one_law.csv').read_text() == draw_scene(seed).files['law.csv']
    written = flatten_parameters(yaml.safe_load((tmp_path / 'one.yaml').read_text()))
    assert 'one_law.csv' in str(written.values())
    (tmp_path / 'two_law.csv').write_text('mine')
    assert main([*words, str(tmp_path / 'two.yaml')]) == 2
    assert 'two_law.csv exists' in capsys.readouterr().err
    assert not (tmp_path / 'two.yaml').exists()


def described(findings):
    """Faults, with what there is to say of them."""
    return [finding for finding in findings if finding.is_fault]


@pytest.mark.examples
def test_random_scenes_of_kinds_that_other_tests_compile():
    kinds = {KINDS.index(Kind(method)) for method in ('srkn4', 'srkn6', 'dop8')}
    count = 16 * FACTOR
    findings = [judge(draw_scene(seed)) for seed in seeds_of(2000, count, kinds)]
    assert len(findings) == count and not described(findings)
    assert sum(finding.compared for finding in findings) >= 0.7 * count
    assert sum(finding.verdict is Verdict.WITHIN for finding in findings) >= 0.5 * count
    assert sum(finding.verdict is Verdict.BETWEEN for finding in findings) <= 1 + 0.01 * count


@pytest.mark.long
def test_many_random_scenes():
    findings = list(judge_all(seeds_of(3000, 200, range(len(KINDS))), processes=2))
    assert len(findings) == 200
    # A step that is given may be too long for a connector that collapses (docs/decisions).
    assert not [finding for finding in described(findings) if not finding.is_given]
    between = sum(finding.verdict is Verdict.BETWEEN for finding in findings)
    assert between <= 4


@pytest.mark.parametrize('words, status, said', [
    (['--kinds', '3-99'], 2, 'must be within 0 to'), (['--kinds', 'x'], 2, 'neither a number nor'),
    (['--scenes', '0'], 2, '--scenes must be'), (['--seed', '-1'], 2, '--seed must be'),
    (['--shrink'], 2, '--shrink needs --seed'), (['--processes', '0'], 2, '--processes must be')])
def test_words_that_make_no_sense(words, status, said, capsys):
    assert main(['stress', *words]) == status
    assert said in capsys.readouterr().err


def test_one_scene_by_the_command_and_its_table(tmp_path, capsys):
    # Refused, so no kernels are needed.
    seed = next(
        seed for seed in range(9000) if draw_scene(seed).spoiled == 'weave.size'
        and not draw_scene(seed).change)
    assert main(['stress', '--seed', str(seed)]) == 0
    assert 'refused with the right name' in capsys.readouterr().out
    table = tmp_path / 'table.csv'
    assert main([
        'stress', '--seed', str(seed), '--scenes', '1', '--output', str(table), '--json']) == 0
    assert json.loads(capsys.readouterr().out)['verdict'] == 'refused with the right name'
    [row] = csv.DictReader(table.read_text().splitlines())
    assert row['seed'] == str(seed) and 'weave.size' in row['detail']


def test_figures_that_are_not_finite_are_valid_json(capsys, monkeypatch):
    found = Finding(7, 0, Verdict.SILENT, growth=float('inf'), added=float('nan'))
    monkeypatch.setattr(workers, 'judge_all', lambda seeds, **words: iter([found]))
    assert main(['stress', '--seed', '7', '--json']) == 1
    said = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert said['growth'] is said['added'] is None and said['seed'] == 7


def test_kinds_are_listed(capsys):
    assert main(['stress', '--list', '--kinds', '0,5']) == 0
    assert [line.split()[:2] for line in capsys.readouterr().out.splitlines()] == [
        ['0', 'auto'], ['5', 'dop8']]


def test_a_step_whose_forces_are_no_numbers_is_refused():
    # Connectors that pull 7,000 times as stiffly as they push: steps grow while all are pushed,
    # and one of 0.5 s leaves the range of numbers. Its error was taken for none.
    finding = judge(stored_scene('not_finite_step'))
    assert finding.verdict in (Verdict.WITHIN, Verdict.CHAOTIC), finding


def test_a_reference_is_as_tight_as_doubles_can_give():
    scene = ico.Scene.from_parameters(PLAIN.parameters | {'solver.tolerance': 1e-15})
    with pytest.raises(ValueError, match='below what doubles can give'):
        compile_scene(scene)
    taken = compile_reference(scene).scene.parameters['solver.tolerance']
    assert 1e-15 < taken < 1e-10
    with pytest.raises(ValueError, match='below what doubles can give'):
        compile_scene(scene.with_changes({'solver.tolerance': taken / 3.0}))
    # What else is refused is no matter of the tolerance.
    with pytest.raises(ValueError, match='solver.step'):
        compile_reference(scene.with_changes({'solver.step': 1.0}))
