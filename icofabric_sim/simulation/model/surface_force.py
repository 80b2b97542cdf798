# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Surface forces by a function F(face, xi, eta, t), integrated over the faces of bodies (eq 40).

Unlike `tractions.NAME`, the function may depend on place and time in any form. The coordinates xi,
eta are lambda2, lambda3 of the face (eq 35), from its first corner along its two sides.
"""

from collections.abc import Callable
from typing import Any, Final

from icofabric_sim import checks
from icofabric_sim.geometry.icosahedron import face_geometry, face_quadrature, triangle_rule
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.scene.body_sizes import require_shell_size
from icofabric_sim.scene.faces import select_faces, Shells
from icofabric_sim.scene.scene import require_scene, Scene
from icofabric_sim.simulation.model.body_force import BodyForce, takes_body
import numpy as np

Traction = Callable[..., Any]
AXES: Final = ('face', 'body', 'world')
_MAX_DEGREE = 20


def surface_force(
    scene: Scene, traction: Traction, *, group: str = 'all', faces: str = 'exterior',
    axes: str = 'face', degree: int = 6
) -> BodyForce:
    """
    Return the body force of a traction on faces of the bodies of a group, for `compile_scene`.

    Parameters
    ----------
    scene
        The scene.
    traction
        Called as `traction(face, xi, eta, time)` with the numbers (1 to 20) of the faces of m
        points, their coordinates (m,) and the time [s]. Returns the traction [Pa], (m, 3). If the
        function has an argument `body`, it also gets the numbers (m,) of the bodies; otherwise all
        bodies have the same traction.
    group
        NAME of `groups.NAME`, or 'all'.
    faces
        Selector of faces, as `tractions.NAME.faces`.
    axes
        Axes of the traction. 'face': pressure against the outward normal, shear along the first
        side of the face, shear across it, as `tractions.NAME`. 'body' or 'world': components along
        these axes.
    degree
        Polynomial degree in xi and eta up to which forces and torques are exact.

    Returns
    -------
    BodyForce
        Resultant force and torque of the traction on each body.

    Raises
    ------
    ValueError
        There is no such group, or no such faces.
    """
    parameters = require_scene(scene).parameters
    checks.function('traction', traction)
    if checks.text('axes', axes) not in AXES:
        raise ValueError(f'axes must be one of {", ".join(AXES)}, got {axes!r}')
    degree = checks.count('degree', degree, 0)
    if degree > _MAX_DEGREE:
        raise ValueError(f'degree must be at most {_MAX_DEGREE}, got {degree}')
    group, faces = checks.text('group', group), checks.text('faces', faces)
    if group != 'all' and f'groups.{group}' not in parameters:
        known = ', '.join(['all', *parameters.names('groups')])
        raise ParameterError('group', f'group: there is no group {group!r}; known: {known}')
    bodies, half_edge = scene.groups[group], scene.geometry.half_edge
    require_shell_size(scene.half_edges, bodies, scene.shell, 'group')
    mask = select_faces('faces', faces, Shells(
        scene.position, scene.orientation, bodies, half_edge, scene.geometry.pitch))
    return BodyForce(
        _Surface(traction, bodies, mask, half_edge, axes, degree, scene.body_count),
        compiled=False)


class _Surface:
    """Force and torque of a traction on all bodies, called by `BodyForce`."""

    def __init__(
        self, traction: Traction, bodies: np.ndarray, mask: np.ndarray, half_edge: float,
        axes: str, degree: int, count: int
    ) -> None:
        self.__name__ = getattr(traction, '__name__', type(traction).__name__)
        self._traction, self._bodies, self._in_world = traction, bodies, axes == 'world'
        self._count = count
        # Torques are one degree higher.
        coordinates, _ = triangle_rule(degree + 1)
        points, self._areas = face_quadrature(half_edge, degree=degree + 1)
        used = np.flatnonzero(mask.any(axis=0))
        self._mask = mask[:, used].astype(float)  # (m, f)
        self._points = points[used]  # (f, k, 3) body axes
        # Points of all bodies, or of one for all.
        bodies = self._bodies if takes_body(traction) else self._bodies[:1]
        self._own = {'body': np.repeat(bodies, len(used) * len(coordinates))} if (
            takes_body(traction)) else {}
        self._face = np.tile(np.repeat(used + 1, len(coordinates)), len(bodies))
        self._xi, self._eta = np.tile(coordinates, (len(bodies) * len(used), 1)).T
        self._frames: np.ndarray | None = None
        if axes == 'face':
            geometry = face_geometry(half_edge)
            first = geometry.frames[used, :, 1]
            first = first / np.linalg.norm(first, axis=1)[:, None]
            normal = geometry.normals[used]
            # Rows: a pressure of 1 Pa, and shears.
            self._frames = np.stack([-normal, first, np.cross(normal, first)], axis=1)

    def __call__(
        self, time: float, position: np.ndarray, orientation: np.ndarray,
        linear_velocity: np.ndarray, angular_velocity: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        found = np.asarray(self._traction(
            self._face.copy(), self._xi.copy(), self._eta.copy(), time,
            **{name: of.copy() for name, of in self._own.items()}), float)
        if found.shape != (len(self._face), 3):
            raise ValueError(
                f'the traction must return [Pa] {(len(self._face), 3)}, one row for each point, '
                f'not {found.shape}')
        found = found.reshape(-1, *self._points.shape)  # (m or 1, f, k, 3)
        if self._frames is not None:
            found = np.einsum('mfka,fai->mfki', found, self._frames)
        weighted = found * self._areas[:, None]

        def over_faces(parts: np.ndarray) -> np.ndarray:
            return np.einsum('mf,mf...->m...', self._mask, np.broadcast_to(
                parts, (*self._mask.shape, *parts.shape[2:])))

        # Of each body the sum over its faces, in its own axes or the world's.
        push = over_faces(weighted.sum(axis=2))
        axes = cosines_from_quaternions(orientation[self._bodies]).reshape(-1, 3, 3)
        force, torque = np.zeros((2, self._count, 3))
        if self._in_world:
            # sum r F^T, with r in body axes and F in those of the world.
            lever = over_faces(np.einsum('fki,mfkj->mfij', self._points, weighted))
            turned = np.einsum('mai,maj->mij', axes, lever)
            force[self._bodies] = push
            torque[self._bodies] = np.stack([
                turned[:, 1, 2] - turned[:, 2, 1], turned[:, 2, 0] - turned[:, 0, 2],
                turned[:, 0, 1] - turned[:, 1, 0]], axis=1)
        else:
            moment = over_faces(np.cross(self._points, weighted).sum(axis=2))
            force[self._bodies] = np.einsum('mi,mij->mj', push, axes)
            torque[self._bodies] = np.einsum('mi,mij->mj', moment, axes)
        return force, torque
