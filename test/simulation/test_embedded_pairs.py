# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Order conditions of the tableaus of embedded pairs, and runs by the pair of order 5(4)."""

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.kernels import figures, monitor
from icofabric_sim.kernels.integrators import bodies, dop853, embedded
from icofabric_sim.kernels.integrators.embedded import DOP8
from icofabric_sim.kernels.integrators.tableau import pair_of, SLOPE_COUNT
from icofabric_sim.kernels.rhs import step_error
from icofabric_sim.kernels.runtime.compiled import in_python
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.simulation.model.layout import aligned_zeros
from icofabric_sim.simulation.stepping import tsit5
import numpy as np
import pytest

DAMPED = {
    'contact.mode': 'never', 'connector.damping': 0.02, 'initial_random.velocity_sigma': 0.1,
    'initial_random.spin_sigma': 2.0, 'initial_random.seed': 1}
TABLEAUS = {'dop8': (dop853.TABLEAU, 8), 'tsit5': (tsit5.TABLEAU, 5)}


def matrix_of(tableau):
    """Return the weights of all stages and of the end, (n + 1, n + 1)."""
    size = len(tableau.stages) + 1
    matrix = np.zeros((size, size))
    for target, row in zip(matrix, (*tableau.stages, tableau.step)):
        target[:len(row)] = row
    return matrix


def defects(matrix, weights, order):
    """Return errors in the order conditions of all trees of up to 5 nodes, and of quadrature."""
    ones = np.ones(len(matrix))
    nodes = matrix @ ones
    found = [weights @ nodes**(k - 1) - 1.0 / k for k in range(1, order + 1)]
    second = matrix @ nodes
    conditions = (
        (3, second, 6), (4, nodes * second, 8), (4, matrix @ nodes**2, 12),
        (4, matrix @ second, 24), (5, nodes**2 * second, 10), (5, second**2, 20),
        (5, nodes * (matrix @ nodes**2), 15), (5, nodes * (matrix @ second), 30),
        (5, matrix @ nodes**3, 20), (5, matrix @ (nodes * second), 40),
        (5, matrix @ (matrix @ nodes**2), 60), (5, matrix @ (matrix @ second), 120))
    return found + [weights @ tree - 1.0 / gamma for size, tree, gamma in conditions
                    if size <= order]


@pytest.mark.parametrize('name', TABLEAUS)
def test_step_meets_the_order_conditions(name):
    tableau, order = TABLEAUS[name]
    weights = np.append(tableau.step, 0.0)
    assert np.abs(defects(matrix_of(tableau), weights, order)).max() < 1e-13


def test_embedded_formulas_have_their_orders():
    for tableau, error, order in (
            (tsit5.TABLEAU, tsit5.TABLEAU.higher_error, 4),
            (dop853.TABLEAU, dop853.TABLEAU.higher_error, 5),
            (dop853.TABLEAU, dop853.TABLEAU.lower_error, 3)):
        matrix = matrix_of(tableau)
        weights, error = np.append(tableau.step, 0.0), np.append(error, 0.0)[:len(matrix)]
        # The sign of the difference of both formulas has no meaning.
        found = [np.abs(defects(matrix, weights + sign * error, order)).max()
                 for sign in (-1.0, 1.0)]
        assert min(found) < 1e-13
        assert np.abs(error).max() > 1e-3


@pytest.mark.parametrize('turn_rows', [4, 9])
def test_each_quantity_counts_by_its_scale_in_the_error_of_a_step(turn_rows):
    # Of position, orientation, velocity and spin; e5^2 / sqrt(e5^2 + 0.01 e3^2).
    generator, scales = np.random.default_rng(4), np.array([2.0, 3.0, 5.0, 7.0])
    higher, lower = generator.standard_normal((2, 13))
    ends = np.cumsum([0, 3, turn_rows, 3, 3])
    for scale, first, last in zip(scales, ends[:-1], ends[1:]):
        slopes = aligned_zeros((13, ends[-1], LANES))
        slopes[:, first:last] = generator.standard_normal((13, last - first, LANES))
        five, three = (
            scale * (np.tensordot(weights, slopes, 1)**2).sum(axis=0)
            for weights in (higher, lower))
        error, _ = step_error(slopes, turn_rows, higher, lower, scales, 1e300, 0)
        assert error == pytest.approx((five / np.sqrt(five + 0.01 * three)).max(), rel=1e-12)


def test_dense_output_has_order_4_within_a_step():
    tableau, matrix = tsit5.TABLEAU, matrix_of(tsit5.TABLEAU)
    step, first, last = np.append(tableau.step, 0.0), np.eye(7)[0], np.eye(7)[-1]
    nodes = matrix.sum(axis=1)
    for x in (0.2, 0.5, 0.9):
        # The cubic of Hermite in the slopes, and the polynomial that is added.
        weights = x * x * (3.0 - 2.0 * x) * step + x * (1.0 - x)**2 * first - (
            x * x * (1.0 - x) * last) + (x * (1.0 - x))**2 * np.array(tableau.dense[0])
        for k in range(1, 5):
            assert weights @ nodes**(k - 1) == pytest.approx(x**k / k, abs=1e-13)


def test_slots_hold_at_most_twelve_stages():
    tableau = tsit5.TABLEAU
    with pytest.raises(ValueError, match='at most 12 stages .* got 13 stages'):
        pair_of(tableau._replace(stages=tableau.stages + 7 * ((0.1,),)))
    pair = pair_of(tableau)
    assert pair.judges_end and not DOP8.judges_end
    assert pair.weights.shape == DOP8.weights.shape == (SLOPE_COUNT, SLOPE_COUNT)
    assert pair.kept_slots == (0, 1, 2, 3, 4, 5, 12) and len(DOP8.dense_slots) == 3


def test_damped_runs_keep_the_tolerance_also_between_steps():
    expected = {}
    for method, tolerance in (('dop8', 1e-9), *(('tsit5', 10.0**-k) for k in (2, 3, 4))):
        simulation = ico.compile_scene(make_scene((3, 3, 3), {
            **DAMPED, 'solver.method': method, 'solver.tolerance': tolerance}))
        for time in (0.0413, 0.1):
            simulation.advance_to(time)
            position = simulation.snapshot().position
            if method == 'dop8':
                expected[time] = position
                continue
            assert 0.0 < np.abs(position - expected[time]).max() / 0.01 < 0.1 * tolerance
            assert abs(simulation.balance.error) < tolerance * simulation.balance.scale


def test_refused_and_accepted_steps_give_the_same_bits_on_any_threads():
    states = []
    for threads, times in ((1, (0.05,)), (2, (0.05,)), (1, (0.0123, 0.0311, 0.05))):
        simulation = ico.compile_scene(make_scene((3, 3, 3), {
            **DAMPED, 'solver.method': 'tsit5', 'solver.tolerance': 1e-2,
            'solver.threads': threads}))
        for time in times:
            simulation.advance_to(time)
        states.append(simulation.snapshot().position.tobytes())
    assert states[0] == states[1] == states[2]


def test_shells_that_may_touch_are_refused():
    with pytest.raises(ParameterError, match='solver.method tsit5 .* take contact.mode never'):
        ico.compile_scene(make_scene((2, 2, 2), {
            'solver.method': 'tsit5', 'contact.mode': 'auto'}))


def test_steps_on_a_device_are_those_of_the_processor():
    pytest.importorskip('warp')
    changes = {**DAMPED, 'solver.method': 'tsit5', 'solver.tolerance': 1e-3}
    expected, simulation = (
        ico.compile_scene(make_scene((3, 3, 3), {**changes, 'solver.device': device}))
        for device in ('cpu', 'warp_cpu'))
    for time in (0.0113, 0.05):
        expected.advance_to(time)
        simulation.advance_to(time)
        assert simulation.status.step_count == expected.status.step_count > 5
        assert np.abs(
            simulation.snapshot().position - expected.snapshot().position).max() < 1e-13


def test_scenes_share_the_compiled_step_control():
    """Another term compiles its slopes and figures, and nothing else of the steps."""
    def steps_of(**changes):
        run = ico.compile_scene(make_scene((2, 2, 1), **{
            'solver.method': 'dop8'} | changes))
        run.advance_to(0.01)
        return run.status.step_count

    def counts():
        kernels = (
            embedded.adaptive_pair, bodies.slope_at, figures.note_figures, monitor.conclude)
        return [len(kernel.overloads) for kernel in kernels]

    assert steps_of(**{'drag.linear': 0.01}) > 0
    before = counts()
    assert steps_of(**{'drag.linear': 0.01, 'connector.twisting_stiffness': 0.02}) > 0
    control, slopes, sums, verdicts = np.array(counts()) - before
    assert control == verdicts == 0 and slopes == sums == 1
    before = counts()
    # Damping has no energy.
    assert steps_of(**{'drag.linear': 0.01, 'connector.damping': 0.02}) > 0
    assert (np.array(counts()) - before).tolist() == [0, 1, 0, 0]


def test_an_object_is_asked_in_place_of_bodies():
    """The step control runs in Python with the numbers of an object: here of two steps."""
    class Asked:
        def __init__(self):
            self.calls = []

        def __getattr__(self, name):
            def answer(*arguments):
                self.calls.append(name)
                return {'count_tests': 0, 'check_health': (0, 1)}.get(name)
            return answer

    asked = Asked()
    taken = in_python(embedded.fixed_pair)(asked, DOP8, 0.0, 0, 0.5, 2, 0, 9, np.zeros(0))
    assert taken == (0, 2, 1)
    assert asked.calls == [
        'count_tests', 'find_slope', 'repeat_count',
        *2 * ['try_step', 'accept_step', 'find_slope', 'check_health']]
