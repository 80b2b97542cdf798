# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
ROS 2 at the rim: nodes translate between the graph and the runner. Nothing else imports rclpy.
"""
