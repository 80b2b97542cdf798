# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Messages of a running fabric: which topics there are, and their bytes from snapshots.
"""

from typing import NamedTuple

from icofabric_sim.messages import (
    ClockBytes,
    Float64MultiArrayBytes,
    MarkerAction,
    MarkerBytes,
    MarkerType,
    PoseArrayBytes,
    StringBytes,
)
from icofabric_sim.parameter_text import dump_parameters
from icofabric_sim.parameters import Parameters
from icofabric_sim.scene import Scene
from icofabric_sim.snapshot import Snapshot
import numpy as np


class Topic(NamedTuple):
    """
    A topic that the node publishes, and how.
    """

    name: str  # private (~/) name, or absolute
    type: str
    latched: bool  # transient local: late joiners get the last message
    depth: int
    recorded: bool


POSES = Topic('~/poses', PoseArrayBytes.TYPE, False, 10, True)
CONNECTORS = Topic('~/connectors', MarkerBytes.TYPE, False, 20, True)
STATE = Topic('~/state', Float64MultiArrayBytes.TYPE, False, 10, False)
ENERGY = Topic('~/energy', Float64MultiArrayBytes.TYPE, False, 10, True)
WEAVE = Topic('~/weave', StringBytes.TYPE, True, 1, True)
CLOCK = Topic('/clock', ClockBytes.TYPE, False, 10, True)
DIAGNOSTICS = Topic('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', False, 10, True)
# What was done to the run beside its inputs (pause, steps, reset, ...), one JSON object each.
EVENTS = Topic('~/events', StringBytes.TYPE, False, 100, True)
# Checkpoints, so that a bag can be simulated again from there.
CHECKPOINT = Topic('~/checkpoint', 'std_msgs/msg/UInt8MultiArray', False, 1, True)
TOPICS = (POSES, CONNECTORS, STATE, ENERGY, WEAVE, CLOCK, DIAGNOSTICS)

# Label and name in a snapshot of each number in `~/energy` [J].
ENERGIES = {
    label: label.replace(' ', '_') for label in (
        'kinetic', 'connectors', 'gravity', 'contact', 'work in', 'dissipated', 'balance error')}


class StrainClass(NamedTuple):
    """
    Connectors of one colour; bounds of the strain (l - D) / D above which it begins.
    """

    above: float
    name: str
    color: tuple[float, float, float, float]


# Few lists instead of a colour for each point: 24 bytes for a point instead of 40. Blue is pushed
# together, red is pulled.
STRAIN_CLASSES = (
    StrainClass(-np.inf, 'compressed by more than 5 %', (0.13, 0.27, 0.80, 1.0)),
    StrainClass(-0.05, 'compressed by 0.5 % to 5 %', (0.40, 0.65, 0.95, 1.0)),
    StrainClass(-0.005, 'within 0.5 % of the natural length', (0.75, 0.75, 0.75, 1.0)),
    StrainClass(0.005, 'stretched by 0.5 % to 5 %', (0.98, 0.65, 0.35, 1.0)),
    StrainClass(0.05, 'stretched by more than 5 %', (0.85, 0.12, 0.10, 1.0)),
)


class Outputs:
    """
    Message layouts of one scene, written once; the numbers change with every snapshot.
    """

    def __init__(self, scene: Scene) -> None:
        """
        Lay out nothing yet: each message is laid out when it is first wanted.
        """
        self.scene = scene
        self.frame_id = scene.parameters['frame_id']
        self._poses: PoseArrayBytes | None = None
        self._state: Float64MultiArrayBytes | None = None
        self._energy = Float64MultiArrayBytes((', '.join(ENERGIES),), (len(ENERGIES),))
        self._lines: list[MarkerBytes] = []
        self._shown: set[int] = set()
        self._clock = ClockBytes()

    def poses(self, snapshot: Snapshot, nanoseconds: int) -> bytes:
        """
        `~/poses`: bodies in order.
        """
        if self._poses is None:
            self._poses = PoseArrayBytes(self.frame_id, self.scene.body_count)
        self._poses.values[:, :3] = snapshot.position
        self._poses.values[:, 3:] = snapshot.orientation
        return self._poses.stamped(nanoseconds)

    def state(self, snapshot: Snapshot) -> bytes:
        """
        `~/state`: [n, 13] position, orientation x y z w, velocity, angular velocity (world).
        """
        if self._state is None:
            self._state = Float64MultiArrayBytes(
                ('body', 'position orientation_xyzw linear_velocity angular_velocity'),
                (self.scene.body_count, 13),
            )
        np.concatenate(
            [
                snapshot.position,
                snapshot.orientation,
                snapshot.linear_velocity,
                snapshot.angular_velocity,
            ],
            axis=1,
            out=self._state.values,
        )
        return self._state.to_bytes()

    def energy(self, snapshot: Snapshot) -> bytes:
        """
        `~/energy`: the energies [J] that its label names.
        """
        self._energy.values[:] = [snapshot.energy[name] for name in ENERGIES.values()]
        return self._energy.to_bytes()

    def connectors(self, snapshot: Snapshot, nanoseconds: int) -> list[bytes]:
        """
        `~/connectors`: one line list for each strain class that has connectors.

        A list whose class has become empty is deleted.
        """
        if not self._lines:
            width = 0.08 * self.scene.shell.half_edge
            self._lines = [
                MarkerBytes(
                    self.frame_id,
                    'connectors',
                    number,
                    MarkerType.LINE_LIST,
                    color=entry.color,
                    scale=(width, 0.0, 0.0),
                )
                for number, entry in enumerate(STRAIN_CLASSES)
            ]
        ends = snapshot.connector_ends
        strain = snapshot.connector_length / self.scene.connectors.natural_length - 1.0
        bounds = [entry.above for entry in STRAIN_CLASSES[1:]]
        number_of = np.searchsorted(bounds, strain, side='left')
        messages = []
        for number, marker in enumerate(self._lines):
            chosen = ends[number_of == number].reshape(-1, 3)
            if len(chosen):
                marker.point_count = len(chosen)
                marker.points[:] = chosen
                messages.append(marker.stamped(nanoseconds))
                self._shown.add(number)
            elif number in self._shown:
                messages.append(marker.stamped(nanoseconds, action=MarkerAction.DELETE))
                self._shown.remove(number)
        return messages

    def cleared(self, nanoseconds: int) -> bytes:
        """
        `~/connectors`: remove all markers of an earlier weave.
        """
        self._shown.clear()
        marker = MarkerBytes(self.frame_id, 'connectors', 0, MarkerType.LINE_LIST)
        return marker.stamped(nanoseconds, action=MarkerAction.DELETEALL)

    def weave(self, parameters: Parameters) -> bytes:
        """
        `~/weave`: the `parameters` in force, as a ROS parameter file.

        They are those of the scene, but for rates and the like that may have changed since.
        """
        return StringBytes(dump_parameters(dict(parameters))).to_bytes()

    def clock(self, nanoseconds: int) -> bytes:
        """
        `/clock`.
        """
        return self._clock.stamped(nanoseconds)
