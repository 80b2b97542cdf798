# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: what it does, what it says, and its exit status."""

from collections.abc import Callable, Iterator
import json
import os
from pathlib import Path
import pty
import re
import signal
import subprocess
import sys
import threading
import time
from typing import NamedTuple

from icofabric_sim.bag import BagReader
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.bag.summary import summarise_bag
from icofabric_sim.commands.main import main, VERBS
from icofabric_sim.commands.scene_estimates import frequency_bound
from icofabric_sim.messages.schedule import seconds
from icofabric_sim.parameters.example_scenes import example_scenes, find_scene
from icofabric_sim.parameters.file import load_parameter_file
from icofabric_sim.running.cross_check import cross_check, DISTURBANCE
from icofabric_sim.scene.scene import Scene
from icofabric_sim.scene.summary import evaluations_text
from icofabric_sim.simulation.reports.divergence import measure_growth
from icofabric_sim.simulation.simulation import compile_scene, Simulation
from icofabric_sim.statics.modes import solve_modes
import numpy as np
import pytest
import yaml

COMMAND = [sys.executable, '-m', 'icofabric_sim.commands.main']
# A shell script in the background ignores SIGINT, and so would its children.
WITH_SIGINT = [
    sys.executable, '-c',
    'import os, signal, sys; signal.signal(signal.SIGINT, signal.SIG_DFL); '
    'os.execv(sys.argv[1], sys.argv[1:])']
SMALL = ['-p', 'weave.size:=[3, 3, 3]']
# A slab held at one side, which falls.
SWING = """\
/**:
  ros__parameters:
    weave: {size: [3, 3, 3], connector_angle: 0.3}
    gravity: [0.0, 0.0, -9.81]
    groups: {wall: x_min, tip: x_max}
    supports: {wall: {group: wall}}
    loads: {tip: {group: tip, share: total}}
"""
DURATION = 0.25
ESCAPE = '\x1b'


class Result(NamedTuple):
    status: int
    out: str
    err: str


def command(*words: str, folder: Path, **environment: str) -> Result:
    done = subprocess.run(
        [*COMMAND, *words], cwd=folder, capture_output=True, text=True, timeout=400,
        env={**os.environ, 'PYTHONPATH': str(Path(__file__).parents[2]), **environment},
        check=False)
    return Result(done.returncode, done.stdout, done.stderr)


def wait_until(condition: Callable[[], bool], seconds: float = 300.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, 'waited in vain'
        time.sleep(0.02)


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str], tmp_path: Path,
         monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Result]]:
    """Run the command in this process: the same function, without the start of a Python."""
    monkeypatch.chdir(tmp_path)
    handler = signal.getsignal(signal.SIGTERM)

    def run(*words: str) -> Result:
        try:
            status = main(list(words))
        except SystemExit as exit_:
            status = int(exit_.code or 0)
        captured = capsys.readouterr()
        return Result(status, captured.out, captured.err)

    yield run
    signal.signal(signal.SIGTERM, handler)


class Recorded(NamedTuple):
    folder: Path
    bag: Path
    result: Result


@pytest.fixture(scope='module')
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    folder = tmp_path_factory.mktemp('recorded')
    (folder / 'swing.yaml').write_text(SWING)
    result = command('run', 'swing.yaml', '--duration', str(DURATION), folder=folder)
    return Recorded(folder, folder / 'runs' / 'swing', result)


def swing_scene(**changes: object) -> Scene:
    return Scene.from_parameters({**yaml.safe_load(SWING)['/**']['ros__parameters'], **changes})


# Starting.

def test_help_lists_the_verbs_and_starts_without_a_compiler(tmp_path: Path) -> None:
    code = (
        'import sys\n'
        'from icofabric_sim.commands.main import main\n'
        'try:\n'
        '    main(sys.argv[1:])\n'
        'except SystemExit as end:\n'
        '    assert end.code == 0\n'
        'loaded = {"numba", "scipy", "numpy", "matplotlib", "rosbags"} & set(sys.modules)\n'
        'assert not loaded, loaded\n')
    for words in (['--help'], *([verb, '--help'] for verb in VERBS)):
        done = subprocess.run(
            [sys.executable, '-c', code, *words], capture_output=True, text=True, check=False,
            env={**os.environ, 'PYTHONPATH': str(Path(__file__).parents[2])}, timeout=60)
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith('usage: icofabric')
        if words == ['--help']:
            assert all(f'  {verb} ' in done.stdout for verb in VERBS)


def test_example_scenes_are_found_by_name_and_by_path() -> None:
    assert {'hanging_slab', 'free_slab', 'bias_column'} <= set(example_scenes())
    path = example_scenes()['free_slab']
    assert find_scene('free_slab') == path == find_scene(str(path))
    with pytest.raises(ValueError, match='hanging_slab'):
        find_scene('no_such_scene')


def test_example_scenes_are_found_in_an_installation(tmp_path: Path) -> None:
    # As colcon, pip and Debian lay it out: the package somewhere below PREFIX, scenes in share.
    source = Path(__file__).parents[2]
    for place in ('lib/python3.11/site-packages', 'local/lib/python3.12/dist-packages'):
        prefix = tmp_path / place.replace('/', '_')
        package = prefix / place / 'icofabric_sim'
        package.mkdir(parents=True)
        (prefix / 'share' / 'icofabric_sim' / 'config').mkdir(parents=True)
        (prefix / 'share' / 'icofabric_sim' / 'config' / 'mine.yaml').write_text('{}')
        where = Path(example_scenes.__code__.co_filename).relative_to(source)
        module = prefix / place / where
        module.parent.mkdir(parents=True)
        module.write_text((source / where).read_text())
        done = subprocess.run(
            [sys.executable, '-c',
             'import example_scenes; print(*example_scenes.example_scenes())'],
            cwd=module.parent, capture_output=True, text=True, check=True)
        assert done.stdout.split() == ['mine']


# icofabric run.

def test_run_records_to_a_fresh_folder_and_sums_up(recorded: Recorded) -> None:
    status, out, err = recorded.result
    assert status == 0, err
    for label in ('scene', 'method', 'step', 'threads', 'run', 'accuracy', 'growth', 'energy',
                  'momentum', 'strain', 'motion', 'overlap', 'bag', 'next'):
        assert re.search(f'^{label} ', out, re.MULTILINE), label
    assert '14 bodies, 36 connectors' in out
    assert re.search('^method +dop8: shells of neighbours are close', out, re.MULTILINE)
    assert re.search('^step .*: adapted to the error$', out, re.MULTILINE)
    assert f'{DURATION:g} s of simulated time' in out
    assert str(recorded.bag) in out and f'icofabric info {recorded.bag}' in out
    assert ESCAPE not in out + err and '\r' not in out + err


def test_a_second_run_takes_the_next_folder_and_the_same_bits(recorded: Recorded) -> None:
    result = command(
        'run', 'swing.yaml', '--duration', str(DURATION), '--storage', 'sqlite3',
        folder=recorded.folder)
    assert result.status == 0, result.err
    second = recorded.folder / 'runs' / 'swing_1'
    assert list(second.glob('*.db3'))
    with RecordedRun(recorded.bag) as one, RecordedRun(second) as two:
        for left, right in zip(one.poses(), two.poses(), strict=True):
            assert left.nanoseconds == right.nanoseconds
            np.testing.assert_array_equal(left.position, right.position)
            np.testing.assert_array_equal(left.orientation, right.orientation)


def test_bag_holds_the_states_of_a_direct_run_to_the_last_bit(recorded: Recorded) -> None:
    simulation = compile_scene(swing_scene())
    start = simulation.snapshot().position
    count = 0
    with RecordedRun(recorded.bag) as run:
        assert len(run.pose_times()) == round(60 * DURATION) + 1
        for frame in run.poses():
            simulation.advance_to(seconds(frame.nanoseconds))
            state = simulation.snapshot()
            np.testing.assert_array_equal(frame.position, state.position)
            np.testing.assert_array_equal(frame.orientation, state.orientation)
            count += 1
    assert count > 10
    assert np.abs(state.position - start).max() > 0.1 * simulation.scene.geometry.pitch


def test_energy_of_the_summary_is_that_of_the_simulation(recorded: Recorded) -> None:
    simulation = compile_scene(swing_scene())
    first = simulation.snapshot().energy['total']
    simulation.advance_to(DURATION)
    last = simulation.snapshot().energy['total']
    assert f'{first:.9g} J at the start, {last:.9g} J at the end' in recorded.result.out


@pytest.mark.parametrize('shown, is_estimated, said', [
    (30, False, '; beside them 30 (15.0 %) to show states'),
    (10, False, '; beside them 20 (10.0 %) to choose and judge steps and 10 (5.0 %) to show stat'),
    (0, True, '; beside them 30 (15.0 %) to estimate errors')])
def test_the_summary_says_what_evaluations_are_for(
        shown: int, is_estimated: bool, said: str) -> None:
    text = evaluations_text(200, 30, shown, is_estimated=is_estimated)
    assert text.startswith(f'200 evaluations of the forces{said}')
    assert 'beside' not in evaluations_text(200, 0, 0, is_estimated=is_estimated)


def test_accuracy_of_the_summary_is_that_of_the_simulation(recorded: Recorded) -> None:
    simulation = compile_scene(swing_scene())
    simulation.advance_to(DURATION)
    out, custom = recorded.result.out, summarise_bag(recorded.bag).custom
    assert f'{simulation.error_estimate:.2g} in total' in out
    assert f'{simulation.status.error_rate:.2g} per second at present' in out
    assert 'solver.tolerance is 1e-06 per second' in out
    assert float(custom['error_estimate']) == simulation.error_estimate > 0.0
    assert float(custom['error_rate']) == simulation.status.error_rate
    # States that were shown count beside the trajectory.
    assert int(custom['evaluation_count']) == simulation.status.evaluation_count > 0
    assert int(custom['estimation_count']) >= simulation.status.estimation_count
    assert int(custom['estimation_count']) >= int(custom['shown_count']) > 0
    text = evaluations_text(
        *(int(custom[f'{name}_count']) for name in ('evaluation', 'estimation', 'shown')),
        is_estimated=True)
    assert text in out and text in '\n'.join(summarise_bag(recorded.bag).lines())
    assert f'largest error {simulation.balance.worst:.1e} of' in out
    assert float(custom['balance_worst']) == simulation.balance.worst > 0.0
    assert custom['method_reason'] == simulation.status.method_reason in out
    growth = measure_growth(swing_scene(), DURATION)
    assert float(custom['growth']) == pytest.approx(growth.largest, rel=0.3)
    # Shells touch; a collision may be over between two looks at the disturbance.
    assert re.search(
        rf'grew (at least )?{re.escape(format(float(custom["growth"]), ".3g"))} times', out)


def test_verdict_of_a_calm_motion_is_a_bound_of_its_error(
        call: Callable[..., Result]) -> None:
    words = ['run', 'free_slab', *SMALL, '--duration', '0.25', '--no-record']
    result = call(*words)
    assert result.status == 0, result.err
    match = re.search(r'grew (\S+) times: the final error stays below (\S+) \(tol', result.out)
    assert match is not None, result.out
    assert float(match[2]) == pytest.approx(1e-6 * float(match[1]), rel=0.1)
    assert 'to measure the growth' in result.out
    without = call(*words, '--no-growth')
    assert re.search('^growth +not measured$', without.out, re.MULTILINE)
    assert 'to measure the growth' not in without.out
    # The companion changes nothing.
    same = [re.findall('^(?:energy|momentum|strain|motion).*', out, re.MULTILINE)
            for out in (result.out, without.out)]
    assert same[0] == same[1] and len(same[0]) == 4


def test_verdict_of_a_chaotic_motion_is_the_time_for_which_it_means_something(
        call: Callable[..., Result], tmp_path: Path) -> None:
    (tmp_path / 'swing.yaml').write_text(SWING)
    result = call(
        'run', 'swing.yaml', '--duration', '2', '--record', 'bag', '-p', 'contact.mode:=never')
    assert result.status == 0, result.err
    match = re.search(r'grew (\S+) times: the motion is sensitive', result.out)
    assert match is not None and float(match[1]) > 1e10, result.out
    until = re.search(r'is meaningful until t = (\S+) s', result.out)
    assert until is not None and 0.1 < float(until[1]) < 1.9
    told = call('info', 'bag').out
    assert f'grew {match[1]} times; the trajectory is meaningful until t = {until[1]} s' in told


@pytest.mark.parametrize('step, verdict', [(1e-4, ''), (5e-4, ': exceeded with the given step')])
def test_tolerance_is_reported_against_a_step_that_was_given(
        call: Callable[..., Result], step: float, verdict: str) -> None:
    result = call(
        'run', 'free_slab', *SMALL, '--duration', '0.1', '--no-record', '-p',
        f'solver.step:={step}', '-p', 'solver.method:=leapfrog', '-p',
        f'solver.tolerance:={1e-3 if not verdict else 1e-6}')
    assert result.status == 0, result.err
    assert re.search('^method +leapfrog: given as solver.method$', result.out, re.MULTILINE)
    line = re.search('^accuracy +error estimate ([^ ]+) in total.*$', result.out, re.MULTILINE)
    assert line is not None and float(line[1]) > 0.0
    assert ('exceeded' in line[0]) == bool(verdict) and verdict in line[0]
    assert '(errors, times growth)' in result.out


def test_free_fabric_keeps_its_momentum_in_the_summary(call: Callable[..., Result]) -> None:
    result = call('run', 'free_slab', *SMALL, '--duration', '0.5', '--no-record')
    assert result.status == 0, result.err
    match = re.search(r'relative change: linear (\S+), angular (\S+) \(', result.out)
    assert match is not None, result.out
    assert 0.0 <= float(match[1]) < 1e-12 and 0.0 <= float(match[2]) < 1e-12
    assert 'not recorded' in result.out


def test_no_record_leaves_nothing_behind(call: Callable[..., Result], tmp_path: Path) -> None:
    assert call('run', 'hanging_slab', *SMALL, '--duration', '0.01', '--no-record').status == 0
    assert not list(tmp_path.iterdir())


def test_record_path_of_the_scene_is_used(call: Callable[..., Result], tmp_path: Path) -> None:
    result = call('run', 'hanging_slab', *SMALL, '--duration', '0.01', '-p', 'record.path:=mine')
    assert result.status == 0, result.err
    assert (tmp_path / 'mine' / 'metadata.yaml').exists()


def test_overlap_is_said_once_and_in_the_summary(call: Callable[..., Result]) -> None:
    crash = ['-p', 'bodies.a.position:=[1.0, 0.0, 0.0]', '-p',
             'bodies.b.position:=[1.1, 0.0, 0.0]', '-p',
             'bodies.a.linear_velocity:=[1.0, 0.0, 0.0]', '-p', 'contact.stiffness:=1e4']
    result = call('run', 'free_slab', *SMALL, *crash, '--duration', '0.2', '--record', 'bag')
    assert result.status == 0
    assert result.err.count('body 14 and body 15 overlap by') == 1
    assert re.search('^overlap +body 14 and body 15 overlap', result.out, re.MULTILINE)
    assert 'body 14 and body 15' in summarise_bag('bag').overlap_text


def test_failure_exits_with_1_and_keeps_the_record(call: Callable[..., Result]) -> None:
    # Spinning bodies stretch the fabric until the given step is too long for it.
    result = call(
        'run', 'free_slab', *SMALL, '--duration', '3', '--record', 'bag', '-p',
        'initial_random.velocity_sigma:=10.0', '-p', 'solver.method:=srkn6', '-p',
        f'solver.step:={_just_stable_step()!r}', '-p', 'contact.mode:=never')
    assert result.status == 1, result.out + result.err
    assert 'has become unsafe at t = ' in result.err and 'bodies' in result.err
    assert 'smaller step' in result.err
    assert re.search('^stopped ', result.out, re.MULTILINE)
    kept, = re.findall('those of the last valid state, t = (.*) s', result.out)
    assert f'J at t = {kept} s' in result.out
    summary = summarise_bag('bag')
    assert 'has become unsafe' in summary.failure
    assert summary.last is not None and 0.0 < summary.last.time < 3.0


def _just_stable_step() -> float:
    parameters = load_parameter_file(find_scene('free_slab'))
    scene = Scene.from_parameters({
        **parameters, 'weave.size': [3, 3, 3], 'initial_random.velocity_sigma': 10.0,
        'solver.method': 'srkn6'})
    return 0.999 * compile_scene(scene).status.stability_limit


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_interrupted_run_keeps_a_whole_bag(tmp_path: Path, number: signal.Signals) -> None:
    process = subprocess.Popen(
        [*WITH_SIGINT, *COMMAND, 'run', 'free_slab', *SMALL, '-p', 'contact.mode:=never',
         '--duration', '1e6', '--record', 'bag'],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, 'PYTHONPATH': str(Path(__file__).parents[2])})
    try:
        wait_until(lambda: any(
            file.stat().st_size > 200_000 for file in tmp_path.glob('bag/*.mcap')))
        process.send_signal(number)
        out, err = process.communicate(timeout=300)
    finally:
        process.kill()
    assert process.returncode == 130, err
    assert 'Traceback' not in err
    assert re.search('^stopped +by the user at t = ', out, re.MULTILINE)
    summary = summarise_bag(tmp_path / 'bag')
    assert summary.custom['interrupted'] == 'true' and summary.finished
    assert summary.last is not None and summary.last.time > 0.0


def test_an_interrupt_in_a_text_that_is_executed_ends_with_130_too():
    # Python would end by SIGINT, although the interrupt was caught.
    process = subprocess.run([
        sys.executable, '-c', 'import sys; from icofabric_sim.commands import info, main; '
        "info.main = lambda arguments: exec('raise KeyboardInterrupt'); "
        "sys.exit(main.main(['info', 'hanging_slab']))"], capture_output=True, text=True)
    assert process.returncode == 130 and process.stderr == 'icofabric info: interrupted\n'


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_while_python_ends_leaves_the_status_that_was_decided(
        number: signal.Signals) -> None:
    # Modules are torn down after signals have their default action again.
    process = subprocess.run([
        sys.executable, '-c', 'import os, sys\n'
        'class Late:\n'
        f'    def __del__(self, kill=os.kill, own=os.getpid()): kill(own, {int(number)})\n'
        "late, sys.argv = Late(), ['icofabric', 'tables', '1']\n"
        'from icofabric_sim.commands.main import main\n'
        'sys.exit(main())'], capture_output=True, text=True, check=False)
    assert process.returncode == 0 and 'Table 1' in process.stdout
    assert process.stderr == ''


def test_an_interrupt_that_a_call_back_drops_is_raised_again() -> None:
    # The compiler calls Python back through ctypes, which drops what is raised there.
    process = subprocess.run([
        sys.executable, '-c', 'import ctypes, os, signal, sys, time\n'
        'from icofabric_sim.commands import info, main\n'
        'def interrupted():\n'
        '    os.kill(os.getpid(), signal.SIGINT)\n'
        '    time.sleep(10.0)\n'
        'def work(arguments):\n'
        '    ctypes.CFUNCTYPE(None)(interrupted)()\n'
        '    time.sleep(30.0)\n'
        '    return 0\n'
        'info.main = work\n'
        "sys.argv = ['icofabric', 'info', 'hanging_slab']\n"
        'sys.exit(main.main())'], capture_output=True, text=True, check=False)
    assert process.returncode == 130 and process.stderr == 'icofabric info: interrupted\n'


def test_a_program_that_calls_main_keeps_its_interrupts(
        capsys: pytest.CaptureFixture[str]) -> None:
    before = signal.getsignal(signal.SIGINT)
    assert main(['tables', '1']) == 0 and capsys.readouterr().out
    assert signal.getsignal(signal.SIGINT) is before is not signal.SIG_IGN
    assert sys.unraisablehook.__module__ != 'icofabric_sim.commands.main'


def test_nothing_that_takes_long_is_imported_before_interrupts_are_caught():
    code = (
        'import sys; import icofabric_sim.commands.main; '
        "print([name for name in sys.modules if name.startswith('icofabric_sim')])")
    loaded = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=True).stdout
    assert sorted(eval(loaded)) == ['icofabric_sim', 'icofabric_sim.commands', (
        'icofabric_sim.commands.main'), 'icofabric_sim.version']


def test_terminal_shows_a_bar_with_the_time_left(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    # So slow that nothing touches meanwhile: contact would have to be compiled.
    calm = ['-p', 'initial_random.velocity_sigma:=1e-3', '-p', 'initial_random.spin_sigma:=0.01']
    process = subprocess.Popen(
        [*WITH_SIGINT, *COMMAND, 'run', 'free_slab', *SMALL, *calm, '--duration', '1e5',
         '--no-record'],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=theirs,
        env={**os.environ, 'PYTHONPATH': str(Path(__file__).parents[2])})
    os.close(theirs)
    shown = bytearray()

    def read_terminal() -> None:
        # A terminal that nobody reads fills up, and the run would wait for room in it.
        try:
            while text := os.read(ours, 4096):
                shown.extend(text)
        except OSError:  # the other end was closed
            pass

    reader = threading.Thread(target=read_terminal, daemon=True)
    reader.start()
    try:
        end = time.monotonic() + 120.0
        while b'left' not in shown and time.monotonic() < end:
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=300)
    finally:
        process.kill()
        reader.join(10.0)
        os.close(ours)
    assert process.returncode == 130, shown.decode()
    assert re.search(r'\[[#.]+\] \S+ of 1e\+05 s, about \S+ (s|min|h) left', shown.decode())


# Cross-check.

def test_cross_check_reports_agreement_and_growth(
        call: Callable[..., Result], tmp_path: Path) -> None:
    (tmp_path / 'swing.yaml').write_text(SWING)
    result = call('run', 'swing.yaml', '--duration', '0.2', '--cross-check', '-p',
                  'solver.method:=leapfrog', '-p', 'contact.mode:=never')
    assert result.status == 0, result.out + result.err
    assert 'quaternions' in result.out and 'direction cosines' in result.out
    assert 'the formulations agree' in result.out
    rows = [line.split() for line in result.out.splitlines() if re.match(r' +\d+\.\d', line)]
    assert len(rows) > 5
    assert 0.0 < float(rows[-1][2]) < 1e-9 and 0.0 < float(rows[-1][3]) < 1e-9


def test_cross_check_refuses_what_needs_quaternions(
        call: Callable[..., Result], tmp_path: Path) -> None:
    (tmp_path / 'swing.yaml').write_text(SWING)
    result = call(
        'run', 'swing.yaml', '--duration', '0.01', '--cross-check', '-p', 'groups.g:=all', '-p',
        'loads.l.group:=g', '-p', 'loads.l.expression:=0, 0, -0.1 - z')
    assert result.status == 2 and 'loads.l.expression is given quaternions' in result.err
    assert 'Traceback' not in result.err


def test_cross_check_bound_covers_rounding_and_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = swing_scene(solver={'method': 'leapfrog'}, contact={'mode': 'never'})
    honest = cross_check(scene, 0.2)
    assert honest.agrees and not honest.ended
    assert honest.rows[-1].growth > 1.0
    # Far above rounding, and far below what any wrong term would do.
    assert honest.rows[-1].bound < 1e-6
    advance = Simulation.advance_to

    def wrong(self: Simulation, time: float) -> None:
        advance(self, time)
        state = self._driver.trajectory.state
        with_cosines = state.orientation.ndim == 3
        if with_cosines and time > 0.1 and not hasattr(self, 'spoilt'):
            self.spoilt = True  # type: ignore[attr-defined]
            # On the trajectory itself: set_state would choose the step again.
            state.angular_velocity[:, self.packed.layout.slot] += 1e-4
            self._cached = None

    monkeypatch.setattr(Simulation, 'advance_to', wrong)
    spoilt = cross_check(scene, 0.2)
    assert not spoilt.agrees
    assert all(row.agrees for row in spoilt.rows if row.time < 0.1)


def test_cross_check_ends_where_rounding_has_grown_too_far() -> None:
    # A fabric that folds up: its motion doubles a disturbance every few hundredths of a second.
    result = cross_check(swing_scene(contact={'mode': 'never'}), 20.0)
    assert 'has grown' in result.ended or 'round-off affected' in result.ended
    assert result.rows and result.agrees
    assert result.rows[-1].growth > 1e3 and DISTURBANCE < 1e-9


# Bad input: status 2, one line that names it, no traceback.

NAN_SCENE = '/**: {ros__parameters: {gravity: [0.0, 0.0, .nan]}}'
BAD_SCENES = {
    'malformed YAML': ('/**: {ros__parameters: [', 'scene.yaml'),
    'unknown parameter': ('/**: {ros__parameters: {weave: {sise: [3, 3, 3]}}}', 'weave.sise'),
    'NaN': (NAN_SCENE, 'gravity'),
    'wrong type': ('/**: {ros__parameters: {duration: soon}}', 'duration'),
    'L below its minimum': (
        '/**: {ros__parameters: {weave: {connector_length: 0.01}}}', 'weave.connector_length'),
    'thickness beyond eq 41': (
        '/**: {ros__parameters: {shell: {thickness: 0.5}}}', 'shell.thickness'),
    'empty weave': (
        '/**: {ros__parameters: {weave: {variant: 1, size: [1, 1, 1]}}}', 'weave.size'),
    'step beyond the limit': ('/**: {ros__parameters: {solver: {step: 0.5}}}', 'solver.step'),
}


def assert_bad_input(result: Result, named: str) -> None:
    assert result.status == 2, result
    assert result.out == ''
    lines = result.err.strip().splitlines()
    assert named in lines[-1] and lines[-1].startswith('icofabric')
    assert 'Traceback' not in result.err
    # Only the line that says what is being built may come before.
    assert all(re.match('scene: .* bodies', line) for line in lines[:-1])


@pytest.mark.parametrize('verb', [('run', '--duration', '1'), ('info', '--compile')])
@pytest.mark.parametrize('kind', BAD_SCENES)
def test_bad_scene(
        call: Callable[..., Result], tmp_path: Path, kind: str, verb: tuple[str, ...]) -> None:
    text, named = BAD_SCENES[kind]
    (tmp_path / 'scene.yaml').write_text(text)
    assert_bad_input(call(verb[0], 'scene.yaml', *verb[1:]), named)
    assert not (tmp_path / 'runs').exists()


@pytest.mark.parametrize('words, named', [
    (('run', 'missing.yaml', '--duration', '1'), 'missing.yaml'),
    (('run', 'hanging_slab'), '--duration'),
    (('run', 'hanging_slab', '--duration', 'nan'), 'duration'),
    (('run', 'hanging_slab', '--duration', '-1'), 'duration'),
    (('run', 'hanging_slab', '--duration', 'long'), '--duration'),
    (('run', 'hanging_slab', '--duration', '1', '-p', 'weave.size'), 'weave.size'),
    (('run', 'hanging_slab', '--duration', '1', '-p', 'gravity:=[0.0, .nan, 0.0]'), 'gravity'),
    (('run', 'hanging_slab', '--duration', '1', '--record', '.'), 'record.path'),
    (('run', 'hanging_slab', '--duration', '1', '--record', 'x', '--no-record'), '--no-record'),
    (('run', 'hanging_slab', '--duration', '1', '--storage', 'zip'), '--storage'),
    (('info', 'missing.yaml'), 'missing.yaml'),
    (('info', 'empty_folder'), 'empty_folder'),
    (('render', 'empty_folder'), 'empty_folder'),
    (('render', 'missing'), 'missing'),
    (('render', 'empty_folder', '--size', 'big'), '--size'),
    (('render', 'empty_folder', '--sheet', 'x.gif'), 'x.gif'),
    (('render', 'empty_folder', '--view', '0', '100'), '--view'),
    (('recover', 'missing'), 'missing'),
    (('recover', 'empty_folder'), 'empty_folder'),
    (('fly',), 'fly'),
    ((), 'VERB'),
])
def test_bad_words(
        call: Callable[..., Result], tmp_path: Path, words: tuple[str, ...], named: str) -> None:
    (tmp_path / 'empty_folder').mkdir()
    result = call(*words)
    assert result.status == 2, result
    assert named in result.err.strip().splitlines()[-1]
    assert 'Traceback' not in result.err and result.out == ''
    assert [entry.name for entry in tmp_path.iterdir()] == ['empty_folder']


def test_existing_record_is_never_touched(recorded: Recorded) -> None:
    before = {file: file.read_bytes() for file in recorded.bag.iterdir()}
    result = command(
        'run', 'swing.yaml', '--duration', '0.01', '--record', str(recorded.bag),
        folder=recorded.folder)
    assert result.status == 2 and 'record.path' in result.err and 'Traceback' not in result.err
    assert {file: file.read_bytes() for file in recorded.bag.iterdir()} == before


# icofabric info and recover.

def test_info_describes_a_scene(call: Callable[..., Result], tmp_path: Path) -> None:
    scene = swing_scene()
    simulation = compile_scene(scene)
    (tmp_path / 'swing.yaml').write_text(SWING)
    result = call('info', 'swing.yaml')
    assert result.status == 0, result.err
    for text in (
        f'mass {scene.shell.mass:.6g} kg', f'inertia {scene.shell.inertia:.6g} kg m^2',
        f'L = {scene.geometry.connector_length:.6g} m', f'W = {scene.geometry.pitch:.6g} m',
        f'{np.degrees(scene.geometry.connector_angle):.6g} degrees',
        f'wall: {len(scene.groups["wall"])} bodies (x_min)',
        '~/loads/tip', f'{simulation.status.largest_frequency:.6g} rad/s',
        f'{simulation.status.step:.6g} s',
        f'{simulation.status.method_name}: {simulation.status.method_reason}',
        f'error {simulation.status.error_rate:.2g} per second',
    ):
        assert text in result.out, text


def test_info_compiles_nothing_unless_it_is_asked_to(tmp_path: Path) -> None:
    (tmp_path / 'swing.yaml').write_text(SWING)
    cache = tmp_path / 'cache'
    result = command('info', 'swing.yaml', folder=tmp_path, NUMBA_CACHE_DIR=str(cache))
    assert result.status == 0 and 'compiling' not in result.err
    assert 'not compiled yet: add --compile' in result.out and 'mass' in result.out
    assert 'frequency' not in result.out and not list(cache.rglob('*.nbc'))


def test_info_describes_a_bag(recorded: Recorded, call: Callable[..., Result]) -> None:
    result = call('info', str(recorded.bag))
    assert result.status == 0, result.err
    assert result.out.splitlines() == summarise_bag(recorded.bag).lines()
    assert '14 bodies, 36 connectors' in result.out and 'closed properly' in result.out


def test_unfinished_bag_says_so_and_is_recovered(
        recorded: Recorded, call: Callable[..., Result], tmp_path: Path) -> None:
    killed = tmp_path / 'killed'
    killed.mkdir()
    whole = next(recorded.bag.glob('*.mcap'))
    # The end of the file is missing, as after a kill.
    (killed / whole.name).write_bytes(whole.read_bytes()[:-3000])
    for verb in ('info', 'render'):
        result = call(verb, 'killed')
        assert result.status == 1 and 'icofabric recover' in result.err
    result = call('recover', 'killed')
    assert result.status == 0, result.err
    assert 'the source was damaged' in result.out
    saved = tmp_path / 'killed_recovered'
    with BagReader(saved) as reader:
        assert reader.message_count > 10
    result = call('info', str(saved))
    assert result.status == 0 and '14 bodies' in result.out
    assert call('recover', 'killed', str(saved)).status == 2


def test_pipe_that_closes_early_is_quiet(recorded: Recorded) -> None:
    process = subprocess.Popen(
        [*COMMAND, 'info', str(recorded.bag)], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, 'PYTHONPATH': str(Path(__file__).parents[2])})
    assert process.stdout is not None and process.stderr is not None
    process.stdout.close()
    with process.stderr:
        assert process.stderr.read() == b''
    assert process.wait(timeout=300) == 0


def test_statics_says_where_a_scene_comes_to_rest(
        call: Callable[..., Result], tmp_path: Path) -> None:
    (tmp_path / 'swing.yaml').write_text(SWING)
    done = call('statics', 'swing.yaml', '--output', 'rest', '--picture', 'rest.png')
    assert done.status == 0, done.err
    assert 'equilibrium, stable' in done.out and 'pairs of shells' in done.out
    bodies = (tmp_path / 'rest' / 'bodies.csv').read_text().splitlines()
    assert len(bodies) == 15 and bodies[0].startswith('body,x_m,y_m,z_m,qx')
    borne = (tmp_path / 'rest' / 'reactions.csv').read_text().splitlines()
    assert borne[0].startswith('name,point_x_m,') and borne[0].endswith(',torque_z_nm')
    held = np.array([line.split(',')[8:11] for line in bodies[1:]], float).sum(axis=0)
    scene = Scene.from_parameters(load_parameter_file(tmp_path / 'swing.yaml'))
    assert held[2] == pytest.approx(14 * scene.shell.mass * 9.81, rel=1e-9)
    assert len((tmp_path / 'rest' / 'connectors.csv').read_text().splitlines()) == 37
    assert (tmp_path / 'rest.png').read_bytes().startswith(b'\x89PNG')
    early = call('statics', 'swing.yaml', '--steps', '2')
    assert early.status == 1 and 'not in equilibrium' in early.out and 'unbalanced' in early.out
    assert 'reason     the search took all of its 2 steps; allow more (--steps' in early.out
    bad = call('statics', 'swing.yaml', '--tolerance', '2')
    assert bad.status == 2 and 'tolerance' in bad.err
    falls = command('statics', 'free_slab', '-p', 'gravity:=[0.0, 0.0, -9.81]', folder=tmp_path)
    assert falls.status == 2 and 'supports' in falls.err and 'Traceback' not in falls.err


def test_modes_with_friction_at_rest_and_as_woven(call: Callable[..., Result]) -> None:
    small = ['hanging_slab', '-p', 'weave.size:=[2, 2, 2]', '-p', 'contact.friction:=0.3']
    rests = call('modes', *small, '--equilibrium')
    assert rests.status == 0 and 'verdict     equilibrium, stable' in rests.out, rests.err
    woven = call('modes', *small)
    assert woven.status == 0 and 'zero energy' in woven.out and 'verdict' not in woven.out


def test_statics_says_what_lies_around_shells(call: Callable[..., Result]) -> None:
    taut = ['--time', '2', '-p', 'connector.natural_length:=0.04']
    rests = call('statics', 'twisted_column', *taut)
    assert rests.status == 0 and 'equilibrium, stable' in rests.out
    assert 'around     4 connectors are wrapped over shells' in rests.out
    # As woven some push.
    jumps = call('statics', 'twisted_column', '--time', '2', '--steps', '50')
    assert jumps.status == 1 and 'in compression while wrapped over shells' in jumps.out
    for words in ('connector.stiffness_compression to 0.0', 'connector.natural_length'):
        assert words in jumps.out


def test_statics_says_where_shells_overlap_too_deeply(call: Callable[..., Result]) -> None:
    """And what it says to do mends it."""
    dense = ['-p', 'weave.size:=[3, 3, 3]', '-p', 'weave.connector_angle:=-0.3', '-p',
             'connector.natural_length:=0.0145']
    deep = call('statics', 'free_slab', *dense)
    said = re.search(
        r'more than the intended 1 % of a: .* contact.stiffness of ([0-9.e+]+) N/m', deep.out)
    assert deep.status == 0 and said is not None
    mended = call('statics', 'free_slab', *dense, '-p', f'contact.stiffness:={float(said[1])!r}')
    assert mended.status == 0 and 'intended' not in mended.out
    depth = re.search(r'deepest overlap ([0-9.e-]+) a', mended.out)
    assert depth is not None and 0.002 < float(depth[1]) < 0.01


def test_statics_and_curves_follow_friction_along_a_path(
    call: Callable[..., Result], tmp_path: Path
) -> None:
    folder = tmp_path / 'held'
    dense = ['-p', 'weave.size:=[4, 3, 3]', '-p', 'weave.connector_angle:=-0.36', '-p',
             'connector.natural_length:=0.0127', '-p', 'connector.bending_stiffness:=0.005']
    rubs = ['-p', 'contact.stiffness:=2e4', '-p', 'contact.friction:=0.3']
    done = call(
        'statics', 'free_slab', *dense, *rubs, '--load-steps', '3', '-p', 'groups.low:=z_min',
        '-p', 'supports.low.group:=low', '-p', 'groups.high:=z_max', '-p',
        'loads.push.group:=high', '-p', 'loads.push.force:=[0.05, 0.0, -0.2]')
    assert done.status == 0, done.out + done.err
    assert 'on a path of 3 load steps' in done.out
    scene = tmp_path / 'shell.yaml'
    scene.write_text(
        '/**:\n  ros__parameters:\n    weave: {size: [1, 1, 1]}\n'
        '    contact: {friction: 0.3, stiffness: 2.0e4}\n    groups: {it: all}\n'
        '    supports: {it: {group: it, fix: rotation}}\n'
        '    planes: {floor: {normal: [0.0, 0.0, 1.0], offset: -0.016181}}\n')
    incline = ['statics', str(scene), '-p', 'gravity:=[1.0, 0.0, -9.81]']
    held = call(*incline, '--output', str(folder), '--json')
    assert held.status == 0, held.out + held.err
    found = json.loads(held.out)
    assert found['friction_needed'] == pytest.approx(1.0 / 9.81, rel=1e-6)
    assert found['contacts']['margin'] == [pytest.approx(1.0 - 1.0 / 9.81 / 0.3, abs=1e-5)]
    assert 'normal_force_n,friction_n,margin' in (folder / 'contacts.csv').read_text()
    slides = call(*incline, '-p', 'gravity:=[3.2, 0.0, -9.81]')
    assert slides.status == 1 and 'slides' in slides.out
    curve = call(
        'elasticity', 'free_slab', *dense, *rubs, '--kinds', 'shear', '--strain', '0.012',
        '--cycles', '1')
    assert curve.status == 0, curve.out + curve.err
    assert 'dissipated' in curve.out


def test_friction_does_not_matter_where_nothing_touches(call: Callable[..., Result]) -> None:
    done = call(
        'modes', 'free_slab', '-p', 'weave.size:=[2, 2, 2]', '-p', 'contact.friction:=0.3', '-p',
        'contact.mode:=never')
    assert done.status == 0 and 'zero energy' in done.out
    periodic = call('elasticity', 'free_slab', '-p', 'contact.friction:=0.3', '--kinds')
    assert periodic.status == 0 and 'have zero energy' in periodic.out


def test_modes_lists_frequencies_and_mechanisms(
        call: Callable[..., Result], tmp_path: Path) -> None:
    (tmp_path / 'swing.yaml').write_text(SWING)
    done = call(
        'modes', 'swing.yaml', '--output', 'out', '--picture', 'm.png', '--bands', 'b.png')
    assert done.status == 0, done.err
    held = re.search(r'DOF +(\d+)', done.out)
    assert held is not None and 'states of self-stress' in done.out
    rates = (tmp_path / 'out' / 'frequencies.csv').read_text().splitlines()[1:]
    found = re.search(r'zero energy (\d+)', done.out)
    assert found is not None and int(held[1]) == len(rates) + int(found[1])
    largest = re.search(r'largest +([0-9.]+) rad/s', done.out)
    assert largest is not None
    assert float(largest[1]) == pytest.approx(float(rates[-1].split(',')[1]), rel=1e-5)
    assert (tmp_path / 'm.png').is_file() and (tmp_path / 'b.png').is_file()
    about = call('modes', 'swing.yaml', '--equilibrium', '--count', '3')
    assert about.status == 0 and 'equilibrium, stable' in about.out
    assert 'frequencies 3,' in about.out
    bad = call('modes', 'swing.yaml', '--count', '0')
    assert bad.status == 2 and 'count' in bad.err


def test_elasticity_prints_constants_and_curves(
        call: Callable[..., Result], tmp_path: Path) -> None:
    size = ['-p', 'weave.size:=[5, 3, 3]']
    done = call(
        'elasticity', 'stiff_cantilever', *size, '--points', '2', '--kinds', 'pull', '--output',
        'out', '--picture', 'e.png')
    assert done.status == 0, done.err
    assert "Young's modulus along xyz" in done.out and 'equilibrium, stable' in done.out
    rows = (tmp_path / 'out' / 'stiffness.csv').read_text().splitlines()
    assert len(rows) == 7 and float(rows[1].split(',')[1]) > 0.0
    curves = (tmp_path / 'out' / 'curves.csv').read_text().splitlines()
    assert len(curves) == 3 and 'middle_strain_yy' in curves[0] and 'end_force_x_n' in curves[0]
    assert {line.count('"') for line in curves} == {0, 2}  # verdicts have a comma
    moduli = (tmp_path / 'out' / 'moduli.csv').read_text().splitlines()
    assert moduli[0] == 'pull_along,young_modulus_pa,across,poisson_ratio,bulk_modulus_pa'
    assert len(moduli) == 11
    for words in ("Poisson's ratio ", 'bulk modulus ', 'strain yy', 'strain zz'):
        assert words in done.out
    assert (tmp_path / 'e.png').read_bytes().startswith(b'\x89PNG')
    alone = call(
        'elasticity', 'free_slab', '--kinds', '--direction', '1', '2', '0', '--output', 'plain')
    assert alone.status == 0 and '3 strains have zero energy' in alone.out
    for words in (
            "along xy: no Poisson's ratio: the load does work on the strain xy, which costs no "
            'energy',
            "along 1 2 0: Young's modulus 0 Pa",
            "along x: Poisson's ratio 0.30825 in all directions"):
        assert words in alone.out
    table = (tmp_path / 'plain' / 'directions.csv').read_text().splitlines()
    assert len(table) == 15 and 'least_shear_modulus_pa' in table[0]
    assert table[4].startswith('xy,') and table[4].endswith(
        ',"the load does work on the strain xy, which costs no energy"')
    assert call('elasticity', 'free_slab', '--kinds', '--direction', '0', '0', '0').status == 2
    # None where a pull meets nothing.
    assert re.search(r'along xy +0 Pa\n', alone.out)
    bad = call('elasticity', 'radial_arch', '--kinds')
    assert bad.status == 2 and 'weave.kind' in bad.err


def test_elasticity_bends_twists_and_presses(
        call: Callable[..., Result], tmp_path: Path) -> None:
    size = ['-p', 'weave.size:=[5, 3, 3]', '-p', 'connector.break_length_extension:=0.127']
    done = call(
        'elasticity', 'stiff_cantilever', *size, '--points', '2', '--kinds', 'hydrostatic',
        'bend', 'twist', '--about', 'z', '--angle', '-0.6', '--strain', '0.02', '--output', 'out',
        '--picture', 'e.png')
    assert done.status == 0, done.err
    for words in ('EI [N m^2]', 'GJ [N m^2]', 'hydrostatic', 'rotated against each other'):
        assert words in done.out
    rows = [line.split(',') for line in
            (tmp_path / 'out' / 'moment_curves.csv').read_text().splitlines()]
    assert rows[0][:4] == ['kind', 'angle_rad', 'moment_nm', 'rigidity_nm2'] and len(rows) == 5
    assert [row[0] for row in rows[1:]] == ['bend', 'bend', 'twist', 'twist']
    for _, angle, moment, rigidity, *_ in rows[1:]:
        assert float(angle) in (-0.3, -0.6) and float(moment) < 0.0 < float(rigidity)
    broken = (tmp_path / 'out' / 'breaks.csv').read_text().splitlines()
    assert broken[0] == 'kind,strain_or_angle_rad,connector,side,length_m,released_energy_j'
    assert len(broken) > 1 and all('extension' in line for line in broken[1:])
    assert (tmp_path / 'e.png').read_bytes().startswith(b'\x89PNG')
    loop = call(
        'elasticity', 'stiff_cantilever', *size, '--points', '2', '--kinds', 'pull', 'twist',
        '--angle', '0.1', '--strain', '0.04', '--cycles', '2', '--output', 'loop')
    assert loop.status == 0, loop.err
    assert re.search(r'pull +cycle 1: .* J dissipated; breaks released .* broken', loop.out)
    rows = [line.split(',') for line in
            (tmp_path / 'loop' / 'cycles.csv').read_text().splitlines()]
    assert rows[0] == ['kind', 'cycle', 'loading_work_j', 'unloading_work_j', 'loop_area_j',
                       'released_energy_j', 'energy_gain_j', 'broken']
    assert [row[:2] for row in rows[1:]] == [
        ['pull', '1'], ['pull', '2'], ['twist', '1'], ['twist', '2']]
    assert float(rows[1][4]) > 0.05 * float(rows[1][2]) and int(rows[1][7]) > 0
    assert abs(float(rows[3][4])) < 1e-9 * float(rows[3][2]) and rows[3][7] == '0'
    groups = ['-p', 'groups.own:=level 1', '-p', 'connector_groups.own.between:=own own', '-p',
              'connector_groups.own.stiffness:=300.0']
    own = call('elasticity', 'stiff_cantilever', *size, *groups, '--kinds', 'pull', '--points',
               '1', '--output', 'own', '--picture', 'own.png')
    assert own.status == 0, own.err
    assert 'no constants of a periodic fabric' in own.out
    written = {path.name for path in (tmp_path / 'own').iterdir()}
    assert 'curves.csv' in written and not written & {'stiffness.csv', 'moduli.csv'}
    assert (tmp_path / 'own.png').read_bytes().startswith(b'\x89PNG')
    arch = call('elasticity', 'radial_arch', '-p', 'weave.size:=[5, 3, 2]', '--kinds', 'pull',
                '--points', '1', '--json')
    assert arch.status == 0, arch.err
    assert json.loads(arch.out)['curves']['pull'][0]['stress'] > 10.0
    aside = call('elasticity', 'stiff_cantilever', *size, '--kinds', 'shear', 'inflation',
                 '--along', '0', '0', '-1', '--points', '1', '--json')
    assert aside.status == 0, aside.err
    curves = json.loads(aside.out)['curves']
    assert curves['shear'][0]['end_force'][2] < 0.0 < curves['inflation'][0]['stress']
    none = call('elasticity', 'stiff_cantilever', *size, *groups, '--kinds')
    assert none.status == 2 and 'connector_groups' in none.err
    for words, said in (
            (('--about', 'x'), 'about must be an axis'), (('--angle', '0'), '--angle'),
            (('--along', '1', '0', '0'), 'along applies to pull, push, shear only'),
            (('--angle', 'nan'), '--angle')):
        bad = call('elasticity', 'stiff_cantilever', *size, '--kinds', 'bend', *words)
        assert bad.status == 2 and said in bad.err


@pytest.mark.parametrize('length, words', [
    ('0.024', 'the equilibrium needs contact. The smallest natural length without contact is '
     '0.0250664748 m'),
    ('0.026', 'the free fabric is in equilibrium at weave.connector_angle -0.29066'), ('0.0', '')])
def test_elasticity_says_where_pre_tension_leads(
        call: Callable[..., Result], length: str, words: str) -> None:
    done = call('elasticity', 'free_slab', '--kinds', '-p', 'weave.connector_angle:=-0.3', '-p',
                f'connector.natural_length:={length}')
    assert done.status == 0 and words in done.out
    assert ('natural_length' in done.out) == bool(words)
    if 'in equilibrium at' in words:
        angle = re.search(r'in equilibrium at weave.connector_angle (\S+) rad', done.out)
        assert angle is not None
        there = call('elasticity', 'free_slab', '--kinds', '-p',
                     f'weave.connector_angle:={angle[1]}')
        assert 'stress as woven' in done.out and 'stress as woven' not in there.out


def test_fabrics_at_their_kink_say_so_and_give_both_branches(
        call: Callable[..., Result], tmp_path: Path) -> None:
    kinked = ['-p', 'weave.size:=[3, 2, 2]', '-p', 'connector.stiffness_compression:=200.0']
    done = call(
        'elasticity', 'stiff_cantilever', *kinked, '--kinds', 'pull', '--points', '1', '--output',
        'out', '--picture', 'e.png')
    assert done.status == 0, done.err
    for words in ('no single tangent', 'do not superpose', 'as if all connectors had k_e',
                  'as if all connectors had k_c', 'Pa in tension', '6 connectors: at the natural',
                  "Poisson's ratio along x: "):
        assert words in done.out
    moduli = re.findall(r' xx +([+-]) +([0-9.]+)', done.out)
    assert [sign for sign, _ in moduli] == ['+', '-']
    assert float(moduli[0][1]) > 8.0 * float(moduli[1][1])
    pull, push = (
        float((tmp_path / 'out' / f'stiffness_{name}.csv').read_text().splitlines()[1].split(
            ',')[1]) for name in ('pull', 'push'))
    assert pull > 8.0 * push
    assert len((tmp_path / 'out' / 'one_sided.csv').read_text().splitlines()) == 13
    modes = call(
        'modes', 'stiff_cantilever', *kinked, '--count', '2', '--output', 'modes', '--bands',
        'b.png')
    assert modes.status == 0, modes.err
    for words in ('no single frequency', 'do not superpose', 'pull, k_e', 'push, k_c', 'between'):
        assert words in modes.out
    rows = (tmp_path / 'modes' / 'frequency_bounds.csv').read_text().splitlines()[1:]
    for number, row in enumerate(rows):
        for name, value in zip(('push', 'pull'), row.split(',')[1:]):
            own = (tmp_path / 'modes' / f'frequencies_{name}.csv').read_text().splitlines()
            assert float(own[1 + number].split(',')[1]) == pytest.approx(float(value))
    rest = call('statics', 'free_slab', *kinked)
    assert rest.status == 0 and 'at a kink' in rest.out and 'do not superpose' in rest.out
    tense = call(
        'modes', 'stiff_cantilever', *kinked, '-p', 'connector.natural_length:=0.1', '--count',
        '2')
    assert tense.status == 0 and 'the first connector ' in tense.out
    assert 'at its kink' not in tense.out


def test_no_vibration_is_faster_than_the_bound_of_info_also_with_light_bodies() -> None:
    rates = []
    for mass in (0.0, 1e-6):
        scene = Scene.from_parameters({
            'weave.size': [3, 1, 2], 'groups.own': 'ids 0', 'masses.own.group': 'own',
            'masses.own.mass': mass})
        rates.append(frequency_bound(scene))
        assert solve_modes(scene).frequencies.max() <= rates[-1]
    assert rates[1] > 10.0 * rates[0]
