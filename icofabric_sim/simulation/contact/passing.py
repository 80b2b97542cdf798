# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Test whether shells may have passed through each other undetected within one long step.

A search finds all pairs that can touch before a body has moved by its reach. If bodies move
farther in one step, the relative displacement of each pair is bounded instead. The cubic through
the positions and velocities at both ends of the step lies within the hull of its Bezier points,
and so does the difference of two cubics.
"""

from typing import NamedTuple

from icofabric_sim.scene.initial import InitialState
import numpy as np

# Pairs of a batch: bounds the temporary arrays.
_BATCH_SIZE = 1 << 18


class Course(NamedTuple):
    """Paths of bodies within a step."""

    points: np.ndarray  # (4, n, 3) Bezier points of the centres [m], relative to a common motion
    turned: np.ndarray  # (n,) bound of rotation angles since the search [rad], at most 2


class Passing(NamedTuple):
    """Two bodies, or a body and a plane, that may have passed through each other."""

    first: int
    second: int  # -1 - k: plane k
    way: float  # [m] relative displacement


def bezier_points(before: InitialState, after: InitialState, length: float) -> np.ndarray:
    """Return the points (4, n, 3) of the cubics from a state to another one `length` [s] later."""
    third = length / 3.0
    return np.stack([
        before.position, before.position + third * before.linear_velocity,
        after.position - third * after.linear_velocity, after.position])


def turned_at_most(
    look: np.ndarray, before: InitialState, after: InitialState, length: float
) -> np.ndarray:
    """
    Bound the rotation angles [rad] since the orientations (n, 4) at `look`, (n,), at most 2.

    A point that rotates by an angle x about a centre moves by 2 sin(x / 2), at most min(x, 2)
    radii.
    """
    spin = np.maximum(*(
        np.linalg.norm(state.angular_velocity, axis=1) for state in (before, after)))
    cosine = np.abs((look * before.orientation).sum(axis=1))
    angle = 2.0 * np.arccos(np.minimum(cosine, 1.0)) + length * spin
    return np.asarray(np.minimum(angle, 2.0))


def first_passing(
    course: Course, look: np.ndarray, planes: np.ndarray, shift: np.ndarray, *, reach: float,
    radius: np.ndarray, seen: np.ndarray | None = None, carried: np.ndarray | None = None
) -> Passing | None:
    """
    Return the first bodies that may have met undetected since the search at `look` (n, 3).

    The result is None without such bodies. The gap of a pair that was not listed was at least
    twice the `reach` [m]. The gap can close only if the relative displacement exceeds twice the
    reach, and the bodies touch only if their spheres of `radius` (n,) [m] do. `planes` are (k, 4)
    normals and offsets [m]; `shift` (4, 3) [m] was subtracted from the points. `seen` are listed
    pairs (m, 2) whose contact is evaluated in each of many steps; a second body of -1 - k is plane
    k. `carried` (5, k, 3) [m] are the displacements of planes: Bezier points of the step, and that
    at the search; None: planes rest.
    """
    seen = np.zeros((0, 2), np.int32) if seen is None else seen
    points, turned = course.points, radius * course.turned
    own = np.linalg.norm(points - look, axis=2).max(axis=0) + turned
    movers = np.flatnonzero(~(own <= reach))
    for plane, (*normal, offset) in enumerate(planes):
        near, place = movers, shift[:, None]
        if carried is not None:
            # Relative to the plane.
            way = carried[:4, plane, None] - carried[4, plane]
            near = np.flatnonzero(~(
                np.linalg.norm(points - way - look, axis=2).max(axis=0) + turned <= reach))
            place = place - carried[:4, plane, None]
        fallers = np.setdiff1d(near, seen[seen[:, 1] == -1 - plane, 0])
        height = ((points[:, fallers] + place) @ np.array(normal)).min(axis=0)
        height -= radius[fallers]
        if (height < offset).any():
            body = int(fallers[np.argmin(height)])
            return Passing(body, -1 - plane, float(own[body]))
    batch = max(1, _BATCH_SIZE // max(len(own), 1))
    for start in range(0, len(movers), batch):
        some = movers[start:start + batch]
        apart = points[:, None, :] - points[:, some, None]
        way = np.linalg.norm(apart - (look - look[some, None]), axis=3).max(axis=0)
        way += turned + turned[some, None]
        meet = (way > 2.0 * reach) & (
            _least_distance(apart) < radius + radius[some, None])
        meet[np.arange(len(some)), some] = False
        for one, other in ((0, 1), (1, 0)):
            listed = seen[(seen[:, 1] >= 0) & np.isin(seen[:, one], some)]
            meet[np.searchsorted(some, listed[:, one]), listed[:, other]] = False
        if meet.any():
            row, other = (int(number[0]) for number in np.nonzero(meet))
            body = int(some[row])
            return Passing(min(body, other), max(body, other), float(way[row, other]))
    return None


def _least_distance(apart: np.ndarray) -> np.ndarray:
    """
    Return a lower bound (m, n) of the distance of cubics from the origin.

    The cubics have Bezier points (4, m, n, 3). The bound is the distance of the chord minus the
    largest deviation of such a cubic from the chord.
    """
    start, chord = apart[0], apart[3] - apart[0]
    square = (chord * chord).sum(axis=-1)
    part = np.clip(-(start * chord).sum(axis=-1) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    nearest = np.linalg.norm(start + part[..., None] * chord, axis=-1)
    # 3 t (1 - t)^2 + 3 t^2 (1 - t) is at most 3 / 4.
    off = [
        np.linalg.norm(apart[k] - start - (k / 3.0) * chord, axis=-1) for k in (1, 2)]
    return np.asarray(nearest - 0.75 * np.maximum(*off))
