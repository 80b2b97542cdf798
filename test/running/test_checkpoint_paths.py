# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Where a running fabric keeps its checkpoints."""
from icofabric_sim.parameters.validation import make_parameters
from icofabric_sim.running.checkpoint_files import path_to_restore, path_to_save
import pytest


def parameters(**given):
    return make_parameters({name.replace('__', '.'): str(value) for name, value in given.items()})


def test_folder_is_filled_and_nothing_overwritten(tmp_path):
    chosen = parameters(checkpoint__path=tmp_path / 'a' / 'b')
    for number in (1, 2):
        path = path_to_save(chosen)
        assert path == tmp_path / 'a' / 'b' / f'{number}.checkpoint'
        path.write_bytes(b'')
    assert path_to_restore(chosen) == tmp_path / 'a' / 'b' / '2.checkpoint'
    (tmp_path / 'a' / 'b' / '10.checkpoint').write_bytes(b'')
    (tmp_path / 'a' / 'b' / 'mine.checkpoint').write_bytes(b'')
    assert path_to_restore(chosen).name == '10.checkpoint'
    assert path_to_save(chosen).name == '11.checkpoint'


def test_files_under_way_keep_their_names(tmp_path):
    chosen = parameters(checkpoint__path=tmp_path)
    first = path_to_save(chosen)
    assert path_to_save(chosen, {first}) != first


def test_beside_the_bag(tmp_path):
    chosen = parameters(record__path=tmp_path / 'runs' / 'mine')
    assert path_to_save(chosen) == tmp_path / 'runs' / 'mine_checkpoints' / '1.checkpoint'


def test_one_file(tmp_path):
    chosen = parameters(checkpoint__path=tmp_path / 'new' / 'last.checkpoint')
    with pytest.raises(ValueError, match=r'no checkpoint .*last\.checkpoint'):
        path_to_restore(chosen)
    path = path_to_save(chosen)
    path.write_bytes(b'')
    assert path == path_to_save(chosen) == path_to_restore(chosen)


def test_nowhere_and_nothing(tmp_path):
    for find in (path_to_save, path_to_restore):
        with pytest.raises(ValueError, match=r'checkpoint\.path .*record\.path'):
            find(parameters())
    with pytest.raises(ValueError, match='no checkpoint in'):
        path_to_restore(parameters(checkpoint__path=tmp_path / 'none'))
    (tmp_path / 'file').write_bytes(b'')
    with pytest.raises(ValueError, match='cannot be created'):
        path_to_save(parameters(checkpoint__path=tmp_path / 'file' / 'below'))
