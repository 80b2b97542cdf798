# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Former names raise an error that gives the new name; the new name exists."""

from dataclasses import fields
import pickle
import re

import icofabric_sim as ico
from icofabric_sim import contact
from icofabric_sim.checks import renamed_attributes
from icofabric_sim.simulation.reports.load_cells import ContactForces
from icofabric_sim.statics.cycles import Cycle
from icofabric_sim.statics.lattice import LatticeRest
from icofabric_sim.statics.moment_curve import MomentCurvePoint
from icofabric_sim.statics.slab_path import Break
from icofabric_sim.statics.stress_strain import CurvePoint
import numpy as np
import pytest


@pytest.mark.parametrize('cls, old', [
    (contact.ContactForce, 'touching'), (ico.Equilibrium, 'leftover'),
    (ico.Equilibrium, 'touching'), (ico.Equilibrium, 'rubbing'), (ico.Spectrum, 'here'),
    (ico.Spectrum, 'freedoms'), (ico.Spectrum, 'zero_below'), (ico.Spectrum, 'bounds_from'),
    (ico.Spectrum, 'hidden_count'), (ico.Spectrum, 'stretching_mechanism_count'),
    (ico.Elasticity, 'pulled'), (ico.Elasticity, 'along'), (ico.Elasticity, 'rest'),
    (ico.Elasticity, 'soft_strains'),
    (CurvePoint, 'beyond'), (CurvePoint, 'touching'), (MomentCurvePoint, 'sliding'),
    (Cycle, 'work'), (Cycle, 'lost'), (Cycle, 'left'), (Break, 'released'),
    (ContactForces, 'first'), (ContactForces, 'push'), (ico.Snapshot, 'lost'),
    (ico.Simulation, 'take_over'), (ico.Simulation, 'break_like'),
    (LatticeRest, 'pressing')])
def test_former_attributes(cls, old):
    made = cls(*len(cls._fields) * [0.0]) if hasattr(cls, '_fields') else cls.__new__(cls)
    with pytest.raises(AttributeError, match=f'{cls.__name__}.{old} has been renamed') as raised:
        getattr(made, old)
    new = re.search(r'use \w+\.(\w+)$', str(raised.value))[1]
    assert hasattr(cls, new) or new in [field.name for field in fields(cls)]
    with pytest.raises(AttributeError, match="no attribute 'unknown'"):
        made.unknown  # noqa: B018


@pytest.mark.parametrize('module, old, new', [
    (ico, 'measure_turning', 'measure_moment_curve'), (contact, 'push', 'contact_force'),
    (contact, 'push_of_plane', 'plane_contact_force'), (contact, 'Push', 'ContactForce')])
def test_former_functions(module, old, new):
    with pytest.raises(AttributeError, match=rf'{old} has been renamed: use \w+\.{new}$'):
        getattr(module, old)
    assert callable(getattr(module, new))


@renamed_attributes(old='new')
class Plain:
    """A class with a renamed attribute and a broken property."""

    def __init__(self):
        self.new = np.arange(3)

    @property
    def broken(self):
        """Property that raises."""
        return self.new.nothing


def test_other_errors_and_pickles_are_kept():
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        Plain().broken  # noqa: B018
    assert (pickle.loads(pickle.dumps(Plain())).new == np.arange(3)).all()
    assert not hasattr(Plain(), 'old')
