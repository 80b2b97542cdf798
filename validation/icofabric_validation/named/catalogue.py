# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The numbered problems, and their runs one after another."""

from collections.abc import Iterator, Sequence
import logging
import time
from typing import Final

from icofabric_sim.simulation.errors import Interrupted, SimulationError
from icofabric_validation.named import (
    arenstorf,
    bouncing,
    falling_grid,
    fermi_pasta_ulam,
    granular_gas,
    heap,
    impacts,
    incline,
    pleiades,
    time_reversal,
    toda,
    wave_packet,
)
from icofabric_validation.named.problem import Answer, Curve, PremiseError, Problem

_LOGGER = logging.getLogger('icofabric_sim')
# Numbers are positions in this list, from 1: add new problems at the end.
PROBLEMS: Final[tuple[Problem, ...]] = (
    pleiades.PROBLEM,
    arenstorf.PROBLEM,
    fermi_pasta_ulam.PROBLEM,
    toda.PROBLEM,
    wave_packet.PROBLEM,
    time_reversal.PROBLEM,
    impacts.NORMAL,
    impacts.OBLIQUE,
    bouncing.PROBLEM,
    incline.SLIDES,
    incline.TIPS,
    falling_grid.FALLING,
    falling_grid.ELASTIC,
    granular_gas.PROBLEM,
    heap.PROBLEM,
)


def solve_all(numbers: Sequence[int], *, long: bool = False) -> Iterator[Answer]:
    """
    Run problems by their numbers, and yield each answer when it is complete.

    A refused scene or a stopped run is an answer with a fault.
    """
    for number in numbers:
        problem = PROBLEMS[number - 1]
        curves: list[Curve] = []
        failure, began = '', time.process_time()
        level = _LOGGER.level
        # Some contacts are too soft on purpose: problems compare them with stiffer ones.
        _LOGGER.setLevel(logging.ERROR)
        try:
            curves.extend(problem.solve(long))
        except Interrupted:
            raise
        except SimulationError as error:
            failure = f'the run stopped: {error}'
        except ValueError as error:
            failure = f'the scene was refused: {error}'
        except PremiseError as error:
            failure = str(error)
        finally:
            _LOGGER.setLevel(level)
        yield Answer(number, problem, tuple(curves), time.process_time() - began, failure)
