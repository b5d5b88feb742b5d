#!/usr/bin/env python3
"""A Cartesian controller on ROS 2 topics: --stage "exec:python3 stage_ros2.py /target_frame /current_pose"

It publishes geometry_msgs/PoseStamped to the first topic, as those of cartesian_controllers and many drivers take it, and reads
the pose of the tool from the second. The tool's x points to the right of the image and its y down. Targets are sent step by
step, at the speed of the capture, so that it can stop. Run it in a shell that has sourced ROS 2.
"""

import math
import sys
import time

import rclpy
from geometry_msgs.msg import PoseStamped

from orders import Orders, numbers, pose, serve

PATIENCE_S = 10.0
PERIOD_S = 0.02
TOLERANCE_MM = 0.1


def axes(q):
    """The x and y axes of a pose."""
    return (
        (1 - 2 * (q.y * q.y + q.z * q.z), 2 * (q.x * q.y + q.w * q.z), 2 * (q.x * q.z - q.w * q.y)),
        (2 * (q.x * q.y - q.w * q.z), 1 - 2 * (q.x * q.x + q.z * q.z), 2 * (q.y * q.z + q.w * q.x)),
    )


class Tool:
    def __init__(self, target, current, orders):
        self.orders = orders
        rclpy.init()
        self.node = rclpy.create_node("multiscopic_stage")
        self.publisher = self.node.create_publisher(PoseStamped, target, 1)
        self.subscription = self.node.create_subscription(PoseStamped, current, self.take, 1)
        self.topic = current
        self.latest = None
        self.start = None
        self.sent = (0.0, 0.0)

    def take(self, pose):
        self.latest = pose

    def fresh(self):
        """A pose that comes after the call."""
        self.latest, end = None, time.monotonic() + PATIENCE_S
        while self.latest is None:
            rclpy.spin_once(self.node, timeout_sec=PERIOD_S)
            if time.monotonic() > end:
                raise RuntimeError(f"no pose comes from {self.topic}")
        return self.latest

    def open(self, text):
        self.speed, _ = numbers(text, 2)
        self.start = self.fresh()

    def offset(self, here):
        start = self.start.pose.position
        way = (here.x - start.x, here.y - start.y, here.z - start.z)
        return [1000 * sum(a * b for a, b in zip(way, axis)) for axis in axes(self.start.pose.orientation)]

    def where(self, _=""):
        found = self.fresh().pose
        return self.offset(found.position) + pose(found.position, found.orientation)

    def send(self, right, down):
        target, start = PoseStamped(), self.start.pose
        target.header.frame_id = self.start.header.frame_id
        target.header.stamp = self.node.get_clock().now().to_msg()
        target.pose.orientation = start.orientation
        for name, x, y in zip("xyz", *axes(start.orientation)):
            setattr(target.pose.position, name, getattr(start.position, name) + (right * x + down * y) / 1000)
        self.publisher.publish(target)
        self.sent = (right, down)

    def move(self, text):
        goal, start = numbers(text, 2), self.sent
        steps = max(1, math.ceil(math.dist(goal, start) / (self.speed * PERIOD_S)))
        for step in range(1, steps + 1):
            self.orders.check(PERIOD_S)
            self.send(*(a + (b - a) * step / steps for a, b in zip(start, goal)))
        end = time.monotonic() + PATIENCE_S
        while math.dist(self.offset(self.fresh().pose.position), goal) > TOLERANCE_MM:
            self.orders.check()
            if time.monotonic() > end:
                raise RuntimeError("it does not come to its target")

    def stop(self, _=""):
        """Holds it where it is."""
        if self.start is not None:
            here = self.offset(self.fresh().pose.position)
            if math.dist(here, self.sent) > TOLERANCE_MM:
                self.send(*here)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    tool = Tool(*sys.argv[1:], Orders())
    serve({"open": tool.open, "move": tool.move, "where": tool.where, "stop": tool.stop}, tool.orders)
