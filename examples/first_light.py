# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Run a node, load it from this second process, record a bag, and draw a picture; see `make run`.

    .venv/bin/python examples/first_light.py

No part is simulated or shortened: `fabric_node` runs in its own process, the load is a
WrenchStamped sent over ROS 2, and the summary and picture come from the recorded bag.
"""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import os
from pathlib import Path
import sys
import time

from geometry_msgs.msg import PoseArray, WrenchStamped
from icofabric_sim.bag.summary import summarise_bag
from icofabric_sim.messages import decode_pose_array
from icofabric_sim.messages.schedule import NANOSECONDS
from icofabric_sim.parameters.example_scenes import find_scene
from icofabric_sim.pictures.render import draw_sheet
from icofabric_sim.ros.robustness.node_watch import NodeStuck, watched_node
from icofabric_sim.ros.start import check_domain, READY
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_srvs.srv import SetBool

SCENE = 'hanging_slab'
DURATION_S = 4.0  # [s] of simulated time
LOAD_START_S, LOAD_END_S = 1.0, 1.5  # [s] of simulated time
LOAD_FORCE = (0.0, 2.0, 0.0)  # [N], shared out over the free side
CHANNEL = '/icofabric/loads/tip'
POSES = '/icofabric/poses'
FRAME_COUNT = 6
# Time [s] for the discovery of running nodes; the started node takes longer.
_DISCOVERY_S = 0.5


class LoadSender(Node):
    """Node that sends the load in time and monitors the poses."""

    def __init__(self, tip: list[int]) -> None:
        """Monitor the bodies `tip`."""
        super().__init__('first_light')
        self._tip = tip
        self._publisher = self.create_publisher(WrenchStamped, CHANNEL, 10)
        self.create_subscription(
            PoseArray, POSES, self._see, QoSProfile(depth=100), raw=True)
        self._resume = self.create_client(SetBool, '/icofabric/pause')
        self._resumed = False
        self.first_seen: float | None = None
        self.pushed = False
        self.pose_count = 0
        self._next_report = 0.0

    def listeners(self) -> int:
        """Count the subscribers of the load."""
        return int(self._publisher.get_subscription_count())

    def describe_discovery(self) -> str:
        """Describe the part of the started node that is discovered; empty if none is."""
        return f'{POSES} is found, but no pose has come' if self.count_publishers(POSES) else ''

    def find_others(self) -> str:
        """Return an error message if another fabric is in the graph already, otherwise ''."""
        end = time.monotonic() + _DISCOVERY_S
        while time.monotonic() < end and not self.count_publishers(POSES):
            rclpy.spin_once(self, timeout_sec=0.05)
        if not self.count_publishers(POSES):
            return ''
        return (
            f'another node already publishes {POSES}, and its poses would be taken for those of '
            f'this run: end it, or set another ROS_DOMAIN_ID (now '
            f'{os.environ.get("ROS_DOMAIN_ID", "0")})')

    def start_when_connected(self) -> None:
        """
        Start simulated time once both directions are connected, so that no message is missed.
        """
        if self._resumed or self.first_seen is None or not self.listeners():
            return
        if self._resume.service_is_ready():
            self._resume.call_async(SetBool.Request(data=False))
            self._resumed = True

    def push(self) -> None:
        """
        Send the force, stamped with the simulated time at which it starts, and later its end.
        """
        for when, force in ((LOAD_START_S, LOAD_FORCE), (LOAD_END_S, (0.0, 0.0, 0.0))):
            message = WrenchStamped()
            message.header.stamp.sec = int(when)
            message.header.stamp.nanosec = round((when - int(when)) * NANOSECONDS)
            message.wrench.force.x, message.wrench.force.y, message.wrench.force.z = force
            self._publisher.publish(message)
        self.pushed = True

    def _see(self, data: bytes) -> None:
        poses = decode_pose_array(data)
        self.pose_count += 1
        if self.first_seen is None:
            self.first_seen = time.monotonic()
        now = poses.nanoseconds / NANOSECONDS
        if not self.pushed and now >= LOAD_START_S - 0.5 and self.listeners():
            self.push()
        if self._resumed and now >= self._next_report:
            self._next_report += 0.5
            x, y, z = poses.values[self._tip, :3].mean(axis=0) * 1e3
            note = '  <- pushed' if LOAD_START_S <= now < LOAD_END_S else ''
            print(f'  t = {now:4.1f} s   free side at x {x:7.1f}  y {y:7.1f}  z {z:7.1f} mm{note}',
                  flush=True)


def main() -> int:
    """Run the demonstration; return the exit status."""
    parser = argparse.ArgumentParser(prog='make run', description=__doc__.strip().splitlines()[0])
    parser.add_argument('--output', default='', help='folder for the bag and the picture')
    options = parser.parse_args()
    try:
        check_domain()
    except ValueError as error:
        parser.error(str(error))
    folder = Path(options.output) if options.output else _fresh_folder(Path('runs'), 'first_light')
    folder.mkdir(parents=True, exist_ok=True)
    bag, picture = folder / 'bag', folder / 'moments.png'
    # A demonstration should not reach other robots on the network.
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    scene_file = find_scene(SCENE)
    print(f'1. fabric_node runs {scene_file} for {DURATION_S:g} s and records to {bag}')
    print(f'2. this process sends {LOAD_FORCE[1]:g} N on {CHANNEL} from t = {LOAD_START_S:g} s to '
          f'{LOAD_END_S:g} s\n', flush=True)
    status = _run_node(scene_file, bag)
    if status != 0:
        return status
    print('\n3. summary of the bag\n')
    summary = summarise_bag(bag)
    print('\n'.join('  ' + line for line in summary.lines()))
    print('\n4. drawing the picture from the bag', flush=True)
    title = f'{SCENE}, pushed from {LOAD_START_S:g} s to {LOAD_END_S:g} s'
    draw_sheet(bag, picture, moments=FRAME_COUNT, title=title)
    print(f'   {picture}\n')
    print(_next_steps(bag))
    return 0


def _run_node(scene_file: Path, bag: Path) -> int:
    from icofabric_sim.scene.scene import load_scene
    tip = load_scene(scene_file).groups['tip'].tolist()
    return follow_node([
        sys.executable, '-m', 'icofabric_sim.ros.fabric_node', '--ros-args',
        '--params-file', str(scene_file), '-p', f'duration:={DURATION_S}',
        '-p', f'record.path:={bag}', '-p', 'start_paused:=true'], tip)


def follow_node(command: Sequence[str], tip: list[int]) -> int:
    """Run a node to its end and load its bodies `tip`; return the exit status."""
    with _context():
        sender, started = LoadSender(tip), time.monotonic()
        with watched_node(command, READY) as node:
            others = sender.find_others()
            if others:
                print(others, file=sys.stderr)
                return 1
            while not node.has_ended:
                rclpy.spin_once(sender, timeout_sec=0.05)
                sender.start_when_connected()
                if sender.first_seen is None:
                    try:
                        node.judge(sender.describe_discovery)
                    except NodeStuck as reason:
                        print(reason, file=sys.stderr)
                        return 1
            code, was_ready = node.wait(), node.is_ready
    if code != 0:
        print(f'fabric_node ended with status {code}'
              + ('' if was_ready else ' before it was ready: its output above says why'),
              file=sys.stderr)
        return code if code > 0 else 1
    if sender.first_seen is None or not sender.pushed:
        print('the node ran, but no pose reached this process over ROS 2: does a firewall '
              'block the loopback interface?', file=sys.stderr)
        return 1
    print(f'\n   {sender.pose_count} poses received over ROS 2, the first '
          f'{sender.first_seen - started:.1f} s after the start')
    return 0


@contextmanager
def _context() -> Iterator[None]:
    rclpy.init()
    try:
        yield
    finally:
        rclpy.try_shutdown()


def _fresh_folder(parent: Path, name: str) -> Path:
    number = 1
    while (parent / f'{name}_{number}').exists():
        number += 1
    return parent / f'{name}_{number}'


def _next_steps(bag: Path) -> str:
    return f"""Next steps
  .venv/bin/icofabric info {bag}
  .venv/bin/icofabric film {bag} {bag.parent / 'film.gif'}
  .venv/bin/icofabric plot {bag} energy
  .venv/bin/icofabric run free_slab --duration 2
  .venv/bin/fabric_node --ros-args --params-file config/bias_column.yaml
      a node to drive from your own code: wrenches on /icofabric/loads/head, poses on
      /icofabric/poses, weave changes through its parameters; docs/ros.md shows all of it"""


if __name__ == '__main__':
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
