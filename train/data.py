"""Batches of features with truth."""

from pathlib import Path

import numpy as np
import torch

from scenes import read_pfm

# The share of pixels at which semi-global matching fails; scenes with a larger one count less, in inverse proportion.
EASY = 0.1


class Example:
    """The features of a scene, and its truth in 1/64 px from the least disparity on."""

    def __init__(self, folder, truth, least):
        load = lambda name: np.load(Path(folder) / f"{name}.npy")
        self.rgb, self.winners, self.measures, self.volume = map(load, ("colors", "winners", "measures", "volume"))
        self.truth = 64 * (read_pfm(truth) - least)
        self.count = self.volume.shape[0]
        valid = np.isfinite(self.truth)
        # The share of pixels at which semi-global matching fails: how hard the scene is.
        hardness = (np.abs(self.winners[1] - self.truth)[valid] > 64).mean()
        # How often it is drawn: scenes in which little can be matched teach less.
        self.weight = EASY / max(hardness, EASY)

    @property
    def features(self):
        """The arrays that the program writes, in the order of `reference.infer`."""
        return self.rgb, self.winners, self.measures, self.volume

    def arrays(self, y=0, x=0, height=None, width=None):
        """The arrays of the pixels from (y, x) on, which are multiples of 4; padded by repetition as the program does."""
        height, width = height or self.truth.shape[0] - y, width or self.truth.shape[1] - x
        block = lambda a, axis: a.take(range(y // 4, (y + -(-height // 16) * 16) // 4), axis).take(
            range(x // 4, (x + -(-width // 16) * 16) // 4), axis + 1
        )
        pad = lambda a: np.pad(a, ((0, -height % 16), (0, -width % 16)) + ((0, 0),) * (a.ndim - 2), "edge")
        crop = lambda a: pad(a[y : y + height, x : x + width])
        volume = block(self.volume, 1)
        # Slices come in eights.
        volume = np.pad(volume, ((0, -self.count % 8), (0, 0), (0, 0), (0, 0)), constant_values=127)
        rgb, da, db, p = crop(self.rgb), crop(self.winners[0]), crop(self.winners[1]), crop(self.measures)
        return {"rgb": rgb, "da": da, "db": db, "p": p, "volume": volume, "truth": crop(self.truth)}


def augmented(arrays, random):
    """The scene in a mirror, upside down, in other colours."""
    for axis in (0, 1):
        if random.random() < 0.5:
            arrays = {name: np.flip(a, axis + (name == "volume")) for name, a in arrays.items()}
    choice, rgb = random.random(), arrays["rgb"]
    if choice < 0.3:
        rgb = rgb[..., random.permutation(3)]
    elif choice < 0.45:
        gray = (rgb.astype(np.uint16) @ np.array([77, 150, 29], np.uint16).astype(np.uint32) + 128) >> 8
        rgb = np.repeat(gray.astype(np.uint8)[..., None], 3, -1)
    return {**arrays, "rgb": rgb}


def batch_of(all_arrays, count):
    """Tensors for `Network.forward`, with the truth."""
    tensor = lambda name: torch.from_numpy(np.ascontiguousarray(np.stack([a[name] for a in all_arrays])))
    batch = {name: tensor(name) for name in ("p", "volume", "truth")}
    batch["da"], batch["db"] = (torch.from_numpy(np.stack([a[n] for a in all_arrays]).astype(np.int32)) for n in ("da", "db"))
    batch["rgb"] = tensor("rgb") >> 1
    return {**batch, "count": count}
