# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Compiled loops over bodies and connectors; each also runs as plain Python with NUMBA_DISABLE_JIT=1.
"""
