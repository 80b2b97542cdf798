# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the term: name, default, unit, description, range."""

PARAMETERS = (
    ('connector.damping', 0.0, 'N s/m',
     'viscous damping along the connector',
     {'minimum': 0.0}),
)
# Those of `connector_groups.NAME`.
GROUP_PARAMETERS = (
    ('damping', -1.0, 'N s/m',
     'damping along the connectors; negative: connector.damping'),
)
