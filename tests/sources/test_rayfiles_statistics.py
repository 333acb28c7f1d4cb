"""What ``describe`` says, against closed forms, and what it drops."""

from dataclasses import replace

import numpy as np
import pytest
from rayfile_samples import rays
from scipy.optimize import minimize

from lensforge.errors import InputError
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.ray_file_statistics import RaySums, describe, outline
from lensforge.sources.ray_file_summary import Box, RayFileSummary, WavelengthRange
from lensforge.sources.rayfiles.ray_file import RayFile
from lensforge.sources.stored_rays import StoredRays


def point_source(point, count=500, seed=3):
    """Rays through ``point`` that start anywhere along themselves."""
    random = np.random.default_rng(seed)
    directions = random.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return point + random.uniform(-5.0, 5.0, (count, 1)) * directions, directions, random.uniform(0.1, 2.0, count)


def test_the_focus_minimises_the_weighted_squared_distances():
    """Against a numerical minimum of the definition, on rays that share no point."""
    random = np.random.default_rng(5)
    positions, directions, weights = point_source(np.zeros(3), 200)
    positions += random.normal(scale=0.5, size=positions.shape)

    def cost(point):
        away = point - positions
        along = np.sum(away * directions, axis=1)
        return weights @ (np.sum(away**2, axis=1) - along**2)

    best = minimize(cost, np.ones(3), tol=1e-14)
    np.testing.assert_allclose(RaySums.of(RayBundle(positions, directions, weights)).focus_mm, best.x, atol=1e-6)


def test_bad_rows_are_dropped_by_cause_and_directions_are_normalised():
    rayfile = rays(10)
    positions, directions, flux = (np.array(a) for a in (rayfile.positions_mm, rayfile.directions, rayfile.flux))
    positions[0, 1], directions[1, 2], flux[2], positions[3, 0] = np.nan, np.inf, np.nan, 1e30
    directions[4] = 0.0
    flux[5], flux[6] = 0.0, -1.0
    directions[7] *= 3.0
    broken = replace(rayfile, positions_mm=positions, directions=directions, flux=flux)
    stored = StoredRays.of(broken)
    kept = stored.loaded()
    assert stored.dropped == {"not_finite": 4, "zero_direction": 1, "no_flux": 2}
    assert len(kept) + sum(stored.dropped.values()) == 10
    np.testing.assert_allclose(np.linalg.norm(kept.directions, axis=1), 1.0, atol=1e-15)
    summary = describe(broken)
    assert summary.rays_used == 3
    assert any("7 of 10 rays dropped" in warning for warning in summary.warnings)


def test_numbers_of_a_small_file():
    directions = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    rayfile = RayFile(np.eye(3), directions, np.array([2.0, 1.0, 1.0]), "W", np.array([400.0, 500.0, 600.0]))
    summary = describe(rayfile)
    assert summary.flux.total == 4.0
    assert summary.flux.backward_share == 0.25
    assert summary.effective_rays == pytest.approx(16.0 / 6.0)
    assert summary.mean_direction == pytest.approx([0.25, 0.0, 0.25])
    assert summary.bounding_box_mm == Box(min=(0.0,) * 3, max=(1.0,) * 3)
    assert summary.wavelengths_nm == WavelengthRange(min=400.0, max=600.0, mean=475.0)
    assert RayFileSummary.model_validate_json(summary.model_dump_json()) == summary


def test_the_outline_is_what_the_description_says_without_the_rays():
    table = {"wavelength_nm": [400.0, 500.0, 600.0], "weight": [0.0, 1.0, 0.0]}
    for rayfile, waves in (
        (rays(wavelengths="one"), WavelengthRange(min=450.0, max=450.0, mean=450.0)),
        (replace(rays(), header={"spectral_tables": [table]}), WavelengthRange(min=400.0, max=600.0, mean=500.0)),
        (replace(rays(), header={"spectral_tables": [table, table]}), WavelengthRange(min=400.0, max=600.0)),
        (rays(), None),
    ):
        header, whole = outline(rayfile), describe(rayfile)
        assert header.wavelengths_nm == waves
        for name in ("format", "rays", "wavelengths_nm", "header"):
            assert getattr(header, name) == getattr(whole, name)
        assert type(header).model_validate_json(header.model_dump_json()) == header
        unread = outline(replace(rayfile, flux=np.full(12, np.nan)))
        assert unread == header


def test_a_summary_is_saved_compared_and_shown(tmp_path):
    rayfile = rays(300, wavelengths="each")
    summary = describe(rayfile)
    summary.save(tmp_path / "led.json")
    back = RayFileSummary.read(tmp_path, "led")
    assert back == summary
    assert describe(rays(300, wavelengths="each", seed=2)) != summary
    assert summary.row()["flux.ray_sum"] == summary.flux.ray_sum
    assert "<img" in summary._repr_html_() and "<img" not in back._repr_html_()
    with pytest.raises(InputError, match="read the ray file itself"):
        back.plot()
    (line, *_) = summary.plot(which="intensity").lines
    assert line.get_ydata().sum() > 0.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"header_flux_w": 99.0}, "the header is used"),
        ({"header_flux_w": 99.0, "header_role": "ignored"}, "the sum over the rays is used"),
        ({"positions_mm": np.random.default_rng(1).normal(size=(12, 3)) * 1000.0}, "length unit"),
        ({"positions_mm": np.random.default_rng(1).normal(size=(12, 3)) / 1000.0}, "length unit"),
    ],
)
def test_warnings(changes, message):
    assert any(message in warning for warning in describe(replace(rays(), **changes)).warnings)
