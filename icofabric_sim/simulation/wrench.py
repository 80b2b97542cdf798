# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""A wrench from outside, and the moment at which it begins or ends."""

from collections.abc import Sequence
from typing import NamedTuple, Self

from icofabric_sim import checks
import numpy as np

Key = str | int  # a channel by name, or a body by number
Vector = Sequence[float] | np.ndarray


class Wrench(NamedTuple):
    """A force and a torque on the axes of their channel."""

    force: np.ndarray  # (3,) [N]
    torque: np.ndarray  # (3,) [N m]

    @classmethod
    def checked(cls, force: Vector, torque: Vector) -> Self:
        """Make a wrench of what a file holds; ValueError says what is wrong with it."""
        try:
            return cls(checks.array('force', force, (3,)), checks.array('torque', torque, (3,)))
        except TypeError as error:
            raise ValueError(str(error)) from None

    def is_zero(self) -> bool:
        """Whether it does nothing."""
        return not (self.force.any() or self.torque.any())

    def same(self, other: 'Wrench') -> bool:
        """Whether both have the same values."""
        return bool((self.force == other.force).all() and (self.torque == other.torque).all())


class Event(NamedTuple):
    """A wrench that begins, or (`wrench` None) the end of its hold time."""

    time: float
    rank: int  # at one time, holds end before wrenches begin
    sequence: int
    key: Key
    wrench: Wrench | None
