# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Programs that check the repository: commands on pages, and tests against planted faults."""
