"""The end of a command: its results as blocks of the screen or as JSON, warnings, and the criteria it must meet."""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lensforge.cad.part import Part
from lensforge.cli.output import Block, Output, Row, warning_line
from lensforge.errors import CriterionMissed, shortened
from lensforge.light.evaluation_result import Light
from lensforge.light.light_facts import place_groups
from lensforge.light.photometry_result import IES_FILE, LDT_FILE, LUMINAIRE_FILES, TM25_FILE, TM33_FILE, Photometry
from lensforge.proof.proof_result import Proof
from lensforge.report.folder import Run, RunFolder
from lensforge.report.headline import headline, kinds, trade_facts
from lensforge.report.results import REPORT_FILE, Results, conditions_of, stem_of
from lensforge.report.sweep import Sweep
from lensforge.report.tradeoff import Tradeoff
from lensforge.results import Fact, Group, ResultByLed, StageResult
from lensforge.results.criteria import require
from lensforge.results.fact import cells_of, columns_of
from lensforge.results.record import State
from lensforge.results.verdict import TITLES, Verdict, state_label
from lensforge.search.design_result import Design
from lensforge.shop.check_facts import shape_facts
from lensforge.shop.check_result import Check
from lensforge.verbs import Decides

if TYPE_CHECKING:
    from lensforge.shop.handover import Handover

_STEM = "lens"  # of the files
_MOST_ROWS = 10
_MOST_LIMITS = 3
_WIDEST_CELL = 24
_WIDEST_TABLE = 120
_DESIGN = "design"  # group of a study
_VERDICTS = ("criteria", "cutting")  # columns of every group
_WHOLE = ("ways", "applications", "limits")  # groups of a whole run; of others some facts
# Groups that are rows of a table, a line each even where there is one alone.
_LINES = ("ways", "place", "application", "bound", "spread", "causes", "budget", "error", "failed", "preset")
# Facts of a whole run, by its blocks; a stage shows all that it has.
_ON_RECEIVER = ("nmse", "share_in_target", "efficiency", "uniformity", "level", "cct", "rms_delta_uv")
_LIGHT = (*_ON_RECEIVER, "leak", "rays", "fitted_nmse", "file_nmse", "file_efficiency")
_FAR_FIELD = ("exit_lm", "exit_lm_per_m", "peak_cd", "beam_C 0", "beam_C 90", "bug")
_LENS = ("kept_start", "radius", "height", "least_size", "kept", "next")
_FILES = ("form_error", "volume", "mass", "plate_mass", "surfaces", "scale", "keep_out", "landing", "print_mesh")
_FILES_OF_HANDOVER = (
    "html",
    "pdf",
    "dxf",
    "points_csv",
    "plate_pdf",
    "plate_dxf",
    "models",
)  # bytes, which lie in the folder


def finish(
    output: Output, here: RunFolder, *results: StageResult, decides: Decides = "", renewed: Run | None = None
) -> None:
    """Print the ``results`` of a stage, the first one the stage's own, and refresh the report if there is one.

    ``renewed``: the lens made for another LED, whose light stands beside. Raises :class:`CriterionMissed` where a
    criterion is missed, or the part of the verdict that the stage ``decides``. A result under other than nominal
    conditions does not change the verdict.
    """
    run = here.run
    here.refresh_report()  # first: the reader of the screen may leave
    beside = {} if renewed is None else {"renewed": document(renewed, renewed.light, renewed.design)}
    blocks = [] if renewed is None else [Block(f"A lens made for it, in {renewed.folder}", preview_rows(renewed))]
    output.show(
        lambda: {**document(run, *results), **beside},
        lambda: [*(block for result in results for block in blocks_of(result, run)), *blocks],
    )
    for result in results:
        _tell_conditions(result)
    require(criterion for result in results for criterion in result.deciding_criteria())
    if decides and conditions_of(results[0]) is None:
        _require_pass(run, decides)


def finish_run(output: Output, run: Run) -> None:
    """Print the results of a whole run. Raises :class:`CriterionMissed` where its verdict fails."""
    output.show(lambda: document(run, *run.found.values()), lambda: summary(run))
    _require_pass(run)


def finish_page(output: Output, run: Run | None, page: Path) -> None:
    """Print the path of the ``page`` that was written, and the verdict of the ``run`` where it is on one."""
    title = "Comparison" if run is None else headline(run).sentence
    output.show(
        lambda: {**({} if run is None else document(run)), "report": str(page)},
        lambda: [Block(title, [("report", str(page))])],
    )


def finish_handover(output: Output, here: RunFolder, made: "Handover", folder: Path) -> None:
    """Print the files that were ``made`` for the shop in ``folder``, and the findings of the check that do not hold."""
    run = here.run
    here.refresh_report()
    title = f"For the shop, in {folder}"
    content = made.model_dump(
        mode="json", exclude={**dict.fromkeys(_FILES_OF_HANDOVER, True), "grids": {"__all__": {"content"}}}
    )
    output.show(
        lambda: {**document(run), "handover": {"files": list(made.files), **content}},
        lambda: [Block(title, list(rows_of([made.facts]))), Block(headline(run).sentence)],
    )


def finish_study(output: Output, directory: Path, study: Sweep | Tradeoff, title: str, page: str) -> None:
    """Print a study of its own folder under ``title``, and its ``page``."""
    output.show(
        lambda: {"folder": str(directory), study.stage: study.plain()},
        lambda: [_block_of(title, study.facts), Block(f"Written: {directory / page}")],
    )


def _block_of(title: str, groups: Sequence[Group]) -> Block:
    """A study: a table of its designs, and a line for each group of another kind."""
    designs = [group for group in groups if group.key == _DESIGN]
    return Block(title, list(rows_of([group for group in groups if group.key != _DESIGN])), list(table_of(designs)))


def table_of(groups: Sequence[Group]) -> Iterator[str]:
    """Lines of a table of ``groups``: verdicts, and what they differ in; in parts where it is too wide for one."""
    columns = columns_of(groups)
    rows = [[shortened(" ".join(cell.text.split()), _WIDEST_CELL) for cell in cells_of(g, columns)] for g in groups]
    told = [
        [label, *cells]
        for (key, label), *cells in zip(columns.items(), *rows, strict=True)
        if key in _VERDICTS or len({*cells}) != 1 or len(groups) == 1
    ]
    first = ["", *(group.title for group in groups)]
    room = 0
    parts: list[list[list[str]]] = []
    for column in told:
        wide = max(map(len, column)) + 2
        if not parts or wide > room:
            parts = [*parts, [first]]
            room = _WIDEST_TABLE - max(map(len, first)) - 4
        parts[-1].append(column)
        room -= wide
    for part in parts:
        padded = [[text.ljust(max(map(len, column))) for text in column] for column in part]
        yield from ("  ".join(line).rstrip() for line in zip(*padded, strict=True))


def document(run: Run, *results: StageResult) -> dict[str, object]:
    """Folder and verdict of ``run``, facts of ``results``, and each of them as its file holds it, by its stem."""
    stems = {stem_of(result): result for result in results}
    head = {"folder": str(run.folder), "verdict": run.verdict.model_dump(mode="json")}
    facts = {stem: [group.plain() for group in run.facts(result)] for stem, result in stems.items()}
    return {**head, "facts": facts, **{stem: result.plain() for stem, result in stems.items()}}


def _tell_conditions(result: StageResult) -> None:
    conditions = conditions_of(result)
    if conditions is None:
        return
    for warning in conditions.warnings:
        click.echo(warning_line(warning), err=True)
    nominal_stem = stem_of(result.changed(conditions=None))
    click.echo(
        f"{stem_of(result)}.json: not at nominal conditions ({conditions}), "
        f"so {nominal_stem}.json and the verdict stay as "
        "they are",
        err=True,
    )


def _require_pass(run: Run, *parts: str) -> None:
    """Raise :class:`CriterionMissed` where the verdict on ``run`` fails, in ``parts`` or, without them, any."""
    try:
        run.verdict.require(cutting=run.spec.manufacture.required, parts=parts)
    except CriterionMissed as error:
        raise CriterionMissed(f"{run.folder}: {error}") from None


def blocks_of(result: StageResult, run: Run) -> list[Block]:
    """Blocks for ``result``, one of those in the folder of ``run``, and the file that holds it."""
    groups = run.facts(result)
    light = run.find(Light)
    if light is not None and isinstance(result, ResultByLed):  # of the same LEDs
        groups = [*groups, *place_groups(light)]
    title, reasons = _judged(result, run)
    blocks = [Block(title, [*rows_of(groups), *reasons])] if title else _titled(groups)
    conditions = conditions_of(result)
    under = [] if conditions is None else [("Conditions", str(conditions))]
    names = sorted(name for name in result.file_names(stem_of(result)) if Path(name).suffix not in (".json", ".npz"))
    if files := [name for name in names if (run.folder / name).exists()]:
        under.append(("Files", ", ".join(files)))
    return [*blocks, Block(f"Written: {run.folder / stem_of(result)}.json", under)]


def rows_of(groups: Sequence[Group]) -> Iterator[Row]:
    """A line for each fact; for each group where several are of one kind, of many the first ones."""
    counted = Counter(group.key for group in groups)
    shown = Counter[str]()
    for group in groups:
        if group.key == "limits":
            yield from _limit_rows(group)
        elif counted[group.key] > 1 or group.key in _LINES:
            shown[group.key] += 1
            if shown[group.key] <= _MOST_ROWS:
                yield group.title, f"{group.line}; {group.note}" if group.note else group.line
            elif shown[group.key] == _MOST_ROWS + 1:
                yield "", f"and {counted[group.key] - _MOST_ROWS} more, in the record"
        else:
            yield from map(_row, group.facts)


def summary(run: Run) -> list[Block]:
    """The end of a whole run: verdict, light, lens, files, manufacture, and the folder, in 30 lines at most."""
    head = headline(run)
    verdict = run.verdict
    trade = trade_facts(run)
    light = _selected(run, _LIGHT, Light)
    lens = _selected(run, _LENS, Design)
    design = run.find(Design)
    search = "" if design is None else f": {_search(run, design)}"
    # No application asks for the angles of a beam.
    told = [fact.key for fact in trade]
    kept = [key for key in _FAR_FIELD if key not in told and not (run.spec.applications and key.startswith("beam_"))]
    far_field = _selected(run, tuple(kept), Photometry)
    files = _selected(run, _FILES, Part, Proof)
    why = [] if run.spec.has_limits else _because(verdict, "light")[:1]  # limits are lines of their own already
    return [
        Block(f"{run.spec.name}: {head.sentence} {head.criteria}"),
        Block(_title("light", verdict.light, light), [*map(_row, trade), *rows_of(light), *rows_of(far_field), *why]),
        Block(f"Lens{search}", [*rows_of(lens), *_kinds(run)]),
        Block(_title("files", verdict.files, files), [*rows_of(files), *_because(verdict, "files")[:1]]),
        Block(_title("cutting", verdict.cutting, _of_mould(run)), list(_manufacture(run))),
        Block(f"Written: {run.folder / REPORT_FILE}", [("Files", _written(run))]),
    ]


def _title(part: str, state: State, groups: Sequence[Group] = (), under: str = "") -> str:
    """A part of the verdict; where it passes with the names of those facts that deserve a look all the same."""
    labels = dict.fromkeys(fact.label.lower() for group in groups for fact in group.facts if fact.notice)
    look = f"; look at: {', '.join(labels)}" if labels and state == "pass" else ""
    return f"{TITLES[part]}{under}: {state_label(state)}{look}"


def _kinds(run: Run) -> Iterator[Row]:
    """The kind of this lens, of several, and the folders of the others."""
    every = kinds(run, linked=False)
    here = [f"{kind.name}, of {kind.lamps} lamps" for kind in every if kind.here]
    elsewhere = [f"{kind.name} of {kind.lamps}" for kind in every if not kind.here]
    if here:
        yield "Kind", f"{here[0]}; in folders of their names: {', '.join(elsewhere)}"


def preview_rows(run: Run) -> list[Row]:
    """Light and size of a draft."""
    return [*rows_of(_selected(run, _LIGHT, Light)), *rows_of(_selected(run, _LENS, Design))]


def _row(fact: Fact) -> Row:
    change = f". Change: {fact.remedy}" if fact.remedy and fact.value == "no" else ""
    return fact.label, f"{fact.sentence}{change}"


def _limit_rows(group: Group) -> Iterator[Row]:
    missed = [fact for fact in group.facts if not fact.holds]
    yield "Limits", f"{len(group.facts) - len(missed)} of {len(group.facts)} met"
    for fact in missed[:_MOST_LIMITS]:
        yield f"  {fact.outcome}", "; ".join(filter(None, (f"{fact.label}: {fact.sentence}", fact.advice)))
    if len(missed) > _MOST_LIMITS:
        yield "", f"and {len(missed) - _MOST_LIMITS} more, in evaluate.json"


def _judged(result: StageResult, run: Run) -> tuple[str, list[Row]]:
    """Title with the verdict, and reasons, of light and files; under other than nominal conditions by itself."""
    if not isinstance(result, Light | Part | Proof):
        return "", []
    judged = run.verdict
    under = ""
    if conditions_of(result) is not None:
        part = {stem: result for stem, result in run.found.items() if stem == Part.stage}
        judged = Results(run.lens, {**part, result.stage: result}).verdict
        under = " under other conditions"
    if isinstance(result, Light):
        return _title("light", judged.light, run.facts(result), under), _because(judged, "light")
    return _title("files", judged.files, run.facts(result), under), _because(judged, "files")


def _titled(groups: Sequence[Group]) -> list[Block]:
    kinds = dict.fromkeys(group.key for group in groups)
    by_kind = [[group for group in groups if group.key == key] for key in kinds]
    titles = {"bound": "Limits", "spread": "Over all parts", "causes": "Share of the variance", "budget": "Tolerances"}
    titles["application"] = "Applications"
    titles["error"] = "Change at the end of each tolerance"
    return [Block(titles.get(same[0].key, same[0].title), list(rows_of(same))) for same in by_kind]


def _because(verdict: Verdict, name: str) -> list[Row]:
    return [("Reason", reason) for reason in verdict.reasons_of(name)]


def _selected(run: Run, keys: tuple[str, ...], *kinds: type[StageResult]) -> list[Group]:
    """The facts called ``keys`` of the results of ``kinds``; ways of light and limits in full."""
    results = [result for result in map(run.find, kinds) if result is not None]
    groups = [group for result in results for group in run.facts(result)]
    selected = (group if group.key in _WHOLE else group.select(*keys) for group in groups)
    return [group for group in selected if group.facts]


def _search(run: Run, design: Design) -> str:
    search = next(group for group in run.facts(design) if group.key == "search")
    levels = search.fact("levels").text
    return f"{search.fact('steps').text} steps in {levels} level{'' if levels == '1' else 's'}"


def _of_mould(run: Run) -> list[Group]:
    check = run.find(Check)
    return [] if check is None else [group for group in run.facts(check) if group.key == "mould"]


def _manufacture(run: Run) -> Iterator[Row]:
    check = run.find(Check)
    if check is None:
        return
    yield from map(_row, shape_facts(check, run.facts(check)))
    yield from rows_of(_selected(run, ("thinnest",), Check))
    yield from (_row(fact) for group in _of_mould(run) for fact in group.facts if fact.notice)
    design = run.find(Design)
    yield from (_row(cost.fact) for cost in (() if design is None else design.tool_costs) if cost.matters)
    groups = [group for group in run.facts(check) if group.key.startswith("findings")]
    missed = [
        f"{fact.label.lower()}: no ({group.title.partition(', ')[2]})"
        for group in groups
        for fact in group.facts
        if fact.state == "fail" and fact.key not in ("cutter", "nose")
    ]
    of_kinds = [(kind.name, why) for kind in kinds(run, linked=False) for why in run.verdict.reasons_of("cutting")]
    further = [(name, why) for name, why in of_kinds if why.startswith(f"{name}: ")]
    if missed or further:
        yield "Not met", "; ".join((*missed, *(why for _, why in further)))
    if run.verdict.cutting not in ("pass", "none"):
        at = "" if missed or not further else f" {run.folder / further[0][0]}"
        yield "Remedy", f"see `lensforge check{at}`"


def _written(run: Run) -> str:
    part = run.find(Part)
    photometry = run.find(Photometry)
    names = [] if part is None else list(part.files)
    names += [] if photometry is None else [IES_FILE, LDT_FILE, TM33_FILE, TM25_FILE]
    names += [*LUMINAIRE_FILES.values()] if photometry is not None and photometry.luminaire else []
    names += [] if photometry is None else [f"{_STEM}{case.suffix}.ies" for case in photometry.cases() if case.number]
    pairs = zip([Path(), *map(Path, names)], map(Path, names), strict=False)  # "lens.step, .stl, .3mf"
    return ", ".join(path.suffix if path.stem == before.stem else path.name for before, path in pairs)
