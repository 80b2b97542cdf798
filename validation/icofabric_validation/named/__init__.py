# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Problems whose answers are known, numbered: what `icofabric stress --named` runs.

`problem.py` says what a problem is and how its curves are judged, `catalogue.py` numbers them,
`report.py` makes the table. `free_bodies.py`, `chain.py`, `loose_bodies.py`, `crowds.py` and
`restitution.py` are shared; every other file is a problem, or two with one scene: the scene, its
answer, and what is compared.
"""
