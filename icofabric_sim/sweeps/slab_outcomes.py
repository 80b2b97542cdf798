# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Results of load cases of slabs other than stresses: strength, cycles, an independent check."""

from collections.abc import Callable, Sequence
import math
from typing import Final

from icofabric_sim.scene.scene import Scene
from icofabric_sim.statics.cycles import measure_cycles
from icofabric_sim.statics.stress_strain import CurvePoint, measure_curve
from icofabric_sim.sweeps.independent import compare_energies
from icofabric_sim.sweeps.phrases import Column, curve_arguments, Phrase, RunFailed
import numpy as np

# Strains between which moduli are measured.
_MODULUS_STRAINS: Final = (1e-4, 3e-4, 1e-3)
# Smallest relative decrease of the stress that counts as buckling.
_MIN_DECREASE_RATIO = 1e-3


def _strength(phrase: Phrase, scene: Scene) -> list[Column]:
    """
    Return moduli at small strains, then strength from evenly spaced strains.

    The slab buckles at the last state before the stress first decreases, if no connector has
    broken by then.
    """
    kind, strains, axis, direction, name = curve_arguments(phrase)
    small = [strain for strain in _MODULUS_STRAINS if strain < (1.0 - 1e-9) * strains[0]]
    points = measure_curve(scene, kind, [*small, *strains], axis=axis, along=direction)
    states = _equilibria(phrase, points)
    across = [number for number in range(3) if number != axis]
    first = states[0]
    along = first.middle_strain[axis]
    stress = np.array([state.stress for state in states])
    peak = int(np.argmax(stress))
    buckling_strain, buckling_stress = _buckling(states)
    columns = [
        # From consecutive states, because at zero strain another equilibrium may be close.
        Column(f'{name}.modulus', 'Pa', _slope(states, *_MODULUS_STRAINS[:2])),
        Column(f'{name}.modulus_beyond', 'Pa', _slope(states, *_MODULUS_STRAINS[1:])),
        Column(f'{name}.secant', 'Pa', (first.stress - first.rest_stress) / first.strain),
        *(Column(f'{name}.poisson.{"xyz"[number]}', '',
                 -first.middle_strain[number] / along if abs(along) > 1e-3 * first.strain
                 else math.nan) for number in across)]
    return [
        *columns,
        Column(f'{name}.verdict', '', first.verdict),
        Column(f'{name}.rest_stress', 'Pa', first.rest_stress),
        Column(f'{name}.largest_stress', 'Pa', float(stress[peak])),
        Column(f'{name}.strain_at_largest_stress', '', states[peak].strain),
        Column(f'{name}.buckles_at', '', buckling_strain),
        Column(f'{name}.buckling_stress', 'Pa', buckling_stress),
        Column(f'{name}.unstable_at', '', _first(
            states, lambda state: state.verdict == 'equilibrium, unstable')),
        Column(f'{name}.contact_at', '', _first(states, lambda state: state.contact_pairs > 0)),
        Column(f'{name}.slips_at', '', _first(states, lambda state: state.sliding_pairs > 0)),
        Column(f'{name}.obstructed_at', '', _first(states, lambda state: state.obstructed > 0)),
        Column(f'{name}.breaks_at', '', _first(states, lambda state: state.broken > 0)),
        Column(f'{name}.broken', '', states[-1].broken),
        Column(f'{name}.contact_pairs', '', max(state.contact_pairs for state in states)),
        Column(f'{name}.energy', 'J', states[-1].energy),
        Column(f'{name}.reached', '', states[-1].strain),
        Column(f'{name}.residual', '', max(state.residual for state in states)),
        *(Column(f'{name}.strains', '', ' '.join(f'{state.strain:.6g}' for state in states)),
          Column(f'{name}.stresses', 'Pa', ' '.join(f'{value:.6g}' for value in stress)))]


def _equilibria(phrase: Phrase, points: Sequence[CurvePoint]) -> list[CurvePoint]:
    states = [point for point in points if not point.verdict.startswith('not')]
    if not states:
        raise RunFailed(f'{phrase}: no equilibrium at the first strain')
    return states


def _slope(states: Sequence[CurvePoint], first: float, second: float) -> float:
    """Return the slope of the stress between two strains [Pa]; NaN if either is missing."""
    stress = {round(state.strain, 12): state.stress for state in states}
    if first not in stress or second not in stress:
        return math.nan
    return (stress[second] - stress[first]) / (second - first)


def _buckling(states: Sequence[CurvePoint]) -> tuple[float, float]:
    """Return strain and stress [Pa] before the stress first falls without breaks, or NaN."""
    for before, after in zip(states, states[1:]):
        if after.broken:
            break
        if before.stress > 0.0 and after.stress < (1.0 - _MIN_DECREASE_RATIO) * before.stress:
            return before.strain, before.stress
    return math.nan, math.nan


def _first(states: Sequence[CurvePoint], holds: Callable[[CurvePoint], bool]) -> float:
    return next((state.strain for state in states if holds(state)), math.nan)


def _cycle(phrase: Phrase, scene: Scene) -> list[Column]:
    kind, strains, axis, along, name = curve_arguments(phrase)
    cycles = measure_cycles(scene, kind, strains, axis=axis, along=along)
    if not cycles or not math.isfinite(cycles[0].loading_work):
        raise RunFailed(f'{phrase}: no equilibrium within the cycle')
    cycle = cycles[0]
    name = f'cycle.{name}'
    return [
        Column(f'{name}.loading_work', 'J', cycle.loading_work),
        Column(f'{name}.unloading_work', 'J', cycle.unloading_work),
        Column(f'{name}.loop_area', 'J', cycle.loop_area),
        Column(f'{name}.released_energy', 'J', cycle.released_energy),
        Column(f'{name}.energy_gain', 'J', cycle.energy_gain),
        Column(f'{name}.broken', '', cycle.broken)]


def _independent(phrase: Phrase, scene: Scene) -> list[Column]:
    kind, strains, axis, along, case = curve_arguments(phrase)
    columns = []
    for found in compare_energies(scene, kind, strains, axis, along):
        name = f'independent.{case}.{found.strain:.6g}'
        columns += [
            Column(f'{name}.package', 'J', found.package),
            Column(f'{name}.scipy', 'J', found.scipy),
            Column(f'{name}.package_slope', 'J', found.package_slope),
            Column(f'{name}.scipy_slope', 'J', found.scipy_slope),
            Column(f'{name}.position_difference', '', found.position_difference),
            Column(f'{name}.gradient', '', found.gradient),
            Column(f'{name}.contact_pairs', '', found.contact_pairs)]
    return columns


SLAB_RESULTS: Final[dict[str, Callable[[Phrase, Scene], list[Column]]]] = {
    'strength': _strength, 'cycle': _cycle, 'independent': _independent}
