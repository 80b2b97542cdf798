# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Makes a scene smaller while its class stays."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, Final

from icofabric_sim.parameters.table import FAMILIES
from icofabric_validation.stress.scenes import StressScene
from icofabric_validation.stress.verdict import Finding

# Tries, at most: each is a run.
MOST_RUNS: Final = 200
# Part of the duration that stays: any part may be enough for a verdict.
_SHORTEST = 2.0**-10
# Without these a scene is another one, or has no end.
_KEPT = ('duration', 'solver.threads')
# What an impossible value is drawn as a multiple of.
_SCALES = (
    'shell.', 'weave.connector_', 'weave.kind', 'connector.stiffness', 'connector.natural_length')


def shrink(
    scene: StressScene, judge: Callable[[StressScene], Finding], *,
    tried: Callable[[int], Any] = lambda count: None
) -> tuple[StressScene, Finding]:
    """
    Take features away one at a time, as long as the verdict stays; and halve the duration.

    Returns the smallest scene that was found, with its finding.
    """
    finding, shortest = judge(scene), _SHORTEST * scene.duration
    wanted, count, found = finding.verdict, 1, True
    while found and count < MOST_RUNS:
        found = False
        for candidate in _smaller(scene, shortest):
            count += 1
            tried(count)
            answer = judge(candidate)
            if answer.verdict is wanted:
                scene, finding, found = candidate, answer, True
                break
            if count >= MOST_RUNS:
                break
    return scene, finding


def _smaller(scene: StressScene, shortest: float) -> Iterator[StressScene]:
    """
    Scenes with one feature less, the largest features first; half as long down to `shortest` [s].

    A spoiled scene keeps what makes its value impossible, else another scene would be judged.
    """
    for smaller in _all_smaller(scene, shortest):
        if not scene.spoiled or all(
                name in smaller.parameters for name in scene.parameters
                if name in scene.spoiled_with or name.startswith(_SCALES)):
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
        if name.split('.')[0] not in FAMILIES and name not in _KEPT:
            yield scene.without([name])
    size = names.get('weave.size')
    if isinstance(size, list):
        for axis, length in enumerate(size):
            if length > 1:
                less = [n - 1 if k == axis else n for k, n in enumerate(size)]
                yield replace(scene, parameters={**names, 'weave.size': less})
    if scene.duration > shortest:
        yield replace(scene, parameters={**names, 'duration': 0.5 * scene.duration})
