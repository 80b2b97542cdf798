# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Slots and links: every connector is found from both ends, whatever the fabric."""

from fabrics import make_scene, STATE
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.scene import weave_connect
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.simulation.model import layout as layout_module
from icofabric_sim.simulation.model.layout import make_layout
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.terms.shared import EDGE_COUNT, LINK_COUNT, LINKS_PER_EDGE
import numpy as np
import pytest

SIZES = (
    *((n, n, n) for n in range(1, 8)), (1, 5, 1), (1, 1, 6), (7, 1, 1), (1, 4, 3), (5, 1, 4),
    (6, 3, 1), (2, 7, 3), (20, 2, 3), (3, 2, 17), (2, 33, 2))
# Diagonal cuts, where rows begin and end anywhere.
AZIMUTHS = (0.0, 0.4, *np.random.default_rng(1).uniform(-3.2, 3.2, 3))


def check(scene):
    """Layout and links against `scene.connectors`; returns the layout."""
    packed = pack_scene(scene)
    layout, links = packed.layout, packed.model.links
    slot, blocks = layout.slot.astype(int), layout.blocks
    # Each body has a slot of its own, with room for a vector on either side.
    assert len(set(slot.tolist())) == scene.body_count == layout.body_count
    assert slot.min() >= LANES and slot.max() + LANES < layout.slot_count
    assert layout.slot_count % LANES == 0
    # Each slot with a body is in exactly one block, and only those are alive.
    assert (blocks.slot % LANES == 0).all()
    assert len(np.unique(blocks.slot)) == len(blocks.slot)
    alive = [
        first + lane for first, byte in zip(blocks.slot, blocks.alive)
        for lane in range(LANES) if int(byte) >> lane & 1]
    assert sorted(alive) == sorted(slot.tolist())
    assert (np.take(blocks.slot, layout.block_of(np.arange(scene.body_count)))
            == slot // LANES * LANES).all()
    if links is None:
        assert scene.connector_count == 0
        return layout
    # Both ends of all connectors, from the tables of the kernels ...
    body_at = dict(zip(slot.tolist(), range(scene.body_count)))
    seen = set()
    assert links.place.shape == links.present.shape == (len(blocks.slot), LINK_COUNT)
    reach = 0
    for block, first in enumerate(blocks.slot):
        for link in range(LINK_COUNT):
            place, byte = int(links.place[block, link]), int(links.present[block, link])
            # Also what is read where no connector is must lie within the points.
            assert 0 <= place
            assert place + 2 * layout.slot_count + LANES <= 18 * layout.slot_count
            for lane in range(LANES):
                if not byte >> lane & 1:
                    continue
                edge, start = divmod(place, 3 * layout.slot_count)
                assert edge < EDGE_COUNT
                body, other = body_at[first + lane], body_at[start + lane]
                entry = (body, link // LINKS_PER_EDGE, other, edge)
                assert entry not in seen
                seen.add(entry)
                reach = max(reach, abs(block - int(layout.block_of(np.array([other]))[0])))
    # ... are those of the scene.
    expected = set()
    for (first, second), (edge, other_edge) in zip(
            scene.connectors.bodies.tolist(), scene.connectors.edges.tolist()):
        expected |= {(first, edge, second, other_edge), (second, other_edge, first, edge)}
    assert seen == expected and len(expected) == 2 * scene.connector_count
    assert blocks.reach == reach
    return layout


@pytest.mark.parametrize('variant', range(4))
@pytest.mark.parametrize('size', SIZES, ids=str)
def test_orthogonal_weave(size, variant):
    if size == (1, 1, 1) and variant % 2:
        # Its only place is a gap.
        with pytest.raises(ValueError, match='no icosahedron'):
            make_scene(size, {'weave.variant': variant})
        return
    check(make_scene(size, {'weave.variant': variant}))


@pytest.mark.parametrize('boundary', ['upright', 'fabric'])
@pytest.mark.parametrize('variant', range(4))
def test_bias_weave(variant, boundary):
    counts = []
    # Some weaves have nothing in the smallest boxes.
    flat = [] if variant % 2 else [(1, 1, 1), (1, 6, 1)]
    for size in (*flat, (2, 2, 2), (3, 3, 3), (5, 5, 5), (2, 6, 3), (4, 2, 7), (6, 6, 6)):
        for azimuth in AZIMUTHS:
            scene = make_scene(size, {
                'weave.kind': 'bias', 'weave.variant': variant, 'weave.boundary': boundary,
                'weave.azimuth': float(azimuth)})
            check(scene)
            counts.append(scene.connector_count)
    assert max(counts) > 300


@pytest.mark.parametrize('size', [(1, 1, 1), (2, 2, 2), (5, 4, 3)])
def test_loose_bodies_beside_a_weave(size):
    changes = {
        f'bodies.b{number}.position': [0.5 + 0.1 * number, 0.0, 0.0] for number in range(11)}
    scene = make_scene(size, changes)
    assert scene.body_count == make_scene(size).body_count + 11
    check(scene)
    # The weave itself lies as it does alone.
    woven = pack_scene(make_scene(size)).layout.slot
    assert np.array_equal(pack_scene(scene).layout.slot[:len(woven)], woven)


def test_unconnected_bodies_have_slots_and_no_links():
    layout = check(make_scene((4, 4, 4), {'weave.connected': False}))
    assert layout.blocks.reach == 0
    layout = make_layout(np.zeros((0, 3), np.int32), 3 * LANES + 1)
    assert len(layout.blocks.slot) == 4
    assert [bin(byte).count('1') for byte in layout.blocks.alive] == [LANES] * 3 + [1]


@pytest.mark.parametrize('changes', [
    {}, {'weave.variant': 1}, {'weave.kind': 'bias'},
    {f'bodies.b{k}.position': [1.0, 0.1 * k, 0.0] for k in range(9)},
    {'connector_groups.g.direction': 'up down', 'connector_groups.g.stiffness_extension': 300.0}])
def test_what_is_made_in_pieces_is_that_of_the_whole(changes, monkeypatch):
    scene = make_scene((5, 6, 7), changes)
    packed = pack_scene(scene)
    assert scene.body_count > 7 * 11
    monkeypatch.setattr(layout_module, '_BATCH_SIZE', 11)
    monkeypatch.setattr(weave_connect, '_BATCH_BODIES', 11)
    monkeypatch.setattr(weave_connect, '_MAX_STORED_BODIES', 0)
    # Made anew, so that no connectors are listed yet.
    pieces = pack_scene(make_scene((5, 6, 7), changes))
    for one, other in (
            (packed.layout, pieces.layout), (packed.layout.blocks, pieces.layout.blocks),
            (packed.model.links, pieces.model.links)):
        names = 'slot', 'rows', 'alive', 'place', 'present', 'reach', 'slot_count', 'stiffness'
        for name in names:
            if hasattr(one, name):
                assert np.array_equal(getattr(one, name), getattr(other, name)), name
    if packed.model.links.variety is not None:
        for one, other in zip(packed.model.links.variety, pieces.model.links.variety):
            assert np.array_equal(one, other)
    listed = packed.connectors, pieces.connectors
    assert np.array_equal(listed[0].first, listed[1].first) and len(listed[0].first) > 300


def test_large_slabs_fill_their_blocks():
    # Of slots in blocks, few are empty; a slab's rows lie end to end.
    for size, most in (((21, 21, 21), 1.12), ((60, 60, 3), 1.12), ((5, 5, 5), 2.0)):
        layout = pack_scene(make_scene(size)).layout
        assert len(layout.blocks.slot) * LANES <= most * layout.body_count


@pytest.mark.parametrize('cosines', [False, True])
def test_states_come_back_from_their_slots(cosines):
    generator = np.random.default_rng(3)
    scene = make_scene((4, 3, 5), {'bodies.b.position': [0.5, 0.0, 0.0]})
    shape = (scene.body_count, 3)
    orientation = generator.standard_normal((scene.body_count, 4))
    orientation /= np.linalg.norm(orientation, axis=1, keepdims=True)
    orientation[orientation[:, 3] < 0.0] *= -1.0
    initial = InitialState(
        generator.standard_normal(shape), orientation, generator.standard_normal(shape),
        generator.standard_normal(shape))
    layout = pack_scene(scene, cosines=cosines).layout
    state = layout.pack(initial)
    assert state.orientation.shape == ((3, 3) if cosines else (4,)) + (layout.slot_count,)
    for array in state.rows():
        assert array.ctypes.data % 64 == 0
    for name, before, after in zip(STATE, initial, layout.unpack(state)):
        if name == 'orientation' and cosines:
            np.testing.assert_allclose(after, before, rtol=0, atol=1e-15)
        else:
            assert np.array_equal(after, before)
    # Slots without a body hold ordinary numbers: a unit orientation, no motion.
    empty = np.setdiff1d(np.arange(layout.slot_count), layout.slot)
    assert not state.position[:, empty].any() and not state.linear_velocity[:, empty].any()
    norm = (state.orientation[..., empty] ** 2).reshape(-1, len(empty)).sum(axis=0)
    assert (norm == (3.0 if cosines else 1.0)).all()


def test_values_spread_and_gather():
    layout = pack_scene(make_scene((3, 4, 2))).layout
    values = np.arange(layout.body_count * 6.0).reshape(-1, 2, 3)
    spread = layout.spread(values, empty=-1.0)
    assert spread.shape == (2, 3, layout.slot_count)
    assert np.array_equal(layout.gather(spread), values)
    assert (np.delete(spread, layout.slot, axis=-1) == -1.0).all()
