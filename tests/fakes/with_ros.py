"""Runs a script with stubs of ROS 2: a tool that can move, which holds a camera.

Messages have the fields of their definitions and no others. What the tool is told goes to the file of the variable EVENTS. The
tool's x is the world's x, and its y the world's -y, since it looks down.
"""

import copy
import math
import os
import runpy
import sys
import time
import types

START = (0.4, -0.2, 0.5)
# Speed of a tool that is moved by topics, in metres per second, above that of the targets.
AGILE = 1.0


def message(**fields):
    """A class of messages with these fields and their defaults."""

    class Message:
        __slots__ = tuple(fields)

        def __init__(self):
            for name, default in fields.items():
                setattr(self, name, default() if callable(default) else copy.copy(default))

    return Message


Stamp = message(sec=0, nanosec=0)
Header = message(stamp=Stamp, frame_id="")
Point = message(x=0.0, y=0.0, z=0.0)
Quaternion = message(x=0.0, y=0.0, z=0.0, w=1.0)
Pose = message(position=Point, orientation=Quaternion)
PoseStamped = message(header=Header, pose=Pose)
Transform = message(translation=Point, rotation=Quaternion)
TransformStamped = message(header=Header, child_frame_id="", transform=Transform)
Image = message(header=Header, height=0, width=0, encoding="", is_bigendian=0, step=0, data=b"")
ErrorCodes = message(val=0)
ErrorCodes.SUCCESS = 1
RobotState = message(is_diff=False)
Trajectory = message(target=list, speed=0.0)
Request = message(
    header=Header,
    start_state=RobotState,
    group_name="",
    link_name="",
    waypoints=list,
    max_step=0.0,
    jump_threshold=0.0,
    avoid_collisions=False,
    cartesian_speed_limited_link="",
    max_cartesian_speed=0.0,
)
Response = message(start_state=RobotState, solution=Trajectory, fraction=0.0, error_code=ErrorCodes)
Goal = message(trajectory=Trajectory)
Result = message(error_code=ErrorCodes)


class Time:
    def __init__(self, nanoseconds=0):
        self.nanoseconds = nanoseconds

    @staticmethod
    def from_msg(stamp):
        return Time(stamp.sec * 10**9 + stamp.nanosec)

    def to_msg(self):
        stamp = Stamp()
        stamp.sec, stamp.nanosec = divmod(self.nanoseconds, 10**9)
        return stamp

    def now(self):
        return Time(time.time_ns())

    def __lt__(self, other):
        return self.nanoseconds < other.nanoseconds

    def __ge__(self, other):
        return self.nanoseconds >= other.nanoseconds


class TransformException(Exception):
    pass


class Future:
    def __init__(self, result=None):
        self.value = result

    def done(self):
        return self.value is not None

    def result(self):
        return self.value


class World:
    """The tool, which moves straight to its target."""

    def __init__(self):
        self.place, self.target, self.speed = list(START), list(START), AGILE
        self.updated = time.monotonic()
        self.subscriptions = []
        self.result = None
        self.images = 0

    def note(self, event):
        with open(os.environ["EVENTS"], "a") as file:
            print(event, file=file)

    def step(self):
        now = time.monotonic()
        way = [b - a for a, b in zip(self.place, self.target)]
        length, reach = math.hypot(*way), self.speed * (now - self.updated)
        share = 1.0 if length <= reach else reach / length
        self.place = [a + share * b for a, b in zip(self.place, way)]
        self.updated = now
        if share == 1.0:
            self.finish(4)

    def finish(self, status):
        if self.result is not None:
            done = types.SimpleNamespace(status=status, result=Result())
            self.result.value, self.result = done, None

    def pose(self):
        pose = Pose()
        pose.position.x, pose.position.y, pose.position.z = self.place
        pose.orientation.x, pose.orientation.w = 1.0, 0.0
        return pose

    def go(self, target, speed):
        self.step()
        self.target, self.speed = target, speed
        self.note("to %.4f %.4f %.4f" % tuple(target))


WORLD = World()


def coordinates(point):
    return [point.x, point.y, point.z]


class Node:
    def get_clock(self):
        return Time()

    def create_publisher(self, kind, topic, depth):
        def publish(pose):
            assert isinstance(pose, kind) and pose.header.frame_id == "base"
            WORLD.go(coordinates(pose.pose.position), AGILE)

        return types.SimpleNamespace(publish=publish)

    def create_subscription(self, kind, topic, callback, qos):
        WORLD.subscriptions.append((kind, callback))

    def create_client(self, kind, name):
        def call_async(request):
            assert request.start_state.is_diff and request.avoid_collisions and request.max_step > 0
            plan = Response()
            plan.error_code.val = 1
            target = coordinates(request.waypoints[-1].position)
            plan.solution.target, plan.solution.speed = target, request.max_cartesian_speed
            # A wall.
            plan.fraction = 0.4 if target[0] > START[0] + 0.09 else 1.0
            return Future(plan)

        return types.SimpleNamespace(call_async=call_async, wait_for_service=lambda timeout_sec: True)


class ActionClient:
    def __init__(self, node, kind, name):
        pass

    def wait_for_server(self, timeout_sec):
        return True

    def send_goal_async(self, goal):
        WORLD.go(goal.trajectory.target, goal.trajectory.speed)
        result = WORLD.result = Future()

        def cancel():
            WORLD.step()
            WORLD.note("cancelled")
            WORLD.target = list(WORLD.place)
            WORLD.finish(5)
            return Future(True)

        handle = types.SimpleNamespace(accepted=True, get_result_async=lambda: result, cancel_goal_async=cancel)
        return Future(handle)


class Buffer:
    def lookup_transform(self, target, source, when):
        found = TransformStamped()
        found.header.stamp = Time().now().to_msg()
        found.transform.translation, found.transform.rotation = WORLD.pose().position, WORLD.pose().orientation
        if target != "base" or source != "tool":
            raise TransformException
        return found


def image():
    """Four rows of three pixels, red and blue, with a byte of padding in each row. The first image is an old one."""
    found = Image()
    old = WORLD.images == 0
    WORLD.images += 1
    found.header.stamp = Time(time.time_ns() - 10**9 * old).to_msg()
    found.height, found.width, found.encoding, found.step = 4, 3, "bgr8", 10
    row = bytes([0, 0, 255, 200, 0, 0, 9, 8, 7, 99])
    found.data = bytes(40) if old else 4 * row
    return found


def spin_once(node, timeout_sec):
    time.sleep(timeout_sec)
    WORLD.step()
    for kind, callback in WORLD.subscriptions:
        if kind is Image:
            callback(image())
        else:
            pose = PoseStamped()
            pose.header.frame_id, pose.pose = "base", WORLD.pose()
            callback(pose)


def module(name, **contents):
    found = types.ModuleType(name)
    found.__dict__.update(contents)
    sys.modules[name] = found
    parent, _, child = name.rpartition(".")
    if parent:
        setattr(sys.modules[parent], child, found)


module("rclpy", init=lambda: None, create_node=lambda name: Node(), spin_once=spin_once)
module("rclpy.time", Time=Time)
module("rclpy.qos", qos_profile_sensor_data=5)
module("rclpy.action", ActionClient=ActionClient)
module("tf2_ros", Buffer=Buffer, TransformListener=lambda buffer, node: None, TransformException=TransformException)
module("action_msgs")
module("action_msgs.msg", GoalStatus=types.SimpleNamespace(STATUS_SUCCEEDED=4))
module("geometry_msgs")
module("geometry_msgs.msg", Pose=Pose, PoseStamped=PoseStamped)
module("sensor_msgs")
module("sensor_msgs.msg", Image=Image)
module("moveit_msgs")
module("moveit_msgs.msg", MoveItErrorCodes=ErrorCodes)
module("moveit_msgs.srv", GetCartesianPath=types.SimpleNamespace(Request=Request))
module("moveit_msgs.action", ExecuteTrajectory=types.SimpleNamespace(Goal=Goal))

sys.argv = sys.argv[1:]
sys.path[0] = os.path.dirname(sys.argv[0])
runpy.run_path(sys.argv[0], run_name="__main__")
