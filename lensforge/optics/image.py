"""An image as it is stored, the relative light that its values stand for, and its embedded colour profile.

Values with a profile pass as sRGB where they agree to half a percent or so: International Color Consortium, ICC.1:2022,
sections 7, 10.6, 10.18.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from io import BytesIO
from typing import Literal

import numpy as np
from jaxtyping import Float, Real, Shaped, UInt

Luminance = Literal["as_stored", "srgb"]
"""The light that a picture's values stand for.

``as_stored``: the values themselves, with no gamma taken off; of colours their luma, 0.299 R + 0.587 G + 0.114 B
(ITU-R BT.601). ``srgb``: the luminance that a screen would show: values decoded by the sRGB curve (IEC 61966-2-1), of
colours 0.2126 R + 0.7152 G + 0.0722 B (ITU-R BT.709).
"""

REC709 = np.array([0.2126, 0.7152, 0.0722])  # luminance of linear red, green, blue (ITU-R BT.709)
_REC601 = np.array([19595.0, 38470.0, 7471.0])  # of 65,536, to which they add up: the luma of a grey is exactly itself
MOST_PIXELS = 2**26  # 8192 x 8192
_LONGEST_SIDE = 2**16
_UNREAD = {
    **dict.fromkeys(("CMYK", "SEPARATED"), "the four inks of print (CMYK)"),
    **dict.fromkeys(("LAB", "CIELAB"), "CIE L*a*b*"),
}
_WITHIN_SRGB = 0.01  # of full light; "gamma 2.2" is within 0.008 of sRGB, Display P3's green is 0.025 away
_GREYS = [[[level] * 3 for level in (26, 64, 128, 191, 230)]]
_COLOURS = [[[190, 90, 90], [90, 190, 90], [90, 90, 190], *_GREYS[0]]]  # inside the gamut of any display
_BAND_VALUES = 2**22  # converted at once: 32 MiB, so that a large picture needs little more than its light


@dataclass(frozen=True, eq=False)
class Picture:
    """Values [row, column, channel] as stored, row 0 at the top; one channel is grey, three are red, green and blue.

    ``full_scale``: the largest value that can be stored, 1 for floating-point numbers. ``opacity``: 0 where the
    picture is transparent, the largest number of its type where it is opaque, None for opaque everywhere.
    ``premultiplied``: the values are already multiplied by it. ``not_srgb``: why the values cannot be decoded as sRGB,
    "" where they can. ``orientation``: that of EXIF, by which the picture was turned upright.
    """

    values: Real[np.ndarray, "h w c"]
    full_scale: float
    opacity: UInt[np.ndarray, "h w"] | None = None
    premultiplied: bool = False
    not_srgb: str = ""
    orientation: int = 1

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.values.shape[0], self.values.shape[1]

    def light(self, luminance: Luminance) -> Float[np.ndarray, "h w"]:
        """Relative light of each pixel, 1 at full scale: light times opacity, so that transparent pixels are dark."""
        return self._by_bands(self._stored if luminance == "as_stored" else partial(self._linear, srgb_decoded))

    def linear(self, gamma: float) -> Float[np.ndarray, "h w"]:
        """Light as of :meth:`light`, for a camera whose values to the power of ``gamma`` are linear."""
        return self._by_bands(partial(self._linear, lambda values: values**gamma))

    def _by_bands(self, light: Callable[[slice], Float[np.ndarray, "b w"]]) -> Float[np.ndarray, "h w"]:
        rows = np.empty(self.shape)
        band = max(1, _BAND_VALUES // (self.values.shape[1] * self.values.shape[2]))
        for first in range(0, len(rows), band):
            rows[first : first + band] = light(slice(first, first + band))
        return rows

    def _stored(self, rows: slice) -> Float[np.ndarray, "b w"]:
        stored = self.values[rows].astype(np.float64)
        luma = stored @ _REC601 / 65536.0 if stored.shape[2] == 3 else stored[:, :, 0]
        light = luma / self.full_scale
        return light if self.opacity is None or self.premultiplied else light * self._opaque(rows)

    def _linear(
        self, decoded: Callable[[Float[np.ndarray, "b w c"]], Float[np.ndarray, "b w c"]], rows: slice
    ) -> Float[np.ndarray, "b w"]:
        values = self.values[rows] / self.full_scale
        opaque = None if self.opacity is None else self._opaque(rows)
        if opaque is not None and self.premultiplied:
            shown = opaque[:, :, None] > 0.0
            values = np.minimum(np.divide(values, opaque[:, :, None], out=np.zeros_like(values), where=shown), 1.0)
        linear = decoded(values)
        light = linear @ REC709 if linear.shape[2] == 3 else linear[:, :, 0]
        return light if opaque is None else light * opaque

    def _opaque(self, rows: slice) -> Float[np.ndarray, "b w"]:
        assert self.opacity is not None
        return self.opacity[rows] / float(np.iinfo(self.opacity.dtype).max)


def srgb_decoded(encoded: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Linear light of sRGB values, 0 to 1 (IEC 61966-2-1)."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def picture_of(
    values: Shaped[np.ndarray, "h w c"],
    opacity: UInt[np.ndarray, "h w"] | None,
    *,
    not_srgb: str,
    orientation: int,
    full_scale: float | None = None,
) -> Picture:
    """A picture of ``values``; ``full_scale``: None for the largest number of their type."""
    if opacity is not None and (opacity == np.iinfo(opacity.dtype).max).all():
        opacity = None
    if full_scale is None:
        full_scale = float(np.iinfo(values.dtype).max)
    known = orientation if 1 <= orientation <= 8 else 1
    return Picture(values, full_scale, opacity, not_srgb=not_srgb, orientation=known)


class Refused(ValueError):
    """Error for an intact picture that is refused, with a message of this program."""


@contextmanager
def damage(kind: str) -> Iterator[None]:
    """Turn any error of a decoder on a damaged file into a :class:`ValueError` of one line."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # on tags and chunks that hold no pixels
            yield
    except Refused:
        raise
    except Exception as error:
        lines = str(error).splitlines()
        raise ValueError(f"not readable as {kind}: {lines[0] if lines else type(error).__name__}") from None


def require_small(width: int, height: int, most: int = MOST_PIXELS) -> None:
    """Refuse a picture of more than ``most`` pixels, before any of them is decoded."""
    if width * height > most or max(width, height) > _LONGEST_SIDE:
        raise Refused(
            f"{width} x {height} pixels, must be at most {most / 1e6:.3g} million of them and {_LONGEST_SIDE} on a "
            "side; make it smaller, or save it as PNG"
        )


def wrong_colours(name: str) -> str:
    """Message that refuses the colours that a decoder calls ``name``."""
    return f"its colours are {_UNREAD.get(name, name)}, must be grey or RGB"


def not_srgb(profile: bytes) -> str:
    """Reason why a colour profile is not sRGB; "" if it is, or is empty.

    Little CMS converts colours of the profile to sRGB: with sRGB itself they are unchanged.
    """
    if not profile:
        return ""
    from PIL import Image, ImageCms

    try:
        stated = ImageCms.ImageCmsProfile(BytesIO(profile))
        grey = stated.profile.xcolor_space.strip() == "GRAY"
        colours = np.array(_GREYS if grey else _COLOURS, dtype=np.uint8)
        picture = Image.fromarray(colours[:, :, 0] if grey else colours)
        converted = ImageCms.profileToProfile(
            picture, stated, ImageCms.createProfile("sRGB"), ImageCms.Intent.RELATIVE_COLORIMETRIC, outputMode="RGB"
        )
    except (ImageCms.PyCMSError, OSError, ValueError, TypeError) as error:
        return f"its colour profile is damaged, or not one of grey or RGB ({str(error).splitlines()[0][:100]})"
    apart = np.abs(srgb_decoded(np.asarray(converted) / 255.0) - srgb_decoded(colours / 255.0))
    return "" if float(apart.max()) < _WITHIN_SRGB else "its colour profile is not the sRGB profile"
