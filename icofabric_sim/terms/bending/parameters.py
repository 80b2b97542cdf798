# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the term: name, default, unit, description, range."""

PARAMETERS = (
    ('connector.bending_stiffness', 0.0, 'N m/rad',
     'stiffness kappa_b against bending at each end; energy kappa_b (1 - cos phi) at an angle '
     'phi between the connector and its direction as woven, fixed in the body',
     {'minimum': 0.0}),
)
# Those of `connector_groups.NAME`.
GROUP_PARAMETERS = (
    ('bending_stiffness', -1.0, 'N m/rad',
     'kappa_b; negative: connector.bending_stiffness'),
)
