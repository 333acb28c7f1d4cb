"""What the commands print: one ``key<TAB>value`` line for each number, to stdout."""

import json
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from lensforge.commands.options import pipeline
from lensforge.gates import Gate, require


def finish(result: dict[str, Any], directory: Path) -> None:
    """Print one stage's numbers, refresh the report if there is one, and judge the stage's gates."""
    gates = [Gate.from_json(entry) for entry in result.get("gates", [])]
    print_table({key: value for key, value in result.items() if key != "gates"})
    if (directory / "report.html").exists():
        pipeline().run_report(directory)
    require(gates)


def print_table(content: dict[str, Any], prefix: str = "") -> None:
    """One ``key<TAB>value`` line for each number, keys joined by dots: easy to read, grep and cut."""
    for key, value in content.items():
        if isinstance(value, dict):
            print_table(value, f"{prefix}{key}.")
        else:
            click.echo(f"{prefix}{key}\t{json.dumps(value) if isinstance(value, list) else value}")


_HEADLINE = {
    "evaluate": ("nmse", "nmse_standard_error", "uniformity", "efficiency", "efficiency_standard_error"),
    "design": ("steps", "seconds", "max_radius_mm", "height_mm", "constraints"),
    "export": ("form_error_nm", "normal_error_mrad", "watertight", "genus", "volume_mm3"),
    "check": ("min_wall_mm",),
    "verify": ("nmse_vs_design", "noise_floor_nmse", "deviation_mm"),
}


def print_headline(directory: Path) -> None:
    """The numbers that one asks for first, from the JSON files of a whole run."""
    read_json = import_module("lensforge.files").read_json
    for stage, keys in _HEADLINE.items():
        content = read_json(directory / f"{stage}.json")
        print_table({key: content[key] for key in keys if content.get(key) is not None}, f"{stage}.")
