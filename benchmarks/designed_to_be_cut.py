"""Cost in light of designing a lens for the tool that makes it: one row of the table in docs/results.md.

    python benchmarks/designed_to_be_cut.py examples/flat_top.toml [--inner 1.0] [--outer 1.0] [--draft 2.0]

``--inner``, ``--outer``: radius (mm) of the ball cutter for each face; ``--draft``: least draft (deg) of both faces.
Without any of them: the spec as it is. Designs, evaluates and checks; prints one row of Markdown.
"""

import argparse
from pathlib import Path

from lensforge.light.evaluation import evaluate_lens
from lensforge.search.optimiser import search
from lensforge.shop.check import check_lens
from lensforge.shop.check_measures import FaceResult
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec, load_spec, parse_spec
from lensforge.spec.accuracy import PRESETS


def with_constraints(spec: Spec, options: argparse.Namespace) -> Spec:
    """The spec with the constraints of the command line."""
    content = spec.model_dump(mode="json")
    for face in spec.lens.faces:
        content["lens"][face] |= {"concave_radius_mm": getattr(options, face), "draft_deg": options.draft}
    if options.offset is not None:
        content["lens"]["inner"]["offset_mm"] = options.offset
    return parse_spec(content, spec.name)


def constraints_text(options: argparse.Namespace) -> str:
    """Text of the command line's constraints."""
    given = {"inner": options.inner, "outer": options.outer, "draft": options.draft}
    return ", ".join(f"{name} {value:g}" for name, value in given.items() if value is not None) or "nothing"


def largest(face: FaceResult) -> str:
    """The largest ball (mm) that reaches all of a face: by its curvature, and without gouging."""
    local, ball = face.curvature.smallest_concave_radius_mm, face.cutter.largest_radius_mm
    return " / ".join("any" if value is None else f"{value:.3f}" for value in (local, ball))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("spec", type=Path)
    parser.add_argument("--inner", type=float)
    parser.add_argument("--outer", type=float)
    parser.add_argument("--draft", type=float)
    parser.add_argument("--offset", type=float, help="starting radius of the inner face (mm)")
    parser.add_argument("--accuracy", default="standard", choices=tuple(PRESETS))
    parser.add_argument("--save", type=Path, help="where to write lens.json")
    options = parser.parse_args()
    spec = with_constraints(load_spec(options.spec), options)
    source = build_source(spec.source)
    found = search(spec, source, accuracy=options.accuracy)
    if options.save is not None:
        found.lens.save(options.save)
    light = evaluate_lens(found.lens, source, PRESETS[options.accuracy])
    check = check_lens(found.lens)
    faces = check.faces.values()
    missed = [criterion.key for criterion in found.criteria if not criterion.holds]
    columns = [
        constraints_text(options),
        f"{light.uniformity.value:.3f}" if light.uniformity is not None else "-",
        f"{light.efficiency.value:.4f}",
        f"{light.nmse.value:.4f}",
        *(largest(face) for face in faces),
        *(f"{face.draft_deg.min:.1f}" for face in faces),
        ", ".join(missed) or "all met",
    ]
    print("| " + " | ".join(columns) + " |", flush=True)


if __name__ == "__main__":
    main()
