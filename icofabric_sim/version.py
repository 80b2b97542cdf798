# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""The version, below everything else: any module may state it."""

__version__ = '0.1.0'
