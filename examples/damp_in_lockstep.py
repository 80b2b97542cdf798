# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Damp the free side of a fabric in lockstep: simulated time waits for the controller.

    .venv/bin/fabric_node --ros-args --params-file config/hanging_slab.yaml -p start_paused:=true
    .venv/bin/python examples/damp_in_lockstep.py
"""

from geometry_msgs.msg import PoseArray, WrenchStamped
import numpy as np
import rclpy
from std_srvs.srv import Trigger

GAIN, PERIOD, CALLS = 2.0, 0.01, 150  # [N s/m], advance_duration [s] of the node

rclpy.init()
node = rclpy.create_node('damper')
# Depth 1: Fast DDS asks for the acknowledgement at once, and only every 3 s in a deeper queue.
publisher = node.create_publisher(WrenchStamped, '/icofabric/loads/tip', 1)
advance = node.create_client(Trigger, '/icofabric/advance')
seen = {}  # time [s] -> positions (n, 3) [m]


def see(message: PoseArray) -> None:
    """Keep the positions of the time of the message."""
    time = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
    seen[round(time, 9)] = np.array([[p.position.x, p.position.y, p.position.z]
                                     for p in message.poses])


node.create_subscription(PoseArray, '/icofabric/poses', see, 100)
while not (seen and advance.service_is_ready() and publisher.get_subscription_count()):
    rclpy.spin_once(node, timeout_sec=0.1)
time = max(seen)
tip = seen[time][:, 0] > seen[time][:, 0].max() - 1e-3
for call in range(CALLS):
    before = seen[time][tip].mean(axis=0)
    future = advance.call_async(Trigger.Request())
    rclpy.spin_until_future_complete(node, future)
    if not future.result().success:
        raise SystemExit(future.result().message)
    time = round(float(future.result().message.split('t = ')[1].removesuffix(' s')), 9)
    while time not in seen:  # topics and services arrive in no common order
        rclpy.spin_once(node)
    velocity = (seen[time][tip].mean(axis=0) - before) / PERIOD
    message = WrenchStamped()
    message.wrench.force.x, message.wrench.force.y, message.wrench.force.z = -GAIN * velocity
    publisher.publish(message)
    publisher.wait_for_all_acked()  # then it acts before the next advance begins
    if call % 10 == 9:
        print(f't = {time:.2f} s, the tip moves at {np.linalg.norm(velocity):.4f} m/s')
rclpy.shutdown()
