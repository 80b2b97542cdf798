# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric elasticity SCENE`."""

import argparse
from typing import Any

from icofabric_sim.commands.equilibrium_outputs import add_output_arguments, outputs_of
from icofabric_sim.commands.report import add_json_numbers_argument, print_json, text_to_stderr
from icofabric_sim.commands.scenes import add_scene_arguments, read_parameters
from icofabric_sim.terminal import bad_input, InputError

_KINDS = ('pull', 'push', 'shear', 'hydrostatic', 'inflation', 'bend', 'twist')
_BY_ITSELF = ('pull', 'push', 'shear')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    add_scene_arguments(parser)
    parser.add_argument(
        '--strain', type=float, default=0.1, metavar='E',
        help='largest displacement of the moved end divided by the length (%(default)g)')
    parser.add_argument(
        '--angle', type=float, default=0.1, metavar='RAD',
        help='largest relative angle of the ends in bending and twisting [rad] (%(default)g)')
    parser.add_argument(
        '--points', type=int, default=10, metavar='N', help='states in each curve (%(default)d)')
    parser.add_argument(
        '--axis', choices=('x', 'y', 'z'), default='x', help='axis through both ends of the slab '
                                                             '(%(default)s)')
    parser.add_argument(
        '--about', choices=('x', 'y', 'z'),
        help='rotation axis of a bend, normal to --axis (default: the next axis, y for x)')
    parser.add_argument(
        '--along', nargs=3, type=float, metavar=('X', 'Y', 'Z'),
        help='displacement direction of the moved end in a pull or, reversed, a push (default: '
             '--axis), or in a shear (default: the next axis, y for --axis x)')
    parser.add_argument(
        '--cycles', type=int, default=0, metavar='N',
        help='load and unload N times and report the dissipated energy (%(default)d: load only)')
    parser.add_argument(
        '--kinds', nargs='*', choices=_KINDS, default=_BY_ITSELF, metavar='KIND',
        help='curves of the slab: pull, push, shear, hydrostatic (all faces inwards), inflation '
             '(outwards), bend, twist (default: pull push shear); --kinds without a value: '
             'constants only')
    parser.add_argument(
        '--direction', nargs=3, type=float, action='append', default=[],
        metavar=('X', 'Y', 'Z'),
        help="Young's modulus, Poisson's ratios and shear moduli of the periodic fabric in this "
             'direction, in addition to thirteen others; may be repeated')
    parser.add_argument(
        '--relaxed', action='store_true',
        help='constants of the periodic fabric about its equilibrium, with contact between shells '
             '(contact.mode never: without contact), instead of about the woven state')
    add_output_arguments(parser)
    add_json_numbers_argument(parser)


def main(arguments: argparse.Namespace) -> int:
    """
    Print elastic constants of the periodic fabric and curves of the slab of a scene.

    Return 1 if a curve ends early.
    """
    with text_to_stderr(arguments.json):
        report, early = _find(arguments)
    if arguments.json:
        print_json(report)
    return 1 if early else 0


def _find(arguments: argparse.Namespace) -> tuple[dict[str, Any], bool]:
    """Compute constants and curves; return the report and whether a curve ended early."""
    name, parameters = read_parameters(arguments)
    outputs = outputs_of(arguments)
    if not arguments.points >= 1:
        raise InputError(f'--points must be at least 1, got {arguments.points}')
    if arguments.cycles < 0:
        raise InputError(f'--cycles must be at least 0, got {arguments.cycles}')
    if not 0.0 < abs(arguments.angle) < float('inf'):
        raise InputError(f'--angle must be a finite angle in rad, not 0, got {arguments.angle}')
    axis = 'xyz'.index(arguments.axis)
    about = None if arguments.about is None else 'xyz'.index(arguments.about)
    from icofabric_sim.commands import elastic_constants
    from icofabric_sim.commands.load_cases import LoadCases
    from icofabric_sim.scene.scene import Scene
    from icofabric_sim.statics.held_motion import check_along, DIRECTED
    from icofabric_sim.statics.moment_curve import check_about
    from icofabric_sim.statics.periodic import homogenise
    import numpy as np

    with bad_input():
        scene = Scene.from_parameters(parameters)
        check_about('bend', axis, about)
        directed = [kind for kind in arguments.kinds if kind in DIRECTED]
        for kind in directed or arguments.kinds:
            check_along(kind, axis, arguments.along)
        # Curves of the slab do not need the periodic fabric.
        why = elastic_constants.missing_reason(scene) if arguments.kinds else ''
        constants = None if why else homogenise(scene, relaxed=arguments.relaxed)
    by_direction = {} if constants is None else elastic_constants.by_direction(
        constants, arguments.direction)
    if constants is None:
        print(f'{name}: no constants of a periodic fabric, because {why}')
    else:
        print(f'{name}: periodic fabric')
        print('\n'.join(elastic_constants.text(constants, by_direction, scene)))
    parts = np.arange(1, arguments.points + 1) / arguments.points
    cases = LoadCases(
        arguments.kinds, (arguments.strain * parts).tolist(), (arguments.angle * parts).tolist(),
        axis, about, arguments.cycles, arguments.along)
    try:
        cases.search(scene)
    finally:
        # Also after an interrupt.
        if lines := cases.text(name):
            print('\n'.join(lines))
        if constants is not None:
            elastic_constants.write(outputs, constants, by_direction)
        if outputs.folder is not None:
            cases.write(outputs)
    if outputs.picture is not None:
        from icofabric_sim.pictures.elastic_picture import draw_elasticity
        outputs.picture.parent.mkdir(parents=True, exist_ok=True)
        draw_elasticity(outputs.picture, name, constants, cases.curves, cases.moment_curves)
        print(f'drawn to {outputs.picture}')
    if constants is None:
        return {'scene': name, **cases.numbers()}, cases.early
    return {
        'scene': name, **elastic_constants.numbers(constants, by_direction),
        **cases.numbers()}, cases.early
