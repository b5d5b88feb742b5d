"""Accurate depth from one camera that is moved on purpose: multiscopic matching of numpy arrays."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal, Protocol, TypedDict, final

import numpy as np
import numpy.typing as npt
from typing_extensions import Unpack

__version__: str

class MatchWarning(UserWarning):
    """A reason to doubt images, or the disparities that were found in them."""

#: Of height x width, or height x width x 3 (RGB).
_Image = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
#: Offsets from the centre in baselines to the right and down.
_Offset = tuple[int, int]

class _SweepOptions(TypedDict, total=False):
    """The keyword arguments of match_sweep(), as match() takes them."""

    min_disparity: int | None
    num_disparities: int | None
    min_confidence: float | None
    auto_range: bool | None
    inspection: bool | None
    bits: Literal[10, 12, 14, 16] | None
    threads: int | None
    simd: str | None
    max_memory: int | None

class _Options(TypedDict, total=False):
    """The keyword arguments of match(), whose help describes them."""

    method: Literal["bm", "gc", "sgm", "mccnn-fast", "mccnn-accurate", "net"] | None
    fusion: Literal["min", "mean", "heuristic", "half", "trimmed"] | None
    min_disparity: int | None
    num_disparities: int | None
    block_size: int | None
    occlusion_cost: float | Literal["auto"] | None
    occlusions: Literal["unique", "capped"] | None
    smoothness: Literal["linear", "potts"] | None
    lambda1: float | None
    lambda2: float | None
    theta: int | None
    cutoff: int | None
    gray: bool | None
    reach: int | None
    sweeps: int | None
    seed: int | None
    refine: bool | None
    keep_occluded: bool | None
    upsample: Literal[1, 2, 3, 4] | None
    cost: Literal["census", "census2", "sad"] | None
    p1: int | None
    p2: int | None
    p2_edge: int | None
    paths: Literal[4, 5, 8] | None
    census: Literal["5x5", "7x7", "9x7"] | None
    sgm_p1: float | None
    sgm_p2: float | None
    sgm_q1: float | None
    sgm_q2: float | None
    sgm_v: float | None
    sgm_d: float | None
    cbca_intensity: float | None
    cbca_distance: int | None
    cbca_iterations_1: int | None
    cbca_iterations_2: int | None
    search_margin: int | None
    disp12_max_diff: int | None
    uniqueness_ratio: int | None
    texture_threshold: int | None
    speckle_window_size: int | None
    speckle_range: int | None
    median: int | None
    bilateral: tuple[float, float] | None
    sub_pixel: Literal["lucas-kanade", "none"] | None
    repair: Literal["smooth", "none"] | None
    hidden: Literal["background", "none"] | None
    min_confidence: float | None
    smooth: bool | None
    fill: Literal["background"] | None
    prior_disparities: int | None
    prior_median: int | None
    together: bool | None
    align: bool | None
    auto_range: bool | None
    inspection: bool | None
    bits: Literal[10, 12, 14, 16] | None
    prior: npt.ArrayLike | None
    confidence: bool | None
    threads: int | None
    simd: str | None
    max_memory: int | None

@final
class Result:
    """Disparities, how sure they are, and the depths that follow from them."""

    @property
    def disparity(self) -> npt.NDArray[np.float32]:
        """Disparities in pixels: height x width, NaN where there is none."""

    @property
    def warnings(self) -> list[str]:
        """The reasons to doubt the images or the disparities, the worst first."""

    @property
    def confidence(self) -> npt.NDArray[np.uint8] | None:
        """The probability that a disparity is at most one pixel off, times 255: height x width, 0 where there is none."""

    def depth(
        self, focal_px: float | None = None, baseline_mm: float | None = None, doffs: float | None = None
    ) -> npt.NDArray[np.float32]:
        """Depths in metres: height x width, NaN where there is none."""

    def sigma(
        self, focal_px: float | None = None, baseline_mm: float | None = None, doffs: float | None = None
    ) -> npt.NDArray[np.float32]:
        """Standard deviations of the depths in metres: height x width, NaN where there is none."""

    def points(
        self,
        focal_px: float | None = None,
        baseline_mm: float | None = None,
        doffs: float | None = None,
        principal_point: tuple[float, float] | None = None,
        frame: Literal["camera", "tool", "base"] = "camera",
        edges: Literal["drop", "keep"] = "drop",
    ) -> npt.NDArray[np.float32]:
        """Points in metres: height x width x 3, NaN where there is none; x to the right, y down, z away."""

    def write_ply(
        self,
        path: str | os.PathLike[str],
        focal_px: float | None = None,
        baseline_mm: float | None = None,
        doffs: float | None = None,
        principal_point: tuple[float, float] | None = None,
        ascii: bool = False,
        frame: Literal["camera", "tool", "base"] = "camera",
        edges: Literal["drop", "keep"] = "drop",
    ) -> None:
        """Writes a point cloud in metres, in the colours of the centre, and with confidences and sigmas if there are some."""

@final
class Rig:
    """A captured folder: images and the rig.toml that describes them."""

    @staticmethod
    def load(path: str | os.PathLike[str]) -> Rig:
        """Reads the rig.toml in a folder, and the calibration of its lens, if it names one."""

    @property
    def path(self) -> Path:
        """The folder."""

    @property
    def baseline_mm(self) -> float | None:
        """The distance from the centre to each neighbour in millimetres, if it is known."""

    @property
    def focal_px(self) -> float | None:
        """The focal length in pixels, if it is known."""

    @property
    def doffs(self) -> float:
        """The negated disparity of a point at infinity, in pixels."""

    @property
    def views(self) -> list[_Offset]:
        """The offsets of the neighbours from the centre, in baselines to the right and down."""

    def frames(self) -> dict[_Offset, npt.NDArray[np.uint8]]:
        """Reads the images, without the distortion of the lens, by their offsets from the centre, whose own is (0, 0)."""

    def sweep(self) -> tuple[npt.NDArray[np.uint8], list[npt.NDArray[np.uint8]], list[float]]:
        """Reads the frames of a sweep: the centre, the others, and their places in millimetres to the right, for match_sweep()."""

    def match(self, **options: Unpack[_Options]) -> Result:
        """Reads the images and matches the centre with its neighbours, or with the frames of a sweep."""

class _Stage(Protocol):
    """A stage of your own. It may also have position(), pose() and stop()."""

    def move_to(self, right_mm: float, down_mm: float, /) -> object: ...

class _Camera(Protocol):
    """A camera of your own."""

    def grab(self) -> _Image: ...

def capture(
    stage: _Stage,
    camera: _Camera,
    path: str | os.PathLike[str],
    *,
    baseline_mm: float,
    views: Literal[1, 2, 3, 4, 8] | None = None,
    layout: str | None = None,
    focal_px: float | None = None,
    lens: str | os.PathLike[str] | None = None,
    mount: str | os.PathLike[str] | None = None,
    hand_eye: str | os.PathLike[str] | None = None,
    settle: float = 0.2,
    tolerance_um: int = 100,
    backlash_um: int = 0,
    bits: Literal[10, 12, 14, 16] | None = None,
) -> Rig:
    """Captures a rig with a stage and a camera of your own: objects of any class with these methods."""

def match(
    center: _Image,
    left: _Image | None = None,
    right: _Image | None = None,
    top: _Image | None = None,
    bottom: _Image | None = None,
    *,
    views: Mapping[_Offset, _Image] | None = None,
    **options: Unpack[_Options],
) -> Result:
    """Estimates the disparity of each pixel of a centre image by matching it with its neighbours."""

def match_sweep(
    center: _Image,
    frames: Sequence[_Image],
    offsets_mm: Sequence[float],
    *,
    baseline_mm: float | None = None,
    **options: Unpack[_SweepOptions],
) -> Result:
    """Estimates the disparity of each pixel of a centre image from the frames of a camera that slid along its rows: a sweep."""

def align(
    center: _Image,
    left: _Image | None = None,
    right: _Image | None = None,
    top: _Image | None = None,
    bottom: _Image | None = None,
    *,
    views: Mapping[_Offset, _Image] | None = None,
    min_disparity: int | None = None,
    num_disparities: int | None = None,
    focal_px: float | None = None,
    bits: Literal[10, 12, 14, 16] | None = None,
) -> dict[_Offset, _Image]:
    """Rectifies views: finds from the images how each is turned, scaled and off its place, and takes that out."""

def inspect(
    center: _Image,
    left: _Image | None = None,
    right: _Image | None = None,
    top: _Image | None = None,
    bottom: _Image | None = None,
    *,
    views: Mapping[_Offset, _Image] | None = None,
    bits: Literal[10, 12, 14, 16] | None = None,
) -> tuple[tuple[int, int] | None, list[str]]:
    """Tells what images show before they are matched: the range of their disparities, and what may be wrong with them."""

def evaluate(
    disparity: npt.ArrayLike, truth: npt.ArrayLike, confidence: npt.NDArray[np.uint8] | None = None
) -> dict[str, float]:
    """The errors of disparities over all pixels whose true disparity is known."""

def colorize(disparity: npt.ArrayLike, range: tuple[float, float] | None = None) -> npt.NDArray[np.uint8]:
    """Disparities in colour: near is red, far is blue, and pixels without a disparity are black."""

def read_image(path: str | os.PathLike[str]) -> npt.NDArray[np.uint8]:
    """Reads a PNG, JPEG, TIFF, BMP, WebP, PGM, PPM or PFM image in 8 bits."""

def set_max_pixels(pixels: int) -> None:
    """Changes the most pixels of the images and maps that are read."""

def write_png(path: str | os.PathLike[str], image: _Image) -> None:
    """Writes an image as PNG."""

def read_pfm(path: str | os.PathLike[str]) -> npt.NDArray[np.float32]:
    """Reads a PFM file with one channel: height x width, NaN where the file has +inf."""

def write_pfm(path: str | os.PathLike[str], values: npt.ArrayLike) -> None:
    """Writes a PFM file with one channel. NaN becomes +inf."""
