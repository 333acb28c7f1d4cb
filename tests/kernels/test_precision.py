"""Kernels in single precision beside the same in double: rays through random lenses, and all that a scene may have."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from chains import clear, collimator, tables_of, upwards
from nightly import first_by_day, scaled
from own_media import coatings
from scenes import random_surface

from lensforge.kernels.compiled import inline, kernel
from lensforge.kernels.fate import Fate
from lensforge.kernels.precision import DOUBLE_PRECISION, SINGLE_PRECISION, ByPrecision, in_single
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.media import CoatingLayer, CoverGlass, IndexCurve, LayerStack, Media, Medium
from lensforge.optics.pose import Pose
from lensforge.scene.exit_rays import Sensitivities
from lensforge.scene.made_part import AsMade
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid, tabulate

GRID = TableGrid(48)
FACTOR = ByPrecision(3.0, 5.0)


@inline
def _third(x):
    return x / 3.0


def _sum_of_thirds(values):
    total = 0.0
    for k in range(len(values)):
        total += FACTOR * _third(values[k]) + float(k)
    return total


def test_all_numbers_of_a_kernel_are_single_also_in_those_that_it_calls(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Compiled anew: the cache of a folder of tests knows nothing of the code that makes the copy."""
    monkeypatch.setattr("lensforge.kernels.compiled._folder_of", lambda _: tmp_path)
    double = kernel(_sum_of_thirds)
    values = np.array([0.1, 0.7, 1.3])
    exact = np.float32(0.0)
    single = values.astype(np.float32)
    for k, value in enumerate(single):
        exact = exact + (np.float32(5.0) * (value / np.float32(3.0)) + np.float32(k))
    assert in_single(double)(single) == pytest.approx(float(exact), rel=2e-7)
    assert double(values) == pytest.approx(values.sum() + 3.0, rel=1e-15), "the other one is as it was"
    assert str(in_single(double).nopython_signatures[0].return_type) == "float32"
    assert in_single(double) is in_single(double)


def test_arrays_and_numbers_are_rounded_and_the_rest_stays() -> None:
    given = (np.array([0.1]), 0.1, True, None, np.array([1], dtype=np.int64), (0.2,))
    array, number, flag, none, whole, (inner,) = SINGLE_PRECISION.of(given)
    assert (array.dtype, type(number), type(inner)) == (np.float32, np.float32, np.float32)
    assert flag is True and none is None and whole.dtype == np.int64
    assert DOUBLE_PRECISION.of(given) is given


def _rays(rng: np.random.Generator, count: int, scale: float) -> RayBundle:
    """From all over the cavity and from below, every way: many graze a face or start beyond it."""
    origins = rng.normal(size=(count, 3)) * scale * rng.choice([1e-3, 0.1, 0.5, 0.9], size=(count, 1))
    origins[:, 2] = np.abs(origins[:, 2]) * rng.choice([0.0, 1.0], count) - 0.05 * scale * rng.choice([0.0, 1.0], count)
    directions = rng.normal(size=(count, 3)) * [1.0, 1.0, 0.3]
    return RayBundle(origins, directions / np.linalg.norm(directions, axis=1)[:, None], np.full(count, 1.0 / count))


def _both(tables: np.ndarray, scene: Scene, rays: RayBundle) -> tuple[TracedBundle, TracedBundle]:
    return TracedBundle.of(tables, scene, rays), TracedBundle.of(tables, replace(scene, single=True), rays)


@pytest.mark.parametrize("roughness", [0.003, 0.02, 0.08])
def test_rays_through_rough_lenses_of_any_size_have_the_same_fates(roughness: float) -> None:
    """One in a million ends elsewhere: it passes an edge within rounding."""
    rng = np.random.default_rng(7)
    different = 0
    count = 0
    errors = []
    for number in range(scaled(12)):
        scale = 10.0 ** rng.uniform(-3.0, 3.0)
        faces = [random_surface(2 * number + k, (1.0, 1.8)[k] * scale, roughness, (25, 81)) for k in range(2)]
        tables = np.stack([tabulate(GRID, face) for face in faces])
        rays = _rays(rng, 4096, scale)
        double, single = _both(tables, Scene(Media(Medium(1.4936)), GRID), rays)
        fates = double.at_lens.fates, single.at_lens.fates
        assert not (fates[1] == Fate.NOT_CONVERGED).any()
        different = different + int((fates[0] != fates[1]).sum())
        count = count + len(rays)
        left = (fates[0] == Fate.LEFT_LENS) & (fates[1] == Fate.LEFT_LENS)
        errors.append(np.abs(double.exits.points - single.exits.points)[left].max(axis=1) / scale)
    assert different <= 2e-5 * count
    assert np.quantile(np.concatenate(errors), 0.99) < 1e-5
    assert 0.0 < np.median(np.concatenate(errors)) < 1e-6, "exactly 0 would be double precision"


FILM = LayerStack((CoatingLayer(IndexCurve((1.38,)), 100.0),), IndexCurve((1.49,)), (300.0, 900.0))
MADE = AsMade(
    source=Pose.displaced((0.05, -0.03, 0.02), (0.01, -0.02, 0.0)), source_centre_mm=(0.1, 0.0, 0.0),
    lens=Pose.displaced((0.1, 0.0, 0.05)), faces={"outer": Pose.displaced((0.02, 0.05, -0.03), (0.004, 0.01, 0.0))},
    source_size=1.1, scale=0.99, slopes={"inner": 1e-3, "outer": 2e-3},
)  # fmt: skip
SCENES = {
    "bare": Scene(clear(), GRID),
    "without losses": Scene(clear(), GRID, fresnel=False),
    "absorbing": Scene(clear(absorption=0.02), GRID),
    "coated": Scene(replace(clear(), coatings=coatings(FILM, FILM)), GRID),
    "behind a glass": Scene(replace(clear(), cover_glass=CoverGlass(1.52, 2.0, 30.0, 1e-3)), GRID),
    "as made": Scene(clear(absorption=0.02), GRID, made=MADE),
    "as made, coated, behind a glass": Scene(
        replace(clear(), coatings=coatings(outer=FILM), cover_glass=CoverGlass(1.52, 2.0, 30.0)), GRID, made=MADE
    ),
}


CASES = [("bare", False), ("as made", False)]  # each has kernels of its own to compile
CASES += [(name, coloured) for name in SCENES for coloured in (False, True) if (name, coloured) not in CASES]


@pytest.mark.parametrize(("name", "coloured"), first_by_day(2, CASES))
def test_rays_and_gradients_of_every_scene_are_those_in_double(name: str, coloured: bool) -> None:
    rng = np.random.default_rng(3)
    scene = SCENES[name]
    tables = np.stack([tabulate(GRID, random_surface(k, (3.0, 6.0)[k], 0.01, (25, 81))) for k in range(2)])
    rays = upwards(2000, 5, 0.5)
    rays = rays.with_wavelengths(rng.uniform(400.0, 700.0, len(rays))) if coloured else rays
    double, single = _both(tables, scene, rays)
    assert (double.at_lens.fates == single.at_lens.fates).all()
    assert 0.5 < (double.at_lens.fates == Fate.LEFT_LENS).mean() < 1.0
    for field in ("points", "directions", "flux", "sin2_exit", "absorbed", "axial"):
        wanted, value = (getattr(traced.exits, field) for traced in (double, single))
        assert (wanted is None) == (value is None)
        if wanted is not None and len(wanted):
            assert value.dtype == np.float64
            assert np.abs(value - wanted).max() <= 3e-5 * np.abs(wanted).max(), field
    by = Sensitivities(rng.normal(size=(len(rays), 3)), rng.normal(size=(len(rays), 3)))
    by_flux, by_sin2 = rng.normal(size=(2, len(rays)))
    wanted, value = (traced.gradients(by, by_flux, by_sin2) for traced in (double, single))
    for a, b in zip(wanted, value, strict=True):
        assert 1e-9 < np.linalg.norm(b - a) / np.linalg.norm(a) < 2e-5


def test_a_chain_of_events_stays_in_double() -> None:
    body = collimator(0.05)
    scene = Scene(clear(), GRID, chain=body.chain(3))
    double, single = _both(tables_of(body, GRID), scene, upwards(500, 1, 0.5))
    assert np.array_equal(double.exits.points, single.exits.points)
