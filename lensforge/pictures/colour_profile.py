"""Embedded colour profiles: whether values that carry one are those of sRGB, to half a percent or so.

International Color Consortium, ICC.1:2022, sections 7, 10.6, 10.18.
"""

import struct

import numpy as np
from jaxtyping import Float

from lensforge.pictures.picture import srgb_decoded

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
