"""What it costs to design a lens for the tool that makes it: one row of the table in docs/results.md.

    python benchmarks/designed_to_be_cut.py examples/flat_top.toml [--inner 1.0] [--outer 1.0] [--draft 2.0]

``--inner``, ``--outer``: radius (mm) of the ball cutter for each face; ``--draft``: least draft (deg) of both faces.
Without any of them: the spec as it is. Designs, evaluates and checks; prints one row of Markdown.
"""

import argparse
import tempfile
from pathlib import Path
from typing import Any

from lensforge.accuracy import PRESETS
from lensforge.optimisation.optimiser import design
from lensforge.evaluation.evaluate import evaluate_lens
from lensforge.manufacturing.check import check_lens
from lensforge.sources.build import build_source
from lensforge.spec import Spec, load_spec, parse_spec


def asked_for(spec: Spec, options: argparse.Namespace) -> Spec:
    """The spec with the constraints of the command line."""
    content = spec.model_dump(mode="json")
    content["constraints"] |= {
        "inner_concave_radius_mm": options.inner,
        "outer_concave_radius_mm": options.outer,
        "inner_draft_deg": options.draft,
        "outer_draft_deg": options.draft,
    }
    if options.offset is not None:
        content["lens"]["inner_offset_mm"] = options.offset
    return parse_spec(content, spec.name)


def wish(options: argparse.Namespace) -> str:
    """What was asked for, in words."""
    asked = {"inner": options.inner, "outer": options.outer, "draft": options.draft}
    return ", ".join(f"{name} {value:g}" for name, value in asked.items() if value is not None) or "nothing"


def largest(check: dict[str, Any], face: str) -> str:
    """The largest ball (mm) that reaches all of a face: by its curvature, and without gouging."""
    local, ball = check[face]["curvature"]["smallest_concave_radius_mm"], check[face]["cutter"]["largest_radius_mm"]
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
    spec = asked_for(load_spec(options.spec), options)
    source = build_source(spec.source)
    found = design(spec, source, accuracy=options.accuracy)
    if options.save is not None:
        found.lens.save(options.save)
    report = evaluate_lens(found.lens, source, PRESETS[options.accuracy]).report
    with tempfile.TemporaryDirectory() as folder:
        check = check_lens(found.lens, Path(folder))
    failed = [gate.name for gate in found.gates if not gate.passed]
    columns = [
        wish(options),
        f"{report['uniformity']:.3f}" if report["uniformity"] is not None else "-",
        f"{report['efficiency']:.4f}",
        f"{report['nmse']:.4f}",
        *(largest(check, face) for face in ("inner", "outer")),
        *(f"{check[face]['draft_deg']['min']:.1f}" for face in ("inner", "outer")),
        ", ".join(failed) or "all hold",
    ]
    print("| " + " | ".join(columns) + " |", flush=True)


if __name__ == "__main__":
    main()
