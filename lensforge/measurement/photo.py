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
from lensforge.measurement.corners import Located, locate
from lensforge.measurement.orientation import require_upright
from lensforge.measurement.photo_figure import draw_comparison
from lensforge.measurement.photograph import Photograph, lit_only, read_photograph
from lensforge.measurement.rectify import rectify
from lensforge.measurement.similarity import displacement, moved_back, normalised, similarity
from lensforge.receivers.plane import Receiver

CLIPPED_SHARE = 0.01  # of the target: clipped pixels make a pattern look more uniform than it is
_LEAST_PIXELS = 11  # the window of SSIM


@dataclass(frozen=True)
class Shot:
    """What was photographed: LED on, LED off, the target's corners (column, row), its side, the camera's gamma.

    Corners of None are looked for in the pictures; a side of None is that of the design's receiver.
    """

    on: Path
    off: Path | None
    corners: Float[np.ndarray, "4 2"] | None
    target_mm: float | None = None
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

    Corners that are not given are looked for. Writes compare.json, compare.npz and compare.png. Both pictures are
    scaled to a mean of 1. Raises :class:`InputError` for pictures or corners that cannot be used.
    """
    receiver, reference = Receiver(receiver_mm, len(simulated)), normalised(simulated)
    picture, located = _picture(shot, receiver, reference)
    measured = picture.light
    moved = displacement(measured, reference)
    aligned = moved_back(measured, moved)
    content = {
        "on": shot.on.name,
        "off": shot.off.name if shot.off else None,
        "corners": picture.corners.tolist(),
        "corners_located": None if located is None else located.to_json(),
        "target_mm": shot.target_mm or receiver_mm,
        "gamma": shot.gamma,
        "pixels": receiver.pixels,
        **asdict(similarity(measured, reference)),
        "displacement_mm": (moved * receiver.pitch_mm).tolist(),
        "aligned": asdict(similarity(aligned, reference)),
        "measured": _uniformity(measured, receiver, uniform_mm),
        "simulated": _uniformity(reference, receiver, uniform_mm),
        "clipped": picture.clipped,
    }
    remedy = "expose for a shorter time, both pictures alike"
    content["gates"] = [Gate("photo_clipped", picture.clipped, "<=", CLIPPED_SHARE, "of the target", remedy).to_json()]
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


@dataclass(frozen=True)
class _OnTarget:
    """The picture on the receiver, its mean 1; the share of it that the camera clipped; and the corners it is by."""

    light: Float[np.ndarray, "p p"]
    clipped: float
    corners: Float[np.ndarray, "4 2"]


def _picture(shot: Shot, receiver: Receiver, reference: Float[np.ndarray, "p p"]) -> tuple[_OnTarget, Located | None]:
    """The photograph on the receiver, and how its corners were found if they were not given."""
    if receiver.pixels < _LEAST_PIXELS:
        raise InputError(f"evaluate.pixels = {receiver.pixels}: at least {_LEAST_PIXELS} to compare pictures")
    on = read_photograph(shot.on, shot.gamma)
    dark = read_photograph(shot.off, shot.gamma) if shot.off else None
    lit = lit_only(on, dark)
    if shot.corners is not None:
        return _on_target(lit, shot, shot.corners, receiver), None
    located = locate(
        on.light,
        None if dark is None else dark.light,
        border_share=_border_share(reference),
        lit_square=shot.target_mm is not None,
    )
    seen = _on_target(lit, shot, located.corners, receiver)
    require_upright(seen.light, reference, located.corners)
    return seen, located


def _on_target(picture: Photograph, shot: Shot, corners: Float[np.ndarray, "4 2"], receiver: Receiver) -> _OnTarget:
    target_mm = shot.target_mm or receiver.side_mm
    image = rectify(picture.light, corners, target_mm, receiver)
    unseen = float(np.isnan(image).mean())
    if unseen > 0.0:
        raise InputError(
            f"--corners: {unseen:.1%} of the receiver of {receiver.side_mm:g} mm lies outside of {shot.on}; "
            "are the corners those of a square of --target-mm?"
        )
    if image.mean() <= 0.0:
        raise InputError(f"{shot.on}: no brighter than --off within the corners; are the two pictures interchanged?")
    clipped = float(rectify(picture.clipped, corners, target_mm, receiver).mean())
    return _OnTarget(normalised(image), clipped, corners)


def _border_share(reference: Float[np.ndarray, "p p"]) -> float:
    """How bright the simulation is at its border, of its peak."""
    border = np.concatenate([reference[0], reference[-1], reference[:, 0], reference[:, -1]])
    return float(border.mean() / reference.max())


def _uniformity(
    image: Float[np.ndarray, "p p"], receiver: Receiver, uniform_mm: float | None
) -> dict[str, float | None]:
    if uniform_mm is None or not (mask := receiver.square_mask(uniform_mm)).any():
        return {"uniformity": None, "rsd": None}
    return {"uniformity": uniformity(image, mask), "rsd": relative_deviation(image, mask)}
