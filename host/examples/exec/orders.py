"""Reads the orders of multiscopic from standard input, and answers them: docs/capture.md, "Commands for stages and cameras"."""

import math
import os
import select
import sys


class Stopped(Exception):
    """An order came, or the input ended, while the stage moved."""


class Orders:
    """The lines of standard input. Anything else that is printed would be taken for an answer: print to standard error."""

    def __init__(self):
        self._bytes = b""

    def _read(self):
        piece = os.read(0, 4096)
        self._bytes += piece
        return bool(piece)

    def check(self, seconds=0.0):
        """Waits for so long, and raises Stopped if an order or the end of the input comes meanwhile."""
        if self._bytes or select.select([0], [], [], seconds)[0]:
            raise Stopped

    def __iter__(self):
        while b"\n" in self._bytes or self._read():
            if b"\n" in self._bytes:
                line, self._bytes = self._bytes.split(b"\n", 1)
                yield line.decode().strip()


def serve(answers, orders):
    """Answers each order by a function of its name, which gets the text behind it, and returns numbers, or None.

    An exception is the answer `error`. When the input ends, the function of `stop` is called if there is one.
    """
    answers.setdefault("stop", lambda _: None)
    for line in orders:
        name, _, rest = line.partition(" ")
        try:
            if name not in answers:
                raise ValueError(f"unknown order {name}")
            numbers = answers[name](rest)
            print(" ".join(["ok", *(f"{number:.4f}" for number in numbers or [])]), flush=True)
        except Stopped:
            print("error stopped on the way", flush=True)
        except Exception as error:  # Whatever it is, the order failed.
            print("error", " ".join(str(error).split()) or type(error).__name__, flush=True)
    answers["stop"]("")


def pose(position, quaternion):
    """What follows the position in an answer to `where`: a place in metres, as millimetres, and a turn as an axis times degrees."""
    vector = [quaternion.x, quaternion.y, quaternion.z]
    length = math.hypot(*vector)
    angle = 2 * math.atan2(length, quaternion.w)
    turn = [math.degrees(angle) * part / length if length else 0.0 for part in vector]
    return [1000 * position.x, 1000 * position.y, 1000 * position.z, *turn]


def numbers(text, count):
    """So many finite numbers."""
    found = [float(word) for word in text.split()]
    if len(found) != count or not all(map(math.isfinite, found)):
        raise ValueError(f"expected {count} numbers, found {text!r}")
    return found
