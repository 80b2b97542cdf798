# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Line loads, forces per length along edges of bodies, integrated to wrenches.

A line load is a `Traction` on edges instead of faces: its force f(s) [N/m] at the fraction s of
the edge keeps its direction or turns with the body. If it depends on place or time, it is
evaluated in motion (`SurfaceLoad`).
"""

from icofabric_sim.geometry.icosahedron import (
    EDGES,
    FACES,
    NAMED_EDGE_VERTICES,
    NAMED_EDGES,
    vertices,
)
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
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.scene.profiles import make_profile
from icofabric_sim.scene.tractions import (
    FaceWrench,
    finite_values,
    fixed_wrenches,
    follower_wrenches,
    Traction,
    two_forces,
)
import numpy as np


def make_line_load(
    parameters: Parameters, name: str, bodies: np.ndarray, half_edge: float, start: InitialState
) -> Traction | SurfaceLoad:
    """Integrate `line_loads.NAME` over edges of its `bodies`, which `start` somewhere."""
    prefix = f'line_loads.{name}'
    key = f'{prefix}.edges'
    ends = vertices(half_edge)[EDGES[select_edges(key, parameters[key])]]  # (j, 2, 3)
    expression, turns = line_expression(parameters, name), parameters[f'{prefix}.frame'] == 'body'
    given = [np.eye(3)] if _is_vector(expression) else [[parameters[f'{prefix}.force']]]
    directions = np.repeat(np.array(given, float), len(ends), axis=0)  # (j, c, 3)

    def points(coordinates: np.ndarray) -> np.ndarray:
        return ends[:, :1] + coordinates[:, :1] * (ends[:, 1:] - ends[:, :1])

    rule, moving = Quadrature(1, 0.0), expression is not None and {*PLACE} & {
        *expression.variables}
    if expression is not None:
        rule = choose_quadrature(
            expression, _edge_rule,
            sample_places(
                expression, _edge_rule, start, bodies, points, parameters['duration'])
            if moving else named_coordinates)
    coordinates, weights = _edge_rule(rule.degree + 1)
    weights = 2.0 * half_edge * weights
    if expression is not None and moving:
        world = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (len(bodies), 4))
        return SurfaceLoad(
            expression, bodies, np.ones((len(bodies), len(ends)), bool), points(coordinates),
            weights, coordinates, directions, None, None if turns else world.copy(), rule,
            make_profile(parameters, prefix))
    factors = np.ones((1, len(weights))) if expression is None else finite_values(
        expression, coordinates)
    force, point = (np.concatenate(part, axis=1) for part in zip(*(
        two_forces(
            factor * weights, points(coordinates), directions[:, c], ends.mean(axis=1),
            2.0 * half_edge)
        for c, factor in enumerate(factors))))
    members, edges = bodies.astype(np.int32), np.arange(len(ends))
    wrenches: list[FaceWrench] = follower_wrenches(
        members, edges, force, point) if turns else fixed_wrenches(
        members, edges, force, point, np.eye(3), np.zeros((len(ends), 3)))
    return Traction(
        tuple(wrenches), make_profile(parameters, prefix), None if expression is None else rule)


def line_expression(parameters: Parameters, name: str) -> Expression | None:
    """Return `line_loads.NAME.expression`; raise ParameterError if other parameters oppose it."""
    prefix = f'line_loads.{name}'
    key = f'{prefix}.expression'
    expression = make_expression(parameters, key, ('s', *PLACE), (1, 3))
    if expression is None:
        return None
    if _is_vector(expression) and any(parameters[f'{prefix}.force']):
        raise ParameterError(
            key, f'{key} gives the force per length, and so does {prefix}.force: leave that out, '
            'or give one component, which is a factor')
    return expression


def select_edges(name: str, text: str) -> np.ndarray:
    """Return the numbers of the edges in EDGES that the text names."""
    found: list[int] = []
    for word in text.split():
        if word == 'all':
            found += range(len(EDGES))
            continue
        ends = set()
        if word in NAMED_EDGES:
            ends = {*NAMED_EDGE_VERTICES[NAMED_EDGES.index(word)].tolist()}
        elif all(part.isdecimal() and 1 <= int(part) <= len(FACES) for part in word.split('-')):
            faces = [{*FACES[int(part) - 1].tolist()} for part in word.split('-')]
            ends = set.intersection(*faces)
        if len(ends) != 2:
            raise ParameterError(
                name, f'{name}: {word!r} is no edge; use {", ".join(NAMED_EDGES)}, all, or the '
                'numbers (1 to 20) of two faces that meet at it, such as 1-2')
        found.append(EDGES.tolist().index(sorted(ends)))
    if not found:
        raise ParameterError(name, f'{name} names no edge; use {", ".join(NAMED_EDGES)} or all')
    return np.unique(found)


def _is_vector(expression: Expression | None) -> bool:
    return expression is not None and len(expression.components) == 3


def _edge_rule(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points (s, 0) and weights of the Gauss rule of a degree on the unit interval."""
    nodes, weights = np.polynomial.legendre.leggauss(degree // 2 + 1)
    return np.column_stack([0.5 + 0.5 * nodes, 0.0 * nodes]), 0.5 * weights
