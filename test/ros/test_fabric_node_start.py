# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""How the node begins and ends: bad input, a duration, interrupts."""
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
import os
import signal
import subprocess
import sys
import time

import icofabric_sim as ico
from icofabric_sim.bag import BagReader
from icofabric_sim.messages import decode_diagnostic_array, WARN
import numpy as np
import pytest
from ros_helpers import Client, domain, NodeProcess, ROOT, SCENES, wait_for

MALFORMED = '/**:\n  ros__parameters:\n    gravity: [0.0, 0, -9.81]\n'

# Name: parameters, further arguments, and what the one line on stderr must hold.
BAD_STARTS = {
    'no such file': ({}, ['--params-file', 'nowhere.yaml'], ['nowhere.yaml', 'no such']),
    'malformed file': ({}, ['--params-file', '{folder}/bad.yaml'], ['bad.yaml', 'gravity']),
    'unknown name': ({'conector.stiffness': 1.0}, [],
                     ['conector.stiffness', 'connector.stiffness']),
    'NaN': ({'shell.density': '.nan'}, [], ['shell.density', 'finite', 'nan']),
    'type': ({'weave.size': 'big'}, [], ['weave.size', 'list of 3', 'big']),
    'out of range': ({'contact.friction': -1.0}, [], ['contact.friction', 'at least', '-1.0']),
    'too thick': ({'shell.thickness': 0.016}, [], ['shell.thickness', 'eq 41', '0.0151152']),
    'too short': ({'weave.connector_length': 0.02}, [],
                  ['weave.connector_length', '0.0250664', 'eq 54']),
    'no bodies': ({'weave.size': '[1, 1, 1]', 'weave.variant': 1}, [],
                  ['weave.size', 'no icosahedron']),
    'record path': ({'record.path': '{folder}'}, [], ['record.path', 'exists']),
    'step': ({'solver.step': 0.1}, [], ['solver.step', '0.1', 'stability limit']),
    'frame': ({'frame_id': '/map'}, [], ['frame_id', '/map', 'leading /']),
    'ROS argument': ({}, ['--paramsfile', 'x'], ['--paramsfile']),
}
if find_spec('tf2_msgs') is None:
    BAD_STARTS['frames'] = {'tf.group': 'all'}, [], ['tf.group', 'tf2_msgs', 'not installed']


@pytest.fixture(scope='module')
def bad_starts(tmp_path_factory):
    """Name: (exit status, output) of all of them, two at a time."""
    folder = tmp_path_factory.mktemp('starts')
    (folder / 'bad.yaml').write_text(MALFORMED)

    def fill(text):
        return str(text).replace('{folder}', str(folder))

    def start(item):
        number, (name, (parameters, arguments, _)) = item
        parameters = {key: fill(value) for key, value in parameters.items()}
        with NodeProcess(folder / f'{number}.log', *map(fill, arguments),
                         parameters=parameters) as node:
            return name, (node.wait(), node.log())

    with ThreadPoolExecutor(2) as pool:
        return dict(pool.map(start, enumerate(BAD_STARTS.items())))


@pytest.mark.parametrize('name', BAD_STARTS)
def test_bad_start(bad_starts, name):
    """Exit status 2 and one clear line, before anything runs."""
    status, output = bad_starts[name]
    lines = [line for line in output.splitlines() if line.startswith('fabric_node: ')]
    assert status == 2, output
    assert len(lines) == 1, output
    for word in BAD_STARTS[name][2]:
        assert word in lines[0]
    assert 'Traceback' not in output
    # Beside that line at most what rcl itself logs.
    assert all('[rcl]' in line for line in output.splitlines() if line not in lines), output


def test_stray_arguments_are_refused_and_help_ends():
    def start(*arguments):
        command = [sys.executable, '-m', 'icofabric_sim.ros.fabric_node', *arguments]
        return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)

    stray = start('config/hanging_slab.yaml')
    assert stray.returncode == 2 and 'config/hanging_slab.yaml' in stray.stderr
    assert '--params-file' in stray.stderr and 'Traceback' not in stray.stderr
    helped = start('--help')
    assert helped.returncode == 0 and '--params-file' in helped.stdout


def test_duration_ends_the_node(tmp_path):
    """Under another name and namespace; the bag holds the state at the very end."""
    other = tmp_path / 'other.yaml'
    other.write_text('/icofabric: {ros__parameters: {duration: 100.0}}\n')
    with NodeProcess(
            tmp_path / 'log', '-r', '__ns:=/lab', '-r', '__node:=left',
            '--params-file', str(other), scene=SCENES / 'free_slab.yaml',
            parameters={'duration': 0.21, 'record.path': tmp_path / 'bag'},
    ) as node:
        assert node.wait() == 0
        [warning] = node.lines('has no section for the node')
        assert '[WARN]' in warning and '/icofabric;' in warning and '/lab/left' in warning
        assert 'Traceback' not in node.log() and '[ERROR]' not in node.log()
    with BagReader(tmp_path / 'bag') as bag:
        poses = list(bag.messages(['/lab/left/poses']))
        assert [time for _, time, _ in poses] == [round(k * 1e9 / 60) for k in range(13)]
        assert bag.end_time == 210_000_000
        _, statuses = decode_diagnostic_array(list(bag.messages(['/diagnostics']))[-1][2])
        assert statuses[0].name == '/lab/left' and statuses[0].message == 'finished'
        assert bag.custom['failure'] == 'none'


@pytest.mark.parametrize('passed', [False, True])
def test_duration_that_is_set_live_ends_the_node(tmp_path, passed):
    with NodeProcess(tmp_path / 'log', parameters={
            'real_time_factor': 0.1, 'record.path': tmp_path / 'bag'}) as node, \
            Client(node) as client:
        client.wait_until(20_000_000)
        client.set(duration=1000.0)
        client.set(duration=0.0)
        now = client.clock
        end = 0.01 if passed else 1e-9 * now + 0.3
        client.set(duration=end)
        assert node.wait() == 0
        last = node.log().splitlines()[-1]
        assert f'done: the duration of {end:g} s has passed; recorded to ' in last
    with BagReader(tmp_path / 'bag') as bag:
        assert bag.end_time > now if passed else bag.end_time == round(1e9 * end)
        assert bag.custom['failure'] == 'none'


def test_interrupt_before_the_duration_has_passed(tmp_path):
    """Status 130 and a last line with the time; the bag is closed."""
    with NodeProcess(tmp_path / 'log', parameters={
            'duration': 100.0, 'record.path': tmp_path / 'bag'}) as node:
        wait_for(lambda: node.lines(node.READY), 'a node that runs', node=node)
        time.sleep(0.3)
        assert node.stop() == 130
        last = node.log().splitlines()[-1]
    assert f' s of 100 s; recorded to {tmp_path / "bag"}' in last
    with BagReader(tmp_path / 'bag') as bag:
        assert f'interrupted at t = {bag.end_time / 1e9:.9g} s' in last
        assert bag.end_time > 0


def test_listeners_get_the_last_state_before_the_node_ends(tmp_path):
    parameters = {'duration': 0.5, 'publish_rate': 10.0, 'contact.mode': 'never',
                  'start_paused': True}
    with NodeProcess(tmp_path / 'log', parameters=parameters) as node, Client(node) as client:
        poses = client.listen('~/poses')
        client.wait_for(lambda: poses, 'a first pose')
        client.pause(False)
        assert node.wait() == 0
        client.wait_for(lambda: poses[-1].nanoseconds == 500_000_000, 'the last pose', limit=10)


def test_second_signal_while_closing(tmp_path):
    """As when a launch passes on the Ctrl-C that the node has heard already."""
    with NodeProcess(tmp_path / 'log', parameters={'record.path': tmp_path / 'bag'}) as node:
        wait_for(lambda: sum(file.stat().st_size for file in tmp_path.glob('bag/*')) > 100_000,
                 'recording', node=node)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGINT):
            node.send(number)
        assert node.stop() == 0
    with BagReader(tmp_path / 'bag') as bag:
        assert bag.topics['/icofabric/poses'].message_count > 5


def test_interrupt_is_heard_while_steps_are_tiny(tmp_path):
    parameters = {'weave.size': '[2, 2, 2]', 'contact.mode': 'never', 'solver.step': 1e-7,
                  'connector.stiffness': 100.0}
    with NodeProcess(tmp_path / 'log', parameters=parameters) as node, Client(node) as client:
        client.next('~/poses')
        assert node.stop() == 0


@pytest.mark.parametrize('after', [0.05, 0.15, 0.3, 0.45, 0.6, 0.75])
def test_interrupt_during_the_start_leaves_no_traceback(tmp_path, after):
    """Whatever it is about to import then; where it runs already, it ends as it should."""
    with NodeProcess(tmp_path / 'log') as node:
        time.sleep(after)
        node.send(signal.SIGINT)
        wait_for(lambda: node.process.poll() is not None
                 or node.lines('KeyboardInterrupt') and node.lines('ready: '), 'end')
        if node.process.poll() is None:
            # Before the first line of the node Python drops an interrupt where it cannot raise it
            # (a callback of an import, a .pth file), says so, and goes on.
            node.send(signal.SIGINT)
            assert node.wait() == 0
            return
        status, log = node.process.returncode, node.log()
    if status == -signal.SIGINT and not log:
        return  # Python did not even handle signals yet.
    # Before its first line runs it is Python itself that is interrupted.
    begun = 'KeyboardInterrupt' not in log or '_node.py", line' in log and ', in main' in log
    assert not begun or status in (0, 130) and 'Traceback' not in log, log


def test_interrupt_while_the_node_is_being_built(tmp_path):
    """Nothing ran, so the status says interrupted; a compilation that breaks off is no error."""
    parameters = {'weave.size': '[90, 90, 90]'}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('NUMBA_CACHE_DIR', str(tmp_path / 'cache'))
        node = NodeProcess(tmp_path / 'log', parameters=parameters)
    with node, Client() as client:
        # It says what it waits for once it compiles, also on the graph.
        wait_for(lambda: node.lines('compiling'), 'compilation', node=node)
        status = client.health(lambda status: status.values['compiling'] != 'no')
        assert status.name == '/icofabric' and status.level == WARN
        assert status.message.startswith('compiling') and not node.lines(node.READY)
        assert node.stop() == 130
        assert not node.lines('Error')


BROKEN = """
from icofabric_sim.ros.fabric_node import main
from icofabric_sim.running.time_advance import TimeAdvance

def fail(self):
    raise MemoryError('nothing left')

TimeAdvance.advance = fail
main()
"""


def test_simulation_thread_that_dies_is_a_failure(tmp_path):
    command = [sys.executable, '-c', BROKEN, '--ros-args', '-p', f'record.path:={tmp_path}/bag']
    ended = subprocess.run(
        command, cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        timeout=120, env={**os.environ, 'ROS_DOMAIN_ID': str(domain())})
    assert ended.returncode == 1, ended.stdout
    assert 'the simulation thread has ended' in ended.stdout and 'nothing left' in ended.stdout
    with BagReader(tmp_path / 'bag') as bag:
        assert 'nothing left' in bag.custom['failure']


def test_unstable_run_ends_with_status_one(tmp_path):
    """
    A step that becomes unsafe as the slab stretches: time, bodies and the new limit are named.
    """
    limit = ico.compile_scene(ico.Scene.from_parameters({'weave': {'size': [3, 3, 3]}}))
    step = np.nextafter(limit.status.stability_limit, 0.0)
    parameters = {'weave.size': '[3, 3, 3]', 'solver.step': repr(float(step)), 'duration': 5.0,
                  'initial_random.velocity_sigma': 3.0, 'contact.mode': 'never',
                  'real_time_factor': 0.0, 'record.path': tmp_path / 'bag'}
    with NodeProcess(tmp_path / 'log', parameters=parameters) as node:
        assert node.wait() == 1
        lines = node.lines('the simulation has stopped')
        assert 'Traceback' not in node.log()
    assert len(lines) == 1
    for word in ('solver.step', 'unsafe', 't = ', 'bodies', 'stability limit is now'):
        assert word in lines[0]
    with BagReader(tmp_path / 'bag') as bag:
        assert 'solver.step' in bag.custom['failure']


@pytest.mark.parametrize('program', [
    ['-m', 'icofabric_sim.ros.fabric_node'], ['-m', 'icofabric_sim.ros.replay_node'],
    ['examples/first_light.py']])
def test_domain_that_does_not_exist_is_one_line(program):
    done = subprocess.run(
        [sys.executable, *program], capture_output=True, text=True, timeout=60, cwd=ROOT,
        env={**os.environ, 'ROS_DOMAIN_ID': '500'})
    assert done.returncode == 2
    line = done.stderr.splitlines()[-1]
    assert 'ROS_DOMAIN_ID is 500' in line and '0 to 232' in line
    assert 'RTPS' not in done.stderr
