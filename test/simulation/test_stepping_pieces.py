# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The pieces of a driver are held, not inherited; a new one is one file."""

import ast
import importlib
import math
from pathlib import Path
import re
import textwrap

from fabrics import make_scene, RANDOM, same_state
import icofabric_sim as ico
from icofabric_sim.simulation import stepping
from icofabric_sim.simulation.stepping import controllers, events
from icofabric_sim.simulation.stepping.methods import METHODS
from icofabric_sim.simulation.stepping.pieces import StepChoice
import numpy as np
import pytest

PAGE = Path(__file__).parents[2] / 'docs' / 'adding_a_method.md'
FOLDER = Path(stepping.__file__).parent
GRAVITY, HEIGHT = 9.81, -0.5


def test_no_piece_inherits_from_another():
    seen = 0
    for path in FOLDER.rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef):
                seen += 1
                # The last three are interfaces whose methods have defaults.
                assert {ast.unparse(base) for base in node.bases} <= {
                    'Enum', 'NamedTuple', 'Protocol', 'Executor', 'Stepping', 'StepController'}, (
                    f'{path.name}: {node.name}')
    assert seen > 20


@pytest.mark.parametrize('name', METHODS)
@pytest.mark.parametrize('given', [0.0, 1e-4])
@pytest.mark.parametrize('embedded', [False, True])
def test_one_controller_suits_each_choice(name, given, embedded):
    choice = StepChoice(METHODS[name], given, embedded, 0.01)
    suited = [module for module in controllers.controllers() if module.suits(choice)]
    assert len(suited) == 1


def test_a_reset_goes_back_to_the_given_step():
    given = 2e-5
    scene = ico.load_scene('torn_slab')
    simulation = ico.compile_scene(ico.Scene.from_parameters(scene.parameters.with_changes({
        'solver.step': given})))
    # As a failure leaves it in a step that ends where a connector breaks.
    simulation._driver.trajectory.step = 0.3 * given
    simulation.reset()
    assert simulation.status.step == given
    simulation.advance_to(3.5 * given)
    assert simulation.status.step == given and simulation.status.step_count == 3


@pytest.fixture
def from_page(tmp_path, monkeypatch):
    """Put a file of docs/adding_a_method.md into a folder of pieces, as a newcomer does."""
    def put(package, name):
        text = PAGE.read_text()
        start = text.index('\n    """', text.index(f', saved as {name}.py in that folder'))
        block = re.match(r'(?:\n| {4}.*\n)+', text[start:])
        (tmp_path / f'{name}.py').write_text(textwrap.dedent(block.group()))
        monkeypatch.setattr(package, '__path__', [*package.__path__, str(tmp_path)])
        importlib.invalidate_caches()
    return put


def test_a_controller_is_one_file(from_page):
    changes = {'solver.method': 'srkn6', 'solver.tolerance': 1e-4}
    before = ico.compile_scene(make_scene((3, 3, 3), changes, **RANDOM))
    from_page(controllers, 'fraction')
    simulation, pieces = (
        ico.compile_scene(make_scene((3, 3, 3), changes, **RANDOM)) for _ in range(2))
    assert simulation.status.step == simulation.status.stability_limit / 20.0
    assert before.status.step != simulation.status.step
    simulation.advance_to(0.05)
    for time in np.linspace(0.0, 0.05, 7)[1:]:
        pieces.advance_to(time)
    assert same_state(simulation.snapshot(), pieces.snapshot())
    # The limit follows the motion, and so does the step.
    assert simulation.status.step_count > 200
    limits = METHODS['srkn6'].stability / simulation.status.largest_frequency
    assert simulation.status.step == pytest.approx(limits / 20.0, rel=0.2)
    # Given steps have the controller that they had.
    given = ico.compile_scene(make_scene((3, 3, 3), {**changes, 'solver.step': 1e-5}, **RANDOM))
    assert given.status.step == 1e-5


def test_an_event_is_one_file(from_page):
    changes = {'gravity': [0.0, 0.0, -GRAVITY]}
    from_page(events, 'bounce')
    simulation, pieces = (ico.compile_scene(make_scene((1, 1, 1), changes)) for _ in range(2))
    assert simulation.status.method_name == 'dop8'
    assert 'bounces' in simulation.status.method_reason
    start = simulation.snapshot().position[0, 2]
    # Free fall to the height, and back: z = v t - g t^2 / 2 with the velocity of the fall.
    fall = math.sqrt(2.0 * (start - HEIGHT) / GRAVITY)
    simulation.advance_to(end := 1.5 * fall)
    rise = end - fall
    expected = HEIGHT + GRAVITY * fall * rise - 0.5 * GRAVITY * rise**2
    assert simulation.snapshot().position[0, 2] == pytest.approx(expected, abs=1e-9)
    # In pieces, one of which ends next to the bounce, and from a checkpoint of then.
    checkpoint = None
    for time in (0.3 * fall, fall * (1.0 - 1e-9), fall * (1.0 + 1e-9), end):
        pieces.advance_to(time)
        if time < fall:
            checkpoint = pieces.checkpoint()
    assert same_state(simulation.snapshot(), pieces.snapshot())
    again = ico.compile_scene(make_scene((1, 1, 1), changes))
    again.restore(ico.Checkpoint.from_bytes(checkpoint.to_bytes()))
    again.advance_to(end)
    assert same_state(simulation.snapshot(), again.snapshot())
    # It bounces once: back at the height after 3 times the fall, the body falls on.
    again = ico.compile_scene(make_scene((1, 1, 1), changes))
    again.restore(simulation.checkpoint())
    for run in (simulation, again):
        run.advance_to(3.5 * fall)
        assert run.snapshot().position[0, 2] == pytest.approx(
            HEIGHT - 0.5 * GRAVITY * (1.25 * fall**2), abs=1e-9)
    assert same_state(simulation.snapshot(), again.snapshot())
    # Nothing of it is in scenes that it does not concern.
    other = ico.compile_scene(make_scene((2, 2, 2), {'solver.method': 'srkn4', **changes}))
    assert other.status.method_name == 'srkn4'
