# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the term: name, default, unit, description, range."""

PARAMETERS = (
    ('charge.mutual', False, '',
     'forces between charges and dipoles of all pairs of bodies; at most 5000 bodies'),
)
