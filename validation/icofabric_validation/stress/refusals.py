# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Judges of refusals and stops by their messages.

The refusal of a spoiled scene must name the spoiled parameter. The other scenes may be refused
only for a few known contradictions.
"""

from collections.abc import Callable
import math
import re
from typing import Final

from icofabric_sim.parameters.table import BY_NAME, FAMILIES
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.simulation.errors import SimulationError
from icofabric_sim.simulation.simulation import Simulation
from icofabric_sim.simulation.stepping.wrap_jumps import depths_of
import numpy as np

# Parameters that a refusal may name instead of the spoiled one.
PARTNERS: Final[dict[str, tuple[str, ...]]] = {
    # The scene may give both.
    'shell.thickness': ('shell.inner_edge_length',),
    'weave.connector_angle': ('weave.connector_length',),
    'weave.connector_length': ('weave.connector_angle',),
    # The spoiled scene has a method that may not support its terms.
    'solver.step': ('solver.method',)}
# Contradictions in scenes that are not spoiled: start of a parameter, and words of the message.
ACCIDENTAL_REFUSALS: Final = (
    ('solver.step', 'is beyond the stability limit'),
    ('solver.step', 'is too long for present or possible contacts'),
    ('solver.method', 'cannot integrate this scene'),
    ('weave.size', 'has no icosahedron'),
    ('weave.box', 'no icosahedron fits'),
    ('weave.region', 'contains no centre'),
    ('groups.', 'selects no body'),
    ('anchors.tie.body', 'there is no body'),
    ('anchors.tie.break_length_', 'would break at once'),
    ('bodies.ball.', 'which a support holds'),
    ('bodies.ball.inertia', 'the largest possible'),
    ('shell.inertia', 'the largest possible'),
    ('masses.others.inertia', 'the largest possible'),
    # Lighter shells, after a change of the density.
    ('shell.principal_inertia', 'the largest possible'),
    ('initial.kick.', 'which a support holds'),
    ('initial.kick.', 'disagrees with drives.'),
    ('connector.break_length_', 'at which they would break at once'),
    ('connector_groups.seam.between', 'no connector leads from one to the other'),
    ('connector_groups.seam.break_length_', 'at which they would break at once'),
    ('drives.table.', 'the velocity would jump at the start'),
    ('tractions.wind.group', 'rotates body'),
    # A body outside the weave or a displaced body, which overlaps another shell.
    ('contact.mode', 'move them apart'))
# Number of states of a reference run that are searched for overlaps of charged bodies.
_SEARCHED_STATES: Final = 64


def is_right_refusal(error: ValueError, spoiled: str) -> bool:
    """Return True if `error` is right for the spoiled parameter, or for a scene without one."""
    text = str(error)
    named = error.name if isinstance(error, ParameterError) else ''
    if spoiled:
        return any(_mentions(text, named, name) for name in (spoiled, *PARTNERS.get(spoiled, ())))
    return any(
        words in text and re.search(rf'(?<![\w.]){re.escape(start)}', text) is not None
        for start, words in ACCIDENTAL_REFUSALS)


def _mentions(text: str, named: str, name: str) -> bool:
    """Return True if a text, or the parameter `named` of its error, mentions `name`."""
    if name == named:
        return True
    # Names without a dot may be ordinary words.
    before = r'(?<![\w.])' if '.' in name else '^'
    return re.search(rf'{before}{re.escape(name)}(?!\w)', text) is not None


def first_parameter(text: str) -> str:
    """Return the first parameter in a sentence, or an empty string."""
    for word in re.findall(r'(?<![\w.])[a-z]\w*(?:\.\w+)+', text):
        if word in BY_NAME or word.split('.')[0] in FAMILIES:
            return str(word)
    return ''


def stop_time(text: str) -> float:
    """Return the time [s] in the message of a stop; infinite if the message has none."""
    found = re.search(r'\bt = (-?\d[\d.]*(?:e[+-]?\d+)?) s', text)
    return float(found.group(1)) if found else math.inf


def did_length_jump(text: str, run: Simulation) -> bool:
    """
    Return True if the last state of a run confirms that the length of a connector jumped.

    In this state the two shells that `text` names overlap, the scene has no contact, and the
    connector joins the two shells and is wrapped over one of them.
    """
    parameters = run.scene.parameters
    named = re.search(
        r'connector\.obstruction is wrap, the shells of bodies (\d+) and (\d+) pass through each '
        r'other, .* connector (\d+) ', text)
    if named is None or parameters['connector.obstruction'] != 'wrap' or (
            parameters['contact.mode'] != 'never'):
        return False
    *bodies, connector = (int(number) for number in named.groups())
    state = run.snapshot()
    ends = run.scene.connectors.bodies[connector].tolist()
    depths = depths_of(
        state, run.scene.geometry.half_edge, np.array(bodies[:1]), np.array(bodies[1:]))
    return sorted(ends) == sorted(bodies) and bool(state.obstructed[connector]) and bool(
        depths[0] > 0.0)


def did_charges_pass(text: str, run: Simulation, reference_of: Callable[[], Simulation]) -> bool:
    """
    Return True if a reference run confirms that two charged bodies passed each other.

    The scene then has no contact, and the shells that `text` names overlap in the reference, which
    starts from the last state of the run, before the time of the stop. `reference_of` compiles the
    reference.
    """
    parameters = run.scene.parameters
    named = re.search(
        r'bodies (\d+) and (\d+), whose charges act on each other \(charge\.mutual\), pass each '
        r'other ', text)
    moment = stop_time(text)
    if named is None or not parameters['charge.mutual'] or (
            parameters['contact.mode'] != 'never') or not math.isfinite(moment):
        return False
    one, two = (int(number) for number in named.groups())
    start, reference = run.time, reference_of()
    reference.reset_time()
    reference.continue_from(run, keep_motion=True)
    for part in range(1, _SEARCHED_STATES + 1):
        try:
            reference.advance_to(start + (moment - start) * part / _SEARCHED_STATES)
        except SimulationError:
            return False
        depths = depths_of(
            reference.snapshot(), run.scene.geometry.half_edge, np.array([one]), np.array([two]))
        if depths[0] > 0.0:
            return True
    return False
