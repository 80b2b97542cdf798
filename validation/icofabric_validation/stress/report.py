# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of findings by class and by term, and counts of drawn parameters."""

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from icofabric_sim.commands.report import write_csv
from icofabric_sim.parameters.table import BY_NAME, FAMILIES
from icofabric_validation.stress.kinds import KINDS, TERMS
from icofabric_validation.stress.scenes import draw_scene
from icofabric_validation.stress.verdict import FAULTS, Finding, Verdict

# Largest number of seeds in a line of the table.
_MAX_SEEDS = 8
# Parameters that affect the output of a run, but not its motion.
_NOT_PHYSICAL = (
    'pull.', 'real_time_factor', 'publish', 'marker_rate', 'clock_rate', 'frame_id',
    'start_paused', 'reset_time', 'step_count', 'advance_duration', 'input_', 'checkpoint.',
    'record.', 'tf.', 'equilibrium.')


def class_lines(findings: Sequence[Finding]) -> list[str]:
    """Return a line for each class: its count, and the first seeds of rare classes and faults."""
    count = Counter(finding.verdict for finding in findings)
    lines = []
    for verdict in Verdict:
        seeds = sorted(found.seed for found in findings if found.verdict is verdict)
        line = f'{verdict.value:44}{count[verdict]:6}'
        if verdict is Verdict.REPORTED:
            given = sum(found.is_given for found in findings if found.verdict is verdict)
            line += f'  of which {given} with a given step'
        if verdict is Verdict.EXCUSED and seeds:
            worst = max(
                (found for found in findings if found.verdict is verdict), key=_error_ratio)
            line += (f'  the estimate too small by up to {_error_ratio(worst):.3g} times (seed '
                     f'{worst.seed})')
        if verdict is Verdict.UNJUDGED and seeds:
            line += (f'  {sum(found.unjudged for found in findings)} of '
                     f'{sum(found.windows for found in findings)} windows of all scenes')
        if seeds and (len(seeds) <= _MAX_SEEDS or verdict in FAULTS):
            line += '  seeds ' + ' '.join(map(str, seeds[:_MAX_SEEDS]))
            line += ' ...' if len(seeds) > _MAX_SEEDS else ''
        lines.append(line)
    return lines


def _error_ratio(finding: Finding) -> float:
    """Return the ratio of the added error to the reported or promised one."""
    return finding.added / max(finding.estimate, finding.promised)


def term_lines(findings: Sequence[Finding]) -> list[str]:
    """Return a line for each term: the number of scenes, in total and by class."""
    lines = [f'{"term":13}{"scenes":>7}  classes']
    for term in ('', *TERMS):
        of = Counter(
            found.verdict for found in findings
            if (term in KINDS[found.kind].terms if term else not KINDS[found.kind].terms))
        if of:
            words = ', '.join(
                f'{of[verdict]} {verdict.value}' for verdict in Verdict if of[verdict])
            lines.append(f'{term or "plain":13}{sum(of.values()):7}  {words}')
    return lines


def coverage_lines(findings: Iterable[Finding]) -> list[str]:
    """Return a line for each physical parameter: the number of scenes with another value."""
    count: Counter[str] = Counter()
    for finding in findings:
        parameters = draw_scene(finding.seed).parameters
        count.update({_family_name(name) for name, value in parameters.items()
                      if not _is_default(name, value)})
    return [f'{count[name]:6}  {name}' for name in physical_parameters()]


def physical_parameters() -> list[str]:
    """Return the parameters that affect the motion; NAME replaces the names in families."""
    names = [name for name in BY_NAME if not name.startswith(_NOT_PHYSICAL)]
    names += [
        f'{family}.NAME{"." if entry.name else ""}{entry.name}'
        for family, entries in FAMILIES.items() for entry in entries]
    return names


def _family_name(name: str) -> str:
    words = name.split('.')
    return '.'.join([words[0], 'NAME', *words[2:]]) if words[0] in FAMILIES else name


def _is_default(name: str, value: Any) -> bool:
    words = name.split('.')
    if words[0] in FAMILIES:
        return any(entry.name == '.'.join(words[2:]) and entry.default == value
                   for entry in FAMILIES[words[0]])
    return bool(BY_NAME[name].default == value)


def write_table(path: Path, findings: Iterable[Finding]) -> None:
    """Write all findings as CSV."""
    write_csv(path, Finding._fields, (
        {**finding._asdict(), 'verdict': finding.verdict.value}.values() for finding in findings))


def as_dictionary(finding: Finding) -> dict[str, Any]:
    """Return a finding as plain values, for JSON."""
    return {
        **finding._asdict(), 'verdict': finding.verdict.value, 'terms': str(KINDS[finding.kind])}
