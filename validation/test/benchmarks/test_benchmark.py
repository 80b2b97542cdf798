# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The benchmarks measure what they say: the same motion, errors, interpolation; no wall times here.
"""

import csv
import math
from xml.etree import ElementTree

import icofabric_sim as ico
from icofabric_sim.commands.main import main
from icofabric_sim.geometry.icosahedron import vertices
from icofabric_validation.benchmarks import own_methods, report, step_speed, timing, work_precision
from icofabric_validation.benchmarks.contestants import gather
from icofabric_validation.benchmarks.curves import Curve, Point, trace
from icofabric_validation.benchmarks.kinked_reference import kinked_reference
from icofabric_validation.benchmarks.peers import lammps_peer, mujoco_peer, PEERS, scipy_peer
from icofabric_validation.benchmarks.reference import reference_motion
from icofabric_validation.benchmarks.scenes import (
    axes_from_midpoints,
    axes_from_quaternions,
    DAMPED,
    KINKED,
    Motion,
    motion_error,
    plain_scene,
    scene_parameters,
    SIZES,
)
from icofabric_validation.benchmarks.solver import StepSolver, ToleranceSolver, Unusable
from icofabric_validation.benchmarks.timing import in_rounds, Spread
from icofabric_validation.commands.benchmark import read_tables
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

SMALL = (2, 3, 2)
DURATION = 0.05


@pytest.fixture(scope='module')
def small():
    return plain_scene('small', SMALL)


@pytest.fixture(scope='module')
def truth(small):
    return reference_motion(small, DURATION)


def world_ends(scene, motion):
    arms = scene.edge_points[scene.edges]
    return motion.position[scene.bodies] + np.einsum(
        'ceij,cei->cej', motion.axes[scene.bodies], arms)


def test_first_scene_is_the_free_slab_it_is_said_to_be():
    scene = plain_scene('S1')
    assert (scene.body_count, scene.connector_count) == (63, 240)
    assert scene.half_edge == 0.01 and scene.stiffness == 500.0
    assert scene.natural_length == pytest.approx(2.0 * scene.half_width, rel=1e-14)
    # The deviation of 189 numbers is known to 1 / sqrt(2 * 189) = 5 %; four of these.
    assert scene.velocity.std() == pytest.approx(0.05, rel=0.2)
    assert scene.spin.std() == pytest.approx(2.0, rel=0.2)
    ends = world_ends(scene, Motion(scene.position, scene.axes))
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert lengths == pytest.approx(scene.natural_length, rel=1e-12)
    assert SIZES['S3'] == (21, 21, 21)


def test_error_is_the_largest_of_distance_and_angle(small):
    start = Motion(small.position, small.axes)
    assert motion_error(start, start, small.half_edge) == 0.0
    moved = small.position.copy()
    moved[3, 1] += 2e-6 * small.half_edge
    assert motion_error(Motion(moved, small.axes), start, small.half_edge) == pytest.approx(2e-6)
    for angle in (1e-9, 0.3, 3.0):
        turned = small.axes.copy()
        turned[1] = turned[1] @ Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix().T
        error = motion_error(Motion(small.position, turned), start, small.half_edge)
        assert error == pytest.approx(angle, rel=1e-6)
    moved[0, 0] = math.nan
    assert motion_error(Motion(moved, small.axes), start, small.half_edge) == math.inf


def test_axes_agree_between_quaternions_and_midpoints(small):
    quaternions = Rotation.random(small.body_count, random_state=4).as_quat()
    axes = axes_from_quaternions(quaternions)
    matrices = Rotation.from_quat(quaternions).as_matrix()
    assert axes == pytest.approx(np.swapaxes(matrices, 1, 2), abs=1e-14)
    points = small.position[:, None, :] + np.einsum('ei,bij->bej', small.edge_points, axes)
    motion = axes_from_midpoints(points)
    assert motion_error(motion, Motion(small.position, axes), small.half_edge) < 1e-13


def test_reference_agrees_with_our_finest_motion_and_moves(small, truth):
    parameters = scene_parameters(SMALL, {'method': 'srkn6', 'step': DURATION / 400})
    simulation = ico.compile_scene(ico.Scene.from_parameters(parameters))
    simulation.advance_to(DURATION)
    now = simulation.snapshot()
    ours = Motion(now.position, axes_from_quaternions(now.orientation))
    assert motion_error(ours, truth.motion, small.half_edge) < 1e-10
    assert truth.uncertainty < 1e-11
    start = Motion(small.position, small.axes)
    assert motion_error(truth.motion, start, small.half_edge) > 0.05
    # Displacements that strain springs swing: they neither vanish nor explode in so short a time.
    assert 0.1 < truth.growth < 20.0


def require_our_motion(reference, changes, truth, half_edge):
    """Our finest motion is that of the reference, and not that of plain connectors, `truth`."""
    parameters = scene_parameters(SMALL, {'method': 'dop8', 'tolerance': 1e-9}, changes)
    simulation = ico.compile_scene(ico.Scene.from_parameters(parameters))
    simulation.advance_to(DURATION)
    now = simulation.snapshot()
    ours = Motion(now.position, axes_from_quaternions(now.orientation))
    assert motion_error(ours, reference.motion, half_edge) < 1e-9 * DURATION
    assert motion_error(truth.motion, reference.motion, half_edge) > 1e-3


def test_kinked_reference_agrees_with_our_finest_motion(small, truth):
    scene = plain_scene('kinked', SMALL, KINKED)
    assert scene.compression == 0.2 * scene.stiffness
    reference = kinked_reference(scene, DURATION)
    assert reference.crossings > 20 and reference.uncertainty < 1e-11
    require_our_motion(reference, KINKED, truth, small.half_edge)


def test_damped_reference_agrees_with_our_finest_motion(small, truth):
    scene = plain_scene('damped', SMALL, DAMPED)
    assert scene.damping == 0.02 and small.damping == 0.0
    reference = reference_motion(scene, DURATION)
    assert reference.uncertainty < 1e-11
    require_our_motion(reference, DAMPED, truth, small.half_edge)
    solver = next(scipy_peer.solvers(scene))
    solver.start(1e-11, DURATION)
    solver.finish()
    assert motion_error(solver.motion(), reference.motion, small.half_edge) < 1e-9


def test_reference_conserves_momentum(small, truth):
    centre = small.position.mean(axis=0) + DURATION * small.velocity.mean(axis=0)
    assert truth.motion.position.mean(axis=0) == pytest.approx(centre, abs=1e-14)
    gram = np.einsum('bik,bjk->bij', truth.motion.axes, truth.motion.axes)
    assert gram == pytest.approx(np.broadcast_to(np.eye(3), gram.shape), abs=1e-12)


def test_scipy_follows_its_tolerance(small, truth):
    solver = next(scipy_peer.solvers(small))
    assert isinstance(solver, ToleranceSolver)
    errors = []
    for tolerance in (1e-4, 1e-7, 1e-10):
        solver.start(tolerance, DURATION)
        solver.finish()
        errors.append(motion_error(solver.motion(), truth.motion, small.half_edge))
    assert errors[0] > 30.0 * errors[1] > 900.0 * errors[2] > 0.0
    assert errors[2] < 1e-9


def test_every_peer_converges_or_says_how_to_get_it(small, truth):
    found = gather(small, SMALL, PEERS)
    assert 'scipy' in found.distributions
    for name, peer in PEERS.items():
        if peer.DISTRIBUTION not in found.distributions:
            assert any(line.startswith(name) and line.endswith(peer.INSTALL)
                       for line in found.missing)
    own_labels = [solver.label for solver in found.solvers if solver.tool == own_methods.TOOL]
    fixed = [name for name, facts in ico.METHODS.items() if not facts.adaptive]
    assert set(fixed) <= set(own_labels)
    for solver in found.solvers:
        if not isinstance(solver, StepSolver):
            continue
        errors = []
        # Short enough for an order to show, and for the energy to stay within its limit.
        count = math.ceil(DURATION / solver.longest)
        for factor in (4, 8):
            solver.start(DURATION / (factor * count))
            solver.advance(factor * count)
            errors.append(motion_error(solver.motion(), truth.motion, small.half_edge))
        solver.close()
        assert errors[0] > 1e-13
        assert errors[1] < 0.6 * errors[0] * 2.0 ** (1 - solver.order), solver.label


def test_own_methods_refuse_steps_beyond_their_limit(small):
    solver = next(s for s in own_methods.solvers(SMALL) if isinstance(s, StepSolver))
    with pytest.raises(Unusable, match='limit'):
        solver.start(3.0 * solver.longest)


def test_lammps_reads_the_scene(small, tmp_path):
    lammps_peer.write_files(small, tmp_path)
    words = (tmp_path / 'fabric.data').read_text().split('\n')
    assert f'{6 * small.body_count} atoms' in words
    atoms = words.index('Atoms # bond') + 2
    places = np.array([line.split()[3:] for line in words[atoms:atoms + 6 * small.body_count]],
                      dtype=float)
    bonds = words.index('Bonds') + 2
    ends = np.array([line.split()[2:] for line in words[bonds:bonds + small.connector_count]],
                    dtype=int) - 1
    lengths = np.linalg.norm(places[ends[:, 0]] - places[ends[:, 1]], axis=1)
    assert lengths == pytest.approx(small.natural_length, rel=1e-12)
    assert (ends // 6 == small.bodies).all()
    bodies = np.loadtxt(tmp_path / 'bodies.txt', skiprows=1)
    assert bodies[:, 1] == pytest.approx(small.mass) and bodies[:, 5] == pytest.approx(
        small.inertia)
    assert bodies[:, 14:17] == pytest.approx(small.inertia * small.spin, rel=1e-15)


def test_mujoco_reads_the_scene(small):
    root = ElementTree.fromstring(mujoco_peer.model_text(small))
    assert len(root.findall('worldbody/body')) == small.body_count
    sites = {site.get('name') for site in root.iter('site') if site.get('name')}
    tendons = root.findall('tendon/spatial')
    assert len(tendons) == small.connector_count
    assert {end.get('site') for tendon in tendons for end in tendon} == sites
    assert {float(tendon.get('springlength')) for tendon in tendons} == {small.natural_length}
    assert not list(root.iter('geom')) and root.find('option/flag').get('contact') == 'disable'
    floor = ElementTree.fromstring(mujoco_peer.model_text(small, floor=-0.25))
    assert [geom.get('type') for geom in floor.iter('geom')] == ['plane'] + (
        ['mesh'] * small.body_count)
    assert floor.find('option').get('gravity') == '0 0 -9.81'
    assert floor.find('option/flag').get('contact') is None
    corners = np.array(floor.find('asset/mesh').get('vertex').split(), float).reshape(12, 3)
    assert np.array_equal(corners, vertices(small.half_edge))


class Power(StepSolver):
    """A solver whose error is known: (step / longest) to the power of its order."""

    label, tool, order, evaluations, longest = 'power', 'power', 3, 1, 0.1

    def __init__(self, motion):
        self._still = motion

    def start(self, step):
        if step > 0.05:
            raise Unusable('too long')
        self._step = step

    def advance(self, count):
        self.count = count

    def motion(self):
        shift = 0.2 * self._still_size * (self._step / self.longest) ** self.order
        return Motion(self._still.position + [shift, 0.0, 0.0], self._still.axes)

    _still_size = 0.01


def test_curve_goes_from_rough_to_fine_and_shows_its_order(small, truth):
    curve = trace(Power(truth.motion), small, truth, longest_run=1.0)
    errors = [point.error for point in curve.points]
    assert errors == sorted(errors, reverse=True)
    assert errors[0] > 1e-2 and errors[-1] < 3e-11
    assert curve.observed_order() == pytest.approx(3.0, abs=0.05)
    assert curve.remark == ''


def power_curve(settings):
    """Time in proportion to the steps, error to their power of -3: 1e-3 for 100 steps in 1 s."""
    points = [Point(n, 1e-3 * (100.0 / n) ** 3, [0.01 * n, 0.02 * n]) for n in settings]
    return Curve(Power(None), points)


def test_time_at_an_error_follows_the_power_law():
    curve = power_curve([50, 200, 800])
    for target in (5e-3, 1e-3, 1e-5):
        steps = 100.0 * (1e-3 / target) ** (1.0 / 3.0)
        assert curve.time_at(target, 0) == (pytest.approx(0.01 * steps), False)
        assert curve.time_at(target, 1) == (pytest.approx(0.02 * steps), False)
        assert curve.time_at(target)[0] == pytest.approx(0.015 * steps)
    # Better than asked for by its roughest run, and not good enough by its finest.
    assert curve.time_at(0.1, 0) == (pytest.approx(0.5), False)
    assert curve.time_at(1e-9, 0) == (pytest.approx(100.0), True)
    assert [point.setting for point in curve.needed((1e-3, 1e-9))] == [50, 200, 800]
    assert power_curve([]).time_at(1e-3)[0] == math.inf


def test_a_finer_run_that_takes_less_counts():
    curve = power_curve([50, 200, 800])
    curve.points[0].times = [9.0, 9.0]
    assert curve.time_at(1e-3, 0) == (pytest.approx(2.0), False)
    assert curve.time_at(5e-3, 1) == (pytest.approx(4.0), False)
    curve.points[1].times = [14.0, 14.0]
    assert curve.time_at(1e-3, 1) == (pytest.approx((9.0 * 14.0) ** 0.5), False)
    curve.points[1].times = [50.0, 50.0]
    assert curve.time_at(1e-3, 1) == (pytest.approx(16.0), False)
    assert [point.setting for point in curve.needed((1e-3,))] == [800]


def test_rounds_interleave_forwards_and_backwards():
    order, seen = [], []
    tasks = [lambda k=k: order.append(k) or float(len(order)) for k in range(3)]
    results = in_rounds(tasks, 3, lambda *counts: seen.append(counts))
    assert order == [0, 1, 2, 2, 1, 0, 0, 1, 2]
    assert results == [[1.0, 6.0, 7.0], [2.0, 5.0, 8.0], [3.0, 4.0, 9.0]]
    assert seen == [(done, 9) for done in range(1, 10)]


@pytest.mark.parametrize('values, text', [
    ([3.0, 1.0, 2.0], '2 (1-3)'),
    ([1234.4, 1234.4], '1,234 (1,234-1,234)'),
    ([0.012345], '0.0123 (0.0123-0.0123)'),
    ([99.96], '100 (100-100)'),
    ([3e-7], '3.0e-07 (3.0e-07-3.0e-07)'),
])
def test_spread_as_text(values, text):
    assert Spread.of(values).text() == text


@pytest.fixture
def timed_twice(monkeypatch):
    """Short runs are repeated for their time's sake, and what is shown here is not a time."""
    monkeypatch.setattr(timing, '_MAX_REPEATS', 2)


def test_work_precision_from_end_to_end(tmp_path, timed_twice):
    said = []
    result = work_precision.measure(
        ['scipy'], rounds=2, size=SMALL, duration=0.02, longest_run=0.05, say=said.append)
    lines = work_precision_text = '\n'.join(report.work_precision_lines(result))
    assert 'SciPy DOP853, plain Numba' in lines and 'srkn6' in lines and any(said)
    assert 'below its order' not in lines and 'no motion' not in lines
    best = result.own_best(1e-6)
    assert best is not None and result.ratios(best, 1e-6) == Spread(1.0, 1.0, 1.0)
    assert 'ours' in work_precision_text
    points, targets, picture = report.write_work_precision(result, tmp_path)
    with open(points, newline='') as file:
        rows = list(csv.DictReader(file))
    assert {row['tool'] for row in rows} == {'icofabric_sim', 'scipy'}
    assert all(float(row['time_low_s']) <= float(row['time_s']) for row in rows)
    assert all(0.0 < float(row['error']) <= 0.3 for row in rows)
    with open(targets, newline='') as file:
        assert {'0.001', '1e-06', '1e-09'} == {row['error'] for row in csv.DictReader(file)}
    assert picture.read_bytes().startswith(b'\x89PNG')


def test_kinked_work_precision_from_end_to_end(tmp_path, timed_twice):
    result = work_precision.measure(
        ['scipy', 'mujoco'], rounds=1, size=SMALL, duration=0.02, longest_run=0.1,
        variant='kinked')
    lines = '\n'.join(report.work_precision_lines(result))
    assert 'S1 kinked' in lines and 'kinks located' in lines and 'MuJoCo' not in lines
    # Steps of one length lose their order, as they meet kinks anywhere.
    curves = {curve.solver.label: curve for curve in result.curves}
    assert curves['srkn8'].observed_order() < 4.5
    assert min(point.error for point in curves['dop8, tolerance'].points) < 1e-4
    names = [path.name for path in report.write_work_precision(result, tmp_path)]
    assert names[0] == 'work_precision_kinked.csv' and names[2] == 'work_precision_kinked.png'


def test_damped_work_precision_from_end_to_end(tmp_path, timed_twice):
    result = work_precision.measure(
        ['scipy', 'mujoco'], rounds=1, size=SMALL, duration=0.02, longest_run=5.0,
        variant='damped')
    lines = '\n'.join(report.work_precision_lines(result))
    assert 'S1 damped' in lines and 'plain Numba' in lines and 'MuJoCo' not in lines
    # Methods for forces without velocities take no part.
    points = {curve.solver.label: curve.points for curve in result.curves}
    assert not points['srkn6'] and min(point.error for point in points['dop8, tolerance']) < 1e-9
    paths = report.write_work_precision(result, tmp_path)
    assert [path.name for path in paths] == [
        f'work_precision_damped{end}' for end in ('.csv', '_targets.csv', '.png')]


def test_step_speed_from_end_to_end(tmp_path, monkeypatch):
    monkeypatch.setattr(step_speed, 'STEPS_BLOCK_S', 0.005)
    result = step_speed.measure([], rounds=2, size=SMALL)
    lines = '\n'.join(report.step_speed_lines(result))
    assert 'leapfrog' in lines and not result.remarks
    best = result.own_best()
    assert best is not None and result.ratios(best) == Spread(1.0, 1.0, 1.0)
    for row in result.rows:
        assert 0.0 < row.error < 1e-3 and len(row.times) == 2
    path, = report.write_step_speed(result, tmp_path)
    with open(path, newline='') as file:
        assert len(list(csv.DictReader(file))) == len(result.rows)


@pytest.mark.parametrize('words, told', [
    (['seconds'], "unknown measurement 'seconds'"),
    (['speed', '--peers', 'bullet'], "unknown peer 'bullet'"),
    (['speed', '--rounds', '0'], '--rounds must be at least 1'),
    (['scaling', '--largest', '5'], '--largest must be 63 to'),
])
def test_bad_input(words, told, capsys):
    assert main(['benchmark', *words]) == 2
    assert told in capsys.readouterr().err


def test_benchmarks_report_their_tables(tmp_path):
    path = tmp_path / 'speed.csv'
    path.write_text('who,bodies,ns\nours,63,1.5\n', 'utf-8')
    assert read_tables([path, tmp_path / 'picture.png']) == {
        'speed': [{'who': 'ours', 'bodies': 63, 'ns': 1.5}]}
