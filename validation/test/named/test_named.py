# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Problems with known answers in their short form, how curves are judged, and the table."""

import csv
import json
import math

from icofabric_sim import contact
from icofabric_sim.commands.main import main
from icofabric_sim.kernels.integrators.embedded import DOP8
from icofabric_sim.simulation.errors import SimulationError
from icofabric_sim.simulation.stepping.embedded_kernels import kernels_of
from icofabric_sim.simulation.stepping.methods import METHODS
from icofabric_sim.terms.contacts.many import touch_planes
from icofabric_sim.terms.contacts.pair import contact_scratch, OUT_SIZE
from icofabric_validation.named import (
    arenstorf,
    bouncing,
    catalogue,
    chain,
    falling_grid,
    fermi_pasta_ulam,
    granular_gas,
    heap,
    impacts,
    incline,
    loose_bodies,
    pleiades,
    restitution,
    time_reversal,
    toda,
    wave_packet,
)
from icofabric_validation.named.catalogue import PROBLEMS, solve_all
from icofabric_validation.named.mujoco_incline import slide
from icofabric_validation.named.problem import Curve, Point, PremiseError, Problem
import numpy as np
import pytest


def falling(order, *, factor=1.0, last=None):
    """Errors of an order at four steps."""
    points = [Point(h, factor * h**order, 10) for h in (0.1, 0.05, 0.025, 0.0125)]
    if last is not None:
        points[-1] = points[-1]._replace(error=last)
    return tuple(points)


def test_curves_are_judged_by_their_last_error_and_their_slope():
    curve = Curve('x', 'step [s]', falling(4.0), allowed=1e-6, order=4.0)
    assert curve.fault == '' and curve.observed_order == pytest.approx(4.0)
    assert curve.order_before(0) is None and curve.order_before(2) == pytest.approx(4.0)
    assert 'allowed' in Curve('x', 'step [s]', falling(4.0), allowed=1e-9).fault
    assert 'order' in Curve('x', 'step [s]', falling(3.4), allowed=1.0, order=4.0).fault
    # Rounding at the end hides no order.
    stalled = falling(4.0, factor=100.0, last=3e-5)
    assert Curve('x', 'step [s]', stalled, order=4.0).fault != ''
    assert Curve('x', 'step [s]', stalled, order=4.0, floor=4e-5).fault == ''
    fault = Curve('x', 'step [s]', falling(4.0), order=4.0, floor=1.0).fault
    assert 'fewer than two errors' in fault
    for wrong in (math.nan, math.inf):
        assert Curve('x', 'step [s]', falling(4.0, last=wrong), allowed=1.0).fault
        cases = (Point(1.0, wrong), Point(2.0, 0.0))
        assert Curve('x', 'case', cases, allowed=1.0, is_refined=False).fault
        assert not Curve('x', 'case', cases, is_comparison=True).fault
    # Cases are judged one by one.
    assert Curve('x', 'case', (Point(1.0, 2.0), Point(2.0, 0.0)), 1.0, is_refined=False).fault


def test_problems_are_numbered_and_named_once():
    assert len({problem.name for problem in PROBLEMS}) == len(PROBLEMS)
    for problem in PROBLEMS:
        assert problem.source and problem.compared and problem.title


def check(problem):
    """Solve the short form; returns its curves, none of which has a fault."""
    curves = tuple(problem.solve(False))
    for curve in curves:
        print(problem.name, curve.label, curve.observed_order, *curve.points, sep='\n  ')
        assert curve.fault == '', (problem.name, curve.label, curve.fault)
        assert all(point.error >= 0.0 for point in curve.points)
    assert curves
    return curves


@pytest.mark.parametrize('problem', [
    pytest.param(pleiades.PROBLEM, marks=pytest.mark.long), arenstorf.PROBLEM])
def test_orbits_by_the_kernel_and_the_controller_of_dop8(problem):
    chosen, given = check(problem)
    # The controller takes steps of very different lengths: far fewer than equal ones.
    assert chosen.points[-2].steps < 0.2 * given.points[-1].steps
    assert chosen.points[-1].error < given.points[-1].error


QUICK = (
    wave_packet.PROBLEM, time_reversal.PROBLEM, impacts.NORMAL, impacts.OBLIQUE,
    bouncing.PROBLEM, incline.SLIDES, falling_grid.FALLING, falling_grid.ELASTIC)
SLOW = (
    toda.PROBLEM, fermi_pasta_ulam.PROBLEM, incline.TIPS, granular_gas.PROBLEM, heap.PROBLEM)


@pytest.mark.parametrize('problem', [
    *(pytest.param(problem, id=problem.name) for problem in QUICK),
    *(pytest.param(problem, id=problem.name, marks=pytest.mark.long) for problem in SLOW)])
def test_other_answers_are_found(problem):
    curves = check(problem)
    if problem is not incline.TIPS:
        assert all(point.steps > 0 for curve in curves for point in curve.points)


def test_every_problem_is_tested():
    assert {pleiades.PROBLEM.name, arenstorf.PROBLEM.name, *(
        problem.name for problem in (*QUICK, *SLOW))} == {problem.name for problem in PROBLEMS}


def test_restitution_is_that_of_the_library():
    for damping, speed in ((0.0, 1.0), (0.1, 0.1), (0.3, 1.0), (5.0, 2.0), (100.0, 3.0)):
        assert restitution.restitution_of(damping, speed) == pytest.approx(
            contact.restitution(damping, speed), rel=1e-8), (damping, speed)
    assert restitution.damping_for(0.7, 2.0) == pytest.approx(contact.damping_for(0.7, 2.0))


def test_the_share_of_a_vertex_is_that_of_the_contact_kernel():
    a, up, tip = loose_bodies.A, loose_bodies.UP, restitution.TIP
    depth = 1e-4 * a
    rotation = loose_bodies.rotate_down(loose_bodies.VERTICES[0]).as_matrix()
    touching, out = np.zeros(1, bool), np.zeros((1, OUT_SIZE))
    touch_planes(
        np.full((1, 2), a), up, 0.0, ((tip - depth) * up)[None],
        np.ascontiguousarray(rotation)[None], contact_scratch(), touching, out)
    assert touching[0]
    assert out[0, 10] / depth == pytest.approx(restitution.VERTEX_SHARE, rel=1e-10)


def test_the_table_of_a_law_is_refined_about_its_zero(tmp_path):
    path = tmp_path / 'law.csv'
    spacing = chain.write_law(path, lambda r: 2.0 * r, -1.0, 0.5, 15)
    rows = np.loadtxt(path, delimiter=',')
    assert spacing == pytest.approx(0.1) and len(rows) == 16
    here = np.flatnonzero(rows[:, 1] == 0.0)
    assert rows[here, 0] == [chain.natural_length()]
    with pytest.raises(ValueError, match='odd'):
        chain.chain_parameters(4, 'ids 0', {})


def test_the_shell_on_an_incline_in_mujoco_creeps_less_with_shorter_steps():
    pytest.importorskip('mujoco')
    ways = [
        slide(np.arctan(0.27), 0.3, 1e-2, 1e-6, 0.0, step, 0.2, 0.1)[0] for step in (2e-3, 1e-3)]
    assert 0.0 < ways[1] < ways[0] < 1.0


def test_a_premise_that_does_not_hold_is_a_fault(monkeypatch):
    monkeypatch.setattr(time_reversal, '_END', 1e-3)
    monkeypatch.setattr(catalogue, 'PROBLEMS', (time_reversal.PROBLEM,))
    (answer,) = solve_all([1])
    assert answer.curves == () and 'nothing moved' in answer.faults[0]


def test_what_planes_bear_counts_friction_and_asks_for_a_heap():
    tilt = np.arctan(0.27)
    simulation = incline.on_face(tilt, friction=0.3, over_vertex=True)
    simulation.advance_to(2.1)
    touching = simulation.status.touching()
    weight = simulation.scene.shell.mass * loose_bodies.GRAVITY
    assert touching.spring == pytest.approx(
        np.array([[-weight * np.sin(tilt), 0.0, 0.0]]), abs=1e-8 * weight)
    assert heap.upward_force(touching, 2) == pytest.approx(weight * np.cos(tilt), rel=1e-8)
    with pytest.raises(PremiseError, match='no heap'):
        heap.upward_force(touching, 1)


def test_a_shell_that_does_not_bounce_is_a_fault(monkeypatch):
    monkeypatch.setattr(bouncing, 'FLOOR', {})
    monkeypatch.setattr(catalogue, 'PROBLEMS', (bouncing.PROBLEM,))
    (answer,) = solve_all([1])
    assert answer.curves == () and 'after 4 bounces' in answer.faults[0]


def test_a_method_that_is_not_reversible_is_found(monkeypatch):
    real = time_reversal._error
    monkeypatch.setattr(time_reversal, '_error', lambda method, step: real(
        'dop8' if method.startswith('srkn') else method, step))
    *reversible, beside = time_reversal.PROBLEM.solve(False)
    assert [curve.label.split(':')[0] for curve in reversible if curve.fault] == [
        'srkn4', 'srkn6', 'srkn8']
    assert not beside.fault


@pytest.mark.long
def test_a_fault_in_the_law_of_a_chain_is_found(monkeypatch):
    real = chain.write_law
    monkeypatch.setattr(toda, 'write_law', lambda path, tension, *places: real(
        path, lambda r: (1.0 + 1e-6) * tension(r), *places))
    (curve,) = toda.PROBLEM.solve(False)
    assert 'allowed' in curve.fault and curve.points[-1].error < 1e-4


def with_changes(name, factor):
    """`simulate` of loose bodies with a parameter that is not the one of the formula."""
    def simulate(bodies, parameters):
        return loose_bodies.simulate(bodies, {**parameters, name: factor * parameters[name]})
    return simulate


def test_a_fault_in_the_friction_is_found(monkeypatch):
    monkeypatch.setattr(incline, 'simulate', with_changes('contact.friction', 1.0 + 1e-9))
    monkeypatch.setattr(incline, 'is_installed', lambda: False)
    stays, slides = incline.SLIDES.solve(False)
    assert 'allowed' in slides.fault and not stays.fault


def test_a_fault_in_the_restitution_is_found(monkeypatch):
    monkeypatch.setattr(impacts, 'simulate', with_changes('contact.damping', 1.0 + 1e-4))
    *others, damped = impacts.NORMAL.solve(False)
    assert 'allowed' in damped.fault and not any(curve.fault for curve in others)


def test_a_scene_that_is_refused_is_a_fault_of_its_problem_alone(monkeypatch, capsys):
    def refused(long):
        raise ValueError('solver.tolerance 1e-30 1/s is below what doubles can give here')
        yield
    monkeypatch.setattr(catalogue, 'PROBLEMS', (
        Problem('refused', 'refused', 'nobody', 'none', refused), made_up(1e-4)))
    first, second = solve_all([1, 2])
    assert 'refused: solver.tolerance' in first.faults[0] and not second.faults
    assert main(['stress', '--named']) == 1
    assert '1 of 2 problems answered as expected; not 1' in capsys.readouterr().out


def test_a_fault_in_the_tableau_is_found(monkeypatch):
    weights = np.array(DOP8.step)
    weights[5] += 1e-3
    weights[6] -= 1e-3
    monkeypatch.setitem(METHODS, 'dop8', METHODS['dop8']._replace(
        embedded=kernels_of(DOP8._replace(step=weights))))
    curve = next(arenstorf.PROBLEM.solve(False))
    assert 'allowed' in curve.fault and curve.observed_order < 4.0


def made_up(error, name='made_up'):
    """A problem that needs no run."""
    def solve(long):
        yield Curve('short', 'step [s]', (Point(1.0, error, 7),), allowed=1e-3)
        if long:
            yield Curve('long', 'step [s]', (Point(0.5, error),), is_comparison=True)
    return Problem(name, 'made up', 'nobody', 'nothing', solve, has_long_form=True)


def test_the_command_prints_one_numbered_table(monkeypatch, tmp_path, capsys):
    def stops(long):
        raise SimulationError('it stops')
        yield
    monkeypatch.setattr(catalogue, 'PROBLEMS', (
        made_up(1e-4), made_up(1.0, 'off'), Problem('ends', 'ends', 'nobody', 'none', stops)))
    table = tmp_path / 'new' / 'named.csv'
    for words, status in ((['--problem', '1'], 0), (['--problem', '1,2'], 1),
                          (['--problem', '3'], 1)):
        assert main(['stress', '--named', *words, '--output', str(table)]) == status
        assert ('not ' in capsys.readouterr().out) == bool(status)
    assert main(['stress', '--named', '--problem', '2,1', '--json']) == 1
    wrong, right = map(json.loads, capsys.readouterr().out.splitlines())
    assert (wrong['problem'], right['problem']) == (2, 1)
    assert wrong['faults'] and not right['faults']
    assert right['curves'][0]['points'] == [{'refined': 1.0, 'error': 1e-4, 'steps': 7}]
    assert main(['stress', '--named', '--problem', '1', '--long', '--output', str(table)]) == 0
    with table.open() as file:
        rows = [*csv.DictReader(file)]
    assert [row['curve'] for row in rows] == ['short', 'long']
    assert float(rows[0]['error']) == 1e-4


def test_what_does_not_fit_is_refused(capsys):
    for words, part in ((['--named', '--seed', '1'], '--seed'), (['--problem', '1'], '--named'),
                        (['--named', '--seed', '0'], '--seed'),
                        (['--named', '--processes', '1'], '--processes'),
                        (['--named', '--problem', '0'], 'from 1'), (['--long'], '--named'),
                        (['--named', '--problem', 'x'], "'x'")):
        assert main(['stress', *words]) == 2
        assert part in capsys.readouterr().err
    assert main(['stress', '--named', '--list']) == 0
    listed = capsys.readouterr().out
    assert all(problem.name in listed for problem in PROBLEMS)
    assert [answer.number for answer in solve_all([])] == []
