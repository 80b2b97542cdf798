# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Fact sheets of the integration methods; tests and benchmarks read this table.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from icofabric_sim.integrators.splitting import leapfrog


class Method(NamedTuple):
    """
    What there is to know about a method.
    """

    order: int
    symplectic: bool
    adaptive: bool
    stages: int  # force evaluations for each step
    stability: float  # largest stable product of step and frequency
    source: str
    advance: Callable[..., Any]


METHODS: dict[str, Method] = {
    'leapfrog': Method(
        order=2,
        symplectic=True,
        adaptive=False,
        stages=1,
        stability=2.0,
        source='Verlet 1967, Phys. Rev. 159, 98; kick-drift-kick form, with the free rotation as '
        'its drift',
        advance=leapfrog,
    ),
}

# What solver.method: auto stands for.
AUTOMATIC = 'leapfrog'
