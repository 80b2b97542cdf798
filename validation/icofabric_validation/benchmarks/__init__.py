# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Measures the package beside the tools that people would otherwise take; see `icofabric benchmark`.

What a scene is stands in `scenes`, what is true in `reference`, each tool in `peers`, each
measurement in a module of its own, and how figures are shown in `report`.
"""
