# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a run and of a record, seen and used by a client of viser's protocol."""

from functools import partial
import socket
import threading
import urllib.error
import urllib.request

import icofabric_sim as ico
from icofabric_sim.messages import decode_point_stamped
from icofabric_sim.messages.topics import POSES, STRAIN_CLASSES
from icofabric_sim.parameters.text import dump_parameters
from icofabric_sim.running.replay.player import Player
from icofabric_sim.running.replay.report import ReplayReport
from icofabric_sim.running.replay.source import ReplaySource
from icofabric_sim.viewer import flow
from icofabric_sim.viewer.local import ReplayActions, SightSink
from icofabric_sim.viewer.page import Page
from icofabric_sim.viewer.panel import _as_code
from icofabric_sim.viewer.sight import Sight
import numpy as np
from page_client import PageClient
import pytest
from recorded_runs import record_run
from runner_helpers import SCENE
from shown_page import Shown
from websockets.exceptions import InvalidStatus


@pytest.fixture(scope='module')
def shown():
    with Shown(start_paused=True) as found:
        yield found


@pytest.fixture
def client(shown):
    with PageClient(shown.port) as found:
        yield found


def test_bodies_are_where_the_poses_say(shown, client):
    client.wait_for(lambda: client.shells() is not None, 'no shells')
    expected = shown.runner.post(
        lambda: shown.runner.simulation.snapshot().position.copy()).result(60.0)
    client.wait_for(
        lambda: np.allclose(client.shells(), expected, atol=1e-6), 'shells are elsewhere')
    node = client.nodes['/shells']
    assert len(np.frombuffer(node['vertices'], np.float32)) == 3 * 12
    assert len(np.frombuffer(node['faces'], np.uint32)) == 3 * 20 and node['flat_shading']
    # At rest all connectors are of the middle class.
    lines = client.wait_for(lambda: client.nodes.get('/connectors/2'), 'no connectors')
    assert len(np.frombuffer(lines['points'], np.float32)) == (
        6 * shown.runner.simulation.scene.connector_count)
    for item in STRAIN_CLASSES:
        assert client.shown(item.name)


def test_drag_becomes_a_pull_that_moves_the_fabric_and_ends(shown, client):
    client.wait_for(lambda: client.shells() is not None, 'no shells')
    shown.runner.set_paused(False).result(60.0)
    before = shown.position(1)
    grasp = before + [0.01, 0.0, 0.0]
    client.drag('start', 1, grasp, grasp)
    client.drag('update', 1, grasp, grasp + [0.0, 0.0, 0.3])
    client.wait_for(lambda: shown.position(1)[2] > before[2] + 0.05, 'the shell stays')
    assert client.wait_for(lambda: client.nodes.get('/pull'), 'no line of the pull')
    # The point that was grasped stays under the mouse: its offset goes with the target.
    targets = [
        decode_point_stamped(data) for topic, _, data in shown.inputs.messages
        if topic == '~/pull']
    assert targets[-1].frame_id == 'icosahedron_1'
    assert targets[-1].point == pytest.approx(before + [0.0, 0.0, 0.3], abs=0.02)
    client.drag('end', 1, grasp, grasp)
    client.wait_for(
        lambda: not shown.runner.simulation.inputs.pulls.bodies, 'the shell is not let go')
    shown.runner.set_paused(True).result(60.0)


def test_page_that_closes_lets_go(shown):
    with PageClient(shown.port) as client:
        client.wait_for(lambda: client.shells() is not None, 'no shells')
        client.drag('start', 2, shown.position(2), shown.position(2))
        client.wait_for(lambda: shown.runner.simulation.inputs.pulls.bodies == [2], 'no pull')
    client.wait_for(lambda: not shown.runner.simulation.inputs.pulls.bodies, 'held for ever')


def test_page_that_stops_answering_lets_go_and_pulls_again_when_the_mouse_moves(
        shown, client, monkeypatch):
    def pulled():
        return shown.runner.simulation.inputs.pulls.bodies

    client.wait_for(lambda: client.shells() is not None, 'no shells')
    place = shown.position(1)
    client.drag('start', 1, place, place)
    client.wait_for(lambda: pulled() == [1], 'no pull')
    # A mouse that is held still sends nothing, but the page answers, also of a paused fabric.
    reader = next(iter(shown.page._flow._readers.values()))
    answered = reader.come
    client.wait_for(lambda: reader.come > answered + 20, 'nothing to answer')
    monkeypatch.setattr(flow, '_SILENCE_S', 0.5)
    client.draws = False
    client.wait_for(lambda: not pulled(), 'a silent page holds on')
    shown.page.grip.repeat()
    assert not shown.page.grip.lines(np.zeros((4, 7))).size
    client.draws = True
    client.drag('update', 1, place, place)
    client.wait_for(lambda: pulled() == [1], 'the mouse does not pull again')
    client.drag('end', 1, place, place)
    client.wait_for(lambda: not pulled(), 'held for ever')


def test_a_silent_page_slows_no_other(shown, client):
    client.wait_for(lambda: client.shells() is not None, 'no shells')
    shown.runner.set_paused(False).result(60.0)
    with PageClient(shown.port) as silent:
        silent.wait_for(lambda: silent.shells() is not None, 'no shells')
        silent.draws = False
        client.wait_for(lambda: silent.frames > 1, 'no frames')
        before = silent.frames, client.frames
        client.wait_for(lambda: client.frames > before[1] + 40, 'no frames')
        # Of these, those that may be under way to it, and one in 3 s.
        assert silent.frames - before[0] < 20
    shown.runner.set_paused(True).result(60.0)


def test_slider_changes_a_parameter_and_a_refusal_is_said(shown, client):
    client.set('Stiffness [N/m]', 350.0)
    client.wait_for(
        lambda: shown.runner.parameters['connector.stiffness'] == 350.0, 'stiffness stays')
    client.wait_for(lambda: client.shown('connector.stiffness is set'), 'no answer')
    client.set('weave.size', [0.0, 1.0, 1.0])
    words = client.wait_for(lambda: client.notices[-1:] or None, 'no refusal')
    assert 'weave.size' in words[0]
    client.wait_for(lambda: client.shown('**refused:**'), 'the refusal is not shown')
    in_force = shown.runner.parameters['weave.size']
    client.wait_for(
        lambda: list(client.controls[client.control('weave.size')]['value']) == in_force or (
            shown.runner.parameters['weave.size'] != in_force), 'the control is not set back')


def test_buttons(shown, client):
    client.wait_for(lambda: client.shells() is not None, 'no shells')
    for label, answer in (
            ('Advance', 'advanced'), ('Step', 'solver steps taken'),
            ('Reset', 'reset to the initial state'),
            ('Start recording', 'recording is not available')):
        client.press(label)
        client.wait_for(partial(client.shown, answer), answer)


def test_section_hides_what_lies_beyond(shown):
    stage = shown.page.stage
    stage.section.set('z', 0.5)
    points = np.array([[0.0, 0.0, 0.4], [0.0, 0.0, 0.6]])
    assert stage.section.shows(points).tolist() == [True, False]
    stage.section.set('off', 0.0)
    assert stage.section.shows(points).all()


def test_the_slider_of_the_cut_spans_the_fabric(shown, client):
    position = shown.runner.simulation.scene.position
    slider = client.controls[client.control('Clip plane position [m]')]
    client.wait_for(lambda: slider['max'] < 1.0, 'it does not span the fabric')
    assert slider['min'] < position.min() < position.max() < slider['max']


def test_other_pages_are_refused_at_the_socket(shown):
    with pytest.raises(InvalidStatus) as refused:
        PageClient(shown.port, additional_headers={'Origin': 'http://evil.example'})
    assert refused.value.response.status_code == 403
    own = f'http://localhost:{shown.port}'
    with PageClient(shown.port, additional_headers={'Origin': own}):
        pass
    for headers in ({'Host': f'evil.example:{shown.port}'}, {'Origin': 'http://evil.example'}):
        with pytest.raises(urllib.error.HTTPError, match='403'):
            urllib.request.urlopen(urllib.request.Request(own, headers=headers), timeout=60.0)
    tunnel = {'Host': 'localhost:28106', 'Origin': 'http://localhost:28106'}
    for request in (own, urllib.request.Request(own, headers=tunnel)):
        with urllib.request.urlopen(request, timeout=60.0) as page:
            assert b'<html' in page.read().lower()
    assert shown.page.address == f'{own}/'


def test_no_page_can_open_it_to_the_world(shown, client, monkeypatch):
    asked = []
    monkeypatch.setattr(
        type(shown.page.server), 'request_share_url', lambda *words, **more: asked.append(words))
    client.send('ShareUrlRequest')
    client.set('Clip plane position [m]', 0.7)
    client.wait_for(lambda: shown.page.stage.section.place == 0.7, 'later messages are heard')
    assert not asked


def test_read_only_page_changes_nothing():
    with Shown(read_only=True, start_paused=True) as shown, PageClient(shown.port) as client:
        client.wait_for(lambda: client.shells() is not None, 'no shells')
        client.wait_for(lambda: client.shown('Read only'), 'it does not say so')
        client.drag('start', 1, (0.0, 0.0, 0.0), (0.0, 0.0, 0.3))
        labels = {item.get('label') for item in client.controls.values()}
        assert not labels & {'Motion', 'Stiffness [N/m]', 'Bag'} and 'Clip plane normal' in labels
        assert not shown.inputs.messages and shown.page.grip is None


def test_record_is_shown_and_scrubbed(tmp_path):
    scene = ico.Scene.from_parameters(SCENE)
    record_run(tmp_path / 'bag', scene)
    sight = Sight()
    with ReplaySource(tmp_path / 'bag') as source:
        player = Player(source, SightSink(sight), stay=True, paused=True)
        page = Page(sight, ReplayActions(player), port=18080)
        thread = threading.Thread(target=player.run, daemon=True)
        thread.start()
        try:
            with PageClient(page.server.get_port()) as client:
                client.wait_for(lambda: client.shells() is not None, 'no shells')
                client.set('Time [s]', 0.05)
                client.wait_for(lambda: player.now == 50_000_000, 'not there')
                client.set('Time [s]', 9.0)
                client.wait_for(lambda: client.notices, 'no refusal')
                client.set('Rate', 4.0)
                client.wait_for(lambda: player.rate == 4.0, 'the rate stays')
                client.set('Loop', True)
                client.wait_for(lambda: player.loop, 'no loop')
        finally:
            page.close()
            player.stop()
            thread.join(60.0)


def test_the_slider_of_a_record_goes_with_its_time_and_a_record_goes_on_as_a_run(tmp_path):
    record_run(tmp_path / 'bag', ico.Scene.from_parameters(SCENE))
    sight = Sight()
    with ReplaySource(tmp_path / 'bag') as source:
        report = ReplayReport('/icofabric', source)
        player = Player(
            source, SightSink(sight), stay=True, report=report.message)
        actions = ReplayActions(player)
        page = Page(sight, actions, port=18080)
        thread = threading.Thread(target=player.run, daemon=True)
        thread.start()
        try:
            with PageClient(page.port) as client:
                client.wait_for(lambda: client.shells() is not None, 'no shells')
                end = source.end * 1e-9
                client.wait_for(lambda: sight.span == (0.0, end), 'the span is not known')
                # It was played to its end.
                client.wait_for(
                    lambda: client.controls[client.control('Time [s]')]['value'] == end,
                    'the slider stays')
                assert client.controls[client.control('Time [s]')]['max'] == end
                client.press('Pause')
                client.wait_for(lambda: player.paused, 'it goes on')
                client.set('Time [s]', 0.05)
                client.wait_for(lambda: player.now == 50_000_000, 'not there')
                client.press('Simulate from here')
                client.wait_for(lambda: actions.continued_run is not None, 'it does not go on')
                client.wait_for(partial(client.shown, 'continues as a simulation'), 'no answer')
        finally:
            page.close()
            player.stop()
            thread.join(60.0)
    simulation, parameters = actions.continued_run
    # The state of the recorded run at that moment, to the last bit.
    again = ico.compile_scene(ico.Scene.from_parameters(SCENE))
    again.advance_to(0.05)
    assert simulation.time == 0.05
    assert (simulation.snapshot().position == again.snapshot().position).all()
    assert parameters['record.path'] == '' and parameters['duration'] == 0.0


def test_plots_have_the_displacements_of_groups(shown, client):
    client.wait_for(lambda: client.shells() is not None, 'no shells')
    shown.runner.set_paused(False).result(60.0)
    place = shown.position(1)
    client.drag('start', 1, place, place)
    client.drag('update', 1, place, place + [0.0, 0.0, 0.3])
    client.wait_for(
        lambda: shown.sight.curves and shown.sight.curves[-1].displacement > 0.01, 'no curves')
    client.drag('end', 1, place, place)
    shown.runner.set_paused(True).result(60.0)
    groups = shown.sight.fabric.groups
    assert groups
    last = shown.sight.curves[-1]
    assert len(last.groups) == len(groups)
    # The middle of a group has gone no farther than the body that has gone farthest.
    # The two are rounded apart where a group is one body.
    assert 0.0 < max(last.groups) <= last.displacement * (1.0 + 1e-12)
    handle, _ = shown.page.panel._plots[-1]
    client.wait_for(lambda: len(handle.data) == 2 + len(groups), 'the groups are not drawn')
    assert [line.get('label') for line in handle.series] == [
        't [s]', 'largest', *(f'of {name}' for name in groups)]


def test_rates_change_no_fabric_and_what_is_woven_does(shown):
    sight = Sight()
    for changes, number in (
            ({}, 1), ({'real_time_factor': 3.0}, 1), ({'publish_rate': 30.0}, 1),
            ({'weave.size': [3, 3, 2]}, 2)):
        parameters = shown.runner.parameters.with_changes(changes)
        sight._take_weave(dump_parameters(parameters.complete()))
        assert sight.fabric_number == number
        for name, value in changes.items():
            assert sight.fabric.parameters[name] == value


def test_a_page_closes_without_the_answers_of_those_who_are_connected(capfd):
    page = Page(Sight(), None, port=18080)
    with socket.create_connection(('127.0.0.1', page.port)), PageClient(page.port) as client:
        handlers = page._guard._serving.server.handlers
        client.wait_for(lambda: len(handlers) == 2, 'they are not connected')
        server = page.server._websock_server._server_thread
        page.close()
        # viser waits for 5 s, and websockets for 10 s.
        assert not server.is_alive() and not handlers
    assert not capfd.readouterr().err


@pytest.mark.parametrize('host', ['192.0.2.1', 'no such name'])
def test_a_host_of_elsewhere_is_refused_and_not_waited_for(host):
    with pytest.raises(ValueError, match='not an address of this machine'):
        Page(Sight(), None, host=host)


def test_words_from_elsewhere_are_no_markup():
    assert _as_code('<img src=x onerror=alert(1)>\n\n`b` ') == "`<img src=x onerror=alert(1)> 'b'`"
    assert _as_code('') == '`-`'


def test_malformed_message_is_left_out(caplog):
    sight = Sight()
    SightSink(sight).send(POSES, 0, b'\0\1\0\0')
    with pytest.raises(ValueError, match='PoseArray'):
        sight.poses()
