# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The study of the material: what icosahedral fabric is good for (docs/study.md).

A part has stages, each a study of the sweep store; its tables are made from what these keep.
`part` has the records, `catalogue` all parts, `elastic`, `waves`, `surfaces`, `strength` and
`jamming` the parts themselves.
"""
