# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Integration methods: fact sheets in `methods.py`, one file for each family.
"""
