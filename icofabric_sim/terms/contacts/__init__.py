# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of contact: distance, overlap, forces, losses, and the search for pairs."""
