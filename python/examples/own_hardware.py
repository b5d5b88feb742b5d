"""Captures a rig with a stage and a camera of one's own, and measures the distance of what it sees.

    python own_hardware.py RIG_DIR

Both are simulated here: the slide as its maker's library might drive it, and the camera before a wall 500 mm away.
"""

import sys

import multiscopic
import numpy as np

FOCAL_PX = 250.0
DISTANCE_MM = 500.0


class Slide:
    """An XY slide. Each method returns once it has done what it is asked for."""

    def __init__(self):
        self.x = self.y = 0.0

    def move_to(self, right_mm, down_mm):
        if max(abs(right_mm), abs(down_mm)) > 50:
            raise ValueError(f"the slide reaches 50 mm to each side, not ({right_mm}, {down_mm})")
        self.x, self.y = right_mm, down_mm

    def position(self):
        """What it counts, which need not be where it was sent. A slide that does not count needs no such method."""
        return self.x, self.y


class Eye:
    """A camera on the slide."""

    WALL = np.random.default_rng(1).integers(0, 256, (300, 400, 3), dtype=np.uint8)

    def __init__(self, slide):
        self.slide = slide

    def grab(self):
        """A picture of now, in RGB. With OpenCV, drop the pictures of before the move, and turn BGR around: `image[..., ::-1]`."""
        right, down = (round(place * FOCAL_PX / DISTANCE_MM) for place in (self.slide.x, self.slide.y))
        return self.WALL[75 + down : 225 + down, 100 + right : 300 + right]


def main(folder):
    slide = Slide()
    rig = multiscopic.capture(slide, Eye(slide), folder, baseline_mm=20, focal_px=FOCAL_PX, settle=0.01)
    depth = rig.match(num_disparities=20).depth()
    print(f"{folder}: {len(rig.views) + 1} pictures, the wall is {1000 * np.nanmedian(depth):.0f} mm away")


if __name__ == "__main__":
    main(sys.argv[1])
