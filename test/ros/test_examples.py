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
"""The scripts in examples/ do to a running node what they say."""

import os
import subprocess
import sys

from ros_helpers import Client, domain, NodeProcess, ROOT


def test_push_moves_the_fabric_and_stiffens_it(tmp_path):
    with NodeProcess(
            tmp_path / 'log', scene=ROOT / 'config' / 'hanging_slab.yaml',
            parameters={'gravity': '[0.0, 0.0, 0.0]'}) as node, Client(node) as client:
        poses, weaves = client.listen('~/poses'), client.listen('~/weave', latched=True)
        client.wait_for(lambda: poses, 'poses')
        before = poses[0].values[:, 1].copy()
        done = subprocess.run(
            [sys.executable, str(ROOT / 'examples' / 'push.py')], capture_output=True, text=True,
            timeout=60, env={**os.environ, 'ROS_DOMAIN_ID': str(domain(0))})
        assert done.returncode == 0, done.stderr
        assert 'successful=True' in done.stdout
        client.wait_for(
            lambda: (poses[-1].values[:, 1] - before).max() > 1e-3, 'the push to move the tip')
        client.wait_for(lambda: 'stiffness: 3000.0' in str(weaves[-1]), 'the stiffer connectors')
        assert node.stop() == 0
