# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric modes SCENE`."""

import argparse
import math
import os
from pathlib import Path
import time
from typing import Any, TYPE_CHECKING

import icofabric_sim as ico
from icofabric_sim.commands.equilibrium_outputs import (
    add_output_arguments,
    EquilibriumOutputs,
    kink_text,
    outputs_of,
    touch_text,
)
from icofabric_sim.commands.picture_arguments import picture_path
from icofabric_sim.commands.report import add_json_numbers_argument, print_json, text_to_stderr
from icofabric_sim.commands.scenes import add_scene_arguments, read_parameters
from icofabric_sim.libraries import require_library
from icofabric_sim.terminal import bad_input, CommandFailed, InputError, Progress, require_place

if TYPE_CHECKING:
    import numpy as np

_SHOWN = 12
_DRAWN = 5  # number of modes in a picture
# Endings of other files, which are not accepted for an animation.
_OTHER_FILES = ('.png', '.jpg', '.jpeg', '.mp4', '.webm', '.avi', '.mov', '.mcap', '.db3')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    add_scene_arguments(parser)
    parser.add_argument(
        '--count', type=int, metavar='N',
        help='number of frequencies (default: all for up to 2,400 degrees of freedom, else 20)')
    parser.add_argument(
        '--highest', action='store_true', help='highest frequencies instead of the lowest')
    parser.add_argument(
        '--branch', choices=('pull', 'push'),
        help='stiffness assumed in pictures and animations for connectors at their natural '
             'length: pull uses k_e, push uses k_c (default: push). Lists and files contain '
             'both; bands only this one (default: both)')
    parser.add_argument(
        '--equilibrium', action='store_true',
        help='about the equilibrium under the loads of the scene, as found by icofabric statics '
             '(default: about the initial configuration); bands are about the equilibrium of the '
             'periodic fabric, with contact')
    parser.add_argument(
        '--time', type=float, metavar='S',
        help='hold loads, drives and anchors at their values at this time [s] (required if they '
             'change with time)')
    parser.add_argument(
        '--bands', metavar='FILE',
        help='also draw the dispersion of waves in the periodic fabric to this PNG: band '
             'structure and density of states')
    parser.add_argument(
        '--animate', metavar='PATH',
        help='animate one mode: a path that ends in .gif is an animated picture, any '
             'other new path the folder of a bag for replay_node and icofabric render')
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        '--mode', type=int, metavar='N', help='mode to animate, as listed (default: 0)')
    which.add_argument(
        '--mechanism', type=int, metavar='N',
        help='animate a zero-energy motion instead (from 0; for up to 2,400 degrees of freedom)')
    add_output_arguments(parser)
    add_json_numbers_argument(parser)


def main(arguments: argparse.Namespace) -> int:
    """Find the normal modes, and count the zero-energy motions."""
    with text_to_stderr(arguments.json):
        report = _find(arguments)
    if arguments.json:
        print_json(report)
    return 0


def _find(arguments: argparse.Namespace) -> dict[str, Any]:
    """Compute the spectrum, write the requested output, and return the report."""
    name, parameters = read_parameters(arguments)
    outputs = outputs_of(arguments)
    bands = picture_path(arguments, 'bands')
    animation = _animation_path(arguments)
    from icofabric_sim.scene.summary import size_text
    from icofabric_sim.statics.modes import HIGHEST, LOWEST, solve_modes
    from icofabric_sim.statics.resultants import LEAST_RESULTANTS

    began = time.monotonic()
    with bad_input():
        scene = ico.Scene.from_parameters(parameters)
        print(f'{name}: {size_text(scene)}')
        at = None
        if arguments.equilibrium:
            found = ico.solve_equilibrium(scene, time=arguments.time)
            print(f'verdict     {found.verdict} (residual {found.residual:.2g})')
            if not found.converged or found.verdict == LEAST_RESULTANTS:
                raise CommandFailed(
                    'no equilibrium was found; icofabric statics shows why')
            at = found.snapshot
        spectrum = solve_modes(
            scene, at=at, time=arguments.time, count=arguments.count,
            which=HIGHEST if arguments.highest else LOWEST, branch=arguments.branch)
    print('\n'.join(summary(spectrum, time.monotonic() - began)))
    _write(outputs, spectrum)
    if animation is not None:
        _animate(animation, name, scene, spectrum, arguments)
    if outputs.picture is not None:
        outputs.draw(name, scene, _pictures(scene, spectrum))
    if bands is not None:
        from icofabric_sim.pictures.band_picture import draw_bands
        bands.parent.mkdir(parents=True, exist_ok=True)
        with bad_input():
            draw_bands(
                bands, name, scene, branch=arguments.branch, relaxed=arguments.equilibrium)
        print(f'drawn to {bands}')
    branches = {key: _numbers(one) for key, one in spectrum.branches.items()}
    return {'scene': name, 'bodies': scene.body_count, 'connectors': scene.connector_count,
            **_numbers(spectrum), 'branch': spectrum.branch, 'branches': branches,
            'bounds_rad_per_s': spectrum.bounds,
            'first_bounded_motion': spectrum.first_bounded_motion}


def _numbers(spectrum: 'ico.Spectrum') -> dict[str, Any]:
    return {
        'degrees_of_freedom': spectrum.degrees_of_freedom,
        'frequencies_rad_per_s': spectrum.frequencies,
        'mechanism_count': spectrum.mechanism_count, 'rigid_count': spectrum.rigid_count,
        'unstable_count': spectrum.unstable_count, 'self_stress_count': spectrum.self_stress_count,
        'largest_frequency_rad_per_s': spectrum.largest_frequency,
        'relative_errors': spectrum.relative_errors,
        'unresolved_mode_count': spectrum.unresolved_mode_count,
        'zero_frequency_limit_rad_per_s': spectrum.zero_frequency_limit}


def summary(spectrum: 'ico.Spectrum', seconds: float) -> list[str]:
    """Return lines for the terminal."""
    lines = [f'DOF         {spectrum.degrees_of_freedom:,} degrees of freedom']
    if spectrum.first_touches:
        lines.append(f'touching    {touch_text(spectrum.first_touches)}')
    if not spectrum.branches:
        lines += _spectrum_text(spectrum)
    else:
        lines.append(f'at its kink {kink_text(len(spectrum.at_kink), spectrum.anchors_at_kink)}')
        lines += [f'            {words}' for words in _KINK]
        for branch, said in _BRANCHES.items():
            lines.append(f'{branch}, {said}')
            lines += [f'  {line}' for line in _spectrum_text(spectrum.branches[branch])]
        lines += _bounds_text(spectrum)
    lines.append(f'{seconds:.3g} s')
    return lines


# Thresholds below which no warning is printed: largest ratio of a frequency that may count as 0 to
# the lowest frequency, and largest relative error of the latter.
_UNCLEAR, _INEXACT = 0.1, 1e-6
_KINK = (
    'Such a fabric has no single frequency for each mode. Two branches bound it: all of these',
    'have k_e (tension), or all have k_c. Any combination has its k-th frequency in between.',
    'The period is independent of the amplitude, but motions do not superpose.')
_BRANCHES = {'pull': 'k_e in all at their kink', 'push': 'k_c in all at their kink'}


def _spectrum_text(spectrum: 'ico.Spectrum') -> list[str]:
    import numpy as np

    lines = []
    if spectrum.mechanism_count < 0:
        lines.append('zero energy not counted')
    else:
        lines.append(
            f'zero energy {spectrum.mechanism_count:,} motions, of which {spectrum.rigid_count} '
            'are rigid-body motions of the fabric')
    counts = spectrum.counts
    if counts is not None:
        lines.append(
            f'geometry    {counts.degrees_of_freedom:,} degrees of freedom - '
            f'{counts.connectors:,} connectors = {counts.mechanisms:,} mechanisms - '
            f'{counts.self_stresses:,} states of self-stress')
    lines += _rounding_text(spectrum)
    if spectrum.unstable_count > 0:
        lines.append(f'unstable    {spectrum.unstable_count:,} motions decrease the energy')
    rates = spectrum.frequencies
    if len(rates):
        lines.append(
            f'frequencies {len(rates):,}, {rates[0]:.6g} to {rates[-1]:.6g} rad/s '
            f'({rates[0] / (2 * math.pi):.6g} to {rates[-1] / (2 * math.pi):.6g} Hz)')
        # Without a kink the limit holds for any small amplitude; at the kink it is 0.
        factors = spectrum.amplitudes[:_SHOWN]
        holds = np.isfinite(factors) & (factors > 0.0)
        for number, rate in enumerate(rates[:_SHOWN].tolist()):
            line = f'  {number:4d}  {rate:14.8g} rad/s  {rate / (2 * math.pi):14.8g} Hz'
            if holds[number]:
                shape = np.abs(factors[number] * spectrum.shapes[number])
                line += f'  up to {shape[:, :3].max():.3g} m, {shape[:, 3:].max():.3g} rad'
            lines.append(line)
        if len(rates) > _SHOWN:
            lines.append(f'  ... and {len(rates) - _SHOWN:,} more')
        if holds.any():
            lines.append(
                '  up to: largest displacement and rotation of a body at which the first '
                'connector changes between tension and compression')
        largest = spectrum.largest_frequency
        lines.append(
            f'largest     {largest:.6g} rad/s ({largest / (2 * math.pi):.6g} Hz), which '
            'limits the automatic step')
    else:
        lines.append('frequencies none')
    return lines


def _rounding_text(spectrum: 'ico.Spectrum') -> list[str]:
    """Report what round-off hides if stiffnesses differ by orders of magnitude."""
    lines, rates, errors = [], spectrum.frequencies, spectrum.relative_errors
    if hidden := spectrum.unresolved_mode_count:
        lines.append(
            f'round-off   {hidden:,} of the zero-energy motions stretch connectors: '
            f'frequencies below {spectrum.zero_frequency_limit:.3g} rad/s are counted as 0')
    elif spectrum.mechanism_count > 0 and len(rates) and (
            spectrum.zero_frequency_limit > _UNCLEAR * rates[0]):
        lines.append(f'round-off   frequencies below {spectrum.zero_frequency_limit:.3g} rad/s '
                     'are counted as 0')
    if len(errors) and errors[0] > _INEXACT:
        lines.append(f'round-off   relative error of the lowest frequency {errors[0]:.1g}')
    return lines


def _bounds_text(spectrum: 'ico.Spectrum') -> list[str]:
    bounds = spectrum.bounds
    if bounds is None:
        return ['between     unknown: zero-energy motions were not counted']
    lines = [
        'between     bounds of the k-th frequency for any combination of k_e and k_c; '
        'zero-energy motions are counted first']
    lines += [
        f'  {spectrum.first_bounded_motion + row:4d}  {least:14.8g} to {most:14.8g} rad/s'
        for row, (least, most) in enumerate(bounds[:_SHOWN].tolist())]
    if len(bounds) > _SHOWN:
        lines.append(f'  ... and {len(bounds) - _SHOWN:,} more')
    return lines


def _write(outputs: EquilibriumOutputs, spectrum: 'ico.Spectrum') -> None:
    if outputs.folder is None:
        return
    branches = {f'_{name}': one for name, one in spectrum.branches.items()} or {'': spectrum}
    for suffix, one in branches.items():
        outputs.table(f'frequencies{suffix}.csv', ('mode', 'rad_per_s', 'hertz'), (
            [number, rate, rate / (2.0 * math.pi)]
            for number, rate in enumerate(one.frequencies.tolist())))
        outputs.table(
            f'shapes{suffix}.csv',
            ('mode', 'body', 'x', 'y', 'z', 'turn_x', 'turn_y', 'turn_z'), (
                [number, body, *motion]
                for number, shape in enumerate(one.shapes[:_SHOWN].tolist())
                for body, motion in enumerate(shape)))
    if spectrum.bounds is not None:
        outputs.table('frequency_bounds.csv', ('place', 'least_rad_per_s', 'most_rad_per_s'), (
            [spectrum.first_bounded_motion + row, *pair]
            for row, pair in enumerate(spectrum.bounds.tolist())))


def _pictures(
    scene: 'ico.Scene', spectrum: 'ico.Spectrum'
) -> list[tuple['np.ndarray', 'np.ndarray', str]]:
    from icofabric_sim.pictures.mode_animation import displaced, scaled_shape

    rest = spectrum.snapshot
    states = [(rest.position, rest.orientation, 'equilibrium')]
    for rate, shape in zip(spectrum.frequencies[:_DRAWN], spectrum.shapes):
        there = displaced(rest, scaled_shape(scene, shape))
        states.append((there.position, there.orientation, f'{rate:.5g} rad/s'))
    return states


def _animation_path(arguments: argparse.Namespace) -> Path | None:
    """Return the path of the animation: a GIF, or a folder that does not exist yet."""
    wanted = arguments.mode if arguments.mechanism is None else arguments.mechanism
    if arguments.animate is None:
        if wanted is not None:
            raise InputError('--mode and --mechanism need --animate PATH')
        return None
    if wanted is not None and wanted < 0:
        raise InputError(f'--mode and --mechanism count from 0, got {wanted}')
    path = Path(arguments.animate).expanduser()
    suffix = path.suffix.lower()
    if suffix in _OTHER_FILES:
        raise InputError(
            f'--animate {path}: give a file that ends in .gif, or the folder of a new bag')
    if suffix != '.gif' and os.path.lexists(path):
        raise InputError(f'--animate {path} already exists and will not be overwritten')
    if suffix == '.gif':
        require_library('matplotlib', 'a picture')
    return require_place('--animate', path)


def _animate(
    path: Path, name: str, scene: 'ico.Scene', spectrum: 'ico.Spectrum',
    arguments: argparse.Namespace
) -> None:
    """Animate the requested mode or zero-energy motion."""
    from icofabric_sim.pictures.mode_animation import HALF, PERIOD, write_bag, write_gif

    if arguments.mechanism is not None:
        shapes, number = spectrum.mechanisms, arguments.mechanism
        said = f'zero-energy motion {number}'
    else:
        shapes, number = spectrum.shapes, arguments.mode or 0
        said = f'mode {number}'
    if not number < len(shapes):
        raise InputError(f'--animate: {said} does not exist; {len(shapes):,} were found')
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
    print(f'{said} animated in {path}: the period is {PERIOD:g} s')
