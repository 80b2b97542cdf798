# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Files that a scene names go with its recorded run: it is repeated without them."""

from pathlib import Path
import shutil
from typing import Any

import icofabric_sim as ico
from icofabric_sim.bag import BagError
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.parameters import named_files
from icofabric_sim.parameters.named_files import append_files, extract_files, NamedFile
from icofabric_sim.parameters.text import dump_parameters
from icofabric_sim.running.replay.verify import verify_run
from icofabric_sim.scene.scene import check_parameters
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
import numpy as np
import pytest
from recorded_runs import record_run, swing_scene

# A cube of 150 mm sides.
_CORNERS = [(x, y, z) for x in (0, 0.15) for y in (0, 0.15) for z in (0, 0.15)]
_SIDES = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
OBJ = '\n'.join(
    [f'v {x} {y} {z}' for x, y, z in _CORNERS]
    + ['f ' + ' '.join(map(str, side)) for side in _SIDES]) + '\n'


@pytest.fixture
def named(tmp_path: Path) -> dict[str, Any]:
    """Parameters that name a file of every kind, relative ones beside absolute ones."""
    folder = tmp_path / 'named'
    folder.mkdir()
    for name, text in {
            'law.csv': '0.02, 0\n0.03, 0\n0.034, 1.5\n0.04, 9\n',
            'push.csv': '0, 0\n0.05, 1\n0.2, 0\n',
            'way.csv': '0, 0, 0, 0\n0.1, 0, 0, 0.002\n0.4, 0, 0, 0\n',
            'cube.obj': OBJ}.items():
        (folder / name).write_text(text, encoding='utf-8')
    return {
        'connector.law': str(folder / 'law.csv'), 'weave.region': str(folder / 'cube.obj'),
        'loads.tip.profile': f'table {folder / "push.csv"}', 'loads.tip.force': [0.0, 0.4, 0.0],
        'groups.low': 'ids 2', 'drives.shake.group': 'low', 'drives.shake.motion': 'table',
        'drives.shake.file': str(folder / 'way.csv'), 'anchors.hook.body': 4,
        'anchors.hook.edge': 'up', 'anchors.hook.position': [0.05, 0.05, 0.12],
        'anchors.hook.file': str(folder / 'way.csv'), 'solver.method': 'leapfrog',
        'solver.step': 2e-4, 'contact.mode': 'never', 'duration': 0.1}


def verified(path: Path) -> str:
    with RecordedRun(path) as run:
        return verify_run(run).verdict


def test_a_run_is_repeated_without_its_files(tmp_path: Path, named: dict[str, Any]) -> None:
    scene, bag = swing_scene(**named), tmp_path / 'bag'
    assert len(scene.files) == 4
    record_run(bag, scene)
    assert verified(bag) == 'identical'
    folder = tmp_path / 'named'
    for name in ('law.csv', 'push.csv', 'way.csv'):
        (folder / name).write_text('0, 0, 0, 0\n1, 0, 0, 1\n', encoding='utf-8')
    # Other contents, then none: what was recorded counts.
    assert verified(bag) == 'identical'
    shutil.rmtree(folder)
    assert verified(bag) == 'identical'
    with RecordedRun(bag) as run:
        again = run.scene_at(0)
        assert again.files == scene.files
        assert extract_files(run.custom['scene']) == scene.files
        assert np.array_equal(again.position, scene.position)
        # A change of another parameter keeps them.
        check_parameters(again.parameters.with_changes({'connector.damping': 0.1}))
    # The text is still a parameter file, whose names alone do not help.
    (tmp_path / 'scene.yaml').write_text(
        dump_parameters(scene.parameters.complete()), encoding='utf-8')
    with pytest.raises(ValueError, match='there is no file|cannot be read'):
        ico.load_scene(tmp_path / 'scene.yaml')


def test_large_files_are_known_by_their_sum(
    tmp_path: Path, named: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(named_files, 'MAX_RECORDED_BYTES', 10)
    bag = tmp_path / 'bag'
    record_run(bag, swing_scene(**named))
    assert verified(bag) == 'identical'
    law = tmp_path / 'named' / 'law.csv'
    text = law.read_text(encoding='utf-8')
    law.write_text(text + '0.05, 20\n', encoding='utf-8')
    with pytest.raises(BagError, match='law.csv.* differs from that of the recorded run: '):
        verified(bag)
    law.unlink()
    with pytest.raises(BagError, match='there is no file .*law.csv'):
        verified(bag)


def test_checkpoints_know_them(tmp_path: Path, named: dict[str, Any]) -> None:
    simulation = ico.compile_scene(swing_scene(**named))
    simulation.advance_to(0.01)
    simulation.checkpoint().save(tmp_path / 'a.checkpoint')
    law = tmp_path / 'named' / 'law.csv'
    law.write_text('0.02, 0\n0.03, 0\n0.034, 2\n0.04, 9\n', encoding='utf-8')
    other = ico.compile_scene(swing_scene(**named))
    loaded = Checkpoint.load(tmp_path / 'a.checkpoint')
    with pytest.raises(ValueError, match='the SHA-256 of .*law.csv'):
        other.restore(loaded)
    shutil.rmtree(tmp_path / 'named')
    again = ico.compile_scene(ico.Scene.from_parameters(loaded.parameters()))
    again.restore(loaded)
    again.advance_to(0.02)
    simulation.advance_to(0.02)
    assert np.array_equal(again.snapshot().position, simulation.snapshot().position)


def test_what_is_damaged_is_said() -> None:
    files = {'a b.csv': NamedFile('', None), 'ü': NamedFile('0' * 64, b'x' * 1000)}
    text = append_files('/**:\n  ros__parameters: {}\n', files)
    with pytest.raises(ValueError, match='damaged: its content does not match'):
        extract_files(text)
    for damage in (lambda t: t.replace('sha256', 'sha'), lambda t: t.replace('# + e', '# + !'),
                   lambda t: t.replace('{"name"', '{name')):
        with pytest.raises(ValueError, match='recorded with the scene is damaged'):
            extract_files(damage(text))
    assert extract_files('/**:\n  ros__parameters: {}\n# + nothing\n') == {}
    plain = append_files('', {'a b.csv': NamedFile('12', None)})
    assert extract_files(plain) == {'a b.csv': NamedFile('12', None)}
