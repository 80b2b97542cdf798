# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of a scene that change with time, and loads without a potential."""

from icofabric_sim import checks
from icofabric_sim.scene.profiles import STEADY_PROFILE
from icofabric_sim.scene.scene import Scene


def check_time(time: float | None) -> None:
    """Raise TypeError or ValueError unless `time` is a simulated time [s]; None passes."""
    if time is not None:
        checks.number('time', time, unit='s', least=0.0)


def held_time(scene: Scene, time: float | None) -> float:
    """
    Return the time [s] at which a scene is held; 0 if none is given and the scene is steady.

    Raises ValueError with the parameters that change with time.
    """
    if time is not None:
        return float(time)
    moving = varying(scene)
    if moving:
        several = f' and {len(moving) - 1} more' if len(moving) > 1 else ''
        raise ValueError(
            f'{moving[0]}{several}: changes with time, but an equilibrium needs steady loads; '
            'give the time at which to hold them (time=, or icofabric statics --time S)')
    return 0.0


def varying(scene: Scene) -> list[str]:
    """Return the parameters that make drives, planes, anchors or loads change with time."""
    parameters = scene.parameters
    found = [
        f'{family}.{name}.motion' for family in ('drives', 'planes')
        for name in parameters.names(family)
        if parameters[f'{family}.{name}.motion'] not in ('fixed', 'hold')]
    for name in parameters.names('anchors'):
        if parameters[f'anchors.{name}.motion']:
            found.append(f'anchors.{name}.motion')
        elif parameters[f'anchors.{name}.file']:
            found.append(f'anchors.{name}.file')
        elif any(parameters[f'anchors.{name}.velocity']):
            found.append(f'anchors.{name}.velocity')
    if not scene.electric.is_potential and scene.electric.profile != STEADY_PROFILE:
        found.append('field.profile')
    found += dict.fromkeys(
        load.expression.name for load in scene.expression_loads
        if 't' in load.expression.variables)
    for section in ('loads', 'tractions', 'line_loads'):
        for name in parameters.names(section):
            key = f'{section}.{name}'
            if parameters[f'{key}.profile'] != 'steady':
                found.append(f'{key}.profile')
            found += [
                f'{key}.{when}' for when in ('start', 'duration') if parameters[f'{key}.{when}']]
    return found


def without_potential(scene: Scene) -> list[str]:
    """Return the names of loads on bodies that follow them or apply torques."""
    parameters = scene.parameters
    found = []
    for name in parameters.names('loads'):
        key = f'loads.{name}'
        acts = any(parameters[f'{key}.force']) or any(parameters[f'{key}.torque'])
        if acts and (
                parameters[f'{key}.frame'] == 'body' or any(parameters[f'{key}.torque'])):
            found.append(key)
    found += [
        f'tractions.{name}' for name in parameters.names('tractions')
        if parameters[f'tractions.{name}.direction'] == 'follower'
        or parameters[f'tractions.{name}.frictionless']]
    found += [
        f'line_loads.{name}' for name in parameters.names('line_loads')
        if parameters[f'line_loads.{name}.frame'] == 'body']
    return found
