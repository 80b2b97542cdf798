# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Bags written by our MCAP writer, by that of rosbags and by the mcap package; and messages as bytes.

A small scene first: how much is in the file after ten simulated seconds of poses of 20 bodies, at
a flush every 0.25 s where the writer can, before the bag is closed. Then processor time for poses
of 10,000 bodies, bytes ready, median of the rounds; and for making these bytes from an array.
Needs mcap, which comes with the tests.

    .venv/bin/python -m icofabric_validation.benchmarks.bag_writers [--rounds 5]
"""

import argparse
from collections.abc import Callable
import io
from pathlib import Path
import statistics
import tempfile
import time

from icofabric_sim.bag.bag_file import BagFile
from icofabric_sim.bag.storage import definition, quality_of_service, TopicEntry, typestore
from icofabric_sim.messages import PoseArrayBytes
from icofabric_validation.benchmarks.machine import describe_machine
from mcap.writer import Writer as PackageWriter
import numpy as np
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter

TOPIC, KIND = '/icofabric/poses', 'geometry_msgs/msg/PoseArray'
RATE, FLUSHED = 60, 15  # [Hz], messages between two flushes
Write = Callable[[int, bytes], object]


def ours(folder: Path) -> tuple[Write, Callable[[], object], Callable[[], object]]:
    """Return functions that write, flush and close a bag of this package."""
    bag = BagFile(folder, 'mcap')
    bag.add_topic(TopicEntry(
        TOPIC, KIND, definition(KIND), [quality_of_service(latched=False, depth=10)]))
    return (lambda stamp, data: bag.write(TOPIC, stamp, data), bag.flush, lambda: bag.close({}))


def of_rosbags(folder: Path) -> tuple[Write, Callable[[], object], Callable[[], object]]:
    """Return functions that write, flush and close a bag of rosbags, which has no flush."""
    bag = RosbagsWriter(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    bag.open()
    connection = bag.add_connection(TOPIC, KIND, typestore=typestore())
    return (lambda stamp, data: bag.write(connection, stamp, data), lambda: None, bag.close)


def of_mcap(folder: Path) -> tuple[Write, Callable[[], object], Callable[[], object]]:
    """Return functions that write, flush and close a file of the mcap package."""
    folder.mkdir()
    file = (folder / 'bag.mcap').open('wb', buffering=0)
    bag = PackageWriter(io.BufferedWriter(file))
    bag.start('ros2')
    schema = bag.register_schema(KIND, 'ros2msg', definition(KIND).text.encode())
    channel = bag.register_channel(TOPIC, 'cdr', schema)

    def close() -> None:
        bag.finish()
        file.close()

    return (lambda stamp, data: bag.add_message(channel, stamp, data, stamp), bag.flush, close)


def poses(bodies: int) -> PoseArrayBytes:
    """Return serialised poses of bodies at random positions."""
    message = PoseArrayBytes(frame_id='world', body_count=bodies)
    message.values[:] = np.random.default_rng(1).standard_normal((bodies, 7))
    return message


def measure(make: Callable[[Path], tuple[Write, Callable[[], object], Callable[[], object]]],
            large: bytes, small: bytes) -> tuple[int, float]:
    """Return bytes on disk before the end for the small scene, and seconds of a large message."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / 'small'
        write, flush, close = make(folder)
        for count in range(10 * RATE):
            write(count * 10**9 // RATE, small)
            if count % FLUSHED == 0:
                flush()
        there = sum(path.stat().st_size for path in folder.iterdir())
        close()
        write, flush, close = make(Path(name) / 'large')
        began = time.process_time()
        for count in range(100):
            write(count * 10**9 // RATE, large)
        close()
        return there, (time.process_time() - began) / 100


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--rounds', type=int, default=5)
    given = parser.parse_args()
    print(describe_machine())
    message = poses(10_000)
    large, small = bytes(message.stamped(0)), bytes(poses(20).stamped(0))
    rows = {make: [measure(make, large, small) for _ in range(given.rounds)]
            for make in (ours, of_rosbags, of_mcap)}
    for make, measured in rows.items():
        seconds = statistics.median(time_ for _, time_ in measured)
        print(f'{make.__name__:12} {measured[0][0]:8,} B there of {600 * len(small):,}, '
              f'{seconds * 1e3:.2f} ms for {len(large):,} B')
    # The same message from an array, by types of rosbags.
    store = typestore()
    pose, point = store.types['geometry_msgs/msg/Pose'], store.types['geometry_msgs/msg/Point']
    turn, header = store.types['geometry_msgs/msg/Quaternion'], store.types['std_msgs/msg/Header']
    values = np.array(message.values)
    stamp = store.types['builtin_interfaces/msg/Time'](0, 0)
    times: list[tuple[float, float]] = []
    for _ in range(given.rounds):
        began = time.process_time()
        built = store.types[KIND](header(stamp, 'world'), [
            pose(point(*row[:3]), turn(*row[3:])) for row in values.tolist()])
        data = store.serialize_cdr(built, KIND)
        middle = time.process_time()
        for _ in range(20):
            message.values[:] = values
            own = bytes(message.stamped(0))
        times.append((middle - began, (time.process_time() - middle) / 20))
    assert bytes(data) == own
    theirs, mine = (statistics.median(column) for column in zip(*times))
    print(f'bytes of 10,000 poses: ours {mine * 1e3:.3f} ms, rosbags {theirs * 1e3:.1f} ms, '
          f'{theirs / mine:.0f} times')


if __name__ == '__main__':
    main()
