# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Fabrics at rest: equilibria, vibrations, mechanisms. Uses the force laws of the dynamics."""
