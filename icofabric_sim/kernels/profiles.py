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
"""Factors of wrenches in time, and how they are averaged over a drift."""

import math

from icofabric_sim.kernels.records import Varying
from icofabric_sim.kernels.runtime.compiled import compiled

# Gauss-Legendre on (0, 1), exact up to degree 9: beyond the order of every method.
NEAR, FAR = 0.269234655052841545, 0.453089922969331996
NEAR_WEIGHT, FAR_WEIGHT, MIDDLE_WEIGHT = (
    0.239314335249683234, 0.118463442528094544, 64.0 / 225.0)


@compiled
def factor_of(varying: Varying | None, w: int, time: float) -> float:
    """What wrench `w` is multiplied by at `time` [s]."""
    if varying is None:
        return 1.0
    else:
        after = time - varying.start[w]
        return float(
            varying.value[w] + varying.slope[w] * after
            + varying.height[w] * math.sin(varying.rate[w] * after))


@compiled
def is_steady(varying: Varying | None, w: int) -> bool:
    """Whether that is the same at all times."""
    if varying is None:
        return True
    else:
        return bool(varying.slope[w] == 0.0 and varying.height[w] == 0.0)
