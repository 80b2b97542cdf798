# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Fabrics at rest: equilibria, small vibrations, mechanisms. The same forces as in motion."""
