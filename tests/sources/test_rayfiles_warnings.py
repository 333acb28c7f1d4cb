"""Warnings on rays: a summary and a design give the same, the latter about the rays at their place in the lens."""

from dataclasses import replace

import numpy as np
import pytest
from rayfile_samples import encoded, rays, with_tables
from scenes import small_spec

from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.ray_file_statistics import FEWEST_EFFECTIVE_RAYS, RaySums, describe, ray_set_warnings
from lensforge.sources.rayfiles.ray_file_io import read_rayfile

COUNT = FEWEST_EFFECTIVE_RAYS + 2000


def led(count=COUNT, **changes):
    """An LED about which there is nothing to say: 1 mm wide, upwards, as many rays as are wanted."""
    plain = rays(count, wavelengths="none")
    directions = np.array(plain.directions)
    directions[:, 2] = np.abs(directions[:, 2])
    equal = np.ones(count, dtype=np.float32)
    return replace(plain, directions=directions, flux=equal, header_flux_w=float(count), **changes)


def doubtful():
    """Files of which each deserves exactly one warning, by a word of that warning."""
    plain, half = led(), np.ones(COUNT, dtype=np.float32)
    half[: COUNT // 2] = 1e-6
    down = np.array(plain.directions)
    down[:1000, 2] *= -1.0
    holes = np.array(plain.flux)
    holes[:1000] = np.nan
    microns = replace(rays(COUNT, wavelengths="each"), directions=plain.directions, flux=plain.flux)
    waves = np.array(microns.wavelengths_nm)
    patchy = waves.copy()
    patchy[:300] = np.nan
    tables = with_tables(plain).header
    return {
        "effective rays": replace(plain, flux=half, header_flux_w=float(half.sum(dtype=float))),
        "goes towards -z": replace(plain, directions=down),
        "rays dropped": replace(plain, flux=holes, header_flux_w=COUNT - 1000.0),
        "the header says": plain,  # its header is changed in the file: a writer's own header fits its rays
        "length unit": replace(plain, positions_mm=plain.positions_mm * np.float32(1000.0)),
        "at one point": replace(plain, positions_mm=np.zeros((COUNT, 3), dtype=np.float32)),
        "taken as µm": replace(plain, wavelengths_nm=waves / np.float32(1000.0)),
        "check their unit": replace(plain, wavelengths_nm=waves * np.float32(10.0)),
        "no usable wavelength": replace(plain, wavelengths_nm=patchy),
        "its spectrum": replace(plain, header=tables, header_flux_lm=plain.header_flux_w * 300.0),
        "683 lm/W at most": replace(plain, header_flux_lm=plain.header_flux_w * 800.0),
    }


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("doubtful")
    for number, (word, rayfile) in enumerate(doubtful().items()):
        content = bytearray(encoded("tm25", rayfile))
        if word == "the header says":
            content[16:20] = np.float32(3.0).tobytes()
        (folder / f"{number}.ray").write_bytes(content)
    (folder / "plain.ray").write_bytes(encoded("tm25", led()))
    return folder


@pytest.mark.parametrize(
    ("side_mm", "backward", "effective"), [(1.0, 0.0099, 25_001.0), (0.05, 0.0, 25_001.0), (100.0, 0.01, 1e6)]
)
def test_the_limits_are_those_of_the_guide(side_mm, backward, effective):
    def warned(side_mm, backward, effective):
        sums = RaySums(
            flux=1.0, flux_squared=1.0 / effective, backward=backward, low=np.zeros(3), high=np.full(3, side_mm)
        )
        return list(ray_set_warnings(sums, placed=False))

    assert not warned(side_mm, backward, effective)
    (few,) = warned(side_mm, backward, 24_998.0)
    (down,) = warned(side_mm, 0.0101, effective)
    (wide,) = warned(100.1, backward, effective)
    assert "effective" in few and "-z" in down and "unit" in wide


def test_an_ordinary_file_gives_no_warning(files):
    assert describe(read_rayfile(files / "plain.ray")).warnings == ()
    assert loaded(files / "plain.ray").warnings == ()


@pytest.mark.parametrize("number", range(len(doubtful())))
def test_every_warning_of_a_summary_is_one_of_the_source(number, files):
    word = list(doubtful())[number]
    path = files / f"{number}.ray"
    seen, used = describe(read_rayfile(path)).warnings, loaded(path)
    assert [word in warning for warning in seen] == [True]
    assert sum(word in warning for warning in used.warnings) == 1
    for warning in seen:
        assert any(warning.split(":")[0].split(", away")[0] in other for other in used.warnings)


def loaded(path, model="rays", **fields):
    """The summary of the source of a file: by its rays alone, as a model takes three seconds to fit."""
    spec = small_spec(source={"kind": "rayfile", "file": str(path), "model": model, **fields})
    return summarise(build_source(spec.source), spec.source)


def test_a_model_has_the_warnings_of_its_rays(files):
    path = files / f"{list(doubtful()).index('the header says')}.ray"
    fitted = loaded(path, model="radiance")
    assert fitted.model.startswith("radiance") and fitted.warnings == loaded(path).warnings != ()


def test_in_a_design_backward_light_is_that_of_the_placed_source(files):
    """Turned over, the light that went up in the file goes down; what starts above z = 0 is not lost from the start."""
    number = list(doubtful()).index("goes towards -z")
    (warning,) = loaded(files / f"{number}.ray", axis="-z").warnings
    share = 100.0 * (COUNT - 1000) / COUNT
    file = doubtful()["goes towards -z"]
    lost = 100.0 * np.mean((file.directions[:, 2] > 0.0) & (file.positions_mm[:, 2] >= 0.0))
    assert f"{share:.3g} % of the flux goes towards -z, {lost:.3g} % from z = 0 or below" in warning
    assert warning.endswith("check source.axis")
    raised = loaded(files / f"{number}.ray", axis="-z", position_mm=(0.0, 0.0, 5.0)).warnings[0]
    assert f"{share:.3g} % of the flux goes towards -z, 0 % from z = 0 or below" in raised


def test_scale_mends_the_unit(files):
    number = list(doubtful()).index("length unit")
    assert "source.scale" in loaded(files / f"{number}.ray").warnings[0]
    assert loaded(files / f"{number}.ray", scale=1e-3).warnings == ()
    assert "length unit" in loaded(files / "plain.ray", scale=1e3).warnings[0]
