"""A lens judged under other conditions than its own: beside its own record, by name, and never in its verdict."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from addon_rows import needs_addon
from click.testing import CliRunner, Result
from presets import FEW
from scenes import hemisphere_directions, random_surface, small_spec
from undrawn import undrawn

import lensforge as lf
from lensforge.cli.cli import cli
from lensforge.errors import SourceWarning
from lensforge.light.lens_light import photometry_conditions, source_of
from lensforge.report import pipeline
from lensforge.report.folder import RunFolder
from lensforge.report.pipeline import write_report
from lensforge.scene.lens import Lens
from lensforge.verbs import EVALUATE

pytestmark = pytest.mark.usefixtures("undrawn")

RAYS = 1500

OWN = FEW.replace("few_of_sensitivity", studies={"sensitivity_rays": 256})


def write_rays(path: Path, sense: float = 1.0, side_mm: float = 1.0, flux_w: float = 1.0) -> Path:
    """A file of rays that start on a square; ``sense``: of their z."""
    rng = np.random.default_rng(5)
    start = np.column_stack([side_mm * (rng.random((RAYS, 2)) - 0.5), np.zeros(RAYS)])
    direction = hemisphere_directions(RAYS) * [1.0, 1.0, sense]
    rows = np.column_stack([start, direction, np.full(RAYS, flux_w / RAYS)])
    path.parent.mkdir(exist_ok=True)
    np.savetxt(path, rows, delimiter=",", header="x_mm,y_mm,z_mm,kx,ky,kz,flux_w", comments="", fmt="%.17g")
    return path


def lensforge(*arguments: object) -> Result:
    done = CliRunner().invoke(cli, list(map(str, arguments)))
    assert done.exception is None or isinstance(done.exception, lf.LensforgeError), done.exception
    return done


def rough_lens(spec: lf.Spec) -> Lens:
    return Lens.double(random_surface(1, 3.0, 0.01, (9,)), random_surface(2, 6.0, 0.01, (9,)), spec, 0, OWN)


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A lens with its own light, and a report."""
    folder = tmp_path_factory.mktemp("own")
    rough_lens(small_spec()).save(folder / "lens.json")
    EVALUATE.run(folder)
    with undrawn():
        write_report(folder)
    return folder


@pytest.fixture
def folder(original: Path, tmp_path: Path) -> Path:
    """A copy for a test that writes."""
    return Path(shutil.copytree(original, tmp_path / "lens"))


def shown(screen: str) -> dict[str, str]:
    """Texts of the screen by their labels, those on one line."""
    rows = (line.strip().split("  ", 1) for line in screen.splitlines() if "  " in line.strip())
    return {label: text.strip() for label, text in rows}


def own_files(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in ("evaluate.json", "evaluate.npz", "lens.json")}


def test_another_source_goes_beside_the_own_light(folder: Path, tmp_path: Path) -> None:
    before, verdict = own_files(folder), RunFolder(folder).run.verdict
    led = write_rays(tmp_path / "led cold.csv")
    done = lensforge("evaluate", folder, "--source", led)
    assert done.exit_code == 0
    assert own_files(folder) == before
    assert "/evaluate_led-cold.json\n" in done.stdout
    assert shown(done.stdout)["Conditions"] == "ray file led cold.csv"
    assert "Photometry: " not in done.stdout, "of the lens: not the matter here"
    assert "not at nominal conditions (ray file led cold.csv)" in done.stderr
    record = json.loads((folder / "evaluate_led-cold.json").read_text(encoding="utf-8"))
    assert record["conditions"]["source"] == "ray file led cold.csv"
    assert record["conditions"]["source_sha256"] == record["inputs"]["source"]
    assert record["inputs"]["file:led cold.csv"]
    assert [record["conditions"][name] for name in ("rays", "pixels", "seed", "accuracy")] == [None] * 4
    run = lf.load(folder)
    assert list(run.others) == ["evaluate_led-cold"] and run.others["evaluate_led-cold"] != run.light
    assert run.verdict == verdict and run.light.conditions is None
    stored = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    assert stored["others"] == {"evaluate_led-cold": run.others["evaluate_led-cold"].sha256}
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "Other conditions" in page and page.count("ray file led cold.csv") >= 2


def test_another_temperature_goes_beside_the_own_light(folder: Path) -> None:
    refused = lensforge("evaluate", folder, "--temperature", 85)
    assert isinstance(refused.exception, lf.InputError) and "lens.index_per_k" in str(refused.exception)
    assert not list(folder.glob("evaluate_*"))
    spec = small_spec(lens__index_per_k=-1.1e-4, lens__expansion_per_k=7e-5)
    rough_lens(spec).save(folder / "lens.json")
    EVALUATE.run(folder)
    before = own_files(folder)
    done = lensforge("evaluate", folder, "--temperature", 85)
    assert done.exit_code == 0, done.exception
    assert shown(done.stdout)["Conditions"] == "85 °C" and "evaluate_85C.json" in done.stdout
    run = lf.load(folder)
    light = run.others["evaluate_85C"]
    assert isinstance(light, lf.Light) and light.conditions is not None and light.conditions.temperature_c == 85.0
    assert light.efficiency.value != run.light.efficiency.value and own_files(folder) == before
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "lens at 85 °C" in page[page.index('id="other"') :]
    EVALUATE.run(folder, temperature_c=-40.0)
    assert "evaluate_minus40C" in lf.load(folder).others
    assert EVALUATE.run(folder, temperature_c=20.0).conditions is None
    assert set(lf.load(folder).others) == {"evaluate_85C", "evaluate_minus40C"}


def test_light_that_goes_backward_is_no_light_of_the_lens(folder: Path, tmp_path: Path) -> None:
    """Efficiency 0 under another source says nothing against the lens, and its own figures nothing for the source."""
    top = page_top(folder)
    done = lensforge("evaluate", folder, "--source", write_rays(tmp_path / "down.csv", sense=-1.0))
    assert done.exit_code == 0, done.stderr
    light = lf.load(folder).others["evaluate_down"]
    assert isinstance(light, lf.Light) and light.efficiency.value == 0.0
    assert light.missed_by_cause.backward > 0.99  # a few start above z = 0 and graze the inner surface
    assert done.stdout.startswith("Photometry under other conditions: fail\n")
    assert light.conditions is not None and any("-z" in warning for warning in light.conditions.warnings)
    for message in light.conditions.warnings:
        assert f"warning: {message}" in done.stderr.splitlines()
    assert page_top(folder) == top, "the own light, its verdict and its figures"
    page = (folder / "report.html").read_text(encoding="utf-8")
    row = page[page.index('id="other"') :]
    assert "mark fail" in row[: row.index("</table>")] and ">0\u2009%<" in row


def page_top(folder: Path) -> str:
    """The page up to its first section, without the menu."""
    page = (folder / "report.html").read_text(encoding="utf-8")
    top = page[: page.index('id="light"')]
    return top[: top.index("<nav>")] + top[top.index("</nav>") :]


def test_two_sources_of_one_name_are_not_mixed_up(folder: Path, tmp_path: Path) -> None:
    first, second = write_rays(tmp_path / "a" / "led.csv"), write_rays(tmp_path / "b" / "led.csv", side_mm=0.5)
    assert lensforge("evaluate", folder, "--source", first).exit_code == 0
    light = (folder / "evaluate_led.json").read_bytes()
    refused = lensforge("evaluate", folder, "--source", second)
    assert isinstance(refused.exception, lf.InputError)
    assert "evaluate_led.json: holds a result under other conditions of that name" in str(refused.exception)
    assert "--name" in str(refused.exception)
    assert (folder / "evaluate_led.json").read_bytes() == light
    assert lensforge("evaluate", folder, "--source", second, "--name", "small").exit_code == 0
    assert lensforge("evaluate", folder, "--source", first).exit_code == 0, "the same again is renewed"
    assert set(lf.load(folder).others) == {"evaluate_led", "evaluate_small"}
    assert isinstance(lensforge("evaluate", folder, "--rays", 64, "--name", "small").exception, lf.InputError)


def test_the_own_conditions_by_other_words_are_the_own(folder: Path) -> None:
    light = EVALUATE.run(folder, rays=4096, pixels=16)
    assert light.conditions is None and not lf.load(folder).others
    assert light.sha256 == lf.load(folder).light.sha256
    with pytest.raises(lf.InputError, match="the nominal conditions"):
        EVALUATE.run(folder, rays=4096, name="mine")


def test_a_record_under_other_conditions_never_takes_the_place_of_the_own(folder: Path) -> None:
    EVALUATE.run(folder, pixels=8)
    for suffix in ("json", "npz"):
        shutil.copy(folder / f"evaluate_8px.{suffix}", folder / f"evaluate.{suffix}")
    run = lf.load(folder)
    assert "under other than nominal conditions (8 x 8 pixels)" in run.outdated["evaluate"]
    assert run.verdict.light == "undecided" and not hasattr(run, "light")


@needs_addon("measure")
@pytest.mark.nightly("every study; by day the evaluation goes beside, above")
def test_every_study_with_other_rays_goes_beside(folder: Path) -> None:
    (folder / "report.html").unlink()  # written anew by each command otherwise
    cloud, lens = folder / "cloud.csv", lf.load_lens(folder / "lens.json")
    u = hemisphere_directions(2000)
    np.savetxt(cloud, u * lens.inner.radius(u)[:, None], delimiter=",")
    points = ("compare", folder, "--points", cloud, "--surface", "inner")
    assert lensforge("sensitivity", folder).exit_code == 0
    assert lensforge(*points).exit_code == 0
    made = {name: (folder / name).read_bytes() for name in ("sensitivity.json", "compare_inner.json")}
    (folder / "lens.ies").write_bytes(b"an own file")
    for command in (("sensitivity", folder), points, ("photometry", folder)):
        done = lensforge(*command, "--rays", 512)
        assert done.exit_code == 0, done.exception
        assert shown(done.stdout)["Conditions"] == "512 rays"
    assert made == {name: (folder / name).read_bytes() for name in made}
    assert (folder / "lens.ies").read_bytes() == b"an own file"
    assert (folder / "compare_inner_512rays.json").exists()
    run = lf.load(folder)
    assert set(run.others) == {"sensitivity_512rays", "compare_inner_512rays", "photometry_512rays"}
    photometry = run.others["photometry_512rays"]
    assert isinstance(photometry, lf.Photometry) and (folder / "lens_512rays.ies").read_bytes() == photometry.ies
    write_report(folder)
    page = (folder / "report.html").read_text(encoding="utf-8")
    for stem in run.others:
        assert page.count(f"{stem}.json") >= 2, "in the section and among all numbers"


def test_lumens_are_other_conditions_where_the_spec_knows_its_own() -> None:
    plain, known = small_spec(), small_spec(source__luminous_efficacy_lm_per_w=300.0)
    for spec, lumens, name in ((plain, 90.0, None), (known, 300.0, None), (known, 90.0, "90lm"), (known, None, None)):
        conditions = photometry_conditions(rough_lens(spec), source_of(spec), rays=None, seed=None, lumens=lumens)
        assert (None if conditions is None else conditions.name) == name


def test_light_knows_its_conditions(original: Path) -> None:
    lens = lf.load_lens(original / "lens.json")
    assert lf.evaluate(lens).conditions is None
    light = lf.evaluate(lens, source=lf.DiscSource(diameter_mm=1.0), rays=256, pixels=8, seed=3, accuracy="standard")
    assert light.conditions is not None
    assert str(light.conditions) == "1 mm disc source, accuracy standard, 256 rays, 8 x 8 pixels, seed 3"
    assert light.conditions.name == "1-mm-disc-source_standard_256rays_8px_seed3"


def test_a_source_is_warned_of_before_the_search(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pipeline, "run_later_stages", lambda *_: None)  # the later stages say nothing on the source
    led = write_rays(tmp_path / "led.csv")
    text = led.read_text(encoding="utf-8").splitlines()
    led.write_text("\n".join([*text, "0,0,0,0,0,0,1"]) + "\n", encoding="utf-8")
    source = {"kind": "rayfile", "file": str(led)}
    spec = small_spec(source=source, optimise__steps_per_level=[1, 1])
    heard: list[str] = []
    result = lf.design(spec, accuracy=FEW, warn=heard.append, progress=lambda step: heard.append("step"))
    assert heard[-2:] == ["step", "step"] and tuple(heard[:-2]) == result.source.warnings != ()
    with pytest.warns(SourceWarning) as warned:
        lf.design(spec, accuracy=OWN)
    assert [str(warning.message) for warning in warned if warning.category is SourceWarning] == heard[:-2]
    spec.save(tmp_path / "led.toml")
    done = CliRunner().invoke(
        cli, ["design", str(tmp_path / "led.toml"), "--accuracy", "draft", "--out", str(tmp_path / "o")]
    )
    lines = done.stderr.splitlines()
    assert [f"warning: {message}" for message in heard[:-2]] == lines[: len(heard) - 2], done.stderr
    stored = json.loads((tmp_path / "o" / "design.json").read_text(encoding="utf-8"))
    assert tuple(stored["source"]["warnings"]) == result.source.warnings
    page = (tmp_path / "o" / "report.html").read_text(encoding="utf-8")
    assert "on the source</strong>" in page[: page.index('id="light"')]


@pytest.mark.parametrize("name", ["", "a/b", "../up", "-x", ".hidden", "a" * 121, "a b", "a\x00b", "a\n"])
def test_a_name_of_conditions_stays_inside_the_folder(name: str) -> None:
    with pytest.raises(lf.InputError, match="letters, digits"):
        lf.Conditions.of(rays=64).renamed(name)
