"""The network as training sees it: real numbers in the units of the whole-number network.

Activations are kept in units of 1/16, clipped to 0..127, height x width x channels. Once `quantized` is set, they and the weights are
rounded as in the program, and gradients pass through the rounding. `reference.py` is the definition in whole numbers.
"""

import torch
import torch.nn.functional as F
from torch import nn

from reference import LAYERS

UNIT = 16.0
TOP = 127.0
# Neighbours of a pixel (dy, dx), row by row, without the pixel itself.
AROUND = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dy or dx]


class Clipped(torch.autograd.Function):
    """Clips to 0..127 and rounds; gradients pass through the rounding."""

    @staticmethod
    def forward(ctx, x):
        ctx.save_for_backward(x)
        return F.hardtanh(x, 0.0, TOP).round_()

    @staticmethod
    def backward(ctx, gradient):
        return torch.ops.aten.hardtanh_backward(gradient, ctx.saved_tensors[0], 0.0, TOP)


class Rounded(torch.autograd.Function):
    """Rounds; gradients pass through."""

    @staticmethod
    def forward(ctx, x):
        return x.round()

    @staticmethod
    def backward(ctx, gradient):
        return gradient


class Layer(nn.Module):
    """A convolution of `size` x `size` pixels. `gain` scales its first weights, `center` is subtracted from its inputs."""

    def __init__(self, inputs, outputs, size=1, gain=1.0, center=0.0):
        super().__init__()
        fan_in = inputs * size * size
        self.weight = nn.Parameter(torch.randn(outputs, inputs, size, size) * gain * (2.0 / fan_in) ** 0.5)
        self.bias = nn.Parameter(torch.zeros(outputs))
        self.center = center
        self.quantized = False

    def scales(self):
        """The unit of each output channel's weights."""
        return self.weight.detach().abs().amax((1, 2, 3)).clamp(min=1e-6) / TOP

    def sums(self, x):
        bias = UNIT * self.bias
        if self.center:
            bias = bias - self.center * self.weight.sum((1, 2, 3))
        weight = self.weight
        if self.quantized:
            scales = self.scales()[:, None, None, None]
            weight = weight + ((weight / scales).round() * scales - weight).detach()
        weight, bias = weight.to(x.dtype), bias.to(x.dtype)
        if weight.shape[2] == 1:
            return F.linear(x, weight[:, :, 0, 0], bias)
        return F.conv2d(x.permute(0, 3, 1, 2), weight, bias, padding=1).permute(0, 2, 3, 1)

    def clip(self, y):
        return Clipped.apply(y) if self.quantized else F.hardtanh(y, 0.0, TOP)

    def forward(self, x):
        return self.clip(self.sums(x))

    def raw(self, x):
        y = self.sums(x)
        return Rounded.apply(y) if self.quantized else y

    def residual(self, x, skip):
        return self.clip(self.sums(x) + skip)


def space_to_depth(x, k):
    b, h, w, c = x.shape
    return x.reshape(b, h // k, k, w // k, k, c).permute(0, 1, 3, 2, 4, 5).reshape(b, h // k, w // k, k * k * c)


def depth_to_space(x, k):
    b, h, w, c = x.shape
    c //= k * k
    return x.reshape(b, h, w, k, k, c).permute(0, 1, 3, 2, 4, 5).reshape(b, h * k, w * k, c)


def planes_of(x, k):
    """`depth_to_space`, and the channels first."""
    b, h, w, c = x.shape
    c //= k * k
    return x.reshape(b, h, w, k, k, c).permute(0, 5, 1, 3, 2, 4).reshape(b, c, h * k, w * k)


def volume_to_depth(x):
    b, s, h, w, c = x.shape
    x = x.reshape(b, s // 2, 2, h // 2, 2, w // 2, 2, c).permute(0, 1, 3, 5, 2, 4, 6, 7)
    return x.reshape(b, s // 2, h // 2, w // 2, 8 * c)


def depth_to_volume(x):
    b, s, h, w, c = x.shape
    c //= 8
    return x.reshape(b, s, h, w, 2, 2, 2, c).permute(0, 1, 4, 2, 5, 3, 6, 7).reshape(b, 2 * s, 2 * h, 2 * w, c)


def spread(x):
    """An image of blocks at the size of the pixels."""
    return x.repeat_interleave(4, 1).repeat_interleave(4, 2)


def around(padded, reach, dy, dx):
    """The neighbours at an offset, of an image b x h x w that was padded by `reach`."""
    h, w = padded.shape[1] - 2 * reach, padded.shape[2] - 2 * reach
    return padded[:, reach + dy : reach + dy + h, reach + dx : reach + dx + w]


def pad(x, reach):
    """An image b x h x w with its edges repeated."""
    return F.pad(x[:, None], (reach,) * 4, mode="replicate")[:, 0]


class Neighbourhood(torch.autograd.Function):
    """The sums of a pixel and its neighbours at distances 1 and 3 by weights b x 17 x h x w."""

    OFFSETS = [(0, 0)] + [(k * dy, k * dx) for k in (1, 3) for dy, dx in AROUND]

    @staticmethod
    def forward(ctx, weights, x):
        padded = pad(x, 3)
        ctx.save_for_backward(weights, padded)
        sums = torch.zeros_like(x)
        for k, offset in enumerate(Neighbourhood.OFFSETS):
            sums.addcmul_(weights[:, k], around(padded, 3, *offset))
        return sums

    @staticmethod
    def backward(ctx, gradient):
        weights, padded = ctx.saved_tensors
        of_weights, of_padded = torch.empty_like(weights), torch.zeros_like(padded)
        for k, offset in enumerate(Neighbourhood.OFFSETS):
            torch.mul(gradient, around(padded, 3, *offset), out=of_weights[:, k])
            around(of_padded, 3, *offset).addcmul_(gradient, weights[:, k])
        like = gradient[:, None].contiguous()
        of_x = torch.ops.aten.replication_pad2d_backward(of_padded[:, None], like, [3, 3, 3, 3])[:, 0]
        return of_weights, of_x


# Layers that add to what they are given start near zero.
GAINS = {"lo": 0.3, "o": 0.1, **{name: 0.5 for name in ("l0ad", "l1ad", "l2ad", "l2bd", "l1bd", "l0bd", "uc", "u2c", "u3c", "u4c", "u4e")}}
CENTERS = {"g0": 32.0, "in": 32.0, "ua": 48.0}
# Inputs are some five times as large as activations.
GAINS.update({"g0": 0.5, "in": 0.5, "ua": 0.5, "u1": 0.7, "u0": 0.7, "uu1": 0.7, "uu2": 0.7, "uu3": 0.7, "g1": 0.7})


class Network(nn.Module):
    def __init__(self):
        super().__init__()
        for name, inputs, outputs, size in LAYERS:
            self.add_module("layer_" + name, Layer(inputs, outputs, size, GAINS.get(name, 1.0), CENTERS.get(name, 0.0)))
        # The pixel itself counts first, the free choices start even.
        first = torch.zeros(31)
        first[0], first[17:20], first[24] = 3.0, torch.tensor([1.0, 1.0, 0.5]), 2.0
        self.layer("o").bias.data = first.repeat(4)

    def layer(self, name):
        return getattr(self, "layer_" + name)

    def layers(self):
        return [self.layer(name) for name, *_ in LAYERS]

    def quantize(self, quantized=True):
        for layer in self.layers():
            layer.quantized = quantized

    def volume_block(self, name, x):
        b, s, h, w, c = x.shape
        y = self.layer(name + "s")(x.reshape(b * s, h, w, c)).reshape(b, s, h, w, c)
        y = F.pad(y, (0, 0, 0, 0, 0, 0, 1, 1))
        y = torch.cat([y[:, :-2], y[:, 1:-1], y[:, 2:]], -1)
        return self.layer(name + "d").residual(y, x)

    def volume_logits(self, rgb, volume):
        """The logits of all slices b x n x h x w in units of 1/16: of the colours (halved), and of the volume b x n x h x w x 8."""
        guide = self.layer("g1").raw(self.layer("g0")(space_to_depth(rgb, 4)))
        b, n, h, w, c = volume.shape
        pairs = volume.reshape(b, n // 2, 2, h, w, c).permute(0, 1, 3, 4, 2, 5).reshape(b, n // 2, h, w, 2 * c)
        e0 = self.volume_block("l0a", self.layer("in").residual(pairs, guide[:, None]))
        e1 = self.volume_block("l1a", self.layer("d1")(volume_to_depth(e0)))
        x = self.volume_block("l2b", self.volume_block("l2a", self.layer("d2")(volume_to_depth(e1))))
        x = self.layer("u1").clip(depth_to_volume(self.layer("u1").raw(x)) + e1)
        x = self.volume_block("l1b", x)
        x = self.layer("u0").clip(depth_to_volume(self.layer("u0").raw(x)) + e0)
        x = self.volume_block("l0b", x)
        y = self.layer("lo").raw(x).permute(0, 1, 4, 2, 3).reshape(b, n, h, w)
        return y.float() - volume[..., 4].float()

    def features(self, inputs, dv, confidence, count):
        """The 24 channels of the pixels."""
        def gradient(d, dy, dx):
            d = pad(d, 1)
            return ((around(d, 1, dy, dx) - around(d, 1, -dy, -dx)) / 4 + 64).floor().clamp(0, TOP)

        da, db = inputs["da"], inputs["db"]
        planes = [
            (2 * da / count).floor(), (2 * db / count).floor(), (2 * dv / count).floor(),
            gradient(da, 0, 1), gradient(da, 1, 0), gradient(db, 0, 1), gradient(db, 1, 0),
            ((db - da) / 4 + 64).floor().clamp(0, TOP), ((dv - da) / 4 + 64).floor().clamp(0, TOP), confidence,
        ]  # fmt: skip
        return torch.cat([inputs["rgb"], torch.stack(planes, -1), inputs["p"]], -1)

    def outputs(self, features):
        run = lambda name, x: self.layer(name)(x)
        block = lambda b, c, x: self.layer(c).residual(run(b, x), x)
        f1 = block("ub", "uc", run("ua", space_to_depth(features, 2)))
        f2 = block("u2b", "u2c", run("ud2", space_to_depth(f1, 2)))
        f3 = block("u3b", "u3c", run("ud3", space_to_depth(f2, 2)))
        x = block("u4d", "u4e", block("u4b", "u4c", run("ud4", space_to_depth(f3, 2))))
        for up, conv, skip in (("uu3", "u3d", f3), ("uu2", "u2d", f2), ("uu1", "u1d", f1)):
            x = run(conv, self.layer(up).clip(depth_to_space(self.layer(up).raw(x), 2) + skip))
        return planes_of(self.layer("o").raw(x), 2).float()

    def forward(self, inputs, dtype=torch.float32):
        """Inputs as tensors: rgb b x h x w x 3 (halved), da, db b x h x w in 1/64 px, p b x h x w x 11, volume b x n x h/4 x w/4 x 8,
        and the count of disparities. Disparities are in 1/64 px."""
        count = inputs["count"]
        volume = inputs["volume"].to(dtype)
        logits = self.volume_logits(inputs["rgb"].to(dtype), volume)[:, :count]
        probabilities = torch.softmax(logits * (1 / UNIT), 1)
        best = logits.argmax(1, keepdim=True)
        index = torch.arange(count, device=logits.device)[None, :, None, None]
        window = probabilities * ((index - best).abs() <= 2)
        mass = window.sum(1)
        coarse = (window * (64.0 * index)).sum(1) / mass
        dv = spread(coarse.detach().round())
        confidence = spread((TOP * mass.detach()).floor())
        features = self.features({k: inputs[k].float() for k in ("rgb", "da", "db", "p")}, dv, confidence, count)
        o = self.outputs(features.to(dtype)) * (1 / UNIT)
        weights, gates, blocks_of, residual, sure = o.split((17, 3, 9, 1, 1), 1)
        b, _, height, width = o.shape
        blocks = pad(coarse, 1)
        blocks = torch.stack([around(blocks, 1, dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1)], 1)
        shares = torch.softmax(blocks_of, 1).reshape(b, 9, height // 4, 4, width // 4, 4)
        fine_volume = (shares * blocks[:, :, :, None, :, None]).sum(1).reshape(b, height, width)
        choices = torch.stack([inputs["da"].float(), inputs["db"].float(), fine_volume], 1)
        mixed = (torch.softmax(gates, 1) * choices).sum(1)
        disparity = Neighbourhood.apply(torch.softmax(weights, 1), mixed) + UNIT * residual[:, 0]
        return {"disparity": disparity, "mixed": mixed, "volume": fine_volume, "logits": logits, "confidence": sure[:, 0]}
