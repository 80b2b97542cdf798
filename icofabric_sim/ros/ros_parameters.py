# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Scene parameters as parameters of a node: descriptors, validation of changes, rejections."""

from array import array
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from importlib.util import find_spec
from typing import Any

from icofabric_sim.checks import shown
from icofabric_sim.parameters.changes import require_changeable
from icofabric_sim.parameters.rcl_scalars import resolve_scalar
from icofabric_sim.parameters.table import Change, FAMILIES, Specification
from icofabric_sim.parameters.validation import (
    find_specification,
    make_parameters,
    ParameterError,
    Parameters,
    validate_value,
)
from icofabric_sim.running.parameter_change import ParameterChange
from icofabric_sim.running.rate_limited_log import shortened
from icofabric_sim.scene.scene import check_parameters, estimate_bodies, Scene
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.parameter import Parameter
import yaml

# Parameters that ROS itself declares on every node; the scene ignores them.
ROS_NAMES = ('use_sim_time', 'start_type_description_service')
_QOS_PREFIX = 'qos_overrides.'
_TF_PACKAGE = 'tf2_msgs'
# A scene of this many bodies is built within about ten milliseconds.
_MAX_QUICK_BODIES = 20_000
# A change is validated together with all earlier ones, within about 0.5 s. Changes at run time may
# extend a scene to this many parameters and this much text; a file may hold more.
MAX_NAME_LENGTH, MAX_TEXT_LENGTH = 1000, 16_384  # characters, of all values of a change together
MAX_GIVEN_COUNT, MAX_TOTAL_TEXT = 2000, 65_536
_MAX_FLOAT = 1.7976931348623157e308


def is_foreign(name: str) -> bool:
    """Return whether a parameter belongs to ROS and not to the scene."""
    return name in ROS_NAMES or name.startswith(_QOS_PREFIX)


def describe(name: str, entry: Specification) -> ParameterDescriptor:
    """Return the descriptor of a parameter: meaning, unit and range."""
    descriptor = ParameterDescriptor(
        name=name,
        read_only=entry.change is Change.FIXED,
        # rclpy would not delete parameters of a fixed type; the gate checks every type.
        dynamic_typing=name.split('.')[0] in FAMILIES,
    )
    unit = f' [{entry.unit}]' if entry.unit else ''
    descriptor.description = (
        f'{entry.description}{unit}. A change: {entry.change.value}')
    if entry.choices:
        descriptor.additional_constraints = 'one of ' + ', '.join(str(c) for c in entry.choices)
    if entry.open_minimum:
        descriptor.additional_constraints = f'above {entry.minimum:g}'
    elif entry.smallest is not None:
        descriptor.additional_constraints = f'0, or at least {entry.smallest:g}'
    elif isinstance(entry.default, list) and entry.minimum is not None:
        descriptor.additional_constraints = f'each at least {entry.minimum:g}'
    if not isinstance(entry.default, list) and entry.minimum is not None:
        if isinstance(entry.default, float):
            descriptor.floating_point_range = [
                FloatingPointRange(
                    from_value=float(entry.minimum),
                    to_value=float(entry.maximum or _MAX_FLOAT),
                    step=0.0,
                )
            ]
        elif isinstance(entry.default, int):
            descriptor.integer_range = [
                IntegerRange(
                    from_value=int(entry.minimum), to_value=int(entry.maximum or 2**63 - 1), step=0
                )
            ]
    return descriptor


def make_start_parameters(overrides: Mapping[str, Any]) -> Parameters:
    """
    Return the validated parameters of a node at its start; raise ParameterError or ValueError.
    """
    own = {name: value for name, value in overrides.items() if not is_foreign(name)}
    parameters = make_parameters(own)
    if parameters['tf.group'] and find_spec(_TF_PACKAGE) is None:
        raise ParameterError(
            'tf.group', f'tf.group {parameters["tf.group"]!r} needs the package {_TF_PACKAGE}, '
            "which is not installed: install it (part of ROS 2), or set tf.group to ''")
    check_parameters(parameters)
    return parameters


class ParameterGate:
    """
    Validator of changes from the parameter services, called before rclpy applies them.

    The rejections of rclpy do not say enough, and an exception in a callback of its parameter
    services ends the executor. Invalid changes therefore never reach rclpy.
    """

    def __init__(
        self,
        parameters: Parameters,
        on_change: Callable[[ParameterChange], None],
        limit: Callable[[], float],
        held: Callable[[str], Any] = lambda name: None,
    ) -> None:
        """
        Start from `parameters`; `on_change` is called with every accepted change.

        `limit` returns the stability limit [s] of the running fabric, `held` the present value of
        a parameter that ROS declares.
        """
        self.accepted = parameters
        self._on_change = on_change
        self._limit, self._held = limit, held

    def set_atomically(
        self, wanted: Iterable[Parameter], store: Callable[[list[Parameter]], SetParametersResult]
    ) -> SetParametersResult:
        """Validate `wanted` as one change; if valid, `store` it in the node and pass it on."""
        wanted = list(wanted)
        try:
            change, stored = self._judge(wanted)
        except Exception as error:  # no request may end the executor
            return _refusal(wanted, str(error) or type(error).__name__)
        result = store(stored)
        if not result.successful:
            return _refusal(wanted, result.reason)
        if change is not None:
            self.accepted = change.after
            self._on_change(change)
        return result

    def _judge(
        self, wanted: list[Parameter]
    ) -> tuple[ParameterChange | None, list[Parameter]]:
        given: dict[str, Any] = dict(self.accepted.given())
        stored, touched, earlier = [], False, set()
        for parameter in wanted:
            name = parameter.name
            if not name:
                raise ParameterError(name, 'a parameter without a name cannot be set')
            if len(name) > MAX_NAME_LENGTH:
                raise ParameterError(
                    name, f'{name} has {len(name)} characters; at most {MAX_NAME_LENGTH}')
            if is_foreign(name):
                if parameter.value != self._held(name):
                    stored.append(parameter)
                continue
            if parameter.type_ == Parameter.Type.NOT_SET:
                require_changeable([name])
                if name.split('.')[0] not in FAMILIES:
                    raise ParameterError(name, f'{name} cannot be deleted, only set')
                if name not in self.accepted:
                    raise ParameterError(name, f'{name} is not set, so it cannot be deleted')
                given.pop(name, None)
                stored.append(parameter)
            else:
                # A later value of the same request takes precedence.
                held = None if name in earlier else self.accepted.get(name)
                if isinstance(held, str) and str(parameter.value) == held:
                    continue  # also a text of digits, which tools send as a number
                # The values of contact.mode are booleans in YAML.
                default = name == 'contact.mode' or find_specification(name).default
                value = validate_value(name, restore_type(parameter.value, default))
                if held is not None and _are_equal(value, held):
                    continue  # e.g. from loading a parameter dump; also for fixed parameters
                if not _are_equal(value, self.accepted.get(name)):
                    require_changeable([name])
                given[name] = value
                stored.append(Parameter(name, value=value))
            touched = True
            earlier.add(name)
        if not touched:
            return None, stored
        self._check_size(wanted, given)
        return self._checked(make_parameters(given)), stored

    def _check_size(self, wanted: list[Parameter], given: Mapping[str, Any]) -> None:
        """Reject a change that would take long to validate, now or with each later change."""
        name, length = wanted[0].name, _text_length(parameter.value for parameter in wanted)
        if length > MAX_TEXT_LENGTH:
            raise ParameterError(
                name, f'{name} can be set to a text of at most {MAX_TEXT_LENGTH} characters while '
                f'the node runs, got {length} ({shown(wanted[0].value)}); a file may hold more')
        for have, before, most, what in (
            (len(given), len(self.accepted.explicit), MAX_GIVEN_COUNT, 'parameters'),
            (_text_length(given.values()), _text_length(self.accepted.values()), MAX_TOTAL_TEXT,
             'characters of text'),
        ):
            if have > max(before, most):
                raise ParameterError(
                    name, f'{name}: the scene would have {have} {what}; at most {most} can be set '
                    'while the node runs; a file may hold more')

    def _checked(self, changed: Parameters) -> ParameterChange:
        """Reject a scene that cannot be built; return the change, with a small scene."""
        check_parameters(changed)
        change, step = ParameterChange(self.accepted, changed), changed['solver.step']
        if change.names == {'solver.step'} and not step <= self._limit():
            raise ParameterError(
                'solver.step',
                f'solver.step {step!r} s is beyond the stability limit {self._limit():.6g} s of '
                'the running fabric; choose a smaller step, or 0 for the automatic one',
            )
        if not change.rebuilds or estimate_bodies(changed) > _MAX_QUICK_BODIES:
            return change
        return replace(change, scene=Scene.from_parameters(changed))


def restore_type(value: Any, default: Any) -> Any:
    """
    Convert a string sent by `ros2 param` to the value that a parameter file would give.

    `ros2 param load` and `set` read YAML 1.1, in which 1e-06 and 1.5E3 are strings, and they send
    a list with such an item as one string. `default` has the intended type. A string that YAML 1.1
    would read as a number was quoted by the user and stays a string.
    """
    if isinstance(value, array):
        value = list(value)
    if not isinstance(default, list):
        return _parse_text(value, type(default))
    kind = type(default[0])
    if isinstance(value, str) and value[:1] == '[' and value[-1:] == ']':
        items = [_parse_text(item, kind, any_text=True) for item in value[1:-1].split(',')]
        return value if any(isinstance(item, str) for item in items) else items
    return [_parse_text(item, kind) for item in value] if isinstance(value, list) else value


def _parse_text(value: Any, kind: type, *, any_text: bool = False) -> Any:
    """Return the value that ROS reads from `text` in a file, if it has the type `kind`."""
    if not isinstance(value, str) or kind is str:
        return value
    found = resolve_scalar(value.strip(' \'"'))
    if type(found) not in (kind, int if kind is float else kind):
        return value
    return found if any_text or isinstance(yaml.safe_load(value), str) else value


def _are_equal(one: Any, other: Any) -> bool:
    """Return whether two validated values are equal, also in the sign of zero."""
    return repr(one) == repr(other)


def _text_length(values: Iterable[Any]) -> int:
    return sum(len(value) for value in values if isinstance(value, str))


def _refusal(wanted: list[Parameter], reason: str) -> SetParametersResult:
    """Return a rejection that names the parameter sent, even if another one is the reason."""
    names = [parameter.name for parameter in wanted]
    if not any(name and name in reason for name in names):
        reason = f'{", ".join(names)}: {reason}'
    return SetParametersResult(successful=False, reason=shortened(reason))
