# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Loads of a scene for other programs: wrenches about centres, in the world frame."""

from icofabric_sim.scene.load_channels import LoadChannel
from icofabric_sim.scene.scene import Scene
import numpy as np


class PeerLoads:
    """The loads of a scene, computed independently of the kernels."""

    def __init__(self, scene: Scene) -> None:
        """Select the channels whose force or torque is not zero."""
        self._channels: list[LoadChannel] = [
            channel for channel in scene.loads.values()
            if channel.bodies.size and (channel.force.any() or channel.torque.any())]
        # Sorted numbers of the loaded bodies.
        self.bodies = np.unique(np.concatenate(
            [channel.bodies for channel in self._channels] or [np.zeros(0, dtype=int)]))
        self._rows = [
            np.searchsorted(self.bodies, channel.bodies) for channel in self._channels]

    @property
    def ends(self) -> list[float]:
        """Sorted times [s] at which a factor or its slope may jump."""
        return sorted({
            piece.start for channel in self._channels for piece in channel.profile.pieces
            if piece.start > 0.0})

    def at(self, time: float, within: float, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """
        Return forces [N] and torques [N m] about the centres of `bodies` at `time` [s]; (m, 3).

        `within` [s] is a time inside the current piece of each profile: at an end two pieces meet.
        Rows of `axes` (m, 3, 3) are the axes of these bodies in the world frame.
        """
        force, torque = np.zeros((2, len(self.bodies), 3))
        for channel, rows in zip(self._channels, self._rows):
            profile = channel.profile
            factor = profile.pieces[profile.begun(within)].at(time)
            if channel.is_divided:
                factor /= len(channel.bodies)
            push = np.broadcast_to(factor * channel.force, (len(rows), 3))
            turn = np.broadcast_to(factor * channel.torque, (len(rows), 3))
            own = axes[rows]
            if channel.in_body_axes:
                push, turn = (np.einsum('bi,bij->bj', values, own) for values in (push, turn))
            arm = np.einsum('i,bij->bj', channel.point, own)
            # A channel names a body at most once, so rows are distinct.
            force[rows] += push
            torque[rows] += turn + np.cross(arm, push)
        return force, torque
