# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
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
