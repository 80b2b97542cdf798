# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Expressions in parameters: their values against Python's, and the errors of invalid ones."""

import math

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.scene.expressions import make_expression, SCALAR_FUNCTIONS, VARIABLES
import numpy as np
import pytest

LOAD = {'groups.g': 'ids 0', 'loads.w.group': 'g', 'constants.k': -2.5}


def expression_of(text, variables=VARIABLES, counts=(1, 3)):
    parameters = make_scene((1, 1, 1), LOAD).parameters.with_changes({
        'loads.w.expression': text})
    return make_expression(parameters, 'loads.w.expression', variables, counts)


@pytest.mark.parametrize('text, expected', [
    ('-x**2 + 2**-y', lambda x, y, t: -x**2 + 2.0**-y),
    ('(-2)**3*x - -y/4', lambda x, y, t: -8.0 * x + y / 4.0),
    ('k*sin(2*pi*t)*exp(-x)', lambda x, y, t: -2.5 * math.sin(2 * math.pi * t) * math.exp(-x)),
    ('x - (y - t) - 1', lambda x, y, t: x - (y - t) - 1.0),
    ('x/(y/t)', lambda x, y, t: x / (y / t)),
    ('2**x**y', lambda x, y, t: 2.0**(x**y)),
    ('where(x < y, min(x, t), max(-x, e))', lambda x, y, t: (
        min(x, t) if x < y else max(-x, math.e))),
    ('where(1 > 2, x, hypot(x, y)) + atan2(y, -x)', lambda x, y, t: (
        math.hypot(x, y) + math.atan2(y, -x))),
    ('abs(k) + sqrt(x)*log(y)/cosh(t)', lambda x, y, t: (
        2.5 + math.sqrt(x) * math.log(y) / math.cosh(t))),
    ('tan(x) + asin(x) + acos(x) + atan(y) + sinh(y) + tanh(t) + cos(1)', lambda x, y, t: (
        math.tan(x) + math.asin(x) + math.acos(x) + math.atan(y) + math.sinh(y) + math.tanh(t)
        + math.cos(1.0))),
])
def test_values_are_those_of_python(text, expected):
    expression = expression_of(text)
    x, y, t = np.array([0.3, 0.7, 0.11]), np.array([1.1, 0.4, 2.0]), np.array([0.2, -0.9, 3.0])
    wanted = [expected(*place) for place in zip(x, y, t)]
    assert expression.values(x=x, y=y, t=t)[0] == pytest.approx(wanted, rel=1e-14)
    # And in the form that is compiled.
    function = expression.function(SCALAR_FUNCTIONS)
    found = [function(*place, 0.0, *when, 0.0, 0.0, 0.0)[0]
             for *place, when in zip(x, y, t[:, None])]
    assert found == pytest.approx(wanted, rel=1e-14)


def test_parts_without_a_variable_become_numbers():
    expression = expression_of('3*k + x, sin(0)*2, 1 - t')
    assert expression.components == ('-7.5 + x', '0.0', '1.0 - t')
    assert expression.variables == ('t', 'x')


@pytest.mark.parametrize('text, words', [
    ('1/0, 0, 0', 'division by zero in column 1;'),
    ('0, x/(1 - 1), 0', 'division by zero in column 4;'),
    ('0, 0, log(-1)', 'log\\(-1\\) is not a finite number in column 7;'),
    ('(-8)**(1/3), 0, 0', 'is not a finite number in column 1;'),
    ('9**9**9**9, 0, 0', 'is not a finite number in column 4;'),
    ('  0, q + 1, 0', "unknown name 'q' in column 6;.* the variables x, y, z, t and"),
    ('xi, 0, 0', "unknown name 'xi' in column 1;"),
    ('0, 0', 'must have 3 components separated by commas, and has 2;'),
    ('x', 'must have 3 components separated by commas, and has 1;'),
    ('0, 0, x.y', "'x.y' is not allowed in column 7;"),
    ('__import__("os"), 0, 0', 'is not allowed in column 1;'),
    ('sin.__class__, 0, 0', 'is not allowed in column 1;'),
    ('[x for x in y], 0, 0', 'is not allowed in column 1;'),
    ('0, "a", 0', 'is not allowed in column 4;'),
    ('0, True, 0', 'is not allowed in column 4;'),
    ('x < 1, 0, 0', 'is not allowed in column 1;'),
    ('sin(x, y), 0, 0', 'sin takes 1 argument, not 2, in column 1;'),
    ('where(x, 1, 2), 0, 0', 'must be a comparison by < <= > or >= in column 7;'),
    ('1 +, 0, 0', 'in column 4;'),
    ('x, # y,\n0, 0, 0', 'comments are not allowed in column 4;'),
    ('+'.join(['x'] * 1500), 'has 2,999 characters'),
    ('-' * 1990 + 'x, 0, 0', 'nested too deeply'),
])
def test_errors_give_the_column_and_what_is_allowed(text, words):
    with pytest.raises(ico.ParameterError, match=f'loads.w.expression .*{words}') as caught:
        make_scene((1, 1, 1), {**LOAD, 'loads.w.expression': text})
    assert caught.value.name == 'loads.w.expression' and 'constants.NAME' in str(caught.value)


@pytest.mark.parametrize('name', ['x', 'pi', 'sin', 'lambda'])
def test_constants_have_names_of_their_own(name):
    with pytest.raises(ico.ParameterError, match=f'constants.{name}.* choose another name'):
        make_scene((1, 1, 1), {f'constants.{name}': 1.0})


@pytest.mark.parametrize('text', ['min(x, y)', 'max(x, y)'])
def test_numbers_that_are_not_finite_stay(text):
    """In either order, and in both forms."""
    expression = expression_of(text)
    function = expression.function(SCALAR_FUNCTIONS)
    for x, y in ((math.nan, 1.0), (1.0, math.nan)):
        assert math.isnan(function(x, y, *[0.0] * 5)[0])
        assert np.isnan(expression.values(x=np.array([x]), y=np.array([y])))
