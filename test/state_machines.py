# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
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
