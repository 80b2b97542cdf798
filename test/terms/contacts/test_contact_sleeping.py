# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Pairs that sleep: they are apart as long as they do, and no bit depends on it."""

from contact_scenes import A, crowd
from fabrics import changed
import icofabric_sim as ico
from icofabric_sim import contact
from icofabric_sim.geometry.icosahedron import circumscribed_radius, vertices
from icofabric_sim.kernels.records import Blocks
from icofabric_sim.simulation.contact import broad_phase
from icofabric_sim.simulation.stepping import thread_team
from icofabric_sim.terms.contacts.force import contact_look
from icofabric_sim.terms.contacts.sleeping import AWAKE, go_on
import numpy as np
import pytest

# As other tests compile them.
STICKY = {'contact__damping': 0.5, 'contact__friction': 0.6}
FLOOR = {'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -0.065}
STEPS = {'solver.method': 'leapfrog', 'solver.tolerance': 0.1, 'contact.stiffness': 1e6}


def ends(scene, until, **options):
    """Bits at the end, pairs that touched on the way, and parts of what was listed that slept."""
    simulation, slept, met = ico.compile_scene(scene, **options), [], 0
    for time in np.linspace(0.02, 1.0, 50) * until:
        simulation.advance_to(time)
        contacts = simulation._driver.contact.phase.contacts
        met += simulation.status.contact_count
        if contacts is not None and len(contacts.pairs):
            path = contacts.sleep.path[0] if len(contacts.sleep.blocks.slot) else np.inf
            slept.append(np.mean(path < contacts.sleep.until))
    now = simulation.snapshot()
    bits = [number.tobytes() for number in (
        now.position, now.orientation, now.linear_velocity, now.angular_velocity)]
    return bits, (met, simulation.status.deepest_overlap), slept


@pytest.mark.parametrize('changes, options', [
    ({**STEPS, **FLOOR}, {}), (FLOOR, {}), ({**FLOOR, 'solver.threads': 2}, {}),
    ({**STEPS, **FLOOR, 'solver.threads': 2}, {}), ({**STEPS, 'solver.threads': 2}, {}),
    pytest.param(FLOOR, {'rotation': 'direction_cosines'}, marks=pytest.mark.long)], ids=[
    'leapfrog', 'dop8', 'two threads', 'leapfrog by two', 'free by two', 'direction cosines'])
def test_no_bit_depends_on_what_sleeps(monkeypatch, changes, options):
    monkeypatch.setattr(thread_team, 'BODIES_PER_THREAD', 1)
    scene = changed(crowd(**STICKY), changes)
    slept_bits, met, slept = ends(scene, 0.03, **options)
    monkeypatch.setattr(broad_phase, 'SLOTS_OF_A_PAIR', 0)
    bits, met_then, awake = ends(scene, 0.03, **options)
    assert bits == slept_bits and met == met_then and min(met) > 0
    assert max(slept) > 0.3 and max(awake) == 0.0


@pytest.mark.parametrize('changes', [{}, FLOOR], ids=['free', 'with a floor'])
def test_what_sleeps_is_apart_by_as_much_as_it_may_still_move(changes):
    simulation, seen = ico.compile_scene(changed(crowd(), changes)), 0
    phase = simulation._driver.contact.phase
    for time in np.linspace(0.001, 0.04, 40):
        simulation.advance_to(time)
        contacts = phase.contacts
        if contacts is None or not len(contacts.sleep.blocks.slot):
            continue
        sleep = contacts.sleep
        left = sleep.until - sleep.path[0]
        for p in np.flatnonzero(left > 0.0):
            s, t = contacts.pairs[p]
            place, turned = sleep.position[:, s], sleep.orientation[:, s]
            if t >= 0:
                gap = 0.5 * contact.separation(
                    A, (place, turned), (sleep.position[:, t], sleep.orientation[:, t])).distance
            else:
                plane = contacts.planes[-1 - t]
                gap = np.min((place + points(A, turned)) @ plane[:3]) - plane[3]
            assert gap > left[p]
            seen += 1
    assert seen > 200 and simulation.status.deepest_overlap > 0.0


@pytest.mark.parametrize('changes', [{}, FLOOR], ids=['free', 'with a floor'])
def test_a_look_leaves_out_only_what_is_apart(changes):
    """Also at places that bodies have not come to."""
    simulation, rng, slept = ico.compile_scene(changed(crowd(), changes)), (
        np.random.default_rng(4)), []
    phase, touched = simulation._driver.contact.phase, 0
    for time in np.linspace(0.001, 0.04, 40):
        simulation.advance_to(time)
        contacts, state = phase.contacts, simulation._driver.trajectory.state
        if contacts is None or not len(contacts.sleep.blocks.slot):
            continue
        for shift in (0.0, 1e-4 * A, 1e-2 * A):
            place = state._replace(position=aligned(
                state.position + shift * rng.normal(size=state.position.shape)))
            found = contact_look(contacts, place.position, place.orientation)
            rows = contacts.aside.copy()
            slept.append(np.mean(contacts.sleep.looked == np.inf))
            all_awake = contacts._replace(sleep=contacts.sleep._replace(
                until=np.full(len(contacts.pairs), AWAKE)))
            assert contact_look(all_awake, place.position, place.orientation) == found
            touching = rows[:, 9] > 0.0
            assert (touching == (contacts.aside[:, 9] > 0.0)).all()
            assert (rows[touching] == contacts.aside[touching]).all()
            touched += int(touching.sum())
    assert touched > 50 and max(slept) > 0.3 and min(slept) < 0.3


def points(a, quaternion):
    """Vertices by eq 16, also of what is no rotation."""
    x, y, z, w = quaternion
    matrix = np.array([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)]])
    return vertices(a) @ matrix.T


@pytest.mark.parametrize('size', [1e-6, 1e-2, 1.0, 30.0])
def test_the_path_is_as_long_as_any_way_also_by_numbers_that_are_no_rotations(size):
    simulation, rng = ico.compile_scene(changed(crowd(), FLOOR)), np.random.default_rng(2)
    simulation.advance_to(0.02)
    driver = simulation._driver
    phase, team = driver.contact.phase, driver.trajectory.thread_team.alone()
    sleep, slots = phase.contacts.sleep, phase._layout.slot
    assert isinstance(sleep.blocks, Blocks) and len(sleep.blocks.slot)
    position, orientation = (np.array(rows) for rows in (sleep.position, sleep.orientation))
    anew, tight = 0, 0.0
    for _ in range(200):
        before = [position[:, s, None].T + points(A, orientation[:, s]) for s in slots]
        position = position + size * A * rng.normal(size=position.shape)
        orientation = orientation + size * rng.normal(size=orientation.shape)
        if rng.random() < 0.5:
            orientation /= np.linalg.norm(orientation, axis=0)
        after = [position[:, s, None].T + points(A, orientation[:, s]) for s in slots]
        way = max(np.linalg.norm(a - b, axis=1).max() for a, b in zip(before, after, strict=True))
        start = sleep.path[0]
        path = go_on(sleep, aligned(position), aligned(orientation), team)
        if path == 0.0:
            # It has begun anew: nothing sleeps.
            assert start + way > 500.0 * circumscribed_radius(A) and not (sleep.until > 0.0).any()
            anew += 1
            continue
        assert path - start >= way * (1.0 - 1e-12)
        tight = max(tight, way / (path - start))
    assert anew > 100 if size > 1.0 else tight > 0.4


def test_numbers_that_are_none_wake_all():
    simulation = ico.compile_scene(changed(crowd(), FLOOR))
    simulation.advance_to(0.02)
    driver = simulation._driver
    sleep = driver.contact.phase.contacts.sleep
    position, orientation = aligned(sleep.position), aligned(sleep.orientation)
    sleep.until[:] = 1.0
    for wild in (np.nan, np.inf, 1e200):
        wilder = aligned(position)
        wilder[1, driver.contact.phase._layout.slot[3]] = wild
        for rows in (wilder, position):
            sleep.until[:] = 1.0
            assert go_on(sleep, rows, orientation, driver.trajectory.thread_team.alone()) == 0.0
            assert (sleep.until == 0.0).all()


def aligned(rows):
    """A copy that begins with a cache line."""
    found = broad_phase.aligned_empty(rows.shape)
    found[:] = rows
    return found
