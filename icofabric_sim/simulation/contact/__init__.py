# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Which shells can touch: broad phase, neighbour list, friction state."""
