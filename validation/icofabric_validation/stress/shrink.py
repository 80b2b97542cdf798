# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Minimise a scene while its class remains."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, Final

from icofabric_sim.parameters.table import FAMILIES
from icofabric_validation.stress.scenes import StressScene
from icofabric_validation.stress.verdict import Finding

# Largest number of runs.
MAX_RUNS: Final = 200
# Smallest fraction of the duration.
_MIN_DURATION_RATIO = 2.0**-10
# Parameters that every scene needs.
_REQUIRED = ('duration', 'solver.threads')
# Prefixes of parameters that set the scale of impossible values.
_SCALE_PREFIXES = (
    'shell.', 'weave.connector_', 'weave.kind', 'connector.stiffness', 'connector.natural_length')


def shrink(
    scene: StressScene, judge: Callable[[StressScene], Finding], *,
    tried: Callable[[int], Any] = lambda count: None
) -> tuple[StressScene, Finding]:
    """
    Remove one feature at a time and halve the duration while the verdict remains.

    Returns the smallest scene found, with its finding.
    """
    finding, shortest = judge(scene), _MIN_DURATION_RATIO * scene.duration
    wanted, count, found = finding.verdict, 1, True
    while found and count < MAX_RUNS:
        found = False
        for candidate in _smaller(scene, shortest):
            count += 1
            tried(count)
            answer = judge(candidate)
            if answer.verdict is wanted:
                scene, finding, found = candidate, answer, True
                break
            if count >= MAX_RUNS:
                break
    return scene, finding


def _smaller(scene: StressScene, shortest: float) -> Iterator[StressScene]:
    """
    Yield scenes without one feature, the largest features first, and one of half the duration.

    Durations are at least `shortest` [s]. A spoiled scene keeps the parameters that make its value
    impossible.
    """
    for smaller in _all_smaller(scene, shortest):
        if not scene.spoiled or all(
                name in smaller.parameters for name in scene.parameters
                if name in scene.spoiled_with or name.startswith(_SCALE_PREFIXES)):
            yield smaller


def _all_smaller(scene: StressScene, shortest: float) -> Iterator[StressScene]:
    names = scene.parameters
    if scene.change and not scene.spoiled:
        yield replace(scene, change={})
        if len(scene.change) > 1:
            for name in scene.change:
                yield replace(scene, change={
                    other: value for other, value in scene.change.items() if other != name})
    heads = dict.fromkeys(
        '.'.join(name.split('.')[:2]) for name in names if name.split('.')[0] in FAMILIES)
    for head in heads:
        yield scene.without([name for name in names if f'{name}.'.startswith(f'{head}.')])
    for room in ('initial_random', 'charge', 'field', 'drag', 'contact'):
        some = [name for name in names if name.startswith(f'{room}.')]
        if len(some) > 1:
            yield scene.without(some)
    for name in names:
        if name.split('.')[0] not in FAMILIES and name not in _REQUIRED:
            yield scene.without([name])
    size = names.get('weave.size')
    if isinstance(size, list):
        for axis, length in enumerate(size):
            if length > 1:
                less = [n - 1 if k == axis else n for k, n in enumerate(size)]
                yield replace(scene, parameters={**names, 'weave.size': less})
    if scene.duration > shortest:
        yield replace(scene, parameters={**names, 'duration': 0.5 * scene.duration})
