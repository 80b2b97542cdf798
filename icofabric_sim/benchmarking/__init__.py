# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Measures the package beside the tools that people would otherwise take; see `icofabric benchmark`.

What a scene is stands in `scenes`, what is true in `reference`, each tool in `peers`, each
measurement in a module of its own, and how figures are shown in `report`.
"""
