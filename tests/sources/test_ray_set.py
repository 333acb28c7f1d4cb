"""The ray-file emitter: placed where the spec says, power as stated, sampling that keeps what the file knows."""

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rayfile_samples import SHARED, rays

from lensforge.errors import InputError
from lensforge.sources.ray_file_statistics import RaySums
from lensforge.sources.ray_set_loading import load_ray_set
from lensforge.sources.rayfiles.ray_file_io import write_rayfile
from lensforge.spec import load_spec
from lensforge.spec.source_sections import RayfileSource, RayfilesSource

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def load(tmp_path):
    """Load the emitter of a ray file with the fields of the spec's source section."""

    def _load(rayfile, **fields):
        path = tmp_path / "led.rays"
        write_rayfile(path, rayfile, "csv" if rayfile.flux_unit == "lm" else "tm25")
        return load_ray_set(RayfileSource(kind="rayfile", file=path, **fields))

    return _load


@pytest.fixture
def two_files(tmp_path):
    """Blue and yellow: 40 and 60 rays; the yellow ones have longer files and other powers."""
    for name, count, seed in (("blue", 40, 1), ("yellow", 60, 2)):
        write_rayfile(tmp_path / name, rays(count, seed=seed), "tm25")
    return tmp_path


def test_watts_and_lumens_are_not_mixed_and_the_field_to_fill_is_named(two_files):
    write_rayfile(two_files / "yellow", rays(60, unit="lm"), "csv")
    files = [{"file": two_files / name} for name in ("blue", "yellow")]
    with pytest.raises(InputError, match=r"source\.files\[1\] \(yellow\): flux known in lm alone.*give its flux_w"):
        load_ray_set(RayfilesSource(files=files))
    mended = load_ray_set(RayfilesSource(files=[files[0], {**files[1], "flux_w": 0.25}]))
    assert mended.flux_w == pytest.approx(rays(40, seed=1).total_flux() + 0.25, rel=1e-6)


def test_several_files_share_one_origin_the_focus_of_all_their_light(two_files):
    files = [{"file": two_files / name} for name in ("blue", "yellow")]
    emitter = load_ray_set(RayfilesSource(kind="rayfiles", files=files, origin="virtual_focus"))
    focus = RaySums.of(emitter.rays).focus_mm
    np.testing.assert_allclose(focus, 0.0, atol=1e-12)
    together = np.concatenate([rays(40, seed=1).positions_mm, rays(60, seed=2).positions_mm]).astype(np.float64)
    shifts = emitter.rays.origins - together
    np.testing.assert_allclose(shifts, np.broadcast_to(shifts[0], shifts.shape), atol=1e-12)


def test_the_virtual_focus_goes_to_the_lens_origin(load):
    emitter = load(rays(500), origin="virtual_focus", rotate_z_deg=17.0)
    placed = RaySums.of(emitter.rays).focus_mm
    np.testing.assert_allclose(placed, 0.0, atol=1e-12)
    assert emitter.summary.placement.origin_mm == emitter.summary.virtual_focus_mm


def test_parallel_rays_have_no_virtual_focus(load):
    beam = replace(rays(), directions=np.tile([0.0, 0.0, 1.0], (12, 1)))
    with pytest.raises(InputError, match="parallel"):
        load(beam, origin="virtual_focus")
    assert load(beam).summary.virtual_focus_mm is None


def load_example(name):
    return load_ray_set(load_spec(EXAMPLES / f"{name}.toml").source)


def test_the_example_file_is_what_its_script_makes(tmp_path):
    make = runpy.run_path(str(EXAMPLES / "make_led_rayfile.py"))["make_led"]
    write_rayfile(tmp_path / "led", make(), "tm25")
    content = (EXAMPLES / "led.tm25ray").read_bytes()
    assert (tmp_path / "led").read_bytes() == content
    assert len(content) <= 700_000
    for name, made in runpy.run_path(str(EXAMPLES / "make_white_led.py"))["make_white"]().items():
        write_rayfile(tmp_path / name, made, "tm25")
        assert (tmp_path / name).read_bytes() == (EXAMPLES / f"white_{name}.tm25ray").read_bytes()


def test_the_example_led_is_off_the_axis_and_below_the_plane():
    summary = load_example("led_rayfile").summary
    np.testing.assert_allclose(summary.virtual_focus_mm, [0.15, -0.10, -0.05], atol=0.01)
    assert (summary.flux_w, summary.rays) == (1.0, 20_000)
    assert [warning.split(":")[0] for warning in summary.warnings] == ["20000 effective rays"]
    assert 0.0 < summary.placement.backward_share < 0.005


@pytest.mark.skipif(not SHARED.is_dir(), reason="../shared/rayfiles is not here")
def test_unknown_totals_and_weights_of_other_formats(tmp_path):
    """SPEOS: eleven equal weights, 1 W in the header. LightTools: 10,000 lm by its rays, 1 lm by its header."""
    emitter = load_ray_set(RayfileSource(kind="rayfile", file=SHARED / "tiny" / "test_08_ray.ray"))
    assert emitter.flux_w == 1.0
    np.testing.assert_allclose(emitter.rays.flux, 1.0 / 11.0)
    lumens = load_ray_set(RayfileSource(kind="rayfile", file=SHARED / "pairs" / "Cyl10k.1.ray", flux_w=0.004))
    assert lumens.flux_w == 0.004
    assert lumens.summary.files[0].file_flux == 1.0
