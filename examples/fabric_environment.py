# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A Gymnasium environment: push the free side of a fabric, in lockstep with its node.

    .venv/bin/pip install gymnasium
    .venv/bin/fabric_node --ros-args --params-file config/hanging_slab.yaml -p start_paused:=true
    .venv/bin/python examples/fabric_environment.py
"""

from geometry_msgs.msg import PoseArray, WrenchStamped
import gymnasium
import numpy as np
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger


class FabricEnv(gymnasium.Env):
    """Observation: position [m] and velocity [m/s] of the tip; action: the force on it [N]."""

    observation_space = gymnasium.spaces.Box(-10.0, 10.0, (6,), np.float64)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float64)

    def __init__(self, fabric: str = '/icofabric', period: float = 0.01, steps: int = 200) -> None:
        """Pause the `fabric`; a step is `period` [s] of simulated time, an episode has `steps`."""
        rclpy.try_shutdown()
        rclpy.init()
        self.node, self.period, self.steps = rclpy.create_node('fabric_env'), period, steps
        self.fabric, self.time, self.tip, self.poses = fabric, '', None, {}
        # Depth 1: Fast DDS asks for the acknowledgement at once; in a deeper queue every 3 s.
        self.publisher = self.node.create_publisher(WrenchStamped, f'{fabric}/loads/tip', 1)
        self.node.create_subscription(PoseArray, f'{fabric}/poses', self._see, 100)
        self._call(SetBool, 'pause', data=True)
        self._call(SetParameters, 'set_parameters', parameters=[
            Parameter('advance_duration', value=period).to_parameter_msg(),
            Parameter('reset_time', value=True).to_parameter_msg()])

    def reset(self, *, seed=None, options=None):
        """Back to the initial state at time 0, without loads; it has no random part."""
        super().reset(seed=seed)
        self.poses.clear()
        self.count, self.position = 0, self._tip_at(self._call(Trigger, 'reset').message)
        return np.r_[self.position, 0.0, 0.0, 0.0], {}

    def step(self, action):
        """Hold a force for one period; the reward is highest where the tip stands still."""
        message = WrenchStamped()
        message.wrench.force.x, message.wrench.force.y, message.wrench.force.z = map(float, action)
        self.publisher.publish(message)
        self.publisher.wait_for_all_acked()  # then it acts before the advance begins
        before = self.position
        self.position = self._tip_at(self._call(Trigger, 'advance').message)
        velocity = (self.position - before) / self.period
        self.count += 1
        return (np.r_[self.position, velocity], -float(velocity @ velocity), False,
                self.count >= self.steps, {})

    def close(self):
        """Leave the graph; the fabric stays paused."""
        self.node.destroy_node()
        rclpy.try_shutdown()

    def _see(self, message):
        stamp = message.header.stamp
        self.poses = {f'{stamp.sec}.{stamp.nanosec:09d}': np.array(
            [[p.position.x, p.position.y, p.position.z] for p in message.poses])}

    def _tip_at(self, answer):
        """Mean position of the tip at the time in an answer, once its poses are there."""
        time = answer.split('t = ')[1].removesuffix(' s')
        while time not in self.poses or not self.publisher.get_subscription_count():
            rclpy.spin_once(self.node)
        if self.tip is None:
            self.tip = self.poses[time][:, 0] > self.poses[time][:, 0].max() - 1e-3
        return self.poses[time][self.tip].mean(axis=0)

    def _call(self, kind, name, **fields):
        client = self.node.create_client(kind, f'{self.fabric}/{name}')
        client.wait_for_service()
        future = client.call_async(kind.Request(**fields))
        rclpy.spin_until_future_complete(self.node, future)
        self.node.destroy_client(client)
        if not getattr(future.result(), 'success', True):
            raise RuntimeError(future.result().message)
        return future.result()


if __name__ == '__main__':
    env = FabricEnv()
    observation, _ = env.reset()
    total, ended = 0.0, False
    while not ended:  # damp: push against the velocity
        observation, reward, _, ended, _ = env.step(np.clip(-2.0 * observation[3:], -1.0, 1.0))
        total += reward
    speed = np.linalg.norm(observation[3:])
    print(f'sum of rewards {total:.4f}, the tip moves at {speed:.4f} m/s')
    env.close()
