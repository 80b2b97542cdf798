# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Benchmarks of the package and of other tools; see `icofabric benchmark`.

`scenes` has the scenes, `reference` their reference motion, `peers` the other tools, `report` the
tables. Every other module is one measurement.
"""
