# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What ranks, GPUs and methods lack is stated in the registry, and refused by its name."""

from fabrics import make_scene
from icofabric_sim.kernels.records import Model
from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.simulation.devices import refusals
from icofabric_sim.simulation.devices.division import divide
from icofabric_sim.simulation.devices.window import slots_of, window_of
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.simulation.stepping.method_needs import required_method
from icofabric_sim.terms.interface import PLACES
from icofabric_sim.terms.registry import LAWS, LOADS, TERMS
import numpy as np
import pytest

# Fields of the model that are no terms: the kernels of a GPU read all but the last.
OTHERS = {
    'inverse_mass', 'inverse_inertia', 'blocks', 'supports', 'shells', 'masses', 'gyration'}
NEVER = {'contact.mode': 'never'}
# Scenes with each term or law that something lacks.
WITH = {
    'wrapping': {'connector.obstruction': 'wrap'},
    'dipole': {'charge.dipole': [1e-6, 0.0, 0.0], 'field.electric': [0.0, 0.0, 1e4]},
    'coulomb': {'charge.mutual': True, 'charge.per_body': 1e-7},
    'damping': {'connector.damping': 0.1},
    'ties': {'connectors.a.bodies': [0, 5]},
    'maxwell': {'connector.maxwell_stiffness': 100.0, 'connector.maxwell_time': 0.01},
    'drag': {'drag.linear': 0.1},
    'platens': {'planes.it.normal': [0.0, 0.0, 1.0], 'planes.it.motion': 'hold'},
    'magnet': {'charge.per_body': 1e-7, 'field.magnetic': [0.0, 0.0, 1.0]}}
PARTS = [part for part in (*TERMS, *LOADS, *LAWS) if part.lacks]


def is_refused(place, changes, *, body_force=False):
    """True if a scene is refused there."""
    methods = {'implicit': 'sdirk4', 'splitting': 'leapfrog'}
    try:
        scene = make_scene((3, 3, 3), {**NEVER, **changes, **(
            {'solver.method': methods[place]} if place in methods else {})})
        if place == 'ranks':
            refusals.require_shareable(scene, cosines=False, body_force=body_force)
        elif place == 'GPU':
            refusals.require_on_device(
                scene, cosines=False, body_force=body_force, shared=False)
        else:
            required_method(scene, outside=body_force)
    except (ParameterError, ValueError):
        return True
    return False


def test_each_field_of_the_model_is_a_term_or_known():
    # The record of a body force is a field of `Work`.
    assert {*Model._fields} == OTHERS | {term.name for term in TERMS} - {'body_force'}


@pytest.mark.parametrize('part', PARTS, ids=lambda part: part.name)
def test_a_term_is_refused_where_the_registry_says(part, tmp_path):
    changes = WITH.get(part.name, {})
    if part.name == 'tables':
        path = tmp_path / 'law.csv'
        path.write_text('0.02, -2\n0.03, 0\n0.05, 4\n')
        changes = {'connector.law': str(path)}
    for place in PLACES:
        assert is_refused(place, changes, body_force=part.name == 'body_force') == (
            place in part.lacks), place


@pytest.mark.parametrize('changes', [
    {}, {'connector.bending_stiffness': 0.01}, {'connector.twisting_stiffness': 0.01},
    {'gravity': [0.0, 0.0, -9.8]}, {'connector.law': 'exponential', 'connector.alpha': 50.0}])
def test_other_terms_are_computed_everywhere(changes):
    assert not any(is_refused(place, changes) for place in PLACES)


class Uncut(Record):
    """A term with a number for each body."""

    moment: np.ndarray


def test_kernels_of_a_gpu_compute_all_terms_that_the_registry_does_not_exclude():
    pytest.importorskip('warp')
    from icofabric_sim.simulation.devices.gpu.arrays import COMPUTED, fabric_of
    from icofabric_sim.simulation.devices.gpu.opening import open_device

    assert {term.name for term in TERMS if 'GPU' not in term.lacks} == COMPUTED
    packed = pack_scene(make_scene((2, 2, 1), {**NEVER, **WITH['maxwell']}))
    with pytest.raises(NotImplementedError, match='the term maxwell'):
        fabric_of(packed.model, packed.layout, open_device('warp_cpu'))


def test_ranks_refuse_an_array_of_the_whole_fabric():
    packed = pack_scene(make_scene((4, 4, 4), {**NEVER, **WITH['drag']}))
    part = divide(packed.layout, packed.model.links, 2)[0]
    slots = slots_of(packed.model, packed.layout, part)
    uncut = packed.model._replace(drag=Uncut(np.ones((1, packed.layout.slot_count))))
    with pytest.raises(NotImplementedError, match='moment of the term drag'):
        window_of(uncut, packed.layout, part, slots, np.zeros(0, np.int32))
