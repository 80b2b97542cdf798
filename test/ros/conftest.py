# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
What most tests of a node share: one node for the module, of its `SCENE`, and a client beside it.

A module that needs more of its client has a fixture of the same name, which takes this one.
"""
import pytest


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Folder of the module's files."""
    return tmp_path_factory.mktemp('node')


@pytest.fixture(scope='module')
def node(request, folder):
    """`fabric_node` with the module's `SCENE`; it must end well."""
    # Here, since it skips the test where rclpy is not installed.
    from ros_helpers import NodeProcess, write_scene
    scene = write_scene(folder / 'scene.yaml', request.module.SCENE)
    with NodeProcess(folder / 'log', scene=scene) as process:
        yield process
        assert process.stop() == 0


@pytest.fixture(scope='module')
def graph(node):
    """Client of the module's node."""
    from ros_helpers import Client
    with Client(node) as client:
        yield client


@pytest.fixture(scope='module')
def client(graph):
    """The same, where tests do not need the node in a known state."""
    return graph


@pytest.fixture
def bare_node():
    """An rclpy node in a context of its own, without a process of ours."""
    import rclpy
    from ros_helpers import domain
    context = rclpy.Context()
    context.init(domain_id=domain(3))
    node = rclpy.create_node('icofabric', context=context, enable_rosout=False)
    yield node
    node.destroy_node()
    context.try_shutdown()
