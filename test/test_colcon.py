# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The tree builds with colcon as a ROS package, and what colcon installs runs."""
import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys
import time

import pytest

ROOT = Path(__file__).resolve().parents[1]
PARTS = ('package.xml', 'pyproject.toml', 'setup.py', 'setup.cfg', 'LICENSE', 'resource',
         'icofabric_sim', 'launch', 'config', 'rviz', 'validation')
COLCON = shutil.which('colcon', path=f'{Path(sys.executable).parent}:{os.environ["PATH"]}')

pytestmark = pytest.mark.skipif(
    COLCON is None, reason='colcon is not installed (requirements-test.txt lists it)')


@pytest.fixture(scope='module')
def install(tmp_path_factory):
    """The install folder of a workspace with only the two packages of this tree in it."""
    workspace = tmp_path_factory.mktemp('workspace')
    source = workspace / 'src' / 'icofabric_sim'
    source.mkdir(parents=True)
    for part in PARTS:
        if (ROOT / part).is_dir():
            shutil.copytree(ROOT / part, source / part,
                            ignore=shutil.ignore_patterns('__pycache__'))
        else:
            shutil.copy(ROOT / part, source / part)
    # colcon looks for no packages below a package.
    base_paths = ['--base-paths', 'src', 'src/icofabric_sim/validation']
    assert packages_of(workspace) == ['icofabric_sim']
    assert packages_of(workspace, *base_paths) == ['icofabric_sim', 'icofabric_validation']
    # Outside ROS colcon is not given the end of the prefix; and no message on the desktop.
    done = subprocess.run(
        [COLCON, 'build', *base_paths,
         '--event-handlers', 'desktop_notification-', 'console_direct+'],
        cwd=workspace, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    return workspace / 'install'


def packages_of(folder, *words):
    """Return the names of the packages that colcon finds."""
    done = subprocess.run([COLCON, 'list', '--names-only', *words], cwd=folder, text=True,
                          capture_output=True, check=True, timeout=60)
    return sorted(done.stdout.split())


def sourced(install, command, **words):
    """
    Start a shell command as after `source install/setup.bash`, in another folder than the tree.
    """
    return subprocess.Popen(
        ['bash', '-c', f'source "{install}/setup.bash" && {command}'], cwd=install.parent,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        # What runs in the background of a script ignores it, and so would all that it starts.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler), **words)


def output_of(install, command):
    process = sourced(install, command)
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 0, output
    return output


def test_installed_files(install):
    prefix = install / 'icofabric_sim'
    for name in ('lib/icofabric_sim/fabric_node', 'lib/icofabric_sim/icofabric',
                 'share/ament_index/resource_index/packages/icofabric_sim',
                 'share/icofabric_sim/package.xml',
                 'share/icofabric_sim/launch/simulate.launch.py',
                 'share/icofabric_sim/config/hanging_slab.yaml',
                 'share/icofabric_sim/rviz/icofabric.rviz',
                 # Only a package that colcon takes for a ROS package gets this hook.
                 'share/icofabric_sim/hook/ament_prefix_path.sh'):
        assert (prefix / name).is_file(), name
    for name in ('fabric_node', 'icofabric'):
        assert os.access(prefix / 'lib' / 'icofabric_sim' / name, os.X_OK)


def test_installed_module_is_the_one_that_runs(install):
    output = output_of(
        install, f'"{sys.executable}" -c "import icofabric_sim; print(icofabric_sim.__file__)"; '
                 'printf "%s\\n" "$AMENT_PREFIX_PATH"')
    module, prefix_path = output.splitlines()
    assert Path(module).is_relative_to(install / 'icofabric_sim')
    assert str(install / 'icofabric_sim') in prefix_path.split(':')


def test_installed_command(install):
    output = output_of(install, 'install/icofabric_sim/lib/icofabric_sim/icofabric --help')
    for verb in ('run', 'info', 'render'):
        assert verb in output
    # A verb of the other package.
    listed = output_of(install, 'install/icofabric_sim/lib/icofabric_sim/icofabric stress --list')
    assert 'leapfrog' in listed
    assert (install / 'icofabric_validation/share/icofabric_validation/package.xml').is_file()


def test_installed_node_publishes(install, monkeypatch):
    rclpy = pytest.importorskip('rclpy')
    from geometry_msgs.msg import PoseArray
    from rclpy.executors import SingleThreadedExecutor
    from ros_helpers import domain

    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain()))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    # The first pose is the woven state: waiting for a compiler would show nothing more here.
    monkeypatch.setenv('NUMBA_DISABLE_JIT', '1')
    context = rclpy.Context()
    context.init(domain_id=domain())
    node = rclpy.create_node('listener', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    received = []
    node.create_subscription(PoseArray, '/icofabric/poses', received.append, 10)
    process = sourced(
        install, 'exec install/icofabric_sim/lib/icofabric_sim/fabric_node --ros-args '
                 '--params-file install/icofabric_sim/share/icofabric_sim/config/'
                 'hanging_slab.yaml')
    try:
        deadline = time.monotonic() + 60
        while not received and process.poll() is None and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=0.1)
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=30)
    finally:
        process.kill()
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()
    assert received, output
    assert len(received[0].poses) > 8
    assert received[0].header.frame_id == 'world'
    assert process.returncode in (0, 130), output
    assert 'Traceback' not in output
