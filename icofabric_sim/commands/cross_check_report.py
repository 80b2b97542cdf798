# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Comparison of rotation formulations and its report, for `icofabric run SCENE --cross-check`."""

from collections.abc import Iterator
from contextlib import contextmanager
import logging
from typing import TYPE_CHECKING

import icofabric_sim as ico
from icofabric_sim.terminal import bad_input, Progress

if TYPE_CHECKING:
    from icofabric_sim.parameters.validation import Parameters

_MAX_ROWS = 16


def report_cross_check(name: str, parameters: 'Parameters') -> int:
    """Compare the rotation formulations; return 0 if they agree up to round-off, otherwise 1."""
    from icofabric_sim.checks import counted
    from icofabric_sim.running.cross_check import cross_check

    with bad_input():
        scene = ico.Scene.from_parameters(parameters)
        with _quiet():
            # Rejects a step above the stability limit, and what needs quaternions.
            for rotation in ('quaternion', 'direction_cosines'):
                ico.compile_scene(scene, rotation=rotation)
    duration = parameters['duration']
    with Progress(duration, 's') as progress, _quiet():
        try:
            result = cross_check(scene, duration, progress=progress.update)
        except ico.SimulationError as error:
            progress.note(f'icofabric run: the simulation failed: {error}')
            return 1
    print(f'{name}: quaternions (eqs 21-27) against direction cosines (eqs 16-20), '
          f'{counted(scene.body_count, "body")}')
    print(f'{"t [s]":>9} {"steps":>9} {"position/a":>11} {"angle [rad]":>11} '
          f'{"growth":>9} {"rounding":>9}')
    count = len(result.rows)
    shown = {round((k + 1) * count / _MAX_ROWS) - 1 for k in range(_MAX_ROWS)}
    for number, row in enumerate(result.rows):
        if number in shown or count <= _MAX_ROWS or not row.agrees:
            print(f'{row.time:9.4f} {row.steps:9,} {row.position:11.2e} {row.angle:11.2e} '
                  f'{row.growth:9.1e} {row.bound:9.1e}' + ('' if row.agrees else '  too far'))
    if result.ended:
        print(f'ended early: {result.ended}')
    if not result.rows:
        print('no state could be compared; choose a shorter --duration or a less chaotic scene')
        return 1
    largest = max(result.rows, key=lambda row: max(row.position, row.angle))
    print(f'largest difference: {max(row.position for row in result.rows):.2e} a in position, '
          f'{max(row.angle for row in result.rows):.2e} rad in orientation, up to '
          f't = {result.rows[-1].time:.6g} s')
    if result.agrees:
        print('the formulations agree: round-off, amplified by this motion, explains differences '
              f'up to {largest.bound:.1e}')
        return 0
    print('the formulations differ by more than amplified round-off explains')
    return 1


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress the warnings of a run, which would appear three times."""
    logger = logging.getLogger('icofabric_sim')
    before = logger.disabled
    logger.disabled = True
    try:
        yield
    finally:
        logger.disabled = before
