"""Output of the commands: a ``key<TAB>value`` line for each number on stdout; then an error for missed criteria."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import click

from lensforge.criteria import require
from lensforge.errors import CriterionMissed
from lensforge.pipeline import run_report
from lensforge.records import StageResult
from lensforge.results import REPORT_FILE
from lensforge.run_folder import Run, open_run

_METRIC = {"value", "unit", "standard_error"}
_NOT_NUMBERS = ("criteria", "version", "inputs")


def finish(
    directory: Path, result: StageResult, decides: Literal["light", "files", ""] = "", **also: StageResult
) -> None:
    """Print one stage's numbers, and ``also`` under their names; refresh the report if there is one.

    Raises :class:`CriterionMissed` where a criterion is missed, or the part of the verdict that the stage ``decides``.
    """
    results = (result, *also.values())
    for prefix, each in zip(("", *(f"{name}." for name in also)), results, strict=True):
        print_table(each.model_dump(mode="json", exclude=_not_printed(each)), prefix)
    if (directory / REPORT_FILE).exists():
        run_report(directory)
    require(criterion for each in results for criterion in getattr(each, "criteria", ()))
    if decides:
        require_pass(directory, decides)


def _not_printed(result: StageResult) -> set[str]:
    """Names of arrays, files and parts of other stages' results, which are in the folder."""
    return {*_NOT_NUMBERS, *type(result).stored_elsewhere()} & set(type(result).model_fields)


def print_table(content: Mapping[str, object], prefix: str = "") -> None:
    """One ``key<TAB>value`` line for each number, keys joined by dots: easy to read, grep and cut."""
    for key, value in content.items():
        if isinstance(value, Mapping) and set(value) == _METRIC:
            click.echo(f"{prefix}{key}\t{value['value']}")
            click.echo(f"{prefix}{key}_standard_error\t{value['standard_error']}")
        elif isinstance(value, Mapping):
            print_table(value, f"{prefix}{key}.")
        else:
            click.echo(f"{prefix}{key}\t{json.dumps(value) if isinstance(value, list | tuple) else value}")


_HEADLINE = {
    "evaluate": ("nmse", "uniformity", "efficiency", "share_in_target"),
    "design": ("steps", "seconds", "max_radius_mm", "height_mm", "constraints"),
    "export": ("form_error_nm", "normal_error_mrad", "watertight", "genus", "volume_mm3"),
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
    verdict = run.verdict
    for name in ("light", "files", "cutting"):
        click.echo(f"verdict.{name}\t{getattr(verdict, name)}")


def require_pass(directory: Path, *parts: str) -> None:
    """Raise :class:`CriterionMissed` where the verdict on ``directory`` fails, in ``parts`` or, without them, any."""
    run = open_run(directory)
    try:
        run.verdict.require(run.spec, parts)
    except CriterionMissed as error:
        raise CriterionMissed(f"{directory}: {error}") from None
