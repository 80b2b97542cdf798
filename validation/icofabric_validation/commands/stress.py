# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric stress`: tests with random scenes, known answers, stability and predictability."""

import argparse
from functools import partial
from itertools import islice
import os
from pathlib import Path
from typing import TYPE_CHECKING

from icofabric_sim.commands.report import print_json_line
from icofabric_sim.terminal import InputError, Progress, require_place
from icofabric_validation.commands.named_problems import add_named_arguments, main_named
from icofabric_validation.commands.predictability import (
    add_predictability_arguments,
    main_predictability,
)
from icofabric_validation.commands.stability_map import add_map_arguments, main_map

if TYPE_CHECKING:
    from icofabric_validation.stress.verdict import Finding

_SCENES = 100


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    parser.add_argument(
        '--scenes', type=int, metavar='N',
        help=f'test N scenes (default {_SCENES}; with --seed alone: that one)')
    parser.add_argument(
        '--seed', type=int, metavar='S',
        help='first seed; the others follow it; alone: run that scene again and report '
        'its class and results')
    parser.add_argument(
        '--kinds', metavar='K,K-K,...',
        help='kinds of scenes by number, e.g. 0-5,12; the others are skipped (default: all; '
        '--list names them)')
    parser.add_argument(
        '--list', action='store_true', help='list the kinds of scenes by number without running '
                                            'them')
    parser.add_argument(
        '--processes', type=int, metavar='P',
        help='test in P processes (default: one for each core)')
    parser.add_argument(
        '--output', metavar='FILE',
        help='write a table of all scenes (CSV); with --shrink the scene (YAML)')
    parser.add_argument('--json', action='store_true', help='print the results as JSON lines')
    parser.add_argument(
        '--shrink', action='store_true',
        help='minimise the scene of --seed: remove features one at a time while its class '
        'remains, and write it to --output (default: stress_SEED.yaml)')
    parser.add_argument(
        '--coverage', action='store_true',
        help='also report in how many scenes each parameter was not at its default')
    parser.add_argument(
        '--peer', choices=('mujoco', 'lammps'),
        help='test that program instead, with the scenes that it can express (loads are left '
        'out)')
    add_named_arguments(parser)
    add_map_arguments(parser)
    add_predictability_arguments(parser)


def main(arguments: argparse.Namespace) -> int:
    """Run the tests; return 1 if a scene is in a class that must not occur."""
    from icofabric_validation.stress.kinds import KINDS
    from icofabric_validation.stress.scenes import MAX_SEED, seeds_of
    if arguments.predictability:
        return main_predictability(arguments)
    if arguments.map:
        return main_map(arguments)
    for name in ('steps', 'picture', 'fabrics', 'products'):
        if getattr(arguments, name) is not None:
            raise InputError(f'--{name} needs --map')
    if arguments.named:
        return main_named(arguments)
    for name in ('problem', 'long'):
        if getattr(arguments, name):
            raise InputError(f'--{name} needs --named: random scenes have none')
    if arguments.processes is None:
        arguments.processes = len(os.sched_getaffinity(0))
    if not 1 <= arguments.processes <= 256:
        raise InputError(f'--processes must be from 1 to 256, got {arguments.processes}')
    if arguments.scenes is not None and not 1 <= arguments.scenes <= 10**6:
        raise InputError(f'--scenes must be from 1 to 1000000, got {arguments.scenes}')
    if arguments.seed is not None and not 0 <= arguments.seed <= MAX_SEED:
        raise InputError(f'--seed must be from 0 to {MAX_SEED}, got {arguments.seed}')
    kinds = _kinds(arguments.kinds, len(KINDS))
    if arguments.list:
        for number in sorted(kinds):
            print(f'{number:3}  {KINDS[number]}')
        return 0
    single = arguments.seed is not None and arguments.scenes is None
    if arguments.peer is not None:
        _require_peer(arguments, single)
    if arguments.shrink and not single:
        raise InputError('--shrink needs --seed, without --scenes: it minimises one scene')
    if arguments.output is not None:
        require_place('--output', Path(arguments.output).expanduser())
    if arguments.shrink:
        return _shrink(arguments)
    if single:
        seeds = [arguments.seed]
    elif arguments.peer is not None:
        from icofabric_validation.stress.peers import PEERS
        drawn = seeds_of(arguments.seed or 0, MAX_SEED, kinds)
        seeds = list(islice(
            filter(PEERS[arguments.peer].can_express, drawn), arguments.scenes or _SCENES))
    else:
        seeds = list(seeds_of(arguments.seed or 0, arguments.scenes or _SCENES, kinds))
    findings, interrupted = _judge(arguments, seeds)
    _show(arguments, findings, single)
    if interrupted:
        raise KeyboardInterrupt
    return int(any(finding.is_fault for finding in findings))


def _require_peer(arguments: argparse.Namespace, single: bool) -> None:
    """Reject options that cannot be combined with --peer, and a program that is not installed."""
    from icofabric_validation.stress.peers import PEERS
    peer = PEERS[arguments.peer]
    if arguments.shrink:
        raise InputError('--shrink cannot be combined with --peer')
    if not peer.is_installed:
        raise InputError(f'--peer {arguments.peer} is not installed: {peer.install}')
    if single and not peer.can_express(arguments.seed):
        raise InputError(f'--peer {arguments.peer} cannot express the scene of --seed '
                         f'{arguments.seed}; add --scenes N to start there')


def _kinds(text: str | None, count: int) -> set[int]:
    """Parse numbers of kinds from a text such as 0-5,12."""
    if text is None:
        return set(range(count))
    found: set[int] = set()
    for part in text.split(','):
        first, dash, last = part.strip().partition('-')
        if not (first.isdecimal() and (last.isdecimal() if dash else not last)):
            raise InputError(f'--kinds {text}: {part!r} is neither a number nor a range, e.g. '
                             '0-5,12')
        numbers = range(int(first), int(last or first) + 1)
        if not numbers or not numbers[-1] < count:
            raise InputError(f'--kinds {text}: {part!r} must be within 0 to {count - 1}; --list '
                             'names them')
        found |= set(numbers)
    return found


def _judge(
    arguments: argparse.Namespace, seeds: list[int]
) -> tuple[list['Finding'], bool]:
    """Return the findings, and whether the user interrupted the tests."""
    from icofabric_validation.stress.judge import judge
    from icofabric_validation.stress.peers import judge_peer
    from icofabric_validation.stress.workers import judge_all
    findings: list[Finding] = []
    try:
        with Progress(len(seeds), 'scenes') as progress:
            for finding in judge_all(
                    seeds, processes=min(arguments.processes, len(seeds)),
                    judge_one=judge if arguments.peer is None else partial(
                        judge_peer, arguments.peer)):
                findings.append(finding)
                if arguments.json:
                    _print_json(finding)
                elif finding.is_fault and len(seeds) > 1:
                    progress.note(f'seed {finding.seed}: {finding.verdict.value}: '
                                  f'{finding.detail}')
                if arguments.output is not None:
                    _write(Path(arguments.output).expanduser(), findings)
                progress.update(len(findings))
    except KeyboardInterrupt:
        return findings, True
    return findings, False


def _write(path: Path, findings: list['Finding']) -> None:
    """Replace the table atomically, so that it can be read at any time."""
    from icofabric_validation.stress.report import write_table
    part = path.with_name(f'.{path.name}.part')
    write_table(part, sorted(findings))
    part.replace(path)


def _print_json(finding: 'Finding') -> None:
    from icofabric_validation.stress.report import as_dictionary
    print_json_line(as_dictionary(finding))


def _show(arguments: argparse.Namespace, findings: list['Finding'], single: bool) -> None:
    from icofabric_validation.stress.report import class_lines, coverage_lines, term_lines
    if arguments.json:
        return
    if single:
        for finding in findings:
            _describe(finding)
        return
    print('\n'.join(class_lines(findings)))
    print()
    print('\n'.join(term_lines(findings)))
    if arguments.coverage:
        print('\nnumber of scenes in which a parameter was not at its default')
        print('\n'.join(coverage_lines(findings)))


def _describe(finding: 'Finding') -> None:
    """Print one scene with its results."""
    from icofabric_validation.stress.kinds import KINDS
    print(f'seed {finding.seed}: {finding.verdict.value}')
    print(f'kind {finding.kind}: {KINDS[finding.kind]}')
    if finding.detail:
        print(finding.detail)
    if finding.method:
        print(
            f'{finding.bodies} bodies, {finding.steps} steps of {finding.method} to t = '
            f'{finding.time:.6g} s')
        print(
            f'added errors without growth: {finding.added:.3g}; promised: {finding.promised:.3g}; '
            f'estimate of the run {finding.estimate:.3g}')
        grown = f'{finding.growth:.3g} times' if finding.growth else 'was not measured'
        print(f'growth of a small displacement: {grown}')
        print(f'windows compared with a reference run: {finding.windows}, of which '
              f'{finding.unjudged} could not be judged')
        bits = 'compared bit by bit' if finding.compared else 'not compared'
        if finding.compared and not finding.shared:
            bits += '; one thread has all bodies, because they are few'
        print(f'two threads and a checkpoint: {bits}')


def _shrink(arguments: argparse.Namespace) -> int:
    """Write the minimal scene."""
    from icofabric_validation.stress.scenes import draw_scene
    from icofabric_validation.stress.shrink import MAX_RUNS, shrink
    from icofabric_validation.stress.workers import Referee
    path = Path(arguments.output or f'stress_{arguments.seed}.yaml').expanduser()
    whole = draw_scene(arguments.seed).with_files_named(f'{path.stem}_')
    for place in (path, *(path.parent / name for name in whole.files)):
        if place.exists():
            raise InputError(f'{place} exists and is never overwritten; choose another with '
                             '--output, which also names the files of the scene')
    referee = Referee()
    try:
        with Progress(MAX_RUNS, 'runs at most', foreseen=False) as progress:
            scene, finding = shrink(whole, referee.judge, tried=progress.update)
    finally:
        referee.close()
    scene = scene.with_files_named('')
    path.write_text(scene.text(), encoding='utf-8')
    for name, text in scene.files.items():
        (path.parent / name).write_text(text, encoding='utf-8')
    _describe(finding)
    print(f'{path}: {len(scene.parameters)} parameters of {len(whole.parameters)}')
    return int(finding.is_fault)
