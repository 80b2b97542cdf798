# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What is kept of a slab between two ends beside its stresses: strength, cycles, a check."""

from collections.abc import Callable, Sequence
import math
from typing import Final

from icofabric_sim.scene.scene import Scene
from icofabric_sim.statics.cycles import measure_cycles
from icofabric_sim.statics.stress_strain import CurvePoint, measure_curve
from icofabric_sim.sweeps.independent import compare_energies
from icofabric_sim.sweeps.phrases import Column, curve_arguments, Failed, Phrase
import numpy as np

# Strains between which moduli are measured.
_MODULUS_STRAINS: Final = (1e-4, 3e-4, 1e-3)
# A stress that falls by less than this part has not fallen.
_FALL = 1e-3


def _strength(phrase: Phrase, scene: Scene) -> list[Column]:
    """
    Small strains first, then even steps.

    The stress falls for the first time where a state has less of it than the one before, and
    nothing broke on the way: the slab has buckled.
    """
    kind, strains, axis, direction, name = curve_arguments(phrase)
    small = [strain for strain in _MODULUS_STRAINS if strain < (1.0 - 1e-9) * strains[0]]
    points = measure_curve(scene, kind, [*small, *strains], axis=axis, along=direction)
    states = _at_rest(phrase, points)
    across = [number for number in range(3) if number != axis]
    first = states[0]
    along = first.middle_strain[axis]
    stress = np.array([state.stress for state in states])
    most = int(np.argmax(stress))
    columns = [
        # Of states that follow from each other: without any strain there may be another one near.
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
        Column(f'{name}.most', 'Pa', float(stress[most])),
        Column(f'{name}.most_at', '', states[most].strain),
        Column(f'{name}.buckles_at', '', _buckling(states)),
        Column(f'{name}.buckles_under', 'Pa', _buckling_stress(states)),
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


def _at_rest(phrase: Phrase, points: Sequence[CurvePoint]) -> list[CurvePoint]:
    states = [point for point in points if not point.verdict.startswith('not')]
    if not states:
        raise Failed(f'{phrase}: no equilibrium at the first strain')
    return states


def _slope(states: Sequence[CurvePoint], first: float, second: float) -> float:
    """Slope of the stress between two strains [Pa]; NaN where it was not measured there."""
    stress = {round(state.strain, 12): state.stress for state in states}
    if first not in stress or second not in stress:
        return math.nan
    return (stress[second] - stress[first]) / (second - first)


def _buckling(states: Sequence[CurvePoint]) -> float:
    fall = _fall(states)
    return math.nan if fall is None else fall.strain


def _buckling_stress(states: Sequence[CurvePoint]) -> float:
    fall = _fall(states)
    return math.nan if fall is None else fall.stress


def _fall(states: Sequence[CurvePoint]) -> CurvePoint | None:
    """Return the last state before the stress first falls without breaks, or None."""
    for before, after in zip(states, states[1:]):
        if after.broken:
            return None
        if before.stress > 0.0 and after.stress < (1.0 - _FALL) * before.stress:
            return before
    return None


def _first(states: Sequence[CurvePoint], holds: Callable[[CurvePoint], bool]) -> float:
    return next((state.strain for state in states if holds(state)), math.nan)


def _cycle(phrase: Phrase, scene: Scene) -> list[Column]:
    kind, strains, axis, along, name = curve_arguments(phrase)
    cycles = measure_cycles(scene, kind, strains, axis=axis, along=along)
    if not cycles or not math.isfinite(cycles[0].loading_work):
        raise Failed(f'{phrase}: no equilibrium on the way')
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
            Column(f'{name}.engine', 'J', found.engine),
            Column(f'{name}.scipy', 'J', found.scipy),
            Column(f'{name}.engine_slope', 'J', found.engine_slope),
            Column(f'{name}.scipy_slope', 'J', found.scipy_slope),
            Column(f'{name}.apart', '', found.apart),
            Column(f'{name}.gradient', '', found.gradient),
            Column(f'{name}.contact_pairs', '', found.contact_pairs)]
    return columns


SLAB_WORDS: Final[dict[str, Callable[[Phrase, Scene], list[Column]]]] = {
    'strength': _strength, 'cycle': _cycle, 'independent': _independent}
