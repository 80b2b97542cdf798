# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
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
