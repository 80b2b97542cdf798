# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the term: name, default, unit, description, range."""

PARAMETERS = (
    ('drag.linear', 0.0, 'N s/m',
     'linear drag coefficient of each body',
     {'minimum': 0.0}),
    ('drag.angular', 0.0, 'N m s/rad',
     'rotational drag coefficient of each body',
     {'minimum': 0.0}),
)
