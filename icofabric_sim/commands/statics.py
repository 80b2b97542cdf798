# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
`icofabric statics SCENE`.
"""

import argparse
import time
from typing import TYPE_CHECKING

from icofabric_sim.commands.rest_outputs import add_output_arguments, outputs_of
from icofabric_sim.commands.scenes import add_scene_arguments, read_parameters
from icofabric_sim.commands.terminal import bad_input, Progress

if TYPE_CHECKING:
    from icofabric_sim.scene import Scene
    from icofabric_sim.statics.equilibrium import Equilibrium


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """
    Declare what the verb takes.
    """
    add_scene_arguments(parser)
    parser.add_argument(
        '--time', type=float, default=0.0, metavar='S',
        help='loads, drives and anchors are held as they are at this time [s] (%(default)g)')
    parser.add_argument(
        '--tolerance', type=float, default=1e-10, metavar='T',
        help='force that may be left, as a part of the largest connector force or load '
             '(%(default)g)')
    parser.add_argument(
        '--steps', type=int, default=2000, metavar='N',
        help='give up after so many steps (%(default)d)')
    add_output_arguments(parser)


def main(arguments: argparse.Namespace) -> int:
    """
    Find where the fabric comes to rest, and say what holds there.

    Returns 0 for an equilibrium, 1 where none was reached.
    """
    name, parameters = read_parameters(arguments)
    outputs = outputs_of(arguments)
    from icofabric_sim.scene import Scene
    from icofabric_sim.statics.equilibrium import Progress as Search
    from icofabric_sim.statics.equilibrium import solve_equilibrium
    import numpy as np

    with bad_input():
        scene = Scene.from_parameters(parameters)
    print(f'{name}: {scene.body_count:,} bodies, {scene.connector_count:,} connectors')
    goal = -float(np.log10(arguments.tolerance)) if 0.0 < arguments.tolerance < 1.0 else 1.0
    began = time.monotonic()
    with Progress(goal, 'decimal places of the residual') as progress, bad_input():
        def show(search: Search) -> None:
            progress.update(max(0.0, -float(np.log10(max(search.residual, 1e-300)))))

        result = solve_equilibrium(
            scene, time=arguments.time, tolerance=arguments.tolerance,
            largest_step_count=arguments.steps, progress=show)
    print('\n'.join(summary(scene, result, time.monotonic() - began)))
    outputs.write(name, scene, result.snapshot, result.tension, result.reaction)
    return 0 if result.converged else 1


def summary(scene: 'Scene', result: 'Equilibrium', seconds: float) -> list[str]:
    """
    Lines for the terminal.
    """
    import numpy as np

    lines = [
        f'verdict    {result.verdict}',
        f'residual   {result.residual:.2g} of the largest force, {result.force_scale:.4g} N; '
        f'{result.step_count:,} steps, {result.product_count:,} products, {seconds:.3g} s']
    if not result.converged:
        worst = ', '.join(map(str, result.worst_bodies))
        most = float(np.linalg.norm(result.leftover[:, :3], axis=1).max())
        lines.append(f'left over  up to {most:.4g} N, most on bodies {worst}')
    elif result.mechanism_count >= 0:
        lines.append(
            f'motions    {result.mechanism_count:,} cost no energy, {result.unstable_count:,} '
            'lower it')
    else:
        lines.append('motions    those without energy could not be counted')
    if len(result.tension):
        lines.append(
            f'connectors {float(result.tension.min()):.4g} to {float(result.tension.max()):.4g} N '
            '(positive: they pull)')
    held = result.reaction[:, :3].sum(axis=0)
    if result.reaction.any():
        lines.append('reactions  ' + ', '.join(f'{value:.6g}' for value in held) + ' N in all')
    moved = float(np.linalg.norm(result.snapshot.position - scene.position, axis=1).max())
    lines.append(f'moved      up to {moved:.4g} m from the woven places')
    obstructed = int(np.count_nonzero(result.snapshot.obstructed))
    if obstructed:
        lines.append(
            f'obstructed {obstructed:,} connectors lead through a shell of their own: that is not '
            'part of this equilibrium')
    touching = result.touching
    if touching is not None:
        lines.append(
            f'contact    {len(touching.pairs):,} pairs of shells and '
            f'{sum(map(len, touching.planes)):,} shells on planes; deepest overlap '
            f'{touching.depth / scene.geometry.half_edge:.2g} a')
    return lines
