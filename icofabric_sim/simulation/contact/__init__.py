# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Candidate pairs of shells for contact: broad phase, neighbour list, friction state."""
