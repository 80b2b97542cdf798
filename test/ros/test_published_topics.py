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
"""Another process sees the bodies that a node is told to publish, and which they are."""

import icofabric_sim as ico
import numpy as np
from ros_helpers import Client, NodeProcess, SCENES

CHOSEN = {'publish.group': 'tip', 'publish.stride': 2}


def test_poses_and_numbers_of_the_chosen_bodies_arrive(tmp_path):
    path, at_rest = SCENES / 'hanging_slab.yaml', {**CHOSEN, 'gravity': [0.0, 0.0, 0.0]}
    scene = ico.load_scene(path).with_changes(at_rest)
    with NodeProcess(tmp_path / 'log', scene=path, parameters=at_rest, offset=3) as node, (
            Client(node, offset=3)) as client:
        poses = client.next('~/poses').values
        assert len(poses) == len(scene.published_bodies) < scene.body_count
        numbers = client.next('~/bodies', latched=True).values
        assert np.array_equal(numbers, scene.published_bodies)
        start = scene.position[scene.published_bodies]
        # Nothing moves them, however late the message is.
        assert np.abs(poses[:, :3] - start).max() < 1e-6 * scene.geometry.pitch
        assert node.stop() == 0
