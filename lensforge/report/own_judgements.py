"""Judgements of a record made again from its other entries, and those that its file states held against them.

A file that somebody edited may state right hashes of wrong content. Its criteria and findings follow from what else it
states and from the lens, so that neither a value nor a limit nor a state can be changed alone.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import Any

from lensforge.cad.plate_layout import PlateWall
from lensforge.errors import InputError
from lensforge.light.evaluation_result import Light
from lensforge.proof.acceptance import proof_criteria
from lensforge.proof.proof_result import Proof
from lensforge.results import Fact, ResultByLed, Sense, StageResult
from lensforge.results.criteria import named
from lensforge.results.stage_result import require_same_judgements
from lensforge.scene.lens import Lens
from lensforge.shop.check_facts import spec_of
from lensforge.shop.check_result import Check
from lensforge.shop.findings import check_findings, edge_criteria, plate_findings, wall_criteria
from lensforge.shop.turning_findings import layer_findings, turning_findings
from lensforge.spec import Spec

Judge = Callable[[Any, Lens], Iterable[Fact]]


def _bounds(spec: Spec) -> Iterator[tuple[str, Sense, float]]:
    """Name, sense and bound of each limit of the spec, in the order in which light is judged; roads left out."""
    for number, limit in enumerate(spec.limits):
        for least, most in map(limit.bounds, limit.quantities()):
            bounds: dict[Sense, float | None] = {">=": least, "<=": most}
            names = limit.labels(number)
            yield from ((name, sense, bound) for name in names for sense, bound in bounds.items() if bound is not None)


def _limits(light: Light, lens: Lens) -> Iterator[Fact]:
    """Limits of the spec with the bounds that it states; those of roads and colours are taken as stated."""
    for stated, asked in zip_longest(light.limits, _bounds(lens.spec) if light.limits else ()):
        name, sense, bound = asked or (stated.key, stated.sense, stated.limit)
        yield replace(stated or Fact(name, name, None), key=name, sense=sense, limit=bound)


def _findings(check: Check, lens: Lens) -> Iterator[Fact]:
    """Findings on faces, base, wall and tools, and on the room of a plate, which is taken as stated."""
    spec = spec_of(check, lens.spec)
    yield from check_findings(spec, check.faces, check.min_wall_mm, check.relief, check.tools, check.mould)
    yield from turning_findings(spec, check.faces)
    yield from layer_findings(spec, check.faces)
    gap, wall = named(check.verdicts, "gap"), named(check.verdicts, "plate")
    thinnest = PlateWall(wall.value, "") if wall is not None and isinstance(wall.value, float) else None
    yield from plate_findings(spec, None if gap is None else gap.limit, thinnest)


# By the field of a record that holds them.
JUDGES: dict[type[StageResult], dict[str, Judge]] = {
    Light: {"limits": _limits},
    Check: {
        "criteria": lambda check, lens: wall_criteria(lens.spec, check.walls) + edge_criteria(lens.spec, check.edges),
        "verdicts": _findings,
    },
    Proof: {"criteria": lambda proof, lens: proof_criteria(proof, on_plate=lens.lamps_on_plate)},
}


def judged_again(result: StageResult, lens: Lens) -> Mapping[str, tuple[Fact, ...]]:
    """The judgements of ``result`` on ``lens`` as its figures make them, by the field that holds them."""
    return {field: tuple(judge(result, lens)) for field, judge in JUDGES.get(type(result), {}).items()}


def require_own_judgements(result: StageResult, lens: Lens, path: Path) -> None:
    """Raise :class:`InputError` where judgements in the file at ``path`` are not those that its figures make.

    Those on another lens count nowhere, and are not judged by the limits of this one.
    """
    if result.inputs.get("lens") != lens.sha256:
        return
    remedy = type(result).rebuild_command()
    try:
        for record in result.by_led.values() if isinstance(result, ResultByLed) else (result,):
            for field, made in judged_again(record, lens).items():
                require_same_judgements(field, getattr(record, field), made)
    except ValueError as error:
        raise InputError(f"{path}: {error}; {remedy}") from None
    except (ArithmeticError, LookupError):  # a volume of 0, a face that the lens has not
        raise InputError(f"{path}: not what a {result.stage} of this lens can be; {remedy}") from None
