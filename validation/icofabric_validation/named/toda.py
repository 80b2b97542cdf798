# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A soliton of the Toda lattice, with a tabulated law of increasing resolution."""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.simulation import compile_scene
from icofabric_validation.named.chain import (
    chain_parameters,
    chain_state,
    set_chain_state,
    write_law,
)
from icofabric_validation.named.problem import Curve, Point, Problem
import numpy as np

# The soliton exp(-(q_n+1 - q_n)) = 1 + sinh^2 k / cosh^2 (k n - t sinh k): connectors shrink by
# up to 2 ln cosh k. Other bodies are at rest up to exp(-2 k n).
_K = 1.0
_RATE = float(np.sinh(_K))
_BODIES = 45
_FIRST, _LAST = 15.0, 27.0  # start and end of the soliton, in bodies


def _soliton(time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return displacements ln(tau_n-1 / tau_n), tau_n = 1 + exp(2 (...)), and velocities (n,)."""
    numbers = np.arange(_BODIES) - _FIRST
    before, current = (
        2.0 * (_K * (numbers - shift) - _RATE * time) for shift in (1.0, 0.0))
    displacement = np.logaddexp(0.0, before) - np.logaddexp(0.0, current)
    velocity = 2.0 * _RATE * (1.0 / (1.0 + np.exp(-current)) - 1.0 / (1.0 + np.exp(-before)))
    return displacement, velocity


def _error(lines: int, tolerance: float) -> tuple[float, float, int]:
    """Return the table spacing [m], the largest final error of a displacement, and steps."""
    end = (_LAST - _FIRST) * _K / _RATE
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'toda.csv'
        spacing = write_law(path, lambda r: -np.expm1(-r), -1.0, 0.2, lines)
        # Bodies far ahead are displaced together, and the ends are at their exact positions.
        simulation = compile_scene(Scene.from_parameters(chain_parameters(
            _BODIES, f'ids 0 {_BODIES - 1}', {
                'connector.law': str(path), 'solver.method': 'dop8',
                'solver.tolerance': tolerance})))
        set_chain_state(simulation, *_soliton(0.0))
        simulation.advance_to(end)
    error = np.abs(chain_state(simulation)[0] - _soliton(end)[0]).max()
    return spacing, float(error), simulation.status.step_count


def _solve(long: bool) -> Iterator[Curve]:
    points = []
    for lines in (24, 48, 96, 192) + ((384, 768, 1536, 3072) if long else ()):
        spacing, error, steps = _error(lines, 1e-9)
        points.append(Point(spacing, error, steps))
    yield Curve('dop8, tabulated law', 'spacing of table [m]', tuple(points), 1.5e-7, order=2.0,
                floor=1e-8)


PROBLEM = Problem(
    'toda', f'a soliton runs over {_LAST - _FIRST:g} bodies of a chain',
    'Toda, Theory of Nonlinear Lattices, 3.2: the lattice of V = exp(-r) + r - 1',
    'largest error of a displacement, in widths of the potential', _solve, has_long_form=True)
