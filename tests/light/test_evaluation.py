from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from known_refraction import normal_transmittance
from nightly import NIGHTLY
from presets import FEW
from scenes import small_spec, sphere

import lensforge as lf
from lensforge.light.evaluation import _with_left_open, evaluate_lens
from lensforge.light.simulation import TracedLens
from lensforge.results import Metric
from lensforge.scene.lens import Lens
from lensforge.sources.build_source import SquareEmitter, build_source
from lensforge.sources.measured_rays import searched
from lensforge.sources.ray_set import RaySetEmitter
from lensforge.sources.rayfiles.ray_file import RayFile
from lensforge.sources.rayfiles.ray_file_io import write_rayfile
from lensforge.spec.source_sections import RayfileSource

DRAFT = FEW


def _evaluate(lens: Lens, **options):
    return evaluate_lens(lens, build_source(lens.spec.source), DRAFT, **options)


def test_a_point_in_concentric_spheres_shines_like_a_bare_lambertian_point() -> None:
    """cos^4 on the receiver, weakened by two surfaces at normal incidence: closed form, pixel by pixel."""
    spec = small_spec(
        source={"kind": "square", "side_mm": 0.0}, evaluate={"rays": 2**20, "pixels": 16, "filter_variance": 0.0}
    )
    result = _evaluate(Lens.double(sphere(3.0), sphere(6.0), spec, 0, FEW))
    fine = np.arange(-100, 100, 0.5) + 0.25
    x, y = np.meshgrid(fine, fine)
    irradiance = normal_transmittance(1.4936) ** 2 / np.pi * 100.0**2 / (100.0**2 + x**2 + y**2) ** 2 * 1e6
    expected = irradiance.reshape(16, 25, 16, 25).mean(axis=(1, 3))
    difference = result.raw_map / expected - 1.0
    assert np.abs(difference).max() < 0.04  # some 2,000 rays a pixel
    assert np.abs(difference).mean() < 0.01
    window = irradiance.mean() * 0.2**2
    efficiency = result.efficiency
    assert efficiency.standard_error is not None
    assert efficiency.value == pytest.approx(window, abs=5 * efficiency.standard_error + 1e-5)


@dataclass(frozen=True)
class Modelled(SquareEmitter):
    """A model of a file of few rays: other draws of them make others, of which none is the light of the rest."""

    number: str = "the model"

    @property
    def file(self) -> "Modelled":
        return self

    @property
    def held_back(self) -> "Modelled":
        return replace(self, number="held back")

    def refitted(self, seed: int) -> "Modelled":
        return replace(self, number=f"refit {seed}")


def test_what_few_rays_of_a_file_leave_open_enlarges_the_error_of_each_figure_by_its_own_changes(monkeypatch) -> None:
    """In quadrature: the rms change of four refits, and what the rays held back differ by beyond their own noise."""
    changes = {"refit 0": (3.0, 1.0), "refit 1": (-1.0, -3.0), "refit 2": (1.0, 5.0), "refit 3": (1.0, 1.0)}
    changes |= {"the model": (0.0, 0.0), "held back": (5.0, -4.0)}
    noise = dict.fromkeys(changes, (0.0, 0.0)) | {"held back": (3.0, 6.0)}  # of the efficiency more than the difference

    def light_of(traced, spec, source, rays, seed) -> SimpleNamespace:
        figures = [
            Metric(value=value + 1e-3 * change, standard_error=1e-3 * error)
            for value, change, error in zip((0.1, 0.5), changes[source.number], noise[source.number], strict=True)
        ]
        return SimpleNamespace(metrics=SimpleNamespace(nmse=figures[0], efficiency=figures[1]))

    spec = small_spec(evaluate={"rays": 2**12, "pixels": 16})
    lens = Lens.double(sphere(3.0), sphere(6.0), spec, 0, FEW)
    plain = _evaluate(lens)
    monkeypatch.setattr("lensforge.light.evaluation.traced_light", light_of)
    built = build_source(spec.source)
    model = Modelled(**{field.name: getattr(built, field.name) for field in fields(built)})
    light = _with_left_open(plain, TracedLens.of(lens, 3.0), spec, model, 2**12, 0)
    held_back = light.by_file
    assert held_back.rays == 2**12 and held_back.nmse.value == pytest.approx(0.105)
    assert held_back.efficiency.value == pytest.approx(0.496) and held_back.efficiency.standard_error == 6e-3
    more = 1e-3 * np.sqrt([(9.0 + 1.0 + 1.0 + 1.0) / 4.0 + 25.0 - 9.0, (1.0 + 9.0 + 25.0 + 1.0) / 4.0])
    for name, open_error in zip(("nmse", "efficiency"), more, strict=True):
        before, after = getattr(plain.first, name), getattr(light.first, name)
        assert after.value == before.value
        assert after.standard_error == pytest.approx(np.hypot(before.standard_error, open_error), rel=1e-9)


PLANE = {"kind": "plane", "centre_mm": [0.0, 0.0, 100.0], "width_mm": 200.0, "height_mm": 200.0}


@pytest.mark.parametrize(
    ("changes", "width", "height"),
    [
        ({"evaluate__window_mm": 60.0}, 60.0, 60.0),
        ({"evaluate__window_mm": 260.0}, 260.0, 260.0),
        ({"target": None, "receivers": [{**PLANE, "window_mm": [80.0, 40.0]}]}, 80.0, 40.0),
        ({"target": None, "receivers": [PLANE]}, 200.0, 200.0),
    ],
)
def test_the_efficiency_is_the_share_of_the_light_in_the_window(changes: dict, width: float, height: float) -> None:
    """Of a Lambertian point behind two surfaces at normal incidence; the window may be larger than the picture."""
    targets = [{"kind": "disc", "diameter_mm": 60.0}]
    if "receivers" in changes:
        changes = {**changes, "receivers": [{**change, "targets": targets} for change in changes["receivers"]]}
    spec = small_spec(source={"kind": "square", "side_mm": 0.0}, evaluate__rays=2**14, **changes)
    efficiency = _evaluate(Lens.double(sphere(3.0), sphere(6.0), spec, 0, FEW)).efficiency
    x, y = np.meshgrid(*((np.arange(400) + 0.5) / 400 * side - 0.5 * side for side in (width, height)))
    share = np.mean(100.0**2 / (100.0**2 + x**2 + y**2) ** 2) * width * height / np.pi
    expected = normal_transmittance(1.4936) ** 2 * share
    assert efficiency.standard_error is not None
    assert efficiency.value == pytest.approx(expected, abs=5.0 * efficiency.standard_error + 1e-4)


@pytest.mark.parametrize("variance", [0.0, 0.3, 2.0])
def test_the_picture_is_that_of_the_rays_under_the_gaussian_asked_for(variance: float) -> None:
    """Weights of a pixel and its eight neighbours by their distance; the edge is repeated outwards."""
    spec = small_spec(evaluate__filter_variance=variance)
    light = _evaluate(Lens.double(sphere(3.0), sphere(6.0), spec, 0, FEW))
    padded = np.pad(light.raw_map, 1, mode="edge")
    total = np.zeros((16, 16))
    weight = 0.0
    for row, column in np.ndindex(3, 3):
        squared = (row - 1) ** 2 + (column - 1) ** 2
        share = float(np.exp(-squared / (2.0 * variance))) if variance else float(squared == 0)
        total += share * padded[row : row + 16, column : column + 16]
        weight += share
    assert light.map == pytest.approx(total / weight, rel=1e-12)


def test_standard_errors_tell_the_truth() -> None:
    """Ten evaluations with other seeds scatter as the standard error of one says, within twice: 3 sigma for ten."""
    spec = small_spec()
    lenses = [Lens.double(sphere(3.0), sphere(6.0), spec, seed, FEW) for seed in range(30 if NIGHTLY else 10)]
    lights = [_evaluate(lens, rays=4096) for lens in lenses]
    for metric in ("efficiency", "nmse", "share_in_target"):
        scatter = np.std([getattr(light, metric).value for light in lights], ddof=1)
        stated = np.mean([getattr(light, metric).standard_error for light in lights])
        assert 0.5 < stated / scatter < 2.0, metric


def test_the_figures_of_few_rays_are_those_of_many_but_for_their_errors() -> None:
    """With 2^14 rays each pixel has a noise of 0.2; the picture as binned looks worse than the light is."""
    spec = small_spec(evaluate__pixels=48)
    lens = Lens.double(sphere(3.0), sphere(6.0), spec, 0, FEW)
    few, many = (_evaluate(lens, rays=rays) for rays in (2**14, 2**20))
    for name, worse_by in (("nmse", 5.0), ("rsd", 5.0), ("uniformity", 1.0)):  # standard errors
        rough = getattr(few, name)
        fine = getattr(many, name)
        error = np.hypot(rough.standard_error, fine.standard_error)
        assert abs(rough.value - fine.value) < 3.0 * error, name
        assert abs(getattr(few.raw, name) - fine.value) > worse_by * error, name
    assert few.nmse_of_noise is not None
    assert few.raw.nmse == pytest.approx(few.nmse.value + few.nmse_of_noise, abs=0.25 * few.nmse_of_noise)


def test_a_lens_for_a_ray_file_is_judged_by_the_rays_that_no_search_uses(tmp_path: Path) -> None:
    """Of the file, the rays for searches go forward, all others backward."""
    rays = SquareEmitter(1.0).sample(4096, 5)
    numbered = RaySetEmitter(replace(rays, origins=np.arange(4096.0)[:, None] * np.ones(3)), 1.0)
    of_search = np.zeros(4096, dtype=bool)
    of_search[searched(numbered).sample(2867, 0).origins[:, 0].astype(int)] = True
    turned = np.where(of_search[:, None], rays.directions, rays.directions * [1.0, 1.0, -1.0])
    files = {name: tmp_path / f"{name}.tm25ray" for name in ("own", "copy", "other")}
    for name, path in files.items():
        order = slice(None, None, -1 if name == "other" else 1)
        columns = (vectors[order].astype(np.float32) for vectors in (rays.origins, turned))
        write_rayfile(path, RayFile(*columns, np.full(4096, 1 / 4096, np.float32), "W", header_flux_w=1.0), "tm25")
    source = RayfileSource(file=files["own"], model="rays", flux_w=1.0)
    lens = Lens.double(sphere(3.0), sphere(6.0), small_spec().model_copy(update={"source": source}), 0, FEW)
    light, copied, other = (
        lf.evaluate(lens, source=source.model_copy(update={"file": files[name]})) for name in ("own", "copy", "other")
    )
    assert light.rays == 1229 and light.missed_by_cause.backward == pytest.approx(1.0) and light.efficiency.value == 0.0
    assert light.fitted is not None and light.fitted.rays == 2867 and light.fitted.efficiency.value > 0.5
    assert copied.rays == 1229, "the same rays under another name"
    assert other.rays == 4096 and other.fitted is None, "no search has seen another file"
