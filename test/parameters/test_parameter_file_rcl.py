# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The same parameter files and command lines read by a real rclpy node and by parameter_file.

What ROS refuses must be refused; what ROS takes must give equal values and types, unless it is
one of the things that ROS spoils without a word, which the messages name.
"""

from pathlib import Path
import random
import subprocess
import sys

from icofabric_sim.parameters.file import (
    check_ros_arguments,
    dump_parameters,
    load_parameter_file,
    ParameterFileError,
)
import pytest
from test_parameter_file import HEAD, random_flat, REFUSED, SCALARS, SECTIONS, typed

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

CONFIG = Path(__file__).parents[2] / 'config'
ROS_OWN = ('use_sim_time', 'start_type_description_service')

# What ROS accepts and spoils, or what only some releases of libyaml read: words of our messages.
STRICTER = (
    'flattens', 'empty list', 'empty map', 'has no null', 'NUL', 'would ignore', 'ROS confuses',
    'ROS loses', 'is empty;', 'not every ROS', 'UTF-8', 'name of a node', 'cannot be a name',
    'is not a name', 'no single value', 'nested more than', 'true or false',
    'holds no parameters', 'written twice')


@pytest.fixture(scope='module')
def ros(tmp_path_factory):
    """A function that returns what a node gets from a command line, or None if ROS refuses it."""
    import rclpy
    from rclpy.context import Context
    from rclpy.exceptions import ParameterException
    from rclpy.node import Node
    from ros_helpers import domain

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_DOMAIN_ID', str(domain()))
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        patch.setenv('ROS_LOG_DIR', str(tmp_path_factory.mktemp('log')))
        context = Context()
        rclpy.init(context=context, args=[])

        def ask(arguments):
            try:
                node = Node(
                    'icofabric', context=context, cli_args=arguments, use_global_arguments=False,
                    automatically_declare_parameters_from_overrides=True, enable_rosout=False,
                    start_parameter_services=False)
            except (RuntimeError, ValueError, ParameterException):
                return None  # RCLError is a RuntimeError; ValueError: a name without a value
            try:
                names = node.get_parameters_by_prefix('')
                return {name: plain(node.get_parameter(name).value) for name in names
                        if name not in ROS_OWN and not name.startswith('qos_overrides.')}
            finally:
                node.destroy_node()

        yield ask
        rclpy.shutdown(context=context)


def plain(value):
    return value if isinstance(value, (bool, int, float, str)) else list(value)


def ours(arguments):
    try:
        return check_ros_arguments(['fabric_node', *arguments]), ''
    except ParameterFileError as error:
        return None, str(error)


def compare(ros, arguments, text=''):
    """Return 'equal', 'refused' by both, or 'stricter'; fail for anything else."""
    theirs = ros(arguments)
    mine, message = ours(arguments)
    if theirs is None:
        assert mine is None, f'ROS refuses {arguments} {text!r}, we read {mine}'
        return 'refused'
    if mine is None:
        assert any(words in message for words in STRICTER), (
            f'ROS reads {theirs} from {arguments} {text!r}, we say {message}')
        return 'stricter'
    assert {name: typed(value) for name, value in mine.items()} == {
        name: typed(value) for name, value in theirs.items()}, f'{arguments} {text!r}'
    return 'equal'


@pytest.fixture
def compare_text(ros, tmp_path):
    path = tmp_path / 'scene.yaml'

    def run(text, *more):
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return compare(ros, ['--ros-args', '--params-file', str(path), *more], text)

    return run


def test_scalars(ros, tmp_path):
    texts = [text for text, _ in SCALARS if text == text.strip() and text not in ('null', '~')]
    texts += ['-' + text for text in texts if text[0] not in '-+~'] + [
        "'1'", '"on"', '!!str 1', '!!int "3"', '!!float 1', '!x 1', '&a 1', "''", '2 # two',
        '!!python/name:os.system 1', '0x1p-1022', '0x1.fffffffffffffp-1023', '0x1p1023',
        '0x1p1024', '1.7976931348623159e308', '1.7976931348623157e308', 'nan()', 'nan(_9a)',
        'nan(-)', '00', '-00x1', '0.0e-999999', '1' * 5000, '0.' + '0' * 400 + '1', '1' * 30 + '.']
    body = ''.join(f'    k{index}: {text}\n' for index, text in enumerate(texts))
    body += '    block: |\n      5\n    stripped: |-\n      5\n    spaced: |2-\n          5\n'
    path = tmp_path / 'scene.yaml'
    path.write_text(HEAD + body)
    theirs = ros(['--ros-args', '--params-file', str(path)])
    mine = load_parameter_file(path)
    assert len(theirs) == len(texts) + 3
    for name, value in theirs.items():
        assert typed(mine[name]) == typed(value), (name, texts[int(name[1:])])
    assert mine.keys() == theirs.keys()


def test_our_refusals_are_those_of_ros_or_stricter(compare_text):
    outcomes = [compare_text(HEAD + case[0]) for case in REFUSED]
    assert outcomes.count('refused') >= 8 and 'equal' not in outcomes


def test_sections_in_any_order(compare_text):
    generator = random.Random(3)
    for _ in range(40):
        text = ''.join(
            f'"{section}": {{ros__parameters: {{a: {number}, b{number}: {{c: {number}}}}}}}\n'
            for number, section in enumerate(generator.sample(sorted({*SECTIONS}), k=5)))
        assert compare_text(text) == 'equal'


COMMAND_LINES = [
    '-p a:=1', '-p icofabric:a:=1', '-p other:a:=1', '-p a:=1 -p a:=2', '-p a:=1 -p a:=2.5',
    '-p a:=2.5 -p a:=1', '-p a:=[1,2] --param b:=[x1]', '-p a:=on -- -p b:=1',
    '-p a:=1 -- b --ros-args -p c:=2', '-p a/b:=1', '-p a.b:=1', '-p a..b:=1', '-p a__b:=1',
    '-p a___b:=1', '-p __a:=1', '-p a.__ns:=1', '-p _:=1', '-p _a_:=1', '-p 1:=1', '-p a1:=1',
    '-p a.1:=1', '-p rostopic:=1', '-p rostopic://a:=1', '-p a*:=1', '-p a:b:=1', '-p a:=',
    '-p a', '-p a:={b:1}', '-p a:=[[1]]', '-p a:=[1,2.0]', '-p a:=x:=y', '-p', '--params-file',
    '-r __node:=other -p other:a:=1 -p icofabric:a:=2', '-r __name:=other -p other:a:=1',
    '-r icofabric:__node:=other -p other:a:=1', '-r no:__node:=other -p other:a:=1',
    '-r __ns:=/left -p icofabric:a:=1 -p b:=1', '-r __ns:=/left/right -p icofabric:a:=1',
    '-r icofabric:__ns:=/left -r __node:=other -p other:a:=1',
    '-r other:__ns:=/left -r __node:=other -p other:a:=1', '-r a:=b -p a:=1',
    '-r __node:=x1 -r __node:=x2 -p x1:a:=1 -p x2:b:=1', '--log-level info -p a:=1',
    '--log-level a:=info -p a:=1', '--disable-rosout-logs -p a:=1', '-e /a -p a:=1',
    '-p use_sim_time:=true', '-p use_sim_time:=1', '-p qos_overrides./clock:=1',
]


def test_command_lines(ros):
    outcomes = [compare(ros, ['--ros-args', *line.split()]) for line in COMMAND_LINES]
    outcomes.append(compare(ros, ['__node:=other', '--ros-args', '-p', 'other:a:=1']))
    assert outcomes.count('equal') > 25 and outcomes.count('refused') > 12


KEYS = ['a', 'b', 'c', 'c.d', 'a.b', 'e.f.g', "'q'", '"r s"', '1', '<<', '~', 'ros__parameters',
        'use_sim_time', 'qos_overrides.a']
PIECES = ['0', '1', '9', '07', '0x', 'a', 'e', 'E+', 'p', '.', '+', '-', '_', 'inf', 'nan', 'n',
          'yes', 'No', 'on', 'true', 'null', '~', '1e5', 'e-320', 'e400', 'e-308', '0x1.8p3',
          '2.2250738585072011', '9223372036854775807', '9223372036854775808', 'f', ':', ' ', '#',
          '\t', '!', '%', '@', '|', 'é', '0x1p-1074', '4.9406564584124654e-324']
WHOLE = ['[1, 2]', '[1.0, 2e3]', '[x1, "b"]', '[on, off]', '[]', '[1, 2.0]', '[x, y]', '{}', '',
         '[[1]]', '[[1], [2]]', '[{a: 1}]', '{a: 1, b.c: {d: 2}, e: 3}', '*a', '["a",]', '{a: }',
         '{a: {b: 1}, a: {b: 2.5}}', '[a: 1]', '[http://x]', '{b:1}', '["a":1]', '[-1, - 1]',
         '[1,\n         2]', '\n      - 1\n      - 2', '"a\\\n      b"', '>-\n      a\n      b']
NODES = [*['/**'] * 9, 'icofabric', 'icofabric', '/icofabric', '/*', '**', '"*"', 'other', 'other',
         '/a/icofabric', '/**/icofabric', 'a:\n  icofabric', 'a:\n  "**"', '/**:\n  /', 'my-node',
         '9x', 'a//b', 'a:\n  b/icofabric', 'a/:\n  icofabric', '/a:\n  b:\n  icofabric',
         '"*":\n  /**']
DAMAGE = list(' :-?[]{},#&*!|>\'"%@`\n\t./~') + [
    '\n---\n', '\n...\n', ': ', '- ', '\r\n', '\x85', '\u2028', '\x07', '\ufeff', '\0', '\\']


def random_scalar(generator):
    text = ''.join(generator.choices(PIECES, k=generator.choice([1, 1, 2, 3, 4])))
    style = generator.randrange(12)
    if style == 0:
        return "'" + text + "'"
    if style == 1:
        return '"' + text + generator.choice(['', '\\n', '\\0', '\\x41', '\\/', '\\ud800']) + '"'
    if style == 2:
        return generator.choice(['|', '>', '|-', '>-', '|+', '|2-']) + '\n              ' + text
    if style == 3:
        return generator.choice(['!!str ', '!!int ', '! ', '!a ', '&a ', '!!null ']) + text
    return text


def random_map(generator, indent):
    lines = ''
    for _ in range(generator.choice([1, 1, 2, 3])):
        lines += ' ' * indent + generator.choice(KEYS) + ':'
        kind = generator.random()
        if kind < 0.55 or indent > 10:
            lines += ' ' + random_scalar(generator) + '\n'
        elif kind < 0.7:
            lines += ' ' + generator.choice(WHOLE) + '\n'
        else:
            lines += '\n' + random_map(generator, indent + 2)
    return lines


def random_file(generator):
    text = ''
    for _ in range(generator.choice([1, 1, 2, 3])):
        indent = 0
        for name in generator.choice(NODES).split('\n  '):
            text += ' ' * indent + name.removesuffix(':') + ':\n'
            indent += 2
        text += ' ' * indent + 'ros__parameters:\n' + random_map(generator, indent + 2)
        if generator.random() < 0.1:
            # Another name of a node or of a namespace, in the same map or farther out.
            indent = generator.randrange(0, indent + 2, 2)
            text += ' ' * indent + generator.choice(['icofabric', 'b', '/**', '"**"']) + ':\n'
            text += ' ' * (indent + 2) + 'ros__parameters:\n' + random_map(generator, indent + 4)
        if generator.random() < 0.03:
            text += generator.choice(['---\n', '...\n', '---\n~\n', '---\n{}\n', '# end\n'])
    if generator.random() < 0.3:
        characters = list(text)
        for _ in range(generator.randrange(1, 3)):
            characters.insert(
                generator.randrange(len(characters)), generator.choice(DAMAGE))
        text = ''.join(characters)
    return text


def test_random_files(compare_text):
    generator = random.Random(2026)
    outcomes = []
    for _ in range(400):
        more = []
        if generator.random() < 0.25:
            more = ['-p', generator.choice(['a', 'a.b', 'c.d', 'icofabric:a', 'other:a']) + ':=' +
                    generator.choice(['1', '2.5', 'x1', '[1, 2]', '[]', '~', 'on'])]
        outcomes.append(compare_text(random_file(generator), *more))
    assert outcomes.count('equal') > 40 and outcomes.count('refused') > 52
    assert outcomes.count('stricter') > 24


def test_ros_reads_what_we_dump(ros, tmp_path):
    generator = random.Random(5)
    path = tmp_path / 'dump.yaml'
    for _ in range(100):
        flat = random_flat(generator)
        path.write_text(dump_parameters(flat), encoding='utf-8')
        theirs = ros(['--ros-args', '--params-file', str(path)])
        assert {name: typed(value) for name, value in theirs.items()} == {
            name: typed(value) for name, value in flat.items()}


def test_example_scenes(ros):
    for path in sorted(CONFIG.glob('*.yaml')):
        assert compare(ros, ['--ros-args', '--params-file', str(path)]) == 'equal', path
        assert load_parameter_file(path), path


def test_the_whole_program_line_counts_the_same(ros, tmp_path):
    import rclpy
    from rclpy.context import Context
    from rclpy.node import Node

    path = tmp_path / 'scene.yaml'
    path.write_text(HEAD + '    a: {b: 1, c: [x1, "y"]}\n')
    argv = ['fabric_node', 'word', '--ros-args', '--params-file', str(path), '-p', 'a.b:=7', '--',
            'word', '--ros-args', '-r', '__ns:=/left', '-p', 'd:=on']
    context = Context()
    rclpy.init(context=context, args=argv)
    try:
        node = Node('icofabric', context=context, start_parameter_services=False,
                    automatically_declare_parameters_from_overrides=True)
        assert node.get_fully_qualified_name() == '/left/icofabric'
        values = {name: plain(node.get_parameter(name).value) for name in ('a.b', 'a.c', 'd')}
        node.destroy_node()
    finally:
        rclpy.shutdown(context=context)
    assert check_ros_arguments(argv) == values == {'a.b': 7, 'a.c': ['x1', 'y'], 'd': True}


def test_reading_needs_no_ros():
    code = ("import sys; sys.modules['rclpy'] = None; "
            'from icofabric_sim.parameters.file import load_parameter_file')
    subprocess.run([sys.executable, '-c', code], check=True, timeout=60)
