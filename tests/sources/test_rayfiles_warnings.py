"""Warnings on rays: a summary and a design give the same, the latter about the rays at their place in the lens."""

from dataclasses import replace

import numpy as np
import pytest
from rayfile_samples import encoded, rays, with_tables
from scenes import small_spec

from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.ray_set_loading import load_ray_set
from lensforge.sources.rayfiles.ray_file_io import read_rayfile
from lensforge.sources.rayfiles.ray_file_statistics import FEWEST_EFFECTIVE_RAYS, describe, ray_set_warnings
from lensforge.spec.source_sections import RayfilesSource, RaySource

COUNT = FEWEST_EFFECTIVE_RAYS + 2000


def led(count=COUNT, **changes):
    """An LED about which there is nothing to say: 1 mm wide, upwards, as many rays as are wanted."""
    plain = rays(count, wavelengths="none")
    directions = np.array(plain.directions)
    directions[:, 2] = np.abs(directions[:, 2])
    equal = np.ones(count, dtype=np.float32)
    return replace(plain, directions=directions, flux=equal, header_flux_w=float(count), **changes)


def doubtful():
    """Files about each of which exactly one thing is to be said, by a word of what is said."""
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
    ("side_mm", "backward", "effective"),
    [(1.0, 0.0099, 25_000.0), (0.05, 0.0, 25_000.0), (100.0, 0.01, 1e6)],
)
def test_the_limits_are_those_of_the_guide(side_mm, backward, effective):
    assert not list(ray_set_warnings(side_mm, backward, effective))
    (few,) = ray_set_warnings(side_mm, backward, 24_999.0)
    (down,) = ray_set_warnings(side_mm, 0.0101, effective)
    (wide,) = ray_set_warnings(100.1, backward, effective)
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


def loaded(path, **fields):
    spec = small_spec(source={"kind": "rayfile", "file": str(path), **fields})
    return summarise(build_source(spec.source), spec.source)


def test_in_a_design_backward_light_is_that_of_the_placed_source(files):
    """Turned over, the light that went up in the file goes down; what starts above z = 0 is not lost from the start."""
    number = list(doubtful()).index("goes towards -z")
    (warning,) = loaded(files / f"{number}.ray", axis="-z").warnings
    share = 100.0 * (COUNT - 1000) / COUNT
    assert f"{share:.3g} % of the flux goes towards -z" in warning and warning.endswith("check source.axis")
    raised = loaded(files / f"{number}.ray", axis="-z", position_mm=(0.0, 0.0, 5.0)).warnings[0]
    assert f"{share:.3g} % of the flux goes towards -z, 0 % from z = 0 or below" in raised


def test_scale_mends_the_unit(files):
    number = list(doubtful()).index("length unit")
    assert "source.scale" in loaded(files / f"{number}.ray").warnings[0]
    assert loaded(files / f"{number}.ray", scale=1e-3).warnings == ()
    assert "length unit" in loaded(files / "plain.ray", scale=1e3).warnings[0]


def test_a_stated_flux_takes_the_place_of_the_header(files):
    number = list(doubtful()).index("the header says")
    assert "the header is used" in loaded(files / f"{number}.ray").warnings[0]
    assert "the given flux is used" in loaded(files / f"{number}.ray", flux_w=1.0).warnings[0]


def test_several_files_are_named_and_their_rays_counted_together(files, tmp_path):
    (tmp_path / "few.ray").write_bytes(encoded("tm25", led(500)))
    number = list(doubtful()).index("the header says")
    paths = [files / f"{number}.ray", files / "plain.ray", tmp_path / "few.ray"]
    summary = load_ray_set(RayfilesSource(files=[{"file": path, "flux_w": 1.0} for path in paths])).summary
    assert summary.warnings[0].startswith(f"{number}.ray: rays add up to")
    assert [file.warnings for file in summary.files[1:]] == [(), ()]
    assert len(summary.warnings) == 2 and "effective rays" in summary.warnings[1]  # 500 rays carry a third of the light


def test_given_arrays_are_warned_of_like_files():
    source = led()
    arrays = {"positions_mm": source.positions_mm, "directions": source.directions, "flux_w": 1.0}
    assert load_ray_set(RaySource(**arrays)).summary.warnings == ()
    few = {**arrays, "positions_mm": 1e3 * source.positions_mm[:50], "directions": -source.directions[:50]}
    words = " ".join(load_ray_set(RaySource(**few)).summary.warnings)
    assert all(each in words for each in ("length unit", "50 effective rays", "100 % of the flux goes towards -z"))
