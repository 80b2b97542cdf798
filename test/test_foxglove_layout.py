# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The Foxglove layout in config/: panels that are there, topics that the node publishes."""
import json
from pathlib import Path
import re

from icofabric_sim.messages import (
    decode_diagnostic_array,
    Float64MultiArrayBytes,
    MarkerBytes,
    PoseArrayBytes,
)
from icofabric_sim.messages.topics import (
    CONNECTORS,
    DIAGNOSTICS,
    ENERGIES,
    ICOSAHEDRA,
    POSES,
    TOPICS,
)
from icofabric_sim.parameters.table import BY_NAME
from icofabric_sim.running.diagnostics import HealthReport
import pytest
from runner_helpers import make_runner

PATH = Path(__file__).resolve().parents[1] / 'config' / 'icofabric.foxglove.json'
# What the panels of the layout can show.
SHOWN = {
    '3D': {PoseArrayBytes.TYPE, MarkerBytes.TYPE},
    'Plot': {Float64MultiArrayBytes.TYPE},
    'DiagnosticSummary': {DIAGNOSTICS.type},
    'DiagnosticStatusPanel': {DIAGNOSTICS.type},
}
TYPES = {topic.name.replace('~', '/icofabric'): topic.type for topic in TOPICS}


@pytest.fixture(scope='module')
def layout():
    return json.loads(PATH.read_text(encoding='utf-8'))


def leaves(node):
    """Panels of a part of the window, each of which is halved or holds one."""
    if isinstance(node, str):
        return [node]
    assert node['direction'] in ('row', 'column') and 0 < node['splitPercentage'] < 100
    assert set(node) == {'direction', 'splitPercentage', 'first', 'second'}
    return leaves(node['first']) + leaves(node['second'])


def topics_of(panel, config):
    if panel == '3D':
        return list(config['topics'])
    if panel == 'Plot':
        return [path['value'].partition('.')[0] for path in config['paths']]
    return [config['topicToRender']]


def test_every_panel_has_its_place_and_its_settings(layout):
    assert set(layout) == {
        'configById', 'globalVariables', 'userNodes', 'playbackConfig', 'layout'}
    panels = leaves(layout['layout'])
    assert sorted(panels) == sorted(layout['configById'])
    assert {panel.partition('!')[0] for panel in panels} == set(SHOWN)


def test_topics_are_published_with_a_type_that_the_panel_shows(layout):
    seen = set()
    for name, config in layout['configById'].items():
        panel = name.partition('!')[0]
        for topic in topics_of(panel, config):
            assert TYPES[topic] in SHOWN[panel]
            seen.add(topic)
    assert seen >= {
        topic.name.replace('~', '/icofabric')
        for topic in (POSES, CONNECTORS, ICOSAHEDRA, DIAGNOSTICS)}


def test_the_scene_is_followed_in_the_frame_of_the_messages(layout):
    config = layout['configById']['3D!fabric']
    frame = BY_NAME['frame_id'].default
    assert config['followTf'] == frame
    assert all(topic['visible'] for topic in config['topics'].values())
    assert all(layer['frameId'] == frame for layer in config['layers'].values())


def test_every_energy_is_plotted_under_its_name(layout):
    plotted = {}
    for name, config in layout['configById'].items():
        if name.startswith('Plot!'):
            for path in config['paths']:
                [number] = re.findall(r'^/icofabric/energy\.data\[(\d)\]$', path['value'])
                plotted[int(number)] = path['label']
                assert path['enabled'] and re.fullmatch('#[0-9a-f]{6}', path['color'])
    assert plotted == dict(enumerate(ENERGIES))


def test_the_diagnostics_shown_are_those_of_the_node(layout):
    config = layout['configById']['DiagnosticStatusPanel!figures']
    runner = make_runner()
    _, [status] = decode_diagnostic_array(HealthReport('/icofabric').bytes(runner.status()))
    assert status.hardware_id == config['selectedHardwareId']
