# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Packing of a scene into the arrays that kernels read, and quantities derived from these arrays.
"""
