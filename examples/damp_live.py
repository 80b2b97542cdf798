# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Damp the free side of a running fabric: the newest state is answered a hundred times a second.

    .venv/bin/fabric_node --ros-args --params-file config/hanging_slab.yaml -p publish_rate:=100.0
    .venv/bin/python examples/damp_live.py
"""

import signal
import threading

from geometry_msgs.msg import WrenchStamped
import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64MultiArray

GAIN, PERIOD = 2.0, 0.01  # [N s/m], [s] of wall time


class Damper(Node):
    """Holds the newest state; a timer answers it."""

    def __init__(self) -> None:
        """Find the bodies of the tip in the first state."""
        super().__init__('damper')
        self.state, self.tip, self.sent = None, None, 0
        self.publisher = self.create_publisher(WrenchStamped, '/icofabric/loads/tip', 10)
        self.create_subscription(Float64MultiArray, '/icofabric/state', self.see, 1)
        self.create_timer(PERIOD, self.push)

    def see(self, message: Float64MultiArray) -> None:
        """Rows: position, orientation, velocity, angular velocity."""
        self.state = np.array(message.data).reshape(-1, 13)
        if self.tip is None:
            self.tip = self.state[:, 0] > self.state[:, 0].max() - 1e-3

    def push(self) -> None:
        """Push against the mean velocity of the tip."""
        if self.state is None:
            return
        velocity = self.state[self.tip, 7:10].mean(axis=0)
        message = WrenchStamped()  # stamp 0: acts at once
        message.wrench.force.x, message.wrench.force.y, message.wrench.force.z = -GAIN * velocity
        self.publisher.publish(message)
        self.sent += 1
        if self.sent % 50 == 0:
            print(f'the tip moves at {np.linalg.norm(velocity):.4f} m/s', flush=True)


# Ctrl-C is noted and looked at between messages: raised in the middle of one, it can come out of
# rclpy as another error.
over = threading.Event()
signal.signal(signal.SIGINT, lambda *_: over.set())
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
executor = SingleThreadedExecutor()
executor.add_node(Damper())
while not over.is_set():
    executor.spin_once(timeout_sec=0.1)
rclpy.shutdown()
