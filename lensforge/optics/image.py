"""An image as it is stored, the relative light that its values stand for, and its embedded colour profile.

Values with a profile pass as sRGB where they agree to half a percent or so: International Color Consortium, ICC.1:2022,
sections 7, 10.6, 10.18.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from jaxtyping import Float, Real, UInt

Luminance = Literal["as_stored", "srgb"]
"""The light that a picture's values stand for.

``as_stored``: the values themselves, with no gamma taken off; of colours their luma, 0.299 R + 0.587 G + 0.114 B
(ITU-R BT.601). ``srgb``: the luminance that a screen would show: values decoded by the sRGB curve (IEC 61966-2-1), of
colours 0.2126 R + 0.7152 G + 0.0722 B (ITU-R BT.709).
"""

REC709 = np.array([0.2126, 0.7152, 0.0722])  # luminance of linear red, green, blue (ITU-R BT.709)
_REC601 = np.array([19595.0, 38470.0, 7471.0])  # of 65,536, to which they add up: the luma of a grey is exactly itself
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
        """Relative light of each pixel, 1 at full scale; what is transparent is dark: light times opacity."""
        return self._by_bands(self._stored if luminance == "as_stored" else partial(self._linear, srgb_decoded))

    def linear(self, gamma: float) -> Float[np.ndarray, "h w"]:
        """Light as of :meth:`light`, for a camera whose values to the power of ``gamma`` are linear."""
        return self._by_bands(partial(self._linear, lambda values: values**gamma))

    def _by_bands(self, light: Callable[[slice], Float[np.ndarray, "b w"]]) -> Float[np.ndarray, "h w"]:
        found = np.empty(self.shape)
        band = max(1, _BAND_VALUES // (self.values.shape[1] * self.values.shape[2]))
        for first in range(0, len(found), band):
            found[first : first + band] = light(slice(first, first + band))
        return found

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


_HEADER = 128
_MOST_TAGS = 1000  # profiles have 10 to 30
_SRGB_Y = {b"rXYZ": 0.2225, b"gXYZ": 0.7169, b"bXYZ": 0.0606}  # luminance of the primaries, adapted to D50
_CURVES = (b"rTRC", b"gTRC", b"bTRC")
_WITHIN = 0.01  # of full light; "gamma 2.2" is within 0.008 of sRGB, Display P3's green is 0.025 away
_SAMPLES = np.array([0.1, 0.25, 0.5, 0.75, 0.9])


def not_srgb(profile: bytes) -> str:
    """Say why a colour profile is not that of sRGB, "" where it is; grey profiles need its curve alone.

    Raises :class:`ValueError` for a damaged profile.
    """
    try:
        tags = _tags(profile)
        if profile[16:20] == b"GRAY":
            return "" if _like_srgb(tags[b"kTRC"]) else "its grey profile has another curve"
        if profile[16:20] != b"RGB " or not all(name in tags for name in (*_SRGB_Y, *_CURVES)):
            return "its colour profile is not one of red, green and blue by curves"
        luminances = {name: struct.unpack_from(">i", tags[name], 12)[0] / 65536.0 for name in _SRGB_Y}
        if any(abs(luminances[name] - wanted) > _WITHIN for name, wanted in _SRGB_Y.items()):
            return "its colour profile has other primaries"
        return "" if all(_like_srgb(tags[name]) for name in _CURVES) else "its colour profile has other curves"
    except (struct.error, KeyError, IndexError, OverflowError):
        raise ValueError("its colour profile is damaged") from None


def _tags(profile: bytes) -> dict[bytes, bytes]:
    (count,) = struct.unpack_from(">I", profile, _HEADER)
    if count > _MOST_TAGS:
        raise ValueError("its colour profile is damaged")
    entries = (struct.unpack_from(">4sII", profile, _HEADER + 4 + 12 * i) for i in range(count))
    return {name: profile[start : start + size] for name, start, size in entries}


def _like_srgb(curve: bytes) -> bool:
    with np.errstate(all="ignore"):  # a curve of wild numbers is not like sRGB, and NaN is not within anything
        return bool((np.abs(_decoded(curve) - srgb_decoded(_SAMPLES)) < _WITHIN).all())


def _decoded(curve: bytes) -> Float[np.ndarray, " n"]:
    """Linear light of the samples by a tone curve: an exponent, a table, or a parametric curve."""
    if curve[:4] == b"curv":
        (count,) = struct.unpack_from(">I", curve, 8)
        if count == 0:
            return _SAMPLES
        if 12 + 2 * count > len(curve):
            raise ValueError("its colour profile is damaged")
        table = np.frombuffer(curve, ">u2", count, 12)
        if count == 1:
            return _SAMPLES ** (int(table[0]) / 256.0)
        light: Float[np.ndarray, " n"] = np.interp(_SAMPLES, np.linspace(0.0, 1.0, count), table / 65535.0)
        return light
    (kind,) = struct.unpack_from(">H", curve, 8)
    sizes = (1, 3, 4, 5, 7)
    if curve[:4] != b"para" or kind >= len(sizes):
        return np.full_like(_SAMPLES, np.nan)
    p = [number / 65536.0 for number in struct.unpack_from(f">{sizes[kind]}i", curve, 12)]
    return _parametric(kind, p)


def _parametric(kind: int, p: list[float]) -> Float[np.ndarray, " n"]:
    """ICC.1 table 68: g, then a and b of the power, c and d of the line, e and f added."""
    g, a, b, c, d, e, f = (*p, *(0.0,) * (7 - len(p)))
    x = _SAMPLES
    if kind == 0:
        return x**g
    power = np.maximum(a * x + b, 0.0) ** g
    if kind in (1, 2):
        added = c if kind == 2 else 0.0
        return np.where(x >= -b / a, power + added, added) if a else np.full_like(x, np.nan)
    return np.where(x >= d, power + e, c * x + f)
