"""The network in whole numbers, written plainly: the definition that the program must equal, bit for bit.

    python reference.py network.weights FEATURES OUT.npz

FEATURES is a folder as `multiscopic match --features` writes it. The result has `disparity`, in 1/64 px from the least disparity on, and
`confidence`, 0 to 255.
"""

import sys
from pathlib import Path

import numpy as np

MAGIC = b"MSCNET01"
# Name, channels in, channels out, side, in the order of the file.
LAYERS = [
    ("g0", 48, 16, 1), ("g1", 16, 12, 3),
    ("in", 16, 12, 1), ("l0as", 12, 12, 3), ("l0ad", 36, 12, 1),
    ("d1", 96, 16, 1), ("l1as", 16, 16, 3), ("l1ad", 48, 16, 1),
    ("d2", 128, 24, 1), ("l2as", 24, 24, 3), ("l2ad", 72, 24, 1), ("l2bs", 24, 24, 3), ("l2bd", 72, 24, 1),
    ("u1", 24, 128, 1), ("l1bs", 16, 16, 3), ("l1bd", 48, 16, 1),
    ("u0", 16, 96, 1), ("l0bs", 12, 12, 3), ("l0bd", 36, 12, 1), ("lo", 12, 2, 1),
    ("ua", 96, 24, 1), ("ub", 24, 24, 3), ("uc", 24, 24, 3),
    ("ud2", 96, 32, 1), ("u2b", 32, 32, 3), ("u2c", 32, 32, 3),
    ("ud3", 128, 32, 1), ("u3b", 32, 32, 3), ("u3c", 32, 32, 3),
    ("ud4", 128, 32, 1), ("u4b", 32, 32, 3), ("u4c", 32, 32, 3), ("u4d", 32, 32, 3), ("u4e", 32, 32, 3),
    ("uu3", 32, 128, 1), ("u3d", 32, 32, 3),
    ("uu2", 32, 128, 1), ("u2d", 32, 32, 3),
    ("uu1", 32, 96, 1), ("u1d", 24, 24, 3),
    ("o", 24, 124, 1),
]  # fmt: skip
AROUND = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dy or dx]


class Weights:
    def __init__(self, data):
        assert data[:8] == MAGIC, "these are no weights of the network"
        self.data, self.at, self.layers = data, 8, {}
        for name, inputs, outputs, side in LAYERS:
            weights = self.take("i1", outputs * side * side * inputs).reshape(outputs, side, side, inputs)
            bias, multiplier, shift = self.take("<i4", outputs), self.take("<u2", outputs), self.take("u1", outputs)
            self.layers[name] = (weights, bias, multiplier, shift)
        self.exp, self.sure = self.take("<u2", 160), self.take("u1", 256)
        assert self.at == len(data), "the weights have another length"

    def take(self, kind, count):
        values = np.frombuffer(self.data, kind, count, self.at)
        self.at += values.nbytes
        return values.astype(np.int64)

    def raw(self, name, x):
        """A layer of x, any number of images of height x width x channels."""
        weights, bias, multiplier, shift = self.layers[name]
        side, (height, width) = weights.shape[1], x.shape[-3:-1]
        r = side // 2
        padded = np.pad(x, ((0, 0),) * (x.ndim - 3) + ((r, r), (r, r), (0, 0)))
        # Sums are below 2^24: float products of matrices are exact, and fast.
        sums = np.zeros(x.shape[:-1] + (weights.shape[0],), np.float32)
        for dy in range(side):
            for dx in range(side):
                part = padded[..., dy : dy + height, dx : dx + width, :].astype(np.float32)
                sums += part @ weights[:, dy, dx].T.astype(np.float32)
        scaled = np.clip((sums.astype(np.int64) + bias) >> shift, -32768, 32767)
        return (scaled * multiplier + 16384) >> 15

    def hidden(self, name, x):
        return np.clip(self.raw(name, x), 0, 127)

    def residual(self, name, x, skip):
        return np.clip(self.raw(name, x) + skip, 0, 127)

    def softmax(self, logits, values):
        """The mean of values, in proportion to the exponentials of the logits, both with the choices first."""
        shares = self.exp[np.minimum(logits.max(0) - logits, 159)]
        total = shares.sum(0)
        return ((shares * values).sum(0) + total // 2) // total


def space_to_depth(x, k):
    h, w, c = x.shape
    return x.reshape(h // k, k, w // k, k, c).transpose(0, 2, 1, 3, 4).reshape(h // k, w // k, k * k * c)


def depth_to_space(x, k):
    h, w, c = x.shape
    return x.reshape(h, w, k, k, c // (k * k)).transpose(0, 2, 1, 3, 4).reshape(h * k, w * k, c // (k * k))


def volume_to_depth(x):
    s, h, w, c = x.shape
    x = x.reshape(s // 2, 2, h // 2, 2, w // 2, 2, c).transpose(0, 2, 4, 1, 3, 5, 6)
    return x.reshape(s // 2, h // 2, w // 2, 8 * c)


def depth_to_volume(x):
    s, h, w, c = x.shape
    x = x.reshape(s, h, w, 2, 2, 2, c // 8).transpose(0, 3, 1, 4, 2, 5, 6)
    return x.reshape(2 * s, 2 * h, 2 * w, c // 8)


def shifted(x, dy, dx):
    """The neighbours at an offset, with the edges repeated."""
    rows = np.clip(np.arange(x.shape[0]) + dy, 0, x.shape[0] - 1)
    columns = np.clip(np.arange(x.shape[1]) + dx, 0, x.shape[1] - 1)
    return x[rows][:, columns]


def spread(x):
    return x.repeat(4, 0).repeat(4, 1)


def volume_block(weights, name, x):
    y = weights.hidden(name + "s", x)
    y = np.pad(y, ((1, 1), (0, 0), (0, 0), (0, 0)))
    return weights.residual(name + "d", np.concatenate([y[:-2], y[1:-1], y[2:]], -1), x)


def volume_winners(weights, rgb, volume):
    """The disparities of the blocks, and how sure they are."""
    count, h, w, _ = volume.shape
    guide = weights.raw("g1", weights.hidden("g0", space_to_depth(rgb, 4)))
    padded = np.pad(volume, ((0, -count % 8), (0, 0), (0, 0), (0, 0)), constant_values=127)
    pairs = padded.reshape(-1, 2, h, w, 8).transpose(0, 2, 3, 1, 4).reshape(-1, h, w, 16)
    e0 = volume_block(weights, "l0a", weights.residual("in", pairs, guide))
    e1 = volume_block(weights, "l1a", weights.hidden("d1", volume_to_depth(e0)))
    x = weights.hidden("d2", volume_to_depth(e1))
    x = volume_block(weights, "l2b", volume_block(weights, "l2a", x))
    x = volume_block(weights, "l1b", np.clip(depth_to_volume(weights.raw("u1", x)) + e1, 0, 127))
    x = volume_block(weights, "l0b", np.clip(depth_to_volume(weights.raw("u0", x)) + e0, 0, 127))
    logits = weights.raw("lo", x).transpose(0, 3, 1, 2).reshape(-1, h, w)[:count] - volume[..., 4]
    shares = weights.exp[np.minimum(logits.max(0) - logits, 159)]
    index = np.arange(count)[:, None, None]
    window = shares * (abs(index - logits.argmax(0)) <= 2)
    total, inside = shares.sum(0), window.sum(0)
    return ((window * 64 * index).sum(0) + inside // 2) // inside, 127 * inside // total


def features(rgb, da, db, dv, sure, measures, count):
    gradient = lambda d, dy, dx: np.clip(64 + ((shifted(d, dy, dx) - shifted(d, -dy, -dx)) >> 2), 0, 127)
    difference = lambda d: np.clip(64 + ((d - da) >> 2), 0, 127)
    planes = [
        2 * da // count, 2 * db // count, 2 * dv // count,
        gradient(da, 0, 1), gradient(da, 1, 0), gradient(db, 0, 1), gradient(db, 1, 0),
        difference(db), difference(dv), sure,
    ]  # fmt: skip
    return np.concatenate([rgb, np.stack(planes, -1), measures], -1)


def outputs(weights, x):
    block = lambda first, second, x: weights.residual(second, weights.hidden(first, x), x)
    f1 = block("ub", "uc", weights.hidden("ua", space_to_depth(x, 2)))
    f2 = block("u2b", "u2c", weights.hidden("ud2", space_to_depth(f1, 2)))
    f3 = block("u3b", "u3c", weights.hidden("ud3", space_to_depth(f2, 2)))
    x = block("u4d", "u4e", block("u4b", "u4c", weights.hidden("ud4", space_to_depth(f3, 2))))
    for up, convolution, skip in (("uu3", "u3d", f3), ("uu2", "u2d", f2), ("uu1", "u1d", f1)):
        x = weights.hidden(convolution, np.clip(depth_to_space(weights.raw(up, x), 2) + skip, 0, 127))
    return depth_to_space(weights.raw("o", x), 2)


def infer(weights, colors, winners, measures, volume):
    """Disparities and confidences of the arrays that the program writes."""
    height, width = colors.shape[:2]
    pad = lambda a: np.pad(a, ((0, -height % 16), (0, -width % 16)) + ((0, 0),) * (a.ndim - 2), "edge").astype(np.int64)
    rgb, da, db, measures = pad(colors >> 1), pad(winners[0]), pad(winners[1]), pad(measures)
    volume, count = volume.astype(np.int64), volume.shape[0]
    coarse, sure = volume_winners(weights, rgb, volume)
    x = features(rgb, da, db, spread(coarse), spread(sure), measures, count)
    o = np.moveaxis(outputs(weights, x), -1, 0)
    blocks = [spread(shifted(coarse, dy, dx)) for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
    fine = weights.softmax(o[20:29], np.stack(blocks))
    mixed = weights.softmax(o[17:20], np.stack([da, db, fine]))
    around = [mixed] + [shifted(mixed, k * dy, k * dx) for k in (1, 3) for dy, dx in AROUND]
    disparity = np.clip(weights.softmax(o[:17], np.stack(around)) + o[29], 0, 64 * (count - 1))
    confidence = weights.sure[np.clip(o[30] + 128, 0, 255)]
    return disparity[:height, :width], confidence[:height, :width], o[30][:height, :width]


def both_looks(weights, *arrays):
    """The disparities, confidences and logits of a look at the arrays and of one at the same turned by half a turn; each 2 x h x w."""
    turn = lambda a, axis=0: np.flip(a, (axis, axis + 1))
    colors, winners, measures, volume = arrays
    other = infer(weights, turn(colors), turn(winners, 1), turn(measures), turn(volume, 1))
    return [np.stack([one, turn(of_turned)]) for one, of_turned in zip(infer(weights, *arrays), other)]


def fused(disparities, confidences):
    """What the program makes of two looks: `fuse_rotations` of the core's `pixel_head`."""
    (a, b), (p, q) = disparities.astype(np.int64), confidences.astype(np.int64)
    v, w = p * p + 1, q * q + 1
    least, most = np.minimum(p, q), np.maximum(p, q)
    not_both = np.maximum(255 * 255 - most * least, 1)
    agree = np.abs(a - b) <= 64
    disparity = np.where(agree, (v * a + w * b + (v + w) // 2) // (v + w), np.where(q > p, b, a))
    return disparity, np.where(agree, (p + q) // 2, 255 * most * (255 - least) // not_both)


def load(folder):
    return [np.load(Path(folder) / f"{name}.npy") for name in ("colors", "winners", "measures", "volume")]


if __name__ == "__main__":
    weights_file, folder, target = sys.argv[1:]
    disparity, confidence, _ = infer(Weights(Path(weights_file).read_bytes()), *load(folder))
    np.savez(target, disparity=disparity.astype(np.uint16), confidence=confidence.astype(np.uint8))
