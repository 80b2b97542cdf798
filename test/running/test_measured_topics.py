# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Topics of a test rig: for a listener only; a live run waits until their kernels are ready."""

import json
import threading
import time

import icofabric_sim as ico
from icofabric_sim.bag import BagReader, BagRecorder
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.kernels.runtime import kernel_guard
from icofabric_sim.messages import decode_float64_multi_array
from icofabric_sim.messages.topics import CONTACTS, Outputs, POSES, REACTIONS, TENSIONS
from icofabric_sim.pictures.render import RunMoments
from icofabric_sim.process.compile_notice import KernelsMissing
from icofabric_sim.running import broadcast as broadcast_module
from icofabric_sim.running.broadcast import Broadcast
from icofabric_sim.running.diagnostics import HealthReport
from icofabric_sim.running.recording import BagSink, GIVEN, summarise_run
from icofabric_sim.running.replay.verify import verify_run
from icofabric_sim.running.runner import Runner
from icofabric_sim.simulation.simulation import Simulation
import numpy as np
import pytest
from runner_helpers import Beside, ListSink

MEASURED = {REACTIONS: 'reactions', TENSIONS: 'tensions', CONTACTS: 'contacts'}


STACK = {
    'weave.size': [1, 1, 1], 'contact.stiffness': 1e4, 'contact.friction': 0.5,
    'bodies.it.position': [0.0, 0.0, 0.0323], 'bodies.it.angular_velocity': [0.0, 9.0, 1.0],
    'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -0.0161}


def test_contacts_are_told_with_force_and_torques():
    scene = ico.Scene.from_parameters(STACK)
    simulation = ico.compile_scene(scene)
    simulation.advance_to(1e-4)
    found = simulation.contacts()
    message = decode_float64_multi_array(Outputs(scene).contacts(found))
    rows = message.values
    assert rows.shape == (2, 15) and found.table()['second'] == [1, 'planes.floor']
    assert message.labels[1].endswith('torque on first, torque on second')
    assert (rows[:, 9:12] == found.wrench_on_first[:, 3:]).all()
    assert (rows[:, 12:] == found.wrench_on_second[:, 3:]).all()
    # About the middle of the two centres the forces of a pair turn nothing but by its moment.
    place = simulation.snapshot().position
    apart = np.cross(place[0] - place[1], rows[0, 5:8])
    turned = rows[0, 9:12] + rows[0, 12:] + apart
    assert np.abs(rows[0, 9:12]).max() > 0.0
    assert np.abs(turned).max() < 1e-12 * np.abs(rows[0, 5:8]).max()


@pytest.mark.parametrize('live', [False, True])
def test_they_are_built_for_a_listener_only(live, monkeypatch):
    simulation, asked = ico.compile_scene(ico.load_scene('hanging_slab')), []
    for name in MEASURED.values():
        measure = getattr(simulation, name)
        monkeypatch.setattr(
            simulation, name, lambda measure=measure, name=name: asked.append(name) or measure())
    sink = ListSink(POSES)
    broadcast = Broadcast([sink], simulation, (lambda: b'') if live else None)
    broadcast.emit(0)
    assert sink.messages and not asked
    sink.topics = tuple(MEASURED)
    sink.messages.clear()
    deadline = time.monotonic() + 300.0
    while set(asked) != set(MEASURED.values()) and time.monotonic() < deadline:
        broadcast.emit(0)
        time.sleep(0.01 if live else 0.0)
    assert set(asked) == set(MEASURED.values())
    sent = {topic: data for topic, _, data in sink.messages}
    assert (decode_float64_multi_array(sent[REACTIONS]).values[:, :3]
            == simulation.reactions().force).all()
    assert decode_float64_multi_array(sent[TENSIONS]).values.shape == (
        simulation.scene.connector_count, 2)


def test_a_bag_holds_them_where_asked_and_verify_compares_them(tmp_path):
    path = tmp_path / 'bag'
    simulation = ico.compile_scene(ico.load_scene('hanging_slab').with_changes({
        'record.path': str(path), 'record.measured': True, 'duration': 0.05,
        'real_time_factor': 0.0}))
    bag = BagSink(path, simulation, live=False)
    runner = Runner(simulation, [bag])
    runner.run(until_finished=True)
    bag.close(summary=summarise_run(runner.status()))
    with RecordedRun(path, '/icofabric') as run:
        counts = {topic: len(run.times_of(topic.name)) for topic in MEASURED}
        assert counts == dict.fromkeys(MEASURED, 4)
        report = verify_run(run)
    assert report.verdict == 'identical', report.lines()


def test_pictures_of_a_bag_have_the_forces_of_its_contacts(tmp_path):
    path = tmp_path / 'bag'
    simulation = ico.compile_scene(ico.Scene.from_parameters(STACK | {
        'record.path': str(path), 'record.measured': True, 'duration': 1e-4,
        'publish_rate': 1e4, 'real_time_factor': 0.0}))
    bag = BagSink(path, simulation, live=False)
    runner = Runner(simulation, [bag])
    runner.run(until_finished=True)
    bag.close(summary=summarise_run(runner.status()))
    with RecordedRun(path, '/icofabric') as run:
        *_, moment = RunMoments(run).at(run.pose_times(), with_contacts=True)
        *_, without = RunMoments(run).at(run.pose_times())
    contacts = simulation.contacts()
    # On the first of two shells, on that which stands on the floor, and on the second.
    assert moment.time == simulation.time and without.contact_forces is None
    np.testing.assert_array_equal(
        moment.contact_forces[:, 1], [*contacts.force, -contacts.force[0]])
    np.testing.assert_array_equal(
        moment.contact_forces[:, 0], [*contacts.point, contacts.point[0]])
    assert np.abs(contacts.force).max() > 0.1


class Cells:
    """Kernels that are missing until the test makes them ready."""

    ready = threading.Event()
    asked = 0

    def __init__(self, simulation):
        Cells.asked += 1
        self.seconds = 3.2

    @property
    def are_ready(self):
        return self.ready.is_set()


@pytest.fixture
def awaited(tmp_path, monkeypatch):
    """A live runner with a bag, whose measuring kernels are missing; every re-weave lacks them."""
    loaded, measure = [], Simulation.reactions

    def reactions(self):
        if kernel_guard._guard.forbids and self not in loaded:
            raise KernelsMissing
        loaded.append(self)
        return measure(self)

    monkeypatch.setattr(Simulation, 'reactions', reactions)
    monkeypatch.setattr(broadcast_module, 'LoadCellKernels', Cells)
    Cells.ready.clear()
    Cells.asked = 0
    path = tmp_path / 'bag'
    simulation = ico.compile_scene(ico.load_scene('hanging_slab').with_changes({
        'record.path': str(path), 'record.measured': True, 'duration': 0.2,
        'real_time_factor': 0.0}))
    report, bag = HealthReport('/icofabric'), BagSink(path, simulation, live=True)
    sink = ListSink(POSES)
    return Runner(
        simulation, [bag, sink], report=lambda status: report.bytes(status)), bag, sink


def counts(path):
    with RecordedRun(path, '/icofabric') as run:
        return {topic: len(run.times_of(topic.name)) for topic in (POSES, *MEASURED)}


def closed(runner, bag):
    bag.close(summary=summarise_run(runner.status()))
    with RecordedRun(bag.path, '/icofabric') as run:
        return verify_run(run)


def test_a_live_run_waits_for_the_kernels_and_its_bag_holds_every_output(awaited, caplog):
    runner, bag, sink = awaited
    caplog.set_level('INFO', 'icofabric_sim')
    with Beside(runner) as beside:
        beside.wait_for(lambda: runner.status().waits)
        assert runner.status().waits == 'compiling kernels of measured forces, for 3 s so far'
        # Who listens to poses alone gets them, and services answer.
        beside.wait_for(lambda: sink.messages)
        assert runner.set_paused(True).result(60.0) == 0
        advance = runner.advance()
        beside.wait_for(lambda: 'reactions and contacts are not ready yet' in caplog.text)
        assert not advance.done() and runner.now == 0
        Cells.ready.set()
        assert advance.result(60.0) == 10_000_000
        Cells.ready.clear()
        changed = runner.change(runner.parameters.with_changes({'connector.stiffness': 700.0}))
        changed.result(60.0)
        beside.wait_for(lambda: Cells.asked == 2)
        # A reset comes in place of what is owed, and what it shows is owed as well.
        runner.reset(time_reset=False).result(60.0)
        advance = runner.advance()
        runner.post(lambda: None).result(60.0)
        assert not advance.done() and runner.now == 10_000_000
        Cells.ready.set()
        assert advance.result(60.0) == 20_000_000
        runner.set_paused(False).result(60.0)
        beside.wait_for(lambda: runner.finished)
    report = closed(runner, bag)
    assert report.verdict == 'identical', report.lines()
    # Outputs of 0 to 0.2 s, after each advance, after the reset, whose time another weave shares.
    assert counts(bag.path) == dict.fromkeys((POSES, *MEASURED), 13 + 2 + 1)
    assert Cells.asked == 2


def test_a_run_that_is_stopped_while_it_waits_leaves_no_half_of_an_output(awaited):
    runner, bag, _ = awaited
    with Beside(runner) as beside:
        Cells.ready.set()
        beside.wait_for(lambda: runner.now >= 20_000_000)
        Cells.ready.clear()
        runner.set_paused(True).result(60.0)
        runner.change(
            runner.parameters.with_changes({'connector.stiffness': 700.0})).result(60.0)
        beside.wait_for(lambda: Cells.asked == 2)
    report = closed(runner, bag)
    assert report.verdict == 'identical', report.lines()
    assert len(set(counts(bag.path).values())) == 1


@pytest.mark.parametrize('topic', MEASURED)
def test_verify_misses_what_is_measured(topic, tmp_path):
    path = tmp_path / 'bag'
    simulation = ico.compile_scene(ico.load_scene('hanging_slab').with_changes({
        'record.path': str(path), 'record.measured': True, 'duration': 0.05,
        'real_time_factor': 0.0}))
    bag = BagSink(path, simulation, live=False)
    runner = Runner(simulation, [bag])
    runner.run(until_finished=True)
    bag.close(summary=summarise_run(runner.status()))
    name = topic.name.replace('~', '/icofabric')
    with BagReader(path) as reader:
        types = {name: topic.type_name for name, topic in reader.topics.items()}
        messages = [message for message in reader.messages() if message[0] in types]
        custom = dict(reader.custom)
    lost = [number for number, message in enumerate(messages) if message[0] == name][0]
    given = json.loads(custom[GIVEN])
    given[name] -= 1  # as if it had never been sent
    custom[GIVEN] = json.dumps(given)
    with BagRecorder(tmp_path / 'less', custom=custom) as recorder:
        for other, type_name in types.items():
            if other != '/icofabric/recording':
                recorder.add_topic(other, type_name)
        for message in messages[:lost] + messages[lost + 1:]:
            if message[0] != '/icofabric/recording':
                recorder.write(*message)
    with RecordedRun(tmp_path / 'less', '/icofabric') as run:
        report = verify_run(run)
    assert report.verdict == 'incomplete', report.lines()
    assert [(gap.topic, gap.messages, gap.nanoseconds) for gap in report.gaps] == [(name, 1, 0)]
