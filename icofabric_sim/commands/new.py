# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric new FILE`."""

import argparse
from pathlib import Path

from icofabric_sim.terminal import bad_input, InputError, require_place

_CORNERS = ' or '.join(f'x_{along} and y_{across}'
                       for along in ('min', 'max') for across in ('min', 'max'))
_HELD = {'side': 'x_min', 'top': 'z_max', 'bottom': 'z_min', 'corners': _CORNERS}
_FREE = {'side': 'x_max', 'top': 'z_min', 'bottom': 'z_max', 'none': 'x_max',
         'corners': 'not x_min and not x_max or not y_min and not y_max'}
# Hooks fix positions but leave rotations free.
_FIX = {'corners': 'tx ty tz'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    parser.add_argument('file', metavar='FILE', help='the new scene, a file that ends in .yaml')
    parser.add_argument(
        '--size', type=int, nargs=3, default=[7, 3, 3], metavar='N',
        help='grid positions along x, y and z (7 3 3)')
    parser.add_argument(
        '--kind', choices=('orthogonal', 'bias'), default='orthogonal',
        help='weave (%(default)s)')
    parser.add_argument(
        '--angle', type=float, default=0.25, metavar='RAD',
        help='connector angle [rad]: a smaller angle gives a denser fabric (%(default)s)')
    parser.add_argument(
        '--stiffness', type=float, default=500.0, metavar='K',
        help='connector stiffness [N/m] (%(default)g)')
    parser.add_argument(
        '--damping', type=float, default=0.02, metavar='C',
        help='connector damping [N s/m] (%(default)g)')
    parser.add_argument(
        '--bending', type=float, default=0.02, metavar='B',
        help='bending stiffness of the connectors [N m/rad]; 0: ideal springs, with which a '
             'fabric folds and hangs like a net (%(default)g)')
    parser.add_argument(
        '--held', choices=(*_HELD, 'none'), default='side',
        help='supported bodies: a layer, or the four upright edges as on hooks, for a '
             'hammock (%(default)s)')
    parser.add_argument('--floor', type=float, metavar='Z', help='height of a floor [m]')
    parser.add_argument('--no-gravity', action='store_true', help='no gravity')
    parser.add_argument(
        '--duration', type=float, default=2.0, metavar='S',
        help='simulated time [s] of `icofabric run` and films (%(default)g)')


def main(arguments: argparse.Namespace) -> int:
    """Write the scene after validating it."""
    from icofabric_sim.parameters.file import load_parameter_file
    from icofabric_sim.parameters.validation import make_parameters
    from icofabric_sim.scene.scene import Scene
    from icofabric_sim.scene.summary import size_text

    path = Path(arguments.file).expanduser()
    if path.suffix not in ('.yaml', '.yml'):
        raise InputError(f'{path}: give a file that ends in .yaml')
    if path.exists():
        raise InputError(f'{path} already exists and will not be overwritten; choose another name')
    require_place('FILE', path)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f'.{path.name}.part')
    try:
        part.write_text(scene_text(arguments, path.name), 'utf-8')
        with bad_input():
            scene = Scene.from_parameters(make_parameters(load_parameter_file(part)))
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    print(f'{path}: {size_text(scene)}')
    print(f'next: icofabric info {path}, or icofabric film {path} film.gif')
    return 0


def scene_text(arguments: argparse.Namespace, name: str) -> str:
    """Return the text of a scene file with comments."""
    held = arguments.held
    down = 0.0 if arguments.no_gravity else -9.81
    lines = [
        f'# {name}: written by icofabric new. All parameters: docs/parameters.md. SI units, '
        'radians.',
        '/**:',
        '  ros__parameters:',
        '    weave:',
        f'      kind: {arguments.kind}',
        f'      size: [{", ".join(map(str, arguments.size))}]  # grid positions; every second one '
        'has a shell',
        f'      connector_angle: {arguments.angle!r}  # [rad], below pi/4; a larger angle gives '
        'longer connectors and a less dense fabric',
        '    connector:',
        f'      stiffness: {arguments.stiffness!r}  # [N/m]',
        f'      damping: {arguments.damping!r}  # [N s/m]; 0: energy is conserved',
        f'      bending_stiffness: {arguments.bending!r}  # [N m/rad]; 0: ideal springs; the '
        'fabric folds',
        f'    gravity: [0.0, 0.0, {down!r}]  # [m/s^2]',
        f'    duration: {arguments.duration!r}  # [s]; a node stops at this time; 0: never',
    ]
    if arguments.floor is not None:
        lines += [
            '    planes:', '      floor:',
            '        normal: [0.0, 0.0, 1.0]  # towards the free side',
            f'        offset: {arguments.floor!r}  # [m]; contact.* sets its stiffness']
    lines += ['    groups:  # selectors: x_min, z_max, level 3, row 0, ids 0 5 7, ...']
    if held != 'none':
        lines.append(f'      held: {_HELD[held]}')
    lines.append(f'      free: {_FREE[held]}')
    if held != 'none':
        lines += ['    supports:', '      hold:', '        group: held',
                  f'        fix: {_FIX.get(held, "all")}  # all, or some of: tx ty tz rotation']
    lines += [
        '    loads:', '      push:  # driven by messages on ~/loads/push, or here:',
        '        group: free', '        share: total  # divided among the bodies of the group',
        '        force: [0.0, 0.0, 0.0]  # [N]']
    return '\n'.join(lines) + '\n'
