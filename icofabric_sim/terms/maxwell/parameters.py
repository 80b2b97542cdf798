# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the term: name, default, unit, description, range."""

PARAMETERS = (
    ('connector.maxwell_stiffness', 0.0, 'N/m',
     'stiffness k_1 of a Maxwell arm (spring and dashpot in series) parallel to the connector; '
     '0: no arm',
     {'minimum': 0.0}),
    ('connector.maxwell_time', 0.0, 's',
     'relaxation time tau of the Maxwell arm, dashpot coefficient over stiffness; must be '
     'above 0 if connector.maxwell_stiffness is',
     {'minimum': 0.0}),
)
# Those of `connector_groups.NAME`.
GROUP_PARAMETERS = (
    ('maxwell_stiffness', -1.0, 'N/m',
     'k_1 of a Maxwell arm; negative: connector.maxwell_stiffness'),
    ('maxwell_time', -1.0, 's',
     'relaxation time tau of the Maxwell arm; negative: connector.maxwell_time'),
)
