# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Executable that plays a recorded run: `ros2 run icofabric_sim replay_node BAG`.

Slow imports follow after the signal handlers are installed.
"""

from pathlib import Path
import sys

from icofabric_sim.ros.start import (
    check_domain,
    end_process,
    import_without_gc,
    non_ros_arguments,
    StopSignals,
)
from icofabric_sim.version import __version__

_USAGE = """usage: replay_node BAG [--ros-args -p name:=value ...]
docs/replay.md describes the node; parameters:
"""


def main(argv: list[str] | None = None) -> int:
    """
    Run `replay_node`; end the process if `argv` is not given.

    Exit status:
        0 done, also by SIGINT or SIGTERM
        1 the bag is damaged or unfinished, or the simulation that continued the replay failed
        2 bad input
        130 interrupted before playback
    """
    if argv is None:
        end_process(main(sys.argv))
    signals = StopSignals(ends_process=argv is sys.argv)
    if set(argv[1:]) & {'-h', '--help', '--version'}:
        print(f'replay_node of icofabric_sim {__version__}: plays a recorded run\n{_usage()}')
        return 0
    with import_without_gc():
        from icofabric_sim.terminal import CommandFailed, InputError
        import rclpy
        from rclpy.impl.implementation_singleton import rclpy_implementation

    try:
        return _run(argv, signals)
    except CommandFailed as error:
        print(f'replay_node: {error}', file=sys.stderr)
        signals.ignore(1)
        return 1
    except (InputError, ValueError, rclpy_implementation.RCLError) as error:
        from icofabric_sim.ros.process import plain_reason

        print(f'replay_node: {plain_reason(error)}', file=sys.stderr)
        signals.ignore(2)
        return 2
    finally:
        signals.ignore()
        rclpy.try_shutdown()


def _run(arguments: list[str], signals: StopSignals) -> int:
    # Before ROS starts, because its errors do not name the parameter.
    own = non_ros_arguments(arguments[1:])
    if len(own) > 1 or own and own[0].startswith('-'):
        raise ValueError(
            f'{" ".join(own)!r}: replay_node takes one bag, and options after --ros-args; '
            'replay_node --help shows its parameters')
    check_domain()
    with import_without_gc():
        from icofabric_sim.commands.bags import bag_errors
        from icofabric_sim.parameters.file import check_ros_arguments
        from icofabric_sim.running.replay.replay_parameters import begin_of, judge_options

    notices: list[str] = []
    options = judge_options(
        check_ros_arguments(arguments[1:], notices=notices), own[0] if own else None)
    from icofabric_sim.running.replay.source import ReplaySource

    path = Path(options['bag']).expanduser()
    with bag_errors(path):
        source = ReplaySource(path, fabric=options['fabric'], inputs=options['inputs'])
    begin_of(options, source.start, source.end)
    with import_without_gc():
        from icofabric_sim.ros.process import start_ros
        from icofabric_sim.ros.replay import ReplayNode, run_replay

    start_ros(arguments, notices)
    node = ReplayNode(options, source)
    signals.record_only()
    return run_replay(node, options, signals)


def _usage() -> str:
    from icofabric_sim.running.replay.replay_parameters import OPTIONS

    width = max(map(len, OPTIONS))
    return _USAGE + '\n'.join(
        f'  {name:{width}}  {option.description} (default {option.default!r})'
        for name, option in OPTIONS.items())


if __name__ == '__main__':
    sys.exit(main())
