"""Regions of a receiver in which uniformity counts, and in which light counts as in the target."""

import numpy as np
from jaxtyping import Bool, Float

from lensforge.scene.receiver import PosedReceiver
from lensforge.spec import Target
from lensforge.spec.target_sections import IN_TARGET


def uniform_region(
    targets: tuple[Target, ...], receiver: PosedReceiver, wider_by_pixels: float = 0.0
) -> Bool[np.ndarray, "h w"] | None:
    """Pixels whose centres lie in the region of uniform light of any of ``targets``; None where none has one."""
    grid, found = receiver.grid, None
    for target in targets:
        sides = target.pair("uniform")
        if sides is None:
            continue
        x, y = receiver.target_coordinates(*np.meshgrid(grid.x(), grid.y()))
        x, y = target.about_centre(x, y)
        to_degrees = 180.0 / np.pi if receiver.kind == "far_field" else 1.0
        width, height = (
            side + wider_by_pixels * to_degrees * pixel for side, pixel in zip(sides, grid.pixel, strict=True)
        )
        inside = (np.abs(y) <= height / 2.0) & (np.abs(x) <= width / 2.0)
        found = inside if found is None else found | inside
    return found


def in_target(light: Float[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels in the target: where it is above a tenth of its maximum."""
    inside: Bool[np.ndarray, "h w"] = light > IN_TARGET * light.max()
    return inside
