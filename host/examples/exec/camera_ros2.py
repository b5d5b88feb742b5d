#!/usr/bin/env python3
"""A camera on a ROS 2 topic: --camera "exec:python3 camera_ros2.py /camera/image_raw"

It takes the first sensor_msgs/Image whose stamp is later than the order, grey or in colour. Run it in a shell that has sourced
ROS 2.
"""

import sys
import time

import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image

from orders import Orders, serve

PATIENCE_S = 10.0
# The kind of PNM file, the bytes of a pixel, and its bytes in the order of the file.
ENCODINGS = {
    "mono8": (b"P5", 255, 1, (0,)),
    "rgb8": (b"P6", 255, 3, (0, 1, 2)),
    "bgr8": (b"P6", 255, 3, (2, 1, 0)),
    "rgba8": (b"P6", 255, 4, (0, 1, 2)),
    "bgra8": (b"P6", 255, 4, (2, 1, 0)),
    "mono16": (b"P5", 65535, 2, (1, 0)),
}


def pnm(image):
    """An image as the bytes of a PGM or PPM file."""
    if image.encoding not in ENCODINGS:
        raise RuntimeError(f"the encoding {image.encoding} is none of {', '.join(ENCODINGS)}")
    kind, white, size, order = ENCODINGS[image.encoding]
    if size == 2 and image.is_bigendian:
        order = (0, 1)
    data, pixels = bytes(image.data), bytearray(image.width * image.height * len(order))
    rows = b"".join(data[image.step * v : image.step * v + image.width * size] for v in range(image.height))
    for at, channel in enumerate(order):
        pixels[at :: len(order)] = rows[channel::size]
    return b"%s\n%d %d\n%d\n" % (kind, image.width, image.height, white) + pixels


class Camera:
    def __init__(self, topic):
        rclpy.init()
        self.topic = topic
        self.node = rclpy.create_node("multiscopic_camera")
        self.subscription = self.node.create_subscription(Image, topic, self.receive, qos_profile_sensor_data)
        self.latest = None

    def receive(self, image):
        self.latest = image

    def next(self):
        asked, end = self.node.get_clock().now(), time.monotonic() + PATIENCE_S
        self.latest = None
        while self.latest is None or rclpy.time.Time.from_msg(self.latest.header.stamp) < asked:
            if time.monotonic() > end:
                problem = "comes" if self.latest is None else "has a stamp after the order"
                raise RuntimeError(f"no image of {self.topic} {problem}")
            rclpy.spin_once(self.node, timeout_sec=0.02)
        return self.latest

    def open(self, _):
        self.next()

    def take(self, path):
        contents = pnm(self.next())
        with open(path, "wb") as file:
            file.write(contents)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    camera = Camera(sys.argv[1])
    serve({"open": camera.open, "take": camera.take}, Orders())
