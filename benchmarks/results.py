"""The paper's designs, repeated: prints the rows of docs/results.md from finished result folders.

for name in flat_top pi quickstart; do lensforge design examples/$name.toml; done
python benchmarks/results.py cad_out/flat_top cad_out/pi cad_out/quickstart
"""

import sys
from pathlib import Path

from lensforge.records import Metric
from lensforge.run_folder import load

COLUMNS = (
    "design",
    "uniformity",
    "efficiency",
    "NMSE",
    "r_max / height (mm)",
    "functions a surface, steps",
    "search",
    "STEP form / normal",
)


def shown(metric: Metric | None, digits: int) -> str:
    if metric is None:
        return "–"
    error = metric.standard_error
    return f"{metric.value:.{digits}f}" + ("" if error is None else f" ± {error:.0e}".replace("e-0", "e-"))


def row(directory: Path) -> tuple[str, ...]:
    """The numbers of one result folder, from its records."""
    run = load(directory)
    design, light, part = run.design, run.light, run.part
    return (
        directory.name,
        shown(light.uniformity, 3),
        shown(light.efficiency, 4),
        shown(light.nmse, 5),
        f"{design.max_radius_mm:.3f} / {design.height_mm:.3f}",
        f"{design.lens.basis.size}, {design.steps}",
        f"{design.seconds:.0f} s",
        f"{part.form_error_nm.max:.2f} nm / {1e3 * part.normal_error_mrad.max:.1f} µrad",
    )


def main() -> None:
    print("| " + " | ".join(COLUMNS) + " |")
    print("|" + "---|" * len(COLUMNS))
    for name in sys.argv[1:]:
        print("| " + " | ".join(row(Path(name))) + " |")


if __name__ == "__main__":
    main()
