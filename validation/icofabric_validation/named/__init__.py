# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Numbered problems with known answers, which `icofabric stress --named` runs.

`problem.py` defines a problem and judges its curves, `catalogue.py` numbers the problems, and
`report.py` makes the table. `free_bodies.py`, `chain.py`, `loose_bodies.py`, `crowds.py` and
`restitution.py` are shared. Every other file has one problem, or two with the same scene: the
scene, its answer, and the compared quantity.
"""
