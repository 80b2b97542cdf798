# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Weaves cut to regions: which bodies stay, in which order, what joins them, and what is refused.
"""

import math
import struct
import tracemalloc

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.scene.region import make_region
from icofabric_sim.scene.scene import estimate_bodies
from icofabric_sim.scene.summary import describe_scene
from icofabric_sim.scene.weave import build_weave, fabric_orientation, rotation_matrix
from icofabric_sim.scene.weave_connect import connect_grid
import numpy as np
import pytest

PITCH = make_scene().geometry.pitch
# Vertices and outward faces of the cube from -1 to 1.
CORNERS = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], float)
QUADS = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
TRIANGLES = np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))])


def binary_stl(corners):
    """Binary STL of triangles (t, 3, 3)."""
    data = bytearray(b'solid like a text'.ljust(80)) + struct.pack('<I', len(corners))
    for triangle in corners:
        data += struct.pack('<12fH', 0, 0, 0, *triangle.ravel(), 0)
    return bytes(data)


def text_stl(corners):
    """The same as text."""
    lines = ['solid some']
    for triangle in corners:
        lines += ['facet normal 0 0 0', ' outer loop']
        lines += [' vertex ' + ' '.join(repr(float(x)) for x in point) for point in triangle]
        lines += [' endloop', 'endfacet']
    return ('\r\n'.join([*lines, 'endsolid some']) + '\n').encode()


def obj(points, faces):
    """OBJ of points and of faces with any number of corners."""
    lines = [f'v {x!r} {y!r} {z!r}' for x, y, z in points.tolist()]
    lines += ['f ' + ' '.join(f'{k + 1}/{k + 1}/1' for k in face) for face in faces]
    return '\n'.join(['# a mesh', 'o thing', *lines]).encode()


def write(path, data):
    """Write a file; returns its path as a text."""
    path.write_bytes(data)
    return str(path)


def expected(region, size, variant, rotation=None):
    """Centres of a slab, about its middle, that `region` says are inside, as grid points."""
    z, y, x = (k.ravel() for k in np.meshgrid(*(np.arange(n) for n in size[::-1]), indexing='ij'))
    grid = np.stack((x, y, z), axis=1)
    grid = grid[grid.sum(axis=1) % 2 == (variant & 1)]
    place = PITCH * (grid - 0.5 * (np.array(size) - 1.0))
    if rotation is not None:
        place = place @ rotation.T
    return grid[region(place)]


SHAPES = {
    'sphere': (f'sphere {2.3 * PITCH}', lambda p: np.linalg.norm(p, axis=1) <= 2.3 * PITCH),
    'cylinder': (
        f'cylinder {2.3 * PITCH} {3.1 * PITCH}',
        lambda p: (np.hypot(p[:, 0], p[:, 1]) <= 2.3 * PITCH) & (
            np.abs(p[:, 2]) <= 1.55 * PITCH)),
    'box': (
        f'box {4.2 * PITCH} {3.3 * PITCH} {2.5 * PITCH}',
        lambda p: np.all(np.abs(p) <= 0.5 * PITCH * np.array([4.2, 3.3, 2.5]), axis=1))}


@pytest.mark.parametrize('variant', [0, 1, 2, 3])
@pytest.mark.parametrize('shape', SHAPES)
def test_an_orthogonal_weave_is_cut(shape, variant):
    text, inside = SHAPES[shape]
    size = (7, 6, 5)
    scene = make_scene(size, {'weave.region': text, 'weave.variant': variant})
    whole = make_scene(size, {'weave.variant': variant})
    grid = expected(inside, size, variant)
    # In the order of the grid: by level, then column, then row.
    assert scene.weave.grid.tolist() == grid.tolist()
    assert 0 < scene.body_count < whole.body_count
    # At the places that they had, turned as they were.
    place = {tuple(g): p for g, p in zip(whole.weave.grid.tolist(), whole.position.tolist())}
    assert scene.position.tolist() == [place[tuple(g)] for g in grid.tolist()]
    assert np.array_equal(scene.weave.orientation, whole.weave.orientation)
    # What is left between them are the connectors of the whole that have both their ends.
    number = {g: k for k, g in enumerate(map(tuple, grid.tolist()))}
    pairs = {
        tuple(sorted(number[tuple(whole.weave.grid[b])] for b in pair)): None
        for pair in whole.connectors.bodies
        if all(tuple(whole.weave.grid[b]) in number for b in pair)}
    assert sorted(map(tuple, scene.connectors.bodies.tolist())) == sorted(pairs)
    assert estimate_bodies(scene.parameters) >= scene.body_count


@pytest.mark.parametrize('boundary', ['upright', 'fabric'])
@pytest.mark.parametrize('shape', SHAPES)
def test_a_bias_weave_is_cut(shape, boundary):
    text, inside = SHAPES[shape]
    changes = {'weave.kind': 'bias', 'weave.boundary': boundary, 'weave.azimuth': 0.3}
    size = (6, 7, 6)
    scene = make_scene(size, {**changes, 'weave.region': text})
    whole = make_scene(size, changes)
    middle = 0.5 * PITCH * (np.array(size) - 1.0)
    if boundary == 'fabric':
        middle = rotation_matrix(fabric_orientation('bias', 0.3)) @ middle
    kept = whole.position[inside(whole.position - middle)]
    order = np.lexsort(whole.weave.grid[inside(whole.position - middle)].T)
    np.testing.assert_allclose(scene.position, kept[order], rtol=0, atol=1e-14)
    assert 4 < scene.body_count < whole.body_count
    assert estimate_bodies(scene.parameters) >= scene.body_count


def test_centres_on_the_border_belong_to_the_region():
    # From the body in the middle: 12 neighbours at sqrt(2), 6 at 2 pitches.
    for radius, count in ((1.0, 1), (math.sqrt(2.0), 13), (1.999, 13), (2.0, 19)):
        scene = make_scene((7, 7, 7), {
            'weave.region': f'sphere {radius * PITCH}', 'weave.variant': 1})
        assert scene.body_count == count


def test_a_cut_fabric_moves_and_keeps_its_groups():
    scene = make_scene((9, 9, 9), {
        'weave.region': f'sphere {4 * PITCH}', 'groups.top': 'level 8', 'groups.cap': 'z_max',
        'gravity': [0.0, 0.0, -9.81], 'supports.top.group': 'top', 'solver.method': 'srkn4'})
    assert scene.groups['top'].tolist() == [scene.body_count - 1] == scene.groups['cap'].tolist()
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.02)
    s = simulation.snapshot()
    assert np.abs(s.position - scene.position).max() > 1e-4
    assert abs(s.energy['balance_error']) < 1e-6 * s.energy['kinetic']


@pytest.mark.parametrize('form', ['binary', 'text', 'obj'])
def test_a_cube_as_a_mesh_is_a_box(form, tmp_path):
    # Its border goes exactly through centres, as the box's does. Not about its own origin.
    half = PITCH * np.array([2.0, 1.0, 2.0])
    points = half * CORNERS + (0.25, 0.5, 0.125)
    if form == 'obj':
        path = write(tmp_path / 'cube.OBJ', obj(points, QUADS))
    else:
        data = (binary_stl if form == 'binary' else text_stl)(points[TRIANGLES])
        path = write(tmp_path / 'cube.stl', data)
    if form == 'binary':
        half = half * (1.0 + 1e-6)  # in single precision it is a little smaller or larger
        data = binary_stl((half * CORNERS)[TRIANGLES])
        path = write(tmp_path / 'larger.stl', data)
    box = make_scene((7, 7, 7), {
        'weave.region': 'box ' + ' '.join(str(2.0 * x) for x in half.tolist())})
    mesh = make_scene((7, 7, 7), {'weave.region': path})
    assert mesh.weave.grid.tolist() == box.weave.grid.tolist()
    assert box.body_count == 38 or form == 'binary'
    assert np.array_equal(mesh.connectors.bodies, box.connectors.bodies)


def geodesic(level):
    """Points and triangles of a refined octahedron on the unit sphere."""
    points = [tuple(s * e) for e in np.eye(3) for s in (1.0, -1.0)]
    faces = [
        (0 + i, 2 + j, 4 + k) if (i + j + k) % 2 == 0 else (2 + j, 0 + i, 4 + k)
        for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    for _ in range(level):
        number, finer = {p: k for k, p in enumerate(points)}, []

        def middle(a, b, number=number):
            p = np.array(points[a]) + np.array(points[b])
            key = tuple((p / np.linalg.norm(p)).tolist())
            if key not in number:
                number[key] = len(points)
                points.append(key)
            return number[key]

        for a, b, c in faces:
            ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
            finer += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = finer
    return np.array(points), np.array(faces)


def test_points_in_a_round_mesh_with_a_hollow_and_a_second_part(tmp_path):
    points, faces = geodesic(4)
    inner = 0.5 * points[faces[:, ::-1]]
    other = points[faces] + (1.5, 0.0, 0.0)
    corners = np.concatenate([points[faces], inner, other])
    region = make_region(write(tmp_path / 'parts.stl', text_stl(corners)))
    assert region.oriented
    places = np.random.RandomState(1).uniform(-2.2, 2.2, (20_000, 3))
    # Rays through corners and along edges too.
    places[:200, :2] = (points[:200] - (0.75, 0.0, 0.0))[:, :2]
    near = places + (0.75, 0.0, 0.0)
    one, two = np.linalg.norm(near, axis=1), np.linalg.norm(near - (1.5, 0.0, 0.0), axis=1)
    # The mesh lies up to 0.4 % within its sphere.
    clear = (np.abs(one - 1.0) > 5e-3) & (np.abs(two - 1.0) > 5e-3) & (np.abs(one - 0.5) > 5e-3)
    # Where the second overlaps the hollow it fills it.
    inside = ((one < 1.0) & (one > 0.5)) | (two < 1.0)
    assert np.array_equal(region.contains(places)[clear], inside[clear])
    assert clear.sum() > 15_000 and inside[clear].sum() > 1000
    # Without a side of its own a surface counts crossings: what overlaps is left out.
    corners[0] = corners[0][::-1]
    region = make_region(write(tmp_path / 'mixed.stl', text_stl(corners)))
    assert not region.oriented
    crossings = (one < 1.0).astype(int) + (one < 0.5) + (two < 1.0)
    assert np.array_equal(region.contains(places)[clear], (crossings % 2 == 1)[clear])


def test_faces_that_stand_upright_bound_too(tmp_path):
    # A prism over an L, whose inner corner bends inwards: rays run along its sides.
    base = np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 3], [0, 3]], float)
    points = np.vstack([np.c_[base, np.zeros(6)], np.c_[base, np.ones(6)]])
    sides = [(k, (k + 1) % 6, 6 + (k + 1) % 6, 6 + k) for k in range(6)]
    caps = [(0, 3, 2, 1), (0, 5, 4, 3), (6, 7, 8, 9), (6, 9, 10, 11)]
    region = make_region(write(tmp_path / 'l.obj', obj(points, sides + caps)))
    grid = np.array([[x, y, z] for x in range(-1, 14) for y in range(-1, 14) for z in range(6)])
    places = 0.25 * grid - (1.5, 1.5, 0.5)
    x, y, z = grid.T
    inside = (0 <= x) & (x <= 12) & (0 <= y) & (y <= 12) & (z <= 4) & ((x <= 4) | (y <= 4))
    assert np.array_equal(region.contains(places), inside)


@pytest.mark.parametrize('turned', [False, True])
def test_rays_through_corners_and_faces_turned_inwards(turned, tmp_path):
    # Corners and edges of an octahedron lie exactly on the rays of a grid.
    points = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
    faces = [(x, y, z) if (x + y + z) % 2 == 0 else (y, x, z)
             for x in (0, 1) for y in (2, 3) for z in (4, 5)]
    faces = [face[::-1] if turned else face for face in faces]
    region = make_region(write(tmp_path / 'octahedron.obj', obj(points, faces)))
    assert region.oriented
    places = 0.125 * np.array(list(np.ndindex(25, 25, 25)), float) - 1.5
    size = np.abs(places).sum(axis=1)
    clear = size != 1.0
    assert np.array_equal(region.contains(places)[clear], (size < 1.0)[clear])


def test_a_small_region_of_a_huge_fabric_looks_at_few_places():
    """One byte for each of its 10^9 places would show."""
    tracemalloc.start()
    scene = ico.Scene.from_parameters({
        'weave': {'size': [1001, 1001, 1001], 'region': f'sphere {1.5 * PITCH}'}})
    assert 10 < scene.body_count < 20
    assert estimate_bodies(scene.parameters) <= 32
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 0 < peak < 50e6


def test_order_of_cut_fabrics_does_not_depend_on_pieces(monkeypatch):
    from icofabric_sim.scene import weave_lattice
    geometry, region = make_scene().geometry, make_region(f'sphere {3.2 * PITCH}')
    whole = build_weave('orthogonal', 2, (9, 8, 7), geometry, region=region)
    monkeypatch.setattr(weave_lattice, '_BATCH_POINTS', 11)
    pieces = build_weave('orthogonal', 2, (9, 8, 7), geometry, region=region)
    assert np.array_equal(whole.grid, pieces.grid)
    assert np.array_equal(whole.connector_edges, pieces.connector_edges)
    assert np.array_equal(
        connect_grid(whole.grid, 2).bodies, whole.connector_bodies)


@pytest.mark.parametrize('text, words', [
    ('sphere', ['sphere R', 'm']),
    ('sphere -1', ['positive', 'sphere R']),
    ('cylinder 1', ['2 positive', 'cylinder R H']),
    ('box 1 2 nan', ['3 positive', 'box X Y Z']),
    ('sphere 1_0', ['positive', 'sphere R']),
    ('ball 2', ['not a region', 'sphere R', '.stl']),
    ('nowhere.stl', ['nowhere.stl', 'No such file']),
    ('sphere 1e-9', ['contains no centre', 'larger region']),
])
def test_regions_that_make_no_sense_are_refused(text, words):
    with pytest.raises(ValueError) as caught:
        make_scene((4, 4, 4), {'weave.region': text, 'weave.variant': 1})
    for word in ['weave.region', *words]:
        assert word in str(caught.value)


CUBE = CORNERS[TRIANGLES]


@pytest.mark.parametrize('name, data, words', [
    ('open.stl', text_stl(CUBE[:-1]), ['not closed', '3 of its']),
    ('cut.stl', binary_stl(CUBE)[:-10], ['cut off']),
    ('cut.stl', text_stl(CUBE)[:-60], ['cut off']),
    ('long.stl', binary_stl(CUBE).replace(b'solid', b'stuff') + bytes(60),
     ['744 bytes', '12 triangles take 684']),
    ('empty.stl', text_stl(CUBE[:0]), ['no triangles']),
    ('flat.stl', text_stl(CUBE * (1, 1, 0)), ['flat']),
    ('nan.stl', binary_stl(CUBE * np.nan), ['not finite']),
    ('word.stl', b'nothing of the kind', ['neither']),
    ('far.obj', obj(CORNERS, [(0, 1, 9)]), ['line', 'points before it']),
    ('two.obj', b'v 1 2', ['line 1', 'three numbers']),
    ('python.obj', b'v 1_0 2 3', ['line 1', 'three numbers']),
    ('python.obj', obj(CORNERS, []) + b'\nf 1 2 0_3', ['a face needs']),
])
def test_files_that_are_no_closed_mesh_are_refused(name, data, words, tmp_path):
    path = write(tmp_path / name, data)
    with pytest.raises(ParameterError) as caught:
        make_scene((4, 4, 4), {'weave.region': path})
    for word in ['weave.region', name, *words]:
        assert word in str(caught.value)


VARIANTS_OF_FILES = {
    'upper case': text_stl(CUBE).upper(),
    'comment at the end': text_stl(CUBE) + b'# made by hand\n; and more\n',
    'byte order mark': b'\xef\xbb\xbf' + text_stl(CUBE),
    'carriage returns': text_stl(CUBE).replace(b'\r\n', b'\r').replace(b'\n', b'\r'),
    'one byte more': binary_stl(CUBE) + b'\n',
    'two bytes more': binary_stl(CUBE) + b'\0\0'}


@pytest.mark.parametrize('form', VARIANTS_OF_FILES)
def test_forms_that_other_programs_write_are_read(form, tmp_path):
    region = make_region(write(tmp_path / 'cube.stl', VARIANTS_OF_FILES[form]))
    assert region.half_extent.tolist() == [1.0, 1.0, 1.0] and len(region.corners) == 12


def test_an_obj_of_another_program_is_read(tmp_path):
    data = obj(CORNERS, QUADS).replace(b'\n', b' # a comment\r')
    region = make_region(write(tmp_path / 'cube.obj', b'\xef\xbb\xbf' + data))
    assert len(region.corners) == 12


@pytest.mark.parametrize('changes', [{}, {'weave.kind': 'bias'}])
def test_a_mesh_in_millimetres_is_reported(changes, tmp_path, caplog):
    """It keeps all bodies. `info` names the region and its sides."""
    size = (5, 5, 5)
    small = write(tmp_path / 'm.stl', text_stl(1.5 * PITCH * CUBE))
    scene = make_scene(size, {**changes, 'weave.region': small})
    assert not caplog.messages
    path = write(tmp_path / 'mm.stl', text_stl(1500.0 * PITCH * CUBE))
    whole = make_scene(size, {**changes, 'weave.region': path})
    assert whole.body_count > scene.body_count
    [warning] = caplog.messages
    assert f'weave.region keeps all {whole.body_count} bodies' in warning
    assert '97.0' in warning and 'a mesh is in m' in warning
    rows = [text for _, text in describe_scene(whole)]
    assert any(text.startswith(f'cut to {path}, 97.0') for text in rows)
