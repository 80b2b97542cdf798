# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Torque of a uniform electric field on dipoles that turn with their bodies."""
