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
"""
Imports Numba, and tells it what to compile for before it makes its code generator; see target.py.
"""

import os
import sys

from icofabric_sim.kernels.runtime.target import target

# Numba imports the package coverage wherever it is installed, a tenth of its own import, for a
# report that it gives on request.
_BARS_COVERAGE = (
    'coverage' not in sys.modules and not os.environ.get('NUMBA_JIT_COVERAGE', '').strip('0'))
if _BARS_COVERAGE:
    sys.modules['coverage'] = None  # type: ignore[assignment]
try:
    from numba.core import config
finally:
    if _BARS_COVERAGE:
        del sys.modules['coverage']

if target().level:
    config.CPU_NAME = target().level  # type: ignore[attr-defined]
    config.CPU_FEATURES = target().features  # type: ignore[attr-defined]
