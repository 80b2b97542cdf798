# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The order in which threads go over a fabric: nothing is pushed before its neighbours have drifted.
"""

from fabrics import make_scene, RANDOM, same_state
import icofabric_sim as ico
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.kernels.runtime.team import TILE
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.simulation.stepping import thread_team, traversal_order
from icofabric_sim.simulation.stepping.traversal_order import make_sweeps
import numpy as np
import pytest

SCENES = {
    'slab': ((21, 20, 9), {}), 'odd slab': ((9, 30, 12), {'weave.variant': 1}),
    'bias': ((9, 9, 9), {'weave.kind': 'bias', 'weave.azimuth': 0.3}),
    'loose': ((4, 4, 4), {'bodies.b.position': [0.5, 0.0, 0.0]}),
    'unconnected': ((6, 6, 6), {'weave.connected': False}),
}


def linked_blocks(packed):
    """Pairs of blocks that connectors join, from the scene's own list of connectors."""
    layout = packed.layout
    if packed.connectors is None:
        return set()
    bodies = np.arange(layout.body_count)
    block = dict(zip(layout.blocks.slot.tolist(), range(len(layout.blocks.slot))))
    of_body = [block[slot // LANES * LANES] for slot in layout.slot[bodies].tolist()]
    pairs = zip(packed.connectors.first.tolist(), packed.connectors.second.tolist())
    return {(of_body[a], of_body[b]) for a, b in pairs}


@pytest.mark.parametrize('panel', [3200, 64, 8])
@pytest.mark.parametrize('size', [1, 2, 3, 7])
@pytest.mark.parametrize('name', SCENES)
def test_neighbours_drift_before_a_push(name, size, panel, monkeypatch):
    monkeypatch.setattr(traversal_order, '_PANEL', panel)
    packed = pack_scene(make_scene(*SCENES[name]))
    count = len(packed.layout.blocks.slot)
    sweeps = make_sweeps(packed.layout, packed.model.links, size)
    assert len(sweeps) == size
    # Each block is one thread's, which drifts and pushes it once.
    assert sorted(np.concatenate([one.pushes for one in sweeps]).tolist()) == list(range(count))
    for one in sweeps:
        assert sorted(one.drifts.tolist()) == sorted(one.pushes.tolist())
    at_border = {block for one in sweeps for block in one.drifts[:one.border].tolist()}
    assert size > 1 or not at_border
    looked = 0
    for one in sweeps:
        assert len(one.ahead) == -(-len(one.pushes) // TILE)
        assert (np.diff(one.ahead) >= 0).all()
        assert not len(one.ahead) or one.ahead[-1] == len(one.drifts)
        own = set(one.pushes.tolist())
        turn = {block: number for number, block in enumerate(one.drifts.tolist())}
        place = {block: number for number, block in enumerate(one.pushes.tolist())}
        for block in own:
            assert turn[block] < max(one.ahead[place[block] // TILE], one.border)
        for a, b in linked_blocks(packed):
            for block, other in ((a, b), (b, a)):
                if block not in own:
                    continue
                looked += 1
                if other in own:
                    assert turn[other] < max(one.ahead[place[block] // TILE], one.border)
                else:
                    assert other in at_border
    assert looked > 0 or packed.model.links is None


@pytest.mark.parametrize('method', ['leapfrog', 'srkn6', 'srkn8'])
def test_panels_change_no_bit(method, monkeypatch):
    scene = make_scene((20, 13, 9), {'solver.method': method, 'solver.step': 1e-4}, **RANDOM)
    monkeypatch.setattr(thread_team, 'BODIES_PER_THREAD', 1)
    ends = []
    for panel, threads in ((3200, 1), (40, 1), (40, 2), (40, 3), (8, 5)):
        monkeypatch.setattr(traversal_order, '_PANEL', panel)
        monkeypatch.setattr(thread_team, 'core_count', lambda threads=threads: threads)
        simulation = ico.compile_scene(scene)
        assert simulation.status.thread_count == threads
        simulation.advance_to(0.001)
        ends.append(simulation.snapshot())
    for end in ends[1:]:
        assert same_state(end, ends[0])
    assert np.abs(ends[0].position - scene.initial.position).max() > 3e-5


def test_panels_bring_neighbours_close_in_time(monkeypatch):
    packed = pack_scene(make_scene((40, 40, 40)))
    pairs = np.array(sorted(linked_blocks(packed)))

    def between(panel):
        monkeypatch.setattr(traversal_order, '_PANEL', panel)
        one = make_sweeps(packed.layout, packed.model.links, 1)[0]
        place = np.argsort(one.pushes)
        return np.percentile(np.abs(np.diff(place[pairs], axis=1)), 80)
    assert between(200) < 0.4 * between(10**6)
