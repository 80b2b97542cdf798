# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Fact sheets of the integration methods; tests and benchmarks read this table.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from icofabric_sim.integrators.splitting import splitting
import numpy as np


class Method(NamedTuple):
    """
    What there is to know about a method.
    """

    order: int
    symplectic: bool
    adaptive: bool
    stages: int  # force evaluations for each step
    stability: float  # largest stable product of step and frequency
    chosen: float  # product of step and largest frequency where the step is not given
    source: str
    kicks: tuple[float, ...]
    drifts: tuple[float, ...]
    advance: Callable[..., Any]


def _palindrome(first_half: tuple[float, ...], *, odd: bool) -> tuple[float, ...]:
    """
    Weights of a symmetric method from those of its first half, middle included where `odd`.
    """
    return first_half + tuple(reversed(first_half[:-1] if odd else first_half))


def _symmetric(kicks: tuple[float, ...], drifts: tuple[float, ...], *, odd_kicks: bool,
               **facts: Any) -> Method:
    """
    A method whose missing middle weights follow from the sums of kicks and drifts, both 1.
    """
    def complete(weights: tuple[float, ...], odd: bool) -> tuple[float, ...]:
        middle = 1.0 - 2.0 * sum(weights) if odd else 0.5 - sum(weights)
        return _palindrome((*weights, middle), odd=odd)

    all_kicks = complete(kicks, odd_kicks)
    all_drifts = complete(drifts, not odd_kicks)
    return Method(
        symplectic=True, adaptive=False, stages=len(all_drifts), kicks=all_kicks,
        drifts=all_drifts, advance=partial(splitting, np.array(all_kicks), np.array(all_drifts)),
        **facts)


METHODS: dict[str, Method] = {
    'leapfrog': _symmetric(
        (), (), odd_kicks=False, order=2, stability=2.0, chosen=0.2,
        source='Verlet 1967, Phys. Rev. 159, 98; kick-drift-kick form, with the free rotation as '
        'its drift'),
    # Runge-Kutta-Nystrom splittings: they need [V, [V, [T, V]]] = 0, which holds because the
    # kinetic energy is quadratic in the velocities and spins, the inertia being isotropic.
    'srkn4': _symmetric(
        (0.0829844064174052, 0.396309801498368, -0.0390563049223486),
        (0.245298957184271, 0.604872665711080),
        odd_kicks=True, order=4, stability=3.16, chosen=1.2,
        source='Blanes and Moan 2002, J. Comput. Appl. Math. 142, 313: SRKN 6b'),
    'srkn6': _symmetric(
        (0.0414649985182624, 0.198128671918067, -0.0400061921041533, 0.0752539843015807,
         -0.0115113874206879),
        (0.123229775946271, 0.290553797799558, -0.127049212625417, -0.246331761062075,
         0.357208872795928),
        odd_kicks=False, order=6, stability=3.14, chosen=1.5,
        source='Blanes and Moan 2002, J. Comput. Appl. Math. 142, 313: SRKN 11b'),
}

# What solver.method: auto stands for.
AUTOMATIC = 'leapfrog'
