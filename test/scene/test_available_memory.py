# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What is left of the memory, and weaves that are refused because they would not fit."""
import icofabric_sim as ico
from icofabric_sim.parameters.validation import make_parameters
from icofabric_sim.scene import scene as module
from icofabric_sim.scene.available_memory import available_memory, share_among
from icofabric_sim.scene.scene import BYTES_PER_BODY, check_parameters
import pytest

MEMINFO = 'MemTotal:       24684096 kB\nMemFree:        1000 kB\nMemAvailable:   2000000 kB\n'


def write(root, files):
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


GROUP_2 = {
    'sys/fs/cgroup/memory.max': '1000000\n', 'sys/fs/cgroup/memory.current': '700000\n',
    'sys/fs/cgroup/memory.stat': 'anon 500000\ninactive_file 50000\n'}
GROUP_1 = {
    'sys/fs/cgroup/memory/memory.limit_in_bytes': '9000\n',
    'sys/fs/cgroup/memory/memory.usage_in_bytes': '10000\n',
    'sys/fs/cgroup/memory/memory.stat': 'total_inactive_file 0\n'}


@pytest.mark.parametrize(('files', 'expected'), [
    ({}, 2_000_000 * 1024),
    (GROUP_2, 350_000),
    ({**GROUP_2, 'sys/fs/cgroup/memory.max': 'max\n'}, 2_000_000 * 1024),
    (GROUP_1, 0),
    ({**GROUP_1, 'sys/fs/cgroup/memory/memory.limit_in_bytes': '9223372036854771712\n'},
     2_000_000 * 1024),
])
def test_least_of_machine_and_container(tmp_path, files, expected):
    assert available_memory(write(tmp_path, {'proc/meminfo': MEMINFO, **files})) == expected


def test_this_machine():
    assert 2**20 < available_memory() < 2**50


@pytest.fixture
def little(monkeypatch):
    """100 MB are free, and building anything would be a fault."""
    def never(**choices):
        raise AssertionError('built')

    monkeypatch.setattr(module, 'available_memory', lambda: 100_000_000)
    monkeypatch.setattr(module, 'build_weave', never)


@pytest.mark.parametrize(('name', 'value', 'bodies'), [
    ('weave.size', [60, 60, 60], '108,000'), ('weave.box', [2.0, 2.0, 2.0], None)])
def test_weave_beyond_the_memory_is_refused_before_it_is_built(little, name, value, bodies):
    with pytest.raises(ico.ParameterError, match='GiB') as caught:
        ico.Scene.from_parameters({name: value})
    text = str(caught.value)
    assert text.startswith(f'{name} {value} means ') and '0.0931 GiB are free' in text
    if bodies is not None:
        assert f'{bodies} bodies' in text
        assert f'{108_000 * BYTES_PER_BODY / 2**30:.3g} GiB' in text


def test_of_a_fabric_that_is_shared_a_process_needs_its_part(little):
    before = share_among(100)
    try:
        check_parameters(make_parameters({'weave.size': [80, 80, 80]}))
        with pytest.raises(ico.ParameterError, match='on the first of 100 ranks.* more ranks'):
            check_parameters(make_parameters({'weave.size': [160, 160, 160]}))
    finally:
        assert share_among(before) == 100
    with pytest.raises(ico.ParameterError, match='GiB'):
        check_parameters(make_parameters({'weave.size': [80, 80, 80]}))


def test_small_scenes_need_no_look(monkeypatch):
    def never():
        raise AssertionError('looked')

    monkeypatch.setattr(module, 'available_memory', never)
    check_parameters(make_parameters({'weave.size': [20, 20, 20]}))


@pytest.mark.parametrize('size', [[1260, 1260, 1260], [10**9, 10**9, 10**9], [2**62, 1, 1]])
def test_billions_of_bodies_are_refused_at_once(size):
    with pytest.raises(ValueError, match='weave.size'):
        ico.Scene.from_parameters({'weave.size': size})
