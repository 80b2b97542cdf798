# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Equations and errata of the document as text."""

from collections.abc import Sequence


def cite(equations: Sequence[int], errata: Sequence[str]) -> str:
    """Return equations and errata as text, such as eqs 28 to 34; errata C2, C5."""
    runs: list[list[int]] = []
    for number in equations:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    texts = [', '.join(map(str, run)) if len(run) < 3 else f'{run[0]} to {run[-1]}'
             for run in runs]
    parts = [f'eq{"s" * (len(equations) > 1)} {", ".join(texts)}'] if texts else []
    if errata:
        parts.append(f'{"errata" if len(errata) > 1 else "erratum"} {", ".join(errata)}')
    return '; '.join(parts)
