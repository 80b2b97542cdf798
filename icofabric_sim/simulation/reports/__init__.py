# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Read-only results of a run: status, reactions, contact forces and error amplification."""
