"""Every format in the folder: what it writes it reads, from any file name, in blocks, and refuses when damaged."""

from dataclasses import replace

import numpy as np
import pytest
from rayfile_samples import CASES, encoded, image, rays

from lensforge.errors import InputError
from lensforge.sources.ray_file_statistics import describe
from lensforge.sources.rayfiles import ray_file as rayfile_module
from lensforge.sources.rayfiles import ray_file_rows
from lensforge.sources.rayfiles.ray_file_io import FORMATS, decode, read_rayfile, write_rayfile
from lensforge.sources.rayfiles.ray_file_rows import HEAD_BYTES

NAMED_CASES = [(name, index) for name, cases in CASES.items() for index in range(len(cases))]
# LightTools' convention: its ray fluxes add up to the number of rays times the header's flux.
SCALED_BY_COUNT = ("lighttools_binary", "lighttools_text")
BINARY = ("tm25", "zemax_binary", "lighttools_binary", "speos")


def test_every_format_of_the_folder_has_a_case():
    assert set(CASES) == set(FORMATS)
    assert all(CASES.values())


@pytest.mark.parametrize(("name", "index"), NAMED_CASES)
def test_round_trip_keeps_rays_unit_wavelengths_and_total(name, index):
    original = CASES[name][index]
    back = decode(image(encoded(name, original)))
    factor = len(original) if name in SCALED_BY_COUNT else 1
    assert back.format == name
    assert back.flux_unit == original.flux_unit
    np.testing.assert_array_equal(back.positions_mm.astype(np.float32), original.positions_mm)
    np.testing.assert_array_equal(back.directions.astype(np.float32), original.directions)
    np.testing.assert_allclose(back.flux, original.flux * factor, rtol=2e-7)
    assert back.total_flux() == pytest.approx(original.total_flux(), rel=3e-7)
    if original.wavelengths_nm is None:
        assert back.wavelengths_nm is None
    else:
        np.testing.assert_allclose(back.wavelengths_nm, original.wavelengths_nm, rtol=2e-7)


@pytest.mark.parametrize(("name", "index"), NAMED_CASES)
def test_a_file_read_is_rewritten_byte_for_byte_whatever_its_name(name, index, tmp_path):
    content = encoded(name, CASES[name][index])
    (tmp_path / "misleading.ies").write_bytes(content)
    rayfile = read_rayfile(tmp_path / "misleading.ies")
    write_rayfile(tmp_path / "again", rayfile, name)
    assert (tmp_path / "again").read_bytes() == content


@pytest.mark.parametrize("name", BINARY)
def test_payloads_of_nan_survive_a_rewrite(name, tmp_path):
    """Signalling and quiet NaNs with bits of their own, in a ray: no copy of the numbers may touch them."""
    content = bytearray(encoded(name, CASES[name][0]))
    for offset, bits in ((40, 0x7F800001), (68, 0xFFC12345), (72, 0x7FA00000)):
        place = len(content) - 7 * (name == "lighttools_binary") - offset
        content[place : place + 4] = bits.to_bytes(4, "little")
    (tmp_path / "in").write_bytes(content)
    write_rayfile(tmp_path / "out", read_rayfile(tmp_path / "in"), name)
    assert (tmp_path / "out").read_bytes() == content


@pytest.mark.parametrize(("name", "index"), [case for case in NAMED_CASES if case[0] in BINARY])
def test_reading_what_was_written_and_encoding_it_anew_is_a_fixed_point(name, index):
    content = encoded(name, CASES[name][index])
    assert encoded(name, decode(image(content))) == content


@pytest.mark.parametrize(("name", "index"), NAMED_CASES)
def test_exactly_one_format_recognises_the_content(name, index):
    content = encoded(name, CASES[name][index])
    matching = [entry.name for entry in FORMATS.values() if entry.matches(content[:HEAD_BYTES], len(content))]
    assert matching == [name]


@pytest.mark.parametrize("name", ["tm25", "zemax_binary", "lighttools_binary", "lighttools_text"])
def test_cut_anywhere_it_is_refused_in_one_line(name):
    content = encoded(name, CASES[name][0])
    for cut in np.unique(np.linspace(1, len(content) - 2, 80).astype(int)):
        refused_in_one_line(content[:cut])


@pytest.mark.parametrize("name", ["zemax_text", "speos_text"])
def test_cut_text_with_a_count_is_refused_up_to_its_last_number_and_warned_of_there(name):
    content = encoded(name, CASES[name][0])
    last_number = content.rindex(b" ") + 1
    for cut in range(1, last_number, 7):
        refused_in_one_line(content[:cut])
    assert "last line" in decode(image(content[:-3])).warnings[-1]
    assert not any("last line" in warning for warning in decode(image(content)).warnings)


def test_cut_speos_and_csv_have_no_count_so_only_a_broken_row_shows():
    speos = encoded("speos", CASES["speos"][0])
    for cut in range(1, 32):
        refused_in_one_line(speos[:-cut])
    assert len(decode(image(speos[:-32]))) == len(CASES["speos"][0]) - 1
    csv = encoded("csv", CASES["csv"][0])
    refused_in_one_line(csv[: csv.rindex(b",")])
    assert decode(image(csv[:-1])).warnings == ()  # its end of line alone: no digit is lost
    shorter = csv[: csv.rindex(b",") + 3]
    assert "last line" in decode(image(shorter)).warnings[0]


def refused_in_one_line(content):
    with pytest.raises(InputError) as caught:
        describe(decode(image(content)))
    assert "\n" not in str(caught.value)


def test_the_suffix_chooses_a_format_for_writing_only_where_it_is_clear(tmp_path):
    assert write_rayfile(tmp_path / "a.tm25ray", rays()).name == "tm25"
    assert write_rayfile(tmp_path / "a.DAT", rays()).name == "zemax_binary"
    for suffix in (".ray", ".txt", ".xyz"):
        with pytest.raises(InputError, match="format"):
            write_rayfile(tmp_path / f"a{suffix}", rays())
    with pytest.raises(InputError, match="one of csv"):
        write_rayfile(tmp_path / "a.csv", rays(), "tm52")


def test_changed_rays_never_meet_the_old_bytes(tmp_path):
    write_rayfile(tmp_path / "in", rays(), "tm25")
    rayfile = read_rayfile(tmp_path / "in")
    moved = replace(rayfile, positions_mm=rayfile.positions_mm + np.float32(1.0))
    write_rayfile(tmp_path / "out", moved, "tm25")
    np.testing.assert_array_equal(read_rayfile(tmp_path / "out").positions_mm, rayfile.positions_mm + np.float32(1.0))


def test_an_unreadable_file_is_one_line_that_says_what_to_do(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_rayfile(tmp_path / "missing.ray")
    with pytest.raises(InputError, match="a folder, must be a file"):
        read_rayfile(tmp_path)
    (tmp_path / "empty.ray").touch()
    with pytest.raises(InputError, match="empty"):
        read_rayfile(tmp_path / "empty.ray")
    (tmp_path / "led.fcr").write_bytes(b"\x01\x02\x03\x04" * 20)
    with pytest.raises(InputError, match="not public: export TM-25"):
        read_rayfile(tmp_path / "led.fcr")
    (tmp_path / "led.xyz").write_bytes(b"\x01\x02\x03\x04" * 20)
    with pytest.raises(InputError, match="TM-25-13"):
        read_rayfile(tmp_path / "led.xyz")


@pytest.mark.parametrize("name", ["csv", "zemax_text", "lighttools_text", "speos_text"])
def test_text_is_read_alike_in_one_block_and_in_many(name, monkeypatch):
    content = encoded(name, rays(500, wavelengths="each"))
    whole = decode(image(content))
    monkeypatch.setattr(ray_file_rows, "_BLOCK", 1000)
    in_blocks = decode(image(content))
    for column in ("positions_mm", "directions", "flux", "wavelengths_nm"):
        np.testing.assert_array_equal(getattr(in_blocks, column), getattr(whole, column))
    lines = content.split(b"\n")
    lines[300] = lines[300].replace(b".", b"?")
    with pytest.raises(InputError, match=r"line 301, column \d: '-?0\?\d+'? is no number"):
        decode(image(b"\n".join(lines)))
    with pytest.raises(InputError, match="has more than 1000 bytes"):
        decode(image(content.replace(b"\n", b" " * 2000 + b"\n")))


@pytest.mark.parametrize("name", list(CASES))
def test_rays_are_written_alike_in_one_block_and_in_many(name, monkeypatch):
    original = replace(CASES[name][-1], header_flux_w=None, header_flux_lm=None)
    whole = encoded(name, original)
    monkeypatch.setattr(rayfile_module, "CHUNK_ROWS", 5)
    assert encoded(name, original) == whole


def test_pages_given_back_are_read_again_from_the_file(tmp_path, monkeypatch):
    monkeypatch.setattr(rayfile_module, "CHUNK_ROWS", 700)
    original = rays(5000)
    (tmp_path / "in.tm25ray").write_bytes(encoded("tm25", original))
    rayfile = read_rayfile(tmp_path / "in.tm25ray")
    for _ in range(2):
        blocks = list(rayfile.blocks())
        np.testing.assert_array_equal(np.concatenate([block.positions_mm for block in blocks]), original.positions_mm)
        assert [len(block) for block in blocks] == [700] * 7 + [100]
