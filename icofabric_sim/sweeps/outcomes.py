# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Computations of a run (verbs), and the results kept (phrases such as `displacement tip`).

A verb computes once for all its phrases. Each kept value becomes a column of the table, with its
unit.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from icofabric_sim import checks
from icofabric_sim.checks import shown
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.scene import Scene
from icofabric_sim.sweeps.phrases import Column, curve_arguments, Phrase, RunFailed
import numpy as np

RUN, STATICS, MODES, ELASTICITY, BANDS, CURVE, MECHANISMS = VERBS = (
    'run', 'statics', 'modes', 'elasticity', 'bands', 'curve', 'mechanisms')
_VOIGT = ('xx', 'yy', 'zz', 'yz', 'xz', 'xy')
_DIRECTIONS = {'x': (1, 0, 0), 'y': (0, 1, 0), 'z': (0, 0, 1), 'xy': (1, 1, 0), 'xyz': (1, 1, 1)}
# Energies of a fabric in equilibrium.
_STATIC_ENERGIES = ('connectors', 'gravity', 'contact', 'field', 'total')
# Name of the bag in the folder of a run.
BAG: Final = 'bag'
# Points between two neighbouring corners of the path through the Brillouin zone, and default
# number of wave vectors along each axis of the zone.
_BAND_POINTS, _BAND_SAMPLES = 24, 6
# Argument that selects the equilibrium of the periodic fabric.
_RELAXED: Final = 'relaxed'
# Results with the arguments of a curve.
_CURVE_RESULTS: Final = ('curve', 'strength', 'cycle', 'independent')


class Work(NamedTuple):
    """Verbs and kept results of each run."""

    verbs: tuple[str, ...]
    keep: tuple[Phrase, ...]

    def of(self, verb: str) -> list[Phrase]:
        """Return the kept results of a verb."""
        return [phrase for phrase in self.keep if verb in RESULT_KINDS[phrase.word].verbs]


class ResultKind(NamedTuple):
    """A kind of result: its verbs, its phrase and its description."""

    verbs: tuple[str, ...]
    usage: str
    description: str


RESULT_KINDS: Final[dict[str, ResultKind]] = {
    'energies': ResultKind((RUN, STATICS), 'energies', 'energies at the end [J]'),
    'displacement': ResultKind(
        (RUN, STATICS), 'displacement GROUP',
        'mean displacement of a group from its initial position, and the largest of any body [m]'),
    'extremes': ResultKind(
        (RUN,), 'extremes',
        'largest relative extension and compression, and largest displacement [m], of the run'),
    'bag': ResultKind((RUN,), 'bag', 'the recorded run, as icofabric run writes it'),
    'tension': ResultKind(
        (STATICS,), 'tension', 'largest and smallest (most compressive) force of a connector [N]'),
    'reaction': ResultKind(
        (STATICS,), 'reaction GROUP', 'sum of the forces of supports and drives on a group [N]'),
    'frequencies': ResultKind((MODES,), 'frequencies [COUNT]', 'the lowest frequencies [rad/s]'),
    'moduli': ResultKind(
        (ELASTICITY,), 'moduli [relaxed]', "stiffness [Pa], Young's moduli [Pa], density "
        '[kg/m^3]; relaxed: about the equilibrium of the periodic fabric, with contact'),
    'gap': ResultKind(
        (BANDS,), 'gap [COUNT] [relaxed]', 'the widest gap between the bands, and the highest '
        'frequency; COUNT: wave vectors along each axis of the Brillouin zone, in addition to '
        'those on the standard path; relaxed: as for moduli'),
    'curve': ResultKind(
        (CURVE,), 'curve KIND STRAIN [POINTS [AXIS]]',
        'stress [Pa] of the slab at strains up to STRAIN; KIND: pull, push, shear, hydrostatic or '
        'inflation; AXIS of a shear may include the direction, e.g. xz'),
    'strength': ResultKind(
        (CURVE,), 'strength KIND STRAIN [POINTS [AXIS]]',
        "modulus and Poisson's ratios at small strain; strain at first contact, at buckling "
        '(first decrease of the stress) and at first breakage; largest stress'),
    'cycle': ResultKind(
        (CURVE,), 'cycle KIND STRAIN [POINTS [AXIS]]',
        'work of loading, work returned in unloading, energy dissipated [J]'),
    'independent': ResultKind(
        (CURVE,), 'independent KIND STRAIN [POINTS [AXIS]]',
        "energies [J] of a slab of linear springs with contact, compared with SciPy's minimiser "
        'on an independent implementation of the forces'),
    'places': ResultKind(
        (MECHANISMS,), 'places', 'number of zero-energy motions of the woven fabric, and the '
        'degrees of freedom at corners, edges, faces, interior and each depth that take part'),
    'contacts': ResultKind(
        (STATICS,), 'contacts',
        'pairs in contact at equilibrium, largest overlap [m] and force [N]'),
    'centre': ResultKind((RUN,), 'centre', 'velocity and kinetic energy of the centre of mass'),
}
DEFAULTS: Final = {
    RUN: ('energies', 'extremes'), STATICS: ('energies', 'tension'), MODES: ('frequencies 6',),
    ELASTICITY: ('moduli',), BANDS: ('gap',), CURVE: ('curve pull 0.1 10 x',),
    MECHANISMS: ('places',)}
_FREQUENCIES = 6


def make_work(verbs: Any, keep: Any = None) -> Work:
    """Validate verbs and phrases. Raise ValueError that lists the allowed ones."""
    chosen = [verbs] if isinstance(verbs, str) else checks.items('verbs', verbs, 'verbs')
    if not chosen:
        raise ValueError(f'verbs must name at least one of {", ".join(VERBS)}')
    for verb in chosen:
        checks.choice('verbs', verb, VERBS)
    given = [keep] if isinstance(keep, str) else [] if keep is None else checks.items(
        'keep', keep, 'phrases')
    phrases = [_parse(text) for text in given]
    for phrase in phrases:
        kind = RESULT_KINDS[phrase.word]
        if not set(kind.verbs) & set(chosen):
            raise ValueError(
                f'keep: {phrase} needs the verb {" or ".join(kind.verbs)}; add one to the verbs '
                f'({", ".join(chosen)})')
    ordered = tuple(verb for verb in VERBS if verb in chosen)
    for verb in ordered:
        if not any(verb in RESULT_KINDS[phrase.word].verbs for phrase in phrases):
            phrases += map(_parse, DEFAULTS[verb])
    return Work(ordered, tuple(dict.fromkeys(phrases)))


def _parse(text: Any) -> Phrase:
    words = checks.text('keep', text, 'phrases').split()
    known = ', '.join(kind.usage for kind in RESULT_KINDS.values())
    if not words or words[0] not in RESULT_KINDS:
        raise ValueError(f'keep: {shown(text)} is not known; choose from: {known}')
    phrase = Phrase(words[0], tuple(words[1:]))
    usage = RESULT_KINDS[phrase.word].usage
    most = len(usage.split()) - 1
    least = len(usage.split('[')[0].split()) - 1
    if not least <= len(phrase.arguments) <= most:
        raise ValueError(f'keep: {shown(text)} must be: {usage}')
    if phrase.word == 'frequencies':
        frequency_count(phrase)
    if phrase.word == 'gap':
        sample_count(phrase)
    if phrase.word == 'moduli' and phrase.arguments not in ((), (_RELAXED,)):
        raise ValueError(f'keep: moduli takes {_RELAXED} or nothing, got {shown(text)}')
    if phrase.word in _CURVE_RESULTS:
        curve_arguments(phrase)
    return phrase


def frequency_count(phrase: Phrase) -> int:
    """Return the requested number of frequencies."""
    return _count(phrase.word, phrase.arguments, _FREQUENCIES, 1000)


def sample_count(phrase: Phrase) -> int:
    """Return the requested number of wave vectors along each axis of the Brillouin zone."""
    given = phrase.arguments[:-1] if phrase.arguments[-1:] == (_RELAXED,) else phrase.arguments
    if len(given) > 1:
        raise ValueError(f'keep: gap takes a count and {_RELAXED}, got {" ".join(given)}')
    return _count(phrase.word, given, _BAND_SAMPLES, 100)


def _count(word: str, given: Sequence[str], default: int, most: int) -> int:
    """Return the first of the arguments as a count."""
    if not given:
        return default
    if not given[0].isdecimal() or not 1 <= int(given[0]) <= most:
        raise ValueError(f'keep: {word} takes a count from 1 to {most}, got {shown(given[0])}')
    return int(given[0])


def is_relaxed(phrases: Sequence[Phrase]) -> bool:
    """Return True if all results are at the periodic equilibrium; ValueError if only some."""
    found = {phrase.arguments[-1:] == (_RELAXED,) for phrase in phrases}
    if len(found) > 1:
        raise ValueError(
            f'keep: {", ".join(map(str, phrases))}: results about the woven state and '
            f'about the equilibrium cannot be mixed; give {_RELAXED} in all, or make two sweeps')
    return found == {True}


def check_end(work: Work, parameters: Parameters) -> None:
    """Raise ParameterError for runs without an end."""
    if RUN in work.verbs and not parameters['duration'] > 0.0:
        raise ParameterError(
            'duration', 'duration must be above 0 for the verb run: it is the simulated time [s]')


def check_work(work: Work, scene: Scene) -> None:
    """Raise ValueError if a requested result is not available for the scene."""
    from icofabric_sim.statics.held import held_time
    from icofabric_sim.statics.periodic import make_cell
    if STATICS in work.verbs or MODES in work.verbs:
        held_time(scene, None)
    if ELASTICITY in work.verbs:
        make_cell(scene, relaxed=is_relaxed(work.of(ELASTICITY)))
    if BANDS in work.verbs:
        cell = make_cell(scene, relaxed=is_relaxed(work.of(BANDS)))
        if cell.at_kink:
            raise ParameterError(
                'connector.stiffness_extension', 'connector.stiffness_extension is not '
                'connector.stiffness_compression, and the connectors are at their natural length: '
                'waves then do not superpose, so there are no bands; give one stiffness')
    if MECHANISMS in work.verbs:
        from icofabric_sim.statics.floppy import require_dense
        require_dense(scene)
    if any(phrase.word == 'independent' for phrase in work.keep):
        from icofabric_sim.sweeps.independent import require_plain
        require_plain(scene)
    for phrase in work.keep:
        if phrase.word in ('displacement', 'reaction') and phrase.arguments[0] not in scene.groups:
            raise ValueError(
                f'keep: {phrase}: there is no such group; groups: {", ".join(scene.groups)}; '
                f'groups.{phrase.arguments[0]} defines it')


def carry_out(work: Work, scene: Scene, folder: Path) -> list[Column]:
    """
    Compute all results of a run in this thread; a bag is written to `folder`.

    Raise RunFailed or ValueError with the reason if a result cannot be computed.
    """
    columns: list[Column] = []
    at: Any = None
    for verb in work.verbs:
        phrases = work.of(verb)
        if verb == STATICS:
            found, at = _statics(phrases, scene)
        elif verb == MODES:
            found = _modes(phrases, scene, at)
        else:
            found = _VERBS[verb](phrases, scene, folder)
        columns += [Column(f'{verb}.{name}', unit, value) for name, unit, value in found]
    return columns


def _run(phrases: Sequence[Phrase], scene: Scene, folder: Path) -> list[Column]:
    from icofabric_sim.running.diagnostics import HealthReport
    from icofabric_sim.running.recording import BagSink, summarise_run
    from icofabric_sim.running.run_monitor import RunMonitor
    from icofabric_sim.running.run_records import errors_of
    from icofabric_sim.running.runner import Runner
    from icofabric_sim.simulation.simulation import compile_scene

    simulation = compile_scene(scene)
    simulation.warm_up()
    monitor = RunMonitor(simulation)
    bag = None
    if any(phrase.word == 'bag' for phrase in phrases):
        bag = BagSink(folder / BAG, simulation, live=False)
    runner = Runner(
        simulation, [monitor] if bag is None else [monitor, bag],
        report=None if bag is None else HealthReport('/icofabric').bytes)
    try:
        runner.run(until_finished=True)
    finally:
        if bag is not None:
            status = runner.status()._replace(errors=errors_of(simulation))
            bag.close(summary={**summarise_run(status), 'interrupted': 'false'})
    if bag is not None and bag.error is not None:
        raise OSError(str(bag.error))
    if runner.failure:
        raise RunFailed(runner.failure)
    last = simulation.snapshot()
    columns = [
        Column('error_estimate', '', float(simulation.error_estimate)),
        Column('balance_worst', '', float(simulation.balance.worst)),
        Column('breaks', '', int(simulation.status.broken_count))]
    for phrase in phrases:
        if phrase.word == 'energies':
            columns += _energies(last)
        elif phrase.word == 'displacement':
            columns += _displacement(scene, last, phrase.arguments[0])
        elif phrase.word == 'extremes':
            columns += [
                Column('stretch', '', monitor.stretch.value),
                Column('compression', '', monitor.compression.value),
                Column('largest_displacement', 'm', monitor.displacement.value)]
        elif phrase.word == 'centre':
            columns += _centre(scene, last)
    return columns


def _statics(phrases: Sequence[Phrase], scene: Scene) -> tuple[list[Column], Any]:
    from icofabric_sim.statics.equilibrium import solve_equilibrium
    found = solve_equilibrium(scene)
    if not found.converged:
        raise RunFailed(f'{found.verdict}: {found.reason}' if found.reason else found.verdict)
    columns = [
        Column('verdict', '', found.verdict), Column('residual', '', float(found.residual)),
        Column('mechanisms', '', int(found.mechanism_count))]
    for phrase in phrases:
        if phrase.word == 'energies':
            columns += [one for one in _energies(found.snapshot)
                        if one.name.removeprefix('energy.') in _STATIC_ENERGIES]
        elif phrase.word == 'displacement':
            columns += _displacement(scene, found.snapshot, phrase.arguments[0])
        elif phrase.word == 'tension':
            columns += [
                Column('largest_tension', 'N', float(np.max(found.tension, initial=0.0))),
                Column('least_tension', 'N', float(np.min(found.tension, initial=0.0)))]
        elif phrase.word == 'contacts':
            contact = found.contact_state
            columns += [
                Column('contact_pairs', '', 0 if contact is None else len(contact.pairs)),
                Column('overlap', 'm', 0.0 if contact is None else contact.depth),
                Column(
                    'largest_contact_force', 'N',
                    0.0 if contact is None else contact.largest_force)]
        else:
            name = phrase.arguments[0]
            force = found.reaction[scene.groups[name], :3].sum(axis=0).tolist()
            columns += [
                Column(f'reaction.{name}.{axis}', 'N', value)
                for axis, value in zip('xyz', force)]
    return columns, found.snapshot


def _modes(phrases: Sequence[Phrase], scene: Scene, at: Any) -> list[Column]:
    from icofabric_sim.statics.modes import solve_modes
    count = max(map(frequency_count, phrases))
    found = solve_modes(scene, at=at, count=count)
    columns = [
        Column('mechanisms', '', int(found.mechanism_count)),
        Column('unstable', '', int(found.unstable_count))]
    values = found.frequencies.tolist()
    return columns + [
        Column(f'frequency.{number}', 'rad/s', values[number] if number < len(values) else np.nan)
        for number in range(count)]


def _elasticity(phrases: Sequence[Phrase], scene: Scene, folder: Path) -> list[Column]:
    from icofabric_sim.statics.periodic import homogenise
    found = homogenise(scene, relaxed=is_relaxed(phrases))
    rest = found.relaxed_state
    columns = [] if rest is None else [
        Column('verdict', '', rest.verdict),
        Column('contact_pairs', '', len(rest.contact_vectors)),
        Column('overlap', 'm', float(rest.overlap)),
        Column('length_ratio', '', float(np.cbrt(np.linalg.det(rest.gradient))))]
    columns += [
        Column('density', 'kg/m^3', float(found.density)),
        Column('soft_strains', '', len(found.zero_energy_strains)),
        Column('at_kink', '', int(found.at_kink))]
    columns += [
        Column(f'stiffness.{first}.{_VOIGT[column]}', 'Pa', float(found.stiffness[row, column]))
        for row, first in enumerate(_VOIGT) for column in range(row, 6)]
    for name, direction in _DIRECTIONS.items():
        axis = np.array(direction, float)
        columns += [
            Column(
                f'young.{name}.{word}', 'Pa', float(found.uniaxial_response(axis, sign).modulus))
            for word, sign in (('tension', 1.0), ('compression', -1.0))]
    return columns


def _bands(phrases: Sequence[Phrase], scene: Scene, folder: Path) -> list[Column]:
    from icofabric_sim.statics.periodic import band_path, sample_zone, solve_bands
    # The path finds extremes on lines of symmetry, the grid all others.
    samples = max(map(sample_count, phrases))
    path, grid = band_path(scene, _BAND_POINTS)[0], sample_zone(scene, samples)
    vectors = np.concatenate([path, grid])
    frequencies = solve_bands(scene, vectors, relaxed=is_relaxed(phrases))
    lowest, highest = frequencies.min(axis=0), frequencies.max(axis=0)
    gaps = lowest[1:] - highest[:-1]
    widest = int(np.argmax(gaps))
    has_gap = bool(gaps[widest] > 0.0)
    return [
        Column('lowest', 'rad/s', float(lowest[0])),
        # Without the path, whose first wave is a translation of the fabric.
        Column('grid.lowest', 'rad/s', float(frequencies[len(path):].min())),
        Column('highest', 'rad/s', float(highest[-1])),
        Column('gap', 'rad/s', float(gaps[widest]) if has_gap else 0.0),
        Column('gap.above_band', '', widest if has_gap else -1),
        Column('gap.from', 'rad/s', float(highest[widest]) if has_gap else np.nan),
        Column('gap.to', 'rad/s', float(lowest[widest + 1]) if has_gap else np.nan),
        *(Column(f'{number}.{end}', 'rad/s', float(values[number]))
          for number in range(len(lowest))
          for end, values in (('lowest', lowest), ('highest', highest)))]


def _curve(phrases: Sequence[Phrase], scene: Scene, folder: Path) -> list[Column]:
    from icofabric_sim.statics.stress_strain import measure_curve
    from icofabric_sim.sweeps.slab_outcomes import SLAB_RESULTS
    columns: list[Column] = []
    for phrase in phrases:
        if phrase.word in SLAB_RESULTS:
            columns += SLAB_RESULTS[phrase.word](phrase, scene)
            continue
        kind, strains, axis, along, name = curve_arguments(phrase)
        points = measure_curve(scene, kind, strains, axis=axis, along=along)
        if not points or points[0].verdict.startswith('not'):
            raise RunFailed(f'{phrase}: no equilibrium at a strain of {strains[0]:g}')
        states = [point for point in points if not point.verdict.startswith('not')]
        columns += [
            Column(f'{name}.reached', '', states[-1].strain),
            Column(f'{name}.broken', '', states[-1].broken),
            Column(f'{name}.largest_stress', 'Pa', max(point.stress for point in states))]
        columns += [
            Column(f'{name}.stress.{strain:.6g}', 'Pa',
                   states[number].stress if number < len(states) else np.nan)
            for number, strain in enumerate(strains)]
    return columns


def _mechanisms(phrases: Sequence[Phrase], scene: Scene, folder: Path) -> list[Column]:
    from icofabric_sim.statics.floppy import find_floppy
    found = find_floppy(scene)
    return [
        Column('degrees_of_freedom', '', found.counts.degrees_of_freedom),
        Column('connectors', '', found.counts.connectors),
        Column('count', '', found.counts.mechanisms),
        Column('self_stresses', '', found.counts.self_stresses),
        Column('rotation_content', '', float(found.rotation_content.sum())),
        *(Column(f'at.{name}', '', value) for name, value in found.by_place().items())]


_VERBS: Final[dict[str, Callable[[Sequence[Phrase], Scene, Path], list[Column]]]] = {
    RUN: _run, ELASTICITY: _elasticity, BANDS: _bands, CURVE: _curve, MECHANISMS: _mechanisms}


def _energies(snapshot: Any) -> list[Column]:
    return [Column(f'energy.{name}', 'J', float(value))
            for name, value in snapshot.energy.items()]


def _displacement(scene: Scene, snapshot: Any, group: str) -> list[Column]:
    members = scene.groups[group]
    moved = snapshot.position[members] - scene.initial.position[members]
    mean = moved.mean(axis=0).tolist() if len(members) else [np.nan] * 3
    largest = float(np.linalg.norm(moved, axis=1).max(initial=0.0))
    return [
        *(Column(f'displacement.{group}.{axis}', 'm', value)
          for axis, value in zip('xyz', mean)),
        Column(f'displacement.{group}.largest', 'm', largest)]


def _centre(scene: Scene, snapshot: Any) -> list[Column]:
    mass = scene.masses.total(scene.body_count)
    body_mass = np.broadcast_to(scene.masses.mass, scene.body_count)
    velocity = (body_mass @ snapshot.linear_velocity / mass).tolist()
    return [
        *(Column(f'centre.velocity.{axis}', 'm/s', value)
          for axis, value in zip('xyz', velocity)),
        Column('centre.kinetic', 'J', 0.5 * mass * sum(value * value for value in velocity))]
