# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Dynamics of icosahedral fabric.

Rigid icosahedral shells are joined by flexible connectors in a repeating weave. Needs no ROS and
no display; only `icofabric_sim.ros` imports rclpy. Names are loaded when first used, so that
`icofabric --help` does not wait for a compiler.
"""

from importlib import import_module
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from icofabric_sim.body_force import BodyForce
    from icofabric_sim.checkpoint import Checkpoint
    from icofabric_sim.growth import Growth, measure_growth
    from icofabric_sim.integrators.methods import METHODS
    from icofabric_sim.parameters import ParameterError
    from icofabric_sim.scene import load_scene, Scene
    from icofabric_sim.shell import Shell
    from icofabric_sim.simulation import compile_scene, Simulation, SimulationError
    from icofabric_sim.snapshot import Snapshot
    from icofabric_sim.statics.equilibrium import Equilibrium, solve_equilibrium, step_loads
    from icofabric_sim.statics.modes import solve_modes, Spectrum
    from icofabric_sim.statics.periodic import Elasticity, homogenise, solve_bands
    from icofabric_sim.statics.stretching import measure_curve

__version__ = '0.1.0'

_HOMES = {
    'BodyForce': 'body_force',
    'Checkpoint': 'checkpoint',
    'Elasticity': 'statics.periodic',
    'Equilibrium': 'statics.equilibrium',
    'Growth': 'growth',
    'METHODS': 'integrators.methods',
    'ParameterError': 'parameters',
    'Scene': 'scene',
    'Shell': 'shell',
    'Simulation': 'simulation',
    'SimulationError': 'simulation',
    'Snapshot': 'snapshot',
    'Spectrum': 'statics.modes',
    'compile_scene': 'simulation',
    'homogenise': 'statics.periodic',
    'load_scene': 'scene',
    'measure_curve': 'statics.stretching',
    'measure_growth': 'growth',
    'solve_bands': 'statics.periodic',
    'solve_equilibrium': 'statics.equilibrium',
    'solve_modes': 'statics.modes',
    'step_loads': 'statics.equilibrium',
}

__all__ = [
    'BodyForce',
    'Checkpoint',
    'Elasticity',
    'Equilibrium',
    'Growth',
    'METHODS',
    'ParameterError',
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
    'measure_growth',
    'solve_bands',
    'solve_equilibrium',
    'solve_modes',
    'step_loads',
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f'icofabric_sim.{_HOMES[name]}'), name)
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def __dir__() -> list[str]:
    return sorted([*__all__, '__version__', '__doc__'])
