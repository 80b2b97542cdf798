# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Gravity, with the acceleration of equal charges by a uniform electric field."""
