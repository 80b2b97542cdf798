# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Executable of the viewer: `ros2 run icofabric_sim viewer_node` beside a fabric or a replay.

Slow imports follow after the signal handlers are installed.
"""

import sys

from icofabric_sim.ros.start import (
    check_domain,
    end_process,
    import_without_gc,
    non_ros_arguments,
    StopSignals,
)
from icofabric_sim.version import __version__

_USAGE = """usage: viewer_node [--ros-args -p fabric:=/icofabric -p port:=8080 ...]
docs/viewer.md describes the page and who may open it"""


def main(argv: list[str] | None = None) -> int:
    """
    Run `viewer_node`; end the process if `argv` is not given.

    Exit status:
        0 done, also by SIGINT or SIGTERM
        2 bad input, or the pip extra `viewer` is not installed
        130 interrupted before the page was open
    """
    if argv is None:
        end_process(main(sys.argv))
    signals = StopSignals(ends_process=argv is sys.argv)
    if set(argv[1:]) & {'-h', '--help', '--version'}:
        print(f'viewer_node of icofabric_sim {__version__}: a fabric in a browser\n{_USAGE}')
        return 0
    with import_without_gc():
        import rclpy
        from rclpy.impl.implementation_singleton import rclpy_implementation

    try:
        own = non_ros_arguments(argv[1:])
        if own:
            raise ValueError(f'{" ".join(own)!r} is not an argument of viewer_node\n{_USAGE}')
        check_domain()
        with import_without_gc():
            from icofabric_sim.parameters.file import check_ros_arguments
            from icofabric_sim.ros.process import start_ros
            from icofabric_sim.ros.viewer import run_viewer, VIEWER, ViewerNode
        notices: list[str] = []
        check_ros_arguments(argv[1:], node_name=VIEWER, notices=notices)
        start_ros(argv, notices)
        node = ViewerNode()
        signals.record_only()
        return run_viewer(node, signals)
    except (ValueError, rclpy_implementation.RCLError) as error:
        from icofabric_sim.ros.process import plain_reason

        print(f'viewer_node: {plain_reason(error)}', file=sys.stderr)
        signals.ignore(2)
        return 2
    finally:
        signals.ignore()
        rclpy.try_shutdown()


if __name__ == '__main__':
    sys.exit(main())
