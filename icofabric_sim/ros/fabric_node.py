# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Executable of the simulation: `ros2 run icofabric_sim fabric_node --ros-args --params-file F`.

Slow imports follow after the signal handlers are installed.
"""

import sys
from typing import TYPE_CHECKING

from icofabric_sim.ros.start import (
    check_domain,
    end_process,
    import_without_gc,
    non_ros_arguments,
    StopSignals,
)
from icofabric_sim.simulation.devices.launcher import (
    launched_ranks,
    lead_or_serve,
    require_alone,
)
from icofabric_sim.version import __version__

if TYPE_CHECKING:
    from icofabric_sim.simulation.devices.ranks import Ranks

_RANKS = '--ranks'
_USAGE = """usage: fabric_node [--ranks] [--ros-args --params-file SCENE -p name:=value ...]
example scenes are in config/; docs/parameters.md lists all parameters
--ranks: the MPI processes that were started together share the steps; the first one is the node
(mpiexec -n 4 fabric_node --ranks --ros-args ...); docs/howto/ranks.md"""


def main(argv: list[str] | None = None) -> int:
    """
    Run `fabric_node`; end the process if `argv` is not given.

    Exit status:
        0 done, also by SIGINT or SIGTERM if the scene has no `duration`
        1 the simulation failed
        2 bad input
        130 interrupted before the run, or before its `duration` had passed
    """
    if argv is None:
        end_process(main(sys.argv))
    signals = StopSignals(ends_process=argv is sys.argv)
    if set(argv[1:]) & {'-h', '--help', '--version'}:
        print(f'fabric_node of icofabric_sim {__version__}: icosahedral fabric\n{_USAGE}')
        return 0
    if _RANKS not in non_ros_arguments(argv[1:]):
        return _answered(argv, signals, None)
    argv = [argument for argument in argv if argument != _RANKS]
    try:
        ranks = launched_ranks()
    except ValueError as error:
        print(f'fabric_node: {error}', file=sys.stderr)
        return 2
    status = lead_or_serve('fabric_node', ranks, lambda: _answered(argv, signals, ranks))
    ranks.finalize()
    return status


def _answered(arguments: list[str], signals: StopSignals, ranks: 'Ranks | None') -> int:
    """Run the node; report invalid input in one line."""
    with import_without_gc():
        import rclpy
        from rclpy.impl.implementation_singleton import rclpy_implementation

    try:
        return _run(arguments, signals, ranks)
    except (ValueError, rclpy_implementation.RCLError) as error:
        from icofabric_sim.ros.process import plain_reason

        print(f'fabric_node: {plain_reason(error)}', file=sys.stderr)
        signals.ignore(2)
        return 2
    finally:
        signals.ignore()
        rclpy.try_shutdown()


def _run(arguments: list[str], signals: StopSignals, ranks: 'Ranks | None') -> int:
    if ranks is None:
        require_alone()
    # Before ROS starts, because its errors do not name the parameter.
    own = non_ros_arguments(arguments[1:])
    if own:
        raise ValueError(f'{" ".join(own)!r} is not an argument of fabric_node\n{_USAGE}')
    check_domain()
    with import_without_gc():
        from icofabric_sim.parameters.file import check_ros_arguments
        from icofabric_sim.ros.ros_parameters import make_start_parameters

    notices: list[str] = []
    parameters = make_start_parameters(check_ros_arguments(arguments[1:], notices=notices))
    with import_without_gc():
        from icofabric_sim.ros.process import Presence, start_ros

    start_ros(arguments, notices)
    presence = Presence()
    with import_without_gc():
        from icofabric_sim.ros.fabric import FabricNode, run_node

    return run_node(
        FabricNode(parameters, on_built=signals.record_only, presence=presence, ranks=ranks),
        signals)


if __name__ == '__main__':
    sys.exit(main())
