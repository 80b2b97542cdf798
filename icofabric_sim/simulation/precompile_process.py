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
"""
The process that precompile.py starts: builds scenes from standard input and compiles for them.
"""

import os
import pickle
import sys
from typing import Any

from icofabric_sim.parameters.validation import make_parameters
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.simulation import compile_scene, use_all_kernels


def _compile(task: tuple[list[dict[str, Any]], str, int]) -> None:
    kinds, rotation, _ = task
    for given in kinds:
        use_all_kernels(compile_scene(
            Scene.from_parameters(make_parameters(given)), rotation=rotation))


if __name__ == '__main__':
    task = pickle.load(sys.stdin.buffer)
    os.environ['ICOFABRIC_COMPILE_AHEAD'] = '0'  # this is the process that does it
    os.nice(task[2])
    _compile(task)
