"""Pictures that are refused in one line: without one luminance, of other formats, too large, or damaged."""

import io
import os
import struct
import time
import zlib
from contextlib import suppress

import numpy as np
import pytest
from handmade_pictures import chunk, numbers, png, tiff
from PIL import Image

from lensforge.errors import InputError
from lensforge.optics.image_decoding import as_errors


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
    separate = tiff(numbers("uint16", 3), extra_tags=[(284, 3, [2])])
    assert "separate planes" in refused(separate)


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


def test_large_pictures_are_refused_before_they_are_decoded(refused):
    started = time.process_time()
    header = struct.pack(">IIBBBBB", 2**14, 2**14, 8, 0, 0, 0, 0)
    rows = zlib.compress(bytes(2**20))
    bomb = b"\x89PNG\r\n\x1a\n" + b"".join(
        chunk(*each) for each in ((b"IHDR", header), (b"IDAT", rows), (b"IEND", b""))
    )
    assert "67.1 million" in refused(bomb)
    wide = tiff(numbers("uint8", 1), extra_tags=[(256, 4, [2**20])])
    assert "pixels, must be at most" in refused(wide)
    assert time.process_time() - started < 2.0


def test_tags_that_would_fill_the_memory_are_refused(refused):
    file = bytearray(tiff(numbers("uint8", 1, (64, 64)), extra_tags=[(60000 + i, 1, [0] * 5) for i in range(9)]))
    (first,) = struct.unpack_from("<I", file, 4)
    for entry in range(first + 2, len(file) - 12, 12):
        if struct.unpack_from("<HH", file, entry)[0] >= 60000:
            struct.pack_into("<II", file, entry + 4, 4000, 8)  # all of them name the same bytes
    assert "larger than the file" in refused(bytes(file))
    strips = tiff(np.zeros((2**18, 1, 1), dtype=np.uint8), rows_per_strip=1)
    assert "strips or tiles, at most" in refused(strips)


def test_scans_without_end_are_refused(refused):
    file = io.BytesIO()
    Image.fromarray(np.zeros((2000, 2000), dtype=np.uint8)).save(file, "JPEG", progressive=True)
    content = file.getvalue()
    last = content.rindex(b"\xff\xda")
    assert "million" in refused(content[:last] + content[last:-2] * 200 + content[-2:])


def test_damage_is_refused(refused, light):
    grey = numbers("uint8", 1, (40, 40))
    whole = png(grey)
    for place in range(40, len(whole) - 12, 97):  # inside the pixels, where no decoder looks at the checksum
        assert "damaged" in refused(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])


def test_libtiff_does_not_write_to_the_terminal_and_its_complaints_are_damage(light, capfd):
    file = io.BytesIO()
    Image.fromarray(numbers("uint8", 1, (64, 64))[..., 0] > 127).save(file, "TIFF", compression="group4")
    whole, lines = file.getvalue(), []
    for place in range(8, 200, 7):
        with suppress(InputError):
            light(whole[:place] + bytes([whole[place] ^ 255]) + whole[place + 1 :])
            continue
        with pytest.raises(InputError) as caught:
            light(whole[:place] + bytes([whole[place] ^ 255]) + whole[place + 1 :])
        lines.append(str(caught.value))
    assert any("damaged: Fax4Decode" in line for line in lines)
    assert capfd.readouterr() == ("", "")


def test_what_others_write_while_a_picture_is_read_arrives(capfd):
    with pytest.raises(ValueError, match="damaged: ZIPDecode: bad"), as_errors():
        os.write(2, b"step 3 of 9\nZIPDecode: bad\n")
    assert capfd.readouterr().err.strip() == "step 3 of 9"
