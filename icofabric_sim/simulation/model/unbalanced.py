# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Unbalanced forces of connectors and anchors in a fabric as woven."""

from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.scene.scene import Scene
import numpy as np


def unbalanced_rate(scene: Scene) -> float:
    """
    Return the largest initial acceleration over a, or of spin, [1/s^2] by connectors and anchors.

    The result is 0 if all have their natural lengths. Tabulated laws count by their largest
    slopes; anchors end at the initial positions of their points.
    """
    if not (_are_strained(scene) or scene.anchors):
        return 0.0
    force, torque = np.zeros((2, scene.body_count, 3))
    axes = cosines_from_quaternions(scene.orientation).reshape(-1, 3, 3)
    if _are_strained(scene):
        _add_connectors(scene, axes, force, torque)
    _add_anchors(scene, axes, force, torque)
    if not (force.any() or torque.any()):
        return 0.0
    if scene.supports is not None:
        force[scene.supports.translation] = 0.0
        torque[scene.supports.rotation] = 0.0
    for drive in scene.drives.values():
        force[np.ix_(drive.bodies, drive.moves[:3])] = 0.0
        if drive.moves[3]:
            torque[drive.bodies] = 0.0
    mass, inertia = scene.masses
    linear = np.linalg.norm(force, axis=1) / (mass * scene.geometry.half_edge)
    angular = np.linalg.norm(torque, axis=1) / inertia
    return float(max(linear.max(), angular.max()))


def _are_strained(scene: Scene) -> bool:
    """Return True if the woven and natural lengths of a connector differ."""
    if not scene.connector_count:
        return False
    natural = scene.connectors.laws.natural_length
    return bool((np.abs(scene.connectors.woven_length - natural) > 1e-12 * natural).any())


def _add_connectors(
    scene: Scene, axes: np.ndarray, force: np.ndarray, torque: np.ndarray
) -> None:
    """
    Add forces [N] and torques [N m] of connectors, (n, 3); `axes` (n, 3, 3) are those of bodies.
    """
    connectors = scene.connectors
    one, two = connectors.bodies.T
    arms = np.einsum('ceij,cei->cej', axes[connectors.bodies], connectors.points_body)
    ends = scene.position[connectors.bodies] + arms
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    laws = connectors.laws
    stretch = length - laws.natural_length
    tension = stretch * np.where(stretch > 0.0, laws.extension, laws.compression)
    # One of no length has no direction.
    pull = along * (tension / np.where(length > 0.0, length, np.inf))[:, None]
    for bodies, sign, arm in ((one, 1.0, arms[:, 0]), (two, -1.0, arms[:, 1])):
        np.add.at(force, bodies, sign * pull)
        np.add.at(torque, bodies, sign * np.cross(arm, pull))


def _add_anchors(
    scene: Scene, axes: np.ndarray, force: np.ndarray, torque: np.ndarray
) -> None:
    """
    Add forces [N] and torques [N m] of anchors, (n, 3); `axes` (n, 3, 3) are those of bodies.
    """
    for anchor in scene.anchors.values():
        extension, compression, natural_length = anchor.law
        arm = anchor.arm @ axes[anchor.body]
        along = anchor.path.pieces[0].at(0.0)[:3] - (scene.position[anchor.body] + arm)
        length = float(np.linalg.norm(along))
        stretch = length - natural_length
        if length > 0.0:
            pull = along * ((extension if stretch > 0.0 else compression) * stretch / length)
            force[anchor.body] += pull
            torque[anchor.body] += np.cross(arm, pull)
