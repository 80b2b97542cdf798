# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Compare the speed of this checkout with other commits, case by case and in turns.

Each commit is checked out into a worktree below build/regression. It is compared with the files of
this checkout, committed or not. A process for each tree runs one case at a time, first one tree,
then the other, so that a drift of the machine's speed affects both. One thread; processor time.
A round has several turns, of which the least time of each tree counts. The comparison fails if a
case is slower than the limit in every round. A first round compiles kernels and does not count.

Single rounds of two identical trees differ by factors of 0.7 to 1.3 on 2 virtual cores at a load
of 1, and of 0.6 to 1.7 at a load of 6. `--rounds` is therefore at least 5. Compare HEAD with HEAD
to see what the machine adds.

The number of steps of a fabric with contacts changes by a tenth with the last bits of the motion.
So gravity differs by 1e-10 between rounds, and the range of the ratios includes these changes.

    make bench REF=HEAD~1
    .venv/bin/python -m icofabric_validation.benchmarks.regression HEAD~1
    .venv/bin/python -m icofabric_validation.benchmarks.regression HEAD~1 --cases S1 pile \
        --rounds 9 --no-baseline
"""

import argparse
from collections.abc import Callable
import json
import logging
import math
import os
from pathlib import Path
import statistics
import subprocess
import sys
import tempfile
import time
from typing import Any, NamedTuple

from icofabric_validation.benchmarks.machine import describe_machine
from icofabric_validation.source_tree import ROOT

# A commit before error estimates existed. A limit for each commit alone would let losses add up.
BASELINE = 'a3d07d9'
# Largest time of this checkout over that of another one.
LIMIT_RATIO = 1.05
# A case shorter than this is repeated within its round, at most so often.
_MIN_BLOCK_S, _MAX_REPEAT_COUNT = 0.2, 9
# Turns in a round, and the fewest rounds from which a case is called slower.
_TURN_COUNT, _MIN_ROUND_COUNT = 3, 5
FABRIC: dict[str, Any] = {
    'shell.edge_length': 0.02, 'shell.thickness': 0.002, 'shell.density': 1200.0,
    'connector.stiffness': 500.0, 'contact.mode': 'never', 'solver.threads': 1,
    'initial_random.velocity_sigma': 0.05, 'initial_random.spin_sigma': 2.0,
    'initial_random.seed': 1}
S1 = {**FABRIC, 'weave.size': [5, 5, 5]}
S3 = {**FABRIC, 'weave.size': [21, 21, 21]}
CHOSEN = {'solver.tolerance': 1e-6}
LAW = 'LAW'  # stands for the path of the table that a worker writes
SPACING_M = (1.0 + 5.0**0.5) * 0.01


class Round(NamedTuple):
    """Common data of the scenes of a round."""

    folder: Path  # for files of scenes
    config: Path  # example scenes, the same for both trees
    gravity_ratio: float


class Motion(NamedTuple):
    """A fabric, and the interval of its motion that is timed [s]."""

    scene: Callable[[Round], Any]
    begin: float
    end: float

    def prepare(self, given: Round) -> Any:
        """Return a simulation at the begin of the interval, with its kernels."""
        import icofabric_sim as ico

        simulation = ico.compile_scene(self.scene(given))
        simulation.warm_up()
        simulation.advance_to(self.begin)
        return simulation

    def run(self, simulation: Any) -> int:
        """Advance to the end of the interval. Return the number of steps."""
        status = getattr(simulation, 'status', simulation)
        before = status.step_count
        simulation.advance_to(self.end)
        return int(status.step_count - before)


class Equilibrium(NamedTuple):
    """An equilibrium of a slab that is held at one side, under its weight."""

    size: list[int]

    def prepare(self, given: Round) -> Any:
        """Return the scene."""
        import icofabric_sim as ico

        return ico.Scene.from_parameters({
            'weave.size': self.size, 'gravity': [0.0, 0.0, -9.81], 'groups.wall': 'x_min',
            'supports.wall.group': 'wall', 'contact.mode': 'never',
            'connector.stiffness': 2000.0, 'connector.bending_stiffness': 0.02})

    def run(self, scene: Any) -> int:
        """Solve. Return the number of steps."""
        import icofabric_sim as ico

        return int(ico.solve_equilibrium(scene).step_count)


class Compiling(NamedTuple):
    """`compile_scene` of a scene whose kernels are on disk."""

    scene: Callable[[Round], Any]

    def prepare(self, given: Round) -> Any:
        """Return the scene."""
        return self.scene(given)

    def run(self, scene: Any) -> int:
        """Compile the scene. Return the number of bodies."""
        import icofabric_sim as ico

        return int(ico.compile_scene(scene).scene.body_count)


def _fabric(parameters: dict[str, Any]) -> Callable[[Round], Any]:
    def make(given: Round) -> Any:
        import icofabric_sim as ico

        return ico.Scene.from_parameters({
            name: _write_law(given.folder) if value == LAW else value
            for name, value in parameters.items()})
    return make


def _example(name: str) -> Callable[[Round], Any]:
    def make(given: Round) -> Any:
        import icofabric_sim as ico

        parameters = ico.load_scene(str(given.config / f'{name}.yaml')).parameters
        return ico.Scene.from_parameters({
            **parameters, 'solver.threads': 1,
            'gravity': [given.gravity_ratio * part for part in parameters['gravity']]})
    return make


def _pile(**changes: Any) -> Callable[[Round], Any]:
    """Return 216 loose shells in a box; they fall and collide."""
    def make(given: Round) -> Any:
        from icofabric_validation.benchmarks.pile import pile

        return pile((6, 6, 12), **{
            'contact.stiffness': 1e6, 'solver.method': 'leapfrog', 'solver.threads': 1,
            'gravity': [0.0, 0.0, -9.81 * given.gravity_ratio], **changes})
    return make


def _dense(tolerance: float) -> Callable[[Round], Any]:
    """Return 32 shells woven face to face, with friction, which settle on a floor."""
    def make(given: Round) -> Any:
        import icofabric_sim as ico

        return ico.Scene.from_parameters({
            'weave.size': [4, 4, 4], 'weave.connector_angle': -0.36, 'contact.friction': 0.4,
            'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -0.0165,
            'gravity': [0.0, 0.0, -9.81 * given.gravity_ratio],
            'solver.tolerance': tolerance, 'solver.threads': 1})
    return make


def _given(method: str, step: float) -> dict[str, Any]:
    return {'solver.method': method, 'solver.step': step}


DAMPED = {**S1, **CHOSEN, 'solver.method': 'dop8', 'connector.damping': 0.02}
CASES: dict[str, Motion | Equilibrium | Compiling] = {
    'S1, auto at 1e-3, 0 to 0.5 s': Motion(_fabric({**S1, 'solver.tolerance': 1e-3}), 0.0, 0.5),
    'S1, auto at 1e-6, 0 to 0.05 s': Motion(_fabric({**S1, **CHOSEN}), 0.0, 0.05),
    'S1, auto at 1e-6, 0 to 0.5 s': Motion(_fabric({**S1, **CHOSEN}), 0.0, 0.5),
    'S1, auto at 1e-9, 0 to 0.5 s': Motion(_fabric({**S1, 'solver.tolerance': 1e-9}), 0.0, 0.5),
    'S1, srkn6, 100 steps': Motion(_fabric({**S1, **_given('srkn6', 1.25e-3)}), 0.0, 0.125),
    'S1, srkn6, 400 steps': Motion(_fabric({**S1, **_given('srkn6', 1.25e-3)}), 0.0, 0.5),
    'S1, srkn8, 250 steps': Motion(_fabric({**S1, **_given('srkn8', 2e-3)}), 0.0, 0.5),
    'S1 damped, dop8, 0 to 0.25 s': Motion(_fabric(DAMPED), 0.0, 0.25),
    'S1 damped, dop8, 1 to 2 s': Motion(_fabric(DAMPED), 1.0, 2.0),
    'S1 kinked, auto at 1e-6': Motion(
        _fabric({**S1, **CHOSEN, 'connector.stiffness_compression': 100.0}), 0.0, 0.1),
    'S1 tabled, leapfrog, 2,000 steps': Motion(
        _fabric({**S1, **_given('leapfrog', 1e-4), 'connector.law': LAW}), 0.0, 0.2),
    'S3, leapfrog, first 400 steps': Motion(
        _fabric({**S3, **_given('leapfrog', 1e-4)}), 0.0, 0.04),
    'S3, leapfrog, steps 1,200 to 1,600': Motion(
        _fabric({**S3, **_given('leapfrog', 1e-4)}), 0.12, 0.16),
    'S3, srkn8, first 40 steps': Motion(_fabric({**S3, **_given('srkn8', 1e-3)}), 0.0, 0.04),
    'hanging_slab, 0 to 0.5 s': Motion(_example('hanging_slab'), 0.0, 0.5),
    'folded_slab, 0 to 0.4 s': Motion(_example('folded_slab'), 0.0, 0.4),
    'pile of 216, 0 to 0.1 s': Motion(_pile(), 0.0, 0.1),
    'elastic pile of 216, 0 to 0.1 s': Motion(
        _pile(**{'contact.damping': 0.0, 'contact.friction': 0.0}), 0.0, 0.1),
    'dense weave, auto at 0.1, 10 ms': Motion(_dense(0.1), 0.07, 0.08),
    'dense weave, auto at 1e-6, 10 ms': Motion(_dense(1e-6), 0.0, 0.01),
    'equilibrium of 2,048 bodies': Equilibrium([16, 16, 16]),
    'compile_scene of S3': Compiling(_fabric(S3)),
}


def _write_law(folder: Path) -> str:
    """Write a law as stiff as the springs at rest, which stiffens. Return its path."""
    file = folder / 'law.csv'
    strains = [-0.5 + 0.25 * number for number in range(5)]
    file.write_text(''.join(
        f'{SPACING_M * (1.0 + e):.17g}, {500.0 * SPACING_M * (e + e**3):.17g}\n'
        for e in strains))
    return str(file)


def work(config: Path, gravity_ratio: float) -> None:
    """Run the cases named on standard input and answer each with its seconds and its count."""
    answers, sys.stdout = sys.stdout, sys.stderr
    # Connectors enter shells in some cases, as they do in the benchmarks of speed.
    logging.disable(logging.WARNING)
    import icofabric_sim as ico

    assert ico.__file__ is not None and Path(ico.__file__).is_relative_to(Path.cwd()), ico.__file__
    with tempfile.TemporaryDirectory() as name:
        given = Round(Path(name), config, gravity_ratio)
        loaded: set[str] = set()
        for line in sys.stdin:
            case, count = CASES[line.strip()], 0
            seconds: list[float] = []
            try:
                if line not in loaded:
                    # The first run loads kernels from disk and does not count.
                    case.run(case.prepare(given))
                    loaded.add(line)
                while not seconds or (
                        sum(seconds) < _MIN_BLOCK_S and len(seconds) < _MAX_REPEAT_COUNT):
                    prepared = case.prepare(given)
                    began = time.process_time()
                    count = case.run(prepared)
                    seconds.append(time.process_time() - began)
            except Exception as error:  # noqa: BLE001 - an older tree may lack a parameter
                print(f'{Path.cwd().name}: {line.strip()}: {error!r}', file=sys.stderr)
                seconds = [math.nan]
            print(json.dumps([min(seconds), count]), file=answers, flush=True)


class Worker:
    """A process that runs cases with the package of one tree."""

    def __init__(self, tree: Path, config: Path, gravity_ratio: float) -> None:
        self._tree = tree
        self._process = subprocess.Popen(
            [sys.executable, '-m', 'icofabric_validation.benchmarks.regression', '--work',
             str(config), repr(gravity_ratio)],
            cwd=tree, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            env={**os.environ, 'PYTHONPATH': str(tree)})

    def time(self, case: str) -> tuple[float, int]:
        """Return the processor time [s] of a case, NaN where the tree cannot run it; its count."""
        assert self._process.stdin is not None and self._process.stdout is not None
        try:
            print(case, file=self._process.stdin, flush=True)
        except BrokenPipeError:
            pass
        answer = self._process.stdout.readline()
        if not answer:
            sys.exit(f'{case}: the process in {self._tree} ended with status '
                     f'{self._process.wait()}')
        seconds, count = json.loads(answer)
        return seconds, count

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


def find_commit(reference: str) -> str:
    """
    Return the hash of a commit.

    Raises
    ------
    ValueError
        If there is no such commit; with what to do.
    """
    found = _git('rev-parse', '--quiet', '--verify', '--short=12', f'{reference}^{{commit}}')
    if found.returncode == 0:
        return found.stdout.strip()
    way = 'give a commit, branch or tag that `git log` shows'
    if reference == BASELINE:
        way = '`git fetch --unshallow` gets older commits, and --no-baseline goes without'
    raise ValueError(f'no commit {reference!r} in {ROOT}{found.stderr.strip()}: {way}')


def check_out(commit: str) -> Path:
    """Check out a commit below build/regression, once. Return its folder."""
    folder = ROOT / 'build' / 'regression' / commit
    if not folder.exists():
        _git('worktree', 'prune')
        made = _git('worktree', 'add', '--quiet', '--detach', str(folder), commit)
        if made.returncode:
            sys.exit(f'no worktree in {folder}: {made.stderr.strip()}')
    return folder


def _git(*words: str) -> 'subprocess.CompletedProcess[str]':
    return subprocess.run(['git', *words], cwd=ROOT, check=False, capture_output=True, text=True)


def is_slower(ratios: list[float]) -> bool:
    """Return True if all ratios of times exceed LIMIT_RATIO. NaN: the other tree has no time."""
    return min(ratios) > LIMIT_RATIO


def compare(
    other: Path, cases: list[str], rounds: int, say: Callable[[str], object] = print
) -> list[str]:
    """
    Time `cases` in this tree and in `other`, in turns, and print a row for each.

    Returns
    -------
    list of str
        The cases in which this tree exceeded LIMIT_RATIO in every round, or did not run.
    """
    times: dict[str, list[tuple[float, float]]] = {case: [] for case in cases}
    counts: dict[str, tuple[int, int]] = {}
    # The first round compiles kernels and is not counted.
    for number in range(rounds + 1):
        workers = [Worker(tree, other / 'config', 1.0 + 1e-10 * number) for tree in (other, ROOT)]
        for case in cases:
            order = (0, 1) if number % 2 else (1, 0)
            turns = [{which: workers[which].time(case) for which in order}
                     for _ in range(_TURN_COUNT if number else 1)]
            if number:
                times[case].append((
                    min(turn[0][0] for turn in turns), min(turn[1][0] for turn in turns)))
            counts[case] = turns[-1][0][1], turns[-1][1][1]
        for worker in workers:
            worker.close()
    failed = []
    say(f'{"case":36}{"other ms":>10}{"this ms":>10}{"ratio":>8}{"range":>14}{"counts":>16}')
    for case in cases:
        ratios = [this / before for before, this in times[case]]
        medians = [statistics.median(column) for column in zip(*times[case])]
        verdict = '  DOES NOT RUN' if math.isnan(medians[1]) else (
            '  SLOWER' if is_slower(ratios) else '')
        failed += [case] * bool(verdict)
        say(f'{case:36}{1e3 * medians[0]:10.2f}{1e3 * medians[1]:10.2f}'
            f'{statistics.median(ratios):8.3f}{f"{min(ratios):.3f}-{max(ratios):.3f}":>14}'
            f'{f"{counts[case][0]}, {counts[case][1]}":>16}{verdict}')
    return failed


def main() -> int:
    """Compare with the commits given. Return 1 if a case is slower than the limit."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('reference', nargs='*', help=f'commits; also compared: {BASELINE}')
    parser.add_argument('--rounds', type=int, default=5)
    parser.add_argument('--cases', nargs='+', default=[''], help='only cases with such a text')
    parser.add_argument('--no-baseline', action='store_true', help=f'do not compare {BASELINE}')
    parser.add_argument('--work', nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.work:
        work(Path(given.work[0]), float(given.work[1]))
        return 0
    cases = [case for case in CASES if any(text in case for text in given.cases)]
    references = [*given.reference, *([] if given.no_baseline else [BASELINE])]
    if not cases:
        parser.error(f'no case has {given.cases} in its name; cases: {"; ".join(CASES)}')
    if given.rounds < _MIN_ROUND_COUNT:
        parser.error(f'--rounds must be at least {_MIN_ROUND_COUNT}, got {given.rounds}: '
                     'in fewer, identical commits differ by chance')
    try:
        commits = {reference: find_commit(reference) for reference in references}
    except ValueError as error:
        parser.error(str(error))
    print(describe_machine(), f'load {os.getloadavg()[0]:.1f}', sep='; ')
    failed = []
    for reference, commit in commits.items():
        print(f'\nthis checkout over {reference} ({commit}), {given.rounds} rounds', flush=True)
        failed += [f'{case} (over {reference})' for case in compare(
            check_out(commit), cases, given.rounds)]
    if failed:
        print(f'\nmore than {LIMIT_RATIO:g} times as long in every round:', *failed, sep='\n  ')
    return int(bool(failed))


if __name__ == '__main__':
    sys.exit(main())
