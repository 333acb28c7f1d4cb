"""Files read and written block by block are those read and written at once."""

from dataclasses import replace

import numpy as np
import pytest
from rayfile_samples import CASES, encoded, image, rays

from lensforge.errors import InputError
from lensforge.sources.rayfiles import ray_file as rayfile_module
from lensforge.sources.rayfiles import ray_file_rows
from lensforge.sources.rayfiles.ray_file_io import decode, read_rayfile


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
    with pytest.raises(InputError, match=r"rows from line (2\d\d|30\d) on"):
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
