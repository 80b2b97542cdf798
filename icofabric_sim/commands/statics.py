# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric statics SCENE`."""

import argparse
import time
from typing import Any

import icofabric_sim as ico
from icofabric_sim.commands.equilibrium_outputs import (
    add_output_arguments,
    kink_text,
    outputs_of,
    touch_text,
)
from icofabric_sim.commands.report import add_json_numbers_argument, print_json, text_to_stderr
from icofabric_sim.commands.scenes import add_scene_arguments, read_parameters
from icofabric_sim.terminal import bad_input, InputError, Progress

_STEP_COLUMNS = (
    'load', 'verdict', 'residual', 'moved_m', 'largest_tension_n', 'reaction_x_n',
    'reaction_y_n', 'reaction_z_n')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    add_scene_arguments(parser)
    parser.add_argument(
        '--time', type=float, metavar='S',
        help='hold loads, drives and anchors at their values at this time [s] (required if they '
             'change with time)')
    parser.add_argument(
        '--tolerance', type=float, default=1e-10, metavar='T',
        help='largest residual force as a fraction of the largest connector force or load '
             '(%(default)g)')
    parser.add_argument(
        '--steps', type=int, default=2000, metavar='N',
        help='maximum number of solver iterations (%(default)d)')
    parser.add_argument(
        '--load-steps', type=int, metavar='N',
        help='increase weight, fields, loads and tractions in N equal steps, each equilibrium '
             'solved from the one before (1); with contact.friction: follow sticking and sliding '
             'contacts on this path, instead of seeking contact forces within the friction cones')
    parser.add_argument(
        '--objective', choices=('energy', 'resultants'),
        help='quantity to minimise: potential energy with contacts as springs, or force and '
             'moment resultants without overlap (docs/statics.md) (default: '
             'equilibrium.objective of the scene)')
    add_output_arguments(parser)
    add_json_numbers_argument(parser)


def main(arguments: argparse.Namespace) -> int:
    """
    Find the static equilibrium and print the forces in it.

    Return 0 for an equilibrium, 1 if none was reached.
    """
    with text_to_stderr(arguments.json):
        report, converged = _find(arguments)
    if arguments.json:
        print_json(report)
    return 0 if converged else 1


def _find(arguments: argparse.Namespace) -> tuple[dict[str, Any], bool]:
    """Solve for the equilibrium; return the report and whether an equilibrium was reached."""
    name, parameters = read_parameters(arguments)
    outputs = outputs_of(arguments)
    if arguments.load_steps is not None and not arguments.load_steps >= 1:
        raise InputError(f'--load-steps must be at least 1, got {arguments.load_steps}')
    from icofabric_sim.scene.summary import size_text

    with bad_input():
        if arguments.objective is not None:
            parameters = parameters.with_changes({'equilibrium.objective': arguments.objective})
        scene = ico.Scene.from_parameters(parameters)
    arguments.objective = scene.parameters['equilibrium.objective']
    if arguments.objective != 'energy' and arguments.load_steps is not None:
        raise InputError(
            '--load-steps requires --objective energy')
    print(f'{name}: {size_text(scene)}')
    from icofabric_sim.statics.held import without_potential
    followers = without_potential(scene)
    if followers:
        print(f'{", ".join(followers)}: follower load or torque without potential energy; the '
              'equilibrium is found by increasing it in steps')
    if _has_friction(scene) and arguments.objective == 'energy':
        print(
            'contact.friction: searching contact forces within the friction cones that balance '
            'all loads; --load-steps N follows a path' if arguments.load_steps is None else
            'contact.friction: sticking and sliding contacts are followed on a path of '
            f'{arguments.load_steps} load steps; more steps (--load-steps) are more '
            'accurate')
    began = time.monotonic()
    reached: list[tuple[float, 'ico.Equilibrium']] = []
    try:
        _search(arguments, scene, reached)
    finally:
        # Also after an interrupt.
        if reached and (len(reached) > 1 or reached[0][0] < 1.0):
            print('\n'.join(_steps_text(scene, reached)))
        if reached and outputs.folder is not None and (arguments.load_steps or 1) > 1:
            outputs.table('load_steps.csv', _STEP_COLUMNS, (
                _step_row(scene, *step) for step in reached))
    factor, result = reached[-1]
    print('\n'.join(summary(scene, result, time.monotonic() - began)))
    outputs.write(
        name, scene, result.snapshot, result.tension, result.reaction, result.reactions,
        result.contacts, None if arguments.objective == 'energy' else result.unbalanced_wrench)
    steps = [dict(zip(_STEP_COLUMNS, _step_row(scene, *step))) for step in reached]
    report = {
        'scene': name, 'bodies': scene.body_count, 'connectors': scene.connector_count,
        'converged': result.converged, 'load': factor, 'unstable_count': result.unstable_count,
        'mechanism_count': result.mechanism_count, 'force_scale_n': result.force_scale,
        'tension_n': result.tension, 'reaction': result.reaction,
        'unbalanced_wrench': result.unbalanced_wrench,
        'reactions': _reaction_numbers(result),
        'contacts': None if result.contacts is None else result.contacts.table(),
        'friction_needed': result.friction_needed,
        'position_m': result.snapshot.position, 'orientation': result.snapshot.orientation,
        'steps': steps}
    of_last = {key: steps[-1][key] for key in (
        'verdict', 'residual', 'moved_m', 'largest_tension_n')}
    return {**report, **of_last}, result.converged


def _search(
    arguments: argparse.Namespace, scene: 'ico.Scene',
    reached: list[tuple[float, 'ico.Equilibrium']]
) -> None:
    """Append equilibria under growing loads to `reached`; the last one is under the full load."""
    from icofabric_sim.statics.equilibrium import Progress as Search
    import numpy as np

    count = arguments.load_steps or 1
    goal = -float(np.log10(arguments.tolerance)) if 0.0 < arguments.tolerance < 1.0 else 1.0
    unit = 'decimal places of the residual' if count == 1 else 'load steps'
    # The residual decreases in jumps, so its rate does not predict the remaining time.
    with Progress(
            goal if count == 1 else count, unit, foreseen=count > 1) as progress, bad_input():
        def show(search: Search) -> None:
            places = min(goal, max(0.0, -float(np.log10(max(search.residual, 1e-300)))))
            progress.update(places if count == 1 else len(reached) + places / goal)

        given = {'time': arguments.time, 'tolerance': arguments.tolerance,
                 'largest_step_count': arguments.steps, 'progress': show}
        if arguments.load_steps is None:
            reached.append((1.0, ico.solve_equilibrium(scene, **given)))
            return
        for step in ico.step_loads(
                scene, [number / count for number in range(1, count + 1)], **given):
            reached.append(step)


def _step_row(scene: 'ico.Scene', factor: float, found: 'ico.Equilibrium') -> list[object]:
    import numpy as np

    moved = float(np.linalg.norm(found.snapshot.position - scene.position, axis=1).max())
    held = found.reaction[:, :3].sum(axis=0).tolist()
    pull = float(np.abs(found.tension).max(initial=0.0))
    return [factor, found.verdict, found.residual, moved, pull, *held]


def _steps_text(scene: 'ico.Scene', reached: list[tuple[float, 'ico.Equilibrium']]) -> list[str]:
    """Return lines for the terminal."""
    lines = ['  load    displ [m]  largest tension [N]']
    for factor, found in reached:
        _, verdict, _, moved, pull, *_ = _step_row(scene, factor, found)
        lines.append(f'  {factor:<6.4g} {moved:10.4g}  {pull:19.5g}  {verdict}')
    factor, found = reached[-1]
    if not found.converged:
        lines.append(f'the following lines refer to {factor:.4g} of the loads')
    return lines


def summary(scene: 'ico.Scene', result: 'ico.Equilibrium', seconds: float) -> list[str]:
    """Return lines for the terminal."""
    from icofabric_sim.checks import counted
    from icofabric_sim.statics.contacts import MAX_INTENDED_OVERLAP_RATIO
    from icofabric_sim.statics.resultants import LEAST_RESULTANTS
    import numpy as np

    lines = [
        f'verdict    {result.verdict}',
        f'residual   {result.residual:.2g} of the largest force, {result.force_scale:.4g} N; '
        f'{counted(result.step_count, "iteration")}, '
        f'{counted(result.product_count, "Hessian-vector product")}, '
        f'{seconds:.3g} s']
    if not result.converged:
        worst = ', '.join(map(str, result.worst_bodies))
        most = float(np.linalg.norm(result.unbalanced_wrench[:, :3], axis=1).max())
        lines.append(f'unbalanced up to {most:.4g} N, most on bodies {worst}')
        lines.append(f'reason     {result.reason}')
    elif result.verdict == LEAST_RESULTANTS:
        worst, left = ', '.join(map(str, result.worst_bodies)), result.unbalanced_wrench
        lines.append(
            f'unbalanced up to {float(np.linalg.norm(left[:, :3], axis=1).max()):.4g} N and '
            f'{float(np.linalg.norm(left[:, 3:], axis=1).max()):.4g} N m, most on bodies {worst}: '
            'contacts would have to carry it')
    elif result.mechanism_count >= 0:
        lines.append(
            f'motions    {result.mechanism_count:,} zero-energy motions, '
            f'{result.unstable_count:,} motions that decrease the energy')
    else:
        lines.append('motions    zero-energy motions could not be counted')
    if result.converged and result.branches:
        lines.append(f'at a kink  {kink_text(len(result.at_kink), result.anchors_at_kink)}')
        lines += [
            f'           if all of these {branch}: {counts.zero:,} zero-energy motions, '
            f'{counts.negative:,} motions that decrease the energy'
            for branch, counts in result.branches.items() if counts.zero >= 0]
        lines.append(
            '           small motions about it do not superpose')
    if len(result.tension):
        lines.append(
            f'connectors {float(result.tension.min()):.4g} to {float(result.tension.max()):.4g} N '
            '(positive: tension)')
    lines += _reactions_text(result)
    moved = float(np.linalg.norm(result.snapshot.position - scene.position, axis=1).max())
    lines.append(f'moved      up to {moved:.4g} m from the woven positions')
    obstructed = int(np.count_nonzero(result.snapshot.obstructed))
    if obstructed and scene.parameters['connector.obstruction'] == 'wrap':
        lines.append(f'around     {obstructed:,} connectors are wrapped over shells')
    elif obstructed:
        lines.append(
            f'obstructed {obstructed:,} connectors pass through their own shell: the equilibrium '
            'does not include this')
    touching = result.contact_state
    if touching is not None:
        lines.append(
            f'contact    {len(touching.pairs):,} pairs of shells and '
            f'{sum(map(len, touching.planes)):,} shells on planes; deepest overlap '
            f'{touching.depth / scene.geometry.half_edge:.2g} a')
        deep = touching.depth / (MAX_INTENDED_OVERLAP_RATIO * scene.geometry.half_edge)
        if deep > 1.0:
            lines.append(
                '           more than the intended 1 % of a: real shells would overlap '
                f'less; use a contact.stiffness of {2.0 * deep * touching.stiffness:.2g} N/m')
    if result.friction is not None and len(result.friction.pairs):
        slides = int(np.count_nonzero(result.friction.slides))
        sizes = np.linalg.norm(result.friction.force, axis=1)
        lines.append(
            f'friction   {len(sizes) - slides:,} contacts stick, {slides:,} slide; up to '
            f'{float(sizes.max()):.4g} N')
    if result.friction_needed < np.inf and result.contacts is not None:
        lines.append(
            f'friction   contacts hold with a smallest margin of '
            f'{result.contacts.smallest_margin:.4g}; required contact.friction '
            f'{result.friction_needed:.4g}, scene: '
            f'{scene.parameters["contact.friction"]:g}')
    if result.first_touches:
        lines.append(f'touching   {touch_text(result.first_touches)}')
    return lines


def _reactions_text(result: 'ico.Equilibrium') -> list[str]:
    """Return the reactions of supports, drives, anchors and planes with their forces."""
    found = result.reactions
    if found is None or not found.force.any():
        return []
    lines: list[str] = []
    for name, force in zip(found.names, found.force.tolist()):
        begin = 'reactions ' if not lines else '          '
        lines.append(
            f'{begin} {name}: {", ".join(f"{value:.6g}" for value in force)} N')
    if len(lines) > 1:
        whole = found.force.sum(axis=0).tolist()
        lines.append('           total: ' + ', '.join(f'{value:.6g}' for value in whole) + ' N')
    return lines


def _reaction_numbers(result: 'ico.Equilibrium') -> dict[str, dict[str, list[float]]]:
    found = result.reactions
    if found is None:
        return {}
    return {
        name: {'point_m': point, 'force_n': force, 'torque_nm': torque}
        for name, point, force, torque in zip(
            found.names, found.point.tolist(), found.force.tolist(), found.torque.tolist())}


def _has_friction(scene: 'ico.Scene') -> bool:
    """Return whether shells can touch with friction."""
    from icofabric_sim.statics.friction import FrictionPath

    return FrictionPath.of(scene) is not None
