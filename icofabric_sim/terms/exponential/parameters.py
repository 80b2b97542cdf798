# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the law: name, default, unit, description."""

PARAMETERS = (
    ('alpha', 0.0, '1/m',
     'alpha of the law exponential, f = k/alpha (exp(alpha (l - D)) - 1), of any sign but not 0'),
)
