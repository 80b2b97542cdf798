# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""Which shells can touch: broad phase, neighbour list, friction state."""
