# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
`icofabric modes SCENE`.
"""

import argparse
import math
import os
from pathlib import Path
import time
from typing import TYPE_CHECKING

from icofabric_sim.commands.rest_outputs import (
    add_output_arguments,
    outputs_of,
    picture_path,
)
from icofabric_sim.commands.scenes import add_scene_arguments, read_parameters
from icofabric_sim.commands.terminal import bad_input, FileSaysNo, InputError, Progress

if TYPE_CHECKING:
    from icofabric_sim.scene import Scene
    from icofabric_sim.statics.modes import Spectrum
    import numpy as np

_SHOWN = 12
_DRAWN = 5  # modes in a picture
# What somebody may expect of an animation.
_OTHER_FILES = ('.png', '.jpg', '.jpeg', '.mp4', '.webm', '.avi', '.mov', '.mcap', '.db3')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """
    Declare what the verb takes.
    """
    add_scene_arguments(parser)
    parser.add_argument(
        '--count', type=int, metavar='N',
        help='so many frequencies (default: all of up to 2,400 freedoms, else 20)')
    parser.add_argument(
        '--highest', action='store_true', help='the highest instead of the lowest')
    parser.add_argument(
        '--equilibrium', action='store_true',
        help='about the equilibrium under the loads of the scene, as icofabric statics finds it '
             '(default: about its initial configuration)')
    parser.add_argument(
        '--time', type=float, metavar='S',
        help='loads, drives and anchors are held as they are at this time [s] (needed where they '
             'change with time)')
    parser.add_argument(
        '--bands', metavar='FILE',
        help='also draw the waves in the endless fabric of this weave to this PNG: band structure '
             'and density of states')
    parser.add_argument(
        '--animate', metavar='PATH',
        help='show one of them in motion: a file that ends in .gif is a picture that moves, any '
             'other new path the folder of a bag for replay_node and icofabric render')
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        '--mode', type=int, metavar='N', help='the one to animate, as listed (default: 0)')
    which.add_argument(
        '--mechanism', type=int, metavar='N',
        help='animate one of the motions without energy instead (from 0; of up to 2,400 freedoms)')
    add_output_arguments(parser)


def main(arguments: argparse.Namespace) -> int:
    """
    Find the vibrations, and count the motions without any.
    """
    name, parameters = read_parameters(arguments)
    outputs = outputs_of(arguments)
    bands = picture_path(arguments, 'bands')
    animation = _animation_path(arguments)
    from icofabric_sim.scene import Scene
    from icofabric_sim.statics.equilibrium import solve_equilibrium
    from icofabric_sim.statics.modes import HIGHEST, LOWEST, solve_modes

    began = time.monotonic()
    with bad_input():
        scene = Scene.from_parameters(parameters)
        print(f'{name}: {scene.body_count:,} bodies, {scene.connector_count:,} connectors')
        at = None
        if arguments.equilibrium:
            found = solve_equilibrium(scene, time=arguments.time)
            print(f'verdict     {found.verdict} (residual {found.residual:.2g})')
            if not found.converged:
                raise FileSaysNo(
                    'there is no equilibrium to vibrate about; icofabric statics says more')
            at = found.snapshot
        spectrum = solve_modes(
            scene, at=at, time=arguments.time, count=arguments.count,
            which=HIGHEST if arguments.highest else LOWEST)
    print('\n'.join(summary(spectrum, time.monotonic() - began)))
    if outputs.folder is not None:
        outputs.table('frequencies.csv', ('mode', 'rad_per_s', 'hertz'), (
            [number, rate, rate / (2.0 * math.pi)]
            for number, rate in enumerate(spectrum.frequencies.tolist())))
        outputs.table(
            'shapes.csv', ('mode', 'body', 'x', 'y', 'z', 'turn_x', 'turn_y', 'turn_z'), (
                [number, body, *motion]
                for number, shape in enumerate(spectrum.shapes[:_SHOWN].tolist())
                for body, motion in enumerate(shape)))
    if animation is not None:
        _animate(animation, name, scene, spectrum, arguments)
    if outputs.picture is not None:
        outputs.draw(name, scene, _pictures(scene, spectrum))
    if bands is not None:
        from icofabric_sim.statics.band_picture import draw_bands
        bands.parent.mkdir(parents=True, exist_ok=True)
        with bad_input():
            draw_bands(bands, name, scene)
        print(f'drawn to {bands}')
    return 0


def summary(spectrum: 'Spectrum', seconds: float) -> list[str]:
    """
    Lines for the terminal.
    """
    lines = [f'freedoms    {spectrum.freedoms:,}']
    if spectrum.mechanism_count < 0:
        lines.append('zero energy not counted')
    else:
        lines.append(
            f'zero energy {spectrum.mechanism_count:,} motions, {spectrum.rigid_count} of them '
            'rigid motions of the whole')
    counts = spectrum.counts
    if counts is not None:
        lines.append(
            f'geometry    {counts.freedoms:,} freedoms - {counts.connectors:,} connectors = '
            f'{counts.mechanisms:,} mechanisms - {counts.self_stresses:,} states of self-stress')
    if spectrum.unstable_count > 0:
        lines.append(f'unstable    {spectrum.unstable_count:,} motions lower the energy')
    rates = spectrum.frequencies
    if len(rates):
        lines.append(
            f'frequencies {len(rates):,}, {rates[0]:.6g} to {rates[-1]:.6g} rad/s '
            f'({rates[0] / (2 * math.pi):.6g} to {rates[-1] / (2 * math.pi):.6g} Hz)')
        lines += [
            f'  {number:4d}  {rate:14.8g} rad/s  {rate / (2 * math.pi):14.8g} Hz'
            for number, rate in enumerate(rates[:_SHOWN].tolist())]
        if len(rates) > _SHOWN:
            lines.append(f'  ... and {len(rates) - _SHOWN:,} more')
        largest = spectrum.largest_frequency
        lines.append(
            f'largest     {largest:.6g} rad/s ({largest / (2 * math.pi):.6g} Hz), by the search '
            'that chooses steps')
    else:
        lines.append('frequencies none')
    lines.append(f'{seconds:.3g} s')
    return lines


def _pictures(
    scene: 'Scene', spectrum: 'Spectrum'
) -> list[tuple['np.ndarray', 'np.ndarray', str]]:
    from icofabric_sim.statics.animation import displaced, scaled_shape

    rest = spectrum.snapshot
    states = [(rest.position, rest.orientation, 'at rest')]
    for rate, shape in zip(spectrum.frequencies[:_DRAWN], spectrum.shapes):
        there = displaced(rest, scaled_shape(scene, shape))
        states.append((there.position, there.orientation, f'{rate:.5g} rad/s'))
    return states


def _animation_path(arguments: argparse.Namespace) -> Path | None:
    """
    Where the animation goes: a GIF, or a folder that is not there yet.
    """
    wanted = arguments.mode if arguments.mechanism is None else arguments.mechanism
    if arguments.animate is None:
        if wanted is not None:
            raise InputError('--mode and --mechanism say what to animate: give --animate PATH too')
        return None
    if wanted is not None and wanted < 0:
        raise InputError(f'--mode and --mechanism count from 0, got {wanted}')
    path = Path(arguments.animate).expanduser()
    suffix = path.suffix.lower()
    if suffix in _OTHER_FILES:
        raise InputError(
            f'--animate {path}: give a file that ends in .gif, or the folder of a new bag')
    if suffix != '.gif' and os.path.lexists(path):
        raise InputError(f'--animate {path} exists already, and no bag is overwritten')
    return path


def _animate(
    path: Path, name: str, scene: 'Scene', spectrum: 'Spectrum', arguments: argparse.Namespace
) -> None:
    """
    Show the mode, or the motion without energy, that is wanted.
    """
    from icofabric_sim.statics.animation import HALF, PERIOD, write_bag, write_gif

    if arguments.mechanism is not None:
        shapes, number = spectrum.mechanisms, arguments.mechanism
        said = f'motion without energy {number}'
    else:
        shapes, number = spectrum.shapes, arguments.mode or 0
        said = f'mode {number}'
    if not number < len(shapes):
        raise InputError(f'--animate: there is no {said}; {len(shapes):,} were found')
    if arguments.mechanism is None:
        said += f', {spectrum.frequencies[number]:.5g} rad/s'
    if path.suffix.lower() == '.gif':
        with Progress(HALF + 1, 'moments') as progress:
            write_gif(
                path, f'{name}: {said}', scene, spectrum.snapshot, shapes[number],
                progress=progress.update)
    else:
        with bad_input():
            write_bag(path, said, scene, spectrum.snapshot, shapes[number])
    print(f'{said} animated in {path}: a swing takes {PERIOD:g} s')
