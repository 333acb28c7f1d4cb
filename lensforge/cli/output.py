"""Output that a user asks for: a screen to read, one JSON document with ``--json``, or nothing with ``--quiet``."""

import functools
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from lensforge.report.folder import Run
from lensforge.report.results import stem_of
from lensforge.results import StageResult


@dataclass(frozen=True)
class Output:
    """``json``: stdout is one JSON document. ``quiet``: no progress, and without ``json`` nothing on stdout."""

    json: bool = False
    quiet: bool = False

    @property
    def screen(self) -> bool:
        """True where a person reads stdout."""
        return not (self.json or self.quiet)


_JSON = click.option("--json", "as_json", is_flag=True, help="Print the result as one JSON document, with all digits.")
_QUIET = click.option("--quiet", is_flag=True, help="Print nothing but warnings and errors; no progress either.")


def with_output(command: Callable[..., None]) -> Callable[..., None]:
    """Add ``--json`` and ``--quiet`` to ``command``, which is called with both as one ``output``."""

    @functools.wraps(command)
    def called(*, as_json: bool, quiet: bool, **options: Any) -> None:
        command(output=Output(as_json, quiet), **options)

    return _JSON(_QUIET(called))


def print_json(content: Mapping[str, object]) -> None:
    """Print one JSON document."""
    click.echo(json.dumps(content, indent=2, allow_nan=False))


def document(run: Run, *results: StageResult) -> dict[str, object]:
    """Folder and verdict of ``run``, facts of ``results``, and each of them as its file holds it, by its stem."""
    stems = {stem_of(each): each for each in results}
    head = {"folder": str(run.folder), "verdict": run.verdict.model_dump(mode="json")}
    facts = {stem: [group.plain() for group in run.facts(each)] for stem, each in stems.items()}
    return {**head, "facts": facts, **{stem: each.plain() for stem, each in stems.items()}}


def folder_document(folder: Path, *results: StageResult) -> dict[str, object]:
    """The same of a folder that holds no lens of its own, as that of a sweep: without verdict."""
    return {"folder": str(folder), **{each.stage: each.plain() for each in results}}
