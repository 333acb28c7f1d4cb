"""Pictures that are refused in one line: without one luminance, of other formats, too large, or damaged."""

import io
import os
import struct
import time
import zlib

import numpy as np
import pytest
from picture_files import bmp, chunk, numbers, png, tiff, with_tag
from PIL import Image

from lensforge.errors import InputError
from lensforge.optics.image_reading import read_picture


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
        chunk(*each) for each in ((b"IHDR", header), (b"IDAT", rows), (b"IEND", b""))
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
