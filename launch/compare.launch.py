# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Simulates two fabrics side by side: /left/icofabric and /right/icofabric.

    ros2 launch icofabric_sim compare.launch.py left_variant:=0 right_variant:=1 rviz:=true

Both take the same scene unless told otherwise. The left one publishes /clock, and the right one
has the same target real-time factor. `distance` [m] puts the frame of the right one (right_world)
beside world, so that a viewer shows both.
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

SIDES = ('left', 'right')
# Argument after the name of the side, parameter that it sets, its type.
OVERRIDES = (
    ('kind', 'weave.kind', str),
    ('variant', 'weave.variant', int),
    ('stiffness', 'connector.stiffness', float),
    ('record', 'record.path', str),
)


def generate_launch_description():
    arguments = [
        DeclareLaunchArgument(
            'scene', default_value='hanging_slab',
            description='of both: example scene (a name in config/) or path of a parameter file'),
        DeclareLaunchArgument(
            'real_time_factor', default_value='',
            description='target real-time factor of both, 0: as fast as possible'),
        DeclareLaunchArgument(
            'distance', default_value='0.5',
            description='from world to right_world along x [m]; needs tf2_ros unless 0'),
        DeclareLaunchArgument(
            'rviz', default_value='false', description='true: show both in RViz'),
    ]
    for side in SIDES:
        arguments += [
            DeclareLaunchArgument(
                f'{side}_scene', default_value='', description=f'scene of the {side} one alone'),
            *[DeclareLaunchArgument(
                f'{side}_{name}', default_value='', description=f'{parameter} of the {side} one')
              for name, parameter, _ in OVERRIDES]]
    refuse_unknown_arguments(__file__, [argument.name for argument in arguments])
    return LaunchDescription([*arguments, OpaqueFunction(function=start_nodes)])


def find_scene(share, argument, scene):
    """Return the path of a scene's parameter file: an example scene's name goes before a path."""
    examples = {path.stem: path for path in sorted((share / 'config').glob('*.yaml'))}
    path = examples.get(scene, Path(scene).expanduser())
    if not path.is_file():
        raise RuntimeError(
            f'{argument}:={scene} is neither an example scene ({", ".join(examples)}) nor a file; '
            f'give one of these names or the path of a parameter file; --show-args '
            f'lists all arguments')
    return path.resolve()


def start_nodes(context):
    share = Path(get_package_share_directory('icofabric_sim'))

    def given(argument):
        return LaunchConfiguration(argument).perform(context)

    nodes = []
    for side in SIDES:
        own_scene = f'{side}_scene' if given(f'{side}_scene') else 'scene'
        own = {
            parameter: typed_value(f'{side}_{name}', given(f'{side}_{name}'), kind)
            for name, parameter, kind in OVERRIDES if given(f'{side}_{name}')}
        if given('real_time_factor'):
            own['real_time_factor'] = typed_value(
                'real_time_factor', given('real_time_factor'), float)
        if side == 'right':
            # Exactly one clock; and a frame of its own, which stands beside the other.
            own |= {'publish_clock': False, 'frame_id': 'right_world'}
        nodes.append(Node(
            package='icofabric_sim',
            executable='fabric_node',
            name='icofabric',
            namespace=side,
            parameters=[
                str(find_scene(share, own_scene, given(own_scene))),
                *write_parameters(side, own)],
            output='screen',
            emulate_tty=True,
            # The end of a long recording takes time to write.
            sigterm_timeout='30', sigkill_timeout='30'))
    frames = []
    if typed_value('distance', given('distance'), float) != 0.0:
        frames.append(Node(
            package='tf2_ros',
            executable='static_transform_publisher',
            name='right_world',
            arguments=['--x', given('distance'), '--frame-id', 'world', '--child-frame-id',
                       'right_world']))
    view = Node(
        package='rviz2',
        executable='rviz2',
        name='rviz',
        arguments=['-d', str(share / 'rviz' / 'compare.rviz')],
        parameters=[{'use_sim_time': True}],
        condition=IfCondition(LaunchConfiguration('rviz')))
    # A missing RViz or tf2_ros ends the launch before the fabrics start.
    return [view, *frames, *nodes]
