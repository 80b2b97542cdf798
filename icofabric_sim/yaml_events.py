# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
YAML text to YAML events, with errors that a user understands.

The events come from libyaml, which ROS uses as well, through PyYAML (rclpy needs it, so it is
there with every ROS). ROS installations carry libyaml 0.1.7 to 0.2.5; the few forms that only
the newer ones read are refused, so that a file means the same everywhere.
"""

import re
from typing import Any

import yaml

# Only where PyYAML was built without libyaml is its own parser used.
_LOADER: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)

_DEEPEST = 32
FORM = ('a parameter file has the form "/**:", below it "ros__parameters:", below that '
        '"name: value"')


class ParameterFileError(ValueError):
    """
    A parameter file, override or dictionary that cannot be used: where, which name, what to do.
    """


def read_events(data: bytes, source: str) -> list[Any]:
    """
    All events of a YAML text; `source` names it in errors.
    """
    try:
        text = data.decode('utf-8-sig')
    except UnicodeDecodeError as error:
        line = data.count(b'\n', 0, error.start) + 1
        raise ParameterFileError(
            f'{source}:{line}: not a text in UTF-8 (byte 0x{data[error.start]:02x}); give a YAML '
            'file saved as UTF-8') from None
    events = []
    # Whether each open list or map is written with brackets.
    in_brackets = [False]
    try:
        for event in yaml.parse(data, Loader=_LOADER):
            events.append(event)
            line = event.start_mark.line + 1
            if isinstance(event, yaml.CollectionStartEvent):
                in_brackets.append(bool(event.flow_style))
                if len(in_brackets) > _DEEPEST:
                    raise ParameterFileError(
                        f'{source}:{line}: nested more than {_DEEPEST} deep; no parameter is')
            elif isinstance(event, yaml.CollectionEndEvent):
                in_brackets.pop()
            elif isinstance(event, yaml.AliasEvent):
                raise ParameterFileError(
                    f'{source}:{line}: ROS refuses aliases (*{event.anchor}); write the value '
                    'again')
            _refuse_new_forms(event, text, in_brackets[-1], f'{source}:{line}')
    except yaml.YAMLError as error:
        raise ParameterFileError(_explain(error, data, source)) from None
    return events


def _refuse_new_forms(event: Any, text: str, in_brackets: bool, where: str) -> None:
    if isinstance(event, yaml.DocumentStartEvent) and event.version not in (None, (1, 1)):
        raise ParameterFileError(
            f'{where}: not every ROS reads YAML {event.version[0]}.{event.version[1]}; delete '
            'the line that begins with %YAML')
    if not isinstance(event, yaml.ScalarEvent):
        return
    if event.style == '"':
        written = text[event.start_mark.index:event.end_mark.index]
        if '\\' in written and '/' in re.findall(r'\\(.)', written, re.DOTALL):
            raise ParameterFileError(
                f'{where}: not every ROS reads "\\/" in a quoted text; write "/" alone')
    elif in_brackets and event.style in ('', None) and re.search('[:?]', event.value):
        raise ParameterFileError(
            f'{where}: not every ROS reads {event.value!r} inside brackets; quote it, or put a '
            'space after the colon if a map is meant')


def _explain(error: yaml.YAMLError, data: bytes, source: str) -> str:
    if isinstance(error, yaml.reader.ReaderError):
        line = data.count(b'\n', 0, error.position) + 1
        return (f'{source}:{line}: not a text file ({error.reason}); give a YAML file saved as '
                'UTF-8')
    mark = getattr(error, 'problem_mark', None) or getattr(error, 'context_mark', None)
    where = f'{source}:{mark.line + 1}:{mark.column + 1}' if mark else source
    what = getattr(error, 'problem', None) or str(error)
    context = getattr(error, 'context', None)
    tip = 'indent with spaces' if 'token' in what or 'tab' in what else (
        'check the indentation, quotes and brackets here and on the line above')
    return f'{where}: not valid YAML: {what}{f" {context}" if context else ""}; {tip}'
