# Needs opencv-python-headless and numpy: pip install opencv-python-headless
import time

import cv2
import numpy as np

cv2.setNumThreads({threads})
# A plane in noise, 20 pixels away.
noise = np.random.default_rng(0).integers(0, 256, ({height}, {width} + 20), dtype=np.uint8)
left, right = np.ascontiguousarray(noise[:, :-20]), np.ascontiguousarray(noise[:, 20:])
matcher = {matcher}
if isinstance(matcher, cv2.StereoBM):
    matcher.setTextureThreshold(0)
    matcher.setUniquenessRatio(0)
seconds = float("inf")
for _ in range({repeat}):
    start = time.perf_counter()
    matcher.compute(left, right)
    seconds = min(seconds, time.perf_counter() - start)
count = matcher.getNumDisparities()
print(f"OpenCV {cv2.__version__}, {type(matcher).__name__}, {width}x{height}, {count} disparities, "
      f"threads {cv2.getNumThreads()}: {1e3 * seconds:.1f} ms, {left.size * count / seconds / 1e9:.3f} GDE/s")
