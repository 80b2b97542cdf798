# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Plays a recorded run, and shows it in RViz if asked.

    ros2 launch icofabric_sim replay.launch.py bag:=runs/mine rate:=0.5 loop:=true rviz:=true
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

# Argument, its type, and what it means; an empty one leaves the default of replay_node.
OPTIONS = (
    ('fabric', str, 'name of the recorded node; empty: the first in the bag'),
    ('rate', float, 'ratio of recorded to wall time, 0: as fast as possible'),
    ('start_offset', float, 'how far into the bag to begin [s]'),
    ('loop', bool, 'true: start over at the end'),
    ('stay', bool, 'true: stand still at the end instead of ending'),
    ('start_paused', bool, 'true: wait for ~/pause or ~/step'),
    ('publish_clock', bool, 'false: leave /clock to another node'),
)
# What the RViz configuration shows, by the names that a fabric without a namespace has.
SHOWN = ('poses', 'connectors', 'icosahedra')


def generate_launch_description():
    arguments = [
        DeclareLaunchArgument('bag', description='bag folder, or a bare .mcap or .db3 file'),
        *[DeclareLaunchArgument(name, default_value='', description=description)
          for name, _, description in OPTIONS],
        DeclareLaunchArgument(
            'namespace', default_value='', description='namespace of the node icofabric'),
        DeclareLaunchArgument(
            'rviz', default_value='false', description='true: show the replay in RViz'),
    ]
    refuse_unknown_arguments(__file__, [argument.name for argument in arguments])
    return LaunchDescription([*arguments, OpaqueFunction(function=start_nodes)])


def start_nodes(context):
    share = Path(get_package_share_directory('icofabric_sim'))
    namespace = LaunchConfiguration('namespace').perform(context).strip('/')
    prefix = f'/{namespace}' if namespace else ''
    bag = Path(LaunchConfiguration('bag').perform(context)).expanduser()
    if not bag.exists():
        raise RuntimeError(
            f'bag:={bag} does not exist; give a bag folder, or a bag file; '
            '--show-args lists all arguments')
    given = {name: LaunchConfiguration(name).perform(context) for name, _, _ in OPTIONS}
    options = {
        name: typed_value(name, given[name], kind) for name, kind, _ in OPTIONS if given[name]}
    player = Node(
        package='icofabric_sim',
        executable='replay_node',
        name='icofabric',
        namespace=namespace,
        parameters=write_parameters(namespace, {'bag': str(bag.resolve()), **options}),
        output='screen',
        emulate_tty=True)
    view = Node(
        package='rviz2',
        executable='rviz2',
        name='rviz',
        namespace=namespace,
        arguments=['-d', str(share / 'rviz' / 'icofabric.rviz')],
        parameters=[{'use_sim_time': True}],
        remappings=[(f'/icofabric/{topic}', f'{prefix}/icofabric/{topic}') for topic in SHOWN],
        condition=IfCondition(LaunchConfiguration('rviz')))
    # A missing RViz ends the launch before the replay starts.
    return [view, player]
