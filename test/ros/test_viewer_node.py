# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The viewer beside a node: what it sends, and what comes of a drag, a slider and a button."""

import sys

import pytest

pytest.importorskip('viser', reason='viser (extra `viewer`) is not installed')

import icofabric_sim as ico  # noqa: E402, I100 - after what skips
from page_client import PageClient  # noqa: E402 - needs viser
from recorded_runs import record_run  # noqa: E402 - after what skips
from ros_helpers import NodeProcess, wait_for  # noqa: E402 - needs rclpy

SCENE = {
    'weave': {'size': [2, 2, 2]},
    'connector': {'stiffness': 200.0},
    'contact': {'mode': 'never'},
}


class ViewerProcess(NodeProcess):
    MODULE = 'icofabric_sim.ros.viewer_node'
    READY = ' is shown at '


class ReplayProcess(NodeProcess):
    MODULE = 'icofabric_sim.ros.replay_node'
    READY = ': playing '


@pytest.fixture(scope='module')
def viewer(node, folder):
    with ViewerProcess(folder / 'viewer_log', parameters={'port': 18300}) as process:
        yield process
        assert process.stop() == 0


@pytest.fixture
def page(viewer):
    address = wait_for(
        lambda: viewer.lines(' is shown at '), 'no page', node=viewer)[-1].split()[-1]
    with PageClient(int(address.rstrip('/').rpartition(':')[2])) as client:
        yield client


def test_drag_moves_the_fabric_of_the_node(page, graph):
    page.wait_for(lambda: page.shells() is not None, 'no shells')
    graph.listen('~/poses')
    before = page.shells()[1].copy()
    page.drag('start', 1, before, before)
    page.drag('update', 1, before, before + [0.0, 0.0, 0.3])
    page.wait_for(lambda: page.shells()[1, 2] > before[2] + 0.05, 'the shell stays')
    graph.next('~/poses', lambda message: message.values[1, 2] > before[2] + 0.05)
    page.drag('end', 1, before, before)


def test_slider_button_and_refusal(page, graph):
    page.set('Stiffness [N/m]', 350.0)
    page.wait_for(lambda: page.shown('connector.stiffness is set'), 'no answer')
    assert graph.get('connector.stiffness') == [350.0]
    page.set('weave.size', [0.0, 1.0, 1.0])
    page.wait_for(lambda: page.shown('weave.size must be at least 1'), 'no refusal')
    page.press('Pause')
    page.wait_for(lambda: page.shown('paused, t = '), 'no answer of the button')
    page.press('Start recording')
    page.wait_for(lambda: page.shown('record.path is empty'), 'no refusal of the button')


def test_replay_is_known_as_one(tmp_path):
    record_run(tmp_path / 'bag', ico.Scene.from_parameters({**SCENE, 'duration': 0.1}))
    replay = ReplayProcess(tmp_path / 'log', offset=1, parameters={
        'bag': tmp_path / 'bag', 'fabric': '/icofabric', 'start_paused': True, 'stay': True})
    with replay, ViewerProcess(
            tmp_path / 'viewer_log', offset=1, parameters={'port': 18400}) as process:
        # Where the replay is found late, there is another page before.
        found = wait_for(
            lambda: process.lines('a replay of /icofabric is shown at '), 'page', node=process)
        port = int(found[-1].split()[-1].rstrip('/').rpartition(':')[2])
        with PageClient(port) as page:
            page.wait_for(lambda: page.shells() is not None, 'no shells')
            assert page.button('Simulate from here')
        assert process.stop() == 0
        assert replay.stop() == 0


@pytest.mark.parametrize('name', ['/', 'a b'])
def test_wrong_fabric_is_one_line(tmp_path, name):
    with ViewerProcess(tmp_path / 'wrong', parameters={'fabric': f"'{name}'"}) as process:
        assert process.wait() == 2
        assert 'viewer_node: fabric must be the full name of a node' in process.log()


def test_wrong_port_is_one_line(viewer, folder):
    with ViewerProcess(folder / 'wrong', parameters={'port': 70000}) as process:
        assert process.wait() == 2
        assert 'viewer_node: port must lie in 0 to 65535, got 70000' in process.log()


def test_without_the_extra_one_line_names_it(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'viser', None)
    from icofabric_sim.commands.main import main
    assert main(['view', 'hanging_slab']) == 2
    assert "pip install 'viser>=1.1,<1.2'" in capsys.readouterr().err
