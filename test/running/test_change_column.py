# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What a change of each parameter does to a run is what its column in the table says."""

import icofabric_sim as ico
from icofabric_sim.parameters.changes import changed_names
from icofabric_sim.parameters.table import BY_NAME, Change, FAMILIES
from icofabric_sim.parameters.validation import find_specification, ParameterError
from icofabric_sim.running.runner import Runner
from icofabric_sim.simulation.stepping.controllers.given import GivenStep
import pytest
from runner_helpers import Beside, ListSink

BASE = {
    'weave.size': [2, 2, 2],
    'connector.stiffness': 200.0,
    'contact.mode': 'never',
    'initial_random.velocity_sigma': 0.01,
    'initial_random.spin_sigma': 1.0,
    'solver.method': 'leapfrog',
    # Given, and its error is not measured: no kernels for steps that are not taken.
    'solver.step': 1e-4,
    'groups.tip': 'x_max',
    'groups.wall': 'x_min',
    'start_paused': True,
    'step_count': 5,
}
_DISSIPATIVE = {'solver.method': 'dop8'}
_MOVING = {'drives.it.motion': 'velocity', 'drives.it.linear': [0.01, 0.0, 0.0]}
_SWAYING = {
    'drives.it.motion': 'sine', 'drives.it.linear': [0.01, 0.0, 0.0], 'drives.it.frequency': 1.0}
_SLIDING = {'planes.it.motion': 'velocity', 'planes.it.linear': [0.01, 0.0, 0.0]}
_SHAKEN = {
    'planes.it.motion': 'sine', 'planes.it.linear': [0.01, 0.0, 0.0], 'planes.it.frequency': 1.0}
_MOMENTS = {
    'connector_groups.it.bending_stiffness': 0.01, 'connector_groups.it.twisting_stiffness': 0.01}
_WAVING = {
    'anchors.it.motion': 'sine', 'anchors.it.linear': [0.01, 0.0, 0.0],
    'anchors.it.frequency': 1.0}
# What a scene needs beside, by family and by name.
NEEDED = {
    'drag.': _DISSIPATIVE,
    'connector.damping': _DISSIPATIVE,
    'connector.break_length_extension': _DISSIPATIVE,
    'connector.break_length_compression': _DISSIPATIVE,
    'connector_groups.it.damping': _DISSIPATIVE,
    'connector.alpha': {'connector.law': 'exponential', 'connector.alpha': 5.0},
    'connector_groups.it.alpha': {
        'connector_groups.it.law': 'exponential', 'connector_groups.it.alpha': 5.0},
    'connector.maxwell_stiffness': _DISSIPATIVE | {'connector.maxwell_time': 0.01},
    'connector.maxwell_time': _DISSIPATIVE,
    'connector_groups.it.maxwell_stiffness': _DISSIPATIVE | {'connector.maxwell_time': 0.01},
    'connector_groups.it.maxwell_time': _DISSIPATIVE,
    'shell.principal_inertia': _DISSIPATIVE,
    'masses.it.principal_inertia': _DISSIPATIVE,
    'bodies.it.principal_inertia': _DISSIPATIVE,
    'connector_groups.it.break_length_extension': _DISSIPATIVE,
    'connector_groups.it.break_length_compression': _DISSIPATIVE,
    'weave.azimuth': {'weave.kind': 'bias', 'weave.size': [3, 2, 2]},
    'weave.boundary': {'weave.kind': 'bias', 'weave.size': [3, 2, 2]},
    'weave.radius': {'weave.kind': 'radial', 'weave.size': [4, 2, 2]},
    'connector_groups.': {'connector_groups.it.between': 'tip wall'},
    # With both from the start they share their kernels; the rules for all connectors begin with 0.
    'connector_groups.it.bending_stiffness': _MOMENTS,
    'connector_groups.it.twisting_stiffness': _MOMENTS,
    'charges.': {'charges.it.group': 'tip'},
    'masses.': {'masses.it.group': 'tip'},
    'masses.it.group': {'masses.it.mass': 0.01},
    'field.profile': {'field.duration': 1.0},
    'supports.': {'supports.it.group': 'wall'},
    'loads.': {'loads.it.group': 'tip', 'loads.it.force': [0.0, 0.0, 1e-3]},
    'tractions.': {'tractions.it.group': 'tip', 'tractions.it.pressure': 1.0},
    'loads.it.expression': _DISSIPATIVE,
    'field.electric_expression': {**_DISSIPATIVE, 'charge.per_body': 1e-9},
    'line_loads.': {'line_loads.it.group': 'tip', 'line_loads.it.force': [0.0, 0.0, 1e-2]},
    'line_loads.it.profile': {'line_loads.it.duration': 1.0},
    'loads.it.profile': {'loads.it.duration': 1.0},
    'tractions.it.profile': {'tractions.it.duration': 1.0},
    'drives.': {'drives.it.group': 'wall'},
    'drives.it.freedoms': {'drives.it.freedoms': 'tx ty'},
    'drives.it.linear': _MOVING,
    'drives.it.angular': _MOVING,
    'drives.it.duration': _MOVING,
    'drives.it.frequency': _SWAYING,
    'drives.it.phase': _SWAYING,
    'drives.it.file': {'drives.it.motion': 'table', 'drives.it.file': 'other_way.csv'},
    'planes.': {'planes.it.normal': [0.0, 0.0, 1.0], 'planes.it.offset': -1.0},
    'planes.it.linear': _SLIDING,
    'planes.it.start': _SLIDING,
    'planes.it.duration': _SLIDING,
    'planes.it.frequency': _SHAKEN,
    'planes.it.phase': _SHAKEN,
    'planes.it.file': {'planes.it.motion': 'table', 'planes.it.file': 'other_way.csv'},
    'anchors.': {'anchors.it.position': [0.0, 0.0, 0.2]},
    'connectors.': {'connectors.it.bodies': [0, 3]},
    'connectors.it.file': {'connectors.it.bodies': [0, 0], 'connectors.it.file': 'ties.csv'},
    'connectors.it.axis': {'connectors.it.kind': 'hinge'},
    'connectors.it.damping': _DISSIPATIVE,
    'connectors.it.break_length_extension': _DISSIPATIVE,
    'connectors.it.break_length_compression': _DISSIPATIVE,
    'anchors.it.break_length_extension': _DISSIPATIVE,
    'anchors.it.break_length_compression': _DISSIPATIVE,
    'anchors.it.damping': _DISSIPATIVE,
    'anchors.it.motion': {'anchors.it.motion': 'ramp', 'anchors.it.duration': 0.5},
    'anchors.it.linear': _WAVING,
    'anchors.it.start': {'anchors.it.motion': 'ramp', 'anchors.it.duration': 0.5},
    'anchors.it.duration': {'anchors.it.motion': 'ramp', 'anchors.it.duration': 0.5},
    'anchors.it.frequency': _WAVING,
    'anchors.it.phase': _WAVING,
    'initial.': {'initial.it.group': 'tip'},
    'bodies.': {'bodies.it.position': [0.0, 0.0, 0.5]},
}
# Another value, where neither the next choice nor a little more than the default is one.
OTHERS = {
    'weave.size': [3, 2, 2],
    'weave.box': [0.2, 0.1, 0.1],
    'weave.radius': 0.2,
    'weave.region': 'sphere 0.05',
    'weave.connector_angle': 0.3,
    'weave.connector_length': 0.04,
    'shell.inner_edge_length': 0.018,
    'connector.natural_length': 0.03,
    'connector.break_length_extension': 0.2,
    'connector.break_length_compression': 0.001,
    'connector.law': 'law.csv',
    'shell.layers': 'layers.csv',
    'shell.expression': '900 + 1e6*(x**2 + y**2 + z**2)',
    'masses.it.expression': '900',
    'bodies.it.expression': '900',
    'charge.layers': 'layers.csv',
    'charge.expression': '1e-6 + 1e-4*x',
    'charges.it.layers': 'layers.csv',
    'charges.it.expression': '1e-6 + 1e-4*x',
    'solver.device': 'warp_cpu',
    'solver.method': 'srkn4',
    'record.split_size': 4096,
    'frame_id': 'map',
    'publish.connectors': 'tip wall',
    'publish.group': 'tip',
    'checkpoint.path': 'elsewhere',
    'record.path': 'elsewhere',
    'groups.it': 'y_max',
    'constants.it': 2.0,
    'connector_groups.it.between': 'tip tip',
    'connector_groups.it.direction': 'north south',
    'connector_groups.it.law': 'law.csv',
    'connector_groups.it.break_length_extension': 0.2,
    'connector_groups.it.break_length_compression': 0.001,
    'supports.it.fix': 'tx',
    'drives.it.motion': 'velocity',
    'drives.it.freedoms': 'tz',
    'drives.it.file': 'way.csv',
    'planes.it.file': 'way.csv',
    'anchors.it.file': 'way.csv',
    'anchors.it.motion': '',
    'connectors.it.bodies': [0, 2],
    'connectors.it.file': 'other_ties.csv',
    'connectors.it.break_length_extension': 0.5,
    'connectors.it.break_length_compression': 0.001,
    'initial.it.file': 'state.csv',
    'anchors.it.break_length_extension': 0.5,
    'anchors.it.break_length_compression': 0.001,
    'bodies.it.orientation': [0.0, 0.0, 1.0, 0.0],
    'bodies.it.inertia': 1e-6,
    'masses.it.inertia': 1e-6,
    'shell.inertia': 1e-6,
    'masses.it.edge_length': 0.018,
    'bodies.it.edge_length': 0.018,
    'shell.principal_inertia': [1e-6, 1.1e-6, 1.2e-6],
    'masses.it.principal_inertia': [1e-6, 1.1e-6, 1.2e-6],
    'bodies.it.principal_inertia': [1e-6, 1.1e-6, 1.2e-6],
    'tractions.it.faces': 'all',
    'tractions.it.variation': '1 0.5 0.5',
    'tractions.it.expression': '1 + xi',
    'line_loads.it.edges': 'up',
    'line_loads.it.expression': '1 + s',
    'loads.it.expression': '1e-3*x, 0, 0',
    'field.electric_expression': 'x, 0, 0',
}
FILES = {
    'law.csv': 'length,force\n0.02,-2\n0.03,0\n0.05,4\n',
    'layers.csv': 'distance,density\n0.012,900\n0.015,2000\n',
    'state.csv': 'body,x_m,y_m,z_m\n1,0.05,0,0\n',
    'ties.csv': '0,3,0,0,0,0,0,0\n',
    'other_ties.csv': '0,3,0,0.01,0,0,0,0\n',
    'way.csv': 'time,x,y,z\n0,0,0,0\n1,0.01,0,0\n',
    'other_way.csv': 'time,x,y,z\n0,0,0,0\n1,0.02,0,0\n',
}


def all_names():
    """Every static parameter, and every field of one member of every family."""
    return [*BY_NAME, *(
        f'{family}.it' + (f'.{field.name}' if field.name else '')
        for family, fields in FAMILIES.items() for field in fields)]


def parameters_with(name):
    """The parameters of a scene that can have `name`."""
    family = f'{name.split(".")[0]}.'
    given = {**BASE, **NEEDED.get(family, {}), **NEEDED.get(name, {})}
    return ico.Scene.from_parameters(given).parameters


def other_value(name, present):
    """A good value that is not the `present` one."""
    entry = find_specification(name)
    if name in OTHERS:
        return OTHERS[name]
    if name.endswith('.group'):
        return 'wall' if present == 'tip' else 'tip'
    if name.endswith('.profile'):
        return 'ramp'
    if entry.choices:
        return entry.choices[(entry.choices.index(present) + 1) % len(entry.choices)]
    if isinstance(present, bool):
        return not present
    if isinstance(present, list):
        return [element + 0.01 for element in present]
    return present + 1 if isinstance(present, int) else 1.01 * abs(present) + 0.001


class Observed(Runner):
    """A paused run, and what one change of its parameters does to it."""

    def __init__(self, parameters):
        self.told = []
        super().__init__(
            ico.compile_scene(ico.Scene.from_parameters(parameters)), [ListSink()],
            on_rebuilt=lambda wanted, reason: self.told.append(reason))

    def effect(self, wanted):
        """Take some steps, then change, and look at what has become of the motion."""
        with Beside(self) as beside:
            now = self.take_steps().result(60.0)
            simulation, before = self.simulation, self.simulation.snapshot()
            assert abs(before.position - simulation.scene.initial.position).max() > 0.0
            try:
                self.change(wanted).result(60.0)
            except ParameterError as error:
                assert Change.FIXED.value in str(error)
                assert self.parameters['frame_id'] == 'world' and self.simulation is simulation
                return Change.FIXED
            if self.parameters != wanted:
                beside.wait_for(lambda: self.told)
                assert self.told == ['']
            assert self.parameters == wanted and self.now == now
            after = self.simulation.snapshot()
            assert after.time == before.time == now / 1e9
            if self.simulation is simulation:
                assert after is before
                return Change.AT_ONCE
            assert self.simulation.scene.parameters == wanted
            return self._what_became_of(before, after)

    def _what_became_of(self, before, after):
        free = self.simulation.scene.initial
        kept = after.position.shape == before.position.shape and (
            after.position == before.position).all() and (
            # To rounding: solver.rotation has orientations written in another way.
            abs(after.orientation - before.orientation) < 1e-14).all()
        restarted = (after.position == free.position).all() and (
            after.linear_velocity == free.linear_velocity).all()
        assert kept != restarted
        return Change.REBUILDS if kept else Change.RESTARTS


@pytest.fixture(autouse=True)
def quick(tmp_path, monkeypatch):
    """Files that scenes name, and no kernels for steps that are not taken."""
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(ico.Simulation, 'warm_up', lambda self: None)
    monkeypatch.setattr(GivenStep, '_measure', lambda self, fastest, *, jumped: None)


@pytest.mark.parametrize('name', [
    pytest.param(name, marks=pytest.mark.long if name == 'masses.it.edge_length' else ())
    for name in all_names()])
def test_a_change_does_what_its_column_says(name):
    parameters = parameters_with(name)
    # A point without a motion takes no duration.
    more = {'anchors.it.duration': 0.0} if name == 'anchors.it.motion' else {}
    wanted = parameters.with_changes(
        more | {name: other_value(name, parameters.get(name, 'x_max'))})
    assert name in changed_names(parameters, wanted)
    assert Observed(parameters).effect(wanted) is find_specification(name).change


def test_a_change_of_the_group_of_a_drive_restarts_the_motion():
    parameters = parameters_with('drives.it.group')
    assert Observed(parameters).effect(
        parameters.with_changes({'groups.wall': 'y_min'})) is Change.RESTARTS
