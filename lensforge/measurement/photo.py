"""``lensforge compare --on``: a photograph of the part's light against the simulation, as in the paper's Fig. 7."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.evaluation.metrics import relative_deviation, uniformity
from lensforge.files import replacing, write_json
from lensforge.gates import Gate
from lensforge.measurement.photo_figure import draw_comparison
from lensforge.measurement.photograph import lit_only, read_photograph
from lensforge.measurement.rectify import rectify
from lensforge.measurement.similarity import displacement, moved_back, normalised, similarity
from lensforge.receiver.plane import Receiver

CLIPPED_SHARE = 0.01  # of the target: clipped pixels make a pattern look more uniform than it is
_LEAST_PIXELS = 11  # the window of SSIM


@dataclass(frozen=True)
class Shot:
    """What was photographed: LED on, LED off, the target's corners (column, row), its side, the camera's gamma."""

    on: Path
    off: Path | None
    corners: Float[np.ndarray, "4 2"]
    target_mm: float
    gamma: float = 1.0


def compare_photo(
    shot: Shot,
    directory: Path,
    *,
    simulated: Float[np.ndarray, "p p"],
    receiver_mm: float,
    uniform_mm: float | None,
) -> dict[str, Any]:
    """Compare ``shot`` with the ``simulated`` irradiance ([y, x], any unit) on a receiver ``receiver_mm`` wide.

    Writes compare.json, compare.npz and compare.png. Both pictures are scaled to a mean of 1. Raises
    :class:`InputError` for pictures or corners that cannot be used.
    """
    receiver = Receiver(receiver_mm, len(simulated))
    measured, clipped = _measured(shot, receiver)
    reference = normalised(simulated)
    moved = displacement(measured, reference)
    aligned = moved_back(measured, moved)
    content = {
        "on": shot.on.name,
        "off": shot.off.name if shot.off else None,
        "corners": shot.corners.tolist(),
        "target_mm": shot.target_mm,
        "gamma": shot.gamma,
        "pixels": receiver.pixels,
        **asdict(similarity(measured, reference)),
        "displacement_mm": (moved * receiver.pitch_mm).tolist(),
        "aligned": asdict(similarity(aligned, reference)),
        "measured": _uniformity(measured, receiver, uniform_mm),
        "simulated": _uniformity(reference, receiver, uniform_mm),
        "clipped": clipped,
    }
    remedy = "expose for a shorter time, both pictures alike"
    content["gates"] = [Gate("photo_clipped", clipped, "<=", CLIPPED_SHARE, "of the target", remedy).to_json()]
    images = {"measured": measured, "simulated": reference, "axis_mm": receiver.axis_mm()}
    sections = {
        f"section_{axis}_{name}": section(images[name], axis) for axis in "xy" for name in ("measured", "simulated")
    }
    with replacing(Path(directory) / "compare.npz") as temporary:
        np.savez_compressed(temporary, allow_pickle=False, **images, **sections)
    with replacing(Path(directory) / "compare.png") as temporary:
        draw_comparison(temporary, images, sections, receiver_mm)
    write_json(Path(directory) / "compare.json", content)
    return content


def section(image: Float[np.ndarray, "p p"], axis: str) -> Float[np.ndarray, " p"]:
    """The line through the centre along ``axis``, the mean of the two middle lines if the number of them is even."""
    lines = image if axis == "x" else image.T
    middle = len(image) // 2
    mean: Float[np.ndarray, " p"] = lines[middle - (len(image) % 2 == 0) : middle + 1].mean(axis=0)
    return mean


def _measured(shot: Shot, receiver: Receiver) -> tuple[Float[np.ndarray, "p p"], float]:
    """The normalised picture on the receiver, and the share of it that the camera clipped."""
    if receiver.pixels < _LEAST_PIXELS:
        raise InputError(f"evaluate.pixels = {receiver.pixels}: at least {_LEAST_PIXELS} to compare pictures")
    dark = read_photograph(shot.off, shot.gamma) if shot.off else None
    picture = lit_only(read_photograph(shot.on, shot.gamma), dark)
    image = rectify(picture.light, shot.corners, shot.target_mm, receiver)
    unseen = float(np.isnan(image).mean())
    if unseen > 0.0:
        raise InputError(
            f"--corners: {unseen:.1%} of the receiver of {receiver.side_mm:g} mm lies outside of {shot.on}; "
            "are the corners those of a square of --target-mm?"
        )
    if image.mean() <= 0.0:
        raise InputError(f"{shot.on}: no brighter than --off within the corners; are the two pictures interchanged?")
    clipped = float(rectify(picture.clipped, shot.corners, shot.target_mm, receiver).mean())
    return normalised(image), clipped


def _uniformity(
    image: Float[np.ndarray, "p p"], receiver: Receiver, uniform_mm: float | None
) -> dict[str, float | None]:
    if uniform_mm is None or not (mask := receiver.square_mask(uniform_mm)).any():
        return {"uniformity": None, "rsd": None}
    return {"uniformity": uniformity(image, mask), "rsd": relative_deviation(image, mask)}
