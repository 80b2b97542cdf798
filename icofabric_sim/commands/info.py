# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric info SCENE|BAG`."""

import argparse
from contextlib import nullcontext
import math

import icofabric_sim as ico
from icofabric_sim.commands.bags import bag_errors, bag_path, is_bag
from icofabric_sim.commands.report import add_json_argument, print_report
from icofabric_sim.commands.scenes import add_scene_arguments, read_parameters
from icofabric_sim.parameters.example_scenes import example_scenes
from icofabric_sim.terminal import bad_input, InputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    add_scene_arguments(parser, 'SCENE|BAG', 'the folder of a bag')
    add_json_argument(parser)
    parser.add_argument(
        '--compile', action='store_true',
        help='compile the kernels of the scene if needed, to report method, step and accuracy')


def main(arguments: argparse.Namespace) -> int:
    """Describe a scene, or summarise a bag."""
    path = bag_path(arguments.scene)
    if arguments.scene not in example_scenes() and is_bag(path):
        if arguments.parameter:
            raise InputError('-p applies to scenes; a recorded run cannot be changed')
        from icofabric_sim.bag.summary import summarise_bag
        with bag_errors(path):
            print_report(summarise_bag(path).rows(), as_json=arguments.json)
        return 0
    return _describe(arguments)


def _describe(arguments: argparse.Namespace) -> int:
    from icofabric_sim.commands.scene_estimates import estimate_rows
    from icofabric_sim.process.compile_notice import compile_notice, KernelsMissing
    from icofabric_sim.scene.summary import describe_scene

    name, parameters = read_parameters(arguments)
    with bad_input():
        scene = ico.Scene.from_parameters(parameters)
        rows = [('scene', name), *describe_scene(scene), *estimate_rows(scene)]
        try:
            with nullcontext() if arguments.compile else compile_notice.forbidden():
                rows += _motion(ico.compile_scene(scene))
        except KernelsMissing:
            rows.append(('step', (
                'method, step and accuracy need the kernels of this scene, '
                'which are not compiled yet: add --compile')))
    duration = parameters['duration']
    rows.append(('duration', f'{duration:g} s' if duration > 0.0 else (
        'none: a node runs until it is stopped, `icofabric run` needs --duration')))
    print_report(rows, as_json=arguments.json)
    return 0


def _motion(simulation: 'ico.Simulation') -> list[tuple[str, str]]:
    """Return rows about frequency, method, step and accuracy of the compiled scene."""
    from icofabric_sim.commands.run_summary import method_rows
    rate = simulation.status.largest_frequency
    rows = [('frequency', f'at most {rate:.6g} rad/s at the start (upper bound)')]
    rows += method_rows(simulation)
    rows.append(('accuracy', _accuracy(simulation)))
    if simulation.status.proximity is not None:
        rows.append(('overlap', str(simulation.status.proximity)))
    return rows


def _accuracy(simulation: 'ico.Simulation') -> str:
    tolerance = simulation.scene.parameters['solver.tolerance']
    rate = simulation.status.error_rate
    if math.isnan(rate):
        return f'error not estimated; solver.tolerance is {tolerance:g} per second'
    return (f'error {rate:.2g} per second at the start (position over a, or rad); '
            f'solver.tolerance is {tolerance:g} per second')
