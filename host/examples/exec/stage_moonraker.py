#!/usr/bin/env python3
"""A machine with Klipper, over Moonraker: --stage "exec:python3 stage_moonraker.py http://printer.local:7125"

It moves the camera to the right with +X and up with +Y. Moves are sent in pieces of a tenth of a second, so that it can stop.
An API key, if Moonraker asks for one, is taken from the variable MOONRAKER_API_KEY.
"""

import json
import math
import os
import sys
import urllib.error
import urllib.parse
import urllib.request

from orders import Orders, numbers, serve

PIECE_S = 0.1
TOLERANCE_MM = 0.06


class Machine:
    def __init__(self, url, orders):
        self.url = url.rstrip("/")
        self.orders = orders
        self.start = None
        self.speed = None

    def call(self, path, post=False):
        request = urllib.request.Request(self.url + path, method="POST" if post else "GET")
        if "MOONRAKER_API_KEY" in os.environ:
            request.add_header("X-Api-Key", os.environ["MOONRAKER_API_KEY"])
        try:
            with urllib.request.urlopen(request, timeout=10) as answer:
                return json.load(answer)["result"]
        except urllib.error.HTTPError as error:
            try:
                reason = json.load(error)["error"]["message"]
            except (ValueError, KeyError, TypeError):
                reason = error.reason
            raise RuntimeError(f"Moonraker: {reason}") from None
        except urllib.error.URLError as error:
            raise RuntimeError(f"cannot reach {self.url}: {error.reason}") from None

    def position(self):
        """The position in millimetres. Fails unless the machine is homed and prints nothing."""
        status = self.call("/printer/objects/query?toolhead&print_stats")["status"]
        if not {"x", "y"} <= set(status["toolhead"]["homed_axes"]):
            raise RuntimeError("the machine is not homed: home it first")
        if status.get("print_stats", {}).get("state") in ("printing", "paused"):
            raise RuntimeError("the machine prints: wait until it is done")
        return status["toolhead"]["position"][:2]

    def open(self, text):
        info = self.call("/printer/info")
        if info["state"] != "ready":
            raise RuntimeError(f"Klipper is not ready: {info.get('state_message', info['state'])}")
        self.speed, _ = numbers(text, 2)
        self.start = self.position()

    def where(self, _=""):
        x, y = self.position()
        return [x - self.start[0], self.start[1] - y]

    def move(self, text):
        x, y = numbers(text, 2)
        here = self.where()
        way = [x - here[0], y - here[1]]
        pieces = max(1, math.ceil(math.hypot(*way) / (self.speed * PIECE_S)))
        for piece in range(1, pieces + 1):
            self.orders.check()
            right, down = (here[axis] + way[axis] * piece / pieces for axis in (0, 1))
            line = f"G1 X{self.start[0] + right:.4f} Y{self.start[1] - down:.4f} F{60 * self.speed:.1f}"
            # M400: the answer comes once it stands still.
            self.call("/printer/gcode/script?script=" + urllib.parse.quote(f"G90\n{line}\nM400"), post=True)
        there = self.where()
        if math.dist(there, (x, y)) > TOLERANCE_MM:
            raise RuntimeError(f"it is at {there[0]:.2f} {there[1]:.2f} instead of {x} {y}")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    machine = Machine(sys.argv[1], Orders())
    serve({"open": machine.open, "move": machine.move, "where": machine.where}, machine.orders)
