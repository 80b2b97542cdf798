# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Read ROS 2 parameter files and command lines without ROS, with the result that a ROS node gets.

`load_parameter_file` returns the names, values and types that the node /icofabric gets from
`--ros-args --params-file F`. `check_ros_arguments` does the same for a whole command line before
rclpy reads it. Input that ROS refuses or would silently change raises a ParameterFileError with
the file, the line, the parameter and the remedy.
"""

from collections.abc import Iterator, Sequence
import logging
import os
import re
import stat
from typing import NamedTuple

from icofabric_sim.parameters.example_scenes import suggest_scene
from icofabric_sim.parameters.rcl_parameters import full_node_name, section_matches, Value
from icofabric_sim.parameters.sections import ParameterSet
from icofabric_sim.parameters.text import dump_parameters, flatten_parameters
from icofabric_sim.parameters.yaml_events import ParameterFileError

__all__ = [
    'check_ros_arguments', 'dump_parameters', 'flatten_parameters', 'load_parameter_file',
    'ParameterFileError', 'parse_parameter_override', 'Value']

_LOGGER = logging.getLogger('icofabric_sim')
_MAX_FILE_BYTES = 16 * 1024 * 1024  # bytes

# Grammar of names on the command line, from rcl/src/rcl/lexer.c.
_NAME_PATTERN = ('(?:[A-Za-z][A-Za-z0-9]*(?:_[A-Za-z0-9]+)*_?'
         '|_(?!_)(?:[A-Za-z0-9]+(?:_[A-Za-z0-9]+)*_?)?)')
_LEXEMES = re.compile(
    r'(?P<special>__ns|__node|__name|rosservice://|rostopic://)'
    rf'|(?P<word>{_NAME_PATTERN})|(?P<dot>\.)|(?P<slash>/)', re.ASCII)
_NODE_PREFIX = re.compile(rf'(?!rosservice://|rostopic://)({_NAME_PATTERN}):(?!=)', re.ASCII)
_REMAP = re.compile(
    rf'(?:(?P<prefix>{_NAME_PATTERN}):)?'
    rf'(?:(?:__node|__name):=(?P<node>{_NAME_PATTERN})'
    rf'|__ns:=(?P<namespace>/(?:{_NAME_PATTERN}/)*(?:{_NAME_PATTERN})?))', re.ASCII)

_OPTIONS_WITH_VALUE = {
    '--log-level', '--log-file-name', '--log-config-file', '-e', '--enclave'}


class _Rule(NamedTuple):
    section: str
    name: str
    text: str
    source: str


def load_parameter_file(
        path: str | os.PathLike[str], *, node_name: str = 'icofabric',
        namespace: str = '/') -> dict[str, Value]:
    """
    Return the dotted names and values that the node gets from a parameter file.

    Warn if no section of the file is for the node.
    """
    parameters = ParameterSet(full_node_name(node_name, namespace))
    parameters.add_file(_read(path), os.fspath(path))
    for notice in parameters.notices():
        _LOGGER.warning('%s', notice)
    return parameters.parameters()


def parse_parameter_override(
        rule: str, *, node_name: str = 'icofabric') -> tuple[str, Value]:
    """Return the name and value of one override `name:=value`, as after `--ros-args -p`."""
    section, name, text, source = _split_rule('-p', rule)
    if not section_matches(section, '/' + node_name):
        raise ParameterFileError(
            f'{source}: this override is for the node {section!r}, not for {node_name!r}; write '
            f'{name}:=value')
    parameters = ParameterSet('/' + node_name)
    parameters.add_override('/**', name, text, source)
    return name, parameters.parameters(with_ros_own=True)[name]


def check_ros_arguments(
        argv: Sequence[str], *, node_name: str = 'icofabric', namespace: str = '/',
        notices: list[str] | None = None) -> dict[str, Value]:
    """
    Return the dotted names and values that the node gets from its command line.

    Applies parameter files, overrides and node remappings (`-r __node:=x`, `-r __ns:=/y`) of all
    `--ros-args` sections in order; rclpy handles the other arguments. Appends a sentence to
    `notices` for every file and every override without effect.
    """
    files_and_rules: list[str | _Rule] = []
    remaps: list[re.Match[str]] = []
    arguments = iter(argv)
    in_ros_section = False
    for argument in arguments:
        if argument == '--ros-args':
            in_ros_section = True
        elif not in_ros_section:
            _add_remap(remaps, argument)  # rcl also accepts remappings outside --ros-args
        elif argument == '--':
            in_ros_section = False
        elif argument in ('-p', '--param'):
            files_and_rules.append(_split_rule(argument, _following(arguments, argument)))
        elif argument == '--params-file':
            files_and_rules.append(_following(arguments, argument))
        elif argument in ('-r', '--remap'):
            _add_remap(remaps, _following(arguments, argument))
        elif argument in _OPTIONS_WITH_VALUE:
            _following(arguments, argument)
    # The first matching rule wins; a namespace rule is matched against the remapped node name.
    node_name = next((
        remap['node'] for remap in remaps
        if remap['node'] and remap['prefix'] in (None, node_name)), node_name)
    namespace = next((
        remap['namespace'] for remap in remaps
        if remap['namespace'] and remap['prefix'] in (None, node_name)), namespace)
    parameters = ParameterSet(full_node_name(node_name, namespace))
    for given in files_and_rules:
        if isinstance(given, _Rule):
            parameters.add_override(*given)
        else:
            parameters.add_file(_read(given), given)
    result = parameters.parameters()
    if notices is not None:
        notices.extend(parameters.notices())
    return result


def _following(arguments: Iterator[str], flag: str) -> str:
    value = next(arguments, None)
    if value is None:
        raise ParameterFileError(
            f'command line: {flag} has no value; write one after it or remove it')
    return value


def _add_remap(remaps: list[re.Match[str]], rule: str) -> None:
    match = _REMAP.fullmatch(rule)
    if match is not None:
        remaps.append(match)


def _split_rule(flag: str, rule: str) -> _Rule:
    source = f'command line ({flag} {rule})'
    prefix = _NODE_PREFIX.match(rule)
    begin = prefix.end() if prefix else 0
    end = rule.find(':=', begin)
    if end < 0:
        raise ParameterFileError(f'{source}: not an override; write name:=value')
    name, text = rule[begin:end], rule[end + 2:]
    if not _is_name(name):
        raise ParameterFileError(
            f'{source}: {name!r} is not a valid ROS parameter name: write words joined by single '
            'dots, each beginning with a letter or underscore')
    if not text:
        raise ParameterFileError(
            f"{source}: parameter {name!r} has no value; write {name}:=value, or {name}:=\"''\" "
            'for an empty text')
    return _Rule(prefix[1] if prefix else '/**', name, text, source)


def _is_name(name: str) -> bool:
    kinds = ''
    position = 0
    while position < len(name):
        match = _LEXEMES.match(name, position)
        if match is None or match['special']:
            return False
        kinds += '.' if match['dot'] else 'w'
        position = match.end()
    return re.fullmatch(r'w+(?:\.w+)*', kinds) is not None


def _read(path: str | os.PathLike[str]) -> bytes:
    name = os.fspath(path)
    try:
        status = os.stat(name)
        if stat.S_ISDIR(status.st_mode):
            raise ParameterFileError(f'{name} is a folder; give a parameter file (.yaml)')
        if not stat.S_ISREG(status.st_mode):
            raise ParameterFileError(
                f'{name} is not a regular file; write the parameters into one, because the file '
                'is read twice')
        if status.st_size > _MAX_FILE_BYTES:
            raise ParameterFileError(
                f'{name}: {status.st_size} bytes, but a parameter file has at most '
                f'{_MAX_FILE_BYTES}; give the right file')
        with open(name, 'rb') as file:
            return file.read()
    except FileNotFoundError:
        raise ParameterFileError(
            f'{name}: there is no such parameter file (searched from {os.getcwd()}); '
            f'{suggest_scene(str(name))}check the path') from None
    except (OSError, ValueError) as error:
        if isinstance(error, ParameterFileError):
            raise
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise ParameterFileError(
            f'{name}: the parameter file cannot be read: {reason}; check the path and its '
            'permissions') from None
