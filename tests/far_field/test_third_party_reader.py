"""IES and EULUMDAT files of a lens, read by another program: LuxPy, where it is installed (it is no dependency)."""

from pathlib import Path

import numpy as np
import pytest
from scenes import random_surface, small_spec

import lensforge as lf

iolidfiles = pytest.importorskip("luxpy.toolboxes.iolidfiles.io_lid_files", exc_type=ImportError)


@pytest.fixture(scope="module")
def found() -> lf.Photometry:
    """A lens without symmetry, so that mirrored or turned half-planes would show."""
    spec = small_spec(target={"kind": "beam", "fwhm_deg": 40.0, "half_angle_deg": 60.0}, source__flux_lm=250.0)
    lens = lf.Lens(random_surface(1, 3.0), random_surface(2, 6.0), spec, 0, "draft")
    return lf.photometry(lens, rays=2**16)


@pytest.mark.parametrize("suffix", ["ies", "ldt"])
def test_another_reader_has_the_same_candela_in_the_same_directions(
    found: lf.Photometry, suffix: str, tmp_path: Path
) -> None:
    file = tmp_path / f"lens.{suffix}"
    file.write_bytes(getattr(found, suffix))
    read = iolidfiles.read_lamp_data(str(file), normalize=None)
    candela = np.asarray(read["candela_2d"]) * read["candela_mult"]
    if suffix == "ldt":
        candela = candela * found.source_lm / 1000.0
    turns = len(read["h_angs"])  # EULUMDAT leaves out C = 360
    assert np.array_equal(np.asarray(read["h_angs"]), found.c_deg[:turns]) and turns >= len(found.c_deg) - 1
    assert np.array_equal(np.asarray(read["v_angs"]), found.gamma_deg)
    assert np.abs(candela - found.candela[:turns]).max() < 1e-3 * found.candela.max()
    assert np.ptp(found.candela, axis=0).max() > 0.05 * found.candela.max(), "half-planes differ"
