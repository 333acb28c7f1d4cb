"""The paper's designs, made again: prints the rows of docs/results.md from finished result folders.

for name in flat_top pi quickstart led_rayfile; do lensforge design examples/$name.toml; done
python benchmarks/results.py cad_out/flat_top cad_out/pi cad_out/quickstart cad_out/led_rayfile
"""

import sys
from pathlib import Path
from typing import Any

from lensforge.files import read_json

COLUMNS = (
    "design",
    "uniformity",
    "efficiency",
    "NMSE",
    "r_max / height (mm)",
    "steps × rays",
    "design time",
    "STEP form / normal",
)


def shown(value: float | None, error: float | None, digits: int) -> str:
    if value is None:
        return "–"
    return f"{value:.{digits}f}" if error is None else f"{value:.{digits}f} ± {error:.0e}".replace("e-0", "e-")


def row(directory: Path) -> tuple[str, ...]:
    """The figures of one result folder, as its JSON files state them."""
    stages: dict[str, Any] = {name: read_json(directory / f"{name}.json") for name in ("design", "evaluate", "export")}
    design, judged, part = stages["design"], stages["evaluate"], stages["export"]
    return (
        directory.name,
        shown(judged["uniformity"], judged["uniformity_standard_error"], 3),
        shown(judged["efficiency"], judged["efficiency_standard_error"], 4),
        shown(judged["nmse"], judged["nmse_standard_error"], 4),
        f"{design['max_radius_mm']:.3f} / {design['height_mm']:.3f}",
        f"{design['steps']} × {design['rays_per_step']}",
        f"{design['seconds']:.0f} s",
        f"{part['form_error_nm']['max']:.2f} nm / {1e3 * part['normal_error_mrad']['max']:.1f} µrad",
    )


def main() -> None:
    print("| " + " | ".join(COLUMNS) + " |")
    print("|" + "---|" * len(COLUMNS))
    for name in sys.argv[1:]:
        print("| " + " | ".join(row(Path(name))) + " |")


if __name__ == "__main__":
    main()
