# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Process started by precompile.py: builds scenes from standard input and compiles their kernels.
"""

import os
import pickle
import sys
from typing import Any

from icofabric_sim.parameters.validation import make_parameters
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.simulation import (
    compile_scene,
    measure_forces,
    use_all_kernels,
)


def _compile(task: tuple[list[dict[str, Any]], str, bool, int]) -> None:
    kinds, rotation, is_measured, _ = task
    for given in kinds:
        scene = Scene.from_parameters(make_parameters(given))
        if is_measured:
            measure_forces(scene, rotation)
        else:
            use_all_kernels(compile_scene(scene, rotation=rotation))


if __name__ == '__main__':
    task = pickle.load(sys.stdin.buffer)
    os.environ['ICOFABRIC_COMPILE_AHEAD'] = '0'  # this process compiles itself
    os.nice(task[-1])
    _compile(task)
