# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A term of the forces that a device does not know would be left out without a word."""

from icofabric_sim.kernels.records import Model

# By the kernels in simulation/devices/gpu, or by the health checks of the processor.
COMPUTED = {
    'inverse_mass', 'inverse_inertia', 'gravity', 'blocks', 'links', 'bending', 'twisting',
    'supports', 'dipole', 'shells', 'masses', 'damping', 'drag', 'contacts'}
# By simulation/devices/refusals.py: by name, or because they need dop8.
REFUSED = {'magnet', 'coulomb', 'wrapping', 'maxwell', 'gyration'}


def test_each_term_is_computed_or_refused():
    assert not COMPUTED & REFUSED and {*Model._fields} == COMPUTED | REFUSED
