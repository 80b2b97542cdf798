# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The same motion wherever, however turned, in whatever numbering, units and output rates.

Units of powers of two change no mantissa, so no bit of a run may change. Another frame rounds
otherwise; what rounding adds grows as small displacements do, and how they grow is measured by a
companion of each run.
"""

from itertools import permutations, product

from contact_scenes import crowd, OBLIQUE
from fabrics import make_scene, RANDOM, same_state, STATE
import icofabric_sim as ico
from icofabric_sim.messages.topics import POSES
from icofabric_sim.running.runner import Runner
from moved_frames import apart, copied, displaced, Frame, rounding
import numpy as np
import pytest
from references import axes_of
from runner_helpers import ListSink, run, SCENE
from scipy.spatial.transform import Rotation

TILT = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
DRIFT, FAR = np.array([3.0, -2.0, 5.0]), np.array([0.7, -1.3, 0.4])
STILL = Frame()
FRAMES = {
    'turned': Frame(TILT), 'shifted': Frame(shift=FAR), 'carried along': Frame(boost=DRIFT),
    'all of it': Frame(TILT, FAR, DRIFT)}
KINKED = {'connector.stiffness_extension': 600.0, 'connector.stiffness_compression': 300.0}
BENT = {'connector.bending_stiffness': 0.05, 'connector.twisting_stiffness': 0.04}
WRAPPED = {'connector.obstruction': 'wrap', 'solver.method': 'leapfrog', 'solver.step': 1e-5}
DAMPED = {'connector.damping': 0.05, 'solver.method': 'dop8'}
# What a fabric has, and how long it is followed [s].
FREE = {
    'leapfrog': ({'solver.method': 'leapfrog', 'solver.step': 1e-4}, 0.05),
    'srkn4': ({'solver.method': 'srkn4', 'solver.step': 3e-4}, 0.05),
    'srkn6': ({'solver.method': 'srkn6'}, 0.05),
    'dop8': ({'solver.method': 'dop8'}, 0.05),
    'direction cosines': ({'solver.method': 'dop8'}, 0.05),
    'two stiffnesses': ({**KINKED, 'solver.method': 'dop8'}, 0.01),
    'moments': ({**BENT, 'solver.method': 'srkn6', 'solver.step': 2e-4}, 0.03),
    'damped': (DAMPED, 0.03),
    'around shells': (WRAPPED, 0.005)}


def followed(scene, state, end, form='quaternion'):
    """State at the end of a run from `state`, and the simulation."""
    simulation = ico.compile_scene(scene, rotation=form)
    simulation.set_state(**copied(state)._asdict())
    simulation.advance_to(end)
    return simulation.snapshot(), simulation


def growth_of(scene, state, end, last, form='quaternion'):
    """How many times farther a small displacement is at the end."""
    first = 1e-7
    near, simulation = followed(
        scene, displaced(state, first * scene.geometry.half_edge), end, form)
    growth = apart(near, last, simulation) / first
    assert growth > 0.5
    return growth


def errs_otherwise(simulation, growth):
    """
    How far a turned run of dop8 with quaternions may be, over a: each errs as it may.

    It asks for forces at quaternions within a step that are not of unit length, by as much as the
    step errs. What these make of an arm depends on the frame.
    """
    if simulation.status.method_name != 'dop8' or simulation.rotation != 'quaternion':
        return 0.0
    return 2.0 * simulation.scene.parameters['solver.tolerance'] * simulation.time * growth


def require_motion(scene, last, least=0.5):
    """Something moved, by a good part of a half edge."""
    way = np.linalg.norm(last.position - scene.initial.position, axis=1)
    assert way.max() > least * scene.geometry.half_edge


@pytest.mark.parametrize('name', FREE)
def test_a_free_fabric_moves_alike_in_every_frame(name):
    changes, end = FREE[name]
    form = 'direction_cosines' if name == 'direction cosines' else 'quaternion'
    scene = make_scene((4, 3, 2), {'solver.tolerance': 1e-9, **changes}, **RANDOM)
    last, _ = followed(scene, scene.initial, end, form)
    require_motion(scene, last, 0.2)
    growth = growth_of(scene, scene.initial, end, last, form)
    for where, frame in FRAMES.items():
        begin = frame.state(scene.initial)
        seen, other = followed(scene, begin, end, form)
        wanted = frame.state(last, end)
        found = apart(seen, wanted, other)
        allowed = rounding(other, growth, begin.position, wanted.position)
        if 'turned' in where or 'all' in where:
            allowed += errs_otherwise(other, growth)
        print(f'{name}, {where}: {found:.2g} of {allowed:.2g} after {other.status.step_count} '
              f'steps, growth {growth:.3g}')
        # Another place, and another rounding.
        assert apart(seen, last, other) > 1.0
        assert 0.0 < found < allowed < 1e-8


def loads_seen(turn):
    """All that acts on a fabric from outside, seen turned; wrenches in body axes stay."""
    def of(*vector):
        return (turn @ np.array(vector)).tolist()

    return {
        'gravity': of(1.0, -2.0, -9.81), 'field.electric': of(0.0, 3e5, 1e5),
        'field.magnetic': of(200.0, 0.0, 300.0), 'charge.per_body': 2e-6,
        'charge.dipole': [1e-7, 0.0, 2e-7], 'drag.linear': 2e-3, 'drag.angular': 3e-7,
        'groups.tip': 'ids 1', 'loads.tip.group': 'tip', 'loads.tip.frame': 'body',
        'loads.tip.point': [0.004, -0.007, 0.011], 'loads.tip.force': [1.5, -0.7, 2.0],
        'groups.others': 'ids 0 2', 'loads.steady.group': 'others',
        'loads.steady.share': 'total', 'loads.steady.force': of(-2.0, 0.4, 1.0),
        'loads.steady.torque': of(0.0, -0.008, 0.002),
        'anchors.hook.body': 3, 'anchors.hook.edge': 'up',
        'anchors.hook.position': of(0.03, 0.03, 0.18),
        'tractions.air.group': 'tip', 'tractions.air.faces': 'all',
        'tractions.air.pressure': 300.0, 'tractions.air.variation': '1 0.5 0.2',
        'connector.damping': 0.05, 'solver.method': 'dop8'}


@pytest.mark.long
def test_a_loaded_fabric_moves_alike_turned_with_its_loads():
    end, frame = 0.03, Frame(TILT)
    scene, turned = (make_scene((3, 3, 2), loads_seen(turn), **RANDOM)
                     for turn in (np.eye(3), TILT))
    last, _ = followed(scene, scene.initial, end)
    require_motion(scene, last)
    growth = growth_of(scene, scene.initial, end, last)
    seen, other = followed(turned, frame.state(scene.initial), end)
    wanted = frame.state(last)
    found = apart(seen, wanted, other)
    allowed = rounding(other, growth, seen.position) + errs_otherwise(other, growth)
    print(f'{found:.2g} of {allowed:.2g}, growth {growth:.3g}')
    assert 0.0 < found < allowed
    # Loads that stay where they were are others.
    elsewhere, _ = followed(scene, frame.state(scene.initial), end)
    assert apart(elsewhere, wanted, other) > 0.1
    for name, value in last.energy.items():
        size = max(abs(last.energy['kinetic']), abs(value))
        assert seen.energy[name] == pytest.approx(value, rel=0, abs=1e-9 * size)


def images_of_the_cube():
    """The 48 maps of a cube to itself; half of them are mirrors."""
    return [np.eye(3)[list(order)] * np.array(signs)[:, None]
            for order in permutations(range(3)) for signs in product((1.0, -1.0), repeat=3)]


def connector_ends(scene, turn=STILL.turn, shift=0.0):
    """Points between which connectors lie at rest, sorted, in units of 1e-9 m."""
    connectors, axes = scene.connectors, axes_of(scene.orientation)
    ends = scene.position[connectors.bodies] + np.einsum(
        'cej,ceji->cei', connectors.points_body, axes[connectors.bodies])
    rounded = np.rint(1e9 * (ends @ turn.T + shift)).astype(np.int64)
    return sorted(tuple(sorted(map(tuple, pair))) for pair in rounded.tolist())


def image(scene, turn, **changes):
    """The slab that is the image of a slab: its scene, the order of its bodies, the frame."""
    size = np.abs(turn) @ np.array(scene.weave.size)
    for variant in range(4):
        other = make_scene(
            [int(n) for n in size], {**changes, 'weave.variant': variant}, **RANDOM)
        if other.body_count != scene.body_count:
            continue
        shift = other.position.mean(axis=0) - turn @ scene.position.mean(axis=0)
        frame = Frame(turn, shift)
        way = np.linalg.norm(
            (scene.position @ turn.T + shift)[None] - other.position[:, None], axis=2)
        order = way.argmin(axis=1)
        if way.min(axis=1).max() < 1e-9 and (
                connector_ends(other) == connector_ends(scene, turn, shift)):
            return other, order, frame
    raise AssertionError('the image of a slab is no slab')


def test_each_image_of_a_slab_under_the_48_maps_of_the_cube_is_a_slab_that_moves_alike():
    changes, end = {'solver.method': 'srkn6', 'solver.step': 2e-4}, 0.04
    scene = make_scene((4, 3, 2), changes, **RANDOM)
    last, _ = followed(scene, scene.initial, end)
    require_motion(scene, last)
    growth = growth_of(scene, scene.initial, end, last)
    variants, worst, renumbered = [], 0.0, 0
    for turn in images_of_the_cube():
        other, order, frame = image(scene, turn, **changes)
        # A body of the image is woven in its own orientation: the shell is its own image.
        wanted = seen_as_woven(scene, other, order, frame, last)
        seen, simulation = followed(
            other, seen_as_woven(scene, other, order, frame, scene.initial), end)
        found = apart(seen, wanted, simulation)
        allowed = rounding(simulation, growth, seen.position)
        assert found < allowed
        variants.append(other.weave.variant)
        renumbered += not np.array_equal(order, np.arange(len(order)))
        worst = max(worst, found)
    print(f'{worst:.2g} of {allowed:.2g}, growth {growth:.3g}')
    assert worst > 0.0 and renumbered > 40
    assert [variants.count(variant) for variant in range(4)] == [12, 12, 12, 12]


def seen_as_woven(scene, other, order, frame, state):
    """
    A state of a slab as one of its image, whose bodies are woven turned otherwise.

    The image of a shell is a shell, in an orientation that differs from that in which the image
    is woven by a map that takes the shell and its named edges to themselves.
    """
    hand = np.sign(np.linalg.det(frame.turn))
    first, last = (axes_of(one.orientation)[0].T for one in (scene, other))
    own = first.T @ frame.turn.T @ last  # body axes of `other` to those of `scene`
    axes = frame.turn @ Rotation.from_quat(state.orientation).as_matrix() @ own
    return copied(state)._replace(
        position=(state.position @ frame.turn.T + frame.shift)[order],
        orientation=Rotation.from_matrix(axes[order]).as_quat(),
        linear_velocity=(state.linear_velocity @ frame.turn.T)[order],
        angular_velocity=(hand * state.angular_velocity @ frame.turn.T)[order])


@pytest.mark.parametrize('how', ['turned', 'mirrored', 'renumbered'])
def test_a_crowd_that_collides_moves_alike(how):
    end = 0.05
    scene = crowd()
    last, first = followed(scene, scene.initial, end)
    assert first.status.deepest_overlap > 0.0
    require_motion(scene, last)
    growth = growth_of(scene, scene.initial, end, last)
    frame, order = Frame(), np.arange(scene.body_count)
    if how == 'renumbered':
        order = np.random.default_rng(8).permutation(scene.body_count)
    else:
        frame = Frame(TILT @ np.diag([-1.0 if how == 'mirrored' else 1.0, 1.0, 1.0]))
    begin, wanted = (
        type(seen)(*(values[order] for values in seen))
        for seen in (frame.state(scene.initial), frame.state(last)))
    seen, other = followed(scene, begin, end)
    found = apart(seen, wanted, other)
    # Also renumbered: whether a step is refused where a contact begins depends on last bits.
    allowed = rounding(other, growth, seen.position) + errs_otherwise(other, growth)
    print(f'{how}: {found:.2g} of {allowed:.2g}, growth {growth:.3g}')
    assert apart(seen, last, other) > 1.0
    assert 0.0 < found < allowed
    # Seen at the ends of steps.
    assert other.status.deepest_overlap == pytest.approx(
        first.status.deepest_overlap, rel=0.1)


# What parameters are measured in: powers of length, mass and time. Charges keep their unit.
UNITS = {
    'shell.edge_length': (1, 0, 0), 'shell.thickness': (1, 0, 0), 'shell.mass': (0, 1, 0),
    'connector.stiffness': (0, 1, -2), 'connector.stiffness_extension': (0, 1, -2),
    'connector.stiffness_compression': (0, 1, -2), 'connector.damping': (0, 1, -1),
    'connector.maxwell_stiffness': (0, 1, -2), 'connector.maxwell_time': (0, 0, 1),
    'connector.natural_length': (1, 0, 0), 'connector.break_length_extension': (1, 0, 0),
    'connector.bending_stiffness': (2, 1, -2), 'connector.twisting_stiffness': (2, 1, -2),
    'weave.connector_length': (1, 0, 0), 'gravity': (1, 0, -2), 'drag.linear': (0, 1, -1),
    'drag.angular': (2, 1, -1), 'initial_random.velocity_sigma': (1, 0, -1),
    'initial_random.spin_sigma': (0, 0, -1), 'solver.tolerance': (0, 0, -1),
    'solver.step': (0, 0, 1), 'publish_rate': (0, 0, -1), 'marker_rate': (0, 0, -1),
    'clock_rate': (0, 0, -1), 'contact.stiffness': (0, 1, -2), 'contact.damping': (-1, 0, 1),
    'bodies.b0.position': (1, 0, 0), 'bodies.b0.linear_velocity': (1, 0, -1),
    'bodies.b0.angular_velocity': (0, 0, -1), 'planes.floor.offset': (1, 0, 0),
    'field.electric': (1, 1, -2), 'field.magnetic': (0, 1, -1), 'charge.dipole': (1, 0, 0),
    'charge.per_body': (0, 0, 0), 'loads.tip.point': (1, 0, 0), 'loads.tip.force': (1, 1, -2),
    'loads.steady.force': (1, 1, -2), 'loads.steady.torque': (2, 1, -2),
    'anchors.hook.position': (1, 0, 0), 'tractions.air.pressure': (-1, 1, -2)}
SHELL = {
    'shell.edge_length': 0.02, 'shell.thickness': 0.002, 'shell.mass': 0.011,
    'connector.stiffness': 500.0, 'solver.tolerance': 1e-6, 'publish_rate': 60.0,
    'marker_rate': 10.0, 'clock_rate': 100.0}
WOVEN = {
    **SHELL, 'weave.size': [3, 3, 2], 'contact.mode': 'never',
    'initial_random.velocity_sigma': 0.5, 'initial_random.spin_sigma': 60.0,
    'initial_random.seed': 1}
RELAXING = {'connector.maxwell_stiffness': 400.0, 'connector.maxwell_time': 1e-3}
TORN = {**DAMPED, 'connector.break_length_extension': 0.0345}
LOOSE = {
    **SHELL, 'weave.size': [1, 1, 1], 'weave.connected': False, 'contact.mode': 'auto',
    'contact.stiffness': 2e5, 'contact.damping': 0.5, 'contact.friction': 0.6,
    'bodies.b0.position': list(OBLIQUE[0]), 'bodies.b0.linear_velocity': list(OBLIQUE[1]),
    'bodies.b0.angular_velocity': list(OBLIQUE[2])}
SCENES = {
    **{method: ({**WOVEN, 'solver.method': method}, 0.02)
       for method in ('leapfrog', 'srkn4', 'srkn6', 'srkn8', 'dop8')},
    **{f'{method}, given step': ({**WOVEN, 'solver.method': method, 'solver.step': 2e-4}, 0.02)
       for method in ('leapfrog', 'srkn4', 'srkn6', 'srkn8', 'dop8')},
    'two stiffnesses': ({**WOVEN, **KINKED, 'solver.method': 'dop8'}, 0.02),
    'two stiffnesses, srkn4': ({**WOVEN, **KINKED, 'solver.method': 'srkn4'}, 0.02),
    'moments': ({**WOVEN, **BENT, 'solver.method': 'srkn6'}, 0.02),
    'damped, relaxing, breaking': ({**WOVEN, **RELAXING, **TORN}, 0.01),
    'loaded': ({**WOVEN, **loads_seen(np.eye(3))}, 0.02),
    'around shells': ({**WOVEN, **WRAPPED}, 0.005),
    'touching': ({**LOOSE, 'solver.method': 'dop8'}, 0.05),
    'touching, leapfrog': ({**LOOSE, 'solver.method': 'leapfrog', 'solver.step': 5e-6}, 0.05)}
# Units of length, mass and time; of mass powers of four, since the largest frequency, which chosen
# steps follow, is computed from roots of the mass.
SCALES = [(2.0, 1.0, 1.0), (1.0, 4.0, 1.0), (1.0, 1.0, 2.0), (2.0**7, 2.0**-14, 2.0**-9)]


def in_units(flat, length, mass, time):
    """The scene in units that are so many times as small."""
    result = {'weave.size': flat['weave.size']}
    for name, value in flat.items():
        powers = UNITS.get(name)
        if powers is None:
            assert not isinstance(value, float) or name == 'contact.friction', name
            result[name] = value
            continue
        factor = length**powers[0] * mass**powers[1] * time**powers[2]
        result[name] = (
            [factor * x for x in value] if isinstance(value, list) else factor * value)
    return ico.Scene.from_parameters(result)


@pytest.mark.parametrize('name', SCENES)
def test_units_of_powers_of_two_change_no_bit(name):
    flat, end = SCENES[name]
    runs = []
    for length, mass, time in [(1.0, 1.0, 1.0), *SCALES]:
        scene = in_units(flat, length, mass, time)
        simulation = ico.compile_scene(scene)
        simulation.advance_to(0.3 * end * time)
        simulation.advance_to(end * time)
        snapshot = simulation.snapshot()
        units = {'position': length, 'orientation': 1.0, 'linear_velocity': length / time,
                 'angular_velocity': 1.0 / time}
        joule = mass * (length / time) ** 2
        runs.append([
            *(getattr(snapshot, one) / units[one] for one in STATE), snapshot.break_time / time,
            np.array([value / joule for value in snapshot.energy.values()]),
            np.array([simulation.error_estimate, simulation.status.step_count,
                      simulation.status.step / time, simulation.status.contact_tests])])
        moved = np.abs(snapshot.position - scene.initial.position).max() / length
        assert moved > 0.002
    if 'breaking' in name:
        assert 0 < np.isfinite(runs[0][4]).sum() < scene.connector_count
    if 'touching' in name:
        assert simulation.status.deepest_overlap > 0.0
    for other, scale in zip(runs[1:], SCALES):
        for values, wanted in zip(other, runs[0]):
            np.testing.assert_array_equal(values, wanted, err_msg=f'{name} {scale}')


@pytest.mark.parametrize('method', ['leapfrog', 'srkn6', 'dop8'])
def test_given_steps_have_the_same_bits_at_twice_the_mass(method):
    flat = {**WOVEN, 'solver.method': method, 'solver.step': 2e-4}
    first, second = (ico.compile_scene(in_units(flat, 1.0, mass, 1.0)) for mass in (1.0, 2.0))
    for simulation in (first, second):
        simulation.advance_to(0.02)
    require_motion(first.scene, first.snapshot())
    assert same_state(first.snapshot(), second.snapshot())
    assert second.scene.shell.mass == 2.0 * first.scene.shell.mass


def test_output_rates_change_no_bit():
    ends, counts = [], []
    for rate in (7.0, 60.0, 1000.0):
        scene = ico.Scene.from_parameters(
            {**SCENE, **RANDOM, 'publish_rate': rate, 'marker_rate': 0.7 * rate})
        sink = ListSink(POSES)
        runner = run(Runner(ico.compile_scene(scene), [sink]))
        ends.append(runner.simulation.snapshot())
        counts.append(len(sink.of(POSES)))
    require_motion(scene, ends[0])
    assert counts[0] < counts[1] < counts[2]
    for other in ends[1:]:
        assert other.time == ends[0].time and same_state(ends[0], other)
