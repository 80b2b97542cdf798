# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Seven stars in a plane that attract each other, with close encounters (Pleiades)."""

from collections.abc import Iterator

from icofabric_validation.named.free_bodies import yield_refined_curves
from icofabric_validation.named.problem import Curve, Problem
import numpy as np

_MASS = np.arange(1.0, 8.0)
_START = np.array([
    [3, 3, 0], [3, -3, 0], [-1, 2, 0], [-3, 0, 0], [2, 0, 0], [-2, -4, 0], [2, 4, 0]], float)
_VELOCITY = np.array([
    [0, 0, 0], [0, 0, 0], [0, 0, 0], [0, -1.25, 0], [0, 1, 0], [1.75, 0, 0], [-1.5, 0, 0]])
_END = 3.0
# Positions at t = 3: Bari test set (F. Mazzia, C. Magherini, release 2.4, II-11), by GAMD in
# quadruple precision.
_ANSWER = np.array([
    [0.3706139143970502, -0.3943437585517392e1, 0.0],
    [0.3237284092057233e1, -0.3271380973972550e1, 0.0],
    [-0.3222559032418324e1, 0.5225081843456543e1, 0.0],
    [0.6597091455775310, -0.2590612434977470e1, 0.0],
    [0.3425581707156584, 0.1198213693392275e1, 0.0],
    [0.1562172101400631e1, -0.2429682344935824, 0.0],
    [-0.7003092922212495, 0.1091449240428980e1, 0.0]])


def _acceleration(time: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    apart = x[None, :, :] - x[:, None, :]
    squared = (apart * apart).sum(axis=2)
    np.fill_diagonal(squared, 1.0)
    pull: np.ndarray = np.einsum('ij,ijk->ik', _MASS / squared**1.5, apart)
    return pull


def _solve(long: bool) -> Iterator[Curve]:
    yield from yield_refined_curves(
        _acceleration, _START, _VELOCITY, _END, _ANSWER,
        tolerances=(1e-4, 1e-6, 1e-8, 1e-10, 1e-12) + ((1e-13,) if long else ()),
        steps=tuple(_END / n for n in (2048, 3072, 4096) + ((8192, 12288) if long else ())),
        # Initial errors grow about 1e3 times until the end.
        allowed=1e-10, allowed_given=1e-5, floor=5e-12)


PROBLEM = Problem(
    'pleiades', 'seven stars with close encounters',
    'Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.10; answer: Test Set '
    'for IVP Solvers, Bari',
    'largest error of a coordinate at t = 3', _solve, has_long_form=True)
