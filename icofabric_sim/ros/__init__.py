# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
ROS 2 nodes: translation between the ROS graph and the runner. No other package imports rclpy.
"""
