# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Push a running fabric and make its connectors stiffer, from a node of your own.

Start the fabric first, then this script in another terminal:

    .venv/bin/fabric_node --ros-args --params-file config/hanging_slab.yaml
    .venv/bin/python examples/push.py
"""

from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.parameter import Parameter

rclpy.init()
node = rclpy.create_node('pusher')
publisher = node.create_publisher(WrenchStamped, '/icofabric/loads/tip', 10)
while publisher.get_subscription_count() == 0:  # until the fabric is found
    rclpy.spin_once(node, timeout_sec=0.1)
message = WrenchStamped()  # stamp 0: acts at once
message.wrench.force.y = 1.0  # [N], shared out over the group of the channel
publisher.publish(message)

client = node.create_client(SetParameters, '/icofabric/set_parameters')
client.wait_for_service()
stiffer = Parameter('connector.stiffness', value=3000.0).to_parameter_msg()
future = client.call_async(SetParameters.Request(parameters=[stiffer]))
rclpy.spin_until_future_complete(node, future)
print(future.result().results[0])  # a refused change says why
rclpy.shutdown()
