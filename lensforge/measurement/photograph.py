"""Photographs as linear light: read, decoded, the dark frame taken off."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError

_REC709 = np.array([0.2126, 0.7152, 0.0722])  # luminance of linear red, green, blue (ITU-R BT.709)


@dataclass(frozen=True)
class Photograph:
    """Linear light by pixel, any unit, [row, column] with row 0 on top; full scale of the camera is 1.

    ``clipped``: 1 where any colour was at full scale, so that the light may have been more.
    """

    light: Float[np.ndarray, "h w"]
    clipped: Float[np.ndarray, "h w"]


def read_photograph(path: Path, gamma: float = 1.0) -> Photograph:
    """Read a grey or colour image of 8 or 16 bits; its values to the power of ``gamma`` are the light.

    1 is right for raw cameras, 2.2 for most pictures meant to be looked at. Raises :class:`InputError`.
    """
    from skimage.io import imread

    if not Path(path).is_file():
        raise InputError(f"{path}: no such file")
    try:
        values = np.asarray(imread(str(path)))
    except Exception as error:  # the readers raise whatever their parsers do
        reason = f"{error}".splitlines()[0] if f"{error}" else type(error).__name__
        raise InputError(f"{path}: not readable as an image ({reason}); PNG, TIFF and JPEG work") from None
    if values.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: pixels of type {values.dtype}, must be of 8 or 16 bits; convert it to PNG or TIFF")
    if values.ndim == 3 and values.shape[2] in (3, 4):
        values = values[:, :, :3]
    elif values.ndim != 2:
        raise InputError(f"{path}: shape {values.shape}, must be one grey or colour image")
    full = np.iinfo(values.dtype).max
    linear, at_full = (values / full) ** gamma, values == full
    if values.ndim == 3:
        return Photograph(linear @ _REC709, at_full.any(axis=2).astype(float))
    return Photograph(linear, at_full.astype(float))


def lit_only(on: Photograph, off: Photograph | None) -> Photograph:
    """The light of the LED alone: ``on`` less ``off``, taken with the LED off and the same exposure."""
    if off is None:
        return on
    if on.light.shape != off.light.shape:
        raise InputError(
            f"--off: {off.light.shape[1]} x {off.light.shape[0]} pixels, --on has "
            f"{on.light.shape[1]} x {on.light.shape[0]}; take both with the same camera settings"
        )
    return Photograph(on.light - off.light, on.clipped)
