"""Files of vendors and of other programs, with the truths that are known about them; skipped where they are not."""

import numpy as np
import pytest
from rayfile_samples import SHARED, encoded, image

from lensforge.errors import InputError
from lensforge.optics.colorimetry import luminous_efficacy
from lensforge.sources.ray_file_statistics import describe
from lensforge.sources.rayfiles.ray_file_io import decode, read_rayfile, write_rayfile

pytestmark = pytest.mark.skipif(not SHARED.is_dir(), reason="../shared/rayfiles is not here")
OSRAM = SHARED / "osram" / "rayfile_LERTDUW_S2WP_blue_100k_20161013_IES_TM25.TM25RAY"
FILES = [
    path
    for folder in ("osram", "pairs", "tiny")
    for path in sorted((SHARED / folder).glob("*"))
    if path.suffix != ".pdf" and "spectrum" not in path.name
]
FORMAT_OF = {
    "Cyl10k.1.tm25ray": "tm25", "Cyl10k.1.ray": "lighttools_text", "ThreeRays_PowerOnly.1.ray": "lighttools_binary",
    "ThreeRays_Wavelength.1.ray": "lighttools_binary", "ThreeRays_Wavelength.1.txt": "lighttools_text",
    "ThreeRays_Wavelength_ZMW_to_LT.ray": "lighttools_binary", "ThreeRays_Wavelength_ZMX.ray": "zemax_binary",
    "ZemaxText.txt": "zemax_text", "ZemaxWavelengthText.txt": "zemax_text", "test_08_dat.DAT": "zemax_binary",
    "test_08_dat_flux_type_1.dat": "zemax_binary", "test_08_dat_reference.ray": "speos", "test_08_ray.ray": "speos",
    "test_08_ray_reference.sdf": "zemax_binary", "test_08_sdf.sdf": "zemax_binary",
    "test_08_sdf_reference.ray": "speos", OSRAM.name: "tm25",
}  # fmt: skip


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_format_is_told_by_content_and_the_rewrite_is_byte_exact(path, tmp_path):
    rayfile = read_rayfile(path)
    assert rayfile.format == FORMAT_OF[path.name]
    write_rayfile(tmp_path / "again", rayfile, rayfile.format)
    assert (tmp_path / "again").read_bytes() == path.read_bytes()


@pytest.mark.parametrize("path", [path for path in FILES if path.name != OSRAM.name], ids=lambda path: path.name)
def test_encoded_anew_the_rays_are_the_same(path):
    """Not a copy of the bytes: decoded, encoded by our writer, decoded again."""
    rayfile = read_rayfile(path)
    back = decode(image(encoded(rayfile.format, rayfile)))
    np.testing.assert_allclose(back.positions_mm, rayfile.positions_mm, rtol=1e-7, atol=1e-30)
    np.testing.assert_array_equal(back.directions, rayfile.directions)
    np.testing.assert_allclose(back.flux / back.flux.sum(), rayfile.flux / rayfile.flux.sum(), rtol=1e-6)
    assert back.total_flux() == pytest.approx(rayfile.total_flux(), rel=1e-6)


def test_the_measured_led():
    rayfile = read_rayfile(OSRAM)
    summary = describe(rayfile)
    assert summary.rays == summary.rays_used == 100_000
    assert summary.flux.ray_sum == pytest.approx(1.68, rel=1e-6)
    assert summary.flux.header_w == pytest.approx(1.68, rel=1e-6)
    assert summary.flux.backward_share == pytest.approx(0.0008, abs=5e-5)
    np.testing.assert_allclose(summary.bounding_box_mm.min, [-2.93, -3.14, -1.15], atol=0.005)
    np.testing.assert_allclose(summary.bounding_box_mm.max, [2.93, 3.27, 0.02], atol=0.005)
    # Printed in the PDF beside it, from 10 million rays; these are 100,000 of them.
    np.testing.assert_allclose(summary.virtual_focus_mm, [0.646, 0.808, -0.389], atol=0.002)
    assert (rayfile.header["name"], rayfile.header["date"]) == ("LERTDUW_S2WP", "2016-10-13 13:24:12")
    assert summary.warnings == ()


def test_the_measured_led_has_the_lumens_of_its_own_spectrum():
    rayfile = read_rayfile(OSRAM)
    table = rayfile.header["spectral_tables"][0]
    stated = rayfile.header_flux_lm / rayfile.header_flux_w
    assert stated == pytest.approx(32.526, abs=0.001)
    efficacy = luminous_efficacy(np.array(table["wavelength_nm"]), np.array(table["weight"]))
    assert efficacy == pytest.approx(stated, rel=0.005)
    assert (table["wavelength_nm"][0], table["wavelength_nm"][-1]) == (390.0, 510.0)


def test_the_same_ten_thousand_rays_in_two_formats():
    tm25, text = (read_rayfile(SHARED / "pairs" / f"Cyl10k.1.{end}") for end in ("tm25ray", "ray"))
    np.testing.assert_allclose(tm25.positions_mm, text.positions_mm, atol=5e-6)
    np.testing.assert_allclose(tm25.directions, text.directions, atol=5e-6)
    np.testing.assert_allclose(tm25.flux, text.flux, rtol=5e-6)
    assert text.ray_sum() == pytest.approx(10_000.0)
    assert text.total_flux() == tm25.total_flux() == 1.0


def test_the_same_three_rays_in_three_formats():
    names = ("ThreeRays_Wavelength.1.ray", "ThreeRays_Wavelength.1.txt", "ThreeRays_Wavelength_ZMX.ray")
    binary, text, zemax = (read_rayfile(SHARED / "pairs" / name) for name in names)
    for other in (text, zemax):
        np.testing.assert_allclose(binary.positions_mm, other.positions_mm, rtol=1e-6)
        np.testing.assert_allclose(binary.directions, other.directions, rtol=1e-6)
        np.testing.assert_allclose(binary.wavelengths_nm, other.wavelengths_nm, rtol=1e-6)
        np.testing.assert_allclose(binary.flux, other.flux, rtol=5e-7)


def test_a_measured_file_cut_short_is_refused():
    content = OSRAM.read_bytes()
    for cut in (3, 100, 30_000, 36_288, 36_300, 1_000_000, len(content) - 1):
        with pytest.raises(InputError):
            decode(image(content[:cut]))
