# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters that ranks or devices do not support yet, with error messages that name them."""

from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Any

from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.scene.body_sizes import size_parameter_names
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.stepping.method_needs import (
    beyond_losses,
    follows_contacts,
    required_method,
)
from icofabric_sim.simulation.stepping.methods import ADAPTIVE, METHODS
from icofabric_sim.terms.registry import LAWS, TERMS
import numpy as np

_ONE, _CPU = 'or run it in one process', 'or solver.device cpu'
_SHARED = 'is not shared by ranks'
# Parameters that turn terms on which neither ranks nor devices compute, and remedies.
_SWITCHES: dict[str, tuple[str, Any, str]] = {
    'coulomb': ('charge.mutual', True, 'take false'),
    'wrapping': ('connector.obstruction', 'wrap', 'take warn or stop')}
# Methods whose steps a device takes through contacts.
_THROUGH_CONTACTS = [name for name in METHODS if follows_contacts(name)]


def require_shareable(scene: Scene, *, cosines: bool, body_force: bool) -> None:
    """Raise ParameterError, or ValueError without a parameter, if ranks cannot share."""
    _require(scene, _lacking(scene), _SHARED, _ONE, cosines=cosines, body_force=body_force)


def require_on_device(
    scene: Scene, *, cosines: bool, body_force: bool, shared: bool
) -> None:
    """
    Raise ParameterError or ValueError if the device of `solver.device` cannot compute the scene.

    `shared` means a scene shared by MPI ranks.
    """
    device = scene.parameters['solver.device']
    if shared:
        raise ParameterError(
            'solver.device',
            f'solver.device {device} is not for ranks of MPI, which compute on processors: take '
            'cpu, or one process')
    _require(
        scene, chain(_lacking(scene), _lacking_on_device(scene)), _on(device), _CPU,
        cosines=cosines, body_force=body_force)
    reason = beyond_losses(scene)
    if reason:
        choice = required_method(scene)
        assert choice is not None
        raise ParameterError(
            'solver.method',
            f'solver.method {choice.name} {_on(device)} for this scene yet: {reason}; leave that '
            f'out, {_CPU}')
    moments = [
        name for name in ('connector.bending_stiffness', 'connector.twisting_stiffness')
        if scene.parameters[name] > 0.0]
    if scene.parameters['weave.kind'] == 'radial' and moments:
        raise ParameterError(
            moments[0], f'{moments[0]} in a weave.kind radial {_on(device)} yet: take 0, {_CPU}')


def require_shareable_method(name: str) -> None:
    """Raise ParameterError if ranks cannot take the steps of the method `name`."""
    _require_method(name, _SHARED, _ONE, [
        other for other, method in METHODS.items() if not method.implicit])


def require_method_on_device(name: str, device: str) -> None:
    """Raise ParameterError if the `device` cannot take the steps of the method `name`."""
    _require_method(name, _on(device), _CPU, [
        other for other, method in METHODS.items() if not method.implicit])


def methods_on_device(scene: Scene) -> tuple[str, ...]:
    """
    Return the names of the methods whose steps of this scene a device takes.

    If slopes of connectors jump, and shells may touch or bodies move on paths, methods that
    resolve these jumps are excluded.
    """
    laws, parameters = scene.connectors.laws if scene.connector_count else None, scene.parameters
    jumps = laws is not None and np.any(
        np.asarray(laws.extension) != np.asarray(laws.compression))
    alone = parameters['contact.mode'] == 'never' and not parameters.names('drives')
    return tuple(
        name for name in _THROUGH_CONTACTS
        if alone or not (jumps and METHODS[name].mends_kinks))


def _on(device: str) -> str:
    return f'is not computed on solver.device {device}'


def _require(
    scene: Scene, lacking: Iterable[tuple[str, str, str]], lacks: str, alone: str, *,
    cosines: bool, body_force: bool
) -> None:
    if cosines:
        raise ParameterError(
            'solver.rotation',
            f"solver.rotation 'direction_cosines' {lacks}: take 'quaternion', " + alone)
    if body_force:
        raise ValueError(f'a body_force {lacks}: leave it out, {alone}')
    for name, what, way_out in lacking:
        raise ParameterError(name, f'{name} {what} {lacks} yet: {way_out}, {alone}')


def _require_method(name: str, lacks: str, alone: str, taken: list[str]) -> None:
    if name not in taken:
        raise ParameterError(
            'solver.method',
            f'solver.method {name} {lacks} yet: take one of {", ".join(taken)}, {alone}')


def _lacking(scene: Scene) -> Iterator[tuple[str, str, str]]:
    """Yield parameters that neither ranks nor devices support, with their values and remedies."""
    parameters = scene.parameters
    for term in TERMS:
        if 'ranks' in term.lacks and term.name in _SWITCHES:
            name, value, remedy = _SWITCHES[term.name]
            if parameters[name] == value:
                yield name, str(value).lower(), remedy
        if 'ranks' in term.lacks and term.name == 'body_force':
            for load in scene.expression_loads:
                yield load.expression.name, 'by place or time', 'leave it out'
        if 'ranks' in term.lacks and term.name == 'ties':
            for name in parameters.names('connectors'):
                yield f'connectors.{name}', '(a custom connector)', 'leave it out'
    for name in scene.platens:
        key = f'planes.{name}.motion'
        yield key, parameters[key], 'take fixed'
    if scene.half_edges is not None and parameters['contact.mode'] != 'never':
        name = size_parameter_names(parameters, scene.shell)[0]
        yield name, f'{parameters[name]!r} m', 'take 0, or contact.mode never'


def _lacking_with_contact(scene: Scene) -> Iterator[tuple[str, str, str]]:
    """Yield what a GPU lacks for scenes whose shells may touch."""
    parameters, never = scene.parameters, 'or contact.mode never'
    for name in ('contact.damping', 'contact.friction'):
        if parameters[name]:
            yield name, f'{parameters[name]!r}', f'take 0, {never}'
    method = str(parameters['solver.method'])
    if method == 'auto':
        return
    if method not in _THROUGH_CONTACTS:
        yield ('solver.method', f'{method} with shells that may touch',
               f'take auto, {", ".join(_THROUGH_CONTACTS)}, {never}')
    if method not in methods_on_device(scene):
        yield ('solver.method', f'{method} with k_e that is not k_c and shells that may touch',
               f'take auto, leapfrog, dop8, {never}')


def _lacking_on_device(scene: Scene) -> Iterator[tuple[str, str, str]]:
    """Yield what a GPU lacks but ranks support."""
    parameters = scene.parameters
    if scene.body_count + len(parameters.names('planes')) > 1 and (
            parameters['contact.mode'] != 'never'):
        yield from _lacking_with_contact(scene)
    lacking = {law.name for law in LAWS if 'GPU' in law.lacks}
    for curve in scene.connectors.curves.curves if scene.connector_count else ():
        if curve.law in lacking:
            yield 'connector.law', f'by {curve.law}', 'take connector.stiffness'
    method = str(parameters['solver.method'])
    for name in parameters.names('drives'):
        if method != 'auto' and method in METHODS and method not in methods_on_device(scene):
            law = ' where k_e is not k_c' if method in _THROUGH_CONTACTS else ''
            yield (f'drives.{name}', f'by {method}{law}',
                   f'take solver.method auto, leapfrog or {ADAPTIVE}')
    for name in parameters.names('anchors'):
        if parameters[f'anchors.{name}.damping']:
            yield f'anchors.{name}.damping', 'above 0', 'take 0'
        if parameters[f'anchors.{name}.motion'] == 'sine':
            yield f'anchors.{name}.motion', 'sine', 'give a table, anchors.NAME.file'
    for family in ('tractions', 'line_loads'):
        for name in parameters.names(family):
            yield f'{family}.{name}', 'with a surface force', 'leave it out'
