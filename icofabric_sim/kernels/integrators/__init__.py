# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""The loops over steps: splitting methods and the embedded Runge-Kutta pair."""
