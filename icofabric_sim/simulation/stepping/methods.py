# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Fact sheets of the integration methods, also for tests and benchmarks."""

from collections.abc import Callable
import math
from typing import Any, NamedTuple

from icofabric_sim.kernels.integrators.embedded import DOP8, fixed_pair
from icofabric_sim.kernels.integrators.splitting import splitting
from icofabric_sim.kernels.integrators.sweep import Splitting
from icofabric_sim.kernels.integrators.tableau import Pair, pair_of
from icofabric_sim.simulation.stepping import tsit5
from icofabric_sim.simulation.stepping.embedded_kernels import EmbeddedKernels, kernels_of
from icofabric_sim.simulation.stepping.executor import Executor
from icofabric_sim.simulation.stepping.scene_kernel import SceneKernel
import numpy as np

# Order that methods with `mends_kinks` have where the slopes of connectors jump.
KINK_ORDER = 4


def _no_more() -> int:
    """Return 0: no evaluations beyond those of each step."""
    return 0


class Method(NamedTuple):
    """Properties of an integration method."""

    order: int
    symplectic: bool
    adaptive: bool
    stages: int  # force evaluations for each step
    stability: float  # largest stable product of step and frequency
    chosen: float  # product of step and largest frequency where the step is not given
    # Error added in a second to motion of 1 a/s or 1 rad/s at step x frequency 1; measured on
    # the S1 scene of `icofabric benchmark work-precision`.
    error: float
    source: str
    kicks: tuple[float, ...]
    drifts: tuple[float, ...]
    advance: Callable[..., Any]
    # Whether it keeps KINK_ORDER where the slopes of connectors jump (kernels/kinks.py); steps
    # with a crossing are neither symplectic nor reversible then.
    mends_kinks: bool = False
    # Whether each step is the solution of equations (implicit.py), and stable however long it is.
    implicit: bool = False
    # Counts the evaluations of the forces since the last call of it: all of implicit steps, else
    # those beyond `stages` for each step.
    count_evaluations: Callable[[], int] = _no_more
    # What accepts or refuses the steps of an adaptive one.
    embedded: EmbeddedKernels | None = None
    executor: Executor = Executor()  # holder of the state between two calls

    @property
    def runs_through_contacts(self) -> bool:
        """
        True if steps need not resolve the start and end of contacts: errors of order 2.

        Such a method also takes what contacts lose (terms/contacts/losses.py).
        """
        return self.symplectic and self.order == 2


def _symmetric(kicks: tuple[float, ...], drifts: tuple[float, ...], *, first: str,
               odd_kicks: bool, **facts: Any) -> Method:
    """
    Return a symmetric method whose middle weights follow from the sums of kicks and drifts, 1.

    `first` is the flow at the start and end of a step.
    """
    def complete(weights: tuple[float, ...], odd: bool) -> tuple[float, ...]:
        rest = 0.5 - math.fsum(weights)
        middle = (2.0 * rest,) if odd else (rest, rest)
        return (*weights, *middle, *reversed(weights))

    all_kicks = complete(kicks, odd_kicks)
    all_drifts = complete(drifts, not odd_kicks)
    assert len(all_kicks) - len(all_drifts) == (1 if first == 'kick' else -1)
    return Method(
        symplectic=True, adaptive=False, stages=min(len(all_kicks), len(all_drifts)),
        kicks=all_kicks, drifts=all_drifts,
        advance=SceneKernel(
            splitting, Splitting(np.array(all_kicks), np.array(all_drifts))), **facts)


def _embedded(pair: Pair, **facts: Any) -> Method:
    """Return the method of an explicit embedded `pair`; its `facts` are fields of `Method`."""
    return Method(
        symplectic=False, adaptive=True, stages=pair.stage_count, kicks=(), drifts=(),
        advance=SceneKernel(fixed_pair, pair), embedded=kernels_of(pair), **facts)


def _needs_scene(*_: Any) -> Any:
    """Raise ValueError in place of steps that are made for a scene, see implicit.py."""
    raise ValueError('implicit steps are made for a scene: take compile_scene')


METHODS: dict[str, Method] = {
    'leapfrog': _symmetric(
        (), (), first='kick', odd_kicks=False, order=2, stability=2.0, chosen=0.2, error=1.5e-2,
        source='Verlet 1967, Phys. Rev. 159, 98; kick-drift-kick form, with the free rotation as '
        'its drift'),
    # Runge-Kutta-Nystrom splittings: they need [V, [V, [T, V]]] = 0, which holds because the
    # kinetic energy is quadratic in the velocities and spins, the inertia being isotropic.
    'srkn4': _symmetric(
        (0.0829844064174052, 0.396309801498368, -0.0390563049223486),
        (0.245298957184271, 0.604872665711080),
        first='kick', odd_kicks=True, order=4, stability=3.16, chosen=1.9, error=4e-6,
        mends_kinks=True,
        source='Blanes and Moan 2002, J. Comput. Appl. Math. 142, 313: SRKN 6b'),
    'srkn6': _symmetric(
        (0.0414649985182624, 0.198128671918067, -0.0400061921041533, 0.0752539843015807,
         -0.0115113874206879),
        (0.123229775946271, 0.290553797799558, -0.127049212625417, -0.246331761062075,
         0.357208872795928),
        first='kick', odd_kicks=False, order=6, stability=3.14, chosen=1.9, error=2.6e-8,
        mends_kinks=True,
        source='Blanes and Moan 2002, J. Comput. Appl. Math. 142, 313: SRKN 11b'),
    'srkn8': _symmetric(
        (0.129478606560536730662, 0.222257260092671143423, -0.0577514893325147204757,
         -0.0578312262103924910221, 0.103087297437175356748, -0.140819612554090768206,
         0.0234462603492826699714, 0.134854517356684096618, 0.0287973821073779306345),
        (0.0505805, 0.149999, -0.0551795510771615573511, 0.423755898835337951482,
         -0.213495353584659048060, -0.0680769774574032619112, 0.227917056974013435949,
         -0.235373619381058906525, 0.387413869179878047817),
        first='drift', odd_kicks=True, order=8, stability=3.139, chosen=1.9, error=3.8e-9,
        source='Blanes, Casas and Escorihuela-Tomas 2022, arXiv:2202.01541: a scheme of 19 '
        'stages that begins with a drift'),
    'dop8': _embedded(
        DOP8, order=8, stability=5.95, chosen=2.0, error=6.7e-8,
        source='Dormand and Prince, in Hairer, Norsett and Wanner 1993, Solving Ordinary '
        'Differential Equations I, II.10: DOP853, an embedded pair with dense output'),
    # It is for damped motion: without damping, steps above the stated limit gain energy slowly.
    'tsit5': _embedded(
        pair_of(tsit5.TABLEAU), order=5, stability=0.478, chosen=0.4, error=1e-4,
        source='Tsitouras 2011, Comput. Math. Appl. 62, 770: an embedded pair of order 5(4) with '
        'dense output'),
}

# Adaptive method of the highest order, for motion that only steps with an error estimate resolve.
ADAPTIVE = max(
    (name for name, method in METHODS.items() if method.adaptive),
    key=lambda name: METHODS[name].order)

# Methods whose steps are solutions of equations; only damping that is beyond all others asks for
# one. A stage counts as some evaluations, and takes as long as many more.
IMPLICIT: dict[str, Method] = {
    'sdirk4': Method(
        order=4, symplectic=False, adaptive=True, stages=20, stability=math.inf, chosen=1e4,
        error=3e-2, implicit=True,
        source='Hairer and Wanner 1996, Solving Ordinary Differential Equations II, IV.6: '
        'singly diagonally implicit, L-stable and stiffly accurate',
        kicks=(), drifts=(), advance=_needs_scene),
}


def facts_of(name: str) -> Method:
    """Return the facts of a method, explicit or implicit."""
    return METHODS[name] if name in METHODS else IMPLICIT[name]
