"""A sweep varies what it says, keeps what is finished, and shows each design's own figures."""

import csv
import json
import re
import shutil
from itertools import pairwise

import numpy as np
import pytest
from PIL import Image
from presets import FEW
from scenes import small_spec
from undrawn import undrawn

import lensforge as lf
from lensforge import build, check, design, evaluate
from lensforge.cli.conclusion import table_of
from lensforge.errors import InputError
from lensforge.report.results import Results
from lensforge.report.stored import load_results
from lensforge.report.sweep import Sweep, sweep_of
from lensforge.report.sweep_runs import files_of_run, resumable, run_sweep, sweep_figure, write_run
from lensforge.report.variation import parse_variation, tool_study, variation_of
from lensforge.results.criteria import require
from lensforge.scene.lens import load_lens
from lensforge.search.checkpoint import CHECKPOINT

pytestmark = pytest.mark.usefixtures("undrawn")

SPEC = small_spec(optimise={"steps_per_level": [2, 2], "rays": 256, "pixels": 16}, base={"kind": "none"})
SCALED = ("lens.inner.offset_mm", "lens.outer.offset_mm")
SETTINGS = {"accuracy": FEW, "seed": 3}


class Designer:
    """Designs and evaluates only, and remembers what it was asked for."""

    def __init__(self) -> None:
        self.made: list[str] = []

    def __call__(self, spec, folder, resume) -> None:
        result = searched(spec, folder, resume)
        result.lens.save(folder / "lens.json")
        result.write(folder)
        (folder / CHECKPOINT).unlink()
        evaluate(result.lens).write(folder)
        self.made.append(folder.name)


def searched(spec, folder, resume=False, progress=None):
    return design(spec, accuracy=FEW, seed=3, checkpoint=folder / CHECKPOINT, resume=resume, progress=progress)


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep")
    variation = parse_variation("constraints.max_radius_mm=8,6.5", SCALED)
    with undrawn():
        return folder, run_sweep(SPEC, variation, folder, Designer(), **SETTINGS)


def test_every_design_is_the_spec_with_its_own_value(swept):
    folder, content = swept
    assert content.values == (6.5, 8.0)
    for row in content.designs:
        lens = load_lens(folder / row.folder / "lens.json")
        assert lens.seed == 3 and lens.accuracy == FEW
        assert content.inputs[row.folder] == lens.sha256
        assert lens.spec.name == row.folder
        assert lens.spec.constraints.max_radius_mm == row.value
        assert lens.spec.lens.inner.offset_mm == pytest.approx(3.0 * row.value / 7.0)
        assert lens.spec.lens.outer.offset_mm == pytest.approx(6.0 * row.value / 7.0)
        same = {"name", "lens", "constraints"}
        assert lens.spec.model_dump(exclude=same) == SPEC.model_dump(exclude=same)


METRICS = ("nmse", "uniformity", "rsd", "efficiency", "share_in_target")
SIZES = ("max_radius_mm", "height_mm", "steps")


def test_every_number_of_a_row_is_of_the_files_of_its_design(swept):
    """Record, facts and cells of the table are by the folders' records, which are unlike; nothing else is stated."""
    folder, content = swept
    table = list(csv.DictReader((folder / "sweep.csv").read_text(encoding="utf-8").splitlines()))
    stored = json.loads((folder / "sweep.json").read_text(encoding="utf-8"))["designs"]
    for group, row, cells, value in zip(content.facts, stored, table, (6.5, 8.0), strict=True):
        name = f"small-{value:g}".replace(".", "_")
        light, of_design = (
            json.loads((folder / name / f"{stage}.json").read_text()) for stage in ("evaluate", "design")
        )
        changes = {"constraints.max_radius_mm": value}
        changes |= {field: pytest.approx(start * value / 7.0) for field, start in zip(SCALED, (3.0, 6.0), strict=True)}
        expected = {
            "value": value, "folder": name, "changes": changes, **{key: light[key] for key in METRICS},
            **{key: of_design[key] for key in (*SIZES, "seconds", "constraints")}, "cutting": "undecided", "by_led": {},
            "criteria": of_design["criteria"] + light["criteria"],
        }  # fmt: skip
        assert row == expected
        facts = {key: (change, None, "") for key, change in changes.items()}
        for key in METRICS:
            factor, unit = (100.0, "%") if key in ("efficiency", "share_in_target") else (1.0, "")
            pair = (pytest.approx(factor * light[key][part], rel=1e-12) for part in ("value", "standard_error"))
            facts[key] = (*pair, unit)
        keys = zip(("radius", "height", "steps"), ("mm", "mm", ""), SIZES, strict=True)
        facts |= {key: (of_design[size], None, unit) for key, unit, size in keys}
        facts |= {"criteria": ("all met", None, ""), "cutting": ("undecided", None, "")}
        assert {fact.key: (fact.value, fact.standard_error, fact.unit) for fact in group.facts} == facts
        assert numbers_in(cells) == numbers_in(content.designs[stored.index(row)].row())
        for key in METRICS:
            assert float(cells[f"{key}.value"]) == pytest.approx(light[key]["value"], rel=1e-9)
        assert [float(cells[key]) for key in SIZES] == pytest.approx([of_design[key] for key in SIZES])
    assert len({cells["nmse.value"] for cells in table}) == len({cells["max_radius_mm"] for cells in table}) == 2


def numbers_in(cells):
    return {key: str(value) for key, value in cells.items() if value not in (None, "")}


def test_the_screen_has_a_table_of_what_differs_and_of_the_verdicts(swept):
    """Each figure stands under its label, in the line of its design; no line is wider than 120 columns."""
    groups = swept[1].facts
    lines = list(table_of(groups))
    assert max(map(len, lines)) <= 120 and len(lines) % 3 == 0
    told = {}
    for head, *rows in zip(*[iter(lines)] * 3, strict=True):
        starts = [match.start() for match in re.finditer(r"\S+(?: \S+)*", head)]
        for begin, end in pairwise([*starts, 999]):
            told[head[begin:end].strip()] = [row[begin:end].strip() for row in rows]
        assert [row.split()[0] for row in rows] == [group.title for group in groups]
    columns = zip(*(group.facts for group in groups), strict=True)
    facts = {pair[0].label: [" ".join(fact.text.split()) for fact in pair] for pair in columns}
    verdicts = {"Criteria", "Manufacture"}
    assert told == {label: texts for label, texts in facts.items() if label in verdicts or texts[0] != texts[1]}
    assert facts.keys() > told.keys() > verdicts, "both took as many steps"
    assert all(label in " ".join(table_of(groups[:1])) for label in facts), "of one design all figures are told"


def test_the_plot_shows_the_figures_of_the_designs(swept):
    folder, content = swept
    figure = sweep_figure(content)
    assert content.plot().get_xlabel() == "constraints: max radius (mm)"
    named = ("roads.0.pole_spacing_m", "lens.temperature_c", "limits.1.exposure_s", "optimise.pixels", "source")
    labels = [content.changed(vary=field).label for field in named]
    with_units = ["roads.0: pole spacing (m)", "lens: temperature (°C)", "limits.1: exposure (s)"]
    assert labels == [*with_units, "optimise: pixels", "source"]
    drawn = {axes.get_ylabel(): axes.containers[0][0].get_xydata() for axes in figure.axes}
    for row, nmse, efficiency in zip(content.designs, *drawn.values(), strict=True):
        assert np.array_equal(nmse, [row.value, row.nmse.value])
        assert np.array_equal(efficiency, [row.value, row.efficiency.value])
    assert np.array_equal(content.plot(metric="efficiency").lines[0].get_xydata(), list(drawn.values())[1])
    with pytest.raises(InputError, match=r"^metric = 'foo': must be one of nmse, "):
        content.plot(metric="foo")
    with pytest.raises(ValueError, match="designs: must have rising values"):
        type(content)(**{**dict(content), "designs": content.designs[::-1]})
    page = (folder / "sweep.html").read_text(encoding="utf-8")
    assert all(f'href="{row.folder}/report.html"' in page for row in content.designs)


def test_finished_designs_are_kept_and_new_values_added(swept):
    folder, content = swept
    lens = (folder / content.designs[0].folder / "lens.json").read_bytes()
    again = Designer()
    grown = run_sweep(
        SPEC, parse_variation("constraints.max_radius_mm=6.5,7", SCALED), folder, again, **SETTINGS, resume=True
    )
    assert again.made == ["small-7"]
    assert grown.values == (6.5, 7.0, 8.0)
    assert grown.designs[0] == content.designs[0] and grown.designs[2] == content.designs[1]
    assert (folder / content.designs[0].folder / "lens.json").read_bytes() == lens
    assert Sweep.read(folder) == grown


@pytest.mark.nightly("a sweep of its own; by day finished designs are kept, above")
def test_an_interrupted_sweep_goes_on_within_the_design(tmp_path):
    class Interrupted(Designer):
        def __call__(self, spec, folder, resume) -> None:
            if self.made:
                searched(spec, folder, progress=lambda step: _stop_at(step, 2))
            super().__call__(spec, folder, resume)

    def _stop_at(step, count):
        if step.steps_done == count:
            raise KeyboardInterrupt

    variation = parse_variation("constraints.max_radius_mm=8,6.5", SCALED)
    with pytest.raises(KeyboardInterrupt):
        run_sweep(SPEC, variation, tmp_path, Interrupted(), **SETTINGS)
    assert Sweep.read(tmp_path).values == (6.5,)
    resumed: list[bool] = []

    class Watched(Designer):
        def __call__(self, spec, folder, resume) -> None:
            resumed.append(resume)
            super().__call__(spec, folder, resume)

    run_sweep(SPEC, variation, tmp_path, Watched(), **SETTINGS, resume=True)
    assert resumed == [True]
    straight = tmp_path / "straight"
    run_sweep(SPEC, variation, straight, Designer(), **SETTINGS)
    for name in ("small-6_5", "small-8"):
        assert (tmp_path / name / "lens.json").read_bytes() == (straight / name / "lens.json").read_bytes()


def test_words_of_a_choice_keep_their_order_and_say_what_each_process_makes_of_the_lens(tmp_path):
    variation = parse_variation("manufacture.process=printed, none,printed")
    swept = run_sweep(SPEC, variation, tmp_path, Designer(), **SETTINGS)
    assert swept.values == ("printed", "none") and Sweep.read(tmp_path) == swept
    specs = [load_lens(tmp_path / row.folder / "lens.json").spec for row in swept.designs]
    assert [spec.manufacture.process for spec in specs] == ["printed", "none"]
    assert [row.folder for row in swept.designs] == ["small-printed", "small-none"]
    told = [group.fact("cutting").text for group in swept.facts if group.key == "design"]
    assert told == ["undecided", "undecided"], "not checked yet"
    study = swept.changed(designs=(swept.designs[0], swept.designs[1].changed(cutting="none")))
    assert study.facts[1].fact("cutting").text == "not judged"


@pytest.mark.parametrize(
    ("manufacture", "field", "radii_mm"),
    [
        ({"process": "milled", "cutter_radius_mm": 0.8}, "cutter_radius_mm", (0.2, 0.4, 0.8, 1.6)),
        ({"process": "moulded", "cutter_radius_mm": 1.2, "shrinkage": 0.01}, "cutter_radius_mm", (0.3, 0.6, 1.2, 2.4)),
        ({"process": "turned", "nose_radius_mm": 0.04}, "nose_radius_mm", (0.01, 0.02, 0.04, 0.08)),
    ],
)
def test_a_study_of_tools_has_the_radius_of_what_cuts_the_lens_from_a_quarter_to_twice(manufacture, field, radii_mm):
    spec = SPEC.replace(manufacture=manufacture)
    varied, variation = tool_study(spec, "tool")
    assert (varied, variation.field) == (spec, f"manufacture.{field}")
    assert variation.values == pytest.approx(radii_mm)
    radii = [getattr(variant.spec.manufacture, field) for variant in variation.variants(varied)]
    assert radii == pytest.approx(radii_mm)


def test_a_study_of_processes_has_each_without_the_fields_of_another():
    spec = SPEC.replace(manufacture={"process": "moulded", "shrinkage": 0.01, "cutter_radius_mm": 0.8})
    variants = tool_study(spec, "process")[1].variants(tool_study(spec, "process")[0])
    shops = [variant.spec.manufacture for variant in variants]
    assert [shop.process for shop in shops] == ["milled", "turned", "moulded", "printed", "none"]
    assert {(shop.shrinkage, shop.cutter_radius_mm) for shop in shops} == {(0.0, 0.8)}
    linear = small_spec(
        lens={"kind": "extruded", "length_mm": 40.0, "profile": 9}, base={"kind": "none"}, optimise__steps_per_level=[1]
    )
    assert tool_study(linear, "process")[1].values == ("milled", "turned", "moulded", "extruded", "printed", "none")
    with pytest.raises(InputError, match='process = "printed": no tool cuts the lens'):
        tool_study(SPEC.replace(manufacture={"process": "printed"}), "tool")


def test_light_over_tools_is_drawn_by_a_line_and_over_processes_by_points_alone(swept):
    _, study = swept
    over_tools = study.changed(vary="manufacture.cutter_radius_mm")
    drawn = sweep_figure(over_tools).axes[0]
    assert drawn.get_xlabel() == "radius of the ball (mm)" and drawn.lines[0].get_linestyle() == "-"
    designs = [row.changed(value=name) for row, name in zip(study.designs, ("milled", "none"), strict=True)]
    drawn = sweep_figure(study.changed(vary="manufacture.process", designs=tuple(designs))).axes[0]
    assert [text.get_text() for text in drawn.get_xticklabels()] == ["milled", "none"]
    assert drawn.lines[0].get_linestyle() == "None"


def test_another_sweep_is_not_resumed(swept):
    folder, _ = swept
    vary = parse_variation("constraints.max_radius_mm=6.5,8", SCALED)
    other, unscaled = (
        parse_variation("lens.outer.offset_mm=5.5,6"),
        parse_variation("constraints.max_radius_mm=6.5,8"),
    )
    for difference, spec, variation, settings in (
        ("seed", SPEC, vary, SETTINGS | {"seed": 4}),
        ("accuracy", SPEC, vary, SETTINGS | {"accuracy": "standard"}),
        ("spec", small_spec(), vary, SETTINGS),
        ("field", SPEC, other, SETTINGS),
        ("scaled fields", SPEC, unscaled, SETTINGS),
    ):
        with pytest.raises(InputError, match=f"a sweep with another {difference}"):
            run_sweep(spec, variation, folder, Designer(), **settings, resume=True)


@pytest.mark.parametrize(
    ("text", "scaled", "message"),
    [
        ("constraints.max_radius_mm=a,b", (), "max_radius_mm = 'a': must be a number"),
        ("manufacture.process=none,1", (), "with numbers or words as values"),
        ("manufacture.process=none,none", (), "1 words; give 2 to 100 different ones"),
        ("manufacture.process=none,cast", (), "manufacture.process = 'cast': must be 'milled'"),
        ("manufacture.process=none,milled", ("lens.inner.offset_mm",), "cannot keep its ratio to manufacture.process"),
        ("constraints.max_radius_mm=7", (), "1 values"),
        ("constraints.max_radius_mm=7,inf", (), "finite"),
        ("constraints.max_radius_mm=7,8", ("constraints.max_radius_mm",), "name others"),
        ("constraints.max_radius=7,8", (), "no such field.*max_radius_mm"),
        ("lens.sigma_c=1,-2", (), r"lens\.sigma_c = -2"),
        ("constraints.max_radius_mm=7,8", ("lens.symmetry",), "can be scaled"),
        ("constraints.max_radius_mm=7,800", (), "must exceed constraints.max_radius_mm"),
    ],
)
def test_bad_variations_are_one_line(text, scaled, message, tmp_path):
    designer = Designer()
    with pytest.raises(InputError, match=message):
        run_sweep(SPEC, parse_variation(text, scaled), tmp_path, designer)
    assert not designer.made


@pytest.mark.nightly("a sweep of its own")
@pytest.mark.parametrize(
    ("values", "message"),
    [
        ("14.0000001,8,14.0000002", "14.0000001 and 14.0000002: both designs would go to the folder small-14"),
        ("1e6,1000000.1", "1000000.0 and 1000000.1: both designs would go to the folder small-1e06"),
    ],
)
def test_values_whose_designs_would_share_a_folder_are_refused_before_the_first(values, message, tmp_path):
    variation = parse_variation(f"constraints.max_radius_mm={values}")
    with pytest.raises(InputError, match=message):
        run_sweep(SPEC, variation, tmp_path, pytest.fail, **SETTINGS)
    with pytest.raises(InputError, match=message):
        lf.sweep(SPEC, variation.field, variation.values)
    assert not list(tmp_path.iterdir())
    kept = parse_variation("constraints.max_radius_mm=14.0001,14.0002,8").variants(SPEC.replace({"name": "a"}))
    assert [variant.spec.name for variant in kept] == ["a-8", "a-14_0001", "a-14_0002"]


def test_a_value_never_replaces_the_design_of_another_that_is_finished(swept):
    folder, _ = swept
    variation = parse_variation("constraints.max_radius_mm=6.5000001,9", SCALED)
    with pytest.raises(InputError, match=r"small-6_5: holds the design of 6.5, that of 6.5000001 would go there"):
        run_sweep(SPEC, variation, folder, pytest.fail, resume=True, **SETTINGS)


def test_criteria_are_named_by_their_design(tmp_path):
    def whole(spec, folder, resume) -> None:
        Designer()(spec, folder, resume)
        if spec.name == "small-7":
            part = build(load_lens(folder / "lens.json"), rings=16)
            part.write(folder)
            check(part).write(folder)

    content = run_sweep(SPEC, parse_variation("constraints.max_radius_mm=7,8", SCALED), tmp_path, whole, **SETTINGS)
    assert {criterion.key.split(": ")[0] for criterion in content.criteria} == {"small-7", "small-8"}
    assert len(content.criteria) == sum(len(row.criteria) for row in content.designs) > 10
    require(content.criteria)


def test_a_sweep_in_memory_is_that_of_the_folders(swept):
    folder, content = swept
    variation = variation_of("constraints.max_radius_mm", [8, 6.5, 8], SCALED)
    runs = [(variant, [load_results(folder / variant.spec.name)]) for variant in variation.variants(SPEC)]
    assert sweep_of(SPEC, variation, runs) == content
    assert [row["nmse.value"] for row in content.rows()] == [row.nmse.value for row in content.designs]
    with pytest.raises(InputError, match="there is no result of this stage"):
        sweep_of(SPEC, variation, [(runs[0][0], [Results(runs[0][1][0].lens)])])


@pytest.mark.nightly("two sweeps")
def test_a_picture_that_changed_is_not_resumed_from(tmp_path):
    picture = tmp_path / "arrow.png"
    Image.fromarray(np.tri(32, dtype=np.uint8) * 255).save(picture)
    target = {"kind": "image", "file": str(picture), "width_mm": 100.0, "distance_mm": 100.0, "receiver_mm": 200.0}
    spec = small_spec(target=target, optimise=SPEC.optimise.model_dump(exclude_unset=True), base={"kind": "none"})
    variation = parse_variation("constraints.max_radius_mm=7,8", SCALED)
    assert not resumable(tmp_path / "made")
    run_sweep(spec, variation, tmp_path / "made", Designer(), **SETTINGS)
    assert resumable(tmp_path / "made")
    again = Designer()
    run_sweep(spec, variation, tmp_path / "made", again, **SETTINGS, resume=True)
    assert again.made == []
    Image.fromarray(np.tri(32, dtype=np.uint8)[::-1] * 255).save(picture)
    with pytest.raises(InputError, match="another spec, or file that it names"):
        run_sweep(spec, variation, tmp_path / "made", again, **SETTINGS, resume=True)
    assert again.made == []


def test_a_folder_that_holds_another_lens_is_not_kept(swept, tmp_path):
    made = tmp_path / "made"
    shutil.copytree(swept[0], made)
    first, last = (made / row.folder / "lens.json" for row in (swept[1].designs[0], swept[1].designs[-1]))
    first.write_bytes(last.read_bytes())
    variation = parse_variation("constraints.max_radius_mm=8,6.5", SCALED)
    with pytest.raises(InputError, match=r"small-6_5: not the design that sweep\.json lists"):
        run_sweep(SPEC, variation, made, Designer(), **SETTINGS, resume=True)


def test_what_a_worker_returns_is_the_files_of_its_run_or_why_there_are_none(tmp_path, monkeypatch):
    def run(spec, folder, *, seed, warn):
        if seed == 0:
            raise InputError("it cannot be")
        (folder / "edge").mkdir(parents=True)  # of lamps with lenses of another kind
        for name in ("lens.json", "run.json", ".lensforge-lock", "edge/lens.json", "edge/.lensforge-lock"):
            (folder / name).write_text(name, encoding="utf-8")

    monkeypatch.setattr("lensforge.report.pipeline.run", run)
    files = files_of_run({"seed": 3}, SPEC)
    assert files == {name: name.encode() for name in ("edge/lens.json", "lens.json", "run.json")}
    assert files_of_run({"seed": 0}, SPEC) == "it cannot be"
    write_run(files, tmp_path / "made")
    written = [path for path in (tmp_path / "made").rglob("*") if path.is_file()]
    assert {path.relative_to(tmp_path / "made").as_posix(): path.read_bytes() for path in written} == files


@pytest.mark.nightly("processes that each load everything, and two whole runs")
def test_a_real_cluster_makes_the_same_lenses(tmp_path):
    variation = parse_variation("constraints.max_radius_mm=7,8")
    there = run_sweep(SPEC, variation, tmp_path, pytest.fail, **SETTINGS, scheduler="local:2")
    for variant, row in zip(variation.variants(SPEC), there.designs, strict=True):
        assert load_lens(tmp_path / row.folder / "lens.json").sha256 == design(variant.spec, **SETTINGS).lens.sha256
        assert (tmp_path / row.folder / "report.html").exists()


def test_an_address_that_is_none_is_one_line(tmp_path):
    variation = parse_variation("constraints.max_radius_mm=7,8")
    with pytest.raises(InputError, match="address of a Dask scheduler"):
        run_sweep(SPEC, variation, tmp_path, pytest.fail, **SETTINGS, scheduler="nowhere")
