"""No page claims a pass that the numbers of a folder do not carry.

``run.json`` holds the hash of every result as its command wrote it; report, handover and library refuse any other.
Every criterion is judged by its own value and its own limit, of which there is a list here that shares no code with
the program.
"""

import json
import re
import shutil
from math import isclose
from pathlib import Path
from typing import Any

import pytest
from addon_rows import addon_rows
from made_once import copied
from nightly import first_by_day

import lensforge as lf
from lensforge.optics.face_roles import DOUBLE
from lensforge.report.folder import RunFolder
from lensforge.report.pipeline import write_report
from lensforge.report.results import kinds_of_results, own_stems
from lensforge.report.stored import load_results
from lensforge.results.stage_result import with_checksum

pytestmark = pytest.mark.usefixtures("undrawn")

NEVER = ("compare_outer", "correct_outer")
RECORDS = [stem for stem in own_stems(DOUBLE) if stem not in NEVER]

# The value of each criterion in its record, and its limit; None: nothing else in the folder states it.
TOLERANCE_MM = 7e-5 * 7.0
VALUES: dict[str, tuple[str | None, str, float | None]] = {
    "cavity clearance": ("constraints.cavity_clearance_mm", ">=", -TOLERANCE_MM),
    "wall margin": ("constraints.wall_margin_mm", ">=", -TOLERANCE_MM),
    "radius margin": ("constraints.radius_margin_mm", ">=", -TOLERANCE_MM),
    "flux not converged": ("receivers.0.flux.not_converged", "<=", 0.0),
    "form_error": ("form_error_nm.max", "<=", 50.0),
    "normal_error": ("normal_error_mrad.max", "<=", 0.2),
    "step_valid": (None, ">=", 1.0),
    "step_volume_change": (None, "<=", 1e-9),
    "watertight": ("watertight", ">=", 1.0),
    "watertight_3mf": (None, ">=", 1.0),
    "genus_difference": (None, "<=", 0.0),
    "mesh_volume_change": (None, "<=", None),
    "thinnest wall": ("walls.thinnest.thickness_mm", ">=", 1.0 - TOLERANCE_MM),
    "open_edges": ("open_edges", "<=", 0.0),
    "volume_change": (None, "<=", None),
    "area_change": (None, "<=", None),
    "box_change": (None, "<=", None),
    "brep_volume_change": (None, "<=", None),
    "brep_area_change": (None, "<=", None),
    "brep_box_change": (None, "<=", None),
    **{f"lens.{end}: form": (f"forms.{k}.off_um", "<=", None) for k, end in enumerate(("step", "stl", "3mf"))},
    **{f"lens.{end}: gaps": (f"forms.{k}.open_edges", "<=", 0.0) for k, end in enumerate(("step", "stl", "3mf"))},
    "own_rays_emission": ("emission_apart", "<=", 5.5),
    "own_rays_efficiency": (None, "<=", None),
    "own_rays_nmse": ("receivers.0.own_rays.nmse_less_noise.value", "<=", None),
    "deviation_rms": ("receivers.0.against_design.rms", "<=", None),
    "flux_deviation": ("receivers.0.against_design.flux", "<=", 1e-3),
    "fate_disagreement_flux": ("receivers.0.against_design.fates_flux", "<=", 1e-3),
    "nmse_same_rays": ("receivers.0.nmse_same_rays", "<=", None),
    "nmse_vs_design": ("receivers.0.nmse_vs_design", "<=", None),
    "plain_cast_disagreements": ("plain_cast.disagreements", "<=", 0.0),
    "brep_deviation_rms": ("receivers.0.brep.against_design.rms", "<=", None),
    "brep_flux_deviation": ("receivers.0.brep.against_design.flux", "<=", 1e-4),
    "brep_fate_disagreements": ("receivers.0.brep.against_design.fates", "<=", 2.0),
    "mitsuba_nmse_vs_design": ("receivers.0.mitsuba.nmse_vs_design", "<=", None),
    "mitsuba_deviation_rms": ("receivers.0.mitsuba.against_design.rms", "<=", None),
    "mitsuba_flux_deviation": ("receivers.0.mitsuba.against_design.flux", "<=", 2e-3),
    "mitsuba_fate_disagreement_flux": ("receivers.0.mitsuba.against_design.fates_flux", "<=", 2e-3),
    "stray_balance": ("receivers.0.balance_error", "<=", 1e-9),
    "stray_leaked": ("receivers.0.flux.leaked", "<=", 1e-3),
    "stray_too_dim": ("receivers.0.flux.too_dim", "<=", 1e-2),
    "flux of lens.ies as read back": ("files.ies.relative_error", "<=", 1e-5),
    "flux of lens.ldt as read back": ("files.ldt.relative_error", "<=", 1e-5),
    "flux of lens.iesxml as read back": ("files.tm33.relative_error", "<=", 1e-5),
    "flux of lens.tm25ray as read back": ("files.tm25ray.relative_error", "<=", 1e-5),
    **addon_rows("JUDGED"),
}


@pytest.fixture
def folder(whole_run: lf.Run, tmp_path: Path) -> Path:
    """A copy of a whole result folder."""
    return copied(whole_run.folder, tmp_path / "run")


def record_in(folder: Path, stem: str) -> dict[str, Any]:
    return dict(json.loads((folder / f"{stem}.json").read_text(encoding="utf-8")))


def write(folder: Path, stem: str, content: dict[str, Any]) -> None:
    (folder / f"{stem}.json").write_text(json.dumps(with_checksum(content)), encoding="utf-8")


def at(content: Any, path: tuple[str | int, ...]) -> Any:
    for key in path:
        content = content[key]
    return content


def way_of(source: str) -> tuple[str | int, ...]:
    return tuple(int(part) if part.isdigit() else part for part in source.split("."))


def handed_over(folder: Path) -> lf.Handover:
    return lf.handover(RunFolder(folder).to_show())


def refusal(command: Any, folder: Path) -> str:
    """Why a command refuses the folder, in one line and with exit code 2; empty where it ends well."""
    try:
        command(folder)
    except lf.InputError as error:
        lines, code = str(error).splitlines(), error.exit_code
    else:
        return ""
    assert code == 2 and len(lines) == 1, lines
    return lines[0]


def test_every_criterion_is_judged_by_its_own_value_and_limit(whole_run: lf.Run) -> None:
    for stem, criterion in whole_run.criteria():
        of_second_cut = f"{stem.partition('_')[0]} {criterion.key}"
        source, sense, limit = VALUES.get(of_second_cut) or VALUES[criterion.key]
        assert criterion.sense == sense, criterion
        bound = criterion.limit + (criterion.tolerance if sense == "<=" else -criterion.tolerance)
        if limit is not None:
            assert isclose(bound, limit, rel_tol=1e-9, abs_tol=1e-12), criterion
        if source is not None:
            assert criterion.value == at(record_in(whole_run.folder, stem), way_of(source)), criterion
        within = criterion.value <= bound if sense == "<=" else criterion.value >= bound
        assert criterion.holds is within, criterion


def test_every_list_of_judgements_is_made_again() -> None:
    for kind in kinds_of_results():
        kept = {"criteria", "verdicts", "limits"} & set(kind.model_fields)
        by_itself = set(kind.judged_in) if kind._judges_itself() else set()
        assert kept == by_itself, kind


@pytest.mark.parametrize("stem", first_by_day(5, RECORDS))
def test_a_changed_record_is_refused_where_run_json_knows_it(folder: Path, stem: str) -> None:
    """Also with a checksum of its new content, so that the file is damaged for no reader."""
    content = record_in(folder, stem)
    first = next(key for key, value in content["inputs"].items() if isinstance(value, str))
    write(folder, stem, content | {"inputs": content["inputs"] | {first: "0" * 64}})
    commands = (write_report, handed_over)
    for command in commands:
        message = refusal(command, folder)
        assert (stem in message and "again" in message) or "is out of date and ignored" in message, message


def test_an_outcome_is_that_of_its_value_and_the_value_that_of_its_record(folder: Path) -> None:
    """1e9 nm of form error "passed": refused, and so is a value that is not the record's; else the files fail."""
    content = record_in(folder, "export")
    content["criteria"][0]["value"] = 1e9
    write(folder, "export", content)
    assert "criteria.0: passed: not as it follows" in refusal(lf.load, folder)
    content["criteria"][0]["passed"] = False
    write(folder, "export", content)
    assert "criteria: form_error: not as it follows from the other entries" in refusal(lf.load, folder)
    content["form_error_nm"]["max"] = 1e9
    write(folder, "export", content)
    for command in (write_report, handed_over, lf.load):
        assert "whose hash run.json states" in refusal(command, folder)
    (folder / "run.json").unlink()
    write_report(folder)
    assert "form error" in (folder / "report.html").read_text(encoding="utf-8")
    assert lf.load(folder).verdict.files == "fail"


FORGED: list[tuple[str, str, Any]] = [
    ("evaluate", "nmse.value", 1e-3),
    ("evaluate", "efficiency.value", 0.99),
    ("evaluate", "flux.detected", 0.99),
    ("evaluate", "possible.nmse", 0.5),
    ("evaluate", "uniformity.value", 1.0),
    ("evaluate", "receivers.0.nmse.value", 1e-3),
    ("evaluate", "receivers.0.efficiency.value", 0.99),
    ("evaluate", "receivers.0.raw.nmse", 1e-3),
    ("evaluate", "receivers.0.missed_by_cause.base", 0.25),
    ("design", "steps", 7),
    ("design", "constraints.wall_margin_mm", 3.0),
    ("export", "form_error_nm.max", 0.5),
    ("export", "watertight", False),
    ("check", "min_wall_mm", 3.0),
    ("check", "verdicts.0.holds", None),
    ("check", "verdicts.0.limit", 0.75),
    ("check", "criteria.0.limit", 0.75),
    ("check", "criteria.0.passed", None),
    ("export", "criteria.0.limit", 0.75),
    ("export", "criteria.2.passed", None),
    ("design", "criteria.0.limit", -0.75),
    ("verify", "nmse_vs_design", 1e-9),
    ("verify", "deviation_mm.rms", 1e-9),
    ("stray", "efficiency", 0.9),
    ("photometry", "files.ies.relative_error", 0.5),
    ("verify", "criteria.3.value", 1e-9),
    ("verify", "criteria.3.limit", 0.75),
    ("verify", "forms.1.off_um", 0.015),
    ("verify", "receivers.0.nmse_same_rays", 1e-9),
    ("stray", "criteria.0.limit", 0.75),
    ("evaluate", "criteria.0.limit", 0.75),
    ("photometry", "criteria.1.limit", 0.75),
    *addon_rows("FORGED"),
]


@pytest.mark.parametrize(("stem", "place", "value"), FORGED)
def test_a_forged_figure_is_refused_whatever_hashes_are_right(
    whole_run: lf.Run, tmp_path: Path, stem: str, place: str, value: Any
) -> None:
    """Also at the head with its own content, and in that with the head as it was."""
    content = record_in(whole_run.folder, stem)
    *way, last = way_of(place)
    holder = at(content, tuple(way))
    holder[last] = not holder[last] if value is None else value
    for path in whole_run.folder.iterdir():
        if path.is_file():
            (tmp_path / path.name).symlink_to(path)
    (tmp_path / f"{stem}.json").unlink()
    write(tmp_path, stem, content)
    assert re.search(r"not as it follows from|the other entries make it", refusal(load_results, tmp_path))


@pytest.mark.parametrize(
    "name",
    first_by_day(
        3, ["lens.step", "lens.stl", "lens.3mf", "lens.ies", "evaluate.npz", "check.npz"], "more cases of the same"
    ),
)
def test_a_file_with_other_bytes_is_refused(folder: Path, name: str) -> None:
    content = bytearray((folder / name).read_bytes())
    content[len(content) // 2] ^= 1
    (folder / name).write_bytes(bytes(content))
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    for command in (write_report, handed_over, lf.load):
        assert "run `lensforge" in refusal(command, folder)
    assert before == {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_the_next_command_takes_over_no_result_but_its_own(folder: Path) -> None:
    """A light that was made better is not vouched for by the next stage; its own command mends it."""
    light = lf.load(folder).light
    better = light.model_copy(update={"rays": light.rays + 1})
    better.write(folder)
    run_folder = RunFolder(folder)
    run_folder.write(run_folder.run.check)
    assert run_folder.run.verdict.light == "undecided"
    assert "whose hash run.json states" in refusal(write_report, folder)
    assert "evaluate" in RunFolder(folder).run.outdated and "verify" in RunFolder(folder).run.outdated
    RunFolder(folder).write(light)
    assert refusal(lf.load, folder) == ""


def test_a_command_killed_before_run_json_is_mended_by_running_it_again(folder: Path) -> None:
    results = lf.load(folder)
    sensitivity = results.found["sensitivity"]
    sensitivity.model_copy(update={"rays": 1}).write(folder)
    assert refusal(write_report, folder).endswith("run `lensforge sensitivity` again")
    RunFolder(folder).write(sensitivity)
    assert lf.load(folder) == results


def test_folders_travel_and_may_lack_run_json(folder: Path, tmp_path: Path) -> None:
    whole = lf.load(folder)
    moved = Path(shutil.move(folder, tmp_path / "elsewhere"))
    assert lf.load(moved).verdict == whole.verdict
    (moved / "run.json").unlink()
    assert refusal(write_report, moved) == ""
    assert record_in(moved, "run")["verdict"] == whole.verdict.model_dump(mode="json")
    (moved / "run.json").write_text("{}", encoding="utf-8")
    assert "delete it" in refusal(write_report, moved)


@pytest.mark.parametrize(("field", "value", "message"), [
    ("seed", 41, "seed = 41, lens.json has 0"),
    ("name", "another", "name = 'another', lens.json has 'small'"),
    ("accuracy", "reference", "accuracy = 'reference', lens.json has"),
    ("seconds", 1e-9, "seconds = 1e-09, one of its stages took"),
    ("verdict", None, "its verdict is not that of the results beside it"),
])  # fmt: skip
def test_what_run_json_states_is_compared_though_its_checksum_is_made_anew(
    folder: Path, field: str, value: Any, message: str
) -> None:
    content = record_in(folder, "run")
    verdict = content["verdict"]
    turned = {"fail": "pass", "pass": "fail", "undecided": "pass"}[verdict["light"]]
    assert content[field] != value
    write(folder, "run", content | {field: verdict | {"light": turned} if field == "verdict" else value})
    for command in (write_report, handed_over, lf.load):
        assert message in refusal(command, folder)
    (folder / "run.json").unlink()
    assert refusal(lf.load, folder) == ""


def test_reasons_of_a_verdict_are_those_of_the_results_whatever_words_an_earlier_version_had(folder: Path) -> None:
    content = record_in(folder, "run")
    verdict = content["verdict"]
    reasons = {part: ["other words"] for part in verdict["reasons"]}
    write(folder, "run", content | {"verdict": verdict | {"reasons": reasons}})
    assert refusal(lf.load, folder) == ""
    assert "other words" not in str(lf.load(folder).verdict.reasons)


def test_seconds_that_one_stage_took_longer_are_none_of_a_whole_run(folder: Path) -> None:
    """A search that was resumed, or a stage that ran again by itself."""
    longest = max(result.seconds for result in lf.load(folder).found.values() if hasattr(result, "seconds"))
    assert RunFolder(folder).renew(seconds=longest / 2).seconds is None
    assert RunFolder(folder).renew(seconds=2 * longest).seconds == 2 * longest
    assert refusal(lf.load, folder) == ""
