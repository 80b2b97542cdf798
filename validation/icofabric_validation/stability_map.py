# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Drifts and refusals of every method with steps up to and beyond the stability limit.

Fabrics are small and in small motion. The limit is that of the largest frequency, computed from
the second derivatives of all energies (statics/modes), independently of the run. Implicit methods
have no limit: no step is refused, and with smooth forces and small motion the energy never grows.
"""

from collections.abc import Iterator, Sequence
import logging
import math
from typing import Any, Final, NamedTuple

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.errors import SimulationError
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.simulation import compile_scene, Simulation
from icofabric_sim.simulation.stepping.method_needs import required_method
from icofabric_sim.simulation.stepping.methods import facts_of, IMPLICIT, METHODS
from icofabric_sim.statics.equilibrium import solve_equilibrium
from icofabric_sim.statics.modes import solve_modes
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')
_PLAIN: Final[dict[str, Any]] = {
    'weave.size': [3, 3, 3], 'weave.connector_angle': 0.4, 'contact.mode': 'never',
    'solver.threads': 1, 'initial_random.velocity_sigma': 1e-5, 'initial_random.spin_sigma': 1e-3,
    'initial_random.seed': 1}
_HELD: Final[dict[str, Any]] = {'groups.top': 'z_max', 'supports.top.group': 'top'}
# Woven length of the connectors of _PLAIN [m].
_LENGTH = float(Scene.from_parameters(_PLAIN).connectors.woven_length)
# The dense weave, and the woven length of its connectors [m].
_DENSE: Final[dict[str, Any]] = {
    **_PLAIN, 'weave.connector_angle': -0.3648, 'contact.mode': 'always',
    'contact.stiffness': 2000.0, 'initial_random.velocity_sigma': 1e-6,
    'initial_random.spin_sigma': 1e-4}
_DENSE_LENGTH = float(Scene.from_parameters(_DENSE).connectors.woven_length)
FABRICS: Final[dict[str, dict[str, Any]]] = {
    'free': _PLAIN,
    'hanging': {**_PLAIN, **_HELD, 'gravity': [0.0, 0.0, -1e-4]},
    'driven': {
        **_PLAIN, 'groups.top': 'z_max', 'drives.top.group': 'top', 'drives.top.motion': 'sine',
        'drives.top.linear': [0.0, 0.0, 1e-8], 'drives.top.frequency': 20.0,
        'drives.top.phase': -0.5 * math.pi},
    # Tensions balance inside a held rim.
    'tensioned': {
        **_PLAIN, 'weave.size': [5, 5, 5], 'connector.natural_length': 0.9 * _LENGTH,
        'groups.rim': 'x_min or x_max or y_min or y_max or z_min or z_max',
        'supports.rim.group': 'rim'},
    # Connectors keep faces in contact during small motion about the equilibrium.
    'touching': {**_DENSE, 'connector.natural_length': 0.97 * _DENSE_LENGTH},
    'kinked': {**_PLAIN, 'connector.stiffness_extension': 600.0,
               'connector.stiffness_compression': 300.0},
    # Some connectors break during small motion.
    'breaking': {**_PLAIN, 'connector.break_length_extension': _LENGTH + 2e-8},
}
# Fabrics whose forces are not smooth, which have no bound of the energy.
_NOT_SMOOTH: Final = ('kinked', 'breaking')
# Fabrics with large motion in long steps, or with a drive that long steps do not resolve:
# L-stability is for small motion.
_LARGE_MOTION: Final = ('hanging', 'driven')
# Step times largest frequency; the limits of the methods are between the last values.
PRODUCTS: Final = (0.05, 0.1, 0.2, 0.5, 1.0, 1.5, 1.9, 2.1, 2.5, 3.0, 3.3, 4.0, 6.0, 6.5)
# Further values for implicit methods, and the factor by which they take fewer steps, because one
# costs as much as 20.
IMPLICIT_PRODUCTS: Final = (20.0, 100.0)
_IMPLICIT_STEP_DIVISOR = 10
MAPPED_METHODS: Final = (*METHODS, *IMPLICIT)
STEPS: Final = 10_000
_SAMPLE_COUNT = 20
# Relative distance from the limit within which a step may be refused or accepted, because the run
# only has bounds of its largest frequency.
_LIMIT_TOLERANCE_RATIO = 0.02
# The same for contacts: candidate pairs make the bound of the frequency up to 3.4 times too large.
_CONTACT_LIMIT_TOLERANCE_RATIO = 0.75
# Below this fraction of the limit the energy error of a symplectic method is at most half of the
# kinetic energy, or that of leapfrog on one oscillator, if forces are smooth.
_BOUNDED_STEP_RATIO, _MAX_ENERGY_SWING_RATIO = 0.8, 0.5
# Largest energy gain of an implicit method over the largest kinetic energy: errors of short steps.
_MAX_ENERGY_GAIN_RATIO = 0.01


class Cell(NamedTuple):
    """One run: a fabric, a method and a step."""

    fabric: str
    method: str
    product: float  # step times largest frequency
    outcome: str  # 'ran', 'refused' or 'stopped'
    steps: int
    energy: float  # largest error of the balance over the largest kinetic energy
    momentum: float  # change over mass times root mean square speed of all; NaN if held or driven
    norm: float  # largest deviation of a quaternion from 1
    fault: str  # contradiction to the theory; '': none


def map_stability(
    fabrics: Sequence[str] = tuple(FABRICS), methods: Sequence[str] = MAPPED_METHODS, *,
    products: Sequence[float] | None = None, steps: int = STEPS
) -> Iterator[Cell]:
    """
    Run all cells, each for `steps` steps, without methods that cannot integrate a fabric.

    `products` defaults to those of each method.
    """
    for fabric in fabrics:
        values = FABRICS[fabric]
        largest, equilibrium = _largest_frequency(values), _equilibrium(values)
        for method in methods_of(fabric, methods):
            for product in products_of(method) if products is None else products:
                yield _judge(fabric, values, method, product, largest, steps, equilibrium)


def products_of(method: str) -> tuple[float, ...]:
    """Return the values of step times largest frequency for a method."""
    return (*PRODUCTS, *IMPLICIT_PRODUCTS) if method in IMPLICIT else PRODUCTS


def methods_of(fabric: str, methods: Sequence[str] = MAPPED_METHODS) -> list[str]:
    """Return the methods that can integrate a fabric: only one if connectors break."""
    needed = required_method(Scene.from_parameters(FABRICS[fabric]))
    return [name for name in methods if needed is None or name == needed.name]


def cell_line(cell: Cell) -> str:
    """Return a row of the table."""
    figures = ''.join(
        f'{value:10.1e}' if math.isfinite(value) else f'{"":10}'
        for value in (cell.energy, cell.momentum, cell.norm))
    return (f'{cell.fabric:10}{cell.method:10}{cell.product:8.4g}  {cell.outcome:8}'
            f'{cell.steps:9d}{figures}  {cell.fault}').rstrip()


HEAD: Final = (f'{"fabric":10}{"method":10}{"h omega":>8}  {"outcome":8}{"steps":>9}'
               f'{"energy":>10}{"momentum":>10}{"norm":>10}')


def _largest_frequency(values: dict[str, Any]) -> float:
    """
    Return the largest frequency [rad/s], with the larger of two connector stiffnesses.

    For fabrics with contact, it is that of small vibrations about the equilibrium.
    """
    if (equilibrium := _equilibrium(values)) is not None:
        return float(solve_modes(Scene.from_parameters(values), at=equilibrium).frequencies[-1])
    stiffest = {name: value for name, value in values.items()
                if not name.startswith('connector.stiffness_')}
    stiffest['connector.stiffness'] = values.get('connector.stiffness_extension', 500.0)
    return float(solve_modes(Scene.from_parameters(stiffest), time=0.0).frequencies[-1])


def _has_contact(values: dict[str, Any]) -> bool:
    return bool(values['contact.mode'] == 'always')


def _equilibrium(values: dict[str, Any]) -> Snapshot | None:
    """Return the equilibrium of a fabric with contact; None: the run starts as its scene."""
    if not _has_contact(values):
        return None
    return solve_equilibrium(Scene.from_parameters(values)).snapshot


def _start_run(values: dict[str, Any], equilibrium: Snapshot | None) -> Simulation:
    """Compile a run that starts at the equilibrium, if any, with the velocities of its scene."""
    simulation = compile_scene(Scene.from_parameters(values))
    if equilibrium is not None:
        start = simulation.snapshot()
        simulation.set_state(
            position=equilibrium.position, orientation=equilibrium.orientation,
            linear_velocity=start.linear_velocity, angular_velocity=start.angular_velocity)
    return simulation


def _judge(
    fabric: str, values: dict[str, Any], method: str, product: float, largest: float, steps: int,
    equilibrium: Snapshot | None
) -> Cell:
    facts = facts_of(method)
    step, limit = product / largest, facts.stability
    if facts.implicit:
        steps //= _IMPLICIT_STEP_DIVISOR
    energy = momentum = norm = gain = math.nan
    taken = 0
    level = _LOGGER.level
    _LOGGER.setLevel(logging.ERROR)
    try:
        simulation = _start_run({
            **values, 'solver.method': method, 'solver.step': step, 'solver.energy_limit': 1.0},
            equilibrium)
        outcome = 'ran'
        try:
            energy, gain, momentum, norm = _measure_drifts(simulation, step, steps)
        except SimulationError:
            outcome = 'stopped'
        taken = simulation.status.step_count
    except ValueError as error:
        if 'stability limit' not in str(error):
            raise
        outcome = 'refused'
    finally:
        _LOGGER.setLevel(level)
    fault = ''
    unsure = _CONTACT_LIMIT_TOLERANCE_RATIO if _has_contact(values) else _LIMIT_TOLERANCE_RATIO
    if product > (1.0 + unsure) * limit and outcome == 'ran':
        fault = f'ran beyond the limit of {limit:g}'
    elif product < (1.0 - unsure) * limit and outcome == 'refused':
        fault = f'refused below the limit of {limit:g}'
    elif gain > _MAX_ENERGY_GAIN_RATIO and facts.implicit and (
            fabric not in (*_NOT_SMOOTH, *_LARGE_MOTION)):
        fault = f'gains {gain:.2g} of the largest kinetic energy'
    elif product < _BOUNDED_STEP_RATIO * limit and facts.symplectic and (
            fabric not in _NOT_SMOOTH) and (outcome == 'stopped' or (
                outcome == 'ran' and not energy < max(
                    _MAX_ENERGY_SWING_RATIO, _leapfrog_swing(product / limit)))):
        fault = f'energy error too large at {product / limit:.2f} of the limit'
    return Cell(fabric, method, product, outcome, taken, energy, momentum, norm, fault)


def _leapfrog_swing(ratio: float) -> float:
    """
    Return the oscillating energy error of leapfrog over the kinetic energy.

    `ratio` is the step over the limit. Leapfrog conserves p^2 + (1 - ratio^2) q^2 of an oscillator
    (Hairer, Lubich, Wanner, XIII.8).
    """
    return ratio**2 / (1.0 - ratio**2)


def _measure_drifts(simulation: Simulation, step: float, steps: int) -> tuple[
        float, float, float, float]:
    """Return the largest energy error, energy gain, momentum and norm error over the run."""
    first = simulation.snapshot()
    speed = math.sqrt(float((first.linear_velocity**2).sum(axis=1).mean()))
    free = simulation.scene.supports is None and not simulation.scene.drives
    momentum = first.linear_velocity.sum(axis=0)
    balance = gain = moving = pushed = norm = 0.0
    for sample in range(1, _SAMPLE_COUNT + 1):
        # Exactly the end of a step, so that the last step is included.
        simulation.advance_to(steps * sample // _SAMPLE_COUNT * step)
        snapshot = simulation.snapshot()
        energy = snapshot.energy
        balance = max(balance, abs(energy['balance_error']))
        gain = max(gain, energy['balance_error'])
        moving = max(moving, energy['kinetic'])
        change = snapshot.linear_velocity.sum(axis=0) - momentum
        pushed = max(pushed, float(np.abs(change).max()) / (speed * simulation.scene.body_count))
        norm = max(norm, float(np.abs(
            np.linalg.norm(snapshot.orientation, axis=1) - 1.0).max()))
    return balance / moving, gain / moving, pushed if free else math.nan, norm
