# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Every verb answers words that make no sense with exit status 2 and one line, before any work."""
from icofabric_sim.commands.main import BAD_INPUT, main, VERBS
from icofabric_sim.pictures.render import spread_times
import numpy as np
import pytest

SCENE_VERBS = ('run', 'statics', 'modes', 'elasticity', 'info')
BAG_VERBS = ('verify', 'info', 'render', 'recover')
# Verbs that need nothing beside their name.
WITHOUT_WORDS = ('benchmark', 'document', 'stress', 'study', 'tables', 'warm')
NO_SCENES = ('nothing', '', 'folder', 'mixed.yaml', 'garbage.yaml', 'unknown.yaml', 'x\ny')
NO_BAGS = ('nothing', '', 'folder', 'garbage.yaml')
OVERRIDES = (
    'x', 'shell.mass:=heavy', 'shell.mass:=-1', 'weave.size:=[0, 0, 0]', 'shell.mass:=.nan',
    'gravity:=[0, 0, -9.81]', 'nothing:=1', ':=3', 'weave.kind:=woolly', 'groups.1:=x')
# Values of options with numbers; `0` where it means nothing.
NUMBERS = ('x', '-1', 'nan', 'inf', '')
COUNTS = ('x', '-1', '0', '1.5', '')
OPTIONS = {
    'run': {
        '--duration': NUMBERS, '--record': ('small.yaml/a', 'mixed.yaml/a/b'),
        '--storage': ('x', '')},
    'statics': {
        '--time': NUMBERS, '--tolerance': (*NUMBERS, '0', '1'), '--steps': ('x', '-1', '1.5', ''),
        '--load-steps': COUNTS, '--picture': ('', 'a.gif', 'small.yaml/a.png'),
        '--output': ('small.yaml', 'small.yaml/a')},
    'modes': {
        '--count': COUNTS, '--time': NUMBERS, '--animate': ('', 'a.png', 'small.yaml/a.gif'),
        '--bands': ('', 'a.gif', 'small.yaml/a.png')},
    'elasticity': {
        '--strain': (*NUMBERS, '0'), '--angle': ('x', 'nan', 'inf', '0', ''),
        '--about': ('w', 'x'), '--cycles': ('x', '-1', '1.5', ''),
        '--points': COUNTS, '--kinds': ('x',), '--axis': ('w', '0'),
        '--picture': ('', 'a.gif', 'small.yaml/a.png'), '--output': ('small.yaml',)},
}
CASES = [
    (), ('nothing',), ('--nothing',), ('',),
    *((verb, '--nothing') for verb in VERBS),
    *((verb, 'small.yaml', '--nothing') for verb in VERBS if verb != 'benchmark'),
    *((verb,) for verb in VERBS if verb not in WITHOUT_WORDS),
    *((verb, scene) for verb in SCENE_VERBS for scene in NO_SCENES),
    *((verb, bag) for verb in BAG_VERBS for bag in NO_BAGS),
    *((verb, 'small.yaml', '-p', rule) for verb in SCENE_VERBS for rule in OVERRIDES),
    *((verb, 'small.yaml', f'{option}={value}') for verb, options in OPTIONS.items()
      for option, values in options.items() for value in values),
    *(('render', 'folder', f'{option}={value}') for option, value in (
        ('--size', 'x'), ('--size', '0x0'), ('--sheet', 'a.gif'), ('--view', '1'),
        ('--sheet', 'small.yaml/a.png'), ('--output', 'small.yaml'), ('--output', 'film.gif'),
        ('--every', 'x'))),
    *(('verify', 'folder', f'{option}={value}') for option, value in (
        ('--threads', '-1'), ('--threads', 'x'), ('--start', 'nan'), ('--stop', '-1'))),
    *(('benchmark', 'speed', f'{option}={value}') for option, value in (
        ('--rounds', '0'), ('--rounds', 'x'), ('--largest', '0'), ('--peers', 'x'),
        ('--output', 'small.yaml'))),
    ('benchmark', 'nothing'),
    *(('study', f'{option}={value}') for option, value in (
        ('--part', 'nothing'), ('--part', ''), ('--workers', '-1'), ('--workers', 'x'),
        ('--output', 'small.yaml'), ('--store', 'small.yaml/a'))),
    *(('tables', number) for number in ('0', '11', '-1', '1.5', 'x', '')),
    ('tables', '--size', '0', '1', '1'), ('tables', '--size', '3', '3'),
    *(('tables', f'--figure={file}') for file in ('', 'a.gif', 'small.yaml/a.png')),
    *(('document', part) for part in ('0', '11', 'x', '')),
    *(('document', 'appendix', f'{option}={value}')
      for option in ('--edge', '--thickness', '--density') for value in (*NUMBERS, '0')),
    *(('document', '--figure', name, file) for name, file in (
        ('9', 'a.png'), ('2', 'a.gif'), ('2', 'small.yaml/a.png'))),
    ('document', '--figures=small.yaml'),
]


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp('words')
    text = '/**: {ros__parameters: {weave.size: [2, 2, 2], contact.mode: never}}\n'
    (folder / 'small.yaml').write_text(text)
    # As rcl: an integer in a list with floats.
    (folder / 'mixed.yaml').write_text('/**: {ros__parameters: {gravity: [0, 0, -9.81]}}\n')
    (folder / 'unknown.yaml').write_text('/**: {ros__parameters: {nothing: 1}}\n')
    (folder / 'garbage.yaml').write_bytes(b'\x00\xff\xfe:::[[[')
    (folder / 'folder').mkdir()
    return folder


def test_every_verb_is_tried():
    assert {words[0] for words in CASES if words and words[0] in VERBS} == set(VERBS)


@pytest.mark.parametrize('words', CASES, ids=lambda words: ' '.join(words).replace('\n', ' '))
def test_words_that_make_no_sense(folder, words, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    # What a test changes of the process does not last.
    monkeypatch.setattr('signal.signal', lambda number, handler: None)
    before = sorted(path.name for path in folder.rglob('*'))
    try:
        status = main(list(words))
    except SystemExit as ended:
        status = ended.code
    said = capsys.readouterr().err.strip().splitlines()
    # Building may come first, and says what it builds.
    said = [line for line in said if not line.startswith(('small: ', 'compiling '))]
    assert status == BAD_INPUT and len(said) == 1, said
    assert said[0].startswith('icofabric') and 'Traceback' not in said[0]
    if words and words[0] in VERBS:
        assert said[0].startswith(f'icofabric {words[0]}: ')
    assert sorted(path.name for path in folder.rglob('*')) == before


def test_more_moments_than_were_recorded_are_all_of_them():
    """Room for 10^12 moments would not fit into any memory."""
    times = np.array([0, 5, 1000])
    assert spread_times(times, 10**12) is times
    assert spread_times(times, 2).tolist() == [0, 1000]
