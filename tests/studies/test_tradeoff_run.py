import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from PIL import Image
from scenes import random_surface, small_spec

from lensforge.errors import InputError
from lensforge.runs.pipeline import write_design
from lensforge.runs.stages import design
from lensforge.runs.tradeoff.measure import Effort, _lens_in, measure, run_tradeoff
from lensforge.runs.tradeoff.record import Tradeoff
from lensforge.scene.lens import Lens, load_lens
from lensforge.sources.build_source import build_source
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec import parse_spec
from lensforge.spec.accuracy import PRESETS

NODES = tuple(sorted({n for p in PRESETS.values() for n in (p.nodes_per_sigma, p.evaluate_nodes_per_sigma)}))
EFFORT = Effort(NODES, (2**8, 2**10, 2**12), (8, 16), (20, 28, 40), (12, 24, 48), (12,), cad=False, search=None)
FEW = replace(EFFORT, rays=(2**8, 2**10), pixels=(8,), nodes=(20, 28), rings=(12, 24))
SPEC = small_spec(base={"kind": "none"})


def small_lens():
    return Lens(random_surface(1, 3.0, 0.01, (9, 25)), random_surface(2, 6.0, 0.01, (9, 25)), SPEC, 0, "draft")


@dataclass(frozen=True)
class Measured:
    """A source of which there are only so many rays."""

    rays: RayBundle
    flux_w: float = 1.0
    symmetry: str = "none"

    @property
    def ray_count(self):
        return len(self.rays)

    def sample(self, count, seed):
        rows = np.random.default_rng(seed).permutation(len(self.rays))[:count]
        weights = self.rays.flux[rows]
        return RayBundle(self.rays.origins[rows], self.rays.directions[rows], weights / weights.sum())

    def outline(self):
        return build_source(SPEC.source).outline()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("tradeoff")
    small_lens().save(path / "lens.json")
    assert run_tradeoff(SPEC, path, effort=EFFORT) == Tradeoff.read(path)
    return path


def test_every_study_has_its_levels_and_a_reference_without_error(folder):
    content = Tradeoff.read(folder)
    studies = content.studies
    assert content.lens.accuracy == "draft"
    assert list(studies) == ["rays", "tables", "pixels", "filter", "nurbs", "mesh", "casting"]
    for name, study in studies.items():
        units = study.units
        assert all({error: found.unit for error, found in level.errors.items()} == units for level in study.levels)
        if name != "pixels":  # hard bins are the reference of the splat at each number of pixels
            (reference,) = [level for level in study.levels if level.reference]
            assert [reference.errors[error].value for error in units if error != "noise_nmse"] == [0.0] * (
                len(units) - (name == "filter")
            )


def test_the_presets_have_the_errors_of_their_levels(folder):
    content = Tradeoff.read(folder)
    assert set(content.presets) == set(PRESETS)
    levels = {level.setting: level for level in content.studies["tables"].levels}
    for name, preset in PRESETS.items():
        accuracy = content.presets[name]
        assert accuracy.design.table_rho == levels[preset.nodes_per_sigma].errors["rho"]
        assert accuracy.evaluation.table_rho == levels[preset.evaluate_nodes_per_sigma].errors["rho"]
    shares = [content.presets[name].evaluation.noise_nmse for name in PRESETS]
    assert shares == sorted(shares, reverse=True)


def test_the_page_needs_nothing_else(folder):
    page = (folder / "tradeoff.html").read_text(encoding="utf-8")
    assert not re.search(r'(src|href)="(?!data:|#)', page) and "http://" not in page.replace("http://www.w3.org", "")
    assert page.count("<svg") == 13
    assert "mathdefault" not in page


def test_a_plot_shows_the_levels_of_a_study(folder):
    tradeoff = Tradeoff.read(folder)
    axes = tradeoff.plot(study="tables", error="rho")
    (line,) = axes.lines
    levels = [level for level in tradeoff.studies["tables"].levels if not level.reference]
    assert np.array_equal(line.get_ydata(), [level.errors["rho"].value for level in levels])
    assert np.array_equal(line.get_xdata(), [level.seconds for level in levels])
    assert axes.get_yscale() == "log" and "<img" in tradeoff._repr_html_()
    with pytest.raises(InputError, match=r"^study = 'foo': must be one of .*tables"):
        tradeoff.plot(study="foo")
    with pytest.raises(InputError, match=r"^error = 'foo': must be one of .*rho"):
        tradeoff.plot(study="tables", error="foo")


def test_the_lens_of_another_scene_is_refused(folder):
    other = small_spec(base={"kind": "none"}, target__half_width_mm=70.0)
    with pytest.raises(InputError, match=r"another \[target\]"):
        run_tradeoff(other, folder, effort=EFFORT)


def test_the_page_of_another_program_is_kept(tmp_path):
    (tmp_path / "tradeoff.html").write_text("<title>Offer</title>", encoding="utf-8")
    with pytest.raises(InputError, match=r"tradeoff\.html.*move it away"):
        run_tradeoff(SPEC, tmp_path, announce=lambda words: pytest.fail(words))
    assert [path.name for path in tmp_path.iterdir()] == ["tradeoff.html"]


@pytest.mark.nightly("a draft and its tables; by day a lens is there")
def test_without_a_lens_a_draft_is_designed(tmp_path):
    heard = []
    spec = small_spec(base={"kind": "none"}, lens__symmetry="auto")

    def stop_at_tables(words: str) -> None:
        heard.append(words)
        if words == "tables":
            raise StopIteration

    for _ in range(2):  # the second time the lens is there, and is that of its spec, whose symmetry it names
        with pytest.raises(StopIteration):
            run_tradeoff(spec, tmp_path, effort=FEW, announce=stop_at_tables)
    assert load_lens(tmp_path / "lens.json").accuracy == "draft"
    assert "draft" in heard[0] and heard[1:] == ["tables", "tables"]


@pytest.mark.nightly("a study of its own")
def test_a_measured_source_is_resampled_and_its_rays_are_the_reference():
    source = Measured(build_source(SPEC.source).sample(5000, 1))
    content = measure(small_lens(), source, replace(FEW, rays=EFFORT.rays), lambda _: None)
    study = content.studies["rays"]
    assert {level.series for level in study.levels} == {"plain Monte Carlo", "reference"}
    assert [level.setting for level in study.levels] == [2**8, 2**10, 2**12, 5000]
    assert study.order["plain Monte Carlo"]["irradiance_nmse"].value == pytest.approx(-1.0, abs=0.1)
    assert content.presets["standard"].evaluation.rays == 5000
    assert content.inputs == {"lens": small_lens().sha256}


def test_the_spec_of_a_lens_file_is_the_scene_it_was_designed_for(folder):
    lens = load_lens(folder / "lens.json")
    assert parse_spec(lens.spec.model_dump(mode="json"), "lens.json") == SPEC


def test_a_lens_whose_picture_changed_since_is_not_measured(tmp_path):
    picture, folder = tmp_path / "arrow.png", tmp_path / "made"
    Image.fromarray(np.tri(32, dtype=np.uint8) * 255).save(picture)
    target = {"kind": "image", "file": str(picture), "width_mm": 100.0, "distance_mm": 100.0, "receiver_mm": 200.0}
    spec = small_spec(target=target, optimise={"steps_per_level": [1, 1], "rays": 256, "pixels": 16})
    lens = write_design(design(spec, accuracy="draft"), folder).lens
    assert _lens_in(folder, spec, build_source(spec.source), pytest.fail) == lens
    Image.fromarray(np.tri(32, dtype=np.uint8)[::-1] * 255).save(picture)
    with pytest.raises(InputError, match="a file that its spec names has changed since"):
        run_tradeoff(spec, folder)
