# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Every public function refuses what makes no sense, in one line, and changes nothing.

The table lists each function and method with good arguments; what is bad follows from the kind of
each argument. A public name without an entry fails, so does an argument without one.
"""
import inspect
import math
import types

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim import contact, messages
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.simulation import simulation as simulation_module
from icofabric_sim.statics import equilibrium, modes, periodic
import numpy as np
import pytest

try:
    from mpi4py import MPI
except ImportError:  # an extra
    MPI = None

# Functions that the documentation names beside what is exported.
NAMED_IN_DOCS = [periodic.band_path, periodic.sample_zone]
WORLD = 'world'


class Other:
    """A class that nothing knows."""


NAN, INF = math.nan, math.inf
NO_TEXT = [None, 3, 0.5, True, b'x', [], ['x'], {}, Other(), NAN]
NO_OBJECT = ['x', '', None, 3, NAN, -1.0, True, [], {}, np.zeros(3), Other(), Other]
NO_FUNCTION = ['x', 3, NAN, True, [], {}, np.zeros(3), Other()]
NO_FLAG = ['x', '', 0, 1, 0.5, NAN, [], np.ones(2, bool), Other()]
NO_INTEGER = ['x', '1', True, np.True_, 1.0, 1.5, NAN, INF, [], [1], np.zeros(2), 1j, Other()]
NO_NUMBER = [
    'x', '1', '', b'1', True, np.True_, [], [1.0], {}, (1.0,), np.ones(2), 1j, NAN, INF, -INF,
    np.float64(NAN), 10**400, Other(), np.str_('1')]
NO_PATH = ['', 'a\0b', 3, True, NAN, b'x', [], {}, Other()]


class Argument:
    """Good values, the first of which serves while other arguments are tried, and bad ones."""

    def __init__(self, good, bad, *, says=None):
        self.good, self.bad, self.says = good, bad, says


def number(*good, bad=(), optional=False, says=None):
    return Argument(list(good), [*NO_NUMBER, *bad, *([] if optional else [None])], says=says)


def integer(*good, bad=(), optional=False, says=None):
    return Argument(list(good), [*NO_INTEGER, *bad, *([] if optional else [None])], says=says)


def positive(*good, bad=()):
    return number(*good, bad=[0.0, -1.0, -3, *bad])


def from_zero(*good):
    return number(*good, bad=[-1.0, -3, -1e-300])


def text(*good, bad=(), optional=False, says=None):
    return Argument(list(good), [
        *(value for value in NO_TEXT if value is not None or not optional), *bad], says=says)


def some(kind, *good, optional=False, says=None):
    bad = [value for value in NO_OBJECT if not isinstance(value, kind)]
    return Argument(list(good), bad if not optional else [
        value for value in bad if value is not None], says=says)


def function(*good, optional=False, says=None):
    return Argument(list(good), [*NO_FUNCTION, *([] if optional else [None])], says=says)


def flag(*good, optional=False):
    return Argument(list(good), [*NO_FLAG, *([] if optional else [None])])


def array(*good, bad=(), optional=False, any_length=False):
    """The first good value is an array; those of other types and shapes follow from it."""
    first = np.array(good[0], float)
    wrong = first.copy()
    wrong.flat[-1] = NAN
    endless = first.copy()
    endless.flat[0] = -INF
    texts, booleans, objects = first.astype(str), np.ones(first.shape, bool), first.astype(object)
    objects.flat[-1] = None
    mixed = first.tolist()
    last = mixed
    while isinstance(last[-1], list):
        last = last[-1]
    last[-1] = True
    cut = first[..., None] if any_length else first[..., :-1]
    ragged = [[1.0, 2.0], [1.0]]
    return Argument(list(good), [
        'x', 'abc', b'abc', True, NAN, 3.0, [], {}, {1.0, 2.0}, Other(), wrong, endless, texts,
        texts.tolist(), booleans, booleans.tolist(), objects, objects.tolist(), mixed, cut,
        cut.tolist(), ragged, np.zeros((2, *first.shape, 2)), first.astype(complex),
        np.zeros(0), *bad, *([] if optional else [None])])


def path(*good, optional=False, says='path'):
    return Argument(list(good), [*NO_PATH, *([] if optional else [None])], says=says)


SECTIONS = {
    'shell': {'edge_length': 0.02},
    'groups': {'tip': 'x_max', 'wall': 'x_min'},
    'loads': {'tip': {'group': 'tip'}},
    'drives': {'wall': {'group': 'wall', 'motion': 'hold'}},
    'planes': {'floor': {'normal': [0.0, 0.0, 1.0], 'offset': -10.0, 'motion': 'hold'}},
}


@pytest.fixture(scope='module')
def things(tmp_path_factory):
    """One small scene, compiled once, and what comes of it."""
    folder = tmp_path_factory.mktemp('things')
    scene = make_scene((3, 2, 2), **SECTIONS)
    simulation = ico.compile_scene(scene)
    simulation.apply_wrench('tip', force=(0, 0, 1), torque=[0, 0, np.float32(1e-3)])
    simulation.advance_to(1e-3)
    (folder / 'scene.yaml').write_text('/**: {ros__parameters: {weave.size: [2, 2, 2]}}\n')
    simulation.checkpoint().save(folder / 'a.checkpoint')
    force = ico.BodyForce(still, compiled=False)
    return types.SimpleNamespace(
        poses=messages.PoseArrayBytes(WORLD, 2),
        array=messages.Float64MultiArrayBytes(['a', 'b'], [2, 3]),
        marker=messages.MarkerBytes(WORLD, 'a', 1, messages.MarkerType.LINE_LIST),
        external=force.prepare(simulation.packed.layout, np.ones((scene.body_count, 13))),
        folder=folder, scene=scene, simulation=simulation,
        other=ico.compile_scene(scene), checkpoint=simulation.checkpoint(),
        snapshot=simulation.snapshot(), elasticity=ico.homogenise(scene),
        rest=ico.solve_equilibrium(scene), spectrum=ico.solve_modes(scene), force=force,
        growth=ico.Growth(np.array([0.0, 1.0]), np.ones(2), np.zeros(2), False, ''))


def still(time, position, orientation, linear_velocity, angular_velocity):
    return np.zeros_like(position), np.zeros_like(position)


def gust(face, xi, eta, time):
    return np.zeros((len(xi), 3))


def uniform(points):
    return np.full(len(points), 1000.0)


def fill(numbers):
    numbers[:] = 0.0


HOME = (np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
AWAY = ([0, 0, 0.03], [0, 0, 0, 1])
NO_POSE = [
    'x', None, 3, True, NAN, [], (HOME[0],), (HOME[0], HOME[1], 0), (HOME[1], HOME[0]),
    (HOME[0], np.zeros(4)), (HOME[0], [0, 0, 0, NAN]), ([0, 0, NAN], HOME[1]), ('abc', HOME[1]),
    ([True, 0, 0], HOME[1]), (HOME[0], [0.0, 0.0, 0.0, 2.0]), (None, None), ([[1, 2, 3], [1]], 1),
    (np.zeros((2, 3)), np.zeros((3, 4))), Other()]
STATUS = messages.DiagnosticStatus(messages.OK, 'a', 'b', 'c', {'d': 'e'})


def table(t):
    """Callable, and its arguments in order, by name."""
    n = t.scene.body_count
    scene = some(ico.Scene, t.scene, says='load_scene')
    snapshot = Argument(
        [None, t.snapshot], [
            'x', 3, True, NAN, [], {}, Other(), t.scene, t.simulation,
            ico.compile_scene(make_scene((2, 2, 2), **SECTIONS)).snapshot()])
    time = number(0.5, 2, np.int64(1), bad=[-1.0], optional=True)
    later = number(None, 5, np.float32(7.5), bad=[0.0, -1], optional=True)
    vector = array((0.0, 0.0, 1e-3), [0, 0, np.int64(0)], np.zeros(3, np.float32))
    step_count = integer(500, np.int64(300), bad=[-1])
    tolerance = number(1e-6, np.float64(1e-5), bad=[0.0, 1.0, -1e-6])
    pose = Argument([HOME, AWAY], NO_POSE)
    density = positive(1000.0, 1000, np.int64(1000))
    edge, thickness = positive(0.02, 1), positive(0.002, np.float64(0.003), bad=[1.0, 1e-30])
    override = number(None, 0, 0.5, np.int64(1), bad=[-1.0], optional=True)
    positions, velocities = t.snapshot.position, t.snapshot.linear_velocity
    turned = t.snapshot.orientation
    nanoseconds = integer(5, np.int64(7), bad=[-1, 2**31 * 10**9])
    frame = text(WORLD, '', bad=['a\0b', '\ud800'])
    marker_words = {
        'frame_id': frame, 'namespace': frame,
        'marker_id': integer(1, np.int32(2), bad=[2**31, -2**40]),
        'marker_type': integer(messages.MarkerType.LINE_LIST, 11, bad=[0, -5]),
        'color': array((0.0, 1.0, 0.5, 1.0), [0, 0, 1, 1], bad=[(0, 0, 0, 1.5), (0, 0, 0, -1)]),
        'scale': array((0.01, 0.0, 0.0), (1, 1, 1), bad=[(1, 1, -1)], optional=True)}
    velocity = array(velocities, None, optional=True)
    state = {'position': array(positions, positions.tolist(), None, optional=True),
             'orientation': array(
                 turned, None, bad=[np.zeros((n, 4)), np.full((n, 4), 0.7)], optional=True),
             'linear_velocity': velocity, 'angular_velocity': velocity}
    statics = {
        'start': snapshot, 'time': time, 'tolerance': tolerance, 'largest_step_count': step_count}
    branch = Argument([None, 'pull', 'push'], ['', 'pulls', *NO_TEXT[1:]])
    body_force = {'body_force': function(None, optional=True)}
    progress = {'progress': function(None, lambda found: None, optional=True)}
    simulation, force, checkpoint = t.simulation, t.force, t.checkpoint
    return {
        'BodyForce': (ico.BodyForce, {
            'force': function(still), 'potential': function(
                None, lambda time, x, q: 0.0, optional=True),
            'compiled': flag(None, True, False, optional=True)}),
        'BodyForce.prepare': (force.prepare, {
            'layout': Argument([simulation.packed.layout], NO_OBJECT),
            'numbers': array(np.ones((n, 13))), 'time': number(0.0, 1)}),
        'BodyForce.energy': (force.energy, {
            'time': number(0.0, 1), 'position': array(positions), 'orientation': array(turned)}),
        'BodyForce.explain': (force.explain, {
            'external': Argument([t.external], NO_OBJECT)}),
        'Checkpoint': (ico.Checkpoint, {
            'header': Argument([checkpoint.header], [*NO_OBJECT, {'time': 'x'}, {1: 2}]),
            'arrays': Argument([checkpoint.arrays], [
                *(bad for bad in NO_OBJECT if not isinstance(bad, dict)),
                {'x': 'y'}, {1: np.zeros(1)}])}),
        'Checkpoint.of': (ico.Checkpoint.of, {
            'simulation': some(ico.Simulation, simulation),
            'tree': Argument(
                [checkpoint.state_tree()._values], ['x', None, 3, NAN, [], {1: 2}, Other()])}),
        'Checkpoint.from_bytes': (ico.Checkpoint.from_bytes, {
            'data': Argument([checkpoint.to_bytes(), bytearray(checkpoint.to_bytes())], [
                'x', None, 3, True, NAN, [], {}, b'', b'x' * 100, checkpoint.to_bytes()[:-1],
                Other()], says='checkpoint')}),
        'Checkpoint.save': (checkpoint.save, {'path': path(
            t.folder / 'b.checkpoint', str(t.folder / 'c.checkpoint'))}),
        'Snapshot.to_csv': (t.snapshot.to_csv, {'path': path(
            t.folder / 'a.csv', str(t.folder / 'b.csv'))}),
        'Equilibrium.to_csv': (t.rest.to_csv, {'path': path(
            t.folder / 'rest.csv', str(t.folder / 'rest_b.csv'))}),
        'Spectrum.to_csv': (t.spectrum.to_csv, {'path': path(
            t.folder / 'modes.csv', str(t.folder / 'modes_b.csv'))}),
        'Elasticity.to_csv': (t.elasticity.to_csv, {'path': path(
            t.folder / 'elastic.csv', str(t.folder / 'elastic_b.csv'))}),
        'Growth.to_csv': (t.growth.to_csv, {'path': path(
            t.folder / 'growth.csv', str(t.folder / 'growth_b.csv'))}),
        'Checkpoint.load': (ico.Checkpoint.load, {'path': path(
            t.folder / 'a.checkpoint', str(t.folder / 'a.checkpoint'))}),
        'Checkpoint.difference': (checkpoint.difference, {
            'other': some(ico.Checkpoint, checkpoint)}),
        'Checkpoint.require_fit': (checkpoint.require_fit, {
            'simulation': some(ico.Simulation, simulation)}),
        'Elasticity.young_modulus': (t.elasticity.young_modulus, {
            'direction': array((1.0, 0.0, 0.0), [[0, 1, 0], [0, 0, 1]], bad=[
                (0, 0, 0), [(1, 0, 0), (0, 0, 0)], (1, 0)])}),
        'Elasticity.poisson_ratio': (t.elasticity.poisson_ratio, {
            'direction': array((1.0, 0.0, 0.0), np.eye(3)[:1], bad=[(0, 0, 0)]),
            'across': array((0.0, 1.0, 0.0), [[0, 0, 1]], bad=[(0, 0, 0)])}),
        'Elasticity.shear_modulus': (t.elasticity.shear_modulus, {
            'normal': array((1.0, 0.0, 0.0), [[1, 0, 0]], bad=[(0, 0, 0), (0.0, 1.0, 0.0)]),
            'along': array((0.0, 1.0, 0.0), [[0, 0, 1]], bad=[(0, 0, 0), (1.0, 1.0, 0.0)])}),
        'Elasticity.directional_moduli': (t.elasticity.directional_moduli, {
            'direction': array((1.0, 0.0, 0.0), [0, 0, 1], bad=[(0, 0, 0), np.eye(3)])}),
        'Elasticity.response': (t.elasticity.response, {
            'strain': array((0.0, 0.0, 1e-3, 0.0, 0.0, 0.0), [0, 0, 1, 0, 0, 0], bad=[
                np.zeros(6), np.eye(6)])}),
        'Elasticity.uniaxial_response': (t.elasticity.uniaxial_response, {
            'direction': array((1.0, 0.0, 0.0), [0, 0, 1], bad=[(0, 0, 0), np.eye(3)]),
            'sign': number(1.0, -1, np.int64(1), bad=[0.0, 2])}),
        'Growth.final_error': (t.growth.final_error, {'tolerance': from_zero(1e-6, 0)}),
        'Scene.from_parameters': (ico.Scene.from_parameters, {
            'parameters': Argument(
                [{'gravity': [0, 0, -9.81], 'weave': {'size': np.array([2, 2, 2])}}, {},
                 t.scene.parameters], [
                    'x', None, 3, NAN, True, [], (), [('weave.size', [2, 2, 2])], Other(),
                    {1: 2}, {'gravity': None}, {'gravity': [0, 0, None]}, {'gravity': [[0, 0, 1]]},
                    {'gravity': [0, True, 0.0]}, {'gravity': 'down'}, {'gravity': [0, 0, NAN]},
                    {'gravity': [0, 0]}, {'gravity': np.eye(3)}, {'gravity': []}, {'shell': {}},
                    {'shell.edge_length': True}, {'shell.edge_length': -1},
                    {'weave.size': [2.0] * 3}, {'gravity': np.full((3, 300), 'x')}], says=''),
            'shell': some(ico.Shell, None, optional=True)}),
        'Scene.with_changes': (t.scene.with_changes, {
            'changes': Argument(
                [{}, {'gravity': [0, 0, -9.81], 'weave': {'size': np.array([2, 2, 2])}}], [
                    'x', None, 3, NAN, True, [('weave.size', [2, 2, 2])], Other(), {1: 2},
                    {'gravity': None}, {'gravity': 'down'}, {'shell': {}},
                    {'shell.edge_length': -1}, {'weave.size': [2.0] * 3}], says='')}),
        'Parameters.with_changes': (t.scene.parameters.with_changes, {
            'changes': Argument(
                [{'gravity': [0, 0, -9.81]}, {'shell.density': np.int64(900)}, {}], [
                    'x', None, 3, NAN, [], Other(), {1: 2}, {'gravity': None},
                    {'gravity': np.eye(3)}, {'gravity': [0, 0, True]},
                    {'shell.masss': 1}], says='')}),
        'Parameters.names': (t.scene.parameters.names, {'family': text('loads', 'none')}),
        'Shell': (ico.Shell, {
            'half_edge': positive(0.01, 1), 'inner_half_edge': positive(0.008, bad=[0.01, 2.0]),
            **{name: positive(1.0, 2) for name in (
                'thickness', 'volume', 'density', 'mass', 'inertia')},
            'relative_error': from_zero(0.0, 1e-6)}),
        'Shell.from_thickness': (ico.Shell.from_thickness, {
            'edge_length': edge, 'thickness': thickness, 'density': density, 'mass': override,
            'inertia': override}),
        'Shell.from_inner_edge_length': (ico.Shell.from_inner_edge_length, {
            'edge_length': edge, 'inner_edge_length': positive(0.018, bad=[0.02, 1.0]),
            'density': density, 'mass': override, 'inertia': override}),
        'Shell.from_layers': (ico.Shell.from_layers, {
            'edge_length': edge, 'thickness': thickness,
            'distance': array(
                [0.01, 0.012], bad=[[0.012, 0.01], [0.0, 1.0], [-1.0, 0.01], [0.01]]),
            'density': array([900.0, 0.0], bad=[[-1.0, 1.0], [0.0, 0.0], [1.0]]),
            'mass': override, 'inertia': override}),
        'Shell.from_density': (ico.Shell.from_density, {
            'edge_length': edge, 'thickness': thickness, 'density_function': function(uniform),
            'include_interior': flag(False, np.True_), 'tolerance': positive(1e-3),
            'evaluation_limit': integer(10**8, np.int64(10**8), bad=[0, -1])}),
        **({} if MPI is None else {'Ranks': (ico.Ranks, {
            'communicator': some(MPI.Intracomm, MPI.COMM_SELF, optional=True)})}),
        'Simulation': (ico.Simulation, compile_words(scene)),
        'compile_scene': (ico.compile_scene, compile_words(scene)),
        'Simulation.advance_to': (simulation.advance_to, {
            'time': number(2e-3, np.float32(3e-3), bad=[-1.0, 0, 1e-4])}),
        'Simulation.advance_steps': (simulation.advance_steps, {
            'count': integer(1, np.int64(2), bad=[0, -1])}),
        'Simulation.apply_wrench': (simulation.apply_wrench, {
            'channel': text('tip', bad=['nobody', '']), 'force': vector, 'torque': vector,
            'time': later}),
        'Simulation.apply_body_wrench': (simulation.apply_body_wrench, {
            'body': integer(0, np.int32(1), bad=[-1, n, 10**12]), 'force': vector,
            'torque': vector, 'time': later}),
        'Simulation.apply_twist': (simulation.apply_twist, {
            'drive': text('wall', bad=['nobody', '', 'drives.wall']), 'linear': vector,
            'angular': vector, 'time': later}),
        'Simulation.move_plane': (simulation.move_plane, {
            'plane': text('floor', bad=['nobody', '', 'planes.floor']), 'linear': vector,
            'time': later}),
        'Simulation.pull': (simulation.pull, {
            'body': integer(0, np.int32(1), bad=[-1, n, 10**12]), 'point': vector}),
        'Simulation.release': (simulation.release, {
            'body': integer(0, np.int32(1), bad=[-1, n, 10**12])}),
        'Simulation.set_state': (
            simulation.set_state, {**state, 'relaxed': flag(False, np.True_)}),
        'Simulation.reset': (simulation.reset, {'time': later}),
        'Simulation.continue_from': (simulation.continue_from, {
            'previous': some(ico.Simulation, t.other), 'keep_motion': flag(False, np.True_)}),
        'Simulation.copy_breaks': (simulation.copy_breaks, {
            'other': Argument([t.other], [*NO_OBJECT, ico.compile_scene(
                make_scene((2, 2, 2), **SECTIONS))])}),
        'Simulation.prepare_contacts': (simulation.prepare_contacts, {
            'load': flag(False, np.True_)}),
        'Simulation.restore': (simulation.restore, {
            'checkpoint': some(ico.Checkpoint, checkpoint)}),
        'homogenise': (ico.homogenise, {
            'scene': scene, 'branch': branch, 'relaxed': flag(False, np.True_)}),
        'load_scene': (ico.load_scene, {'path': path(
            t.folder / 'scene.yaml', str(t.folder / 'scene.yaml'))}),
        'measure_curve': (ico.measure_curve, {
            'scene': scene, 'kind': text('pull', 'push', bad=['', 'pulls']),
            'strains': array([0.01, 0.02], (np.float32(0.01),), any_length=True, bad=[
                [0.0, 0.1], [-0.1, 0.1], [0.2, 0.1], [0.1, 0.1], [[0.1]], 0.1]),
            'axis': integer(0, np.int64(0), bad=[-1, 3]),
            'along': array([1.0, 0.0, 0.0], (2, 1, -1), None, optional=True, bad=[
                [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0]]),
            'body_force': function(None, optional=True),
            'progress': function(None, lambda done: None, optional=True)}),
        'measure_growth': (ico.measure_growth, {
            'scene': scene, 'duration': positive(1e-4), 'progress': function(lambda time: None)}),
        'measure_cycles': (ico.measure_cycles, {
            'scene': scene, 'kind': text('pull', 'push', bad=['', 'pulls']),
            'amounts': array([0.01, 0.02], (np.float32(0.01),), any_length=True, bad=[
                [0.0, 0.1], [-0.1, 0.1], [0.2, 0.1], [0.1, 0.1], [[0.1]], 0.1]),
            'count': integer(1, np.int64(2), bad=[0, -1]),
            'axis': integer(0, np.int64(0), bad=[-1, 3]),
            'about': integer(None, bad=[-1, 1, 3], optional=True),
            'along': array([1.0, 0.0, 0.0], (2, 1, -1), None, optional=True, bad=[
                [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0]]),
            'body_force': function(None, optional=True),
            'progress': function(None, lambda done: None, optional=True)}),
        'measure_moment_curve': (ico.measure_moment_curve, {
            'scene': scene, 'kind': text('bend', bad=['', 'bends', 'pull']),
            'angles': array([0.01, 0.02], (np.float32(-0.01),), any_length=True, bad=[
                [0.0, 0.1], [-0.1, 0.1], [0.2, 0.1], [0.1, 0.1], [[0.1]], 0.1]),
            'axis': integer(0, np.int64(0), bad=[-1, 3]),
            'about': integer(1, np.int64(2), None, bad=[-1, 0, 3], optional=True),
            'body_force': function(None, optional=True),
            'progress': function(None, lambda done: None, optional=True)}),
        'solve_bands': (ico.solve_bands, {
            'scene': scene, 'wave_vectors': array(
                [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]], [1, 0, 0], np.zeros((0, 3)),
                bad=[[[0, 0]], np.zeros((2, 6))]), 'branch': branch,
            'relaxed': flag(False, np.True_)}),
        'solve_equilibrium': (ico.solve_equilibrium, {
            'scene': scene, **statics, 'load_factor': from_zero(1.0, 0, np.int64(1)),
            **body_force, 'objective': text(
                'energy', 'resultants', None, optional=True, bad=['', 'work']), **progress}),
        'step_loads': (ico.step_loads, {
            'scene': scene, 'factors': Argument(
                [[0.5, 1], np.array([1.0]), (1,)], [
                    'x', b'x', None, 3, NAN, True, [], (), {}, {1.0: 2}, [NAN], [-1.0], [True],
                    ['1'], [None], [[1.0]], [0.5, INF], np.zeros(0), Other()]),
            **statics, **body_force, **progress}),
        'solve_modes': (ico.solve_modes, {
            'scene': scene, 'at': snapshot, 'time': time,
            'count': integer(None, 2, np.int64(3), bad=[0, -1], optional=True),
            'which': text('lowest', 'highest', bad=['', 'Lowest']), 'branch': branch,
            **body_force}),
        'surface_force': (ico.surface_force, {
            'scene': scene, 'traction': function(gust),
            'group': text('all', 'tip', bad=['', 'no']),
            'faces': text('exterior', 'all', bad=['', 'numbers 21']),
            'axes': text('face', 'world', bad=['', 'sky']),
            'degree': integer(6, 0, np.int64(2), bad=[-1, 21])}),
        'sweep': (ico.sweep, {
            'scene': scene, 'vary': Argument(
                [None, {'connector.stiffness': [300, 500.0]},
                 {'connector.stiffness': np.array([300.0])}], [
                    'x', 3, NAN, True, [], Other(), {1: 2}, {'connector.stiffness': None},
                    {'connector.stiffness': 3.0}, {'connector.stiffness': []},
                    {'connector.stiffness': '1..2'}]),
            'verbs': Argument(['elasticity', ('elasticity',)], [
                None, 3, NAN, True, [], {}, Other(), '', 'fly', [3], ['elasticity', 'fly']]),
            'keep': Argument([None, 'moduli', ['moduli']], [
                3, NAN, True, {}, Other(), '', 'x', [3], ['moduli', 'x'], 'moduli 3', 'bag']),
            'cases': Argument([None, [{'connector.stiffness': 300.0}]], [
                'x', 3, NAN, True, [], {}, Other(), [3], [{}]]),
            'sample': Argument([None], ['x', 3, NAN, True, [], {}, Other(), {'count': 3}]),
            'workers': integer(0, np.int64(0), bad=[-1, 10**6], optional=True),
            'scheduler': text(''),
            'store': path(t.folder / 'store', str(t.folder / 'store')),
            'retry': flag(False, True, np.True_),
            'progress': function(None, lambda done, total: None, optional=True)}),
        'band_path': (periodic.band_path, {
            'scene': scene, 'points': integer(2, np.int64(3), bad=[0, -1])}),
        'sample_zone': (periodic.sample_zone, {
            'scene': scene, 'count': integer(2, np.int64(3), bad=[0, -1])}),
        'contact.separation': (contact.separation, {
            'half_edge': positive(0.01, 1), 'first': pose, 'second': pose,
            'other_edge': number(0.02, 1, bad=[0.0, -1.0], optional=True)}),
        'contact.contact_force': (contact.contact_force, {
            'half_edge': positive(0.01, 1), 'first': pose, 'second': pose,
            'stiffness': positive(1e3, 100),
            'other_edge': number(0.02, 1, bad=[0.0, -1.0], optional=True)}),
        'contact.plane_contact_force': (contact.plane_contact_force, {
            'half_edge': positive(0.01, 1), 'normal': array(
                (0.0, 0.0, 2.0), [0, 0, 1], (1e308, 0, 1e308), bad=[(0, 0, 0), (1e-320, 0, NAN)]),
            'offset': number(-0.01, 0), 'pose': pose, 'stiffness': positive(1e3, 100)}),
        'contact.restitution': (contact.restitution, {
            'damping': from_zero(0.5, 0, 1e300), 'speed': positive(1.0, 2, 1e300)}),
        'contact.damping_for': (contact.damping_for, {
            'target_restitution': number(0.5, 1, bad=[0.0, 1.5, -0.5]),
            'speed': positive(1.0, 2)}),
        'StringBytes': (messages.StringBytes, {'text': frame}),
        'UInt8MultiArrayBytes': (messages.UInt8MultiArrayBytes, {'data': Argument(
            [b'abc', b''], ['x', None, 3, True, NAN, [], {}, Other()])}),
        'Float64MultiArrayBytes': (messages.Float64MultiArrayBytes, {
            'labels': Argument([['a', 'b'], ('a', 'b')], [
                'ab', None, 3, NAN, [], ['a'], [1, 2], ['a', None], ['a', 'b\0'], Other()]),
            'shape': Argument([[2, 3], (np.int64(0), 4), np.array([1, 1])], [
                'ab', None, 3, NAN, [], [2], [2, -1], [2, 1.5], [2, True], [2**20, 2**20],
                Other()])}),
        'Float64MultiArrayBytes.filled': (t.array.filled, {'fill': function(fill)}),
        'PoseArrayBytes': (messages.PoseArrayBytes, {
            'frame_id': frame, 'body_count': integer(2, np.int64(0), bad=[-1, 2**32])}),
        'PoseArrayBytes.filled': (t.poses.filled, {
            'nanoseconds': nanoseconds, 'fill': function(fill)}),
        'PoseArrayBytes.stamped': (t.poses.stamped, {'nanoseconds': nanoseconds}),
        'WrenchStampedBytes': (messages.WrenchStampedBytes, {'frame_id': frame}),
        'WrenchStampedBytes.stamped': (messages.WrenchStampedBytes(WORLD).stamped, {
            'nanoseconds': nanoseconds}),
        'TwistStampedBytes': (messages.TwistStampedBytes, {'frame_id': frame}),
        'TwistStampedBytes.stamped': (messages.TwistStampedBytes(WORLD).stamped, {
            'nanoseconds': nanoseconds}),
        'PointStampedBytes': (messages.PointStampedBytes, {'frame_id': frame}),
        'PointStampedBytes.stamped': (messages.PointStampedBytes(WORLD).stamped, {
            'nanoseconds': nanoseconds}),
        'ClockBytes.stamped': (messages.ClockBytes().stamped, {'nanoseconds': nanoseconds}),
        'DiagnosticArrayBytes': (messages.DiagnosticArrayBytes, {'frame_id': frame}),
        'DiagnosticArrayBytes.stamped': (messages.DiagnosticArrayBytes(WORLD).stamped, {
            'nanoseconds': nanoseconds, 'statuses': Argument(
                [[STATUS], (), iter([STATUS])], [
                    'x', None, 3, NAN, {}, ['x'], [None], [STATUS._replace(level=4)],
                    [STATUS._replace(level='x')], [STATUS._replace(level=True)],
                    [STATUS._replace(name=None)], [STATUS._replace(message=3)],
                    [STATUS._replace(hardware_id='a\0')], [STATUS._replace(values=[])],
                    [STATUS._replace(values={'a': 1})], [STATUS._replace(values={1: 'a'})],
                    Other()], says='status')}),
        'MarkerBytes': (messages.MarkerBytes, marker_words),
        'MarkerBytes.stamped': (t.marker.stamped, {
            'nanoseconds': nanoseconds,
            'action': integer(messages.MarkerAction.ADD, 2, bad=[1, -1])}),
        'MarkerBytes.filled': (t.marker.filled, {
            'nanoseconds': nanoseconds, 'count': integer(2, np.int64(4), bad=[-2, 3, 2**32]),
            'fill': function(fill)}),
        'MarkerBytes.color': (lambda color: setattr(t.marker, 'color', color), {
            'color': marker_words['color']}),
        'MarkerBytes.scale': (lambda scale: setattr(t.marker, 'scale', scale), {
            'scale': array((0.01, 0.0, 0.0), (1, 1, 1), bad=[(1, 1, -1)])}),
        'MarkerBytes.point_count': (lambda point_count: setattr(
            t.marker, 'point_count', point_count), {
                'point_count': integer(2, np.int64(4), bad=[-2, 3, 2**32])}),
        **{name: (getattr(messages, name), {'data': Argument([good, bytearray(good)], [
            'x', None, 3, True, NAN, [], {}, b'', good[:5], np.zeros(2), Other()],
            says='')}) for name, good in {
                'decode_clock': messages.ClockBytes().stamped(3),
                'decode_diagnostic_array': messages.DiagnosticArrayBytes().stamped(3, [STATUS]),
                'decode_float64_multi_array': t.array.to_bytes(),
                'decode_marker_array': b'\0\1\0\0' + bytes(4),
                'decode_marker_points': t.marker.stamped(3),
                'decode_point_stamped': messages.PointStampedBytes(WORLD).stamped(3),
                'decode_pose_array': t.poses.stamped(3),
                'decode_string': messages.StringBytes('x').to_bytes(),
                'decode_twist_stamped': messages.TwistStampedBytes(WORLD).stamped(3),
                'decode_uint8_multi_array': messages.UInt8MultiArrayBytes(b'x').to_bytes(),
                'decode_wrench_stamped': messages.WrenchStampedBytes(WORLD).stamped(3),
            }.items()},
    }


def compile_words(scene):
    return {
        'scene': scene, 'rotation': text('quaternion', None, bad=['', 'euler'], optional=True),
        'body_force': function(None, optional=True),
        'ranks': some(ico.Ranks, None, optional=True)}


def own_callables(name, kind):
    """
    The constructor and methods of a class that take arguments, and properties that can be set.
    """
    record = hasattr(kind, '_fields') or hasattr(kind, '__dataclass_fields__') and not hasattr(
        kind, '__post_init__')
    if not record and not issubclass(kind, Exception) and inspect.signature(kind).parameters:
        yield name, list(inspect.signature(kind).parameters)
    for word in dir(kind):
        value = inspect.getattr_static(kind, word)
        inherited = not any(
            word in vars(base) for base in kind.__mro__
            if base.__module__.startswith('icofabric_sim'))
        if word.startswith('_') or inherited:
            continue
        if isinstance(value, property):
            if value.fset is not None:
                yield f'{name}.{word}', [word]
        elif callable(getattr(kind, word)):
            given = [
                each for each in inspect.signature(getattr(kind, word)).parameters
                if each != 'self']
            if given:
                yield f'{name}.{word}', given


def public_callables():
    """
    Arguments of every function, constructor, method and property that users can give some to.
    """
    functions = {function.__name__: function for function in NAMED_IN_DOCS}
    found = dict(own_callables('Parameters', Parameters))
    for module in (ico, messages):
        for name in module.__all__:
            member = getattr(module, name)
            if inspect.isfunction(member):
                functions[name] = member
            elif inspect.isclass(member) and not issubclass(member, int):
                found.update(own_callables(name, member))
    functions.update({
        f'contact.{name}': member for name, member in vars(contact).items()
        if inspect.isfunction(member) and not name.startswith('_')
        and member.__module__ == contact.__name__})
    for name, member in functions.items():
        found[name] = list(inspect.signature(member).parameters)
    return found


PUBLIC = public_callables()
if MPI is None:
    del PUBLIC['Ranks']
# What a call that was refused has not begun.
STARTERS = [
    (simulation_module, 'pack_scene'), (equilibrium, 'StaticFabric'), (modes, 'StaticFabric'),
    (periodic, 'StaticFabric')]


def fingerprint(t):
    """All that a call could have changed."""
    scene = t.scene
    return (
        t.simulation.checkpoint().to_bytes(), t.other.checkpoint().to_bytes(),
        t.checkpoint.to_bytes(), t.marker.stamped(0), t.poses.stamped(0), t.array.to_bytes(),
        scene.position.tobytes(), scene.orientation.tobytes(), dict(scene.parameters),
        sorted(path.name for path in t.folder.iterdir()))


@pytest.fixture(scope='module')
def entries(things):
    return table(things)


def test_the_table_is_that_of_the_public_names(entries):
    """A new public name needs an entry here, and so does a new argument."""
    assert {name: list(entry[1]) for name, entry in entries.items()} == PUBLIC


@pytest.mark.parametrize('name', PUBLIC)
def test_what_makes_no_sense_is_refused_and_changes_nothing(things, entries, name, monkeypatch):
    function, arguments = entries[name]
    good = {word: argument.good[0] for word, argument in arguments.items()}
    things.simulation.restore(things.checkpoint)

    def start(*arguments, **words):
        raise RuntimeError('it has begun')

    for module, starter in STARTERS:
        monkeypatch.setattr(module, starter, start)
    for word, argument in arguments.items():
        before = fingerprint(things)
        for bad in argument.bad:
            with pytest.raises((TypeError, ValueError)) as caught:
                function(**{**good, word: bad})
                print(f'{name}({word}={bad!r}) was taken')
            said = str(caught.value)
            assert said and '\n' not in said and len(said) < 500, (word, bad, said)
            assert (word if argument.says is None else argument.says) in said, (bad, said)
        assert fingerprint(things) == before, word


@pytest.mark.parametrize('name', PUBLIC)
def test_what_makes_sense_is_taken(things, entries, name):
    function, arguments = entries[name]
    good = {word: argument.good[0] for word, argument in arguments.items()}
    for word, argument in arguments.items():
        for value in argument.good:
            things.simulation.restore(things.checkpoint)
            result = function(**{**good, word: value})
            if name == 'step_loads':
                assert all(found.converged for _, found in result)


def test_integers_are_numbers():
    """Integers in a list with floats, also NumPy's, mean what floats mean, bit for bit."""
    plain = ico.Scene.from_parameters({'gravity': [0.0, 0.0, -9.81], 'weave.size': [2, 2, 2]})
    mixed = ico.Scene.from_parameters(
        {'gravity': [0, np.int64(0), -9.81], 'weave': {'size': np.array([2, 2, 2])}})
    assert dict(mixed.parameters) == dict(plain.parameters)
    assert [type(value) for value in mixed.parameters['gravity']] == [float] * 3
    changed = plain.parameters.with_changes({'shell.density': 900, 'gravity': [0, 0.5, 1]})
    assert type(changed['shell.density']) is float and changed['gravity'] == [0.0, 0.5, 1.0]


def test_factors_may_depend_on_what_was_found(things):
    """An iterator is not read in advance, and judged as it comes."""
    def factors():
        yield 0.5
        yield -1.0

    steps = ico.step_loads(things.scene, factors())
    assert next(steps)[1].converged
    with pytest.raises(ValueError, match='factors'):
        next(steps)
