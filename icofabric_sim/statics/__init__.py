# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""Fabrics at rest: equilibria, small vibrations, mechanisms. The same forces as in motion."""
