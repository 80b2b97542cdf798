# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Steps are cut into short calls, by the clock; the bits of a run are the same wherever they are cut.
"""

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.kernels.flows import place_all
from icofabric_sim.simulation.model.lanczos import Lanczos, start_vector
from icofabric_sim.simulation.stepping import method_calls
from icofabric_sim.simulation.stepping.portions import Portions
import numpy as np
import pytest

MOVING = {'initial_random.velocity_sigma': 0.5, 'initial_random.spin_sigma': 20.0}


def run(monkeypatch, changes, count):
    """Bits of a run whose calls take `count` steps, and how many calls there were."""
    with monkeypatch.context() as patch:
        calls, note = [], Portions.note
        patch.setattr(Portions, 'note', lambda self, steps, seconds: calls.append(steps))
        patch.setattr(method_calls, 'Portions', lambda work: fixed(count))
        simulation = ico.compile_scene(make_scene((3, 3, 3), {**MOVING, **changes}))
        simulation.advance_to(0.05)
        snapshot = simulation.snapshot()
        assert note is not Portions.note
    values = np.concatenate([
        part.ravel() for part in (snapshot.position, snapshot.orientation,
                                  snapshot.linear_velocity, snapshot.angular_velocity)])
    return values.tobytes(), simulation.status.step_count, simulation.error_estimate, len(calls)


def fixed(count):
    portions = Portions(1)
    portions.count = count
    return portions


@pytest.mark.parametrize('changes', [
    {'solver.method': 'leapfrog', 'solver.tolerance': 1e-3},
    {'solver.method': 'dop8', 'solver.step': 5e-4}, {'solver.method': 'dop8'}],
    ids=['splitting', 'fixed pair', 'adaptive pair'])
def test_bits_do_not_depend_on_where_calls_end(monkeypatch, changes):
    *bits, few = run(monkeypatch, changes, 10**9)
    *others, many = run(monkeypatch, changes, 1)
    assert bits == others
    assert bits[1] > 20 and many > 1.5 * few


@pytest.mark.parametrize('count', [1, 7, 100, 10**9])
def test_checkpoints_do_not_depend_on_where_calls_end(monkeypatch, count):
    """Nothing touches in this run, and the stretch that would be judged begins at a check."""
    monkeypatch.setattr(Portions, 'note', lambda self, steps, seconds: None)
    monkeypatch.setattr(method_calls, 'Portions', lambda work: fixed(count))
    simulation = ico.compile_scene(make_scene((3, 3, 3), {
        'initial_random.velocity_sigma': 1e-3, 'contact.mode': 'auto',
        'solver.method': 'srkn6', 'solver.step': 1e-4}))
    simulation.advance_to(0.0303)
    driver = simulation._driver
    assert 0 < driver.monitor.since_check
    assert driver.errors.touching.state_tree()['start'] == driver.trajectory.saved_time > 0.029


def test_calls_follow_the_pace():
    portions = Portions(50)
    assert portions.count == 2000
    # A hundred steps in a second: three in 30 ms.
    portions.note(100, 1.0)
    assert portions.count == 3
    portions.note(3, 3e-6)
    assert portions.count == 30_000
    for steps, seconds in ((0, 10.0), (1, 10.0)):
        portions.note(steps, seconds)
        assert portions.count == 1
    portions.note(5, 0.0)
    assert portions.count == 1


def test_a_run_learns_its_pace():
    simulation = ico.compile_scene(make_scene((3, 3, 3), {
        **MOVING, 'solver.method': 'leapfrog'}))
    portions = simulation._driver.calls.portions
    portions.count = 10**12
    simulation.advance_steps(1)
    assert 1 <= portions.count < 10**12


def test_lanczos_iterations_are_the_same_wherever_they_are_cut(monkeypatch):
    scene = make_scene((3, 3, 3), {**MOVING, 'solver.method': 'leapfrog'})
    packed = ico.compile_scene(scene).packed
    state, start = packed.layout.pack(scene.initial), start_vector(packed.layout, None)
    found, calls = [], []
    monkeypatch.setattr(Portions, 'note', lambda self, steps, seconds: calls.append(steps))
    for count in (10**9, 1, 7):
        calls.clear()
        work = packed.layout.room(packed.model.links)
        place_all(packed.model, state, work, 0, len(packed.model.blocks.slot))
        run = Lanczos(packed.model, state, work, start, 40)
        run._portions.count = count
        run.go_on(40)
        shape = run.combine(start, np.linspace(1.0, 2.0, 40)[:, None])
        assert len(calls) == 2 * -(-40 // count)
        found.append((run.matrix.diagonal.tobytes(), run.matrix.off.tobytes(), shape.tobytes()))
    assert found[0] == found[1] == found[2]
    assert run.matrix.off.min() > 0.0
