# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Small made-up recordings for tests of the replay: no simulation is needed for them."""
from icofabric_sim.bag import BagRecorder
from icofabric_sim.messages import (
    ClockBytes,
    DiagnosticArrayBytes,
    DiagnosticStatus,
    Float64MultiArrayBytes,
    MarkerAction,
    MarkerBytes,
    MarkerType,
    PoseArrayBytes,
    StringBytes,
    WARN,
    WrenchStampedBytes,
)

NODE = '/icofabric'
SECOND = 10**9
END = 2 * SECOND
STORAGES = ('mcap', 'sqlite3')
POSE_TIMES = [k * SECOND // 50 for k in range(101)]


def pose(nanoseconds, bodies=3):
    message = PoseArrayBytes('world', bodies)
    message.values[:] = nanoseconds / SECOND
    return message.stamped(nanoseconds)


def lines(nanoseconds, number, action=MarkerAction.ADD):
    message = MarkerBytes('world', 'connectors', number, MarkerType.LINE_LIST)
    message.point_count = 2
    return message.stamped(nanoseconds, action=action)


def text(words):
    return StringBytes(words).to_bytes()


def report(name, level, words):
    return DiagnosticArrayBytes().stamped(0, [DiagnosticStatus(level, name, words)])


def wrench(nanoseconds):
    return WrenchStampedBytes('').stamped(nanoseconds)


TYPES = {
    f'{NODE}/poses': PoseArrayBytes.TYPE,
    f'{NODE}/connectors': MarkerBytes.TYPE,
    f'{NODE}/energy': Float64MultiArrayBytes.TYPE,
    f'{NODE}/weave': StringBytes.TYPE,
    f'{NODE}/events': StringBytes.TYPE,
    f'{NODE}/loads/tip': WrenchStampedBytes.TYPE,
    f'{NODE}/wrench': WrenchStampedBytes.TYPE,
    '/clock': ClockBytes.TYPE,
    '/diagnostics': DiagnosticArrayBytes.TYPE,
    '/b/fabric/poses': PoseArrayBytes.TYPE,
    '/b/fabric/weave': StringBytes.TYPE,
    '/camera/words': StringBytes.TYPE,
}


def records():
    """Two seconds of a fabric that is rewoven after one; in order of time."""
    found = [
        (0, f'{NODE}/weave', text('first')),
        (0, '/b/fabric/weave', text('other')),
        (0, f'{NODE}/loads/tip', wrench(0)),
        (0, f'{NODE}/events', text('begin')),
        (SECOND, '/diagnostics', report(NODE, WARN, 'shells overlap')),
        (SECOND, f'{NODE}/weave', text('second')),
        (SECOND, f'{NODE}/connectors', lines(SECOND, 0, MarkerAction.DELETEALL)),
        (SECOND // 2, f'{NODE}/events', text('pause')),
        (SECOND // 4, f'{NODE}/wrench', wrench(SECOND // 4)),
        (123_456_789, '/camera/words', text('hello')),
    ]
    energy = Float64MultiArrayBytes(('kinetic',), (1,))
    for time_ in POSE_TIMES:
        energy.values[:] = time_
        found += [(time_, '/clock', ClockBytes().stamped(time_)),
                  (time_, f'{NODE}/poses', pose(time_)),
                  (time_, f'{NODE}/energy', energy.to_bytes()),
                  (time_, '/b/fabric/poses', pose(time_, 2))]
    for k in range(21):
        found += [(k * SECOND // 10, f'{NODE}/connectors', lines(k * SECOND // 10, number))
                  for number in (1, 2)]
    return sorted(found, key=lambda record: record[0])


RECORDS = records()


def write_bag(path, found=RECORDS, **options):
    with BagRecorder(path, custom={'scene': 'none'}, **options) as recorder:
        for time_, topic, data in found:
            recorder.add_topic(topic, TYPES[topic], latched=topic.endswith('/weave'), depth=7)
            recorder.write(topic, time_, data)
    assert recorder.error is None
    return path


def recorded(topic, *, after=-1):
    return [data for time_, name, data in RECORDS if name == NODE + topic[1:] and time_ > after]


def in_force(name, at):
    """The last messages of a topic at or before a time, found the plain way."""
    times = [time_ for time_, topic, _ in RECORDS if topic == name and time_ <= at]
    return [data for time_, topic, data in RECORDS
            if topic == name and times and time_ == times[-1]]
