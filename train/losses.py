"""The loss of the training, and the metrics by which weights are selected."""

import torch
import torch.nn.functional as F


def robust(error):
    """The loss of an error in pixels: nearly linear near 0, then of a small slope, so that hidden surfaces do not count too much."""
    return ((error * error + 0.01).sqrt() - 0.1).clamp(max=4.0) + 0.05 * error.abs()


def mean(values, valid):
    return (values * valid).sum() / valid.sum().clamp(min=1)


def block_shares(truth, valid, count):
    """The share of each block's pixels at each whole disparity, b x count x h/4 x w/4; a pixel between two counts for both."""
    b, h, w = truth.shape
    block = torch.arange(h)[:, None] // 4 * (w // 4) + torch.arange(w) // 4
    whole = truth.floor()
    shares = torch.zeros(b, count * (h // 4) * (w // 4))
    for index, share in ((whole, 1 - (truth - whole)), (whole + 1, truth - whole)):
        inside = (index >= 0) & (index < count)
        at = index.clamp(0, count - 1).long() * ((h // 4) * (w // 4)) + block
        shares.scatter_add_(1, at.reshape(b, -1), (share * inside * valid / 16).reshape(b, -1))
    return shares.reshape(b, count, h // 4, w // 4)


def loss(out, truth, count):
    valid = truth.isfinite() & (truth > -32) & (truth < 64 * count - 32)
    truth = torch.where(valid, truth, 0.0)
    valid = valid.float()
    error = (out["disparity"] - truth) / 64
    total = mean(robust(error), valid)
    for name in ("mixed", "volume"):
        total = total + 0.3 * mean(robust((out[name] - truth) / 64), valid)
    b, n, h, w = out["logits"].shape
    target = block_shares(truth / 64, valid, n)
    total = total - 0.25 * (target * F.log_softmax(out["logits"] / 16, 1)).sum(1).mean()
    right = (error.detach().abs() <= 1).float()
    return total + 0.1 * mean(F.binary_cross_entropy_with_logits(out["confidence"], right, reduction="none"), valid)


def metrics(disparity, truth):
    """RMS, mean error and share of errors above a pixel, of arrays in 1/64 px."""
    valid = truth.isfinite()
    error = ((disparity - truth)[valid] / 64).abs()
    return torch.stack([(error**2).mean().sqrt(), error.mean(), 100 * (error > 1).float().mean()])
