# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Parameter files without ROS. What ROS does with the same texts: test_parameter_file_rcl.py."""

import math
import os
from pathlib import Path
import random
import struct

from icofabric_sim.parameters.file import (
    check_ros_arguments,
    dump_parameters,
    flatten_parameters,
    load_parameter_file,
    ParameterFileError,
    parse_parameter_override,
)
from icofabric_sim.parameters.rcl_scalars import resolve_scalar
import numpy as np
import pytest
import yaml

HEAD = '/**:\n  ros__parameters:\n'


def typed(value):
    """A form of a value that compares type, sign of zero and NaN as well."""
    if isinstance(value, list):
        return [typed(item) for item in value]
    return type(value).__name__, repr(value)


def load(tmp_path, text, **keywords):
    path = tmp_path / 'scene.yaml'
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_parameter_file(path, **keywords)


def error_of(tmp_path, text):
    with pytest.raises(ParameterFileError) as caught:
        load(tmp_path, text)
    return str(caught.value)


# rcl_yaml_param_parser/src/parse.c get_value; strtoll and strtod of glibc.
SCALARS = [
    ('true', True), ('On', True), ('YES', True), ('y', True), ('oN', 'oN'), ('tRUE', 'tRUE'),
    ('false', False), ('off', False), ('No', False), ('n', False),
    ('0', 0), ('-7', -7), ('+3', 3), ('0x1F', 31), ('-0X10', -16), ('010', 8), ('0o17', '0o17'),
    ('0b1', '0b1'), ('08', 8.0), ('0x', '0x'), ('1_000', '1_000'), ('1:30', '1:30'),
    ('9223372036854775807', 2**63 - 1), ('-9223372036854775808', -2**63),
    ('9223372036854775808', 2.0**63), ('0x10000000000000000', 2.0**64),
    ('1e3', 1000.0), ('1e-6', 1e-6), ('.5', 0.5), ('5.', 5.0), ('-1.5E+2', -150.0), ('1e', '1e'),
    ('.', '.'), ('1.2.3', '1.2.3'), ('-0.0', -0.0), ('0x1.8p3', 12.0), ('0x.8', 0.5),
    ('0x1p', '0x1p'), ('.inf', math.inf), ('-.Inf', -math.inf), ('+.INF', math.inf),
    ('inf', math.inf), ('-Infinity', -math.inf), ('.iNf', '.iNf'), ('.nan', math.nan),
    ('nan', math.nan), ('NaN(7)', math.nan), ('-.nan', '-.nan'), ('infinit', 'infinit'),
    ('1e400', '1e400'), ('0e-400', 0.0), ('1e-400', '1e-400'), ('5e-324', '5e-324'),
    ('2.2250738585072014e-308', 2.2250738585072014e-308), ('0x1p-1074', 5e-324),
    ('0x1.8p-1074', '0x1.8p-1074'), ('2.2250738585072011e-308', '2.2250738585072011e-308'),
    ('null', 'null'), ('~', '~'), ('2026-01-01', '2026-01-01'), ('\u0661', '\u0661'),
    (' 5', 5), ('5 ', '5 '), ('5\n', '5\n'),
]


@pytest.mark.parametrize('text, value', SCALARS)
def test_scalars_resolve_as_in_c(text, value):
    assert typed(resolve_scalar(text)) == typed(value)
    assert resolve_scalar(text, quoted=True) == text
    assert resolve_scalar(text, tag='tag:yaml.org,2002:str') == text


def test_decimals_round_correctly():
    generator = random.Random(7)
    for _ in range(2000):
        value = struct.unpack('<d', generator.randbytes(8))[0]
        if math.isfinite(value) and abs(value) >= 2.3e-308:
            assert typed(resolve_scalar(repr(value))) == typed(value)
        assert not isinstance(resolve_scalar('9' * generator.randrange(20, 5000)), int)


def test_names_types_and_sections(tmp_path):
    values = load(tmp_path, HEAD + """
    use_sim_time: true
    start_type_description_service: false
    qos_overrides./clock.subscription.depth: 3
    gravity: [0.0, 0.0, -9.81]   # three
    shell: {edge_length: 2e-2, density: 1200}
    weave:
      size:
        - 5
        - 0x5
        - 05
      kind: bias
      region: 'cylinder 1 2'
    groups.top: "z_max"
    publish_clock: off
    frame_id: |-
      world
other_node:
  ros__parameters: {gravity: [1.0], names: [], nothing: ~}
""")
    assert values == {
        'gravity': [0.0, 0.0, -9.81], 'shell.edge_length': 0.02, 'shell.density': 1200,
        'weave.size': [5, 5, 5], 'weave.kind': 'bias', 'weave.region': 'cylinder 1 2',
        'groups.top': 'z_max', 'publish_clock': False, 'frame_id': 'world'}
    assert typed(values['shell.density']) == typed(1200)


SECTIONS = ['/**', '/*', 'icofabric', '/icofabric', '/**/icofabric', '/*/icofabric', 'other',
            '/left/icofabric', '/left/*', '/left/**', 'left']
WHO_TAKES = {
    ('icofabric', '/'): {'/**', '/*', 'icofabric', '/icofabric', '/**/icofabric'},
    ('icofabric', '/left'): {
        '/**', '/**/icofabric', '/*/icofabric', '/left/icofabric', '/left/*', '/left/**'},
    ('other', '/'): {'/**', '/*', 'other'},
}


@pytest.mark.parametrize('node_name, namespace', WHO_TAKES)
def test_who_takes_a_section(tmp_path, node_name, namespace):
    text = ''.join(
        f'"{section}": {{ros__parameters: {{"{index}": 1}}}}\n'
        for index, section in enumerate(SECTIONS))
    values = load(tmp_path, text, node_name=node_name, namespace=namespace)
    assert {SECTIONS[int(name)] for name in values} == WHO_TAKES[node_name, namespace]
    nested = yaml.safe_load(text)
    assert flatten_parameters(nested, node_name=node_name, namespace=namespace) == values


def test_later_section_wins_and_so_does_the_first_place_of_a_section(tmp_path):
    text = (HEAD + '    a: 1\n    b: 1\nicofabric: {ros__parameters: {a: 2}}\n'
            + '---\n' + HEAD + '    a: 3\n    b: 3\n    c: 3\n')
    assert load(tmp_path, text) == {'a': 2, 'b': 3, 'c': 3}


# Text below ros__parameters, line of the error, name in it, words in it.
REFUSED = [
    ('    gravity: [0.0, 0, -9.81]\n', 3, 'gravity', 'mixes float and int', 'write 0 as 0.0'),
    ('    a:\n      fix: [x, y]\n', 4, 'a.fix', 'mixes bool and str', 'quote'),
    ('    a: [1, two]\n', 3, 'a', 'mixes int and str', 'quote'),
    ('    a: [[0.0, 1.0]]\n', 3, 'a', 'flattens', 'one list'),
    ('    a: [{b: 1}]\n', 3, 'a', 'flattens', 'one list'),
    ('    a: 1\n    shell:\n      density:\n', 5, 'shell.density', 'no value', 'write one'),
    ('    a: [1, ,]\n', 3, 'a', 'not valid YAML', 'check'),
    ('    a: []\n', 3, 'a', 'empty list', 'delete'),
    ('    a: {}\n', 3, 'a', 'empty map', 'delete'),
    ('    a: ~\n', 3, 'a', 'no null', 'quote'),
    ('    a: [b, null]\n', 3, 'a', 'no null', 'quote'),
    ('    a: "x\\0y"\n', 3, 'a', 'NUL', 'remove'),
    ('    a: &one 1\n    b: *one\n', 4, 'b', 'aliases', 'write the value again'),
    ('    a: 1\n    a: 2.5\n', 4, 'a', 'written twice, first in line 3', 'keep one'),
    ('    a: x\n    b: 1\n    a: [x]\n', 5, 'a', 'written twice, first in line 3', 'keep one'),
    ('    a: [1]\n    a: [2.5]\n', 4, 'a', 'written twice, first in line 3', 'keep one'),
    ('    a: true\n    a: 0.5\n', 4, 'a', 'written twice, first in line 3', 'keep one'),
    ('    a: {b.c: {d: 1}, e: 2}\n', 3, 'a.b.c', 'ROS confuses', 'nested map'),
    ('    a: 1\n    a: {b: 2}\n', 4, 'a', 'written twice, first in line 3', 'keep one'),
    ('    a: {b: 2}\n    a: 1\n', 4, 'a', 'written twice, first in line 3', 'keep one'),
    ('    a: 1\n    a: 1\n', 4, 'a', 'written twice, first in line 3', 'keep one'),
    ('    a: {b: 1, c: 2}\n    a.b: 1\n', 4, 'a.b', 'written twice, first in line 3', 'keep one'),
    ('    a: {b: 1}\n    c: 1\n    a: {d: 2}\n', 5, 'a', 'twice, first in line 3', 'keep one'),
    ('    ? [a, b]\n    : 1\n', 3, '', 'cannot be a name', 'write a word'),
    ('    a: [http://x]\n', 3, 'a', 'inside brackets', 'quote it'),
    ('    a: "b\\/c"\n', 3, 'a', 'quoted text', 'write "/"'),
    ('    use_sim_time: 1\n', 3, 'use_sim_time', 'true or false', 'got 1'),
    ('    a: 1\n\tb: 2\n', 4, 'a', 'not valid YAML', 'indent with spaces'),
    ('    a: ' + '{a: ' * 40 + '1' + '}' * 40, 3, '', 'nested more than', 'deep'),
]


@pytest.mark.parametrize('body, line, name, why, remedy', REFUSED)
def test_refusals_name_file_line_parameter_and_remedy(tmp_path, body, line, name, why, remedy):
    message = error_of(tmp_path, HEAD + body)
    assert message.startswith(f'{tmp_path / "scene.yaml"}:{line}:')
    assert f"parameter '{name}'" in message if name else True
    assert why in message and remedy in message


@pytest.mark.parametrize('text, why', [
    ('', 'empty'), ('# nothing\n', 'empty'), ('hello\n', 'name of a node'),
    ('- 1\n', 'name of a node'), ('shell: {density: 1}\n', "'density' stands outside"),
    ('/**:\n', "'/**' stands outside"), (HEAD, 'no parameters'),
    ('my-node:\n  ros__parameters: {a: 1}\n', "'my-node' is not the name of a node"),
    ('/a//b:\n  ros__parameters: {a: 1}\n', 'is not the name of a node'),
    ('a:\n  b/c:\n    ros__parameters: {a: 1}\n', 'a part of it has a slash'),
    ('a: {ros__parameters: {a: 1}, b: {ros__parameters: {a: 1}}}\n', 'loses the name of the node'),
    ('/**: {ros__parameters: {a: 1}}\n--- \n', 'expected the name of a node'),
    ('ros__parameters: {a: 1}\n', 'no node name'), ('a: [b\n', 'not valid YAML'),
    ('%YAML 1.2\n---\n' + HEAD + '    a: 1\n', 'YAML 1.2'),
    (b'\x7fELF\x01\x00\x02', 'not a text file'), (b'\x89PNG\r\n', 'not UTF-8 text'),
    (HEAD.encode('utf-16'), 'not UTF-8 text'),
    (HEAD.encode() + b'    a: \xe9\n', ':3: not UTF-8'),
    ('a: &a [x, x]\nb: &b [*a, *a]\n', 'aliases'),
    ('/**: &s\n  ros__parameters: {a: 1}\nicofabric: *s\n', 'aliases'),
])
def test_files_that_are_no_parameter_files(tmp_path, text, why):
    message = error_of(tmp_path, text)
    assert why in message
    assert str(tmp_path / 'scene.yaml') in message


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(ParameterFileError, match='no such parameter file'):
        load_parameter_file(tmp_path / 'missing.yaml')
    with pytest.raises(ParameterFileError, match='a folder'):
        load_parameter_file(tmp_path)
    with pytest.raises(ParameterFileError, match='is not a regular file'):
        load_parameter_file('/dev/null')
    with pytest.raises(ParameterFileError, match='cannot be read'):
        load_parameter_file('a\0b')
    huge = tmp_path / 'huge.yaml'
    huge.touch()
    os.truncate(huge, 2**30)
    with pytest.raises(ParameterFileError, match='at most'):
        load_parameter_file(huge)


def test_tags_build_nothing(tmp_path):
    marker = tmp_path / 'made'
    values = load(tmp_path, HEAD + f"""
    a: !!python/object/apply:os.mkdir ['{marker}']
    b: !!python/name:os.system x1
    c: !!float 1
    d: !!str 1
    e: !!int '1'
""")
    assert values == {'a': [str(marker)], 'b': 'x1', 'c': 1, 'd': '1', 'e': '1'}
    assert not marker.exists()


def test_own_rules_hold_for_other_nodes_only_where_ros_insists(tmp_path):
    text = HEAD + '    a: 1\nother:\n  ros__parameters:\n    '
    for harmless in ('b: []', 'b: ~', 'b: "x\\0y"', 'b: 1, "b": 2.5'.replace(', ', '\n    '),
                     'b: {c.d: {e: 1}}'):
        assert load(tmp_path, text + harmless + '\n') == {'a': 1}
    for fatal in ('b: [1, 2.0]', 'b:', 'b: [[1], [2]]', 'b: [[1, 2]]', 'b: {}'):
        assert 'scene.yaml:6' in error_of(tmp_path, text + fatal + '\n')


@pytest.mark.parametrize('rule, name, value', [
    ('duration:=2.5', 'duration', 2.5), ('weave.size:=[3, 4, 5]', 'weave.size', [3, 4, 5]),
    ('icofabric:frame_id:=map', 'frame_id', 'map'), ('a_b.c1:= 1 # one', 'a_b.c1', 1),
    ("a:='1'", 'a', '1'), ('a:=x:=1', 'a', 'x:=1'), ('use_sim_time:=on', 'use_sim_time', True),
])
def test_overrides(rule, name, value):
    got_name, got = parse_parameter_override(rule)
    assert (got_name, typed(got)) == (name, typed(value))


@pytest.mark.parametrize('rule, why', [
    ('duration', 'write name:=value'), ('duration=2', 'write name:=value'),
    ('duration:=', "'duration' has no value"), ('a:=# c', "'a' has no single value"),
    ('a:=[1, 2.0]', "'a' mixes float and int"), ('a:=[]', "'a' is an empty list"),
    ('a:={b: 1}', "'a' is a list or map"), ('a:=[[1]]', "'a' is a list or map"),
    ('a:=~', "'a' is ~"), ('a:=[1', "'a': not valid YAML"), ('1a:=1', "'1a' is not a valid"),
    ('a..b:=1', 'is not a valid'), ('a*:=1', 'is not a valid'), ('__ns.a:=1', 'is not a valid'),
    ('a:=\udcff', 'not UTF-8 text'), ('other:a:=1', "for the node 'other'"),
])
def test_bad_overrides(rule, why):
    with pytest.raises(ParameterFileError, match='command line') as caught:
        parse_parameter_override(rule)
    assert why in str(caught.value)


def test_command_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path('one.yaml').write_text(HEAD + '    a: 1\n    b: {c: 1.0, d: x}\n')
    Path('two.yaml').write_text(
        'second: {ros__parameters: {a: 7}}\n/left/third: {ros__parameters: {a: 8}}\n')
    files = ['--params-file', 'one.yaml', '--params-file', 'two.yaml']
    assert check_ros_arguments(['node', '-p', 'a:=9']) == {}
    values = check_ros_arguments(
        ['node', '--ros-args', *files, '--', '-p', '--ros-args', '--log-level', '-p',
         '-p', 'b.c:=2.0', '--param', 'e:=[1.0, 2.0]', '--ros-args', '--unknown'])
    assert values == {'a': 1, 'b.c': 2.0, 'b.d': 'x', 'e': [1.0, 2.0]}
    for renaming in (['-r', '__node:=second'], ['--remap', 'icofabric:__name:=second']):
        assert check_ros_arguments(['--ros-args', *renaming, *files])['a'] == 7
    assert check_ros_arguments(['__node:=second', '--ros-args', *files])['a'] == 7
    assert check_ros_arguments(['--ros-args', '-r', 'other:__node:=second', *files])['a'] == 1
    assert check_ros_arguments(
        ['--ros-args', '-r', 'third:__ns:=/left', '-r', '__node:=third', '-r', '__node:=second',
         *files])['a'] == 8
    for flag in ('-p', '--param', '--params-file', '-r', '--log-level'):
        with pytest.raises(ParameterFileError, match=f'{flag} has no value'):
            check_ros_arguments(['node', '--ros-args', flag])
    with pytest.raises(ParameterFileError, match=r'would ignore 2\.5.*write 1\.0 in one.yaml:3'):
        check_ros_arguments(['--ros-args', *files, '-p', 'a:=2.5'])
    assert check_ros_arguments(['--ros-args', *files, '-p', 'b.c:=2'])['b.c'] == 2
    with pytest.raises(ParameterFileError, match='more than once before; give it in one place'):
        check_ros_arguments(['--ros-args', *files, *files[:2], '-p', 'b.c:=2.0'])


def test_an_override_without_effect_is_told(tmp_path):
    path = tmp_path / 'scene.yaml'
    path.write_text(HEAD + '    a: 1\nicofabric: {ros__parameters: {b: 2}}\n')
    notices = []
    argv = ['--ros-args', '--params-file', str(path), '-p', 'a:=3', '-p', 'b:=3']
    assert check_ros_arguments(argv, notices=notices) == {'a': 3, 'b': 2}
    assert len(notices) == 1 and 'b:=3' in notices[0] and 'icofabric:b:=' in notices[0]
    argv[-1] = 'icofabric:b:=3'
    assert check_ros_arguments(argv, notices=notices) == {'a': 3, 'b': 3}
    assert len(notices) == 1


def test_a_file_for_other_nodes_is_reported_by_all_readers(tmp_path, caplog):
    """A file that names several nodes, this one among them, is not."""
    other, shared = tmp_path / 'other.yaml', tmp_path / 'shared.yaml'
    other.write_text('/a: {ros__parameters: {a: 1}}\nlab: {b: {ros__parameters: {a: 2}}}\n')
    shared.write_text(other.read_text() + 'icofabric: {ros__parameters: {a: 3}}\n')
    files = ['--ros-args', '--params-file', str(other), '--params-file', str(shared)]
    notices = []
    assert check_ros_arguments(files, notices=notices) == {'a': 3}
    assert load_parameter_file(other) == {} and load_parameter_file(shared) == {'a': 3}
    assert flatten_parameters({'/a': {'ros__parameters': {'a': 1}}}) == {}
    notices += caplog.messages
    assert len(notices) == 3 and notices[0] == notices[1]
    for words in ('other.yaml', '/a, lab/b', '/icofabric'):
        assert words in notices[0]
    assert '/a;' in notices[2] and '/icofabric' in notices[2]
    assert check_ros_arguments([*files[:3], '-r', '__node:=a'], notices=notices) == {'a': 1}
    assert len(notices) == 3


def test_python_dictionaries():
    values = flatten_parameters({
        'use_sim_time': True,
        'shell': {'edge_length': np.float32(0.5), 'density': np.int64(7)},
        'weave.size': (3, np.int32(4), 5),
        'gravity': np.array([0.0, 0.0, -9.81]),
        'weave': {'region': Path('mesh.stl'), 'connected': np.bool_(False)},
        'names': np.array(['a', 'b']), 'one': np.array(2.5),
        # An integer is a number.
        'mixed': [0, np.int64(3), -9.81]})
    expected = {
        'shell.edge_length': 0.5, 'shell.density': 7, 'weave.size': [3, 4, 5],
        'gravity': [0.0, 0.0, -9.81], 'weave.region': 'mesh.stl', 'weave.connected': False,
        'names': ['a', 'b'], 'one': 2.5, 'mixed': [0.0, 3.0, -9.81]}
    assert {name: typed(value) for name, value in values.items()} == {
        name: typed(value) for name, value in expected.items()}
    assert flatten_parameters({}) == {}


@pytest.mark.parametrize('nested, why', [
    ({'a': {'b': None}}, "'a.b'.*leave it out"), ({'a': []}, "'a' is an empty list"),
    ({'a': {}}, "'a' is an empty dict"), ({'a': [True, 1]}, "'a' mixes bool and int"),
    ({'a': ['x', 1]}, "'a' mixes int and str"), ({'a': [0.0, None]}, "'a'.*leave it out"),
    ({'a': [[1]]}, "'a': ROS cannot hold"), ({'a': np.eye(2)}, "'a': ROS cannot hold"),
    ({'a': 2**63}, "'a'.*64 bits"), ({'a': 1j}, "'a'.*complex"), ({'a': b'x'}, "'a'.*bytes"),
    ({'a': 'x\0'}, "'a'.*NUL"), ({'a': '\ud800'}, "'a'.*pair"), ({1: 2}, '1 below'),
    ({'a': {'b': 1}, 'a.b': 1}, "'a.b' is given twice"), ([1], 'must be a dictionary'),
    ({'/**': {'ros__parameters': 3}}, 'must be a dictionary'),
])
def test_bad_python_dictionaries(nested, why):
    with pytest.raises(ParameterFileError, match=why):
        flatten_parameters(nested)


def random_value(generator):
    kind = generator.randrange(5)
    if kind == 0:
        return generator.random() < 0.5
    if kind == 1:
        return generator.randrange(-2**63, 2**63) >> generator.randrange(64)
    if kind == 2:
        return struct.unpack('<d', generator.randbytes(8))[0]
    if kind == 3:
        return generator.choice([
            0.0, -0.0, 5e-324, -2.225073858507201e-308, 1e16, 1e22, 1e-5, 0.1, math.inf,
            -math.inf, math.nan, 2.0**-1022])
    return ''.join(generator.choice('ab 10.eE:#-\'"\\\n\t,[]{}\x85\u2028\ufeffé😀~on\x01')
                   for _ in range(generator.randrange(6)))


def random_flat(generator):
    """Names, some of which have others as their beginning, and values."""
    flat = {}
    for _ in range(generator.randrange(1, 12)):
        name = '.'.join(generator.choice(['a', 'b', 'on', 'c d', '', 'x_1', '9', 'é', '~'])
                        for _ in range(generator.randrange(1, 4)))
        value = random_value(generator)
        if generator.random() < 0.3:
            items = [random_value(generator) for _ in range(20)]
            value = [item for item in items if type(item) is type(value)] or [value]
        flat[name or 'a'] = value
    return flat


def test_dump_comes_back_with_values_and_types(tmp_path):
    generator = random.Random(11)
    for _ in range(300):
        flat = random_flat(generator)
        values = load(tmp_path, dump_parameters(flat))
        assert {name: typed(value) for name, value in values.items()} == {
            name: typed(value) for name, value in flat.items()}


def test_dump_is_nested_and_other_readers_agree():
    flat = {'shell.edge_length': 0.02, 'shell.density': 1e22, 'solver.tolerance': 1e-6,
            'weave.size': [5, 5, 5], 'groups.on': 'off', 'frame_id': '1e3', 'publish_clock': True}
    text = dump_parameters(flat)
    assert text.startswith('/**:\n  ros__parameters:\n    shell:\n      edge_length: 0.02\n')
    nested = yaml.safe_load(text)
    assert nested['/**']['ros__parameters']['groups'] == {'on': 'off'}
    assert flatten_parameters(nested) == flat
    assert dump_parameters({}) == '/**:\n  ros__parameters: {}\n'


def test_dump_refuses_what_a_file_cannot_hold():
    for flat in ({'a': []}, {'a': None}, {'a': [1, 2.0]}, {'': 1}, {'a\0': 1}, {'é' * 200: 1}):
        with pytest.raises(ParameterFileError):
            dump_parameters(flat)
