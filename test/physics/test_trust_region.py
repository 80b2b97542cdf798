# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Steps of the trust region method on quadratic functions that are known."""

from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.statics.trust_region import steihaug
import numpy as np
import pytest

SHAPE = 6, 2 * LANES
SIZE = SHAPE[0] * SHAPE[1]


def make_problem(lowest, seed=1):
    """A symmetric matrix with eigenvalues from `lowest` to 10, weights, and a gradient."""
    random = np.random.default_rng(seed)
    basis = np.linalg.qr(random.standard_normal((SIZE, SIZE)))[0]
    matrix = basis @ np.diag(np.linspace(lowest, 10.0, SIZE)) @ basis.T
    weight = random.uniform(0.2, 3.0, SHAPE)
    weight[:, 3] = 0.0  # held
    gradient = random.standard_normal(SHAPE)
    return matrix, weight, gradient, basis


def times_of(matrix):
    def times(vector, product):
        product[:] = (matrix @ vector.ravel()).reshape(SHAPE)
    return times


def length_of(step, weight):
    free = weight > 0.0
    return np.sqrt((step[free]**2 / weight[free]).sum())


def change_of(matrix, gradient, step):
    vector = step.ravel()
    return gradient.ravel() @ vector + 0.5 * vector @ matrix @ vector


def test_the_minimum_within_a_wide_region():
    matrix, weight, gradient, _ = make_problem(0.5)
    found = steihaug(times_of(matrix), weight, gradient, 1e3, 1e-12, 500)
    free = (weight > 0.0).ravel()
    expected = np.zeros(SIZE)
    expected[free] = -np.linalg.solve(matrix[np.ix_(free, free)], gradient.ravel()[free])
    assert found.step.ravel() == pytest.approx(expected, abs=1e-9)
    assert not found.on_border and found.iterations < 200
    assert found.length == pytest.approx(length_of(found.step, weight), rel=1e-9)
    assert found.expected == pytest.approx(change_of(matrix, gradient, found.step), rel=1e-9)


@pytest.mark.parametrize('lowest', [0.5, 0.0, -2.0])
def test_the_border_of_a_narrow_one(lowest):
    matrix, weight, gradient, _ = make_problem(lowest)
    radius = 0.7
    found = steihaug(times_of(matrix), weight, gradient, radius, 1e-12, 500)
    assert found.on_border and not found.step[:, 3].any()
    assert length_of(found.step, weight) == pytest.approx(radius, rel=1e-9)
    assert found.length == pytest.approx(radius)
    assert found.expected == pytest.approx(change_of(matrix, gradient, found.step), rel=1e-9)
    # At least what steepest descent brings, to its minimum or to the border.
    downhill = -weight * gradient
    curvature = downhill.ravel() @ matrix @ downhill.ravel()
    most = radius / length_of(downhill, weight)
    along = -(gradient * downhill).sum() / curvature if curvature > 0.0 else most
    steepest = min(along, most) * downhill
    assert found.expected <= change_of(matrix, gradient, steepest) + 1e-12 < 0.0


def test_what_nothing_resists_and_nothing_pushes_is_never_entered():
    matrix, weight, gradient, basis = make_problem(0.0)
    weight[:] = 1.0
    flat = basis[:, 0]
    gradient = (gradient.ravel() - flat * (flat @ gradient.ravel())).reshape(SHAPE)
    found = steihaug(times_of(matrix), weight, gradient, 1e3, 1e-10, 500)
    assert not found.on_border
    assert abs(flat @ found.step.ravel()) < 1e-9 * np.linalg.norm(found.step)
    assert np.abs(matrix @ found.step.ravel() + gradient.ravel()).max() < 1e-7


def test_a_limit_of_products():
    matrix, weight, gradient, _ = make_problem(0.5)
    found = steihaug(times_of(matrix), weight, gradient, 1e3, 1e-12, 3)
    assert found.iterations == 3 and found.expected < 0.0
    still = steihaug(times_of(matrix), weight, np.zeros(SHAPE), 1.0, 0.1, 50)
    assert still.iterations == 0 and not still.step.any() and still.length == 0.0
