# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Whether shells may have passed through each other unseen within one long step.

A search finds all pairs that can touch before a body has moved by its reach. Where bodies move
farther in one step, the displacement of each pair is bounded instead: the cubic through the
places and velocities at both ends of the step lies within the hull of its Bezier points, and so
does the difference of two.
"""

from typing import NamedTuple

from icofabric_sim.scene.initial import InitialState
import numpy as np

# Pairs that are compared at once, which bounds temporary arrays.
_PIECE = 1 << 18


class Course(NamedTuple):
    """Where bodies are within a step."""

    points: np.ndarray  # (4, n, 3) Bezier points of the centres [m], beside a common motion
    turned: np.ndarray  # (n,) turned since the search at most [rad], or 2


class Passing(NamedTuple):
    """Two bodies, or a body and a plane, that may have passed through each other."""

    first: int
    second: int  # -1 - k: plane k
    way: float  # [m] that they moved against each other


def bezier_points(before: InitialState, after: InitialState, length: float) -> np.ndarray:
    """Points (4, n, 3) of the cubics from one state to another one `length` [s] later."""
    third = length / 3.0
    return np.stack([
        before.position, before.position + third * before.linear_velocity,
        after.position - third * after.linear_velocity, after.position])


def turned_at_most(
    look: np.ndarray, before: InitialState, after: InitialState, length: float
) -> np.ndarray:
    """
    Bound (n,) of the angles [rad] since the orientations (n, 4) at `look`; 2 where more.

    A point that turns by an angle x about a centre moves by 2 sin(x / 2), at most min(x, 2) radii.
    """
    spin = np.maximum(*(
        np.linalg.norm(state.angular_velocity, axis=1) for state in (before, after)))
    cosine = np.abs((look * before.orientation).sum(axis=1))
    angle = 2.0 * np.arccos(np.minimum(cosine, 1.0)) + length * spin
    return np.asarray(np.minimum(angle, 2.0))


def first_passing(
    course: Course, look: np.ndarray, planes: np.ndarray, shift: np.ndarray, *, reach: float,
    radius: np.ndarray, seen: np.ndarray | None = None
) -> Passing | None:
    """
    Return the first bodies that may have met unseen since the search at `look` (n, 3); or None.

    Of a pair that was not listed then the gap was at least twice the `reach` [m], so it is closed
    only where the two move by more than that beside each other; and they touch only where the
    spheres of `radius` (n,) [m] around them do. What is listed is computed, and seen. `planes` are
    (k, 4) normals and offsets [m]; `shift` (4, 3) [m] is what was taken off the points. `seen`:
    pairs (m, 2) that are listed and meet in many steps, which evaluate their contact; a second one
    of -1 - k is plane k.
    """
    seen = np.zeros((0, 2), np.int32) if seen is None else seen
    points, turned = course.points, radius * course.turned
    own = np.linalg.norm(points - look, axis=2).max(axis=0) + turned
    movers = np.flatnonzero(~(own <= reach))
    for plane, (*normal, offset) in enumerate(planes):
        fallers = np.setdiff1d(movers, seen[seen[:, 1] == -1 - plane, 0])
        height = ((points[:, fallers] + shift[:, None]) @ np.array(normal)).min(axis=0)
        height -= radius[fallers]
        if (height < offset).any():
            body = int(fallers[np.argmin(height)])
            return Passing(body, -1 - plane, float(own[body]))
    piece = max(1, _PIECE // max(len(own), 1))
    for start in range(0, len(movers), piece):
        some = movers[start:start + piece]
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
    Lower bound (m, n) of the distances from the origin of cubics with Bezier points (4, m, n, 3).

    That of the chord, less the most by which such a cubic leaves it.
    """
    start, chord = apart[0], apart[3] - apart[0]
    square = (chord * chord).sum(axis=-1)
    part = np.clip(-(start * chord).sum(axis=-1) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    nearest = np.linalg.norm(start + part[..., None] * chord, axis=-1)
    # 3 t (1 - t)^2 + 3 t^2 (1 - t) is at most 3 / 4.
    off = [
        np.linalg.norm(apart[k] - start - (k / 3.0) * chord, axis=-1) for k in (1, 2)]
    return np.asarray(nearest - 0.75 * np.maximum(*off))
