# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The material study: properties and uses of icosahedral fabric (docs/study.md).

A part has stages, each a study in the sweep store, and tables of their results. `part` has the
records and `catalogue` all parts. `elastic`, `waves`, `surfaces`, `strength`, `jamming` and
`friction` define the parts.
"""
