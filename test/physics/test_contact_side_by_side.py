# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Pairs of shells that are computed side by side have the bits that each has by itself."""

from contact_scenes import A, crowd
from fabrics import changed
import icofabric_sim as ico
from icofabric_sim.terms.contacts.apex import APEX_UNIT
from icofabric_sim.terms.contacts.axis import FACE_OF_FIRST
from icofabric_sim.terms.contacts.force import contact_look
from icofabric_sim.terms.contacts.sleeping import AWAKE
import numpy as np

# As other tests compile it.
STICKY = {'contact__damping': 0.5, 'contact__friction': 0.6}


def test_pairs_have_the_same_bits_in_any_company_and_whatever_was_known():
    simulation = ico.compile_scene(changed(crowd(**STICKY), {
        'solver.method': 'leapfrog', 'solver.tolerance': 0.1, 'contact.stiffness': 1e6}))
    simulation.advance_to(0.02)
    driver, rng = simulation._driver, np.random.default_rng(1)
    phase, state = driver.contact.phase, driver.trajectory.state
    contacts = phase.contacts
    count, seen = len(contacts.pairs), {'edges': 0, 'points': 0, 'others': 0, 'left': 0}
    assert count > 20 and simulation.status.method_name == 'leapfrog'
    for squeezed in np.linspace(1.0, 0.8, 60):
        centre = state.position[:, phase._layout.slot].mean(axis=1, keepdims=True)
        place = centre + squeezed * (state.position - centre)
        place += 0.01 * A * rng.normal(size=place.shape)
        now = state._replace(position=place)
        # As found by what the state before has left, and once more by what that leaves.
        contact_look(contacts, now.position, now.orientation)
        kept = contacts.aside.copy()
        contact_look(contacts, now.position, now.orientation)
        again = contacts.aside.copy()
        # By nothing, and in another order.
        order = rng.permutation(count)
        other = contacts._replace(
            pairs=contacts.pairs[order].copy(), aside=np.zeros_like(contacts.aside),
            sleep=contacts.sleep._replace(
                looked=np.full(count, AWAKE), until=contacts.sleep.until[order].copy()))
        contact_look(other, now.position, now.orientation)
        new = np.empty_like(kept)
        new[order] = other.aside
        touching = new[:, 9] > 0.0
        assert (again[touching] == new[touching]).all() and (kept[:, :12] == new[:, :12]).all()
        assert (kept[touching] == new[touching]).all() and (again[:, :12] == new[:, :12]).all()
        number = new[touching, 19].astype(int)
        apex = number >= APEX_UNIT
        edges = apex & (number % APEX_UNIT < FACE_OF_FIRST)
        seen['edges'] += edges.sum()
        seen['points'] += (apex & ~edges).sum()
        seen['others'] += (~apex & (contacts.pairs[touching, 1] >= 0)).sum()
        # Lanes that are not full.
        seen['left'] += edges.sum() % 8 > 0
    assert min(seen.values()) > 30, seen
