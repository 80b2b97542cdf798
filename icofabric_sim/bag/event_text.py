# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptions of the events of a recorded run."""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from icofabric_sim.bag.recorded_run import RecordedEvent
from icofabric_sim.checks import counted
from icofabric_sim.scene.summary import Row

# Largest number of events listed in a summary; a client may step thousands of times.
MAX_LISTED_EVENTS = 12
# Largest number of listed names of a change.
_MAX_LISTED_NAMES = 4
# Singular and plural.
_NAMES = {
    'reweave': ('fabric change', 'fabric changes'),
    'reset': ('reset', 'resets'),
    'pause': ('pause', 'pauses'),
    'step': ('call of ~/step', 'calls of ~/step'),
    'advance': ('call of ~/advance', 'calls of ~/advance'),
    'loads_cleared': ('call of ~/clear_loads', 'calls of ~/clear_loads'),
    'checkpoint_saved': ('checkpoint saved', 'checkpoints saved'),
    'checkpoint_restored': ('checkpoint restored', 'checkpoints restored'),
    'state_set': ('body state set', 'body states set'),
    'equilibrium': ('call of ~/solve_equilibrium', 'calls of ~/solve_equilibrium'),
    'failed': ('failure', 'failures'),
    'stalled': ('stall', 'stalls'),
    'change_refused': ('change that could not be built', 'changes that could not be built'),
}


class EventDigest(NamedTuple):
    """Counts of each event, and the first events."""

    counts: Counter[str]
    first: tuple[RecordedEvent, ...]


def digest_events(events: Iterable[RecordedEvent]) -> EventDigest:
    """Count events without keeping all of them."""
    counts: Counter[str] = Counter()
    first: list[RecordedEvent] = []
    for event in events:
        counts[event.name] += 1
        if len(first) < MAX_LISTED_EVENTS:
            first.append(event)
    return EventDigest(counts, tuple(first))


def event_rows(digest: EventDigest) -> list[Row]:
    """Return label and text of all events."""
    parts = [
        f'{digest.counts[name]:,} {words[digest.counts[name] > 1]}'
        for name, words in _NAMES.items() if digest.counts[name]]
    total = sum(digest.counts.values())
    rows = [('events', ', '.join(parts) or (f'{total:,}' if total else 'none'))]
    rows += [('', f't = {event.time:.9g} s  {describe_event(event)}') for event in digest.first]
    more = total - len(digest.first)
    if more:
        rows.append(('', f'... and {more:,} more'))
    return rows


def describe_event(event: RecordedEvent) -> str:
    """Describe one event; its data may be of another version."""
    facts = event.facts
    texts = {
        'pause': 'paused',
        'resume': 'resumed',
        'step': _steps(facts.get('count')),
        'advance': 'advance started (~/advance)',
        'advanced': 'advance completed',
        'advance_ended': 'advance ended early',
        'loads_cleared': 'all wrenches were cleared',
        'reset': 'reset to the initial state' + (
            ' and to time 0' if facts.get('time_reset') else ''),
        'reweave': _change(facts),
        'change_refused': f'a change could not be built: {facts.get("reason")}',
        'failed': f'the simulation failed: {facts.get("reason")}',
        'stalled': f'{facts.get("reason")}',
        'checkpoint_saved': f'a checkpoint was saved to {facts.get("path")}',
        'checkpoint_restored': (
            f'restored from the checkpoint of t = {facts.get("of")} s in {facts.get("path")}'),
        'record': 'recording on' if facts.get('on') else 'recording off',
        'state_set': f'body {facts.get("body")} was set to a new state',
        'equilibrium': f'equilibrium solved: {facts.get("verdict")}',
    }
    return texts.get(event.name, event.name) + _dropped(facts)


def _change(facts: Mapping[str, Any]) -> str:
    names = [str(name) for name in _list(facts, 'changed')]
    more = len(names) - _MAX_LISTED_NAMES
    changed = ', '.join(names[:_MAX_LISTED_NAMES]) + (f' and {more} more' if more > 0 else '')
    text = ('re-woven with' if facts.get('restarts') else 'rebuilt with') + f': {changed}'
    lost = ', '.join(str(name) for name in _list(facts, 'lost')[:_MAX_LISTED_NAMES])
    return f'{text}; wrenches ended: {lost}' if lost else text


def _list(facts: Mapping[str, Any], name: str) -> list[Any]:
    value = facts.get(name)
    return value if isinstance(value, list) else []


def _dropped(facts: Mapping[str, Any]) -> str:
    count = facts.get('dropped')
    return f' ({count} waiting wrenches dropped)' if count else ''


def _steps(count: Any) -> str:
    return f'{counted(count, "solver step") if isinstance(count, int) else "solver steps"} taken'
