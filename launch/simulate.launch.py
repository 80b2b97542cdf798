# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Starts the simulation of one scene, and RViz beside it if asked.

    ros2 launch icofabric_sim simulate.launch.py scene:=hanging_slab rviz:=true

`scene` is an example scene (a name in config/) or the path of a parameter file.
"""
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from icofabric_sim.ros.launch_arguments import (
    refuse_unknown_arguments,
    typed_value,
    write_parameters,
)
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

# Argument, parameter that it sets, its type; an empty argument leaves the scene's own value.
OVERRIDES = (
    ('record', 'record.path', str),
    ('storage', 'record.storage', str),
    ('duration', 'duration', float),
    ('real_time_factor', 'real_time_factor', float),
    ('start_paused', 'start_paused', bool),
)
# What the RViz configuration shows, by the names that a fabric without a namespace has.
SHOWN = ('poses', 'connectors', 'icosahedra')


def generate_launch_description():
    arguments = [
        DeclareLaunchArgument(
            'scene', default_value='hanging_slab',
            description='example scene (a name in config/) or path of a parameter file'),
        DeclareLaunchArgument(
            'namespace', default_value='', description='namespace of the node icofabric'),
        DeclareLaunchArgument(
            'record', default_value='', description='new bag folder to record to'),
        DeclareLaunchArgument(
            'storage', default_value='', description='of the bag: mcap or sqlite3'),
        DeclareLaunchArgument(
            'duration', default_value='', description='simulated time to run [s], 0: no end'),
        DeclareLaunchArgument(
            'real_time_factor', default_value='',
            description='target real-time factor, 0: as fast as possible'),
        DeclareLaunchArgument(
            'start_paused', default_value='', description='true: wait for ~/pause or ~/step'),
        DeclareLaunchArgument(
            'log_level', default_value='info', description='of the node icofabric'),
        DeclareLaunchArgument(
            'rviz', default_value='false', description='true: show the fabric in RViz'),
    ]
    refuse_unknown_arguments(__file__, [argument.name for argument in arguments])
    return LaunchDescription([*arguments, OpaqueFunction(function=start_nodes)])


def find_scene(share, scene):
    """Return the path of a scene's parameter file: an example scene's name goes before a path."""
    examples = {path.stem: path for path in sorted((share / 'config').glob('*.yaml'))}
    path = examples.get(scene, Path(scene).expanduser())
    if not path.is_file():
        raise RuntimeError(
            f'scene:={scene} is neither an example scene ({", ".join(examples)}) nor a file; '
            f'give one of these names or the path of a parameter file; --show-args '
            f'lists all arguments')
    return path.resolve()


def start_nodes(context):
    share = Path(get_package_share_directory('icofabric_sim'))
    namespace = LaunchConfiguration('namespace').perform(context).strip('/')
    given = {name: LaunchConfiguration(name).perform(context) for name, _, _ in OVERRIDES}
    overrides = {
        parameter: typed_value(name, given[name], kind)
        for name, parameter, kind in OVERRIDES if given[name]}
    prefix = f'/{namespace}' if namespace else ''
    logger = f'{prefix}/icofabric'[1:].replace('/', '.')
    fabric = Node(
        package='icofabric_sim',
        executable='fabric_node',
        name='icofabric',
        namespace=namespace,
        parameters=[str(find_scene(share, LaunchConfiguration('scene').perform(context))),
                    *write_parameters(namespace, overrides)],
        arguments=['--ros-args', '--log-level',
                   [f'{logger}:=', LaunchConfiguration('log_level')]],
        output='screen',
        emulate_tty=True,
        # The end of a long recording takes time to write.
        sigterm_timeout='30', sigkill_timeout='30')
    view = Node(
        package='rviz2',
        executable='rviz2',
        name='rviz',
        namespace=namespace,
        arguments=['-d', str(share / 'rviz' / 'icofabric.rviz')],
        parameters=[{'use_sim_time': True}],
        remappings=[(f'/icofabric/{topic}', f'{prefix}/icofabric/{topic}') for topic in SHOWN],
        condition=IfCondition(LaunchConfiguration('rviz')))
    # A missing RViz ends the launch before the fabric starts.
    return [view, fabric]
