"""Reading of a picture file of any origin: recognised by its first bytes, bounded, decoded, and turned upright."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Shaped, UInt

from lensforge.errors import InputError
from lensforge.files import MIB, read_file
from lensforge.pictures import tiff_tags
from lensforge.pictures.colour_profile import not_srgb
from lensforge.pictures.decoding import Pixels, decoded
from lensforge.pictures.picture import Luminance, Picture
from lensforge.pictures.png_chunks import SIGNATURE, PngChunks, png_chunks

MOST_BYTES = 512 * MIB  # the largest picture, three colours of 16 bits, has 384 MiB where nothing is compressed
_MOST_SCANS = 6 * 10**8  # times pixels: each scan of a progressive JPEG is a pass over all; 10 of 60 million are usual
_SCAN = b"\xff\xda"  # inside a scan, 0xff is followed by 0
_UNCOMPRESSED_BMP = (0, 3, 6)  # plain, and plain with masks
_SIGNED, _FLOATING, _WHITE_IS_ZERO, _SEPARATE, _ASSOCIATED = 2, 3, 0, 2, 1  # values of TIFF's tags


def read_light(path: Path | str, luminance: Luminance, *, missing: str) -> Float[np.ndarray, "h w"]:
    """Relative light that the picture ``path`` stands for, row 0 at the top, 1 at its full scale.

    Raises :class:`InputError` as :func:`read_picture` does, and where values to be decoded as sRGB are not.
    """
    picture = read_picture(path, missing=missing)
    if luminance == "srgb" and picture.not_srgb:
        raise InputError(f'{path}: {picture.not_srgb}; for luminance = "srgb" convert it to sRGB, or leave that out')
    return picture.light(luminance)


def read_picture(path: Path | str, *, missing: str, orientation: int | None = None) -> Picture:
    """Read a PNG, TIFF, JPEG or BMP file of 1 to 32 bits, grey, colours or a palette, upright by its EXIF orientation.

    ``orientation``: instead of the file's own. Of a JPEG file that holds several pictures the first is read. Raises
    :class:`InputError` for what is not such a file, for several frames or pages, for more than 67 million pixels, for
    damage, for colours other than grey and RGB, and for values below 0 or not finite; ``missing`` is the remedy where
    there is no file.
    """
    content = read_file(path, missing=missing, most_bytes=MOST_BYTES)
    read = next((each for begin, each in _READERS.items() if content.startswith(begin)), None)
    if read is None:
        raise InputError(f"{path}: not a readable image, must be PNG, TIFF, JPEG or BMP; convert it")
    try:
        picture = read(content)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    if picture.values.dtype.kind == "f" and not (np.isfinite(picture.values).all() and picture.values.min() >= 0.0):
        raise InputError(f"{path}: pixels must be finite, and none below 0")
    return _upright(picture if orientation is None else replace(picture, orientation=orientation))


def _png(content: bytes) -> Picture:
    chunks = png_chunks(content)
    pixels = decoded("PNG", chunks.pixels_only)
    samples = pixels.samples.astype(np.uint16) if chunks.depth == 16 else pixels.samples
    orientation = _orientation(chunks.exif) if chunks.exif else 1
    reason = chunks.not_srgb or _reason(chunks.profile)
    opacity = _png_opacity(chunks, pixels, samples) if b"tRNS" in chunks.others else pixels.opacity
    return _picture(samples, opacity, not_srgb=reason, orientation=orientation)


def _png_opacity(chunks: PngChunks, pixels: Pixels, samples: UInt[np.ndarray, "h w c"]) -> UInt[np.ndarray, "h w"]:
    """Opacity by the tRNS chunk: of each colour of the palette, or 0 for the one colour that it names."""
    stated = chunks.others[b"tRNS"]
    if pixels.indices is not None:
        table = np.full(256, 255, dtype=np.uint8)
        table[: len(stated)] = np.frombuffer(stated[:256], dtype=np.uint8)
        opacity: UInt[np.ndarray, "h w"] = table[pixels.indices]
        return opacity
    if pixels.opacity is not None or len(stated) != 2 * samples.shape[2]:
        raise ValueError("damaged: a transparency of another kind of picture")
    most = 2**chunks.depth - 1
    named = np.frombuffer(stated, dtype=">u2").astype(np.int64) & most
    clear = (samples == named * (int(np.iinfo(samples.dtype).max) // most)).all(axis=2)
    return np.where(clear, 0, 255).astype(np.uint8)


def _tiff(content: bytes) -> Picture:
    tags = tiff_tags.tiff_directory(content)
    bits, layout = tags.number(tiff_tags.BITS, 1), tags.number(tiff_tags.SAMPLE_FORMAT, 1)
    if layout == _SIGNED:
        raise ValueError("its values are signed numbers, must be unsigned or floating-point; convert it")
    if bits > 8 and tags.number(tiff_tags.PLANAR, 1) == _SEPARATE and tags.number(tiff_tags.SAMPLES, 1) > 1:
        raise ValueError("its colours of more than 8 bits are in separate planes; save them interleaved")
    pixels = decoded("TIFF", tiff_tags.upright(tags))
    samples = pixels.samples.view(np.uint32) if pixels.samples.dtype == np.int32 else pixels.samples
    full_scale = float(2**bits - 1) if bits > 8 and samples.dtype.kind == "u" else None
    if bits > 8 and tags.number(tiff_tags.PHOTOMETRIC, 1) == _WHITE_IS_ZERO:
        if full_scale is None:
            raise ValueError("its floating-point values say that white is 0; invert it")
        samples = samples.dtype.type(full_scale) - samples
    reason = _reason(lambda: pixels.profile)
    if full_scale is None and samples.dtype.kind == "f":
        reason = "floating-point values are linear by convention"
    associated = pixels.opacity is not None and tags.number(tiff_tags.EXTRA_SAMPLES, 0) == _ASSOCIATED
    found = _picture(samples, pixels.opacity, not_srgb=reason, orientation=tags.orientation)
    return replace(
        found, premultiplied=associated and found.opacity is not None, full_scale=full_scale or found.full_scale
    )


def _jpeg(content: bytes) -> Picture:
    pixels = decoded("JPEG", content, most_pixels=_MOST_SCANS // max(1, content.count(_SCAN)))
    orientation = _orientation(pixels.exif) if pixels.exif else 1
    return _picture(pixels.samples, None, not_srgb=_reason(lambda: pixels.profile), orientation=orientation)


def _bmp(content: bytes) -> Picture:
    if (
        int.from_bytes(content[14:18], "little") >= 40
        and int.from_bytes(content[30:34], "little") not in _UNCOMPRESSED_BMP
    ):
        raise ValueError("a compressed BMP file; save it as PNG")
    pixels = decoded("BMP", content)
    return _picture(pixels.samples, pixels.opacity)


_READERS: dict[bytes, Callable[[bytes], Picture]] = {
    SIGNATURE: _png,
    b"II*\0": _tiff,
    b"MM\0*": _tiff,
    b"\xff\xd8\xff": _jpeg,
    b"BM": _bmp,
}


def _picture(
    samples: Shaped[np.ndarray, "h w c"],
    opacity: UInt[np.ndarray, "h w"] | None,
    *,
    not_srgb: str = "",
    orientation: int = 1,
) -> Picture:
    if opacity is not None and (opacity == np.iinfo(opacity.dtype).max).all():
        opacity = None
    full_scale = 1.0 if samples.dtype.kind == "f" else float(np.iinfo(samples.dtype).max)
    return Picture(samples, full_scale, opacity, not_srgb=not_srgb, orientation=orientation)


def _orientation(exif: bytes) -> int:
    try:
        return tiff_tags.exif_orientation(exif)
    except ValueError:
        raise ValueError("its EXIF block is damaged, so that its orientation is not known; save it again") from None


def _reason(profile: Callable[[], bytes]) -> str:
    """Say why the values are not those of sRGB by the colour profile; it counts only where they are to be decoded."""
    try:
        found = profile()
        return not_srgb(found) if found else ""
    except ValueError as error:
        return str(error)


def _upright(picture: Picture) -> Picture:
    """The picture turned or mirrored as its orientation states (CIPA DC-008, tag 274)."""
    opacity = None if picture.opacity is None else _turned(picture.opacity, picture.orientation)
    return replace(picture, values=_turned(picture.values, picture.orientation), opacity=opacity)


def _turned(values: Shaped[np.ndarray, "h w *c"], orientation: int) -> Shaped[np.ndarray, "a b *c"]:
    if orientation >= 5:
        values = values.swapaxes(0, 1)
    flips_rows, flips_columns = orientation in (3, 4, 7, 8), orientation in (2, 3, 6, 7)
    return values[:: -1 if flips_rows else 1, :: -1 if flips_columns else 1]
