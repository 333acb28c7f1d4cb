"""``road``: the photometry of any lamp judged on a road."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import click
import numpy as np

from lensforge.addons.road.road_facts import road_facts, spacing_fact, with_remedies
from lensforge.addons.road.road_record import RoadJudgement
from lensforge.addons.road.road_section import load_roads
from lensforge.cli.conclusion import rows_of
from lensforge.cli.options import Number
from lensforge.cli.output import Block, Output, warning_line, with_output
from lensforge.errors import CriterionMissed, InputError
from lensforge.results import Group
from lensforge.sources.light_files import read_photometric
from lensforge.sources.photometric.photometric_file import PhotometricFile, cut_below, far_field_warnings
from lensforge.spec.application import names_of

_STEP_DEG = 2.5  # of gamma: CIE 140
_BETTER = 1.2  # a lamp that lights both sides alike is within a few per cent


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--road",
    "roads",
    type=click.Path(path_type=Path),
    required=True,
    metavar="TOML",
    help="File with [[roads]]: those of a spec, or roads alone.",
)
@click.option(
    "--street-c",
    type=Number(-360.0, 360.0),
    default=90.0,
    metavar="DEG",
    help="C of the file towards the street: 90 in Europe, often 0 in America, 270 of a lens with its street at +y.",
)
@click.option("--spacing", is_flag=True, help="Also find the largest spacing of poles that meets each class.")
@with_output
def road(file: Path, roads: Path, street_c: float, spacing: bool, output: Output) -> None:
    """Judge the lamp of a photometric file on a road.

    Luminance for every driver, glare and edges by EN 13201-3, and the class of the road; of an IES LM-63,
    EULUMDAT or TM-33 file.
    """
    from lensforge.addons.road.road_judgement import held_spacing, judge_road
    from lensforge.light.by_intensities import of_file

    lamp = read_photometric(file)
    wanted = load_roads(roads)
    if (warning := cut_below(lamp)) is not None:
        raise InputError(f"{file}: {warning}: too narrow for the row and its glare; export it up to gamma = 90 degrees")
    lights = [of_file(lamp, street_c, section.lamp_lm) for section in wanted]
    judgements = [judge_road(*case) for case in zip(wanted, lights, names_of(wanted), strict=True)]
    for warning in (*far_field_warnings(lamp), *coarse_for_roads(lamp)):
        click.echo(warning_line(warning), err=True)
    groups = [road_facts(*case) for case in zip(judgements, wanted, strict=True)]
    if spacing:
        held = (held_spacing(*case) for case in zip(wanted, lights, strict=True))
        groups = [
            replace(group, facts=(*group.facts, spacing_fact(spacing_held)))
            for group, spacing_held in zip(groups, held, strict=True)
        ]
    output.show(
        lambda: _document(file, groups, judgements),
        lambda: [Block(f"{group.title}, by {file}", list(rows_of([group]))) for group in groups],
    )
    turned = [judge_road(section, of_file(lamp, street_c + 180.0, section.lamp_lm)) for section in wanted]
    if _least_lit(turned) > _BETTER * _least_lit(judgements):
        gain = _least_lit(turned) / _least_lit(judgements)
        other = f"with --street-c {(street_c + 180.0) % 360.0:g} the roads get {gain:.3g}"
        click.echo(warning_line(f"{other} times the light: is the street on that side of the lamp?"), err=True)
    missed = [
        f"{judgement.name}: {limit.reason}"
        for judgement in judgements
        for limit in with_remedies(judgement.limits)
        if not limit.holds
    ]
    if missed:
        raise CriterionMissed(f"{file}: {missed[0]}" + (f"; and {len(missed) - 1} more" if missed[1:] else ""))


def coarse_for_roads(file: PhotometricFile) -> Iterator[str]:
    """Warning on steps of gamma below 90 degrees that are longer than CIE 140 requires."""
    gamma_deg = file.intensity.gamma_deg
    step_deg = float(np.diff(gamma_deg[gamma_deg <= 90.0]).max(initial=0.0))
    if step_deg > _STEP_DEG * (1.0 + 1e-6):
        yield (
            f"its steps of gamma are up to {step_deg:g} degrees, CIE 140 requires {_STEP_DEG:g} at most: glare may "
            "be off by a tenth; export it with finer steps"
        )


def _least_lit(judgements: Sequence[RoadJudgement]) -> float:
    """Least ratio of light to the requirement of its class."""
    lit = [
        limit for judgement in judgements for limit in judgement.limits if (limit.note, limit.sense) == ("light", ">=")
    ]
    return min((limit.metric.value / limit.bound for limit in lit), default=1.0)


def _document(file: Path, groups: list[Group], judgements: list[RoadJudgement]) -> dict[str, object]:
    facts = [group.plain() for group in groups]
    return {"file": str(file), "facts": facts, "roads": [judgement.model_dump(mode="json") for judgement in judgements]}
