"""IES and EULUMDAT: real files against what they say of themselves, symmetries of EULUMDAT, and the turn of C."""

import numpy as np
import pytest
from rayfile_samples import SHARED

from lensforge.sources.build_source import build_source
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric import PhotometricFile, read_photometric, write_photometric
from lensforge.sources.photometric.photometric_file import LampSet
from lensforge.spec.source_sections import DiscSource

FILES = SHARED / "photometry"
real = pytest.mark.skipif(not FILES.is_dir(), reason="../shared/rayfiles is not here")


@real
@pytest.mark.parametrize(("name", "error"), [("sample1", 2e-4), ("sample9", 1e-4), ("road_luminaire", 4e-3)])
def test_eulumdat_integrals_are_the_stated_light_output(name, error):
    """Three real files with symmetry 4, 4 and 3; the last has steps of 5 degrees near a narrow peak."""
    photometric = read_photometric(FILES / f"{name}.ldt")
    assert photometric.intensity.flux() == pytest.approx(photometric.stated_lumens, rel=error)
    assert TabulatedIntensity.of(photometric.intensity).symmetry == (
        "mirror_x" if name == "road_luminaire" else "rectangle"
    )


@real
def test_real_ies_files():
    absolute = read_photometric(FILES / "ABSOLUTE_LED.ies")
    assert (absolute.lamp_lumens, absolute.watts, TabulatedIntensity.of(absolute.intensity).symmetry) == (
        None,
        25.0,
        "square",
    )
    np.testing.assert_array_equal(absolute.intensity.values[5, :3], [3500.0, 3450.0, 3300.0])
    half = TabulatedIntensity.of(read_photometric(FILES / "LLIA001477-002.ies").intensity)
    assert half.symmetry == "mirror_y"
    assert (len(half.c_deg), half.values[0, 0], half.values[16, 0]) == (17, 27.55, 27.55)


def _ldt(symmetry):
    """Eight half-planes, intensities in cd/klm as the symmetry code asks for them; 2000 lm, decimal commas."""
    stored = {0: range(8), 1: [0], 2: range(5), 3: [6, 5, 4, 3, 2], 4: range(3)}[symmetry]
    head = ["maker", "2", str(symmetry), "8", "45,0", "2", "45", "", "a name", "", "", ""] + ["0"] * 9
    head += ["100", "100", "1", "0", "1", "1", "LED", "2000", "", "", "10"] + ["0"] * 10
    angles = [f"{45 * i}" for i in range(8)] + ["0", "45"]
    return "\r\n".join(head + angles + [f"{number},5" for plane in stored for number in (9, plane)])


@pytest.mark.parametrize(
    ("symmetry", "planes"),
    [(0, range(8)), (1, [0]), (2, [0, 1, 2, 3, 4, 3, 2, 1]), (3, [4, 3, 2, 3, 4, 5, 6, 5]), (4, [0, 1, 2, 1] * 2)],
)
def test_eulumdat_symmetries_fill_the_whole_turn(symmetry, planes, tmp_path):
    """Code 3 stores C 270 first and the plane C 90 - C 270 is its mirror, so C 0 holds what stands at C 180."""
    (tmp_path / "file").write_bytes(b"\xef\xbb\xbf" + _ldt(symmetry).encode())
    photometric = read_photometric(tmp_path / "file")
    np.testing.assert_allclose(photometric.intensity.values[:8, 1], [2.0 * (plane + 0.5) for plane in planes])
    assert (photometric.lamp_lumens, photometric.title, photometric.stated_lumens) == (2000.0, "a name", 2000.0)


def test_c_90_of_a_file_is_minus_y_of_a_lens_that_shines_up(tmp_path):
    """Radiance's frame: a luminaire along -z, C = 0 at +x, C = 90 at +y; turned over about x it shines along +z."""
    c_deg, gamma_deg = np.linspace(0.0, 360.0, 13), np.linspace(0.0, 90.0, 10)
    values = np.zeros((13, 10))
    values[3, 3:6], values[4, 3:6] = 100.0, 300.0  # C 90 and 120 degrees, linear to 0 at 60 and 150
    write_photometric(
        tmp_path / "chiral.ies", PhotometricFile(TabulatedIntensity(c_deg, gamma_deg, values), (LampSet(1000.0),))
    )
    profile = {"kind": "photometric", "file": tmp_path / "chiral.ies"}
    rays = build_source(DiscSource(diameter_mm=1e-6, intensity=profile)).sample(2**14, 0)
    down = rays.directions * [1.0, -1.0, -1.0]
    c = np.rad2deg(np.arctan2(down[:, 1], down[:, 0])) % 360.0
    assert 59.9 < c.min() < c.max() < 150.1
    assert c.mean() == pytest.approx(np.average([80.0, 107.5, 130.0], weights=[50.0, 200.0, 150.0]), abs=0.2)
