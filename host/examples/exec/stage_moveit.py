#!/usr/bin/env python3
"""An arm with MoveIt 2: --stage "exec:python3 stage_moveit.py manipulator base_link tool0"

The group, the fixed frame and the link that holds the camera: its x points to the right of the image and its y down. MoveIt
plans a straight line without collisions, and executes it. Run it in a shell that has sourced ROS 2.
"""

import math
import sys
import time

import rclpy
import tf2_ros
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import Pose
from moveit_msgs.action import ExecuteTrajectory
from moveit_msgs.msg import MoveItErrorCodes
from moveit_msgs.srv import GetCartesianPath
from rclpy.action import ActionClient

from orders import Orders, Stopped, numbers, pose, serve

PATIENCE_S = 10.0
POLL_S = 0.02
STEP_M = 0.002


def turned(vector, rotation):
    """A vector turned by a quaternion."""
    u, w = (rotation.x, rotation.y, rotation.z), rotation.w
    cross = lambda a, b: [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    t = [2 * component for component in cross(u, vector)]
    return [v + w * a + b for v, a, b in zip(vector, t, cross(u, t))]


class Arm:
    def __init__(self, group, frame, link, orders):
        self.group, self.frame, self.link, self.orders = group, frame, link, orders
        rclpy.init()
        self.node = rclpy.create_node("multiscopic_stage")
        self.buffer = tf2_ros.Buffer()
        self.listener = tf2_ros.TransformListener(self.buffer, self.node)
        self.planner = self.node.create_client(GetCartesianPath, "compute_cartesian_path")
        self.executor = ActionClient(self.node, ExecuteTrajectory, "execute_trajectory")
        self.start = None
        self.speed = None
        self.goal = None

    def wait(self, future, what, seconds=PATIENCE_S, checked=False):
        """Waits for a future. With `checked`, an order that comes meanwhile raises Stopped."""
        end = time.monotonic() + seconds
        while not future.done():
            rclpy.spin_once(self.node, timeout_sec=POLL_S)
            if checked:
                self.orders.check()
            if time.monotonic() > end:
                raise RuntimeError(f"{what} did not answer within {seconds:.0f} s")
        return future.result()

    def pose(self):
        end = time.monotonic() + PATIENCE_S
        asked = self.node.get_clock().now()
        while time.monotonic() < end:
            rclpy.spin_once(self.node, timeout_sec=POLL_S)
            try:
                found = self.buffer.lookup_transform(self.frame, self.link, rclpy.time.Time())
            except tf2_ros.TransformException:
                continue
            # Older ones may have been measured before it arrived.
            if rclpy.time.Time.from_msg(found.header.stamp) >= asked:
                return found.transform
        raise RuntimeError(f"there is no fresh transform from {self.link} to {self.frame}")

    def open(self, text):
        speed, _ = numbers(text, 2)
        for server, ready in (
            ("compute_cartesian_path", self.planner.wait_for_service(timeout_sec=PATIENCE_S)),
            ("execute_trajectory", self.executor.wait_for_server(timeout_sec=PATIENCE_S)),
        ):
            if not ready:
                raise RuntimeError(f"MoveIt's {server} is not there: is move_group running?")
        self.speed, self.start = speed / 1000, self.pose()

    def where(self, _=""):
        found, start = self.pose(), self.start.translation
        here = found.translation
        way = (here.x - start.x, here.y - start.y, here.z - start.z)
        axes = [turned(axis, self.start.rotation) for axis in ((1, 0, 0), (0, 1, 0))]
        return [1000 * sum(a * b for a, b in zip(way, axis)) for axis in axes] + pose(here, found.rotation)

    def move(self, text):
        x, y = numbers(text, 2)
        offset = turned((x / 1000, y / 1000, 0), self.start.rotation)
        target = Pose()
        for axis, along in zip("xyz", offset):
            setattr(target.position, axis, getattr(self.start.translation, axis) + along)
        target.orientation = self.start.rotation
        request = GetCartesianPath.Request()
        request.header.frame_id, request.group_name, request.link_name = self.frame, self.group, self.link
        request.waypoints, request.max_step, request.avoid_collisions = [target], STEP_M, True
        request.start_state.is_diff = True
        request.cartesian_speed_limited_link, request.max_cartesian_speed = self.link, self.speed
        plan = self.wait(self.planner.call_async(request), "the planner")
        if plan.error_code.val != MoveItErrorCodes.SUCCESS or plan.fraction < 0.999:
            raise RuntimeError(f"MoveIt finds {100 * plan.fraction:.0f} % of a straight way (error {plan.error_code.val})")
        self.orders.check()
        goal = ExecuteTrajectory.Goal()
        goal.trajectory = plan.solution
        self.goal = self.wait(self.executor.send_goal_async(goal), "the controller")
        if not self.goal.accepted:
            self.goal = None
            raise RuntimeError("MoveIt does not accept the move")
        result = self.goal.get_result_async()
        try:
            done = self.wait(result, "the move", math.inf, checked=True)
        except Stopped:
            self.stop()
            raise
        self.goal = None
        if done.status != GoalStatus.STATUS_SUCCEEDED:
            raise RuntimeError(f"the move failed (MoveIt's error {done.result.error_code.val})")

    def stop(self, _=""):
        if self.goal is not None:
            result = self.goal.get_result_async()
            self.wait(self.goal.cancel_goal_async(), "the order to stop")
            self.wait(result, "the end of the move")
            self.goal = None


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    arm = Arm(*sys.argv[1:], Orders())
    serve({"open": arm.open, "move": arm.move, "where": arm.where, "stop": arm.stop}, arm.orders)
