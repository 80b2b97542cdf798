# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Surface forces on faces, integrated to wrenches (eqs 35-40, corrected).

On a face f with outward unit normal n the traction is

    t(lambda2, lambda3) = g(lambda2, lambda3) (-p n + s1 e1 + s2 e2),

with the pressure p, the shear (s1, s2), the unit vectors e1 = w2 / |w2| along the first side of
the face and e2 = n x e1, and the factor g: a polynomial in the face coordinates (`variation`), or
an `expression`, which may also give the three components p, s1, s2.

A follower traction turns with its body; all faces together give one wrench in body axes. A
traction of fixed direction keeps its world direction as woven while its points turn with the body;
on a flat face it is equivalent to one force, or to a couple if the total vanishes. If the
expression depends on place or time, it is evaluated in motion (`SurfaceLoad`).
"""

import math
from typing import NamedTuple

from icofabric_sim.checks import number_in
from icofabric_sim.geometry.icosahedron import (
    face_geometry,
    face_points,
    face_quadrature,
    triangle_rule,
)
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.expression_loads import (
    choose_quadrature,
    named_coordinates,
    PLACE,
    Quadrature,
    sample_places,
    SurfaceLoad,
)
from icofabric_sim.scene.expressions import Expression, make_expression
from icofabric_sim.scene.faces import select_faces, Shells
from icofabric_sim.scene.initial import InitialState
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
    """One traction, `tractions.NAME`, or line load, `line_loads.NAME`."""

    wrenches: tuple[FaceWrench, ...]
    profile: Profile
    quadrature: Quadrature | None = None  # of an expression


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
    orientation: np.ndarray, geometry: WeaveGeometry, start: InitialState
) -> Traction | SurfaceLoad:
    """
    Integrate `tractions.NAME` over faces of its `bodies`; `position` is that of all bodies.

    Forces that depend on place or time are returned as a SurfaceLoad, for bodies that `start`
    somewhere.
    """
    prefix, half_edge = f'tractions.{name}', geometry.half_edge
    mask = select_faces(
        f'{prefix}.faces', parameters[f'{prefix}.faces'],
        Shells(position, orientation, bodies, half_edge, geometry.pitch))
    expression = traction_expression(parameters, name)
    follower = parameters[f'{prefix}.direction'] == 'follower'
    frictionless = parameters[f'{prefix}.frictionless']
    normals = face_geometry(half_edge).normals
    directions = _directions(parameters, prefix, half_edge, expression)
    if expression is not None and {*PLACE} & {*expression.variables}:
        rule = choose_quadrature(expression, triangle_rule, sample_places(
            expression, triangle_rule, start, bodies,
            lambda coordinates: face_points(half_edge, coordinates), parameters['duration']))
        coordinates, _ = triangle_rule(rule.degree + 1)
        points, areas = face_quadrature(half_edge, degree=rule.degree + 1)
        return SurfaceLoad(
            expression, bodies, mask, points, areas, coordinates, directions,
            normals if frictionless else None, None if follower else orientation[bodies], rule,
            make_profile(parameters, prefix))
    quadrature = None if expression is None else choose_quadrature(
        expression, triangle_rule, named_coordinates)
    force, point = _face_forces(parameters, prefix, half_edge, directions, expression, quadrature)
    rounded = np.zeros((len(bodies), 0)) if follower else np.round(
        orientation[bodies] / _EQUAL_QUATERNION)
    _, first, kind = np.unique(
        np.hstack([mask, rounded]), axis=0, return_index=True, return_inverse=True)
    wrenches: list[FaceWrench] = []
    for number, example in enumerate(first):
        alike = bodies[kind.ravel() == number].astype(np.int32)
        faces = np.flatnonzero(mask[example])
        if follower:
            wrenches += follower_wrenches(alike, faces, force, point)
        else:
            axes = cosines_from_quaternions(orientation[bodies[example]][None])[0]
            wrenches += fixed_wrenches(
                alike, faces, force, point, axes,
                normals if frictionless else np.zeros_like(normals))
    return Traction(tuple(wrenches), make_profile(parameters, prefix), quadrature)


def traction_expression(parameters: Parameters, name: str) -> Expression | None:
    """Return `tractions.NAME.expression`; raise ParameterError if other parameters oppose it."""
    prefix = f'tractions.{name}'
    key = f'{prefix}.expression'
    expression = make_expression(parameters, key, ('xi', 'eta', *PLACE), (1, 3))
    if expression is None:
        return None
    given = [field for field in ('variation', 'pressure', 'shear')
             if parameters[f'{prefix}.{field}'] not in ('', 0.0, [0.0, 0.0])]
    if 'variation' in given:
        raise ParameterError(
            key, f'{key} and {prefix}.variation are two factors: write the polynomial into the '
            'expression, with xi for l2 and eta for l3')
    if given and len(expression.components) == 3:
        raise ParameterError(
            key, f'{key} gives pressure and shears, and so does {prefix}.{given[0]}: leave that '
            'out, or give one component, which is a factor')
    return expression


def _directions(
    parameters: Parameters, prefix: str, half_edge: float, expression: Expression | None
) -> np.ndarray:
    """
    Return the tractions (20, c, 3) [Pa] on faces that components of the expression multiply.

    Without an expression there is one, of the factor 1. Body axes as woven.
    """
    geometry = face_geometry(half_edge)
    first = geometry.frames[:, :, 1] / np.linalg.norm(geometry.frames[:, :, 1], axis=1)[:, None]
    second = np.cross(geometry.normals, first)
    # Without friction, the tangential part of a follower traction never acts.
    slides = parameters[f'{prefix}.frictionless'] and (
        parameters[f'{prefix}.direction'] == 'follower')
    if expression is not None and len(expression.components) == 3:
        return np.stack([-geometry.normals, *(
            0.0 * part if slides else part for part in (first, second))], axis=1)
    shear = parameters[f'{prefix}.shear']
    direction = -parameters[f'{prefix}.pressure'] * geometry.normals
    if not slides:
        direction = direction + shear[0] * first + shear[1] * second
    return direction[:, None]


def _face_forces(
    parameters: Parameters, prefix: str, half_edge: float, directions: np.ndarray,
    expression: Expression | None, quadrature: Quadrature | None
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the forces [N] on every face and their points [m], (20, 2 c, 3), body axes as woven.

    Each component has two forces on each face that add up to the traction, because a single force
    would have no finite lever if the total vanishes.
    """
    name = f'{prefix}.variation'
    weights = polynomial(name, parameters[name])
    degree = _degree(len(weights)) if quadrature is None else quadrature.degree
    coordinates, _ = triangle_rule(degree + 1)
    points, areas = face_quadrature(half_edge, degree=degree + 1)
    if expression is not None:
        factors = finite_values(expression, coordinates)
    else:
        l2, l3 = coordinates.T
        powers = [(n - k, k) for n in range(degree + 1) for k in range(n + 1)]
        factors = np.array([sum(w * l2**i * l3**k for w, (i, k) in zip(weights, powers))])
    forces, levers = zip(*(
        two_forces(
            factor * areas, points, directions[:, c], face_geometry(half_edge).centroids,
            float(areas.sum()))
        for c, factor in enumerate(factors)))
    return np.concatenate(forces, axis=1), np.concatenate(levers, axis=1)


def finite_values(expression: Expression, coordinates: np.ndarray) -> np.ndarray:
    """Return the components (c, k) at points; raise ParameterError if one is not finite."""
    places = named_coordinates(coordinates)
    values = expression.values(**places)
    wrong = np.flatnonzero(~np.isfinite(values).all(axis=0))
    if len(wrong):
        place = ', '.join(
            f'{name} = {places[name][wrong[0]]:.4g}' for name in expression.variables)
        raise ParameterError(
            expression.name, f'{expression.name} is not a finite number at {place}')
    return values


def two_forces(
    g: np.ndarray, points: np.ndarray, direction: np.ndarray, middles: np.ndarray, size: float
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return two forces (j, 2, 3) [N] and their points [m] for weights g (k,) on j faces or edges.

    `points` (j, k, 3) are those of the weights, `direction` (j, 3), `middles` (j, 3) centroids,
    `size` the area or length of each.
    """
    total, moment = float(g.sum()), np.einsum('m,fmi->fi', g, points)
    scale = float(np.abs(g).sum())
    # g = (g + c) - c keeps the lever of the first part within a few faces.
    c = 0.0 if abs(total) > 0.125 * scale else scale / size
    forces = np.stack([(total + c * size) * direction, -c * size * direction], axis=1)
    levers = (moment + c * size * middles) / (total + c * size) if scale > 0.0 else middles
    return forces, np.stack([levers, middles], axis=1)


def fixed_wrenches(
    bodies: np.ndarray, faces: np.ndarray, force: np.ndarray, point: np.ndarray,
    axes: np.ndarray, normals: np.ndarray
) -> list[FaceWrench]:
    """
    Return wrenches of forces (j, k, 3) [N] of fixed direction, along `axes` as rows.

    `normals` (j, 3): see FaceWrench.
    """
    return [
        FaceWrench(bodies, False, part @ axes, _ZERO_VECTOR, at, normals[f])
        for f in faces for part, at in zip(force[f], point[f]) if part.any()]


def follower_wrenches(
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
