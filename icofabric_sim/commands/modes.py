# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
`icofabric modes SCENE`.
"""

import argparse
import math
import time
from typing import TYPE_CHECKING

from icofabric_sim.commands.rest_outputs import (
    add_output_arguments,
    outputs_of,
    picture_path,
)
from icofabric_sim.commands.scenes import add_scene_arguments, read_parameters
from icofabric_sim.commands.terminal import bad_input, FileSaysNo

if TYPE_CHECKING:
    from icofabric_sim.scene import Scene
    from icofabric_sim.statics.modes import Spectrum
    import numpy as np

_SHOWN = 12
# Pictures show modes with this largest rotation [rad], or displacement over a.
_AMPLITUDE = 1.0
_DRAWN = 5


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
        '--time', type=float, default=0.0, metavar='S',
        help='loads, drives and anchors are held as they are at this time [s] (%(default)g)')
    parser.add_argument(
        '--bands', metavar='FILE',
        help='also draw the waves in the endless fabric of this weave to this PNG: band structure '
             'and density of states')
    add_output_arguments(parser)


def main(arguments: argparse.Namespace) -> int:
    """
    Find the vibrations, and count the motions without any.
    """
    name, parameters = read_parameters(arguments)
    outputs = outputs_of(arguments)
    bands = picture_path(arguments, 'bands')
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
    else:
        lines.append('frequencies none')
    lines.append(f'{seconds:.3g} s')
    return lines


def _pictures(
    scene: 'Scene', spectrum: 'Spectrum'
) -> list[tuple['np.ndarray', 'np.ndarray', str]]:
    from icofabric_sim.rotation_forms import turned_by
    import numpy as np

    rest = spectrum.snapshot
    states = [(rest.position, rest.orientation, 'at rest')]
    for rate, shape in zip(spectrum.frequencies[:_DRAWN], spectrum.shapes):
        largest = max(
            float(np.abs(shape[:, :3]).max()) / scene.geometry.half_edge,
            float(np.abs(shape[:, 3:]).max()))
        shape = _AMPLITUDE / largest * shape
        states.append((
            rest.position + shape[:, :3], turned_by(shape[:, 3:], rest.orientation),
            f'{rate:.5g} rad/s'))
    return states
