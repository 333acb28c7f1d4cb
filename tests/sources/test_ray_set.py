"""The ray-file emitter: placed where the spec says, power as stated, sampling that keeps what the file knows."""

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rayfile_samples import SHARED, rays

from lensforge.errors import InputError
from lensforge.optics.material import MATERIALS
from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.ray_set import RaySetEmitter, placed
from lensforge.sources.ray_set_loading import load_ray_set
from lensforge.sources.rayfiles import write_rayfile
from lensforge.sources.rayfiles.ray_file_statistics import virtual_focus
from lensforge.sources.source_summary import SourceSummary
from lensforge.spec import load_spec
from lensforge.spec.source_sections import Placement, RayfileSource, RayfilesSource, RaySource, SquareSource

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def load(tmp_path):
    """Load the emitter of a ray file with the fields of the spec's source section."""

    def _load(rayfile, material=None, **fields):
        path = tmp_path / "led.rays"
        write_rayfile(path, rayfile, "csv" if rayfile.flux_unit == "lm" else "tm25")
        return load_ray_set(RayfileSource(kind="rayfile", file=path, **fields), material)

    return _load


def test_origin_and_rotation(load):
    original = rays(50)
    point = np.array([0.25, -0.5, 0.125])
    emitter = load(original, origin=tuple(point), rotate_z_deg=90.0)
    moved = original.positions_mm.astype(np.float64) - point
    np.testing.assert_allclose(emitter.rays.origins, np.column_stack([-moved[:, 1], moved[:, 0], moved[:, 2]]))
    directions = original.directions.astype(np.float64)
    expected = np.column_stack([-directions[:, 1], directions[:, 0], directions[:, 2]])
    np.testing.assert_allclose(emitter.rays.directions, expected, atol=1e-7)
    np.testing.assert_allclose(load(original).rays.origins, original.positions_mm)


@pytest.mark.parametrize("wavelengths_nm", [None, np.full(50, 600.0)])
def test_rays_bring_an_index_only_where_the_lens_disperses_and_their_wavelengths_are_known(load, wavelengths_nm):
    original, pmma = replace(rays(50), wavelengths_nm=wavelengths_nm), MATERIALS["PMMA"]
    places = {"positions_mm": original.positions_mm, "directions": original.directions}
    spec = RaySource(**places, flux_w=1.0, wavelengths_nm=wavelengths_nm)
    one_index = load(original).rays.refractive_indices
    for found in (load_ray_set(spec, pmma), load(original, material=pmma)):
        if wavelengths_nm is None:
            assert found.rays.refractive_indices is None and found.summary.wavelengths_nm is None
        else:
            np.testing.assert_allclose(found.rays.refractive_indices, pmma.index_at(600.0))
            assert found.summary.wavelengths_nm == (600.0, 600.0)
    assert one_index is None


AXES = {"+x": [1, 0, 0], "-x": [-1, 0, 0], "+y": [0, 1, 0], "-y": [0, -1, 0], "+z": [0, 0, 1], "-z": [0, 0, -1]}


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("mirror", ["none", "x", "y"])
def test_any_axis_becomes_the_lens_axis_and_only_a_mirror_changes_the_handedness(axis, mirror):
    frame = RayBundle(np.eye(3), np.array([AXES[axis]] * 3, dtype=float), np.ones(3))
    turned = placed(frame, np.zeros(3), Placement(axis=axis, mirror=mirror, rotate_z_deg=33.0))
    np.testing.assert_allclose(turned.directions, [[0.0, 0.0, 1.0]] * 3, atol=1e-15)
    assert np.linalg.det(turned.origins) == pytest.approx(1.0 if mirror == "none" else -1.0)
    np.testing.assert_allclose(turned.origins @ turned.origins.T, np.eye(3), atol=1e-15)


def test_scale_and_mirror_come_before_the_rotation(load):
    original = rays(20)
    emitter = load(original, origin=(1.0, 0.0, 0.0), scale=2.0, mirror="x", rotate_z_deg=90.0)
    moved = 2.0 * (original.positions_mm.astype(np.float64) - [1.0, 0.0, 0.0]) * [-1.0, 1.0, 1.0]
    np.testing.assert_allclose(emitter.rays.origins, np.column_stack([-moved[:, 1], moved[:, 0], moved[:, 2]]))
    np.testing.assert_allclose(np.linalg.norm(emitter.rays.directions, axis=1), 1.0)


@pytest.fixture
def two_files(tmp_path):
    """Blue and yellow: 40 and 60 rays; the yellow ones have longer files and other powers."""
    for name, count, seed in (("blue", 40, 1), ("yellow", 60, 2)):
        write_rayfile(tmp_path / name, rays(count, seed=seed), "tm25")
    return tmp_path


def test_several_files_keep_their_powers_or_the_ratio_of_them(two_files):
    def parts(*flux):
        return [{"file": two_files / name, "flux_w": f} for name, f in zip(("blue", "yellow"), flux, strict=True)]

    own = load_ray_set(RayfilesSource(kind="rayfiles", files=parts(None, None)))
    assert own.flux_w == pytest.approx(rays(40, seed=1).total_flux() + rays(60, seed=2).total_flux(), rel=1e-6)
    stated = load_ray_set(RayfilesSource(kind="rayfiles", files=parts(0.6, 0.2)))
    assert stated.flux_w == pytest.approx(0.8)
    assert stated.rays.flux[:40].sum() == pytest.approx(0.6)
    scaled = load_ray_set(RayfilesSource(kind="rayfiles", files=parts(3.0, 1.0), flux_w=2.0))
    assert scaled.rays.flux[:40].sum() == pytest.approx(1.5)
    assert [part.flux_w for part in scaled.summary.files] == pytest.approx([1.5, 0.5])
    assert ([part.file for part in scaled.summary.files], scaled.summary.rays) == (["blue", "yellow"], 100)
    assert scaled.summary.effective_rays < 100


def test_watts_and_lumens_are_not_mixed_and_the_field_to_fill_is_named(two_files):
    write_rayfile(two_files / "yellow", rays(60, unit="lm"), "csv")
    files = [{"file": two_files / name} for name in ("blue", "yellow")]
    with pytest.raises(InputError, match=r"source\.files\[1\] \(yellow\): flux known in lm alone.*give its flux_w"):
        load_ray_set(RayfilesSource(files=files))
    mended = load_ray_set(RayfilesSource(files=[files[0], {**files[1], "flux_w": 0.25}]))
    assert mended.flux_w == pytest.approx(rays(40, seed=1).total_flux() + 0.25, rel=1e-6)


def test_the_summary_names_every_file_and_comes_back_from_json(two_files):
    spec = RayfilesSource(kind="rayfiles", files=[{"file": two_files / name} for name in ("blue", "yellow")])
    summary = summarise(load_ray_set(spec), spec)
    assert SourceSummary.model_validate_json(summary.model_dump_json()) == summary
    assert summary.title == "ray files blue, yellow"
    assert [part.rays for part in summary.files] == [40, 60]
    assert sum(part.flux_w for part in summary.files) == pytest.approx(summary.flux_w)
    point = SquareSource(kind="square", side_mm=0.0)
    assert summarise(build_source(point), point) == SourceSummary(title="point source", flux_w=1.0, symmetry="square")


def test_several_files_share_one_origin_the_focus_of_all_their_light(two_files):
    files = [{"file": two_files / name} for name in ("blue", "yellow")]
    emitter = load_ray_set(RayfilesSource(kind="rayfiles", files=files, origin="virtual_focus"))
    focus = virtual_focus(emitter.rays.origins, emitter.rays.directions, emitter.rays.flux)
    np.testing.assert_allclose(focus, 0.0, atol=1e-12)
    together = np.concatenate([rays(40, seed=1).positions_mm, rays(60, seed=2).positions_mm]).astype(np.float64)
    shifts = emitter.rays.origins - together
    np.testing.assert_allclose(shifts, np.broadcast_to(shifts[0], shifts.shape), atol=1e-12)


def test_a_spec_names_several_files_relative_to_itself(two_files, examples):
    text = (examples / "led_rayfile.toml").read_text(encoding="utf-8")
    text = text.replace('kind = "rayfile"', 'kind = "rayfiles"').replace(
        'file = "led.tm25ray"', 'files = [{file = "blue", flux_w = 0.6}, {file = "yellow", flux_w = 0.4}]'
    )
    (two_files / "led_rayfile.toml").write_text(text, encoding="utf-8")
    spec = load_spec(two_files / "led_rayfile.toml")
    assert spec.source.title == "ray files blue, yellow"
    assert build_source(spec.source).flux_w == pytest.approx(1.0)
    (two_files / "led_rayfile.toml").write_text(text.replace("flux_w = 0.6", "flux_w = -0.6"), encoding="utf-8")
    with pytest.raises(InputError, match=r"source\.files\.0\.flux_w = -0\.6"):
        load_spec(two_files / "led_rayfile.toml")


def test_the_virtual_focus_goes_to_the_lens_origin(load):
    emitter = load(rays(500), origin="virtual_focus", rotate_z_deg=17.0)
    placed = virtual_focus(emitter.rays.origins, emitter.rays.directions, emitter.rays.flux)
    np.testing.assert_allclose(placed, 0.0, atol=1e-12)
    assert emitter.summary.placement.origin_mm == emitter.summary.virtual_focus_mm


def test_parallel_rays_have_no_virtual_focus(load):
    beam = replace(rays(), directions=np.tile([0.0, 0.0, 1.0], (12, 1)))
    with pytest.raises(InputError, match="parallel"):
        load(beam, origin="virtual_focus")
    assert load(beam).summary.virtual_focus_mm is None


def test_power_comes_from_the_spec_or_from_watts_and_lumens_are_never_taken_for_them(load):
    assert load(rays()).flux_w == pytest.approx(rays().total_flux(), rel=1e-6)
    assert load(rays(), flux_w=2.5).flux_w == 2.5
    alone = load(rays(unit="lm"))
    assert alone.flux_w == pytest.approx(rays(unit="lm").total_flux() / 683.002, rel=1e-6)
    assert any("known in lm alone" in warning for warning in alone.summary.warnings)
    assert load(rays(unit="lm"), flux_w=2.5).rays.flux.sum() == pytest.approx(2.5)


@pytest.mark.parametrize("count", [1, 7, 99, 100, 101, 250, 1000])
def test_every_sample_carries_the_whole_flux_and_is_reproducible(load, count):
    emitter = load(rays(100), flux_w=3.0)
    bundle = emitter.sample(count, seed=5)
    assert len(bundle) == count
    assert bundle.flux.sum() == pytest.approx(3.0, rel=1e-12)
    np.testing.assert_allclose(np.linalg.norm(bundle.directions, axis=1), 1.0)
    again = emitter.sample(count, seed=5)
    np.testing.assert_array_equal(bundle.origins, again.origins)
    if count % 100:
        assert not np.array_equal(bundle.origins, emitter.sample(count, seed=6).origins)


def test_fewer_rays_are_chosen_without_replacement_from_the_whole_file(load):
    emitter = load(rays(1000))
    index = [
        np.flatnonzero((emitter.rays.origins == origin).all(axis=1))[0] for origin in emitter.sample(400, 1).origins
    ]
    assert len(set(index)) == 400
    assert 400 < np.mean(index) < 600


def test_more_rays_than_the_file_holds_say_what_the_file_says(load):
    """Splitting rays leaves every mean exactly that of the file."""
    emitter = load(rays(100), flux_w=1.0)
    whole = emitter.rays.flux @ emitter.rays.origins
    for count in (100, 163, 1234):
        bundle = emitter.sample(count, seed=2)
        np.testing.assert_allclose(bundle.flux @ bundle.origins, whole, atol=1e-14)


def test_a_smaller_sample_has_the_noise_of_a_finite_population(load):
    """Variance of a mean over m of n rays drawn without replacement: s^2/m (1 - m/n); equal weights."""
    emitter = load(replace(rays(400), flux=np.ones(400)), flux_w=1.0)
    values = emitter.rays.origins[:, 0]
    for count in (50, 300):
        means = [emitter.sample(count, seed) for seed in range(600)]
        spread = np.var([bundle.flux @ bundle.origins[:, 0] for bundle in means])
        assert spread == pytest.approx(values.var(ddof=1) / count * (1.0 - count / 400), rel=0.2)


def test_split_shares_no_ray_and_keeps_the_flux(load):
    emitter = load(rays(100), flux_w=2.0)
    training, holdout = emitter.split(0.8, seed=3)
    assert (len(training), len(holdout)) == (80, 20)
    assert training.rays.flux.sum() == pytest.approx(2.0)
    assert holdout.rays.flux.sum() == pytest.approx(2.0)
    together = np.concatenate([training.rays.origins, holdout.rays.origins])
    np.testing.assert_array_equal(np.sort(together, axis=0), np.sort(emitter.rays.origins, axis=0))
    for fraction in (0.0, 1.0, 0.001, -1.0):
        with pytest.raises(InputError, match="fraction"):
            emitter.split(fraction, seed=3)


def share_outside_cavity(emitter: RaySetEmitter, cavity_height_mm: float, cavity_radius_mm: float) -> float:
    """Share of the flux that starts outside the paraboloid which every feasible cavity contains, Eq. (10).

    A ray that starts below z = 0 is outside if it does not come up through the paraboloid's foot.
    """
    start, direction = emitter.rays.origins, emitter.rays.directions
    rises = direction[:, 2] > 0.0
    foot = start[:, :2] - (start[:, 2] / np.where(rises, direction[:, 2], 1.0))[:, None] * direction[:, :2]
    below = start[:, 2] < 0.0
    squared = np.sum(np.where(below[:, None], foot, start[:, :2]) ** 2, axis=1)
    height = cavity_height_mm * (1.0 - squared / cavity_radius_mm**2)
    inside = (~below | rises) & (np.maximum(start[:, 2], 0.0) <= height)
    return float(emitter.rays.flux[~inside].sum() / emitter.flux_w)


def test_backward_and_outlying_rays_are_kept_and_reported(load):
    directions = np.tile([0.0, 0.0, 1.0], (4, 1))
    directions[3, 2] = -1.0
    positions = np.array([[0.0, 0.0, 0.5], [3.0, 0.0, 0.0], [0.5, 0.0, -2.0], [0.0, 0.0, 0.1]])
    four = replace(rays(4), positions_mm=positions, directions=directions, flux=np.ones(4), header_flux_w=4.0)
    emitter = load(four)
    assert len(emitter) == 4
    assert emitter.summary.placement.backward_share == pytest.approx(0.25)
    assert emitter.summary.placement.below_plane_share == pytest.approx(0.25)
    assert share_outside_cavity(emitter, 1.0, 2.0) == pytest.approx(0.25)
    assert share_outside_cavity(emitter, 0.4, 2.0) == pytest.approx(0.5)
    assert share_outside_cavity(emitter, 1.0, 4.0) == pytest.approx(0.0)


def test_a_ray_below_the_plane_must_come_up_through_the_foot(load):
    slanted = np.array([[0.6, 0.0, 0.8], [0.0, 0.0, -1.0]])
    positions = np.array([[0.0, 0.0, -4.0], [0.0, 0.0, -1.0]])
    two = replace(rays(2), positions_mm=positions, directions=slanted, flux=np.ones(2), header_flux_w=2.0)
    assert share_outside_cavity(load(two), 1.0, 3.1) == pytest.approx(0.5)
    assert share_outside_cavity(load(two), 1.0, 2.9) == pytest.approx(1.0)


def test_outline_is_the_chip_of_the_example():
    """2 mm wide with a faint halo of 0.3 mm; the stray light of the window's edge stays out of it."""
    outline = load_example("led_rayfile").outline()
    assert (outline[:, 2] == 0.0).all()
    np.testing.assert_allclose(np.abs(outline[:, :2]).max(axis=0), 1.25, atol=0.15)
    x, y = outline[:, 0], outline[:, 1]
    area = 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert area == pytest.approx(4.6, abs=0.8)


def test_outline_of_rays_on_one_line(load):
    assert load(rays(1)).outline().shape == (4, 3)
    line = replace(
        rays(5), positions_mm=np.outer(np.arange(5.0), [1.0, 1.0, 0.0]), directions=np.tile([0, 0, 1.0], (5, 1))
    )
    np.testing.assert_allclose(load(line).outline().max(axis=0), [4.0, 4.0, 0.0])


def load_example(name):
    return load_ray_set(load_spec(EXAMPLES / f"{name}.toml").source)


def test_the_example_file_is_what_its_script_makes(tmp_path):
    make = runpy.run_path(str(EXAMPLES / "make_led_rayfile.py"))["make_led"]
    write_rayfile(tmp_path / "led", make(), "tm25")
    content = (EXAMPLES / "led.tm25ray").read_bytes()
    assert (tmp_path / "led").read_bytes() == content
    assert len(content) <= 700_000


def test_the_example_led_is_off_the_axis_and_below_the_plane():
    summary = load_example("led_rayfile").summary
    np.testing.assert_allclose(summary.virtual_focus_mm, [0.15, -0.10, -0.05], atol=0.01)
    assert (summary.flux_w, summary.rays) == (1.0, 20_000)
    assert [warning.split(":")[0] for warning in summary.warnings] == ["20000 effective rays"]
    assert 0.0 < summary.placement.backward_share < 0.005


@pytest.mark.parametrize(("name", "share"), [("led_rayfile", 0.005), ("osram_pi", 0.006)])
def test_the_cavities_of_the_examples_hold_nearly_all_of_the_light(name, share):
    spec = load_spec(EXAMPLES / f"{name}.toml")
    if not spec.source.file.exists():
        pytest.skip("the vendor's file is not here")
    limits = spec.constraints
    outside = share_outside_cavity(load_example(name), limits.cavity_height_mm, limits.cavity_radius_mm)
    assert outside == pytest.approx(share, abs=0.0006)
    assert limits.cavity_radius_mm < spec.lens.inner_offset_mm


@pytest.mark.skipif(not SHARED.is_dir(), reason="../shared/rayfiles is not here")
def test_unknown_totals_and_weights_of_other_formats(tmp_path):
    """SPEOS: eleven equal weights, 1 W in the header. LightTools: 10,000 lm by its rays, 1 lm by its header."""
    emitter = load_ray_set(RayfileSource(kind="rayfile", file=SHARED / "tiny" / "test_08_ray.ray"))
    assert emitter.flux_w == 1.0
    np.testing.assert_allclose(emitter.rays.flux, 1.0 / 11.0)
    lumens = load_ray_set(RayfileSource(kind="rayfile", file=SHARED / "pairs" / "Cyl10k.1.ray", flux_w=0.004))
    assert lumens.flux_w == 0.004
    assert lumens.summary.files[0].file_flux == 1.0
