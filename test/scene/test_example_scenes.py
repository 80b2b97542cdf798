# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Every scene in config/ is an example that works.

It loads, moves, and keeps its energy; no two shells overlap by more than 1 % of a in two seconds.
"""

from pathlib import Path

from fabrics import changed, same_state
import icofabric_sim as ico
from icofabric_sim.parameters.example_scenes import example_scenes
import numpy as np
import pytest

SCENES = example_scenes()
# Those that take longer than a second until they have met, torn, or gone far.
SLOW = {'dropped_slab', 'torn_slab', 'twisted_column'}
# All; some of them, with kernels of their own, in `make test-long` only.
WITH_LONG = [pytest.param(name, marks=pytest.mark.long if name in {
    'auxetic_slab', 'charged_slab', 'draped_slab', 'hung_slab', 'pressed_slab', 'radial_arch',
    'squeezed_slab', 'tightened_slab', 'twisted_column'} else ()) for name in SCENES]
# How far each moves in its run, in pitches of its weave.
MOTION = {
    'hanging_slab': 2.0, 'free_slab': 0.2, 'bias_column': 2.0, 'pressed_slab': 0.3,
    'torn_slab': 5.0, 'shaken_slab': 0.2, 'hung_slab': 0.1, 'woven_ball': 0.4,
    'charged_slab': 0.3, 'twisted_column': 1.0, 'dropped_slab': 1.0, 'draped_slab': 1.0,
    'folded_slab': 1.0, 'squeezed_slab': 0.3, 'auxetic_slab': 0.4,
    'tightened_slab': 0.02}
# Where `always` is compiled in `make test` too: a splitting method, dop8, and contacts. A kind of
# scene with `always` takes the compiler a minute, so the others are for `make test-long`.
ALWAYS_COMPILED = {'free_slab', 'dropped_slab'}
# Those in which shells meet each other, planes, or held bodies.
TOUCHING = {'dropped_slab', 'draped_slab', 'folded_slab', 'squeezed_slab', 'tightened_slab'}


def test_the_scenes_of_the_readme_are_there():
    assert set(MOTION) <= set(SCENES)


def test_the_scene_of_the_push_of_2_newtons_is_kept():
    """It stands for itself: the example scene of that name may change."""
    scene = ico.load_scene(Path(__file__).parents[1] / 'scenes' / 'hanging_slab_wide.yaml')
    assert scene.body_count == 56 and scene.connector_count == 207
    assert scene.parameters['weave.connector_angle'] == 0.66
    assert scene.parameters['connector.stiffness'] == 2000.0
    assert set(scene.loads) == {'tip'} and set(scene.groups) == {'all', 'wall', 'tip'}


def test_scene_is_loaded_by_name_or_path(tmp_path, monkeypatch):
    by_name = ico.load_scene('hanging_slab')
    by_path = ico.load_scene(example_scenes()['hanging_slab'])
    assert by_name.parameters == by_path.parameters and by_name.body_count == 56
    # The name goes before a file that is called so.
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'hanging_slab').write_text('shell: {edge_length: 1.0}')
    assert ico.load_scene('hanging_slab').parameters == by_name.parameters
    with pytest.raises(ValueError, match=r'hanging_slob: there is no such parameter file .*'
                       r'did you mean hanging_slab\?'):
        ico.load_scene('hanging_slob')


@pytest.mark.parametrize('name', WITH_LONG)
def test_scene_moves_and_keeps_its_energy(name):
    scene, end = ico.load_scene(SCENES[name]), 2.0 if name in SLOW else 1.0
    simulation = ico.compile_scene(scene)
    start = simulation.snapshot()
    farthest, largest = 0.0, start.energy['kinetic']
    for time in np.linspace(0.05, end, round(20 * end)):
        simulation.advance_to(time)
        snapshot = simulation.snapshot()
        motion = np.linalg.norm(snapshot.position - start.position, axis=1).max()
        farthest = max(farthest, motion / scene.geometry.pitch)
        largest = max(largest, snapshot.energy['kinetic'])
    # Errors of 1e-6 a for each second, in connectors that stretch by 1e-2 a.
    drift = abs(snapshot.energy['balance_error'])
    assert drift < 1e-5 * largest
    # While next to nothing moves yet it is a part of next to nothing.
    assert simulation.balance.worst < 1e-4
    assert farthest > MOTION.get(name, 0.01)
    assert simulation.status.proximity is None
    assert (simulation.status.deepest_overlap > 0.0) == (name in TOUCHING)
    assert np.isfinite(snapshot.position).all()


@pytest.mark.parametrize('name', [
    pytest.param(name, marks=[] if name in ALWAYS_COMPILED else pytest.mark.long)
    for name in SCENES])
def test_auto_and_always_give_the_same_bits(name):
    scene = ico.load_scene(SCENES[name])
    chosen = ico.compile_scene(scene)
    solver = {'solver.method': chosen.status.method_name}
    if not ico.METHODS[chosen.status.method_name].adaptive:
        # Where contact is computed accuracy is measured with it, and steps may be others.
        solver['solver.step'] = chosen.status.step
    auto, always = (
        ico.compile_scene(changed(scene, {**solver, 'contact.mode': mode}))
        for mode in ('auto', 'always'))
    for time in (0.05, 0.4):
        for simulation in (auto, always):
            simulation.advance_to(time)
        one, other = auto.snapshot(), always.snapshot()
        assert same_state(one, other) and one.energy == other.energy
        assert auto.status.step_count == always.status.step_count
        assert auto.status.deepest_overlap == always.status.deepest_overlap
        assert auto.status.broken_count == always.status.broken_count
    moved = np.abs(one.position - scene.position).max()
    assert moved > 0.01 * scene.shell.half_edge
    # Beyond it, what `always` was there for: contacts, where the scene has any by then.
    assert (auto.status.deepest_overlap > 0.0) == (name in TOUCHING)


@pytest.mark.parametrize('name', WITH_LONG)
def test_every_load_channel_of_a_scene_moves_its_bodies(name):
    scene = ico.load_scene(SCENES[name])
    assert scene.loads
    for channel in scene.loads.values():
        pushed, still = ico.compile_scene(scene), ico.compile_scene(scene)
        pushed.apply_wrench(channel.name, force=(0.0, 0.1, 0.0))
        for simulation in (pushed, still):
            simulation.advance_to(0.05)
        moved = pushed.snapshot().position - still.snapshot().position
        assert np.abs(moved[channel.bodies]).max() > 1e-4 * scene.shell.half_edge


@pytest.mark.parametrize('angle, wider', [(-0.3, True), (0.3, False)])
def test_a_pulled_slab_grows_wider_where_its_connectors_are_short(angle, wider):
    """Lateral strains of the middle of `auxetic_slab`; the sign is that of the connector angle."""
    scene = ico.load_scene('auxetic_slab')
    assert scene.parameters['weave.connector_angle'] == -0.3
    scene = changed(scene, {'weave.connector_angle': angle})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(1.5)
    woven, pulled = scene.position, simulation.snapshot().position
    inner = np.abs(woven[:, 0] - woven[:, 0].mean()) < 1.1 * scene.geometry.pitch

    def extent(position, axis):
        sides = (inner & (np.abs(woven[:, axis] - end) < 1e-9)
                 for end in (woven[:, axis].max(), woven[:, axis].min()))
        upper, lower = (position[side, axis].mean() for side in sides)
        return upper - lower

    ends = [position[scene.groups['grip'], 0].mean() - position[scene.groups['wall'], 0].mean()
            for position in (woven, pulled)]
    along = ends[1] / ends[0] - 1.0
    across = np.array([extent(pulled, axis) / extent(woven, axis) - 1.0 for axis in (1, 2)])
    assert 0.04 < along < 0.1
    assert (np.abs(across) > 0.01).all() and ((across > 0.0) == wider).all()
    if wider:
        # docs/gallery.md.
        assert 100.0 * np.array([along, *across]) == pytest.approx([8.8, 2.7, 4.5], abs=0.06)
    assert simulation.status.deepest_overlap == 0.0 and not simulation.snapshot().obstructed.any()


@pytest.mark.long
def test_faces_and_pre_tension_bear_a_push_that_point_springs_do_not():
    """`tightened_slab`: docs/gallery.md has the displacements of its inner shells."""
    scene = ico.load_scene('tightened_slab')
    inner, moved = scene.groups['inner'], []
    for mode in ('auto', 'never'):
        simulation = ico.compile_scene(changed(scene, {'contact.mode': mode}))
        lowest = 0.0
        for time in np.linspace(0.1, 1.8, 18):
            simulation.advance_to(time)
            snapshot = simulation.snapshot()
            down = (snapshot.position - scene.position)[inner, 2].mean()
            lowest = min(lowest, float(down) / scene.geometry.pitch)
        moved.append(-lowest)
        assert not snapshot.obstructed.any()
        if mode == 'auto':
            assert 0.0 < simulation.status.deepest_overlap < 0.01 * scene.shell.half_edge
            assert len(simulation.status.touching()[0]) > 30
    assert moved == pytest.approx([0.023, 0.405], rel=0.05)
