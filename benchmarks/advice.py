"""Light that drafts reach by kind of lens, beam and size: what `lensforge new` advises by.

python benchmarks/advice.py                # adds what lensforge/search/drafts.csv lacks: twenty minutes on a free core
python benchmarks/advice.py --errors       # how far that table is from other drafts, as a table in Markdown

Each draft is the lens that `lensforge new` writes, with the seed 0. Its row is added as soon as it is there, so that
the command may be stopped and called again. The others are the drafts of the shipped specs (docs/gallery.json), and
those of `new` in benchmarks/advice_held_out.csv, to which the same command adds.
"""

import argparse
import csv
import datetime
import json
import subprocess
from collections.abc import Iterator, Sequence
from math import cos, pi, radians, sin, sqrt, tan
from pathlib import Path
from typing import NamedTuple

import lensforge as lf
from lensforge.errors import InputError
from lensforge.light.lens_light import source_of
from lensforge.report.new_scene import NewScene
from lensforge.search.designed_light import COLUMNS, DRAFTS, DraftPlace, designed_light, series_of
from lensforge.search.lens_advice import light_shape, turned_share
from lensforge.search.scene_check import SceneCheck
from lensforge.spec import parse_spec
from lensforge.spec.new_spec import source_in, target_in
from lensforge.spec.shipped_specs import shipped_specs

ROOT = Path(__file__).resolve().parents[1]
HELD_OUT = Path(__file__).with_name("advice_held_out.csv")
RADIUS_MM = 14.0
DISTANCE_MM = 500.0
_CORNERS = ((5.0, 20.0), (40.0, 40.0), (40.0, 9.0))
PLACES = {  # half angles (degrees), and sizes of the lens over that of the LED
    ("double", "rectangle"): (*_CORNERS, (10.0, 20.0), (20.0, 14.0), (20.0, 30.0), (28.0, 30.0)),
    ("tir", "rectangle"): (*_CORNERS, (20.0, 14.0)),
    ("tir", "disc"): (*_CORNERS, (16.0, 20.0)),
}


class Case(NamedTuple):
    """What ``lensforge new`` is told, in its words."""

    kind: str
    source: str
    target: str
    radius_mm: str = f"{RADIUS_MM:g}"
    material: str = "PMMA"
    cutter: str = "usual"

    @property
    def spec(self) -> lf.Spec:
        """The spec that it writes."""
        light = {"target": target_in(self.target)}
        scene = NewScene.of("draft", light, source_in(self.source), float(self.radius_mm)).of_material(self.material)
        shape = light_shape(parse_spec(scene.content(self.kind), "draft"))
        return parse_spec(scene.tables(self.kind, self.cutter, shape), "draft")


FIRST_LENS = Case("tir", "disc:1", "rectangle:200x150@300")  # amid the others, between which its light is not linear
NEW_HELD_OUT = (
    FIRST_LENS._replace(kind="double"),
    Case("double", "square:1.77245", "rectangle:323.219x323.219@500", cutter="mould"),
)


def cases() -> Iterator[Case]:
    """The lights of the table: even discs, squares of the same solid angle, and the first lens."""
    for (kind, shape), places in PLACES.items():
        for half_angle_deg, size in places:
            yield Case(kind, f"square:{sqrt(pi) * RADIUS_MM / size:.6g}", _target(shape, radians(half_angle_deg)))
    yield FIRST_LENS


def _target(shape: str, half_angle_rad: float) -> str:
    if shape == "disc":
        return f"disc:{2.0 * DISTANCE_MM * tan(half_angle_rad):.6g}@{DISTANCE_MM:g}"
    part = sin(0.5 * pi * (1.0 - cos(half_angle_rad)))  # t²/(1 + t²), t the tangent of half of a square's side
    side_mm = 2.0 * DISTANCE_MM * sqrt(part / (1.0 - part))
    return f"rectangle:{side_mm:.6g}x{side_mm:.6g}@{DISTANCE_MM:g}"


SHIPPED = (  # specs of an even field with soft edges by one lens, some of other materials
    "coated_cover_glass", "desk_spot", "oval", "printed", "projector", "rectangle", "silicone", "solar_simulator",
    "uv_curing",
)  # fmt: skip


class Draft(NamedTuple):
    """A draft's place, the bound of its kind, and its figures."""

    half_angle_deg: float
    size: float
    possible: float
    efficiency: float
    nmse: float


def place_of(spec: lf.Spec) -> tuple[float, float, float]:
    """Half angle, size, and the bound of the kind of lens. Raises :class:`InputError` where no drafts tell of it."""
    source = source_of(spec)
    place = DraftPlace.of(spec, source)
    if place is None:
        raise InputError(f"{spec.name}: no drafts tell of such light")
    return place.half_angle_deg, place.size, turned_share(spec, source)


def row_of(case: Case) -> list[str]:
    """The draft of a case, as a row of the table. Raises :class:`InputError` where ``lensforge new`` refuses it."""
    spec = case.spec
    SceneCheck.of(spec, source_of(spec)).require_light()
    place = place_of(spec)
    light = lf.evaluate(lf.design(spec, accuracy="draft").lens, accuracy="draft").receivers[0]
    numbers = (*place, light.efficiency.value, light.nmse.value)
    return [*case, series_of(spec)[1], *(f"{number:.5g}" for number in numbers)]


def rows_of(path: Path) -> list[list[str]]:
    """The rows of a table that are there."""
    if not path.exists():
        return []
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return list(csv.reader(lines))[1:]


def add_missing(path: Path, wanted: Iterator[Case] | Sequence[Case]) -> None:
    """Design what a table lacks, and add a row for each."""
    if not path.exists():
        git = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
        commit = subprocess.run(git, capture_output=True, encoding="utf-8", check=True).stdout.strip()
        day = datetime.datetime.now(datetime.UTC).date().isoformat()
        head = f"# python benchmarks/advice.py, {day}, commit {commit}, seed 0\n{','.join(COLUMNS)}\n"
        path.write_text(head, encoding="utf-8")
    known = {tuple(row[: len(Case._fields)]) for row in rows_of(path)}
    for case in wanted:
        if case not in known:
            row = row_of(case)
            with path.open("a", encoding="utf-8", newline="") as table:
                csv.writer(table, lineterminator="\n").writerow(row)
            print(" ".join(row), flush=True)


def held_out() -> Iterator[tuple[str, tuple[str, str], Draft]]:
    """Name, series and figures of each draft that is no part of the table."""
    for row in rows_of(HELD_OUT):
        case = Case(*row[: len(Case._fields)])
        yield f"`new`, {case.source}, {case.target}, {case.cutter}", (case.kind, row[-6]), Draft(*map(float, row[-5:]))
    gallery = json.loads((ROOT / "docs" / "gallery.json").read_text(encoding="utf-8"))
    for name in SHIPPED:
        spec = lf.load_spec(shipped_specs()[name])
        light = gallery[name]
        yield f"`{name}`", series_of(spec), Draft(*place_of(spec), light["efficiency"][0], light["nmse"][0])


def print_errors() -> None:
    """Print a row for each draft that was held out: what it reached, and what the table says."""
    print("| draft | kind | half angle | size | efficiency | by the table | NMSE | by the table |")
    print("|---|---|---|---|---|---|---|---|")
    for name, series, draft in held_out():
        efficiency, nmse = by_table(series, draft)
        print(
            f"| {name} | {series[0]} | {draft.half_angle_deg:.1f}° | {draft.size:.1f} | {draft.efficiency:.3f} "
            f"| {efficiency:.3f} | {draft.nmse:.2g} | {nmse:.2g} |",
            flush=True,
        )


def by_table(series: tuple[str, str], draft: Draft) -> tuple[float, float]:
    """Efficiency and NMSE that the table has at the place of a draft. Raises :class:`InputError` beyond its drafts."""
    light = designed_light(series, DraftPlace(draft.half_angle_deg, draft.size))
    if light is None:
        raise InputError(f"{series[0]}, {draft.half_angle_deg:.1f}°, {draft.size:.1f}: beyond the drafts of the table")
    return light.of_possible * draft.possible, light.nmse


def main() -> None:
    """Add to the tables, or print the errors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--errors", action="store_true", help="how far the table is from other drafts")
    if parser.parse_args().errors:
        print_errors()
    else:
        add_missing(DRAFTS, cases())
        add_missing(HELD_OUT, NEW_HELD_OUT)


if __name__ == "__main__":
    main()
