# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Arguments of the launch files: undeclared ones are rejected, declared ones keep their types."""

from collections.abc import Iterable, Mapping, Sequence
import difflib
import math
import os
import sys
from tempfile import NamedTemporaryFile
from typing import Any

from icofabric_sim.parameters.rcl_scalars import resolve_scalar
from icofabric_sim.parameters.text import dump_parameters

_KINDS = {bool: 'true or false', int: 'an integer', float: 'a number'}


def refuse_unknown_arguments(
    launch_file: str, declared: Iterable[str], command: Sequence[str] | None = None
) -> None:
    """
    Raise RuntimeError for a NAME:=VALUE on the command line that `launch_file` does not declare.

    `ros2 launch` ignores undeclared arguments, so a misspelt name would silently leave the
    default. Only a `command` (that of this process) that starts `launch_file` directly is checked:
    a launch file that includes it has its own arguments.
    """
    words = list(sys.argv if command is None else command)
    name = os.path.basename(launch_file)
    places = [number for number, word in enumerate(words) if os.path.basename(word) == name]
    if not places:
        return
    names = tuple(declared)
    for word in words[places[0] + 1:]:
        given, is_argument, _ = word.partition(':=')
        if is_argument and given not in names:
            near = difflib.get_close_matches(given, names, 1)
            hint = f'did you mean {near[0]}? ' if near else ''
            raise RuntimeError(
                f'{word}: {name} has no argument {given}; {hint}allowed: {", ".join(names)}; '
                '--show-args describes them')


def typed_value(argument: str, text: str, kind: type) -> Any:
    """Return the value of a launch argument, or raise RuntimeError that names it."""
    if kind is str:
        return text
    value = resolve_scalar(text)
    if kind is float and type(value) is int:
        value = float(value)
    is_finite = not isinstance(value, float) or math.isfinite(value)
    if type(value) is not kind or not is_finite:
        raise RuntimeError(
            f'{argument}:={text} is not {_KINDS[kind]}; --show-args lists all arguments')
    return value


def write_parameters(namespace: str, values: Mapping[str, Any]) -> list[str]:
    """
    Write a parameter file for the node `icofabric` and return its path in a list.

    Parameter files written by launch itself contain texts such as 1e3 and y without quotes, which
    ROS reads as numbers and booleans. Without `values` no file is written.
    """
    if not values:
        return []
    node = f'{namespace and "/" + namespace}/icofabric'
    with NamedTemporaryFile(
            'w', encoding='utf-8', prefix='launch_params_', suffix='.yaml', delete=False) as file:
        file.write(dump_parameters(values).replace('/**', node, 1))
    return [file.name]
