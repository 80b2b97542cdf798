# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Launch files, run against stand-ins for the launch packages: which nodes start, with what."""

import importlib.util
from pathlib import Path
import sys
from types import ModuleType

from icofabric_sim.parameters.file import load_parameter_file
from icofabric_sim.parameters.validation import find_specification, make_parameters
from icofabric_sim.running.replay.replay_parameters import OPTIONS
import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]


class Recorded:
    """Anything that is constructed from arguments, which it keeps."""

    def __init__(self, *arguments, **named):
        self.arguments, self.named = arguments, named


class Node(Recorded):
    pass


class Argument(Recorded):

    @property
    def name(self):
        return self.arguments[0]


class Function(Recorded):

    pass


class Configuration(Recorded):

    def perform(self, context):
        return context[self.arguments[0]]


@pytest.fixture
def launched(monkeypatch, tmp_path_factory):
    """A way to run a launch file with arguments: the nodes that it starts."""
    monkeypatch.setattr('tempfile.tempdir', str(tmp_path_factory.mktemp('launch')))
    stand_ins = {
        'ament_index_python': {}, 'launch': {'LaunchDescription': Recorded},
        'ament_index_python.packages': {'get_package_share_directory': lambda name: str(ROOT)},
        'launch.actions': {'DeclareLaunchArgument': Argument, 'OpaqueFunction': Function},
        'launch.conditions': {'IfCondition': Recorded},
        'launch.substitutions': {'LaunchConfiguration': Configuration},
        'launch_ros': {}, 'launch_ros.actions': {'Node': Node},
    }
    for name, members in stand_ins.items():
        module = ModuleType(name)
        for key, value in members.items():
            setattr(module, key, value)
        monkeypatch.setitem(sys.modules, name, module)

    def run(name, **given):
        path = ROOT / 'launch' / f'{name}.launch.py'
        specification = importlib.util.spec_from_file_location(name, path)
        module = importlib.util.module_from_spec(specification)
        specification.loader.exec_module(module)
        (actions,) = module.generate_launch_description().arguments
        declared = {
            action.arguments[0]: action for action in actions if isinstance(action, Argument)}
        assert set(given) <= set(declared)
        assert all(action.named.get('description') for action in declared.values())
        context = {key: action.named.get('default_value') for key, action in declared.items()}
        context.update(given)
        (function,) = [action for action in actions if isinstance(action, Function)]
        nodes = function.named['function'](context)
        assert all(isinstance(node, Node) for node in nodes)
        return [node.named for node in nodes]
    return run


def parameters_of(node):
    """Parameters of a node beside its scene, as ROS reads them."""
    return load_parameter_file(
        node['parameters'][-1], node_name=node['name'], namespace=node['namespace'])


def fabrics(nodes):
    return [node for node in nodes if node['package'] == 'icofabric_sim']


def test_simulate(launched):
    (fabric,) = fabrics(launched('simulate', scene='free_slab', duration='2', start_paused='true'))
    assert fabric['executable'] == 'fabric_node'
    assert Path(fabric['parameters'][0]) == ROOT / 'config' / 'free_slab.yaml'
    assert parameters_of(fabric) == {'duration': 2.0, 'start_paused': True}
    with pytest.raises(RuntimeError, match='hanging_slab.*--show-args'):
        launched('simulate', scene='nothing')


def test_replay(launched, tmp_path):
    (player,) = fabrics(launched('replay', bag=str(tmp_path), rate='0.5', loop='true'))
    assert player['executable'] == 'replay_node'
    assert parameters_of(player) == {'bag': str(tmp_path), 'rate': 0.5, 'loop': True}
    with pytest.raises(RuntimeError, match='does not exist.*--show-args'):
        launched('replay', bag=str(tmp_path / 'none'))
    # Every argument but those of the launch itself is an option of the node, in its type.
    everything = {
        'fabric': '/a', 'rate': '2', 'start_offset': '1', 'loop': 'false', 'stay': 'true',
        'start_paused': 'true', 'publish_clock': 'false'}
    (player,) = fabrics(launched('replay', bag=str(tmp_path), **everything))
    given = parameters_of(player)
    assert set(given) == {'bag', *everything}
    assert all(type(value) is type(OPTIONS[name].default) for name, value in given.items())


def test_compare(launched):
    nodes = launched(
        'compare', scene='free_slab', left_variant='1', right_kind='bias',
        right_stiffness='800', right_scene='bias_column', real_time_factor='0.5')
    left, right = fabrics(nodes)
    assert (left['namespace'], right['namespace']) == ('left', 'right')
    assert Path(left['parameters'][0]).stem == 'free_slab'
    assert Path(right['parameters'][0]).stem == 'bias_column'
    assert parameters_of(left) == {'weave.variant': 1, 'real_time_factor': 0.5}
    given = parameters_of(right)
    assert given == {
        'weave.kind': 'bias', 'connector.stiffness': 800.0, 'real_time_factor': 0.5,
        'publish_clock': False, 'frame_id': 'right_world'}
    # They are parameters of a scene; exactly one fabric publishes the clock.
    make_parameters(given)
    assert find_specification('publish_clock').default is True
    assert 'publish_clock' not in parameters_of(left)
    (beside,) = [node for node in nodes if node['package'] == 'tf2_ros']
    assert 'right_world' in beside['arguments']
    assert len(fabrics(launched('compare', distance='0'))) == 2
    # RViz, if asked for, shows the topics that they publish.
    (view,) = [node for node in nodes if node['package'] == 'rviz2']
    shown = yaml.safe_load(Path(view['arguments'][1]).read_text())['Visualization Manager']
    topics = {display['Topic']['Value'] for display in shown['Displays'] if 'Topic' in display}
    assert topics == {f'/{side}/icofabric/{name}' for side in ('left', 'right')
                      for name in ('poses', 'connectors', 'icosahedra')}


def test_compare_names_the_argument_that_is_wrong(launched):
    for given in ({'scene': 'nothing'}, {'left_scene': 'nothing'}, {'right_scene': 'nothing'},
                  {'distance': 'far'}):
        [(name, value)] = given.items()
        with pytest.raises(RuntimeError, match=f'{name}:={value} .*--show-args'):
            launched('compare', **given)


@pytest.mark.parametrize('text', ['1e3', '1e-3', 'nan', 'y', 'off', '0x10', "it's: #1", '~'])
def test_texts_stay_texts(launched, tmp_path, text):
    """A folder or fabric of that name, and not what YAML makes of it."""
    (fabric,) = fabrics(launched('simulate', record=text, namespace='/lab/'))
    assert parameters_of(fabric) == {'record.path': text}
    left, _ = fabrics(launched('compare', left_record=text))
    assert parameters_of(left) == {'record.path': text}
    (player,) = fabrics(launched('replay', bag=str(tmp_path), fabric=text))
    assert parameters_of(player) == {'bag': str(tmp_path), 'fabric': text}


@pytest.mark.parametrize(('name', 'argument', 'text'), [
    ('simulate', 'duration', '1,5'), ('simulate', 'real_time_factor', 'nan'),
    ('simulate', 'start_paused', 'maybe'), ('compare', 'left_variant', '1.5'),
    ('compare', 'right_stiffness', '5k'), ('compare', 'distance', 'inf'),
    ('replay', 'rate', 'fast')])
def test_a_value_of_another_type_names_its_argument(launched, tmp_path, name, argument, text):
    given = {'bag': str(tmp_path)} if name == 'replay' else {}
    with pytest.raises(RuntimeError, match=f'^{argument}:={text} is not .*--show-args'):
        launched(name, **given, **{argument: text})


@pytest.mark.parametrize('name', ['simulate', 'compare', 'replay'])
def test_what_may_be_missing_starts_first(launched, tmp_path, name):
    """The launch ends with the first executable that it does not find: nothing runs by then."""
    packages = [node['package'] for node in launched(
        name, **({'bag': str(tmp_path)} if name == 'replay' else {}))]
    assert packages == sorted(packages, key='icofabric_sim'.__eq__)
    declared = (ROOT / 'package.xml').read_text()
    assert all(f'<exec_depend>{package}</exec_depend>' in declared
               for package in packages if package != 'icofabric_sim')


@pytest.mark.parametrize('name', ['simulate', 'compare', 'replay'])
def test_arguments_that_nobody_declared_are_refused(launched, tmp_path, monkeypatch, name):
    given = {'bag': str(tmp_path)} if name == 'replay' else {}

    def begun_by(*words):
        monkeypatch.setattr(sys, 'argv', ['/opt/ros/jazzy/bin/ros2', 'launch', *words])
        return launched(name, **given)

    file = f'{name}.launch.py'
    with pytest.raises(RuntimeError, match=rf'rvix:=true: {file} has no .* did you mean rviz\?'):
        begun_by('icofabric_sim', file, 'rvix:=true')
    with pytest.raises(RuntimeError, match='no argument zzz; allowed: .*rviz.*--show-args'):
        begun_by(f'/a/{file}', 'rviz:=false', 'zzz:=1')
    assert begun_by('icofabric_sim', file, 'rviz:=true')
    # A launch file that includes this one has arguments of its own.
    assert begun_by('mine', 'mine.launch.py', 'zzz:=1')
