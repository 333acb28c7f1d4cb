"""From spectra to wavelengths of rays: which rays get a wavelength, which wavelength, and when none is needed."""

from dataclasses import replace

import numpy as np
import pytest
from rayfile_samples import image, rays, with_spectrum_numbers, with_tables
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.optics.material import MATERIALS
from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.rayfiles.ray_file_io import decode, write_rayfile
from lensforge.sources.source_spectrum import Spectrum

PMMA = MATERIALS["PMMA"]
LINE = {"kind": "line", "wavelength_nm": 450.0}
TABLE = {"kind": "table", "wavelength_nm": [440.0, 450.0, 480.0], "weight": [0.0, 2.0, 1.0]}


def sample(source, material="PMMA", count=1000, **lens):
    """Rays of ``source`` as a scene would have them."""
    spec = small_spec(source=source, **({"lens__material": material} if material else {}), **lens)
    return build_source(spec.source, spec.lens.dispersion).sample(count, 3)


def saved(folder, rayfile, name="led.tm25ray"):
    write_rayfile(folder / name, rayfile, "tm25")
    return {"kind": "rayfile", "file": str(folder / name)}


def test_a_scene_without_wavelengths_or_without_dispersion_has_rays_without_them(tmp_path):
    square = {"kind": "square", "side_mm": 1.0}
    spectral = saved(tmp_path, rays(50, wavelengths="each"))
    grey = saved(tmp_path, rays(50), "grey.tm25ray")
    for source, material in ((square, "PMMA"), (square | {"spectrum": TABLE}, None), (spectral, None), (grey, "PMMA")):
        assert sample(source, material).wavelengths_nm is None


def test_rays_of_a_file_have_their_own_wavelength(tmp_path):
    measured = rays(200, wavelengths="each")
    source = saved(tmp_path, replace(measured, wavelengths_nm=measured.wavelengths_nm * 0.8 + 100.0))
    spec = small_spec(source=source, lens__material="PMMA")
    everything = build_source(spec.source, spec.lens.dispersion)
    expected = (measured.wavelengths_nm * 0.8 + 100.0).astype(np.float32).astype(np.float64)
    np.testing.assert_array_equal(everything.sample(200, 0).wavelengths_nm, expected)
    by_place = dict(zip(map(tuple, everything.rays.origins), everything.rays.wavelengths_nm, strict=True))
    for part in (
        everything.sample(70, 1),
        everything.sample(333, 1),
        *(half.rays for half in everything.split(0.5, 1)),
    ):
        assert [by_place[tuple(origin)] for origin in part.origins] == part.wavelengths_nm.tolist()


def test_a_common_table_of_the_header_is_drawn_from_and_belongs_to_the_rays(tmp_path):
    spec = small_spec(source=saved(tmp_path, with_tables(rays(4000))), lens__material="PMMA")
    emitter = build_source(spec.source, spec.lens.dispersion)
    waves = np.sort(emitter.sample(4000, 1).wavelengths_nm)
    table = Spectrum(np.array([430.0, 450.0, 470.0]), np.array([0.25, 1.0, 0.5]))
    np.testing.assert_allclose(waves, np.sort(table.at((np.arange(4000) + 0.5) / 4000)), atol=0.1)
    np.testing.assert_array_equal(emitter.sample(4000, 1).wavelengths_nm, emitter.sample(4000, 2).wavelengths_nm)
    summary = summarise(emitter, spec.source)
    assert 430.0 < summary.wavelengths_nm[0] < summary.wavelengths_nm[1] < 470.0


def test_rays_that_name_their_table_are_drawn_from_it(tmp_path):
    (tmp_path / "led.ray").write_bytes(with_spectrum_numbers([1, 2, 2, 1, 2]))
    waves = sample({"kind": "rayfile", "file": str(tmp_path / "led.ray")}, count=5).wavelengths_nm
    np.testing.assert_allclose(waves, [450.0, 600.0, 600.0, 450.0, 600.0], atol=5.0)
    assert decode(image(with_spectrum_numbers([1, 2, 2]))).warnings == ()
    for wrong in (3, 0, -1):
        (tmp_path / "led.ray").write_bytes(with_spectrum_numbers([1, wrong, 2]))
        with pytest.raises(InputError, match=f"spectrum number {wrong} of a ray: 1 to 2"):
            sample({"kind": "rayfile", "file": str(tmp_path / "led.ray")})


def test_several_tables_that_nobody_claims_are_refused(tmp_path):
    table = {"wavelength_nm": [440.0, 450.0], "weight": [1.0, 1.0]}
    source = saved(tmp_path, replace(rays(20), header={"spectral_tables": [table, table]}))
    with pytest.raises(InputError, match=r"2 spectral tables.*give source\.spectrum"):
        sample(source)
    assert sample(source | {"spectrum": LINE}).wavelengths_nm is not None


def test_blue_and_yellow_files_each_keep_their_own_light(tmp_path):
    blue, yellow = (saved(tmp_path, rays(40, seed=seed), f"{seed}.tm25ray")["file"] for seed in (1, 2))
    source = {"kind": "rayfiles", "files": [{"file": blue, "spectrum": LINE}, {"file": yellow}]}
    with pytest.raises(InputError, match=r"2\.tm25ray: no wavelengths, as the other files have"):
        sample(source)
    source["files"][1]["spectrum"] = LINE | {"wavelength_nm": 570.0}
    assert sample(source, count=80).wavelengths_nm.tolist() == [450.0] * 40 + [570.0] * 40
    assert sample(source, None).wavelengths_nm is None


def test_colours_tell_nothing_of_place_and_direction():
    bundle = sample({"kind": "rectangle", "width_mm": 2.0, "height_mm": 1.0, "spectrum": TABLE}, count=2**14)
    waves = bundle.wavelengths_nm - bundle.wavelengths_nm.mean()
    others = np.column_stack([bundle.origins[:, :2], bundle.directions, bundle.directions[:, :2] ** 2])
    others = (others - others.mean(axis=0)) / others.std(axis=0)
    assert np.abs(waves @ others / len(waves) / waves.std()).max() < 5.0 / np.sqrt(len(waves))
