# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Protection of nodes against faults of the middleware and of other processes in the ROS graph.
"""
