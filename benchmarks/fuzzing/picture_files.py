"""Pictures as a target, a photograph, and a source's luminance: PNG, TIFF, JPEG, BMP, and formats that are refused."""

import io
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from fuzzing.chance import Chance
from fuzzing.fields import Layout, changed_fields
from fuzzing.kind import Files, Kind
from fuzzing.noise import damaged
from fuzzing.png_files import changed_png, png_samples
from fuzzing.ray_files import require_finite
from fuzzing.tiff_files import changed_tiff, tiff_samples
from lensforge.errors import InputError
from lensforge.made.photograph import read_photograph
from lensforge.scene.pixel_grid import PixelGrid
from lensforge.scene.receiver import ReceiverPose
from lensforge.scene.receiver_shapes import Plane
from lensforge.scene.target_pattern import target_light
from lensforge.sources.planar_emitter import LuminanceImage
from lensforge.spec import ImageTarget

_FILE = "picture"
_BMP = Layout.of("2sIHHIIiiHHIIiiII", None, 24)
_MARKERS = (0xC0, 0xC2, 0xC4, 0xDB, 0xDA, 0xDD, 0xE0, 0xE1, 0xE2, 0xFE, 0xD9, 0xD0)
_SEGMENT = b"\xff\xe1"


@cache
def _encoded(format: str) -> list[bytes]:
    """Grey and colours of 8 x 8 pixels by Pillow; for JPEG also progressive."""
    from PIL import Image

    grey = np.add.outer(np.arange(8), np.arange(8)).astype(np.uint8) * 17
    pictures = [Image.fromarray(grey), Image.fromarray(np.dstack([grey, grey.T, 255 - grey]))]
    found = []
    for picture in pictures:
        for options in ({}, {"progressive": True}) if format == "JPEG" else ({},):
            stream = io.BytesIO()
            picture.save(stream, format, **options)
            found.append(stream.getvalue())
    return found


def _changed_jpeg(chance: Chance) -> bytes:
    """A JPEG file with segments changed, repeated, or added; its scans repeated thousands of times."""
    content = bytearray(chance.pick(_encoded("JPEG")))
    for _ in range(chance.few(3)):
        starts = [k for k in range(len(content) - 3) if content[k] == 0xFF and content[k + 1] in _MARKERS]
        if not starts:
            break
        at = chance.pick(starts)
        size = 2 + int.from_bytes(content[at + 2 : at + 4], "big")
        kind = chance.below(6)
        if kind == 0:
            content[at : at + size] = b""
        elif kind == 1:
            content[at:at] = bytes(content[at : at + size]) * chance.pick((1, 3, 500))
        elif kind == 2:
            content[at + 1] = chance.pick(_MARKERS)
        elif kind == 3:
            offset = at + 2 + chance.below(max(size - 2, 1))
            content[offset : offset + 2] = chance.bytes(2)
        elif kind == 4:
            text = b"Exif\0\0MM\0*" if chance.share(0.5) else b"ICC_PROFILE\0\x01\x01"
            content[2:2] = _SEGMENT + (len(text) + 402).to_bytes(2, "big") + text + chance.bytes(400)
        else:
            return damaged(chance, bytes(content), _encoded("JPEG"))
    return bytes(content)


def _changed_other(chance: Chance) -> bytes:
    """A file of a format that is not read, whole or damaged, or with the first bytes of one that is."""
    content = chance.pick(
        [sample for format in ("GIF", "WEBP", "TGA", "PCX", "PPM", "ICO") for sample in _encoded(format)]
    )
    head = chance.pick(
        (b"", b"\x89PNG\r\n\x1a\n", b"II*\0", b"MM\0*", b"\xff\xd8\xff", b"BM", b"II+\0", b"%!PS-Adobe", b"<svg")
    )
    return head + (damaged(chance, content) if chance.share(0.5) else content[len(head) :])


def _read(folder: Path) -> object:
    """Read the picture in all three ways; each may refuse it, and what is accepted is finite and not below 0."""
    path, refusals = folder / _FILE, []
    for use in (_as_target, _as_photograph, _as_luminance):
        try:
            found = use(path)
        except InputError as error:
            refusals.append(error)
        else:
            require_finite(found)
            if found.min() < 0.0:
                raise ValueError("accepted, with light below 0")
    if len(refusals) == 3:
        raise refusals[0]
    for error in refusals:
        if not str(error).isprintable():
            raise error
    return None


def _as_target(path: Path) -> np.ndarray:
    target = ImageTarget(file=path, width_mm=10.0, distance_mm=100.0, receiver_mm=1e4)
    plane = Plane(ReceiverPose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 100.0)), PixelGrid.square(1e4, 16))
    return target_light((target,), plane)


def _as_photograph(path: Path) -> np.ndarray:
    return read_photograph(path).light


def _as_luminance(path: Path) -> np.ndarray:
    return LuminanceImage.read(path, 2.0).values


def _kind(name: str, make: Callable[[Chance], bytes], samples: Callable[[], list[bytes]], share: float) -> Kind:
    def case(chance: Chance) -> Files:
        return {_FILE: make(chance)}

    return Kind(name, case, _read, lambda: [{_FILE: content} for content in samples()], share, foreign=True)


KINDS = [
    _kind("png", changed_png, png_samples, 3.0),
    _kind("tiff", changed_tiff, lambda: [tiff.content() for tiff in tiff_samples() if tiff.readable], 3.0),
    _kind("jpeg", _changed_jpeg, lambda: _encoded("JPEG"), 2.0),
    _kind("bmp", lambda chance: changed_fields(chance, _encoded("BMP"), _BMP), lambda: _encoded("BMP"), 1.0),
    _kind("no_picture", _changed_other, lambda: _encoded("PNG"), 0.5),
]
