"""The library as a script meets it: verbs, results that show and plot themselves, folders that come back to the bit."""

import inspect
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from addon_rows import addon_rows
from made_once import copied
from matplotlib.axes import Axes
from nightly import NIGHTLY, first_by_day
from presets import FEW, WITH_TABLE_ERROR
from scenes import small_spec, sphere

import lensforge as lf
from lensforge.report.results import kinds_of_results
from lensforge.results import StageResult
from lensforge.results.record import values_of
from lensforge.verbs import EVALUATE

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def other() -> lf.Design:
    """A draft of another lens than that of the runs."""
    return lf.design(small_spec(), accuracy=FEW)


LENS = lf.Lens.double(sphere(3.0), sphere(6.0), small_spec(), 0, FEW)


def results() -> dict[str, type[StageResult]]:
    """Every class of a result, by its name."""
    kinds, waiting = {}, [StageResult]
    while waiting:
        for kind in waiting.pop().__subclasses__():
            kinds[kind.__name__] = kind
            waiting.append(kind)
    packaged = {name: kind for name, kind in kinds.items() if kind.__module__.startswith("lensforge")}
    return {name: kind for name, kind in packaged.items() if hasattr(kind, "stage")}


def test_a_run_comes_back_to_the_bit(small_run: lf.Run, whole_run: lf.Run) -> None:
    again = lf.load(small_run.folder)
    assert again == small_run
    for stem, result in small_run.found.items():
        for field in values_of(result):
            value, read = getattr(result, field), getattr(again.found[stem], field)
            same = np.array_equal(value, read, equal_nan=True) if isinstance(value, np.ndarray) else value == read
            assert same, f"{stem}.{field}"
    assert again != whole_run, "another folder, and more in it"


def test_verbs_write_nothing_and_give_what_a_run_gives(
    small_run: lf.Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    design = lf.design(small_spec(optimise__steps_per_level=[40, 40]), accuracy=WITH_TABLE_ERROR)
    run, made = small_run, [lf.evaluate(design.lens)]
    if NIGHTLY:  # half a minute
        made += [lf.build(design.lens)]
        made += [lf.check(made[1]), lf.verify(made[1], made[0])]
    assert not list(tmp_path.iterdir()) and capfd.readouterr() == ("", "")
    assert run.design.lens == design.lens
    for result, of_run in zip(made, (run.light, run.part, run.check, run.proof), strict=False):
        assert result.sha256 == of_run.sha256, type(result).__name__


def test_every_kind_of_result_plots_saves_shows_itself_and_is_a_row(whole_run: lf.Run, tmp_path: Path) -> None:
    seen = set()
    for stem, result in whole_run.found.items():
        seen.add(type(result).__name__)
        assert isinstance(result.plot(), Axes), stem  # type: ignore[attr-defined]
        html = result._repr_html_()
        assert html.startswith("<img") and "<table>" in html
        row = result.row()
        assert row and all(value is None or isinstance(value, float | int | bool | str) for value in row.values())
        result.save(tmp_path / f"{stem}.json")
        assert json.loads((tmp_path / f"{stem}.json").read_text())["schema"] == f"lensforge-{result.stage}-3"
        with pytest.raises(lf.InputError, match="saved as one of"):
            result.save(tmp_path / "result.docx")
    assert whole_run.check.plot().figure.axes[-1].get_ylabel().startswith("outer: "), "the last face"
    whole_run.design.save(tmp_path / "design.png")  # as every page above has it
    assert (tmp_path / "design.png").read_bytes().startswith(b"\x89PNG")
    assert seen == {cls.__name__ for cls in kinds_of_results()}


def test_records_name_schema_version_and_inputs(whole_run: lf.Run) -> None:
    for stem, result in whole_run.found.items():
        content = json.loads((whole_run.folder / f"{stem}.json").read_text(encoding="utf-8"))
        assert content["schema"] == f"lensforge-{result.stage}-3"
        assert content["version"] == lf.__version__
        assert content["inputs"]["lens"] == whole_run.lens.sha256, stem
        assert result.inputs == content["inputs"]
    assert whole_run.proof.inputs["export"] == whole_run.part.sha256
    record = json.loads((whole_run.folder / "run.json").read_text(encoding="utf-8"))
    assert record["verdict"]["files"] in ("pass", "fail", "undecided")
    assert record["results"]["evaluate"] == whole_run.light.sha256


def test_results_of_another_lens_count_as_not_run(small_run: lf.Run, other: lf.Design, tmp_path: Path) -> None:
    copied(small_run.folder, tmp_path / "run")
    other.lens.save(tmp_path / "run" / "lens.json")
    mixed = lf.load(tmp_path / "run")
    assert mixed.missing == ["design", "evaluate", "export", "check", "verify", "photometry"]
    assert "another lens" in mixed.outdated["evaluate"] and small_run.light is not None
    with pytest.raises(lf.MissingResult, match="another lens"):
        _ = mixed.light


def test_mesh_and_files_are_the_user_s_own(whole_run: lf.Run, tmp_path: Path) -> None:
    part = whole_run.part
    assert part.mesh.is_watertight
    assert part.mesh.volume == pytest.approx(part.volume_mesh_mm3, rel=1e-6)
    for suffix, content in ((".step", part.step), (".stl", part.stl), (".3mf", part.threemf)):
        part.save(tmp_path / f"mine{suffix}")
        assert (tmp_path / f"mine{suffix}").read_bytes() == content


def test_a_search_reports_and_stops(other: lf.Design, tmp_path: Path) -> None:
    seen: list[lf.Progress] = []
    with pytest.raises(lf.Cancelled):
        lf.design(
            small_spec(),
            accuracy=FEW,
            checkpoint=tmp_path / "search.pt",
            progress=lambda step: seen.append(step) or len(seen) < 3,
        )
    assert [step.steps_done for step in seen] == [1, 2, 3] and seen[0].steps_total == 8
    resumed = lf.design(small_spec(), accuracy=FEW, checkpoint=tmp_path / "search.pt")
    assert resumed.lens == other.lens


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: lf.design("pi.toml"), "design: 'pi.toml' is a str, no Spec; read it with load_spec first"),
        (lambda: lf.design({"source": 1}), "no Spec"),
        (lambda: lf.run(Path("pi.toml"), "out"), "no Spec"),
        (lambda: lf.run(small_spec(), 3), "give the path of a result folder"),
        (lambda: lf.design(small_spec(), accuracy="best"), "accuracy = 'best': one of draft, standard, reference"),
        (lambda: lf.design(small_spec(), seed=-1), "seed = -1"),
        (lambda: lf.design(small_spec(), threads=0), "threads = 0"),
        (lambda: lf.design(small_spec(), progress=5), "progress = 5: a function"),
        (lambda: lf.design(small_spec(), checkpoint=5), "checkpoint = 5: give the path"),
        (lambda: lf.evaluate(LENS, seed="x"), "seed = 'x': an integer, at least 0"),
        (lambda: lf.evaluate(LENS, rays=0), "rays = 0: an integer, at least 1"),
        (lambda: lf.evaluate(LENS, pixels=True), "pixels = True"),
        (lambda: lf.evaluate(LENS, source=small_spec().target), "give one of the sources"),
        (lambda: lf.build(LENS, nodes="a"), "nodes = 'a'"),
        (lambda: lf.build(LENS, extension_deg="x"), "extension_deg = 'x': a finite number"),
        (lambda: lf.photometry(LENS, lumens="a"), "lumens = 'a'"),
        (lambda: lf.tradeoff(small_spec(), lens="x"), "must be a Lens"),
        (lambda: lf.tradeoff(small_spec(target__distance_mm=150.0), lens=LENS), "another [target]"),
        (lambda: lf.design(small_spec(), start="lens.json"), "must be a Lens"),
        (lambda: lf.evaluate("cad_out/pi"), "evaluate: 'cad_out/pi' is a str, must be a Lens"),
        (lambda: lf.build(small_spec()), "build: Spec given, must be a Lens: design(spec).lens"),
        (lambda: lf.check("lens.step"), "must be a Part: build(lens)"),
        (lambda: lf.load("nowhere"), "nowhere: no such folder; run `lensforge design` first"),
        (lambda: lf.load(7), "give the path of a result folder"),
        (lambda: lf.load_spec(7), "give the path of a TOML file"),
        (lambda: lf.handover("cad_out/pi"), "must be a Run"),
        (lambda: lf.rays(7), "give the path of a ray file"),
        (lambda: lf.sweep(small_spec(), "constraints.max_radius", [7.0, 8.0]), "no such field"),
        (lambda: lf.tradeoff(small_spec(), most_rays=3), "most_rays = 3"),
        *addon_rows("REFUSED").items(),
        (lambda: lf.RaySource([[0.0] * 7]), "one of them is (0, 0, 0)"),
    ],
)
def test_bad_input_is_one_line(call: Callable[[], object], message: str) -> None:
    with pytest.raises(lf.InputError) as refusal:
        call()
    assert message in str(refusal.value)
    assert len(str(refusal.value).splitlines()) == 1


def test_every_wrong_field_of_a_spec_has_a_line() -> None:
    with pytest.raises(lf.InputError) as refusal:
        lf.Spec()
    lines = str(refusal.value).splitlines()
    assert [line.split(":")[1].strip() for line in lines] == ["source", "constraints"]
    assert all(line.startswith("Spec: ") and "missing" in line for line in lines)


def test_a_folder_without_a_result_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(lf.InputError, match=r"lens\.json: no such file; run `lensforge design` first"):
        lf.load(tmp_path)


def test_light_of_another_source_is_known_as_such(small_run: lf.Run) -> None:
    other = lf.SquareSource(side_mm=1.0, luminous_efficacy_lm_per_w=300.0)
    light = lf.evaluate(small_run.lens, source=other, rays=256)
    assert light.lumens_per_watt == 300.0
    assert light.inputs["source"] != small_run.light.inputs["source"]
    with pytest.raises(lf.InputError, match="another source"):
        lf.verify(small_run.part, light)


@pytest.mark.parametrize(
    "damage",
    first_by_day(
        2, ["no JSON", "other arrays", "other files", "an extra that nobody makes again"], "more cases of the same"
    ),
)
def test_a_stage_that_is_run_again_mends_a_damaged_record(small_run: lf.Run, tmp_path: Path, damage: str) -> None:
    folder = tmp_path / "run"
    copied(small_run.folder, folder)
    if damage == "no JSON":
        (folder / "evaluate.json").write_text("{")
    elif damage == "other arrays":
        with np.load(folder / "evaluate.npz") as archive:
            arrays = dict(archive)
        np.savez(folder / "evaluate.npz", **(arrays | {"receivers.0.map": 2.0 * arrays["receivers.0.map"]}))
    elif damage == "other files":
        (folder / "evaluate.npz").write_bytes((folder / "check.npz").read_bytes())
    else:
        (folder / "stray.json").write_text("[]")
    with pytest.raises(lf.InputError):
        lf.load(folder)
    assert EVALUATE.run(folder).sha256 == small_run.light.sha256
    (folder / "stray.json").unlink(missing_ok=True)
    assert lf.load(folder).light.sha256 == small_run.light.sha256


def test_a_proof_without_its_part_counts_as_not_run(small_run: lf.Run, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    copied(small_run.folder, folder)
    (folder / "export.json").unlink()
    assert "is missing" in lf.load(folder).outdated["verify"]


def test_a_record_is_saved_without_touching_the_files_beside_it(small_run: lf.Run, tmp_path: Path) -> None:
    (tmp_path / "lens.step").write_bytes(b"another part's")
    small_run.part.save(tmp_path / "part.json")
    assert {path.name for path in tmp_path.iterdir()} == {"lens.step", "part.json"}
    assert (tmp_path / "lens.step").read_bytes() == b"another part's"


def test_light_of_another_lens_does_not_verify_a_part(whole_run: lf.Run, other: lf.Design) -> None:
    with pytest.raises(lf.InputError, match="another lens"):
        lf.verify(whole_run.part, lf.evaluate(other.lens, rays=256))


SCRIPT = ROOT / "examples" / "design_to_step.py"


def test_the_shortest_script_is_that_of_the_readme_and_its_spec_is_valid() -> None:
    lines = [line for line in SCRIPT.read_text(encoding="utf-8").splitlines() if line and not line.startswith('"""')]
    assert len(lines) <= 10 and sum("import" in line for line in lines) == 1
    assert "\n".join(lines) in (ROOT / "README.md").read_text(encoding="utf-8").replace("\n\n", "\n")
    namespace: dict[str, object] = {}
    exec("\n".join(lines[: next(row for row, line in enumerate(lines) if "lf.design(" in line)]), namespace)
    assert isinstance(namespace["spec"], lf.Spec)


@pytest.mark.nightly("more than a minute; by day each of its verbs is called")
def test_the_shortest_script_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(SCRIPT.read_text(encoding="utf-8"), SCRIPT, "exec"), {})
    assert {path.name for path in tmp_path.iterdir()} == {"spot.step", "spot.png"}
    assert "every criterion is met" in capsys.readouterr().out


PLOTTED = (
    lf.Design, lf.Light, lf.Part, lf.Check, lf.Proof, lf.StrayLight, lf.Sensitivity, lf.Photometry,
    *addon_rows("RESULTS").values(), lf.Sweep, lf.Tradeoff, lf.RayFileSummary, lf.PhotometricSummary, lf.Yield,
)  # fmt: skip

_WRONG = """
import inspect, sys
import numpy as np
import lensforge as lf

def refused(result, *args, **choice):
    try:
        result.plot(*args, **choice)
    except lf.InputError as error:
        return str(error)
    sys.exit(f"{type(result).__name__} plots {args} {choice}")

for cls in (lf.Design, lf.Light, lf.Part, lf.Check, lf.StrayLight, lf.Sensitivity, lf.Sweep, lf.RayFileSummary):
    for name in set(list(inspect.signature(cls.plot).parameters)[2:]) - {"receiver"}:
        for value in ("foo", None, ["nmse"]):
            message = refused(cls.model_construct(), **{name: value})
            assert message.startswith(f"{name} = {value!r}: must be ") and "\\n" not in message, message
for result in lf.load(sys.argv[1]).found.values():
    for axes in ("map", 3, np.zeros(2)):
        message = refused(result, axes)
        assert message.startswith(f"axes: is of type {type(axes).__name__}, must be a matplotlib Axes"), message
    if "receiver" in inspect.signature(result.plot).parameters:
        assert result.plot(receiver=result.first.name) is not None
        for value in ("foo", 3, ["nmse"]):
            message = refused(result, receiver=value)
            assert message.startswith(f"receiver = {value!r}: must be ") and "\\n" not in message, message
print("all refused")
"""


def test_every_plot_takes_axes_first_and_choices_by_name() -> None:
    assert set(results().values()) == set(PLOTTED)
    for cls in PLOTTED:
        axes, *choices = list(inspect.signature(cls.plot).parameters.values())[1:]
        assert (axes.name, axes.kind, axes.default) == ("axes", axes.POSITIONAL_OR_KEYWORD, None), cls
        for choice in choices:
            assert choice.kind == choice.KEYWORD_ONLY and choice.default is not choice.empty, (cls, choice)


@pytest.mark.nightly("a process with every result")
def test_what_cannot_be_plotted_is_one_line(whole_run: lf.Run) -> None:
    run = subprocess.run([sys.executable, "-c", _WRONG, str(whole_run.folder)], capture_output=True, encoding="utf-8")
    assert (run.returncode, run.stdout) == (0, "all refused\n"), run.stderr
