"""Pictures of every layout against the numbers written into them; and those that are refused in one line."""

import io
import os
import struct
import time
import zlib

import numpy as np
import pytest
from picture_files import RNG, bmp, chunk, exif, numbers, png, tiff, with_tag
from PIL import Image, ImageCms, ImageOps

from lensforge.errors import InputError
from lensforge.optics.image_reading import read_picture

LUMA = np.array([0.299, 0.587, 0.114])
REC709 = np.array([0.2126, 0.7152, 0.0722])


def srgb(v):
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("depth", [1, 2, 4, 8, 16])
def test_grey_png(light, depth):
    values = RNG.integers(0, 2**depth, (11, 19))
    np.testing.assert_array_equal(light(png(values, "grey", depth)), _full(values, depth))


def _full(values, depth):
    """As Pillow scales fewer bits than eight: to 255."""
    return values * (255 // (2**depth - 1)) / 255 if depth < 8 else values / (2**depth - 1)


@pytest.mark.parametrize("kind", ["uint8", "uint16"])
def test_colours_of_png(light, kind):
    full = np.iinfo(kind).max
    depth = 8 * np.dtype(kind).itemsize
    colours = numbers(kind, 3)
    clear = numbers(kind, 1)
    stored = colours / full
    file = png(colours, "rgb", depth)
    np.testing.assert_allclose(light(file), stored @ LUMA, rtol=0, atol=1e-5)  # its weights are n/65536
    np.testing.assert_allclose(light(file, "srgb"), srgb(stored) @ REC709, rtol=1e-12)
    covered = png(np.concatenate([colours, clear], axis=2), "rgb_alpha", depth)
    np.testing.assert_allclose(light(covered), stored @ LUMA * clear[..., 0] / full, rtol=0, atol=1e-5)
    np.testing.assert_allclose(light(covered, "srgb"), srgb(stored) @ REC709 * clear[..., 0] / full, rtol=1e-12)


@pytest.mark.parametrize("kind", ["uint8", "uint16"])
def test_transparent_grey_is_dark(light, kind):
    both = numbers(kind, 2)
    full = np.iinfo(kind).max
    depth = 8 * np.dtype(kind).itemsize
    expected = both[..., 0] / full * (both[..., 1] / full)
    np.testing.assert_allclose(light(png(both, "grey_alpha", depth)), expected, rtol=1e-14)
    np.testing.assert_allclose(light(tiff(both, extrasamples=[2])), expected, rtol=1e-14) if depth == 8 else None


@pytest.mark.parametrize("depth", [8, 16])
def test_the_one_transparent_colour_is_dark(light, depth):
    colours = np.full((4, 5, 3), 2**depth - 1)
    colours[1, 2] = (2**depth - 1, 2**depth - 1, 2**depth - 2)  # one of the lowest bit from white
    colours[0, 0] = (1, 2, 3)
    key = b"".join(int(v).to_bytes(2, "big") for v in colours[1, 2])
    picture = light(png(colours, "rgb", depth, extra=[(b"tRNS", key)]))
    assert picture[1, 2] == 0.0 and picture[0, 0] > 0.0 and (picture.ravel()[1:7] == 1.0).all()


def test_palette_with_transparency(light):
    indices = RNG.integers(0, 4, (8, 8))
    palette = np.array([[255, 0, 0], [0, 255, 0], [255, 255, 255], [80, 80, 80]])
    opacity = np.array([255, 128, 0, 255])  # the last is not written
    extra = [(b"PLTE", bytes(palette.ravel().tolist())), (b"tRNS", bytes(opacity[:3].tolist()))]
    for depth in (2, 4, 8):
        picture = light(png(indices, "palette", depth, extra=extra))
        np.testing.assert_allclose(picture, (palette / 255 @ LUMA * opacity / 255)[indices], atol=1e-5)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(
    "options", [{}, {"compression": "zlib"}, {"compression": "zlib", "predictor": True}, {"rowsperstrip": 4}]
)
@pytest.mark.parametrize("kind", ["uint8", "uint16", "float32"])
@pytest.mark.parametrize("channels", [1, 3])
def test_tiff(light, order, options, kind, channels):
    values = numbers(kind, channels)
    file = tiff(values, order, **options)
    stored = values / (np.iinfo(kind).max if kind != "float32" else 1.0)
    expected = stored @ LUMA if channels == 3 else stored[..., 0]
    np.testing.assert_allclose(light(file), expected, rtol=0, atol=1e-5 if channels == 3 else 0.0)


@pytest.mark.parametrize("kind", ["uint8", "uint16"])
def test_white_is_zero(light, kind):
    values = numbers(kind, 1)
    full = np.iinfo(kind).max
    np.testing.assert_array_equal(light(tiff(values, photometric="miniswhite")), (full - values[..., 0]) / full)


@pytest.mark.parametrize("kind", ["uint8", "uint16"])
@pytest.mark.parametrize("order", ["<", ">"])
def test_opacity_of_tiff_once_multiplied_and_once_not(light, kind, order):
    full = np.iinfo(kind).max
    straight = numbers(kind, 4)
    straight[0, 0, 3] = 0
    opaque = straight[..., 3] / full
    multiplied = straight.copy()
    multiplied[..., :3] = np.floor(straight[..., :3] * opaque[..., None])
    for file, stored in (
        (tiff(straight, order, extrasamples=[2]), straight[..., :3] / full * opaque[..., None]),
        (tiff(multiplied, order, extrasamples=[1]), multiplied[..., :3] / full),
    ):
        np.testing.assert_allclose(light(file), stored @ LUMA, atol=1e-5)
        plain = np.divide(stored, opaque[..., None], out=np.zeros_like(stored), where=opaque[..., None] > 0)
        np.testing.assert_allclose(light(file, "srgb"), srgb(plain.clip(0, 1)) @ REC709 * opaque, atol=1e-9)


def test_bmp(light):
    grey = numbers("uint8", 1)[..., 0]
    np.testing.assert_array_equal(light(bmp(grey)), grey / 255)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_pictures_stand_upright(light, orientation):
    grey = numbers("uint8", 1, (16, 24))
    upright = Image.fromarray(grey[..., 0])
    upright.getexif()[274] = orientation
    expected = np.asarray(ImageOps.exif_transpose(upright)) / 255
    np.testing.assert_array_equal(light(png(grey, extra=[(b"eXIf", exif(orientation, ">"))])), expected)
    for order in "<>":
        np.testing.assert_array_equal(light(tiff(grey, order, orientation)), expected)
    jpeg = io.BytesIO()
    Image.fromarray(grey[..., 0]).save(jpeg, "JPEG", quality=100, exif=b"Exif\0\0" + exif(orientation))
    np.testing.assert_allclose(light(jpeg.getvalue()), expected, atol=4 / 255)


def _with_profile(grey, profile):
    file = io.BytesIO()
    Image.fromarray(grey).save(file, "PNG", icc_profile=profile)
    return file.getvalue()


def test_profiles_count_where_values_are_decoded(light, refused):
    colours = numbers("uint8", 3)
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    np.testing.assert_allclose(light(_with_profile(colours, profile), "srgb"), srgb(colours / 255) @ REC709, rtol=1e-12)
    place = profile.index(b"rXYZ")
    start = int.from_bytes(profile[place + 4 : place + 8], "big")
    other = (
        profile[: start + 12]
        + (int.from_bytes(profile[start + 12 : start + 16], "big") + 2000).to_bytes(4, "big")
        + profile[start + 16 :]
    )
    assert "not the sRGB profile" in refused(_with_profile(colours, other), "srgb")
    np.testing.assert_allclose(light(_with_profile(colours, other)), colours / 255 @ LUMA, atol=1e-5)
    lab = ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes()
    assert "colour profile" in refused(_with_profile(colours, lab), "srgb")
    assert "damaged" in refused(_with_profile(colours, profile[:150]), "srgb")


def test_stated_gamma(light, refused):
    grey = numbers("uint8", 1)
    for gamma, chunks in ((45455, []), (100000, [(b"sRGB", b"\0")])):
        file = png(grey, extra=[(b"gAMA", gamma.to_bytes(4, "big")), *chunks])
        np.testing.assert_allclose(light(file, "srgb"), srgb(grey[..., 0] / 255), rtol=1e-12)
    linear = png(grey, extra=[(b"gAMA", (100000).to_bytes(4, "big"))])
    assert "gAMA" in refused(linear, "srgb")
    np.testing.assert_array_equal(light(linear), grey[..., 0] / 255)


def test_floating_point_values_are_not_decoded(refused):
    assert "linear" in refused(tiff(numbers("float32", 1)), "srgb")


def _saved(mode, kind, **options):
    file = io.BytesIO()
    Image.new(mode, (8, 8)).save(file, kind, **options)
    return file.getvalue()


def test_what_has_no_one_luminance_is_refused(refused):
    assert "CMYK" in refused(_saved("CMYK", "JPEG"))
    assert "CMYK" in refused(_saved("CMYK", "TIFF"))
    assert "L*a*b*" in refused(_saved("LAB", "TIFF"))
    assert "signed" in refused(tiff(numbers("int16", 1)))
    assert "below 0" in refused(tiff(-numbers("float32", 1)))
    assert "finite" in refused(tiff(np.full((4, 4, 1), np.inf, dtype=np.float32)))
    planes_of_which_two_are_missing = with_tag(tiff(numbers("uint16", 3)), 284, 2)
    assert "truncated" in refused(planes_of_which_two_are_missing)


def test_formats_that_are_not_listed_are_refused(refused):
    for kind in ("GIF", "WEBP", "PPM", "TGA", "ICO"):
        assert "must be PNG, TIFF, JPEG or BMP" in refused(_saved("L", kind))


def test_several_frames_are_refused(light, refused):
    frames = [Image.fromarray(numbers("uint8", 1)[..., 0]) for _ in range(2)]
    for kind in ("TIFF", "PNG"):
        file = io.BytesIO()
        frames[0].save(file, kind, save_all=True, append_images=frames[1:])
        assert "several" in refused(file.getvalue())
    for subfile in (0, 1):  # a second page, a smaller copy of the first
        grey = numbers("uint8", 1)
        pages = bytearray(tiff(grey))
        (first,) = struct.unpack_from("<I", pages, 4)
        (count,) = struct.unpack_from("<H", pages, first)
        struct.pack_into("<I", pages, first + 2 + 12 * count, len(pages))
        pages += struct.pack("<HHHIII", 1, 254, 4, 1, subfile, 0)
        if subfile:
            np.testing.assert_array_equal(light(bytes(pages)), grey[..., 0] / 255)
        else:
            assert "several" in refused(bytes(pages))


def test_missing_and_special_files(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path, message in (
        (tmp_path / "none.png", "no such file; give one"),
        (tmp_path / "pipe", "a pipe"),
        (tmp_path, "a folder"),
        ("/dev/zero", "a device"),
        ("a\0b.png", "null"),
    ):
        with pytest.raises(InputError, match=message):
            read_picture(path, missing="give one")


def test_large_pictures_are_refused_before_they_are_decoded(refused):
    started = time.process_time()
    header = struct.pack(">IIBBBBB", 2**14, 2**14, 8, 0, 0, 0, 0)
    rows = zlib.compress(bytes(2**20))
    bomb = b"\x89PNG\r\n\x1a\n" + b"".join(
        chunk(*fields) for fields in ((b"IHDR", header), (b"IDAT", rows), (b"IEND", b""))
    )
    assert "67.1 million" in refused(bomb)
    wide = with_tag(tiff(numbers("uint8", 1)), 256, 2**20)
    assert "pixels, must be at most" in refused(wide)
    assert time.process_time() - started < 2.0


def test_scans_without_end_are_refused(refused):
    file = io.BytesIO()
    Image.fromarray(np.zeros((2000, 2000), dtype=np.uint8)).save(file, "JPEG", progressive=True)
    content = file.getvalue()
    last = content.rindex(b"\xff\xda")
    assert "million" in refused(content[:last] + content[last:-2] * 200 + content[-2:])


def test_damage_is_refused(refused, light):
    grey = numbers("uint8", 1, (40, 40))
    whole = png(grey)
    for place in range(45, len(whole) - 12, 97):
        assert "not readable as PNG" in refused(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])


@pytest.mark.parametrize("kind", ["png", "tiff", "deflated", "bmp", "jpeg"])
def test_truncated_files_are_one_line(refused, kind):
    grey = numbers("uint8", 1, (40, 40))
    content = {
        "png": png(grey), "tiff": tiff(grey), "deflated": tiff(grey, compression="zlib"), "bmp": bmp(grey[..., 0]),
        "jpeg": _saved("L", "JPEG"),
    }[kind]  # fmt: skip
    for size in (0, 1, 2, 3, 8, 20, 33, len(content) // 2, len(content) - 20):
        refused(content[:size])
