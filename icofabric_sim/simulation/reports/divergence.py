# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Finite-time Lyapunov growth of small disturbances, and the time until which a run is meaningful.

A companion of the run starts with small random displacements and rotations and receives the same
inputs. The growth is the distance between both runs over the initial distance. If the distance
becomes too large for small motions, the companion is rescaled to the initial distance in the
present direction (Benettin, Galgani, Giorgilli and Strelcyn 1980, Meccanica 15, 9). So growth far
beyond 1e10 can be measured.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
import logging
import math
import threading
import time as wall
from typing import Any

from icofabric_sim import checks
from icofabric_sim.process.compile_notice import compile_notice
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.scene.scene import require_scene, Scene
from icofabric_sim.simulation.errors import Interrupted, SimulationError
from icofabric_sim.simulation.model.as_table import AsTable
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.simulation import compile_scene, Simulation
import numpy as np

# Initial distance, and distance at which the companion is rescaled: positions over a, angles in
# rad. Both are far above errors of a method and within the linear range of the motion.
DISPLACEMENT, LARGEST_DISTANCE = 2.0**-17, 2.0**-10
# Growth above which a motion is sensitive.
SENSITIVE = 100.0
# A trajectory is meaningful while the amplified error is below a tenth of a half edge.
MEANINGFUL = 0.1


@dataclass(frozen=True)
class GrowthSettings:
    """Tunables of the measurement of growth."""

    # Distance up to which the growth is that of a small disturbance; beyond, it is a lower bound.
    linear_distance: float = 2.0**-5
    # Larger errors of a run per radian of the fastest motion would hide the growth behind the
    # differences of steps. Both compared runs are then computed with this tolerance.
    max_tolerance: float = 4e-9
    seed: int = 3
    max_history: int = 4096  # entries
    # Periods of the fastest vibration between two comparisons of `measure_growth`, and limits of
    # the number of comparisons.
    comparison_periods: float = 4.0
    min_comparisons: int = 50
    max_comparisons: int = 4000


_SETTINGS = GrowthSettings()


@dataclass(frozen=True, repr=False, eq=False)
class Growth(AsTable):
    """Amplification of a small displacement of all bodies over a run."""

    time: np.ndarray  # (m,) [s]
    growth: np.ndarray  # (m,) distance over the initial one, of positions over a or angles
    error: np.ndarray  # (m,) sum of errors added by the method, position over a or rad
    at_least: bool  # too fast between two comparisons: the growth is a lower bound
    ended: str  # reason why the measurement ended before the run; '': it did not

    def __repr__(self) -> str:
        """Return the growth and the time until which it was measured."""
        least = 'at least ' if self.at_least else ''
        return f'<Growth: {least}{self.largest:.3g} times until t = {self.time[-1]:.9g} s>'

    def table(self) -> dict[str, list[Any]]:
        """Return growth and added errors over time: a list for each column."""
        return {'time_s': self.time.tolist(), 'growth': self.growth.tolist(),
                'error': self.error.tolist()}

    @property
    def largest(self) -> float:
        """Largest growth of the whole run."""
        return float(self.growth.max())

    @property
    def is_sensitive(self) -> bool:
        """True if small errors grow so much that the end of the run depends on them."""
        return self.at_least or not self.largest < SENSITIVE

    @property
    def meaningful_until(self) -> float:
        """
        Time [s] until which amplified errors stay below a tenth of a half edge; infinite: always.

        If the measurement ended early, the result is at most the time of its end. The result is
        NaN if errors were not estimated.
        """
        if np.isnan(self.error).any():
            return math.nan
        with np.errstate(invalid='ignore', over='ignore'):
            grown = self.error * np.maximum.accumulate(self.growth)
        beyond = np.flatnonzero(~(grown <= MEANINGFUL))
        if len(beyond):
            return float(self.time[max(int(beyond[0]) - 1, 0)])
        return float(self.time[-1]) if self.ended else math.inf

    def final_error(self, tolerance: float) -> float:
        """
        Return a bound of the error at the end: the added error times its amplification.

        Parameters
        ----------
        tolerance
            `solver.tolerance` [1/s]; 0 for given steps, whose error has no such limit.

        Returns
        -------
        float
            Position over a, or angle in rad.
        """
        tolerance = checks.number('tolerance', tolerance, least=0.0)
        added = np.maximum(tolerance * max(float(self.time[-1]), 1.0), float(self.error[-1]))
        return float(added * self.largest)


class Companion:
    """A second run with a slightly displaced start, compared with a first run."""

    def __init__(self, simulation: Simulation) -> None:
        """Start at the state of `simulation`; later inputs must be passed on by `act`."""
        self.simulation = simulation
        self.seconds = 0.0  # wall time of the companion, without compilation
        self._half_edge = simulation.scene.geometry.half_edge
        self._reference = self._displaced = simulation
        self._factor = 1.0
        self._history: list[tuple[float, float, float]] = []
        self._at_least, self._ended = False, ''
        with self._aside():
            # Without vibrations, differences of steps are small.
            tolerance = _SETTINGS.max_tolerance * simulation.status.largest_frequency
            if 0.0 < tolerance < simulation.scene.parameters['solver.tolerance'] and (
                simulation.scene.parameters['solver.step'] == 0.0
            ):
                self._reference = self._beside(_more_accurate(simulation.scene, tolerance))
            self._displaced = self._beside(self._reference.scene)
            snapshot = self._reference.snapshot()
            self._put(_displaced(snapshot, self._displaced.scene))
            distance = distance_between(snapshot, self._displaced.snapshot(), self._half_edge)
            # If all bodies are held, no displacement is possible.
            self._factor = 1.0 / distance if distance > 0.0 else 0.0
        self._note(1.0)

    def look(self) -> None:
        """Advance to the time of the run, and compare."""
        if self._ended or not self.simulation.time > self._history[-1][0]:
            return
        with self._aside():
            for simulation in (self._reference, self._displaced):
                if simulation is not self.simulation:
                    simulation.should_stop = self.simulation.should_stop
                    simulation.advance_to(self.simulation.time)
            self._compare()

    def act(self, act: Callable[[Simulation], object]) -> None:
        """Apply an input of the run, which acts at the time of the last comparison."""
        if self._ended:
            return
        with self._aside():
            for simulation in (self._reference, self._displaced):
                if simulation is not self.simulation:
                    act(simulation)

    def result(self) -> Growth:
        """Return the growth measured so far."""
        time, growth, error = np.array(self._history).T
        return Growth(time, growth, error, self._at_least, self._ended)

    def _beside(self, scene: Scene) -> Simulation:
        simulation = compile_scene(scene)
        simulation.continue_from(self.simulation, keep_motion=True)
        return simulation

    def _compare(self) -> None:
        one, two = self._reference.snapshot(), self._displaced.snapshot()
        distance = distance_between(one, two, self._half_edge)
        if not distance <= _SETTINGS.linear_distance:
            self._at_least = True
        self._note(distance * self._factor)
        if distance > LARGEST_DISTANCE:
            part = DISPLACEMENT / distance
            self._displaced.copy_breaks(self._reference)
            self._put(_between(one, two, part))
            distance = distance_between(one, self._displaced.snapshot(), self._half_edge)
            self._factor = self._history[-1][1] / distance

    def _note(self, growth: float) -> None:
        if len(self._history) >= _SETTINGS.max_history:
            # Keep the larger of every two entries; the present entry is appended below.
            pairs = zip(self._history[0::2], self._history[1::2])
            self._history = [max(pair, key=lambda entry: entry[1]) for pair in pairs]
        self._history.append((self.simulation.time, growth, self.simulation.error_estimate))

    def _put(self, state: InitialState) -> None:
        self._displaced.set_state(**state._asdict())

    @contextmanager
    def _aside(self) -> Iterator[None]:
        """Suppress warnings, which the run issues, too; an error ends the measurement."""
        started, thread = wall.perf_counter(), threading.get_ident()
        compiled = compile_notice.seconds
        logger = logging.getLogger('icofabric_sim')

        def others(record: logging.LogRecord) -> bool:
            return record.thread != thread

        logger.addFilter(others)
        try:
            yield
        except Interrupted:
            self._ended = 'the run was stopped'
        except (SimulationError, ValueError) as error:
            self._ended = f'the displaced run could not continue: {error}'
        finally:
            logger.removeFilter(others)
            self.seconds += wall.perf_counter() - started - (compile_notice.seconds - compiled)


def measure_growth(
    scene: Scene, duration: float, *, progress: Callable[[float], None] = lambda time: None
) -> Growth:
    """
    Measure how a small displacement of a scene is amplified (finite-time Lyapunov growth).

    Takes about twice the time of the run alone.

    Parameters
    ----------
    scene
        The scene.
    duration
        Simulated time [s].
    progress
        Called with the simulated time [s].

    Returns
    -------
    Growth
        Amplification of the displacement and of errors over time.

    Raises
    ------
    SimulationError
        The run itself fails.
    """
    require_scene(scene)
    duration = checks.positive('duration', duration, 's')
    checks.function('progress', progress)
    simulation = compile_scene(scene)
    companion = Companion(simulation)
    periods = duration * simulation.status.largest_frequency / (2.0 * math.pi)
    count = math.ceil(min(
        max(periods / _SETTINGS.comparison_periods, _SETTINGS.min_comparisons),
        _SETTINGS.max_comparisons))
    for number in range(1, count + 1):
        simulation.advance_to(number * duration / count)
        companion.look()
        progress(simulation.time)
    return companion.result()


def _more_accurate(scene: Scene, tolerance: float) -> Scene:
    return Scene.from_parameters(scene.parameters.with_changes(
        {'solver.tolerance': tolerance, 'solver.method': 'auto'}))


def _displaced(snapshot: Snapshot, scene: Scene) -> InitialState:
    """
    Return the state with random displacements and rotations of free bodies, at most DISPLACEMENT.

    Velocities are unchanged.
    """
    generator = np.random.RandomState(_SETTINGS.seed)
    shift, turn = generator.standard_normal((2, scene.body_count, 3))
    if scene.supports is not None:
        shift[scene.supports.translation] = 0.0
        turn[scene.supports.rotation] = 0.0
    for drive in scene.drives.values():
        shift[np.ix_(drive.bodies, drive.moves[:3])] = 0.0
        if drive.moves[3]:
            turn[drive.bodies] = 0.0
    largest = max(float(np.linalg.norm(values, axis=1).max()) for values in (shift, turn))
    scale = DISPLACEMENT / largest if largest > 0.0 else 0.0
    return InitialState(
        snapshot.position + scale * scene.geometry.half_edge * shift,
        _turned(scale * turn, snapshot.orientation),
        snapshot.linear_velocity, snapshot.angular_velocity)


def _between(first: Snapshot, second: Snapshot, part: float) -> InitialState:
    """
    Return the state at a small fraction `part` of the displacement from the first to the second.
    """
    def mixed(one: np.ndarray, two: np.ndarray) -> np.ndarray:
        return one + part * (two - one)

    return InitialState(
        mixed(first.position, second.position),
        _turned(part * _rotation(first.orientation, second.orientation), first.orientation),
        mixed(first.linear_velocity, second.linear_velocity),
        mixed(first.angular_velocity, second.angular_velocity))


def distance_between(first: Snapshot, second: Snapshot, half_edge: float) -> float:
    """Return the largest distance of centres over a, or angle between orientations [rad]."""
    shift = np.linalg.norm(first.position - second.position, axis=1).max() / half_edge
    turn = np.linalg.norm(_rotation(first.orientation, second.orientation), axis=1).max()
    return max(float(shift), float(turn))


def _turned(rotation: np.ndarray, orientation: np.ndarray) -> np.ndarray:
    """Return quaternions (n, 4) rotated by rotation vectors (n, 3) [rad], world axes."""
    angle = np.linalg.norm(rotation, axis=1, keepdims=True)
    u, c = np.sinc(angle / (2.0 * np.pi)) * 0.5 * rotation, np.cos(0.5 * angle)
    v, w = orientation[:, :3], orientation[:, 3:]
    turned = np.hstack(
        [c * v + w * u + np.cross(u, v), c * w - (u * v).sum(axis=1, keepdims=True)])
    return turned / np.linalg.norm(turned, axis=1, keepdims=True)


def _rotation(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return rotation vectors [rad], world axes, from the first to the second quaternions."""
    u, c = first[:, :3], first[:, 3:]
    v, w = second[:, :3], second[:, 3:]
    vector = c * v - w * u - np.cross(v, u)
    scalar = c * w + (u * v).sum(axis=1, keepdims=True)
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(length, np.abs(scalar))
    ratio = np.divide(angle, length, out=np.full_like(length, 2.0), where=length > 0.0)
    return np.where(scalar < 0.0, -ratio, ratio) * vector
