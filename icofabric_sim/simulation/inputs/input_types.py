# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Types of inputs: targets (a channel, a body, a drive or a plane) and values (a wrench or a twist).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self, TYPE_CHECKING

from icofabric_sim import checks
import numpy as np

if TYPE_CHECKING:
    from icofabric_sim.scene.scene import Scene

Vector = Sequence[float] | np.ndarray
_DRIVES, _PLANES = 'drives.', 'planes.'


@dataclass(frozen=True, slots=True)
class ChannelTarget:
    """The bodies of `loads.NAME`, in the frame and at the point of the channel."""

    name: str

    def __str__(self) -> str:
        return f'loads.{self.name}'


@dataclass(frozen=True, slots=True)
class BodyTarget:
    """One body, in its own axes and about its centre."""

    number: int

    def __str__(self) -> str:
        return f'body {self.number}'


@dataclass(frozen=True, slots=True)
class DriveTarget:
    """The motion of `drives.NAME`."""

    name: str

    def __str__(self) -> str:
        return f'{_DRIVES}{self.name}'


@dataclass(frozen=True, slots=True)
class PlaneTarget:
    """The motion of `planes.NAME`."""

    name: str

    def __str__(self) -> str:
        return f'{_PLANES}{self.name}'


@dataclass(frozen=True, slots=True)
class PullTarget:
    """One body under a drag force towards a point."""

    number: int

    def __str__(self) -> str:
        return f'the pull on body {self.number}'


LoadTarget = ChannelTarget | BodyTarget
PathTarget = DriveTarget | PlaneTarget
Target = LoadTarget | PathTarget | PullTarget


class Wrench(NamedTuple):
    """A force and a torque in the axes of their channel."""

    force: np.ndarray  # (3,) [N]
    torque: np.ndarray  # (3,) [N m]

    @classmethod
    def checked(cls, force: Vector, torque: Vector) -> Self:
        """
        Return a validated wrench; raise TypeError or ValueError with the name of a wrong argument.
        """
        return cls(checks.array('force', force, (3,)), checks.array('torque', torque, (3,)))

    def is_zero(self) -> bool:
        """Return True if force and torque are zero."""
        return not (self.force.any() or self.torque.any())

    def same(self, other: 'Wrench') -> bool:
        """Return True if both wrenches have the same values."""
        return bool((self.force == other.force).all() and (self.torque == other.torque).all())


class Twist(NamedTuple):
    """A velocity and a spin, world axes."""

    linear: np.ndarray  # (3,) [m/s]
    angular: np.ndarray  # (3,) [rad/s]

    @classmethod
    def checked(cls, linear: Vector, angular: Vector) -> Self:
        """
        Return a validated twist; raise TypeError or ValueError with the name of a wrong argument.
        """
        return cls(checks.array('linear', linear, (3,)), checks.array('angular', angular, (3,)))


class Pull(NamedTuple):
    """Target point of a drag force, world frame; three NaN release the body."""

    point: np.ndarray  # (3,) [m]

    @classmethod
    def checked(cls, point: Vector) -> Self:
        """
        Return a validated target point; raise TypeError or ValueError if the argument is wrong.
        """
        if np.shape(point) == (3,) and all(number != number for number in point):
            return cls(np.full(3, np.nan))
        return cls(checks.array('point', point, (3,)))

    @property
    def is_release(self) -> bool:
        """True if the body is released."""
        return bool(np.isnan(self.point).all())


Value = Wrench | Twist | Pull


def has_target(scene: 'Scene', target: Target) -> bool:
    """Return True if the scene has the channel, body, drive or movable plane."""
    if isinstance(target, (BodyTarget, PullTarget)):
        return 0 <= target.number < scene.body_count
    return target.name in _named(scene, target)


def _named(scene: 'Scene', target: ChannelTarget | PathTarget) -> Mapping[str, Any]:
    """Return the parts of a scene of the kind of a target, by name."""
    if isinstance(target, ChannelTarget):
        return scene.loads
    return scene.platens if isinstance(target, PlaneTarget) else scene.drives


def require_target(scene: 'Scene', target: Target) -> None:
    """Raise ValueError with the known targets if the scene lacks the target."""
    if has_target(scene, target):
        return
    if isinstance(target, (BodyTarget, PullTarget)):
        raise ValueError(
            f'there is no body {target.number}; bodies are 0 to {scene.body_count - 1}')
    if isinstance(target, PlaneTarget) and target.name in scene.parameters.names('planes'):
        raise ValueError(
            f'{target}.motion is fixed: choose hold for a plane that twists move, or another '
            'motion')
    what = {ChannelTarget: 'load channel', DriveTarget: 'drive', PlaneTarget: 'movable plane'}
    field = 'motion' if isinstance(target, PlaneTarget) else 'group'
    raise ValueError(
        f'there is no {what[type(target)]} {target.name!r}; known: '
        f'{", ".join(_named(scene, target)) or "none"}. Define it with {target}.{field}')


def load_order(target: LoadTarget) -> tuple[bool, str | int]:
    """Return a sort key: channels by name, followed by bodies by number."""
    if isinstance(target, BodyTarget):
        return True, target.number
    return False, target.name


def stored_target(target: LoadTarget | PathTarget) -> str | int:
    """
    Return the form of a target in checkpoints.

    A channel is stored by its name, a drive as drives.NAME, a plane as planes.NAME, a body by its
    number. Names contain no dots.
    """
    if isinstance(target, ChannelTarget):
        return target.name
    return target.number if isinstance(target, BodyTarget) else str(target)


def restored_target(stored: Any) -> LoadTarget | PathTarget:
    """Return a target from its form in checkpoints; the scene may lack the target."""
    if type(stored) is int:
        return BodyTarget(stored)
    if not isinstance(stored, str):
        raise ValueError('inputs hold a wrench on neither a channel nor a body')
    if stored.startswith(_DRIVES):
        return DriveTarget(stored.removeprefix(_DRIVES))
    if stored.startswith(_PLANES):
        return PlaneTarget(stored.removeprefix(_PLANES))
    return ChannelTarget(stored)
