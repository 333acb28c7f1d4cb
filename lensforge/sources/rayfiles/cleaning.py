"""Rays that can be traced: finite, with a direction, with flux; the rest is dropped and counted."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from lensforge.errors import InputError
from lensforge.sources.rayfiles.record import HUGE, RayFile, as_float64

_NO_DIRECTION = 1e-12  # |k| below which a direction is no direction


@dataclass(frozen=True)
class ValidRays:
    """``n`` usable rays in float64: mm, unit directions, flux as stored; and how many were dropped, by cause."""

    positions: Float[np.ndarray, "n 3"]
    directions: Float[np.ndarray, "n 3"]
    flux: Float[np.ndarray, " n"]
    wavelengths: Float[np.ndarray, " n"] | None
    spectrum_numbers: Float[np.ndarray, " n"] | None
    dropped: dict[str, int]

    def __len__(self) -> int:
        return len(self.flux)


def valid_rays(rayfile: RayFile) -> ValidRays:
    """The usable rays, directions normalised.

    Dropped, each ray for the first cause that applies: ``not_finite`` (a NaN or an absurd number), ``zero_direction``,
    ``no_flux`` (zero or negative).
    """
    positions, directions = as_float64(rayfile.positions), as_float64(rayfile.directions)
    flux = as_float64(rayfile.flux)
    finite = _finite(positions).all(axis=1) & _finite(directions).all(axis=1) & _finite(flux)
    directions[~finite] = 0.0
    length = np.linalg.norm(directions, axis=1)
    directed = length > _NO_DIRECTION
    with np.errstate(invalid="ignore"):
        bright = flux > 0.0
    keep = finite & directed & bright
    return ValidRays(
        positions=positions[keep],
        directions=directions[keep] / length[keep, None],
        flux=flux[keep],
        wavelengths=None if rayfile.wavelengths is None else as_float64(rayfile.wavelengths[keep]),
        spectrum_numbers=None if rayfile.spectrum_numbers is None else as_float64(rayfile.spectrum_numbers[keep]),
        dropped={
            "not_finite": int(np.count_nonzero(~finite)),
            "zero_direction": int(np.count_nonzero(finite & ~directed)),
            "no_flux": int(np.count_nonzero(finite & directed & ~bright)),
        },
    )


def valid_chunks(rayfile: RayFile) -> Iterator[ValidRays]:
    """The usable rays, some at a time, so that a file of any size needs little memory."""
    for block in rayfile.blocks():
        yield valid_rays(block)


def no_usable_ray(rayfile: RayFile, dropped: dict[str, int]) -> InputError:
    """The error for a file of which nothing is left."""
    return InputError(f"{rayfile.path}: none of its {len(rayfile)} rays is usable ({causes(dropped)}); export it again")


def causes(dropped: dict[str, int]) -> str:
    """Counts and causes in words."""
    return ", ".join(f"{count} {cause.replace('_', ' ')}" for cause, count in dropped.items() if count)


def _finite(values: Float[np.ndarray, "*n"]) -> Bool[np.ndarray, "*n"]:
    with np.errstate(invalid="ignore"):
        finite: Bool[np.ndarray, "*n"] = np.abs(values) < HUGE
        return finite
