# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Connectors around shells are drawn around them: snapshots, markers, the page and pictures."""

from analytical import quaternion_product, rotation_quaternion
from fabrics import make_scene, snapshot_of
from icofabric_sim.geometry.icosahedron import face_geometry, inscribed_radius
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.messages import decode_marker_points, MarkerAction
from icofabric_sim.messages.markers import STRAIN_CLASSES
from icofabric_sim.messages.topics import CONNECTORS, Outputs
from icofabric_sim.pictures.camera import Area, fit_camera, View
from icofabric_sim.pictures.fabric_polygons import fabric_polygons
from icofabric_sim.pictures.measures import connector_segments, values_of
from icofabric_sim.pictures.moment import Moment
from icofabric_sim.viewer.sight import Sight
import numpy as np
import pytest

WRAP = {'connector.obstruction': 'wrap', 'contact.mode': 'never'}
CASES = {
    'midpoints': WRAP,
    'posts': {**WRAP, 'connector.attachment_scale': 1.2},
    'bias, kinked': {**WRAP, 'weave.kind': 'bias', 'connector.stiffness_compression': 150.0}}


def turned(case, seed=3, amplitude=0.9):
    """A fabric whose bodies are turned far enough for many connectors to lie around shells."""
    scene = make_scene((3, 3, 3), CASES[case])
    random = np.random.default_rng(seed)
    turns = rotation_quaternion(amplitude * random.standard_normal((scene.body_count, 3)))
    return scene, snapshot_of(
        scene, scene.position.copy(), quaternion_product(turns, scene.orientation))


def deepest(scene, snapshot, segments):
    """How deep (s,) [m] the segments are within the shells at the ends of their connectors."""
    normals, height = face_geometry(1.0).normals, inscribed_radius(scene.geometry.half_edge)
    axes = cosines_from_quaternions(snapshot.orientation)
    part = np.linspace(0.0, 1.0, 41)[:, None, None]
    points = (1.0 - part) * segments.ends[:, 0] + part * segments.ends[:, 1]
    found = np.zeros(len(segments.of))
    for bodies in scene.connectors.bodies[segments.of].T:
        own = np.einsum('kia,iba->kib', points - snapshot.position[bodies], axes[bodies])
        np.maximum(found, (height - (own @ normals.T).max(axis=2)).max(axis=0), out=found)
    return found


@pytest.mark.parametrize('case', CASES)
def test_parts_lead_around_shells_and_are_as_long_as_the_geodesic(case):
    scene, snapshot = turned(case)
    segments = snapshot.connector_segments
    assert (np.diff(segments.of) >= 0).all()
    parts = np.bincount(segments.of, minlength=scene.connector_count)
    found = (snapshot.without_geodesic == 0) & (snapshot.obstructed > 0)
    # Most cross several edges; what is straight has one part.
    assert found.sum() > 15 and (parts[found] > 1).all() and parts.max() > 3
    assert (parts[snapshot.obstructed == 0] == 1).all()
    np.testing.assert_allclose(
        segments.lengths(scene.connector_count), snapshot.connector_length, rtol=1e-12)
    own = ~(snapshot.without_geodesic > 0)[segments.of]
    half_edge = scene.geometry.half_edge
    assert deepest(scene, snapshot, segments)[own].max() < 1e-9 * half_edge
    straight = snapshot.connector_segments._replace(
        ends=snapshot.connector_ends, of=np.arange(scene.connector_count))
    assert deepest(scene, snapshot, straight)[found].max() > 0.1 * half_edge
    # Attachment points at both ends, and no gaps between.
    first = np.flatnonzero(np.diff(segments.of, prepend=-1))
    last = np.append(first[1:], len(segments.of)) - 1
    np.testing.assert_array_equal(segments.ends[first, 0], snapshot.connector_ends[:, 0])
    np.testing.assert_array_equal(segments.ends[last, 1], snapshot.connector_ends[:, 1])
    inner = np.setdiff1d(np.arange(len(segments.of)), first)
    np.testing.assert_array_equal(segments.ends[inner, 0], segments.ends[inner - 1, 1])


def test_markers_page_and_pictures_draw_the_same_parts():
    scene, snapshot = turned('midpoints')
    segments = snapshot.connector_segments
    sight, drawn = Sight(), []
    for message in Outputs(scene).connectors(snapshot, 0):
        marker = decode_marker_points(message)
        sight.feed(CONNECTORS, message)
        if marker.action == MarkerAction.ADD:
            # Around a shell the colour is that of the strain.
            assert marker.marker_id < len(STRAIN_CLASSES)
            drawn.append(marker.points.reshape(-1, 2, 3))
    drawn = np.concatenate(drawn)
    assert len(drawn) == len(segments.of) > 1.3 * scene.connector_count
    order, wanted = (np.lexsort(ends.reshape(-1, 6).T) for ends in (drawn, segments.ends))
    np.testing.assert_array_equal(drawn[order], segments.ends[wanted])
    assert sum(map(len, sight.lines.values())) == len(drawn)
    again = connector_segments(scene, snapshot.position, snapshot.orientation)
    np.testing.assert_array_equal(again.of, segments.of)
    np.testing.assert_allclose(again.ends, segments.ends, rtol=0, atol=1e-15)
    moment = Moment(0.0, snapshot.position, snapshot.orientation, scene)
    strain = snapshot.connector_length / scene.connectors.natural_length - 1.0
    np.testing.assert_allclose(values_of('strain', moment), strain, atol=1e-12)
    area = Area(0.0, 0.0, 900.0, 700.0)
    camera = fit_camera(View(), snapshot.position, 2.0 * scene.geometry.half_edge, area)
    polygons = fabric_polygons(moment, camera, area, marks=False).corners
    begins = 0.5 * (polygons[:, 0] + polygons[:, 3])
    for point in camera.project(segments.ends[:, 0], area)[::7]:
        assert np.abs(begins - point).sum(axis=1).min() < 1e-6


def test_a_scene_without_wrapping_traces_nothing(monkeypatch):
    scene = make_scene((3, 3, 2), {'contact.mode': 'never'})
    snapshot = snapshot_of(scene, scene.position.copy(), np.tile(scene.orientation[0], (
        scene.body_count, 1)))
    for name in ('trace_paths', 'trace_scene'):
        for module in ('simulation.model.snapshot', 'pictures.measures'):
            monkeypatch.setattr(f'icofabric_sim.{module}.{name}', None, raising=False)
    segments = snapshot.connector_segments
    assert segments.ends is snapshot.connector_ends and len(segments.of) == scene.connector_count
    assert len(connector_segments(
        scene, snapshot.position, snapshot.orientation).of) == scene.connector_count
