# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The same bits, however a run is cut into pieces and whenever it is looked at."""

from fabrics import loaded_fabric, same_state
import icofabric_sim as ico
import numpy as np
import pytest

FORCE, TORQUE = np.array([0.3, -1.1, 2.0]), np.array([0.002, 0.001, -0.003])


@pytest.mark.parametrize('step', [0.0, 1e-4])
def test_scheduled_wrench_gives_the_bits_of_one_applied_at_its_time(step):
    # A method without dense output: there a step that ends at a time gives the bits of one that
    # does not.
    changes = {'solver.step': step, 'solver.method': 'srkn6'}
    scheduled, stopped = (ico.compile_scene(loaded_fabric(changes)) for _ in range(2))
    times = [0.00313, 0.007, 0.0101]
    for index, time in enumerate(times):
        scheduled.apply_wrench('two', (1.0 + index) * FORCE, TORQUE, time=time)
    scheduled.apply_wrench('tip', 3.0 * FORCE, time=times[1])
    scheduled.advance_to(0.02)
    for index, time in enumerate(times):
        stopped.advance_to(time)
        stopped.apply_wrench('two', (1.0 + index) * FORCE, TORQUE)
        if index == 1:
            stopped.apply_wrench('tip', 3.0 * FORCE)
    stopped.advance_to(0.02)
    assert same_state(scheduled.snapshot(), stopped.snapshot())
    untouched = ico.compile_scene(loaded_fabric(changes))
    untouched.advance_to(times[0])
    before = ico.compile_scene(loaded_fabric(changes))
    before.apply_wrench('two', FORCE, time=times[0])
    before.advance_to(times[0])
    # Until it acts, nothing knows of it.
    assert same_state(before.snapshot(), untouched.snapshot())
    for simulation in (before, untouched):
        simulation.advance_to(0.02)
    assert not same_state(before.snapshot(), untouched.snapshot())


def test_wrench_that_changes_nothing_leaves_the_bits_alone():
    plain, repeated = (
        ico.compile_scene(loaded_fabric({'loads.tip.force': [1.0, 0.0, 0.0]})) for _ in range(2)
    )
    for time in (0.0, 0.0031, 0.0079):
        repeated.apply_wrench('tip', (1.0, 0.0, 0.0), time=time)
    repeated.apply_wrench('two', time=0.004)
    for simulation in (plain, repeated):
        simulation.advance_to(0.02)
    assert same_state(plain.snapshot(), repeated.snapshot())


def test_pieces_snapshots_and_random_output_times_give_the_same_bits():
    generator = np.random.default_rng(17)
    wrenches = [
        (float(t), name, generator.standard_normal((2, 3)) * [[3.0], [0.01]])
        for t in generator.uniform(0.0, 0.1, 12)
        for name in ('tip', 'two')
    ]

    def run(outputs, snapshots):
        simulation = ico.compile_scene(loaded_fabric())
        for time, name, (force, torque) in wrenches:
            simulation.apply_wrench(name, force, torque, time=time)
        seen = []
        for time in outputs:
            simulation.advance_to(time)
            if snapshots:
                seen.append(simulation.snapshot())
        return simulation, seen

    whole, _ = run([0.1], False)
    for pieces in (
        np.linspace(0.0, 0.1, 7),
        generator.uniform(0.0, 0.1, 300),
        np.arange(0.0, 0.1, 1e-4),
    ):
        other, seen = run([*np.sort(pieces), 0.1], True)
        assert same_state(whole.snapshot(), other.snapshot())
        assert other.status.step == whole.status.step
        assert other.status.step_count == whole.status.step_count
        # What a snapshot says does not depend on what was asked before it.
        middle = seen[len(seen) // 2]
        alone, _ = run([middle.time], False)
        assert same_state(alone.snapshot(), middle)
    assert whole.status.step_count > 100
    assert np.abs(whole.snapshot().position - whole.scene.initial.position).max() > 0.05


def test_snapshot_of_a_time_within_a_step_is_on_the_way():
    simulation = ico.compile_scene(loaded_fabric({'solver.step': 2e-4}))
    simulation.advance_to(1e-3)
    steps = simulation.status.step_count
    places = []
    for time in np.linspace(1e-3, 1.4e-3, 9):
        simulation.advance_to(time)
        places.append(simulation.snapshot().position[0])
    assert simulation.status.step_count <= steps + 2
    ways = np.diff(places, axis=0)
    # Evenly along a smooth path, none of them stuck at a step end.
    lengths = np.linalg.norm(ways, axis=1)
    assert lengths.min() > 0.5 * lengths.max() > 0.0
