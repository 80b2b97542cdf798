# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the term: name, default, unit, description, range."""

PARAMETERS = (
    ('connector.twisting_stiffness', 0.0, 'N m/rad',
     'stiffness kappa_t against a relative rotation of the two bodies by an angle phi; energy '
     'kappa_t (1 - cos phi)',
     {'minimum': 0.0}),
)
# Those of `connector_groups.NAME`.
GROUP_PARAMETERS = (
    ('twisting_stiffness', -1.0, 'N m/rad',
     'kappa_t; negative: connector.twisting_stiffness'),
)
