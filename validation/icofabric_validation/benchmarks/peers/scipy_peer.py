# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""SciPy's DOP853 over a compiled right-hand side: the best general tool for accuracy."""

from collections.abc import Iterator

from icofabric_sim.libraries import install_command
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.model.rhs import compile_rates
from icofabric_validation.benchmarks.peers.plain_rates import flat_state, plain_rates, Rates
from icofabric_validation.benchmarks.scenes import (
    axes_from_quaternions,
    Motion,
    PlainScene,
    scene_parameters,
    SIZES,
)
from icofabric_validation.benchmarks.solver import Solver, ToleranceSolver
import numpy as np

DISTRIBUTION = 'scipy'
INSTALL = install_command('scipy')
# Relative tolerance if only the absolute one should matter; SciPy needs at least 100 epsilon.
_MIN_TOLERANCE_RATIO = 3e-14


def package_rates(scene: PlainScene) -> Rates | None:
    """Return f(t, y) over kernels of this package, y as in `flat_state`; None: not supported."""
    if scene.name not in SIZES:
        return None
    own = Scene.from_parameters(scene_parameters(SIZES[scene.name]))
    return compile_rates(own) if own.body_count == scene.body_count else None


class Dop853(ToleranceSolver):
    """DOP853 with absolute tolerances in the units of each quantity."""

    tool = 'scipy'
    order = 8
    # At 0.1 the quaternions lose their length, and the motion becomes stiff.
    roughest = 1e-2

    def __init__(self, label: str, scene: PlainScene, rates: Rates) -> None:
        """Create a solver of `rates`."""
        self.label, self._rates = label, rates
        self._start = flat_state(scene)
        # Units of the error of positions, and of velocities with the frequency of the springs.
        frequency = np.sqrt(scene.stiffness / scene.mass)
        kinds = np.array([scene.half_edge, 1.0, scene.half_edge * frequency, frequency])
        # With the first step of SciPy the quaternions overflow.
        self._first = 1.0 / scene.frequency_bound
        self._scale = np.tile(np.repeat(kinds, (3, 4, 3, 3)), scene.body_count)

    def start(self, tolerance: float, duration: float) -> None:
        from scipy.integrate import DOP853
        self._solver = DOP853(
            self._rates, 0.0, self._start.copy(), duration, rtol=_MIN_TOLERANCE_RATIO,
            atol=tolerance * self._scale, first_step=self._first)

    def finish(self) -> None:
        solver = self._solver
        while solver.status == 'running':
            solver.step()

    def motion(self) -> Motion:
        state = self._solver.y.reshape(-1, 13)
        return Motion(state[:, :3].copy(), axes_from_quaternions(state[:, 3:7]))


def solvers(scene: PlainScene) -> Iterator[Solver]:
    """Yield DOP853 over the plain right-hand side, and over that of the package if supported."""
    import scipy.integrate  # noqa: F401
    yield Dop853('SciPy DOP853, plain Numba', scene, plain_rates(scene))
    rates = package_rates(scene)
    if rates is not None:
        yield Dop853('SciPy DOP853, our kernel', scene, rates)
