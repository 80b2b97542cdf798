# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Load cases of a slab as text and rows, for `icofabric elasticity`."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from icofabric_sim.commands.equilibrium_outputs import EquilibriumOutputs
from icofabric_sim.scene.scene import Scene
from icofabric_sim.statics.cycles import Cycle, CYCLE_COLUMNS, CycleRun
from icofabric_sim.statics.held_motion import DIRECTED, STRAINED
from icofabric_sim.statics.moment_curve import (
    MOMENT_CURVE_COLUMNS,
    moment_curve_points,
    MomentCurvePoint,
)
from icofabric_sim.statics.stress_strain import CURVE_COLUMNS, curve_points, CurvePoint
from icofabric_sim.terminal import bad_input, Progress

BREAK_COLUMNS = (
    'kind', 'strain_or_angle_rad', 'connector', 'side', 'length_m', 'released_energy_j')


@dataclass
class LoadCases:
    """Requested load cases and their results."""

    kinds: Sequence[str]
    strains: list[float]
    angles: list[float]  # [rad]
    axis: int  # through both ends
    about: int | None  # rotation axis of a bend
    count: int  # number of cycles; 0: load only
    along: Sequence[float] | None = None  # of pull, push and shear; None: default of each
    curves: dict[str, list[CurvePoint]] = field(default_factory=dict)
    moment_curves: dict[str, list[MomentCurvePoint]] = field(default_factory=dict)
    cycles: dict[str, list[Cycle]] = field(default_factory=dict)
    early: bool = False

    def search(self, scene: Scene) -> None:
        """Find the states of all load cases; an interrupted search keeps the states found."""
        for kind in self.kinds:
            points: list[Any] = []
            found: dict[str, list[Any]] = self.curves if kind in STRAINED else self.moment_curves
            found[kind] = points
            whole = (self._cycle if self.count else self._load)(scene, kind, points)
            self.early |= len(points) < whole or points[-1].verdict.startswith('not')

    def _load(self, scene: Scene, kind: str, points: list[Any]) -> int:
        """Add the states of a load case to `points`, and return their intended number."""
        amounts = self._amounts(kind)
        _collect(
            curve_points(scene, kind, amounts, axis=self.axis, along=self._along(kind))
            if kind in STRAINED else
            moment_curve_points(scene, kind, amounts, axis=self.axis, about=self._about(kind)),
            len(amounts), points)
        return len(amounts)

    def _cycle(self, scene: Scene, kind: str, points: list[Any]) -> int:
        """Load and unload `count` times."""
        with bad_input():
            run = CycleRun(
                scene, kind, self._amounts(kind), count=self.count, axis=self.axis,
                about=self._about(kind), along=self._along(kind))
        try:
            _collect(run.points(), len(run.path), points)
        finally:
            self.cycles[kind] = run.cycles()
        return len(run.path)

    def _amounts(self, kind: str) -> list[float]:
        return self.strains if kind in STRAINED else self.angles

    def _about(self, kind: str) -> int | None:
        return self.about if kind == 'bend' else None

    def _along(self, kind: str) -> Sequence[float] | None:
        return self.along if kind in DIRECTED else None

    def text(self, name: str) -> list[str]:
        """Return lines for the terminal."""
        lines, letter = [], 'xyz'[self.axis]
        curves, turns = _any(self.curves), _any(self.moment_curves)
        if curves:
            lines.append(
                f'{name}: slab, fixed at both ends along {letter}, sides free (hydrostatic, '
                'inflation: all faces fixed); transverse strains are from the middle third')
            lines += curve_text(curves, self.axis)
        if turns:
            lines.append(
                f'{name}: slab, ends along {letter} rotated against each other, sides free')
            lines += moment_curve_text(turns)
        return lines + cycle_text(self.cycles)

    def write(self, outputs: EquilibriumOutputs) -> None:
        """Write tables of all results."""
        if curves := _any(self.curves):
            outputs.table('curves.csv', ('kind', *CURVE_COLUMNS), (
                [kind, *point.row()] for kind, points in curves.items() for point in points))
        if turns := _any(self.moment_curves):
            outputs.table('moment_curves.csv', ('kind', *MOMENT_CURVE_COLUMNS), (
                [kind, *turned.row()] for kind, states in turns.items() for turned in states))
        if cycles := _any(self.cycles):
            outputs.table('cycles.csv', ('kind', 'cycle', *CYCLE_COLUMNS), (
                [kind, number, *cycle[:-1]] for kind, found in cycles.items()
                for number, cycle in enumerate(found, start=1)))
        broken = break_rows([*curves.items(), *turns.items()])
        if broken:
            outputs.table('breaks.csv', BREAK_COLUMNS, broken)

    def numbers(self) -> dict[str, Any]:
        """Return the results for JSON."""
        return {
            'curves': {kind: [_state(one) for one in found]
                       for kind, found in self.curves.items()},
            'moment_curves': {kind: [_state(one) for one in found]
                              for kind, found in self.moment_curves.items()},
            'cycles': {kind: [_without(cycle._asdict(), 'points') for cycle in found]
                       for kind, found in self.cycles.items()}}


def _collect(states: Iterator[Any], count: int, points: list[Any]) -> None:
    """Add the states, `count` at most, to `points` as they are found."""
    with Progress(count, 'states') as progress, bad_input():
        for point in states:
            points.append(point)
            progress.update(len(points))


def _any(found: Mapping[str, list[Any]]) -> dict[str, list[Any]]:
    """Return the entries that are not empty."""
    return {kind: points for kind, points in found.items() if points}


def _state(point: CurvePoint | MomentCurvePoint) -> dict[str, Any]:
    """Return a state without its snapshot."""
    return {**_without(point._asdict(), 'snapshot'),
            'breaks': [each._asdict() for each in point.breaks]}


def _without(fields: dict[str, Any], name: str) -> dict[str, Any]:
    return {key: value for key, value in fields.items() if key != name}


def curve_text(curves: Mapping[str, Sequence[CurvePoint]], axis: int) -> list[str]:
    """Return lines for the terminal; transverse strains are from the middle of the slab."""
    lines = []
    for kind, points in curves.items():
        sides = [number for number in range(3) if number != axis]
        head = ''.join(f'{"strain " + 2 * "xyz"[side]:>11}' for side in sides)
        lines.append(
            f'  {kind:11} {"strain":>10} {"stress [Pa]":>14} {"stress/strain":>14}{head}')
        for point in points:
            lines.append(
                f'              {point.strain:10.5g} {point.stress:14.6g} '
                f'{_over(point.stress, point.strain):>14}' + ''.join(
                    f'{point.middle_strain[side]:11.3g}' for side in sides)
                + f'  {point.verdict}{_more(point)}')
    return lines


def moment_curve_text(turns: Mapping[str, Sequence[MomentCurvePoint]]) -> list[str]:
    """Return lines for the terminal."""
    lines = []
    for kind, points in turns.items():
        stiffness = 'EI [N m^2]' if kind == 'bend' else 'GJ [N m^2]'
        lines.append(f'  {kind:11} {"angle [rad]":>11} {"moment [N m]":>14} {stiffness:>14}')
        for point in points:
            rigidity = f'{point.rigidity:14.6g}' if point.angle else f'{"":14}'
            lines.append(
                f'              {point.angle:10.5g} {point.moment:14.6g} {rigidity}'
                f'  {point.verdict}{_more(point)}')
    return lines


def cycle_text(cycles: Mapping[str, Sequence[Cycle]]) -> list[str]:
    """Return lines for the terminal."""
    return [
        f'  {kind:11} cycle {number}: {cycle.loading_work:.6g} J loading, '
        f'{cycle.unloading_work:.6g} J unloading, '
        f'{cycle.loop_area:.3g} J dissipated' + (
            f'; breaks released {cycle.released_energy:.6g} J, {cycle.broken} broken'
            if cycle.broken else '')
        for kind, found in cycles.items() for number, cycle in enumerate(found, start=1)]


def break_rows(
    cases: Iterable[tuple[str, Sequence[CurvePoint | MomentCurvePoint]]]
) -> list[list[object]]:
    """Return rows of `BREAK_COLUMNS`: the broken connectors of each case, in order."""
    return [
        [kind, each.amount, each.connector, each.side, each.length, each.released_energy]
        for kind, points in cases for point in points for each in point.breaks]


def _over(stress: float, strain: float) -> str:
    return f'{stress / strain:.6g}' if strain else ''


def _more(point: CurvePoint | MomentCurvePoint) -> str:
    """Return remarks on a state besides its verdict."""
    parts = [
        f'  {count} {words}' for count, words in (
            (point.obstructed, 'obstructed'), (point.broken, 'broken'),
            (point.contact_pairs, 'pairs in contact'), (point.sliding_pairs, 'sliding'),
            (point.at_kink, 'at their kink'),
            (point.past_kink, 'past it')) if count]
    return ''.join(parts)
