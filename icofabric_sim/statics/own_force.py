# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Body force of the user in statics: at one time and zero velocity, derivatives by differences."""

from dataclasses import dataclass

from icofabric_sim.geometry.rotations import rotate_quaternions
from icofabric_sim.simulation.model.body_force import BodyForce, set_profiles
from icofabric_sim.simulation.model.layout import Layout
from icofabric_sim.terms.body_force.external_force import call_function
import numpy as np

# Fourth-order central differences: offsets in steps, and weights.
_STENCIL = ((1.0, 8.0 / 12.0), (-1.0, -8.0 / 12.0), (2.0, -1.0 / 12.0), (-2.0, 1.0 / 12.0))


@dataclass(frozen=True)
class DifferenceSettings:
    """Tunables of finite differences of a body force, and of checks of its properties."""

    step: float = 1e-3  # of differences, over a and in rad
    asymmetry_ratio: float = 1e-6  # relative tolerance of the symmetry of derivatives
    change_ratio: float = 1e-9  # relative tolerance of changes of forces
    # Times [s] at which a steady force must have the same value.
    other_times_s: tuple[float, ...] = (0.7390851332, 17.320508)


_DIFFERENCES = DifferenceSettings()


class OwnForce:
    """Forces and torques of a body force in a configuration, and their derivatives."""

    def __init__(
        self, force: BodyForce, layout: Layout, position: np.ndarray, orientation: np.ndarray,
        half_edge: float, time: float, factor: float, profiles: np.ndarray
    ) -> None:
        """
        Hold a force at `time` [s], times a `factor`, and test it in the given configuration.

        `profiles` are the segments of loads by expressions at that time.

        Raises ValueError if the force fails or acts between bodies.
        """
        self._force, self._half_edge, self._time, self._factor = force, half_edge, time, factor
        self._external = force.prepare(
            layout, np.hstack([position, orientation, np.zeros((len(position), 6))]), time)
        set_profiles(force, self._external, profiles)
        self._refuse_coupling(position, orientation)

    @property
    def label(self) -> str:
        """Name of the force in messages."""
        return self._force.label

    @property
    def has_potential(self) -> bool:
        """True if the user has given a potential."""
        return self._force.potential is not None

    def wrench(self, position: np.ndarray, orientation: np.ndarray) -> np.ndarray:
        """Compute forces [N] and torques [N m] on all bodies, (n, 6)."""
        return self._factor * self._at(self._time, position, orientation)

    def energy(self, position: np.ndarray, orientation: np.ndarray) -> float:
        """Compute the potential energy [J]; 0 without a potential."""
        return self._factor * self._force.energy(self._time, position, orientation)

    def work(
        self, position: np.ndarray, orientation: np.ndarray, motion: np.ndarray
    ) -> float:
        """Integrate the work [J] along a `motion` (n, 6) by Simpson's rule."""
        first, middle, last = (
            self.wrench(position + part * motion[:, :3], rotate_quaternions(
                part * motion[:, 3:], orientation)) for part in (0.0, 0.5, 1.0))
        return float(((first + 4.0 * middle + last) * motion).sum()) / 6.0

    def blocks(self, position: np.ndarray, orientation: np.ndarray) -> np.ndarray:
        """
        Compute the derivatives - dF/dx of each body, (n, 6, 6), along displacements and turns.

        They are symmetric if the force has a potential.
        """
        blocks = np.zeros((len(position), 6, 6))
        for k in range(6):
            step = _DIFFERENCES.step * (self._half_edge if k < 3 else 1.0)
            for times, weight in _STENCIL:
                motion = np.zeros_like(blocks[:, 0])
                motion[:, k] = times * step
                there = self.wrench(
                    position + motion[:, :3], rotate_quaternions(motion[:, 3:], orientation))
                blocks[:, :, k] -= weight / step * there
        # Turning the body also rotates the torque; half of that is symmetric.
        torque = self.wrench(position, orientation)[:, 3:]
        for k, axis in enumerate(np.eye(3)):
            blocks[:, 3:, 3 + k] += 0.5 * np.cross(axis, torque)
        return blocks

    def is_symmetric(self, blocks: np.ndarray) -> bool:
        """Return True if derivatives are those of a force with a potential."""
        scale = np.repeat([1.0, 1.0 / self._half_edge], 3)
        scaled = blocks * scale[:, None] * scale
        off = np.abs(scaled - np.swapaxes(scaled, 1, 2)).max(initial=0.0)
        return bool(off <= _DIFFERENCES.asymmetry_ratio * np.abs(scaled).max(initial=0.0))

    def require_steady(self, position: np.ndarray, orientation: np.ndarray) -> None:
        """Raise ValueError if the force changes with time."""
        here = self._at(self._time, position, orientation)
        for time in _DIFFERENCES.other_times_s:
            if not self._alike(here, self._at(time, position, orientation)):
                raise ValueError(
                    f'{self._force.label} changes with time, but an equilibrium needs '
                    'steady forces; give the time at which to hold it (time=), or a steady '
                    'function')

    def require_symmetric(self, blocks: np.ndarray) -> None:
        """Raise ValueError if the force has no potential."""
        if not self.is_symmetric(blocks):
            raise ValueError(
                f'{self._force.label} has no potential: its derivative by positions and '
                'rotations is not symmetric, so vibrations do not follow from an energy and may '
                'grow; give a force that has a potential, use tractions.NAME or loads.NAME '
                '(vibrations ignore that they turn with bodies), or simulate the motion '
                '(compile_scene with body_force=)')

    def _at(self, time: float, position: np.ndarray, orientation: np.ndarray) -> np.ndarray:
        external = self._external
        external.numbers[:, :3], external.numbers[:, 3:7] = position, orientation
        external.moment[0] = time
        if call_function(external.address, time, external.numbers, external.result):
            raise ValueError(self._force.explain(external))
        return external.result.copy()

    def _refuse_coupling(self, position: np.ndarray, orientation: np.ndarray) -> None:
        """Raise ValueError if small motions of every other body change forces on the rest."""
        if self._force.is_by_body:
            return
        moved = np.arange(len(position)) % 2 == 1
        there = np.where(moved[:, None], position + _DIFFERENCES.step * self._half_edge, position)
        turned = np.where(
            moved[:, None],
            rotate_quaternions(np.full_like(position, _DIFFERENCES.step), orientation),
            orientation)
        if not self._alike(*(
                self._at(self._time, *state)[~moved]
                for state in ((position, orientation), (there, turned)))):
            raise ValueError(
                f'{self._force.label} acts between bodies: its force on one body '
                'changes if another moves. Statics supports forces that depend on the pose of '
                'the body alone; use connectors or charge.mutual for forces between bodies, or '
                'let a run with drag come to rest (compile_scene with body_force=)')

    @staticmethod
    def _alike(one: np.ndarray, other: np.ndarray) -> bool:
        off = np.abs(one - other).max(axis=0, initial=0.0)
        size = np.abs(one).max(axis=0, initial=0.0)
        return bool((off <= _DIFFERENCES.change_ratio * size).all())
