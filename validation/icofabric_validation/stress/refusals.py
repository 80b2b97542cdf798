# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Which refusals are right: those of a spoiled scene name what was spoiled, others are few.

And which stops need no other run to be judged.
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

# Names that a refusal of a spoiled parameter may say in its place.
PARTNERS: Final[dict[str, tuple[str, ...]]] = {
    # Spoiled where the scene may give both.
    'shell.thickness': ('shell.inner_edge_length',),
    'weave.connector_angle': ('weave.connector_length',),
    'weave.connector_length': ('weave.connector_angle',),
    # Spoiled with a method that may not suit the scene.
    'solver.step': ('solver.method',)}
# What chance may bring together in a scene that is not spoiled: beginning of a name, and words.
REFUSED_BY_CHANCE: Final = (
    ('solver.step', 'is beyond the stability limit'),
    ('solver.step', 'is too long for what touches'),
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
    # Of lighter shells, once the density has changed.
    ('shell.principal_inertia', 'the largest possible'),
    ('initial.kick.', 'which a support holds'),
    ('initial.kick.', 'disagrees with drives.'),
    ('connector.break_length_', 'at which they would break at once'),
    ('connector_groups.seam.between', 'no connector leads from one to the other'),
    ('connector_groups.seam.break_length_', 'at which they would break at once'),
    ('drives.table.', 'the velocity would jump at the start'),
    ('tractions.wind.group', 'rotates body'),
    # A ball, or a body that begins elsewhere, in another shell.
    ('contact.mode', 'move them apart'))
# States of a tighter run in which charged bodies are looked for that pass each other.
_LOOKS: Final = 64


def is_right_refusal(error: ValueError, spoiled: str) -> bool:
    """Whether a scene whose parameter `spoiled` ('': none) is impossible was refused for it."""
    text = str(error)
    named = error.name if isinstance(error, ParameterError) else ''
    if spoiled:
        return any(_says(text, named, name) for name in (spoiled, *PARTNERS.get(spoiled, ())))
    return any(
        words in text and re.search(rf'(?<![\w.]){re.escape(start)}', text) is not None
        for start, words in REFUSED_BY_CHANCE)


def _says(text: str, named: str, name: str) -> bool:
    """Whether a text, of an error that may be `named` for a parameter, is about `name`."""
    if name == named:
        return True
    # Names without a dot are words of prose, too.
    before = r'(?<![\w.])' if '.' in name else '^'
    return re.search(rf'{before}{re.escape(name)}(?!\w)', text) is not None


def first_name(text: str) -> str:
    """The first parameter that a sentence names; '': none."""
    for word in re.findall(r'(?<![\w.])[a-z]\w*(?:\.\w+)+', text):
        if word in BY_NAME or word.split('.')[0] in FAMILIES:
            return str(word)
    return ''


def moment_of(text: str) -> float:
    """Time [s] at which a run stopped, as its sentence says first; infinite: it does not say."""
    found = re.search(r'\bt = (-?\d[\d.]*(?:e[+-]?\d+)?) s', text)
    return float(found.group(1)) if found else math.inf


def has_jumped(text: str, run: Simulation) -> bool:
    """
    Whether a run that stopped for a jump of the length of a connector had to, by its last state.

    That is: the two shells that `text` names do pass through each other there, nothing keeps them
    apart, and a connector leads from one to the other around one of them.
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


def have_met(text: str, run: Simulation, reference_of: Callable[[], Simulation]) -> bool:
    """
    Whether a run that stopped as charged bodies passed each other had to, by a tighter run.

    That is: nothing keeps shells apart, and from its last state on those of the two bodies that
    `text` names do pass through each other in the reference, before the run stopped.
    `reference_of` compiles it.
    """
    parameters = run.scene.parameters
    named = re.search(
        r'bodies (\d+) and (\d+), whose charges act on each other \(charge\.mutual\), pass each '
        r'other ', text)
    moment = moment_of(text)
    if named is None or not parameters['charge.mutual'] or (
            parameters['contact.mode'] != 'never') or not math.isfinite(moment):
        return False
    one, two = (int(number) for number in named.groups())
    start, reference = run.time, reference_of()
    reference.reset_time()
    reference.take_over(run, keep_motion=True)
    for part in range(1, _LOOKS + 1):
        try:
            reference.advance_to(start + (moment - start) * part / _LOOKS)
        except SimulationError:
            return False
        depths = depths_of(
            reference.snapshot(), run.scene.geometry.half_edge, np.array([one]), np.array([two]))
        if depths[0] > 0.0:
            return True
    return False
