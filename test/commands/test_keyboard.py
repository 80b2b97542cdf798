# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What helps hands on a keyboard: estimates, JSON, completion, new scenes, lines of errors."""

import json
import math
from pathlib import Path
import re
import shutil
import subprocess

from icofabric_sim.commands.main import main, VERBS
from icofabric_sim.commands.scene_estimates import frequency_bound, hints, members
from icofabric_sim.commands.scenes import line_of
from icofabric_sim.parameters.example_scenes import example_scenes, find_scene
from icofabric_sim.scene.scene import load_scene, Scene
from icofabric_sim.statics.modes import solve_modes
import numpy as np
import pytest


def test_info_says_room_members_contact_period_and_cost(
        capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['info', 'folded_slab', '--json']) == 0
    said = json.loads(capsys.readouterr().out)
    scene = load_scene('folded_slab')
    corners = [float(number) for number in re.findall(r'-?[0-9.]+', said['box'])]
    radius = scene.shell.half_edge * math.sqrt(1.0 + ((1.0 + math.sqrt(5.0)) / 2.0) ** 2)
    np.testing.assert_allclose(corners[:3], scene.position.min(axis=0) - radius, rtol=1e-4)
    np.testing.assert_allclose(corners[3:6], scene.position.max(axis=0) + radius, rtol=1e-4)
    nearest = np.linalg.norm(scene.position[1:] - scene.position[0], axis=1).min()
    gap = float(said['gap'].split()[0])
    assert nearest - 2.0 * radius <= gap < nearest
    assert said['group tip'] == '3, 10, 17, 24, 31'
    assert 'auto: stiffness' in said['contact'] and 'friction 0' in said['contact']
    assert 'has a period of at least' in said['period']
    assert 'for each simulated second' in said['cost']


def test_no_vibration_is_faster_than_the_bound() -> None:
    scene = Scene.from_parameters({'weave.size': [3, 3, 3], 'weave.connector_angle': 0.3})
    fastest = solve_modes(scene).frequencies.max()
    assert fastest < frequency_bound(scene) < 4.0 * fastest
    assert frequency_bound(Scene.from_parameters({'weave.size': [1, 1, 1]})) == 0.0


def test_members_are_ranges() -> None:
    assert members(np.array([0, 1, 2, 5, 7, 8])) == '0 to 2, 5, 7 to 8'
    assert members(np.arange(0, 100, 2)).endswith('14, ... (50 bodies)')


@pytest.mark.parametrize('changes, hint', [
    ({'shell.edge_length': 20.0, 'shell.thickness': 2.0}, 'did you mean 0.02?'),
    ({'gravity': [0.0, 0.0, -9810.0]}, 'did you mean 9.81?'),
    ({'initial.turn.group': 'all', 'initial.turn.rotation': [0.0, 0.0, 45.0]}, '0.7854 rad'),
])
def test_units_that_look_like_mistakes_are_questioned(
        changes: dict[str, object], hint: str) -> None:
    scene = Scene.from_parameters({'weave.size': [1, 1, 1], **changes})
    (_, said), = hints(scene)
    assert hint in said
    assert not hints(Scene.from_parameters({'weave.size': [1, 1, 1]}))


# Errors.

def test_errors_about_meaning_name_the_line_of_the_file(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / 'scene.yaml'
    text = ('/**:\n  ros__parameters:\n    weave:\n      size: [3, 3, 3]\n'
            '    groups:\n      tip: x_max\n      none: level 9\n'
            '    supports.wall.group: tip\n')
    path.write_text(text, 'utf-8')
    assert main(['info', str(path)]) == 2
    assert f'({path}, line 7)' in capsys.readouterr().err
    path.write_text(text.replace('level 9', 'x_min').replace('group: tip', 'group: top'), 'utf-8')
    assert main(['info', str(path)]) == 2
    assert f'({path}, line 8)' in capsys.readouterr().err
    # Also where a part of the scene speaks that does not know of parameters.
    path.write_text(text.replace(
        'size: [3, 3, 3]', 'connector_angle: 14.3').replace('level 9', 'x_min'), 'utf-8')
    assert main(['info', str(path)]) == 2
    assert f'({path}, line 4)' in capsys.readouterr().err
    # Not where the command line takes the place of that line.
    assert main(['info', str(path), '-p', 'weave.connector_angle:=14.4']) == 2
    assert 'line 4' not in capsys.readouterr().err
    # What no file says has no line.
    path.write_text(text.replace('level 9', 'x_min'), 'utf-8')
    assert main(['info', str(path), '-p', 'connector.stiffness:=-1.0']) == 2
    assert 'line' not in capsys.readouterr().err


def test_the_line_is_that_of_the_deepest_name_given() -> None:
    path = find_scene('hanging_slab')
    lines = path.read_text('utf-8').splitlines()
    assert lines[line_of(path, 'supports.wall.fix') - 1].strip() == 'fix: all'
    assert lines[line_of(path, 'supports.wall') - 1].strip() == 'wall:'
    assert line_of(path, 'solver.step') == 0


def test_misspelt_scenes_and_verbs_are_answered_by_the_nearest_name(
        capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['info', 'hangin_slab']) == 2
    assert 'did you mean hanging_slab?' in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(['rnder', 'x'])
    assert 'did you mean render?' in capsys.readouterr().err


# Quiet, new, completion.

def test_a_new_scene_is_one_and_says_what_was_chosen(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / 'scenes' / 'mine.yaml'
    assert main(['new', str(path), '--size', '3', '3', '5', '--held', 'top', '--floor', '-0.3',
                 '--angle', '0.4', '--duration', '1.5']) == 0
    assert 'bodies' in capsys.readouterr().out
    scene = load_scene(path)
    assert scene.parameters['connector.bending_stiffness'] == 0.02
    assert scene.geometry.connector_angle == 0.4 and scene.parameters['duration'] == 1.5
    np.testing.assert_array_equal(
        np.flatnonzero(scene.supports.rotation), scene.groups['held'])
    assert scene.position[scene.groups['held'], 2].min() == scene.position[:, 2].max()
    assert scene.parameters['planes.floor.offset'] == -0.3
    assert path.read_text('utf-8').count('#') > 8
    assert list(path.parent.iterdir()) == [path]
    words = ['--held', 'none', '--no-gravity', '--kind', 'bias', '--bending', '0.0']
    assert main(['new', str(tmp_path / 'other.yaml'), *words]) == 0
    other = load_scene(tmp_path / 'other.yaml')
    assert other.supports is None and not any(other.parameters['gravity'])
    capsys.readouterr()
    for file, words, named in (
        (path, [], 'will not be overwritten'), (tmp_path / 'x.txt', [], '.yaml'),
        (tmp_path / 'x.yaml', ['--angle', '14'], 'degrees'),
        (tmp_path / 'x.yaml', ['--size', '0', '1', '1'], 'weave.size'),
    ):
        assert main(['new', str(file), *words]) == 2
        assert named in capsys.readouterr().err
    assert not (tmp_path / 'x.yaml').exists()


def test_a_hammock_hangs_by_its_corners_which_are_free_to_turn(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / 'hammock.yaml'
    assert main(['new', str(path), '--size', '5', '5', '2', '--held', 'corners']) == 0
    capsys.readouterr()
    scene = load_scene(path)
    held, place = scene.groups['held'], scene.position[:, :2]
    ends = [(axis.min(), axis.max()) for axis in place.T]
    corners = [number for number, (x, y) in enumerate(place)
               if x in ends[0] and y in ends[1]]
    assert held.tolist() == corners and len(held) >= 4
    assert scene.supports.translation[held].all() and not scene.supports.rotation.any()
    # All others bear the push.
    assert sorted([*scene.groups['free'], *held]) == list(range(scene.body_count))


def test_quiet_runs_show_their_results_only(
        tmp_path: Path, capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('ICOFABRIC_QUIET', '0')
    words = ['run', 'hanging_slab', '-p', 'weave.size:=[2, 2, 2]', '--duration', '0.02',
             '--no-record', '--no-growth', '--json']
    assert main(words) == 0
    loud = capsys.readouterr()
    assert 'bodies' in loud.err
    assert main([*words, '--quiet']) == 0
    quiet = capsys.readouterr()
    assert quiet.err == '' and set(json.loads(quiet.out)) == set(json.loads(loud.out))
    assert 'scene' in json.loads(quiet.out) and 'energy' in json.loads(quiet.out)


@pytest.mark.parametrize('shell', ['bash', 'zsh', 'fish'])
def test_completion_knows_verbs_options_and_scenes(
        shell: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(['completion', shell]) == 0
    script = capsys.readouterr().out
    for word in (*VERBS, *example_scenes()):
        assert word in script
    assert 'no-growth' in script and 'torn_slab' in script
    program = shutil.which(shell)
    if program is None:
        return
    file = tmp_path / 'script'
    file.write_text(script, 'utf-8')
    if shell == 'bash':
        done = subprocess.run(
            [program, '-c', f'source {file}; COMP_WORDS=(icofabric run --no); COMP_CWORD=2; '
             '_icofabric; echo "${COMPREPLY[@]}"; COMP_WORDS=(icofabric ver); COMP_CWORD=1; '
             '_icofabric; echo "${COMPREPLY[@]}"'],
            capture_output=True, text=True, check=True, cwd=tmp_path)
        assert done.stdout.splitlines() == ['--no-record --no-growth', 'verify']
    else:
        subprocess.run([program, '-n', str(file)], check=True)


def test_a_bag_in_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = tmp_path / 'bag'
    assert main(['run', 'hanging_slab', '-p', 'weave.size:=[2, 2, 2]', '--duration', '0.02',
                 '--no-growth', '--record', str(bag), '--quiet']) == 0
    capsys.readouterr()
    assert main(['info', str(bag), '--json']) == 0
    assert 'bag' in json.loads(capsys.readouterr().out)
    assert main(['verify', str(bag), '--json', '--quiet']) == 0
    assert json.loads(capsys.readouterr().out)['result'].startswith('identical')
    assert main(['recover', str(bag), '--json']) == 0
    assert 'nothing was lost' in json.loads(capsys.readouterr().out)['source']
