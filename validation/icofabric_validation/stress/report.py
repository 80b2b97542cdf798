# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What was found, as tables: by class, by term, and how often each parameter was drawn."""

from collections import Counter
from collections.abc import Iterable, Sequence
import csv
from pathlib import Path
from typing import Any, Final

from icofabric_sim.parameters.table import BY_NAME, FAMILIES
from icofabric_validation.stress.kinds import KINDS, TERMS
from icofabric_validation.stress.scenes import draw_scene
from icofabric_validation.stress.verdict import FAULTS, Finding, Verdict

# Seeds that a line of the table names.
_NAMED = 8
COLUMNS: Final = tuple(name for name in Finding._fields)
# Parameters that change how a run is watched, not what it computes.
_ASIDE = (
    'pull.', 'real_time_factor', 'publish', 'marker_rate', 'clock_rate', 'frame_id',
    'start_paused', 'reset_time', 'step_count', 'advance_duration', 'input_', 'checkpoint.',
    'record.', 'tf.', 'equilibrium.')


def class_lines(findings: Sequence[Finding]) -> list[str]:
    """A line for each class: how many, and the first seeds of those that are few."""
    count = Counter(finding.verdict for finding in findings)
    lines = []
    for verdict in Verdict:
        seeds = sorted(found.seed for found in findings if found.verdict is verdict)
        line = f'{verdict.value:44}{count[verdict]:6}'
        if verdict is Verdict.SAID:
            given = sum(found.is_given for found in findings if found.verdict is verdict)
            line += f'  of which {given} with a given step'
        if verdict is Verdict.EXCUSED and seeds:
            worst = max(
                (found for found in findings if found.verdict is verdict), key=_understated)
            line += (f'  the estimate too small by up to {_understated(worst):.3g} times (seed '
                     f'{worst.seed})')
        if verdict is Verdict.UNJUDGED and seeds:
            line += (f'  {sum(found.unjudged for found in findings)} of '
                     f'{sum(found.windows for found in findings)} windows of all scenes')
        if seeds and (len(seeds) <= _NAMED or verdict in FAULTS):
            line += '  seeds ' + ' '.join(map(str, seeds[:_NAMED]))
            line += ' ...' if len(seeds) > _NAMED else ''
        lines.append(line)
    return lines


def _understated(finding: Finding) -> float:
    """How many times an error is as large as was said."""
    return finding.added / max(finding.estimate, finding.promised)


def term_lines(findings: Sequence[Finding]) -> list[str]:
    """A line for each term: its scenes, and how many of them are of which class."""
    lines = [f'{"term":11}{"scenes":>7}  classes']
    for term in ('', *TERMS):
        of = Counter(
            found.verdict for found in findings
            if (term in KINDS[found.kind].terms if term else not KINDS[found.kind].terms))
        if of:
            words = ', '.join(
                f'{of[verdict]} {verdict.value}' for verdict in Verdict if of[verdict])
            lines.append(f'{term or "plain":11}{sum(of.values()):7}  {words}')
    return lines


def coverage_lines(findings: Iterable[Finding]) -> list[str]:
    """In how many scenes each parameter of the physics was not at its default."""
    count: Counter[str] = Counter()
    for finding in findings:
        count.update({_general(name) for name, value in draw_scene(finding.seed).parameters.items()
                      if not _is_default(name, value)})
    return [f'{count[name]:6}  {name}' for name in physical_parameters()]


def physical_parameters() -> list[str]:
    """Names of the parameters that a run depends on; NAME stands for the names of families."""
    names = [name for name in BY_NAME if not name.startswith(_ASIDE)]
    names += [
        f'{family}.NAME{"." if entry.name else ""}{entry.name}'
        for family, entries in FAMILIES.items() for entry in entries]
    return names


def _general(name: str) -> str:
    words = name.split('.')
    return '.'.join([words[0], 'NAME', *words[2:]]) if words[0] in FAMILIES else name


def _is_default(name: str, value: Any) -> bool:
    words = name.split('.')
    if words[0] in FAMILIES:
        return any(entry.name == '.'.join(words[2:]) and entry.default == value
                   for entry in FAMILIES[words[0]])
    return bool(BY_NAME[name].default == value)


def write_table(path: Path, findings: Iterable[Finding]) -> None:
    """A CSV of all findings."""
    with path.open('w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for finding in findings:
            writer.writerow([
                value.value if isinstance(value, Verdict) else value for value in finding])


def as_dictionary(finding: Finding) -> dict[str, Any]:
    """A finding in plain values, for JSON."""
    return {**finding._asdict(), 'verdict': finding.verdict.value, 'of': str(KINDS[finding.kind])}
