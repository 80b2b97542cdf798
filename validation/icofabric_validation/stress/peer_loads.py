# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Loads of a scene as another program needs them: wrenches about centres, in the world."""

from icofabric_sim.scene.load_channels import LoadChannel
from icofabric_sim.scene.scene import Scene
import numpy as np


class PeerLoads:
    """The scene's own loads, by a way of its own beside that of the kernels."""

    def __init__(self, scene: Scene) -> None:
        """Take the channels whose force or torque acts at some time."""
        self._channels: list[LoadChannel] = [
            channel for channel in scene.loads.values()
            if channel.bodies.size and (channel.force.any() or channel.torque.any())]
        # Bodies that some load acts on, in their order.
        self.bodies = np.unique(np.concatenate(
            [channel.bodies for channel in self._channels] or [np.zeros(0, dtype=int)]))
        self._rows = [
            np.searchsorted(self.bodies, channel.bodies) for channel in self._channels]

    @property
    def ends(self) -> list[float]:
        """Times [s] at which a factor or its slope may jump, in their order."""
        return sorted({
            piece.start for channel in self._channels for piece in channel.profile.pieces
            if piece.start > 0.0})

    def at(self, time: float, within: float, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """
        Forces [N] and torques about the centres [N m] on `bodies` at `time` [s]; (m, 3) each.

        `within` [s] lies inside the piece of each profile that rules: at an end two of them meet.
        `axes` (m, 3, 3): rows are the axes of each of these bodies in the world.
        """
        force, torque = np.zeros((2, len(self.bodies), 3))
        for channel, rows in zip(self._channels, self._rows):
            profile = channel.profile
            factor = profile.pieces[profile.begun(within)].at(time)
            if channel.total:
                factor /= len(channel.bodies)
            push = np.broadcast_to(factor * channel.force, (len(rows), 3))
            turn = np.broadcast_to(factor * channel.torque, (len(rows), 3))
            own = axes[rows]
            if channel.in_body_axes:
                push, turn = (np.einsum('bi,bij->bj', values, own) for values in (push, turn))
            arm = np.einsum('i,bij->bj', channel.point, own)
            # A channel may name a body once only, so rows are never the same.
            force[rows] += push
            torque[rows] += turn + np.cross(arm, push)
        return force, torque
