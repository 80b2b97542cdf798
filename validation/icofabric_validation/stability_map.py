# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Every method with steps up to and beyond the stability limit: what drifts, and what is refused.

Small fabrics in small motion, for which the limit is that of the largest frequency, computed from
the second derivatives of all energies (statics/modes), not from what the run itself takes for it.
Implicit methods have no limit: none of their steps is refused, and where forces are smooth and
motion stays small the energy never grows.
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
# As woven [m]: the connectors of _PLAIN.
_LENGTH = float(Scene.from_parameters(_PLAIN).connectors.woven_length)
# Face to face, and the length of their connectors [m].
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
    # In the middle of a held rim tensions balance.
    'tensioned': {
        **_PLAIN, 'weave.size': [5, 5, 5], 'connector.natural_length': 0.9 * _LENGTH,
        'groups.rim': 'x_min or x_max or y_min or y_max or z_min or z_max',
        'supports.rim.group': 'rim'},
    # Connectors press faces together, which stay so in such small motion. It begins at rest.
    'touching': {**_DENSE, 'connector.natural_length': 0.97 * _DENSE_LENGTH},
    'kinked': {**_PLAIN, 'connector.stiffness_extension': 600.0,
               'connector.stiffness_compression': 300.0},
    # Some of its connectors break in such small motion.
    'breaking': {**_PLAIN, 'connector.break_length_extension': _LENGTH + 2e-8},
}
# Whose forces are not smooth, so that no energy is promised.
_ROUGH: Final = ('kinked', 'breaking')
# That move far in so many long steps, or by a drive that these do not follow: L-stability is of
# small motion.
_SWINGING: Final = ('hanging', 'driven')
# Steps times the largest frequency; the limits of the methods lie between the last of these.
PRODUCTS: Final = (0.05, 0.1, 0.2, 0.5, 1.0, 1.5, 1.9, 2.1, 2.5, 3.0, 3.3, 4.0, 6.0, 6.5)
# And of implicit methods, which take a tenth as many: each step costs as much as 20.
LONGER: Final = (20.0, 100.0)
_FEWER = 10
MAPPED: Final = (*METHODS, *IMPLICIT)
STEPS: Final = 10_000
_LOOKS = 20
# Of the limit within which a step may be refused or not: the run knows its frequency by bounds.
_UNSURE = 0.02
# And where shells touch: their stiffness is bounded by what may come to touch, which makes the
# largest frequency up to 3.4 times as large here.
_UNSURE_TOUCHING = 0.75
# Below this part of the limit the energy of a symplectic method swings by less than half of
# itself, or by what leapfrog's does on one oscillator, where forces have no kinks. Others may lose
# or gain: that is what the map shows.
_SOUND, _SWING = 0.8, 0.5
# What an implicit method may gain, over the largest kinetic energy: errors of short steps.
_GAIN = 0.01


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
    fault: str  # '': as the theory says


def map_stability(
    fabrics: Sequence[str] = tuple(FABRICS), methods: Sequence[str] = MAPPED, *,
    products: Sequence[float] | None = None, steps: int = STEPS
) -> Iterator[Cell]:
    """
    Run all cells, each for so many steps; without methods that cannot take a fabric.

    `products`: those of each method where None are given.
    """
    for fabric in fabrics:
        values = FABRICS[fabric]
        largest, rest = _largest_frequency(values), _rest(values)
        for method in methods_of(fabric, methods):
            for product in products_of(method) if products is None else products:
                yield _judge(fabric, values, method, product, largest, steps, rest)


def products_of(method: str) -> tuple[float, ...]:
    """Steps times the largest frequency that are tried."""
    return (*PRODUCTS, *LONGER) if method in IMPLICIT else PRODUCTS


def methods_of(fabric: str, methods: Sequence[str] = MAPPED) -> list[str]:
    """Those of the `methods` that can integrate a fabric: where connectors break only one."""
    needed = required_method(Scene.from_parameters(FABRICS[fabric]))
    return [name for name in methods if needed is None or name == needed.name]


def cell_line(cell: Cell) -> str:
    """A row of the table."""
    figures = ''.join(
        f'{value:10.1e}' if math.isfinite(value) else f'{"":10}'
        for value in (cell.energy, cell.momentum, cell.norm))
    return (f'{cell.fabric:10}{cell.method:10}{cell.product:8.4g}  {cell.outcome:8}'
            f'{cell.steps:9d}{figures}  {cell.fault}').rstrip()


HEAD: Final = (f'{"fabric":10}{"method":10}{"h omega":>8}  {"outcome":8}{"steps":>9}'
               f'{"energy":>10}{"momentum":>10}{"norm":>10}')


def _largest_frequency(values: dict[str, Any]) -> float:
    """
    Largest frequency [rad/s], of connectors on their stiffer side where there are two.

    Of what touches about its rest.
    """
    if (rest := _rest(values)) is not None:
        return float(solve_modes(Scene.from_parameters(values), at=rest).frequencies[-1])
    stiffest = {name: value for name, value in values.items()
                if not name.startswith('connector.stiffness_')}
    stiffest['connector.stiffness'] = values.get('connector.stiffness_extension', 500.0)
    return float(solve_modes(Scene.from_parameters(stiffest), time=0.0).frequencies[-1])


def _touches(values: dict[str, Any]) -> bool:
    return bool(values['contact.mode'] == 'always')


def _rest(values: dict[str, Any]) -> Snapshot | None:
    """Where a fabric is at rest whose shells touch; None: it begins as its scene says."""
    return solve_equilibrium(Scene.from_parameters(values)).snapshot if _touches(values) else None


def _compiled(values: dict[str, Any], rest: Snapshot | None) -> Simulation:
    """A run that begins at rest but for the velocities of its scene, or as that says."""
    simulation = compile_scene(Scene.from_parameters(values))
    if rest is not None:
        start = simulation.snapshot()
        simulation.set_state(
            position=rest.position, orientation=rest.orientation,
            linear_velocity=start.linear_velocity, angular_velocity=start.angular_velocity)
    return simulation


def _judge(
    fabric: str, values: dict[str, Any], method: str, product: float, largest: float, steps: int,
    rest: Snapshot | None
) -> Cell:
    facts = facts_of(method)
    step, limit = product / largest, facts.stability
    if facts.implicit:
        steps //= _FEWER
    energy = momentum = norm = gain = math.nan
    taken = 0
    level = _LOGGER.level
    _LOGGER.setLevel(logging.ERROR)
    try:
        simulation = _compiled({
            **values, 'solver.method': method, 'solver.step': step, 'solver.energy_limit': 1.0},
            rest)
        outcome = 'ran'
        try:
            energy, gain, momentum, norm = _drifts(simulation, step, steps)
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
    unsure = _UNSURE_TOUCHING if _touches(values) else _UNSURE
    if product > (1.0 + unsure) * limit and outcome == 'ran':
        fault = f'ran beyond the limit of {limit:g}'
    elif product < (1.0 - unsure) * limit and outcome == 'refused':
        fault = f'refused below the limit of {limit:g}'
    elif facts.implicit and fabric not in (*_ROUGH, *_SWINGING) and gain > _GAIN:
        fault = f'gains {gain:.2g} of the largest kinetic energy'
    elif product < _SOUND * limit and facts.symplectic and fabric not in _ROUGH and (
            outcome == 'stopped' or (
                outcome == 'ran' and not energy < max(_SWING, _swing(product / limit)))):
        fault = f'unsound at {product / limit:.2f} of the limit'
    return Cell(fabric, method, product, outcome, taken, energy, momentum, norm, fault)


def _swing(part: float) -> float:
    """
    Energy that leapfrog moves to and fro over the kinetic energy, at a `part` of its limit.

    It keeps p^2 + (1 - part^2) q^2 of an oscillator (Hairer, Lubich, Wanner, XIII.8).
    """
    return part**2 / (1.0 - part**2)


def _drifts(simulation: Simulation, step: float, steps: int) -> tuple[
        float, float, float, float]:
    """Largest errors of energy, and of those gains, of momentum and of norms over the run."""
    first = simulation.snapshot()
    speed = math.sqrt(float((first.linear_velocity**2).sum(axis=1).mean()))
    free = simulation.scene.supports is None and not simulation.scene.drives
    momentum = first.linear_velocity.sum(axis=0)
    balance = gain = moving = pushed = norm = 0.0
    for look in range(1, _LOOKS + 1):
        # Where a step ends to the last bit: just before it the last one would not be taken.
        simulation.advance_to(steps * look // _LOOKS * step)
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
