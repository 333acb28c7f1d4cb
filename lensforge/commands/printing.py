"""What the commands print: one ``key<TAB>value`` line for each number, to stdout."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import click

from lensforge.errors import GateFailed
from lensforge.gates import require
from lensforge.pipeline import REPORT_FILE, require_verdict, run_report
from lensforge.records import StageResult
from lensforge.run_folder import Run, open_run

_METRIC = {"value", "unit", "standard_error"}
_NO_FIGURES = ("gates", "version", "inputs")


def finish(
    directory: Path, result: StageResult, decides: Literal["light", "files", ""] = "", **besides: StageResult
) -> None:
    """Print one stage's numbers, and ``besides`` under their names; refresh the report if there is one.

    Then judge: the gates of all, and the part of the verdict that the stage ``decides``.
    """
    results = (result, *besides.values())
    for prefix, each in zip(("", *(f"{name}." for name in besides)), results, strict=True):
        print_table(each.model_dump(mode="json", exclude=_not_printed(each)), prefix)
    if (directory / REPORT_FILE).exists():
        run_report(directory)
    require(gate for each in results for gate in getattr(each, "gates", ()))
    if decides:
        judge(directory, decides)


def _not_printed(result: StageResult) -> set[str]:
    """Arrays, files and what belongs to another stage: they are in the folder."""
    return {*_NO_FIGURES, *type(result).stored_elsewhere()} & set(type(result).model_fields)


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
    """The numbers that one asks for first, and the verdict."""
    for stem, keys in _HEADLINE.items():
        result = run.found.get(stem)
        if result is not None:
            content = result.model_dump(mode="json", include=set(keys), exclude_none=True)
            print_table({key: content[key] for key in keys if key in content}, f"{stem}.")
    verdict = run.verdict
    for name in ("light", "files", "cutting"):
        click.echo(f"verdict.{name}\t{getattr(verdict, name)}")


def judge(directory: Path, *parts: str) -> None:
    """Raise :class:`GateFailed` where the verdict on ``directory`` fails, or one of its ``parts`` if any are named."""
    run = open_run(directory)
    try:
        require_verdict(run.verdict, run.spec, parts)
    except GateFailed as error:
        raise GateFailed(f"{directory}: {error}") from None
