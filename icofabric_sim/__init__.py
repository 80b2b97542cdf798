# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Dynamics of icosahedral fabric.

Rigid icosahedral shells are joined by flexible connectors in a repeating weave. Needs no ROS and
no display; only `icofabric_sim.ros` imports rclpy. Names are loaded when first used, so that
`icofabric --help` does not wait for a compiler.
"""

from importlib import import_module
from typing import Any, TYPE_CHECKING

from icofabric_sim.version import __version__  # noqa: F401 - a documented name

if TYPE_CHECKING:
    from icofabric_sim.geometry.shell import Shell
    from icofabric_sim.parameters.validation import ParameterError
    from icofabric_sim.scene.scene import load_scene, Scene
    from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
    from icofabric_sim.simulation.devices.ranks import RankError, Ranks
    from icofabric_sim.simulation.errors import SimulationError
    from icofabric_sim.simulation.model.body_force import BodyForce
    from icofabric_sim.simulation.model.snapshot import Snapshot
    from icofabric_sim.simulation.model.surface_force import surface_force
    from icofabric_sim.simulation.reports.divergence import Growth, measure_growth
    from icofabric_sim.simulation.simulation import compile_scene, Simulation
    from icofabric_sim.simulation.stepping.methods import METHODS
    from icofabric_sim.statics.cycles import measure_cycles
    from icofabric_sim.statics.equilibrium import Equilibrium, solve_equilibrium, step_loads
    from icofabric_sim.statics.modes import solve_modes, Spectrum
    from icofabric_sim.statics.moment_curve import measure_moment_curve
    from icofabric_sim.statics.periodic import Elasticity, homogenise, solve_bands
    from icofabric_sim.statics.stress_strain import measure_curve
    from icofabric_sim.sweeps.sweep import sweep

_HOMES = {
    'BodyForce': 'simulation.model.body_force',
    'Checkpoint': 'simulation.checkpoints.checkpoint',
    'Elasticity': 'statics.periodic',
    'Equilibrium': 'statics.equilibrium',
    'Growth': 'simulation.reports.divergence',
    'METHODS': 'simulation.stepping.methods',
    'RankError': 'simulation.devices.ranks',
    'Ranks': 'simulation.devices.ranks',
    'ParameterError': 'parameters.validation',
    'Scene': 'scene.scene',
    'Shell': 'geometry.shell',
    'Simulation': 'simulation.simulation',
    'SimulationError': 'simulation.errors',
    'Snapshot': 'simulation.model.snapshot',
    'Spectrum': 'statics.modes',
    'compile_scene': 'simulation.simulation',
    'homogenise': 'statics.periodic',
    'load_scene': 'scene.scene',
    'measure_curve': 'statics.stress_strain',
    'measure_cycles': 'statics.cycles',
    'measure_growth': 'simulation.reports.divergence',
    'measure_moment_curve': 'statics.moment_curve',
    'solve_bands': 'statics.periodic',
    'solve_equilibrium': 'statics.equilibrium',
    'solve_modes': 'statics.modes',
    'step_loads': 'statics.equilibrium',
    'surface_force': 'simulation.model.surface_force',
    'sweep': 'sweeps.sweep',
}

__all__ = [
    'BodyForce',
    'Checkpoint',
    'Elasticity',
    'Equilibrium',
    'Growth',
    'METHODS',
    'ParameterError',
    'RankError',
    'Ranks',
    'Scene',
    'Shell',
    'Simulation',
    'SimulationError',
    'Snapshot',
    'Spectrum',
    'compile_scene',
    'homogenise',
    'load_scene',
    'measure_curve',
    'measure_cycles',
    'measure_growth',
    'measure_moment_curve',
    'solve_bands',
    'solve_equilibrium',
    'solve_modes',
    'step_loads',
    'surface_force',
    'sweep',
]


_RENAMED = {'measure_turning': 'measure_moment_curve'}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f'icofabric_sim.{_HOMES[name]}'), name)
    if name in _RENAMED:
        renamed_text = import_module('icofabric_sim.checks').renamed_text
        raise AttributeError(renamed_text('icofabric_sim', name, _RENAMED))
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def __dir__() -> list[str]:
    return sorted([*__all__, '__version__', '__doc__'])
