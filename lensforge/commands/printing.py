"""Output of the commands: a ``key<TAB>value`` line for each number on stdout, warnings and progress on stderr."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import click

from lensforge.criteria import require
from lensforge.errors import CriterionMissed
from lensforge.evaluation.light import Light
from lensforge.far_field.photometry import Photometry
from lensforge.pipeline import refresh_report
from lensforge.records import Metric, SimulatedResult, StageResult
from lensforge.report.ownership import is_free_or_own
from lensforge.results import REPORT_FILE, stem_of
from lensforge.run_folder import Run, open_run
from lensforge.verdict import Verdict, verdict_on

_METRIC = {"value", "unit", "standard_error"}
# Digits that the errors of sampled figures carry (docs/definitions.md); the records keep all.
_SIGNIFICANT = {"form_error_nm": 2, "normal_error_mrad": 2, "chord_error_um": 3}
_DECIMALS = {
    "thickness_mm": 6, "min_wall_mm": 6, "pv_mm": 6, "rms_mm": 6, "area_fraction_below_half": 5,
    "area_fraction_below_two": 5, "undercut_fraction": 5, "reachable_fraction": 3, "local_ok_fraction": 3,
}  # fmt: skip
_NOT_NUMBERS = ("criteria", "version", "inputs", "conditions")


def finish(
    directory: Path, result: StageResult, decides: Literal["light", "files", "cutting", ""] = "", **also: StageResult
) -> None:
    """Print one stage's numbers, and ``also`` under their names, and conclude the command.

    Raises :class:`CriterionMissed` where a criterion is missed, or the part of the verdict that the stage ``decides``.
    """
    results = (result, *also.values())
    for prefix, each in zip(("", *(f"{name}." for name in also)), results, strict=True):
        print_conditions(each, prefix)
        print_table({key: value for key, value in each.plain().items() if key not in _NOT_NUMBERS}, prefix)
    conclude(directory, results, decides)


def conclude(
    directory: Path, results: Sequence[StageResult] = (), decides: Literal["light", "files", "cutting", ""] = ""
) -> None:
    """Print the verdict, refresh the report if there is one, and raise as :func:`finish` does.

    Where the first of ``results`` is under other conditions than the lens's own, it decides nothing: a light is judged
    under them, and the lens's verdict is not repeated.
    """
    run, first = open_run(directory), results[0] if results else None
    own = not isinstance(first, SimulatedResult) or first.conditions is None
    if own:
        print_verdict(run)
    elif isinstance(first, Light):
        print_parts("conditions", verdict_on(run.lens, None, first, None, None, None), ("light",))
    if (directory / REPORT_FILE).exists() and is_free_or_own(directory / REPORT_FILE):
        refresh_report(directory)
    require(criterion for each in results for criterion in getattr(each, "criteria", ()))
    if decides and own:
        require_pass(directory, decides)


def print_conditions(result: StageResult, prefix: str = "") -> None:
    """Print the file that holds ``result`` and its conditions where they are not the lens's own; warn on its source."""
    conditions = result.conditions if isinstance(result, SimulatedResult) else None
    if conditions is None:
        return
    print_table({"record": f"{stem_of(result)}.json", "conditions": str(conditions)}, prefix)
    for words in conditions.warnings:
        click.echo(warning_line(words), err=True)
    own = stem_of(result.model_copy(update={"conditions": None}))
    click.echo(
        f"{stem_of(result)}.json: other conditions than the lens's own ({conditions}); {own}.json and the verdict rest "
        "on the lens's own",
        err=True,
    )


def warning_line(words: str) -> str:
    """A warning as one line."""
    return f"warning: {printable(' '.join(words.split()))}"


def printable(text: str) -> str:
    """``text`` with escapes for characters that steer a terminal: names in a file may come from anywhere."""
    return "".join(each if each.isprintable() or each == "\t" else ascii(each)[1:-1] for each in text)


def print_table(content: Mapping[str, object], prefix: str = "") -> None:
    """One ``key<TAB>value`` line for each number, keys joined by dots: easy to read, grep and cut.

    A number with a standard error has the digits that the error carries; the file has them all.
    Entries of a list that have names are found under these.
    """
    for key, value in content.items():
        if isinstance(value, Mapping) and set(value) == _METRIC:
            number, error = Metric.model_validate(value).digits()
            click.echo(f"{prefix}{key}\t{number}")
            click.echo(f"{prefix}{key}_standard_error\t{error or None}")
        elif isinstance(value, Mapping):
            print_table(value, f"{prefix}{key}.")
        elif key == "receivers" and isinstance(value, list):
            for entry in value:
                rest = {name: each for name, each in entry.items() if name != "name"}
                print_table(rest, f"{prefix}{key}.{entry['name']}.")
        else:
            shown = json.dumps(value) if isinstance(value, list | tuple) else value
            click.echo(printable(f"{prefix}{key}\t{_to_its_digits([*prefix.split('.'), key], shown)}"))


def _to_its_digits(names: Sequence[str], value: object) -> object:
    """A number without the digits that its error does not carry; ``names``: its path in the record."""
    if not isinstance(value, float):
        return value
    significant = next((_SIGNIFICANT[name] for name in names if name in _SIGNIFICANT), None)
    if significant is not None:
        return float(f"{value:.{significant}g}")
    decimals = _DECIMALS.get(names[-1])
    return value if decimals is None else round(value, decimals)


_HEADLINE = {
    "evaluate": ("nmse", "uniformity", "efficiency", "share_in_target"),
    "design": ("steps", "seconds", "max_radius_mm", "height_mm", "constraints"),
    "export": ("form_error_nm", "normal_error_mrad", "watertight", "genus", "volume_mm3", "mass_g", "keep_out"),
    "check": ("min_wall_mm",),
    "verify": ("nmse_vs_design", "noise_floor_nmse", "deviation_mm"),
}


def print_headline(run: Run) -> None:
    """Print the main numbers of a whole run, and the verdict."""
    for stem, keys in _HEADLINE.items():
        result = run.found.get(stem)
        if result is not None:
            content = result.model_dump(mode="json", include=set(keys), exclude_none=True)
            print_table({key: content[key] for key in keys if key in content}, f"{stem}.")
    print_far_field(run)
    print_verdict(run)


def print_far_field(run: Run) -> None:
    """Print lumens, largest candela and beam angles, and what a lamp for an area or a road is rated."""
    found = run.find(Photometry)
    if found is None:
        return
    angles = {"c0": found.beam_c0.beam_angle_deg, "c90": found.beam_c90.beam_angle_deg}
    figures = {"exit_lm": found.exit_lm, "peak_cd": found.peak_cd}
    figures |= {f"beam_angle_{plane}_deg": angle for plane, angle in angles.items() if angle is not None}
    print_table({name: figure.model_dump(mode="json") for name, figure in figures.items()}, "photometry.")
    if found.road is not None:
        print_table({"distribution": str(found.road.distribution), "bug": str(found.road.bug)}, "photometry.")


def print_verdict(run: Run) -> None:
    """Print the verdict on light, files and cutting, and the reasons for each that is no pass."""
    print_parts("verdict", run.verdict, ("light", "files", "cutting"))


def print_parts(prefix: str, verdict: Verdict, parts: Sequence[str]) -> None:
    """Print ``parts`` of a verdict under ``prefix``, each with its reasons."""
    for name in parts:
        click.echo(f"{prefix}.{name}\t{getattr(verdict, name)}")
        for reason in verdict.reasons_of(name):
            click.echo(printable(f"{prefix}.{name}.reason\t{reason}"))


def require_pass(directory: Path, *parts: str) -> None:
    """Raise :class:`CriterionMissed` where the verdict on ``directory`` fails, in ``parts`` or, without them, any."""
    run = open_run(directory)
    try:
        run.verdict.require(run.spec, parts)
    except CriterionMissed as error:
        raise CriterionMissed(f"{directory}: {error}") from None
