# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Connectors whose tension grows exponentially, f = k/alpha (exp(alpha (l - D)) - 1)."""
