"""Every option of every command reaches what it is for: the keyword that hears it, or what is printed and written.

An option without a row fails. The seams are the verbs that a command calls: what they make of a keyword is tested
with them.
"""

import contextlib
import json
import shutil
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click
import pytest
from addon_rows import addon_rows
from click.testing import CliRunner, Result
from far_fields import SMALL_IES
from scenes import small_spec

import lensforge as lf
from lensforge.cli.cli import all_commands, cli
from lensforge.search.checkpoint import CHECKPOINT
from lensforge.verbs import FolderStage

OF_FOLDER = (
    "check", "evaluate", "export", "handover", "photometry", "sensitivity", "verify", "yield",
)  # fmt: skip
BASE = dict.fromkeys(OF_FOLDER, ("{folder}",)) | {
    "compile": ("{spec}",), "design": ("{spec}", "--out", "{out}"), "preview": ("{spec}", "--out", "{out}"),
    "sweep": ("{spec}", "--vary", "source.side_mm=1,2", "--out", "{out}"), "tradeoff": ("{spec}", "--out", "{out}"),
    "report": ("{folder}", "{folder}"),
} | addon_rows("ARGUMENTS")  # fmt: skip
COUNT = {"--rays": ("1.5e3", "rays", 1500), "--threads": ("3", "threads", 3)}
SEARCH = COUNT | {
    "--accuracy": ("draft", "accuracy", "draft"), "--seed": ("7", "seed", 7),
    "--scheduler": ("local:2", "scheduler", "local:2"),
    "--out": ("{tmp}/other", "", "{tmp}/other"),
}  # fmt: skip
FORCE = {"--force": ("", "force", True)}
OPEN = {"--open": ("", "", "click.launch")}
HEARD: dict[str, dict[str, tuple[str, str, Any]]] = {  # arguments, keyword (or any), its value
    "check": {"--process": ("moulded", "process", "moulded")},
    "compile": {"--threads": COUNT["--threads"]},
    "design": SEARCH | FORCE | OPEN | {
        "--rays": ("1.5e3", "rays", 1500), "--sources": ("{led} --sources {other_led}", "sources", "led, other"),
        "--starts": ("4", "starts", 4),
        "--device": ("cuda", "device", "cuda"), "--resume": ("", "checkpoint", Path("{out}") / CHECKPOINT),
    },
    "evaluate": {
        **COUNT, "--pixels": ("48", "pixels", 48), "--source": ("led.ray", "source", Path("led.ray")),
        "--temperature": ("85.5", "temperature_c", 85.5), "--name": ("warm", "name", "warm"),
        "--compare": ("--source led.ray", "", "lensforge.cli.stages.renewed_for"),
    },
    "export": {
        "--schema": ("AP242", "schema", "AP242"),
        "--extension": ("2.5", "extension_deg", 2.5), "--nodes": ("77", "nodes", 77), "--rings": ("30", "rings", 30),
        "--form-nm": ("33", "form_nm", 33.0), "--normal-mrad": ("0.11", "normal_mrad", 0.11),
        "--date": ("2025-03-04", "date", "2025-03-04"),
    },
    "handover": {
        "--spacing": ("0.25", "spacing_mm", 0.25), "--error": ("3.5", "error_nm", 3.5),
        "--interpolation": ("linear", "interpolation", "linear"), "--drawing": ("d.toml", "drawing", Path("d.toml")),
        "--process": ("moulded", "process", "moulded"), "--rays": ("1e3", "rays", 1000),
    },
    "photometry": {
        **COUNT, "--seed": ("5", "seed", 5), "--lumens": ("250", "lumens", 250.0),
        "--ies-version": ("2002", "ies_version", 2002),
    },
    "preview": {key: SEARCH[key] for key in ("--seed", "--threads")} | FORCE | OPEN
    | {"--out": ("{tmp}/other", "", "{tmp}/other/light.png")},
    "report": {"--out": ("{tmp}/two.html", "", "{tmp}/two.html")},
    "sensitivity": COUNT,
    "sweep": SEARCH | {
        "--vary": ("source.side_mm=2,3", "values", (2.0, 3.0)), "--resume": ("", "resume", True),
        "--scale": ("lens.inner.offset_mm", "scaled", ("lens.inner.offset_mm",)),
    },
    "tradeoff": {
        "--most-rays": ("8192", "most_rays", 8192), "--threads": ("3", "", "3"), "--out": SEARCH["--out"],
        "--accuracy": SEARCH["--accuracy"], "--over": ("process", "field", "manufacture.process"),
    },
    "verify": COUNT | {"--stray": ("", "", "stray"), "--base": ("black --stray", "base", "black")},
    "yield": {
        **COUNT, "--parts": ("77", "parts", 77), "--seed": ("7", "seed", 7),
        "--budget": ("--no-budget", "budget", False),
        "--tolerances": ("moulded", "tolerances", "moulded"), "--scheduler": SEARCH["--scheduler"],
    },
} | addon_rows("HEARD")  # fmt: skip
OUTPUT = {"--json": ("", "json", True), "--quiet": ("", "quiet", True)}
Calls = list[tuple[str, tuple[object, ...], dict[str, object]]]


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch, small_run: lf.Run) -> Calls:
    """Arguments of the verbs that commands call; a verb returns the result that its command shows next."""
    heard: Calls = []

    def hear(where: str, returned: object = None) -> None:
        def called(*given: object, **named: object) -> object:
            stage = given[0].name if given and isinstance(given[0], FolderStage) else ""
            heard.append((stage or where, () if stage else given, named))
            return returned

        monkeypatch.setattr(where, called)

    hear("lensforge.verbs.FolderStage.run_in", SimpleNamespace())
    none = SimpleNamespace(vary="", designs=(), failed={}, criteria=(), save=lambda _: None)
    cli_modules = {"stages": ("finish", "finish_handover", "finish_page", "renewed_for", "write_comparison")}
    for module, names in (cli_modules | {"design": ("finish_run",), "studies": ("finish_study",)}).items():
        for name in names:
            hear(f"lensforge.cli.{module}.{name}")
    hear("lensforge.cli.stages.make_handover", SimpleNamespace(notes=(), save=lambda _: None))
    hear("lensforge.report.pipeline.run", small_run)
    hear("lensforge.report.sweep_runs.run_sweep", none)
    hear("lensforge.report.tradeoff_study.run_tradeoff", none)
    hear("lensforge.search.searches.design", small_run.design)
    hear("lensforge.cli.preview_picture.evaluate", small_run.light)
    hear("lensforge.light.evaluation_result.Light.save")
    hear("lensforge.cli.design.Output.show")
    hear("click.launch")
    hear("lensforge.cli.studies.threads_of_torch", nullcontext())
    return heard


def invoked(*arguments: object) -> Result:
    return CliRunner().invoke(cli, list(map(str, arguments)))


def options_of(name: str) -> set[str]:
    return {flag for option in all_commands()[name].params if isinstance(option, click.Option) for flag in option.opts}


@pytest.fixture
def places(tmp_path: Path, small_run: lf.Run) -> dict[str, Path]:
    here = {name: tmp_path / name for name in ("folder", "out", "spec")} | {"tmp": tmp_path}
    leds = Path(__file__).parents[2] / "examples" / "led.tm25ray"
    here |= {"led": leds, "other_led": Path(shutil.copy(leds, tmp_path / "other.tm25ray"))}
    for name in ("folder", "out"):
        here[name].mkdir()
    shutil.copy(small_run.folder / "lens.json", here["folder"])
    (here["out"] / CHECKPOINT).touch()
    small_spec().save(here["spec"])
    return here


ROWS = [(name, flag, *row) for name, rows in HEARD.items() for flag, row in {**rows, **OUTPUT}.items()]


@pytest.mark.parametrize(("name", "flag", "value", "keyword", "wanted"), ROWS, ids=[f"{r[0]}{r[1]}" for r in ROWS])
def test_an_option_is_heard(
    name: str, flag: str, value: str, keyword: str, wanted: object, calls: Calls, places: dict[str, Path]
) -> None:
    def given(argument: object) -> Any:
        if isinstance(argument, list | tuple):
            return type(argument)(map(given, argument))
        return type(argument)(str(argument).format(**places)) if isinstance(argument, str | Path) else argument

    def arguments() -> list[object]:
        """What the calls had under the keyword, or all that they had."""
        values: list[object] = []
        for where, args, named in calls:
            parts = [*args, *named.values()]
            fields = {k: v for part in parts if hasattr(part, "__dict__") for k, v in vars(part).items()}
            of_spec = [part.optimise.rays for part in parts if isinstance(part, lf.Spec)] if keyword == "rays" else []
            asked = [({**fields, **named})[keyword]] if keyword in {**fields, **named} else []
            asked = [", ".join(led.name for led in source) for source in asked] if keyword == "sources" else asked
            values += asked + of_spec if keyword else [where, *map(str, parts)]
        calls.clear()
        return values

    base = [given(argument) for argument in BASE[name]]
    without = invoked(name, *base)
    assert without.exception is None or isinstance(without.exception, lf.LensforgeError), without.exception
    before = arguments()
    options = [value] if value.startswith("--no-") else [flag, *given(value).split()]
    done = invoked(name, *base, *options)
    assert done.exception is None or isinstance(done.exception, lf.LensforgeError), done.exception
    after = arguments()
    assert given(wanted) in after and given(wanted) not in before, (before, after, done.output)


@pytest.mark.parametrize("command", ["design", "sweep"])
def test_rays_of_a_search_that_chooses_its_levels_are_refused_by_the_name_that_was_typed(
    command: str, tmp_path: Path
) -> None:
    small_spec(lens__levels="auto", optimise={}).save(tmp_path / "lamp.toml")
    given = ("--vary", "source.side_mm=1,2") if command == "sweep" else ()
    error = invoked(command, tmp_path / "lamp.toml", *given, "--rays", "5e3").exception
    assert isinstance(error, lf.InputError) and str(error).startswith('--rays 5000: with lens.levels = "auto"')


@pytest.mark.parametrize("over", ["tool", "process"])
def test_rays_of_the_longest_evaluation_are_refused_where_no_time_is_measured(over: str, tmp_path: Path) -> None:
    small_spec().save(tmp_path / "lamp.toml")
    error = invoked("tradeoff", tmp_path / "lamp.toml", "--over", over, "--most-rays", "8192").exception
    assert isinstance(error, lf.InputError) and str(error).startswith("--most-rays 8192: goes with --over time")


RAYS = "x_mm,y_mm,z_mm,kx,ky,kz,flux_w\n0,0,0,0,0.6,0.8,0.25\n1,0,0,0,0,1,0.5\n"
LAMP = {"--source": "disc:1", "--target": "rectangle:200x150@300", "--max-radius": "14"}


def printed(*arguments: object) -> str:
    done = invoked(*arguments)
    assert not isinstance(done.exception, lf.InputError), done.exception
    return done.stdout


def of_rays(flag: str, here: Path) -> bool:
    """The summary of a file of two rays, what it is converted to, and its picture."""
    led, lamp, to = here / "led.csv", here / "lamp.ies", here / "to.ies"
    led.write_text(RAYS), lamp.write_text(SMALL_IES)
    summary = json.loads(printed("rays", led, "--json"))
    match flag:
        case "--header":
            return summary["flux"] != json.loads(printed("rays", led, "--json", "--header"))["flux"]
        case "--to" | "--format":
            kinds = {"zemax_binary": here / "a.dat", "tm25": here / "a.tm25ray"}
            given = {name: ("--format", name) if name == "zemax_binary" else () for name in kinds}
            for name, path in kinds.items():
                printed("rays", led, "--to", path, *given[name])
            records = [json.loads(printed("rays", path, "--json")) for path in kinds.values()]
            return [record["format"] for record in records] == list(kinds) and {
                record["rays"] for record in records
            } == {2}
        case "--ies-version":
            printed("rays", lamp, "--to", to, flag, "2002")
            return to.read_text().startswith("IESNA:LM-63-2002")
        case "--model" | "--rays":
            led = Path(__file__).parents[2] / "examples" / "led.tm25ray"
            told = json.loads(printed("rays", led, "--model", "--to", here / "m.tm25ray", "--rays", "3000", "--json"))
            return told["rays"] == json.loads(printed("rays", here / "m.tm25ray", "--json"))["rays"] == 3000
        case "--plot":
            printed("rays", lamp, flag, here / "a.svg")
            return "<svg" in (here / "a.svg").read_text()
    return (summary["rays"], printed("rays", led, "--quiet")) == (2, "")


def of_new(flag: str, here: Path) -> bool:
    """The option changes one field of the spec."""
    other = {
        "--source": "square:2",
        "--target": "disc:120@300",
        "--max-radius": "20",
        "--material": "PC",
        "--cutter": "2",
        "--lens": "reflector",
        "--off-axis": "30",
        "--tilt": "30",
    }
    text, base = other.get(flag, ""), [argument for pair in LAMP.items() for argument in pair]
    if flag in FORCE:
        narrow = {**LAMP, "--source": "square:12", "--target": "beam:2x2"}
        refused, forced = (
            invoked("new", *(argument for pair in narrow.items() for argument in pair), *more) for more in ((), (flag,))
        )
        return isinstance(refused.exception, lf.InputError) and "[source]" in forced.stdout
    if flag == "--thin":
        low = printed("new", "--source", "square:1", "--target", "beam:10", "--max-radius", "12", flag)
        return "groove_radius_mm" in low
    lines = [set(printed("new", *base, *more).splitlines()) for more in ((), (flag, text))]
    word = "150.0, 0.0, 259.808" if flag == "--off-axis" else text.partition(":")[2].split("@")[0].split("x")[0] or text
    return any(word in line for line in lines[1] - lines[0])


SHOWN = {
    "rays": (of_rays, ("--header", "--to", "--format", "--ies-version", "--plot", "--model", "--rays", *OUTPUT)),
    "new": (of_new, (*LAMP, "--off-axis", "--tilt", "--lens", "--thin", "--material", "--cutter", *FORCE)),
    "schema": (lambda *_: printed("schema", "--page").startswith("#") and printed("schema")[0] == "{", ("--page",)),
    "examples": (None, ()),
} | addon_rows("SHOWN")


@pytest.mark.parametrize(("name", "flag"), [(name, flag) for name, (_, flags) in SHOWN.items() for flag in flags])
def test_an_option_is_seen(name: str, flag: str, tmp_path: Path) -> None:
    assert SHOWN[name][0](flag, tmp_path)


@pytest.mark.parametrize("name", sorted(all_commands()))
def test_every_option_has_a_row(name: str) -> None:
    assert options_of(name) == ({*HEARD[name], *OUTPUT} if name in HEARD else set(SHOWN[name][1]))


@pytest.mark.parametrize("quiet", [[], ["--quiet"]])
@pytest.mark.parametrize("told", [{}, {"notes": ("a note",)}, {"notes": ("a note",), "warnings": ("rough", "dark")}])
def test_notes_and_warnings_of_a_result_are_told(
    told: dict[str, tuple[str, ...]],
    quiet: list[str],
    calls: Calls,
    places: dict[str, Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """On standard error, also in silence: of a stage, and the notes of a handover."""
    monkeypatch.setattr("lensforge.verbs.FolderStage.run_in", lambda *_, **__: SimpleNamespace(**told))
    lines = invoked("photometry", places["folder"], *quiet).stderr.splitlines()
    sentences = [sentence for group in told.values() for sentence in group]
    assert [line for line in lines if line.endswith(("a note", "rough", "dark"))] == [
        f"warning: {sentence}" for sentence in sentences
    ]
    made = SimpleNamespace(notes=told.get("notes", ()), save=lambda _: None)
    monkeypatch.setattr("lensforge.cli.stages.make_handover", lambda *_, **__: made)
    lines = invoked("handover", places["folder"], *quiet).stderr.splitlines()
    assert sum(line.endswith("a note") for line in lines) == len(made.notes)


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["{led}", "--format", "tm25"], "--format tm25: give --to FILE with it"),
        (
            ["{lamp}", "--to", "b.ies", "--format", "tm25"],
            "--format tm25: {lamp} is photometric; the suffix of --to, .ies, .ldt or .iesxml, is enough",
        ),
        (
            ["{lamp}", "--to", "b.ldt", "--ies-version", "2002"],
            "--ies-version 2002: give --to FILE.ies with it; other files have no such version",
        ),
        (
            ["{led}", "--model", "--to", "b.tm25ray"],
            "--model with --to FILE needs --rays N, which is for these two alone",
        ),
        (["{led}", "--rays", "20"], "--model with --to FILE needs --rays N, which is for these two alone"),
        (
            ["{lamp}", "--model"],
            "--model {lamp}: of the rays of a ray file; leave it out for a header or a photometric file",
        ),
        (["{led}", "--to", "{led}"], "--to {led}: is the input file; give another name"),
    ],
)
def test_options_of_rays_that_do_not_go_together_are_refused_and_write_nothing(
    tmp_path: Path, options: list[str], line: str
) -> None:
    files = {"led": tmp_path / "led.txt", "lamp": tmp_path / "lamp.ies"}
    files["led"].write_text(RAYS), files["lamp"].write_text(SMALL_IES)
    given = [option.format(**files) for option in options]
    with contextlib.chdir(tmp_path):
        refused = invoked("rays", *given)
    assert isinstance(refused.exception, lf.InputError)
    assert str(refused.exception) == line.format(**files)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"led.txt": RAYS, "lamp.ies": SMALL_IES}
