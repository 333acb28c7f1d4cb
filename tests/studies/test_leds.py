"""A lens for each LED of a list: how lists are read, and what the study says of each."""

import csv
import json
import shutil
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import pytest
from in_this_process import lensforge
from presets import FEW
from scenes import small_spec
from undrawn import undrawn

import lensforge as lf
from lensforge import design, evaluate
from lensforge.errors import InputError
from lensforge.report.stored import load_results
from lensforge.report.sweep import Sweep
from lensforge.report.sweep_runs import run_sweep
from lensforge.report.variation import ONE_FOR_ALL, sources_of
from lensforge.search.checkpoint import CHECKPOINT
from lensforge.spec.source_list import read_sources, require_told_apart, source_with_file

pytestmark = pytest.mark.usefixtures("undrawn")

LEDS = [
    {"name": "small", "source": {"kind": "square", "side_mm": 0.5}},
    {"name": "wide", "source": {"kind": "rectangle", "width_mm": 1.4, "height_mm": 0.7}},
]
STEPS = {"steps_per_level": [2, 2], "rays": 256, "pixels": 16}
SPEC = small_spec(source=None, sources=LEDS, optimise=STEPS, base={"kind": "none"})


def designed(spec: lf.Spec, folder: Path, resume: bool) -> None:
    """Design and evaluation of one LED, the files of a whole run left out; ``wide`` fails where it is alone."""
    if spec.name.endswith("-failing"):
        raise InputError("source: it cannot be")
    result = design(spec, accuracy=FEW, checkpoint=folder / CHECKPOINT)
    result.lens.save(folder / "lens.json")
    result.write(folder)
    (folder / CHECKPOINT).unlink()
    evaluate(result.lens).write(folder)


def copied(made: Path, folder: Path) -> None:
    """The files of a design of the study in the place of others, for tests that do not look at the lens."""
    shutil.copytree(made, folder, dirs_exist_ok=True)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Sweep]:
    folder = tmp_path_factory.mktemp("leds")
    failing = lf.NamedSource(name="failing", source=SPEC.sources[0].source)
    spec = SPEC.replace(sources=[*SPEC.sources, failing])
    with undrawn():
        return folder, run_sweep(spec, sources_of(spec.sources, spec), folder, designed, accuracy=FEW)


def test_every_led_has_its_own_design_and_one_has_them_all(study: tuple[Path, Sweep]) -> None:
    folder, sweep = study
    assert sweep.values == ("small", "wide", ONE_FOR_ALL) and sweep.failed == {"failing": "source: it cannot be"}
    for row in sweep.designs:
        results = load_results(folder / row.folder)
        lights = results.light.by_led.values()
        assert row.efficiency.value == min(light.efficiency.value for light in lights)
        assert row.nmse.value == max(light.nmse.value for light in lights)
        titles = [source.title for source in results.spec.each_source]
        by_led = {"small": ["0.5 mm square Lambertian source"], "wide": ["1.4 mm × 0.7 mm source"]}
        assert titles == by_led.get(str(row.value), [*by_led["small"], *by_led["wide"], *by_led["small"]])
    rows = list(csv.DictReader((folder / "sweep.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["value"] for row in rows] == ["small", "wide", ONE_FOR_ALL, "failing"]
    assert float(rows[1]["efficiency.value"]) == sweep.designs[1].efficiency.value
    assert rows[3]["failed"] == "source: it cannot be"
    common = sweep.designs[2]
    assert common.nmse == common.by_led["wide"].nmse != common.by_led["small"].nmse, "the worst, not the first"
    page = (folder / "sweep.html").read_text(encoding="utf-8")
    assert "it cannot be" in page and "small in one lens for all" in page
    assert f"{common.folder}, worst of 3 LEDs" in page


def test_the_loss_of_each_led_is_against_its_own_lens(study: tuple[Path, Sweep]) -> None:
    folder, sweep = study
    with_all = load_results(folder / sweep.designs[2].folder).light.by_led
    for row in sweep.designs[:2]:
        (loss,) = (group for group in sweep.facts if group.title == f"{row.value} in one lens for all")
        common = with_all[str(row.value)]
        told = {"own_efficiency": (row.efficiency, 100.0, "%"), "efficiency": (common.efficiency, 100.0, "%"),
                "own_nmse": (row.nmse, 1.0, ""), "nmse": (common.nmse, 1.0, "")}  # fmt: skip
        expected = {
            key: (factor * metric.value, factor * metric.standard_error, unit)
            for key, (metric, factor, unit) in told.items()
        }
        expected["lost"] = 100.0 * (1.0 - common.efficiency.value / row.efficiency.value), None, "%"
        expected["more"] = common.nmse.value / row.nmse.value, None, ""
        for fact in loss.facts:
            value, error, unit = expected.pop(fact.key)
            assert (fact.value, fact.unit) == (pytest.approx(value), unit)
            assert fact.standard_error == (None if error is None else pytest.approx(error))
        assert not expected
        assert sweep.designs[2].by_led[str(row.value)].efficiency == common.efficiency != row.efficiency


def test_a_study_goes_on_with_what_is_finished(study: tuple[Path, Sweep], tmp_path: Path) -> None:
    folder, sweep = study
    shutil.copytree(folder, tmp_path / "leds")
    made = []
    again = run_sweep(
        sweep.spec, sources_of(sweep.spec.sources, sweep.spec), tmp_path / "leds",
        lambda spec, where, resume: made.append(spec.name) or designed(spec, where, resume),
        accuracy=FEW, resume=True,
    )  # fmt: skip
    assert made == ["small-failing"] and again == sweep
    other = [SPEC.sources[0], lf.NamedSource(name="wide", source=lf.SquareSource(side_mm=1.1))]
    with pytest.raises(InputError, match="designed for another LED wide"):
        run_sweep(sweep.spec, sources_of(other, SPEC), tmp_path / "leds", designed, accuracy=FEW, resume=True)


def test_workers_get_all_options_and_their_designs_are_in_the_order_of_the_leds(
    study: tuple[Path, Sweep], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, sweep = study
    asked = {}

    class Backwards:
        def __init__(self, scheduler: str) -> None:
            asked["scheduler"] = scheduler

        def map(self, _: object, options: dict, specs: list) -> Iterator[tuple[int, object]]:
            asked.update(options)
            for number in reversed(range(len(specs))):
                made = folder / specs[number].name
                content = {path.name: path.read_bytes() for path in made.iterdir()} if made.exists() else "cannot be"
                yield number, content

    monkeypatch.setattr("lensforge.report.sweep_runs.connected", lambda scheduler: nullcontext(Backwards(scheduler)))
    there = run_sweep(
        sweep.spec, sources_of(sweep.spec.sources, sweep.spec), tmp_path, pytest.fail, accuracy=FEW, seed=2,
        scheduler="tcp://host:8786", force=True,
    )  # fmt: skip
    assert asked == {"accuracy": FEW, "seed": 2, "force": True, "scheduler": "tcp://host:8786"}
    assert there.values == sweep.values and there.failed == {"failing": "cannot be"}


def test_a_study_without_any_design_says_why(tmp_path: Path) -> None:
    leds = [lf.NamedSource(name=f"{number}-failing", source=SPEC.source) for number in range(2)]
    with pytest.raises(InputError, match="it cannot be"):
        run_sweep(SPEC, sources_of(leds, SPEC), tmp_path, designed, accuracy=FEW)


def test_lists_are_files_patterns_tables_and_sections(examples: Path, tmp_path: Path) -> None:
    for name in ("b x.tm25ray", "a.tm25ray"):
        shutil.copy(examples / "led.tm25ray", tmp_path / name)
    source = lf.SquareSource(side_mm=1.0, flux_lm=90.0, position_mm=(0.0, 0.0, 0.1))
    listed = read_sources([tmp_path / "*.tm25ray"], source)
    assert [led.name for led in listed] == ["a", "b_x"]
    assert listed[1].source == lf.RayfileSource(
        file=tmp_path / "b x.tm25ray", origin="virtual_focus", flux_lm=90.0, position_mm=(0.0, 0.0, 0.1)
    )
    table = tmp_path / "leds.csv"
    table.write_text("name,file,flux_lm,share\nfirst,a.tm25ray,120,2\n,b x.tm25ray,,\n", encoding="utf-8")
    first, second = read_sources([str(table)], source)
    assert (first.name, first.share, first.source.flux_lm, second.name) == ("first", 2.0, 120.0, "b_x")
    assert second.source.flux_lm == 90.0
    sections = tmp_path / "leds.toml"
    sections.write_text(
        '[[sources]]\nname = "c"\nsource = { kind = "rayfile", file = "a.tm25ray" }\n', encoding="utf-8"
    )
    (third,) = read_sources([sections], source)
    assert third.source.file == tmp_path / "a.tm25ray"


def test_a_file_in_the_place_of_a_ray_file_is_placed_and_read_as_that_was(tmp_path: Path) -> None:
    """All fields but the file; of a row of a table that states its light, none of what the spec states of that."""
    (tmp_path / "b.ray").touch()
    placed = {
        "origin": (0.1, 0.2, -0.3), "scale": 1.5, "axis": "-x", "mirror": "y", "model": "rays", "rotate_z_deg": 30.0,
        "tilt_deg": (4.0, -5.0), "position_mm": (0.5, 0.0, 0.1), "spectrum": {"kind": "line", "wavelength_nm": 620.0},
    }  # fmt: skip
    source = lf.RayfileSource(file=tmp_path / "a.ray", flux_lm=90.0, luminous_efficacy_lm_per_w=200.0, **placed)
    assert {*placed, "flux_lm", "luminous_efficacy_lm_per_w", "file", "kind", "flux_w"} == {
        *lf.RayfileSource.model_fields
    }
    kept = source.model_copy(update={"file": tmp_path / "b.ray"})
    assert source_with_file(source, tmp_path / "b.ray") == kept
    assert [led.source for led in read_sources([tmp_path / "b.ray", tmp_path / "*.ray"], source)] == [kept, kept]
    table = tmp_path / "leds.csv"
    table.write_text("file,flux_w\nb.ray,0.25\n", encoding="utf-8")
    (of_table,) = read_sources([table], source)
    lit = {"flux_w": 0.25, "flux_lm": None}
    assert of_table.source == kept.model_copy(update=lit)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("*.ray", "", "no file of this pattern"),
        ("none.ray", "", "no such file"),
        ("none.toml", "", "no such file"),
        ("a.toml", "x = 1\n", r"has no \[\[sources\]\]"),
        ("a.toml", '[[sources]]\nname = "a"\nsource = { kind = "sqare" }\n', "did you mean square"),
        ("a.csv", "file,lumens\nled.ray,1\n", "line 1: 'lumens'; the columns are file, name"),
        ("a.csv", "name,flux_lm\na,1\n", "no column file"),
        ("a.csv", "file,flux_lm,flux_lm\nled.ray,100,900\n", "line 1, column 3: 'flux_lm' is there twice"),
        ("a.csv", "file,flux_lm\nled.ray,many\n", "line 2, flux_lm: 'many'"),
        ("a.csv", "file,flux_lm\nled.ray,1,2\n", "line 2: 3 cells, line 1 has 2"),
        ("a.csv", "file,name\nled.ray,a\n,b\n", "line 3: must have a file"),
        (
            "a.csv",
            f"file\n{'x' * 140_000}\n",
            "line 2: RayfileSource: file = .*: 140\\d\\d\\d characters, a path has 4096",
        ),
        ("a.csv", "file,flux_lm\nled.ray,-1\n", "line 2: RayfileSource: flux_lm = -1"),
        ("a.csv", "file,flux_lm,flux_w\nled.ray,-1,0\n", "line 2: RayfileSource: .*; RayfileSource: "),
        ("a.csv", "file\nnone.ray\n", "no such file"),
    ],
)
def test_a_bad_list_is_one_line(name: str, content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "led.ray").write_bytes(b"")
    if content:
        (tmp_path / name).write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=message) as raised:
        read_sources([tmp_path / name if name != "*.ray" else str(tmp_path / "x*.ray")], SPEC.source)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        ("**x/*.ray", "not usable as a pattern"),
        ("*" * 300, "not usable as a pattern"),
        ("*/" * 2000, "it has too many parts"),
        ("**/a/**/b/**", "may stand 2 times"),
        ("a\0*", "cannot be printed"),
        ("x" * 300 + "[1].ray", "no file of this pattern"),
        ("x" * 300, "cannot be read"),
        ("**/*.many", "more than 100 files; narrow the pattern"),
        ("~/led.ray", "~ does not stand for the home folder"),
    ],
)
def test_a_pattern_that_is_none_is_one_line(
    pattern: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in range(101):
        (tmp_path / f"{number}.many").write_bytes(b"")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=message) as raised:
        read_sources([pattern], SPEC.source)
    assert str(raised.value).isprintable() and len(str(raised.value)) < 500


def test_patterns_name_files_alone_and_what_is_called_like_one_is_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a" / "b.ray").mkdir(parents=True)
    for name in ("a/c.ray", "a/b.ray/d.ray", "led[1].ray", "led1.ray"):
        (tmp_path / name).write_bytes(b"")
    monkeypatch.chdir(tmp_path)
    for pattern, names in (("led[1].ray", ["led_1"]), ("led?.ray", ["led1"]), ("**/**/**/[b-d].ray", ["d", "c"])):
        assert [led.name for led in read_sources([pattern], SPEC.source)] == names


@pytest.mark.parametrize(
    "content",
    [b"file\rl0.ray\rl1.ray", "\ufefffile;flux (lm)\r\nl0.ray;100,5\r\nl1.ray;\r\n".encode("utf-16")],
    ids=["Macintosh", "German Excel"],
)
def test_tables_of_other_programs_are_read(content: bytes, tmp_path: Path) -> None:
    for name in ("l0.ray", "l1.ray"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "T.CSV").write_bytes(content)
    source = lf.SquareSource(side_mm=1.0, flux_w=0.5)
    first, second = read_sources([tmp_path / "T.CSV"], source)
    assert (first.name, second.name, second.source.flux_w, second.source.flux_lm) == ("l0", "l1", 0.5, None)
    stated = (None, 100.5) if b"f\0l\0u\0x" in content else (0.5, None)
    assert (first.source.flux_w, first.source.flux_lm) == stated


def test_leds_need_names_of_their_own() -> None:
    with pytest.raises(InputError, match="two have the name 'small'"):
        require_told_apart([SPEC.sources[0]] * 2)
    with pytest.raises(InputError, match="small given; a study of LEDs takes 2 to 100"):
        require_told_apart(SPEC.sources[:1])
    capital, common = (SPEC.sources[0].model_copy(update={"name": name}) for name in ("SMALL", "One_for_all"))
    with pytest.raises(InputError, match="'small' and 'SMALL' differ by letter case alone"):
        require_told_apart([*SPEC.sources, capital])
    with pytest.raises(InputError, match="One_for_all is the name of the design for all of them; rename the LED"):
        sources_of([*SPEC.sources, common], SPEC).variants(SPEC)
    with pytest.raises(InputError, match="101 given"):
        require_told_apart([SPEC.sources[0].model_copy(update={"name": f"led{number}"}) for number in range(101)])
    with pytest.raises(InputError, match="field, values or scale, and source"):
        lf.sweep(SPEC, "constraints.max_radius_mm", [7.0, 8.0], source=SPEC.sources)
    with pytest.raises(InputError, match="a list of sources"):
        lf.sweep(SPEC, source="led.ray")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sources": [LEDS[0], LEDS[0]]}, "two have the name 'small'"),
        ({"sources": [*LEDS, {**LEDS[0], "name": "Wide"}]}, "'wide' and 'Wide' differ by letter case alone"),
        ({"sources": LEDS, "source": LEDS[1]["source"]}, "source and sources: both are given"),
    ],
)
def test_sources_of_a_spec_that_cannot_be_are_one_line(changes: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        small_spec(**{"source": None, **changes})


def test_several_specs_are_designed_in_one_call(
    study: tuple[Path, Sweep], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    made = []

    def run(spec: lf.Spec, folder: Path, *_args: object, **_options: object) -> lf.Run:
        if spec.name == "b":
            raise InputError("target: too far")
        made.append((spec.name, str(folder)))
        copied(study[0] / "small-small", folder)
        return lf.load(folder)

    monkeypatch.setattr("lensforge.cli.design.run_with_progress", run)
    for name in "abc":
        SPEC.replace(name=name).save(f"{name}.toml")
    ended = lensforge("design", "a.toml", "b.toml", "c.toml", "--quiet")
    assert made == [("a", "cad_out/a"), ("c", "cad_out/c")]
    assert ended.code == 2 and "lensforge: b: target: too far" in ended.stderr.splitlines()
    shutil.copy("a.toml", "d.toml")
    for arguments, message in (
        (("a.toml", "d.toml"), "two have the name 'a'"),
        (("a.toml", "c.toml", "--out", "x"), "--out: goes with one SPEC, 2 are given"),
        (("a.toml", "c.toml", "--resume"), "--resume: goes with one SPEC"),
        (("a.toml", "none.toml"), "none.toml: no such file"),
    ):
        ended = lensforge("design", *arguments)
        assert ended.code == 2 and message in ended.stderr and ended.stderr.count("\n") == 1
    assert len(made) == 2


def test_a_design_for_each_led_is_a_study_of_its_own_folder(
    study: tuple[Path, Sweep], examples: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    def run(spec: lf.Spec, folder: Path, *_args: object, **_options: object) -> None:
        made = study[0] / spec.name
        copied(made if made.exists() else study[0] / "small-small", folder)

    monkeypatch.setattr("lensforge.cli.studies.run_with_progress", run)
    SPEC.save("lens.toml")
    ended = lensforge("design", "lens.toml", "--sources", "lens.toml", "--accuracy", "draft")
    assert ended.code in (0, 1) and "small in one lens for all" in ended.stdout
    assert Sweep.read(Path("cad_out/small_sources")).values == ("small", "wide", ONE_FOR_ALL)
    for name in ("a.tm25ray", "b.tm25ray"):  # the shell writes a pattern out: the first is the option's value
        shutil.copy(examples / "led.tm25ray", name)
    options = "--accuracy", "draft", "--out", "listed"
    ended = lensforge("design", "lens.toml", "--sources", "a.tm25ray", "b.tm25ray", *options)
    assert ended.code in (0, 1) and Sweep.read(Path("listed")).values == ("a", "b")
    bad = lensforge("design", "lens.toml", "--sources", "none.ray")
    assert bad.code == 2 and "none.ray: no such file" in bad.stderr


def test_a_lens_for_another_led_begins_at_the_old_one(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = {}
    monkeypatch.setattr("lensforge.search.searches.design", lambda spec, **options: asked.update(spec=spec, **options))
    old = design(small_spec(lens__symmetry="square", optimise=STEPS), accuracy=FEW, seed=4).lens
    lf.redesign(old, lf.SquareSource(side_mm=0.5, flux_lm=100.0), threads=1)
    spec = asked["spec"]
    assert asked["start"] is old and (asked["accuracy"], asked["seed"], asked["threads"]) == (FEW, 4, 1)
    assert (spec.source.side_mm, spec.lens.levels, spec.lens.symmetry) == (0.5, "auto", "square")
    assert spec.name == "small-0_5_mm_square_Lambertian_source"
    lf.redesign(old, lf.RectangleSource(width_mm=0.5, height_mm=0.6), accuracy="standard")
    assert asked["spec"].lens.symmetry == "auto" and asked["accuracy"] == "standard"


def test_a_change_of_the_led_is_compared_with_a_lens_made_for_it(
    study: tuple[Path, Sweep], examples: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    source, asked = examples / "led.tm25ray", []
    copied(study[0] / "small-small", Path("old"))

    def renewed(lens: lf.Lens, file: Path, **_options: object) -> lf.Design:
        asked.append((lens.spec.name, file))
        return load_results(study[0] / "small-wide").design

    monkeypatch.setattr("lensforge.cli.studies.redesign", renewed)
    ended = lensforge("evaluate", "old", "--source", source, "--compare", "--json")
    content = json.loads(ended.stdout)
    assert ended.code == 0 and content["renewed"]["folder"] == "old-led" and asked == [("small-small", source)]
    before, after = content["evaluate_led"]["efficiency"], content["renewed"]["evaluate"]["efficiency"]
    assert before["value"] != after["value"] and lf.load("old-led").light.efficiency.value == after["value"]
    other = lensforge("evaluate", "old", "--source", source, "--compare")
    assert other.code == 2 and "old-led: holds a lens for another LED" in other.stderr
    shutil.rmtree("old-led")
    shown = lensforge("evaluate", "old", "--source", source, "--compare")
    assert "A lens made for it, in old-led" in shown.stdout
    bad = lensforge("evaluate", "old", "--compare")
    assert bad.code == 2 and "--compare: with which LED?" in bad.stderr
