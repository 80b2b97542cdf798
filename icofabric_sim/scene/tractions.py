# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Surface forces on faces, integrated to wrenches (eqs 35-40, corrected).

On a face f with outward unit normal n the traction is

    t(lambda2, lambda3) = g(lambda2, lambda3) (-p n + s1 e1 + s2 e2),

with the pressure p, the shear (s1, s2), the unit vectors e1 = w2 / |w2| along the first side of
the face and e2 = n x e1, and the polynomial g in the face coordinates (`variation`).

A follower traction turns with its body; all faces together give one wrench in body axes. A
traction of fixed direction keeps its world direction as woven while its points turn with the body;
on a flat face it is equivalent to one force, or to a couple if the total vanishes.
"""

from collections.abc import Mapping
import math
from typing import NamedTuple

from icofabric_sim.checks import number_in
from icofabric_sim.geometry.icosahedron import face_geometry, face_quadrature, triangle_rule
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.faces import select_faces, Shells
from icofabric_sim.scene.profiles import make_profile, Profile
from icofabric_sim.scene.weave_geometry import WeaveGeometry
import numpy as np

_MAX_DEGREE = 12  # degree of a polynomial
# Difference of quaternion components below which orientations count as equal.
_EQUAL_QUATERNION = 1e-9
_ZERO_VECTOR = np.zeros(3)


class FaceWrench(NamedTuple):
    """Wrench of a traction on some bodies."""

    bodies: np.ndarray  # (m,) int32
    in_body_axes: bool
    force: np.ndarray  # (3,) [N]
    torque: np.ndarray  # (3,) [N m]
    point: np.ndarray  # (3,) [m], body axes
    # (3,) body axes; frictionless: only the force component along this normal acts; zero vector:
    # the whole force acts.
    normal: np.ndarray


class Traction(NamedTuple):
    """One traction, `tractions.NAME`."""

    wrenches: tuple[FaceWrench, ...]
    profile: Profile


def polynomial(name: str, text: str) -> np.ndarray:
    """Return the coefficients of 1, l2, l3, l2^2, l2 l3, l3^2, ... from a text; '' means 1."""
    if not text.strip():
        return np.ones(1)
    try:
        values = np.array([number_in(word) for word in text.split()])
    except ValueError:
        values = np.full(1, np.nan)
    degree = _degree(len(values))
    if not np.isfinite(values).all() or degree > _MAX_DEGREE or (
            (degree + 1) * (degree + 2) // 2 != len(values)):
        raise ParameterError(
            name, f'{name} must be the coefficients of 1, l2, l3, l2^2, l2 l3, l3^2, ... up to a '
            f'whole degree of at most {_MAX_DEGREE} (1, 3, 6, 10, ... finite numbers), got '
            f'{text!r}')
    return values


def make_traction(
    parameters: Parameters, name: str, bodies: np.ndarray, position: np.ndarray,
    orientation: np.ndarray, geometry: WeaveGeometry,
) -> Traction:
    """Integrate `tractions.NAME` over faces of its `bodies`; `position` is that of all bodies."""
    prefix, half_edge = f'tractions.{name}', geometry.half_edge
    mask = select_faces(
        f'{prefix}.faces', parameters[f'{prefix}.faces'],
        Shells(position, orientation, bodies, half_edge, geometry.pitch))
    force, point = face_forces(parameters, prefix, half_edge)
    follower = parameters[f'{prefix}.direction'] == 'follower'
    rounded = np.zeros((len(bodies), 0)) if follower else np.round(
        orientation[bodies] / _EQUAL_QUATERNION)
    _, first, kind = np.unique(
        np.hstack([mask, rounded]), axis=0, return_index=True, return_inverse=True)
    frictionless = parameters[f'{prefix}.frictionless']
    wrenches: list[FaceWrench] = []
    for number, example in enumerate(first):
        alike = bodies[kind.ravel() == number].astype(np.int32)
        faces = np.flatnonzero(mask[example])
        if follower:
            wrenches += _follower(alike, faces, force, point)
        else:
            axes = cosines_from_quaternions(orientation[bodies[example]][None])[0]
            normals = face_geometry(half_edge).normals
            wrenches += [
                FaceWrench(
                    alike, False, part @ axes, _ZERO_VECTOR, at,
                    normals[f] if frictionless else _ZERO_VECTOR)
                for f in faces for part, at in zip(force[f], point[f]) if part.any()]
    return Traction(tuple(wrenches), make_profile(parameters, prefix))


def face_forces(
    parameters: Mapping[str, object], prefix: str, half_edge: float
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the forces [N] on every face and their points [m], (20, k, 3) each, body axes as woven.

    Each face has two forces that add up to the traction, because a single force would have no
    finite lever if the total vanishes.
    """
    table: Mapping[str, float | str | list[float]] = parameters  # type: ignore[assignment]
    name = f'{prefix}.variation'
    weights = polynomial(name, str(table[name]))
    degree = _degree(len(weights))
    geometry = face_geometry(half_edge)
    coordinates, _ = triangle_rule(degree + 1)
    points, areas = face_quadrature(half_edge, degree=degree + 1)
    l2, l3 = coordinates.T
    powers = [(n - k, k) for n in range(degree + 1) for k in range(n + 1)]
    g = sum(w * l2**i * l3**k for w, (i, k) in zip(weights, powers)) * areas
    shear = table[f'{prefix}.shear']
    assert isinstance(shear, list)
    first = geometry.frames[:, :, 1] / np.linalg.norm(geometry.frames[:, :, 1], axis=1)[:, None]
    second = np.cross(geometry.normals, first)
    pressure = float(table[f'{prefix}.pressure'])  # type: ignore[arg-type]
    direction = -pressure * geometry.normals
    # Without friction, the tangential part of a follower traction never acts.
    if not (table[f'{prefix}.frictionless'] and table[f'{prefix}.direction'] == 'follower'):
        direction = direction + shear[0] * first + shear[1] * second
    total, moment = float(g.sum()), np.einsum('m,fmi->fi', g, points)
    scale = float(np.abs(g).sum())
    area, centroids = float(areas.sum()), geometry.centroids
    # g = (g + c) - c keeps the lever of the first part within a few faces.
    c = 0.0 if abs(total) > 0.125 * scale else scale / area
    forces = np.stack([(total + c * area) * direction, -c * area * direction], axis=1)
    levers = (moment + c * area * centroids) / (total + c * area)
    return forces, np.stack([levers, centroids], axis=1)


def _follower(
    bodies: np.ndarray, faces: np.ndarray, force: np.ndarray, point: np.ndarray
) -> list[FaceWrench]:
    """Return one wrench about the centre for all faces, or no wrench if they cancel exactly."""
    if not len(faces):
        return []
    total = force[faces].sum(axis=(0, 1))
    torque = np.cross(point[faces], force[faces]).sum(axis=(0, 1))
    # The rest of parts that cancel is round-off.
    size = float(np.linalg.norm(force[faces], axis=-1).sum())
    arm = float(np.linalg.norm(point[faces], axis=-1).max())
    total = np.where(np.abs(total) > 1e-15 * size, total, 0.0)
    torque = np.where(np.abs(torque) > 1e-15 * size * arm, torque, 0.0)
    if not (total.any() or torque.any()):
        return []
    return [FaceWrench(bodies, True, total, torque, _ZERO_VECTOR, _ZERO_VECTOR)]


def _degree(count: int) -> int:
    return (math.isqrt(8 * count + 1) - 3) // 2
