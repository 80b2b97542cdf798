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
"""What tests by state machines share: how many examples they draw, and from what."""
import os

from hypothesis import HealthCheck, Phase, settings

# So many times as many examples, drawn anew each time; 1: the same ones in every run.
FACTOR = max(1, int(os.environ.get('ICOFABRIC_EXAMPLES', '1')))


def examples(count, steps):
    """Settings of a machine: `count` examples of at most `steps` rules each."""
    return settings(
        max_examples=count * FACTOR, stateful_step_count=steps, derandomize=FACTOR == 1,
        database=None, deadline=None, print_blob=True,
        # A machine that is slow is one that computes; what was found is made smaller.
        suppress_health_check=list(HealthCheck),
        phases=(Phase.explicit, Phase.generate, Phase.shrink))
