# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What a change of several parameters does, from the column of the table."""

from icofabric_sim.parameters.changes import (
    affects_motion,
    changed_names,
    effect_of,
    rebuilds,
    require_changeable,
    restarts_motion,
    with_immediate_changes,
)
from icofabric_sim.parameters.table import BY_NAME, Change, FAMILIES
from icofabric_sim.parameters.validation import make_parameters, ParameterError
import pytest

BASE = make_parameters({
    'weave.size': [2, 2, 2], 'groups.tip': 'x_max', 'groups.wall': 'x_min',
    'loads.tip.group': 'tip', 'drives.push.group': 'wall'})


@pytest.mark.parametrize(('changes', 'effect'), [
    ({}, Change.AT_ONCE),
    ({'publish_rate': 30.0, 'real_time_factor': 2.0}, Change.AT_ONCE),
    ({'duration': 4.0, 'step_count': 3, 'input_horizon': 2.0}, Change.AT_ONCE),
    ({'record.path': 'x', 'record.split_size': 4096}, Change.AT_ONCE),
    ({'frame_id': 'map'}, Change.FIXED),
    ({'publish_rate': 30.0, 'gravity': [0.0, 0.0, -1.0]}, Change.REBUILDS),
    ({'solver.step': 1e-5}, Change.REBUILDS),
    ({'loads.tip.hold': 1.0}, Change.REBUILDS),
    ({'loads.other.group': 'tip'}, Change.REBUILDS),
    ({'groups.tip': 'y_max'}, Change.REBUILDS),
    ({'groups.wall': 'y_max'}, Change.RESTARTS),
    ({'drives.push.linear': [0.1, 0.0, 0.0]}, Change.RESTARTS),
    ({'drives.pull.group': 'tip'}, Change.RESTARTS),
    ({'shell.density': 1.0, 'publish_rate': 30.0, 'gravity': [0.0, 0.0, -1.0]},
     Change.RESTARTS),
    ({'bodies.one.position': [1.0, 0.0, 0.0]}, Change.RESTARTS),
])
def test_a_change_does_the_most_that_any_of_its_parameters_does(changes, effect):
    after = BASE.with_changes(changes)
    for one, other in ((BASE, after), (after, BASE)):
        assert effect_of(one, other) is effect
        assert rebuilds(one, other) == (effect in (Change.REBUILDS, Change.RESTARTS))
        assert restarts_motion(one, other) == (effect is Change.RESTARTS)
        assert changes.keys() <= changed_names(one, other)


def test_what_acts_at_once_is_taken_alone_out_of_a_larger_change():
    wanted = BASE.with_changes({'gravity': [0.0, 0.0, -1.0], 'publish_rate': 7.0, 'duration': 3.0})
    taken = with_immediate_changes(BASE, wanted)
    assert changed_names(BASE, taken) == {'publish_rate', 'duration'}
    assert taken['publish_rate'] == 7.0 and taken['gravity'] == BASE['gravity']
    assert with_immediate_changes(BASE, BASE) is BASE


def test_what_is_fixed_is_refused_by_name_in_the_words_of_the_column():
    fixed = {name for name, entry in BY_NAME.items() if entry.change is Change.FIXED}
    assert 'frame_id' in fixed and len(fixed) == 8
    require_changeable([*(BY_NAME.keys() - fixed), 'groups.tip', 'loads.tip.hold'])
    for name in fixed:
        assert not affects_motion(name)
        with pytest.raises(ParameterError, match=f'^{name} is {Change.FIXED.value}; start again'):
            require_changeable(['gravity', name])


def test_the_table_has_every_kind_of_change():
    found = [entry.change for entry in (*BY_NAME.values(), *sum(FAMILIES.values(), ()))]
    assert {change: found.count(change) > 2 for change in Change} == dict.fromkeys(Change, True)
