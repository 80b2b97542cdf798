# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
The main job of `make run`: a node, a push from this second process, a bag, a summary, a picture.

Every part is the real one: `fabric_node` runs in a process of its own, the push is a WrenchStamped
sent over ROS 2, the summary and the picture are read back from the recorded bag.
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
from icofabric_sim.parameters.ready_scenes import find_scene
from icofabric_sim.pictures.render import draw_sheet
from icofabric_sim.ros.node_watch import NodeStuck, watched_node
from icofabric_sim.ros.start import check_domain, READY
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_srvs.srv import SetBool

SCENE = 'hanging_slab'
DURATION = 4.0  # [s] of simulated time
PUSH_START, PUSH_END = 1.0, 1.5  # [s] of simulated time
PUSH_FORCE = (0.0, 2.0, 0.0)  # [N], shared out over the free side
CHANNEL = '/icofabric/loads/tip'
POSES = '/icofabric/poses'
MOMENTS = 6
# Time [s] in which nodes that run already are found; the own one takes longer to start.
_LOOK_AROUND = 0.5


class Pusher(Node):
    """Sends the push in time, and watches the poses answer."""

    def __init__(self, tip: list[int]) -> None:
        """Watch the bodies `tip`."""
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
        """Count the subscribers of the push."""
        return int(self._publisher.get_subscription_count())

    def seen_of_node(self) -> str:
        """What of the node can be seen from here; '': nothing."""
        return f'{POSES} is seen, but no pose has come' if self.count_publishers(POSES) else ''

    def find_others(self) -> str:
        """What is wrong where another fabric is in the graph already; '': nothing."""
        end = time.monotonic() + _LOOK_AROUND
        while time.monotonic() < end and not self.count_publishers(POSES):
            rclpy.spin_once(self, timeout_sec=0.05)
        if not self.count_publishers(POSES):
            return ''
        return (
            f'another node publishes {POSES} already, and its poses would be taken for those of '
            f'this run: end it, or set another ROS_DOMAIN_ID (now '
            f'{os.environ.get("ROS_DOMAIN_ID", "0")})')

    def start_when_met(self) -> None:
        """
        Let simulated time run once both directions are connected: nothing of the run is missed.
        """
        if self._resumed or self.first_seen is None or not self.listeners():
            return
        if self._resume.service_is_ready():
            self._resume.call_async(SetBool.Request(data=False))
            self._resumed = True

    def push(self) -> None:
        """Send the force with the simulated time at which it begins, and its end the same way."""
        for when, force in ((PUSH_START, PUSH_FORCE), (PUSH_END, (0.0, 0.0, 0.0))):
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
        if not self.pushed and now >= PUSH_START - 0.5 and self.listeners():
            self.push()
        if self._resumed and now >= self._next_report:
            self._next_report += 0.5
            x, y, z = poses.values[self._tip, :3].mean(axis=0) * 1e3
            note = '  <- pushed' if PUSH_START <= now < PUSH_END else ''
            print(f'  t = {now:4.1f} s   free side at x {x:7.1f}  y {y:7.1f}  z {z:7.1f} mm{note}',
                  flush=True)


def main() -> int:
    """Run the demonstration; returns the exit status."""
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
    # A demonstration should meet no other robot on the network.
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    scene_file = find_scene(SCENE)
    print(f'1. fabric_node runs {scene_file} for {DURATION:g} s and records to {bag}')
    print(f'2. this process sends {PUSH_FORCE[1]:g} N on {CHANNEL} from t = {PUSH_START:g} s to '
          f'{PUSH_END:g} s\n', flush=True)
    status = _run_node(scene_file, bag)
    if status != 0:
        return status
    print('\n3. what the bag holds\n')
    summary = summarise_bag(bag)
    print('\n'.join('  ' + line for line in summary.lines()))
    print('\n4. drawing the picture from the bag', flush=True)
    title = f'{SCENE}, pushed from {PUSH_START:g} s to {PUSH_END:g} s'
    draw_sheet(bag, picture, moments=MOMENTS, title=title)
    print(f'   {picture}\n')
    print(_what_next(bag))
    return 0


def _run_node(scene_file: Path, bag: Path) -> int:
    from icofabric_sim.scene.scene import load_scene
    tip = load_scene(scene_file).groups['tip'].tolist()
    return follow_node([
        sys.executable, '-m', 'icofabric_sim.ros.fabric_node', '--ros-args',
        '--params-file', str(scene_file), '-p', f'duration:={DURATION}',
        '-p', f'record.path:={bag}', '-p', 'start_paused:=true'], tip)


def follow_node(command: Sequence[str], tip: list[int]) -> int:
    """Run a node to its end, and push its bodies `tip`; returns the exit status."""
    with _context():
        pusher, started = Pusher(tip), time.monotonic()
        with watched_node(command, READY) as node:
            others = pusher.find_others()
            if others:
                print(others, file=sys.stderr)
                return 1
            while not node.has_ended:
                rclpy.spin_once(pusher, timeout_sec=0.05)
                pusher.start_when_met()
                if pusher.first_seen is None:
                    try:
                        node.judge(pusher.seen_of_node)
                    except NodeStuck as reason:
                        print(reason, file=sys.stderr)
                        return 1
            code, was_ready = node.wait(), node.is_ready
    if code != 0:
        print(f'fabric_node ended with status {code}'
              + ('' if was_ready else ' before it was ready: its output above says why'),
              file=sys.stderr)
        return code if code > 0 else 1
    if pusher.first_seen is None or not pusher.pushed:
        print('the node ran, but its poses did not reach this process over ROS 2: is a firewall '
              'in the way of the loopback interface?', file=sys.stderr)
        return 1
    print(f'\n   {pusher.pose_count} poses came over ROS 2, the first '
          f'{pusher.first_seen - started:.1f} s after the start')
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


def _what_next(bag: Path) -> str:
    return f"""What next
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
