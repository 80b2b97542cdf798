# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0

import array
import math

import icofabric_sim as ico
from icofabric_sim.parameters.table import BY_NAME, FAMILIES, STATIC
from icofabric_sim.parameters.validation import make_parameters
import numpy as np
import pytest

# One complete member of each family, so that a single field can be changed.
MEMBERS = {
    'groups': {'groups.m': 'all'},
    'constants': {'constants.m': 9.0},
    'connector_groups': {'connector_groups.m.between': 'all all'},
    'charges': {'charges.m.group': 'all'},
    'masses': {'masses.m.group': 'all'},
    'supports': {'supports.m.group': 'all'},
    'loads': {'loads.m.group': 'all'},
    'tractions': {'tractions.m.group': 'all'},
    'line_loads': {'line_loads.m.group': 'all'},
    'drives': {'drives.m.group': 'all'},
    'anchors': {'anchors.m.position': [9.0, 9.0, 9.0]},
    'planes': {'planes.m.normal': [0.0, 0.0, 1.0]},
    'initial': {'initial.m.group': 'all'},
    'bodies': {'bodies.m.position': [9.0, 9.0, 9.0]},
}
FIELDS = [
    (f'{family}.m.{field.name}' if field.name else f'{family}.m', field)
    for family, fields in FAMILIES.items()
    for field in fields
]
EVERY = [(entry.name, entry) for entry in STATIC] + FIELDS


def kind_of(entry):
    return type(entry.default[0] if isinstance(entry.default, list) else entry.default)


def like(entry, element):
    return [element] * len(entry.default) if isinstance(entry.default, list) else element


def with_one(name, value):
    family = name.split('.')[0]
    members = MEMBERS.get(family, {}) if name not in BY_NAME else {}
    return {**members, name: value}


def refused(name, value):
    with pytest.raises(ico.ParameterError) as caught:
        make_parameters(with_one(name, value))
    assert isinstance(caught.value, ValueError)
    assert caught.value.name == name
    text = str(caught.value)
    assert text.startswith(name)
    return text


def test_defaults_are_the_contract():
    parameters = make_parameters({})
    assert parameters['shell.edge_length'] == 0.02
    assert parameters['weave.size'] == [5, 5, 5]
    assert parameters['connector.stiffness'] == 500.0
    assert parameters['gravity'] == [0.0, 0.0, 0.0]
    assert parameters['solver.method'] == 'auto'
    assert parameters['input_horizon'] == 1.0
    assert len(parameters) == len(STATIC) == len(set(parameters))
    assert parameters.explicit == frozenset() and parameters.given() == {}


@pytest.mark.parametrize('name, entry', EVERY)
def test_every_default_is_accepted_and_described(name, entry):
    if entry.name == 'group' or name == 'groups.m':
        value = 'all'
    elif entry.name == 'between':
        value = 'all all'
    elif entry.required:
        value = 9.0 if name == 'constants.m' else [9.0, 9.0, 9.0]
    else:
        value = entry.default
    parameters = make_parameters(with_one(name, value))
    assert parameters[name] == value
    assert type(parameters[name]) is type(entry.default)
    assert name in parameters.explicit
    assert entry.description
    assert not entry.unit or kind_of(entry) is float


@pytest.mark.parametrize('name, entry', EVERY)
def test_wrong_types_are_refused(name, entry):
    kind = kind_of(entry)
    wrong = {
        float: [True, '1.0', None, {}],
        int: [1.0, True, '1', None],
        bool: [0, 1, 'true', None, 1.0],
        str: [1, 1.0, None],
    }[kind]
    if kind is str and name != 'contact.mode':
        wrong.append(True)
    for element in wrong:
        text = refused(name, like(entry, element))
        assert {
            float: 'must be a number',
            int: 'must be an integer',
            bool: 'must be true or false',
            str: 'must be a text',
        }[kind] in text
        assert repr(like(entry, element)) in text
    if isinstance(entry.default, list):
        for value in (
            entry.default[:-1],
            [*entry.default, entry.default[0]],
            entry.default[0],
            [],
            'x',
        ):
            text = refused(name, value)
            assert f'must be a list of {len(entry.default)} values' in text
            assert f'[{entry.unit}]' in text or not entry.unit
    else:
        refused(name, [entry.default])


@pytest.mark.parametrize('name, entry', [case for case in EVERY if kind_of(case[1]) is float])
def test_numbers_must_be_finite_and_integers_do(name, entry):
    for bad in (math.nan, math.inf, -math.inf):
        assert f'{name} must be finite' in refused(name, like(entry, bad))
    assert f'{name} is too large' in refused(name, like(entry, 10**400))
    whole = make_parameters(with_one(name, like(entry, 1)))[name]
    assert whole == like(entry, 1.0)
    assert type(whole[0] if isinstance(whole, list) else whole) is float


@pytest.mark.parametrize('name, entry', [case for case in EVERY if kind_of(case[1]) is int])
def test_integers_must_fit(name, entry):
    for bad in (2**63, -(2**63) - 1, 10**400):
        assert f'{name} must' in refused(name, like(entry, bad))


@pytest.mark.parametrize(
    'name, entry', [case for case in EVERY if case[1].minimum is not None]
)
def test_ranges(name, entry):
    kind = kind_of(entry)
    low = kind(entry.minimum)
    step = 1 if kind is int else 1e-9
    outside = [low] if entry.open_minimum else []
    outside.append(low - step)
    inside = [low + step] if entry.open_minimum else [low]
    if entry.maximum is not None:
        outside.append(kind(entry.maximum) * 2)
        inside.append(kind(entry.maximum))
    for value in outside:
        text = refused(name, like(entry, value))
        bound = 'must be above' if entry.open_minimum else 'must be at least'
        assert bound in text and repr(like(entry, value)) in text
        assert f'[{entry.unit}]' in text or not entry.unit
        # One bad element of a list is enough.
        if isinstance(entry.default, list):
            refused(name, [*entry.default[:-1], value])
    for value in inside:
        assert make_parameters(with_one(name, like(entry, value)))[name] == like(entry, value)


@pytest.mark.parametrize('name, entry', [case for case in EVERY if case[1].choices])
def test_choices(name, entry):
    for value in entry.choices:
        assert make_parameters(with_one(name, value))[name] == value
    bad = 99 if kind_of(entry) is int else 'sideways'
    text = refused(name, bad)
    assert text == f'{name} must be one of {", ".join(str(c) for c in entry.choices)}, got {bad!r}'


@pytest.mark.parametrize(
    'name, hint',
    [
        ('shell.edgelength', 'did you mean shell.edge_length'),
        ('gravitiy', 'did you mean gravity'),
        ('weave', 'weave'),
        ('shell.colour', 'shell.'),
        ('solver.stp', 'did you mean solver.step'),
        ('loads', 'allowed: '),
        ('', 'allowed: '),
        ('loads.tip.pint', 'allowed: loads.tip.group, loads.tip.frame'),
        ('loads.tip', 'allowed: loads.tip.group'),
        ('groups.tip.more', 'allowed: groups.tip'),
        ('bodies.a.size', 'allowed: bodies.a.position'),
    ],
)
def test_unknown_names_are_refused_with_what_is_meant(name, hint):
    with pytest.raises(ico.ParameterError) as caught:
        make_parameters({name: 1.0})
    assert str(caught.value).startswith(f'{name} is not a parameter; ')
    assert hint in str(caught.value)


@pytest.mark.parametrize('member', ['1a', '_a', 'a__b', 'a-b', 'a b', 'ä', 'a/b', 'a' * 300])
def test_names_of_members(member):
    with pytest.raises(
        ico.ParameterError, match='is not a valid name; use a letter, then letters, digits'
    ):
        make_parameters({f'groups.{member}': 'all', f'loads.{member}.group': 'all'})


@pytest.mark.parametrize('member', ['a', 'A', 'tip_1', 'a1_b2_C3', 'x_'])
def test_good_names_of_members(member):
    parameters = make_parameters({f'groups.{member}': 'x_max', f'loads.{member}.group': member})
    assert parameters.names('groups') == parameters.names('loads') == [member]
    assert parameters[f'loads.{member}.share'] == 'each'
    assert parameters.names('supports') == []


@pytest.mark.parametrize(
    'family, missing',
    [('supports', 'group'), ('loads', 'group'), ('initial', 'group'), ('bodies', 'position')],
)
def test_required_fields(family, missing):
    other = next(field for field in FAMILIES[family] if field.name != missing)
    with pytest.raises(
        ico.ParameterError, match=f'{family}.m.{missing} is missing: {family}.m needs it'
    ):
        make_parameters({f'{family}.m.{other.name}': other.default})


def test_words_that_yaml_makes_booleans():
    assert make_parameters({'contact.mode': False})['contact.mode'] == 'never'
    assert make_parameters({'contact.mode': True})['contact.mode'] == 'always'


@pytest.mark.parametrize(
    'value',
    [
        (0, 0, -9.81),
        np.array([0.0, 0.0, -9.81]),
        array.array('d', [0.0, 0.0, -9.81]),
        [np.float64(0.0), np.float32(0.0), np.float64(-9.81)],
    ],
)
def test_arrays_and_tuples_are_lists(value):
    parameters = make_parameters({'gravity': value})
    assert parameters['gravity'] == [0.0, 0.0, -9.81]
    assert all(type(element) is float for element in parameters['gravity'])
    assert (
        type(make_parameters({'connector.stiffness': np.float64(3.0)})['connector.stiffness'])
        is float
    )
    assert make_parameters({'weave.size': np.array([1, 2, 3])})['weave.size'] == [1, 2, 3]


NESTED = {
    'shell': {'edge_length': 0.03},
    'weave': {'size': [3, 2, 2], 'variant': 1},
    'gravity': [0.0, 0.0, -1.0],
    'groups': {'top': 'z_max'},
    'supports': {'roof': {'group': 'top', 'fix': 'tz'}},
    'loads': {'tip': {'group': 'top', 'force': [1.0, 0.0, 0.0]}},
}
DOTTED = {
    'shell.edge_length': 0.03,
    'weave.size': [3, 2, 2],
    'weave.variant': 1,
    'gravity': [0.0, 0.0, -1.0],
    'groups.top': 'z_max',
    'supports.roof.group': 'top',
    'supports.roof.fix': 'tz',
    'loads.tip.group': 'top',
    'loads.tip.force': [1.0, 0.0, 0.0],
}


def test_nested_and_dotted_dictionaries_are_one():
    mixed = {
        'supports.roof': {'group': 'top', 'fix': 'tz'},
        'weave': {'variant': 1},
        'weave.size': [3, 2, 2],
        **{
            name: value
            for name, value in DOTTED.items()
            if name.split('.')[0] not in ('supports', 'weave')
        },
    }
    file_like = {'/**': {'ros__parameters': NESTED}}
    scenes = [ico.Scene.from_parameters(given) for given in (NESTED, DOTTED, mixed, file_like)]
    scenes.append(ico.Scene.from_parameters(scenes[0].parameters))
    for scene in scenes:
        assert scene.parameters == scenes[0].parameters
        assert scene.parameters.given() == DOTTED
        assert np.array_equal(scene.position, scenes[0].position)
        assert np.array_equal(scene.supports.translation, scenes[0].supports.translation)
    assert scenes[0].body_count == 6 and scenes[0].supports.translation.any()


def test_nothing_that_was_given_is_held_on_to():
    gravity = [0.0, 0.0, -1.0]
    parameters = make_parameters({'gravity': gravity})
    gravity[2] = 5.0
    assert parameters['gravity'] == [0.0, 0.0, -1.0]
    # Nor do two sets share the default.
    one, other = make_parameters({}), make_parameters({})
    assert one['weave.size'] is not other['weave.size'] is not BY_NAME['weave.size'].default


def test_with_changes_leaves_the_original_as_it_was():
    original = make_parameters(DOTTED)
    before = (dict(original), original.explicit)
    changed = original.with_changes(
        {'gravity': [1.0, 2.0, 3.0], 'weave.size': [2, 2, 2], 'groups.low': 'z_min'}
    )
    assert changed['gravity'] == [1.0, 2.0, 3.0]
    assert changed.explicit == original.explicit | {'groups.low'}
    assert changed['shell.edge_length'] == 0.03
    assert (dict(original), original.explicit) == before
    with pytest.raises(ico.ParameterError, match='weave.size must be at least 1'):
        original.with_changes({'gravity': [0.0, 0.0, 0.0], 'weave.size': [0, 2, 2]})
    assert (dict(original), original.explicit) == before


@pytest.mark.parametrize(
    'changes, message',
    [
        ({'shell.thickness': 0.02}, 'shell.thickness'),
        ({'shell.edge_length': 1e-3}, 'shell.thickness'),
        ({'shell.inner_edge_length': 0.021}, 'shell.inner_edge_length'),
        (
            {'shell.inner_edge_length': 0.018, 'shell.thickness': 0.002},
            'shell.thickness 0.002 m disagrees with',
        ),
        ({'weave.connector_angle': 0.8}, 'weave.connector_angle'),
        ({'weave.connector_angle': -0.4}, 'weave.connector_angle'),
        ({'weave.connector_length': 0.01}, 'weave.connector_length'),
        (
            {'weave.connector_length': 0.04, 'weave.connector_angle': 0.1},
            'weave.connector_angle 0.1 rad disagrees',
        ),
        ({'weave.box': [0.1, 0.0, 0.1]}, 'weave.box'),
        ({'weave.box': [0.01, 0.1, 0.1]}, 'weave.box'),
        ({'weave.size': [1, 1, 1], 'weave.variant': 1}, 'weave.size'),
        ({'weave.size': [100_000, 100_000, 100_000]}, 'weave.size'),
        ({'weave.size': [2000, 2000, 1000]}, 'weave.size'),
        ({'supports.s.group': 'nowhere'}, "supports.s.group: there is no group 'nowhere'"),
        ({'loads.l.group': ''}, "loads.l.group: there is no group ''"),
        ({'shell.edge_length': 1e300}, 'shell.'),
    ],
)
def test_what_several_parameters_say_together_is_judged(changes, message):
    with pytest.raises(ValueError) as caught:
        ico.Scene.from_parameters(changes)
    assert str(caught.value).startswith(message)


def test_consistent_pairs_are_taken():
    plain = ico.Scene.from_parameters({'weave.connector_angle': 0.2, 'weave.size': [2, 2, 2]})
    both = ico.Scene.from_parameters(
        {
            'weave.connector_length': plain.geometry.connector_length,
            'weave.connector_angle': 0.2,
            'weave.size': [2, 2, 2],
        }
    )
    np.testing.assert_allclose(both.position, plain.position, rtol=1e-12)
    inner = 2.0 * (0.01 - 0.002 / math.sqrt(2.0 / 3.0 + (1.0 + math.sqrt(5.0)) / 2.0))
    by_edge = ico.Scene.from_parameters(
        {'shell.inner_edge_length': inner, 'shell.thickness': 0.002}
    )
    assert by_edge.shell.mass == pytest.approx(ico.Scene.from_parameters({}).shell.mass, rel=1e-12)
    heavy = ico.Scene.from_parameters({'shell.mass': 1.0})
    assert heavy.shell.mass == 1.0
    assert heavy.shell.inertia * plain.shell.mass == pytest.approx(plain.shell.inertia, rel=1e-12)


def test_prestress():
    scene = ico.Scene.from_parameters({'weave.size': [2, 2, 2], 'connector.natural_length': 0.02})
    assert scene.connectors.natural_length == 0.02
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.001)
    moved = simulation.snapshot().position - scene.position
    # Shorter connectors pull the fabric together.
    assert ((scene.position - scene.position.mean(axis=0)) * moved).sum() < 0.0
