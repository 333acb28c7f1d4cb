"""Light on receivers of every kind, beside what physics allows: prints the rows of docs/results.md.

for name in rectangle wall_washer batwing elliptical_beam from_ies two_distances curved_screen signal; do
    lensforge design examples/$name.toml
done
python benchmarks/receivers.py --wall cad_out/vertical_wall        # a wall at 45 degrees, designed
python benchmarks/receivers.py cad_out/rectangle cad_out/wall_washer ...
python benchmarks/receivers.py --again cad_out/from_ies              # its own IES file given back as the target
"""

import lensforge as lf  # before torch, whose idle threads then sleep

# isort: split
import argparse
from collections.abc import Iterator
from math import sqrt
from pathlib import Path

from results import shown

EXAMPLES = Path(__file__).parents[1] / "examples"
COLUMNS = ("design", "receiver", "NMSE", "min/mean", "in the target", "efficiency", "possible", "search")
AWAY_MM = 500.0  # from the lens to the middle of the wall


def vertical_wall() -> lf.Spec:
    """The wall washer's rectangle on a wall parallel to the axis, its middle 45 degrees off it."""
    spec = lf.load_spec(EXAMPLES / "wall_washer.toml")
    (wall,) = spec.receivers
    there = {"centre_mm": (AWAY_MM / sqrt(2.0), 0.0, AWAY_MM / sqrt(2.0)), "tilt_deg": (0.0, 90.0)}
    return spec.replace(receivers=[{**wall.model_dump(exclude_unset=True), "kind": wall.kind, **there}])


def again(folder: Path) -> lf.Spec:
    """A fresh search for the far field of a finished lens, from the IES file that it makes."""
    run, file = lf.load(folder), folder / "again.ies"
    file.write_bytes(lf.photometry(run.lens, rays=2**22).ies)
    half_angle_deg = run.spec.all_receivers[0].extent[0] / 2.0
    target = {"kind": "photometric", "file": str(file), "half_angle_deg": half_angle_deg}
    return run.spec.replace(target=target)


def rows(folder: Path) -> Iterator[tuple[str, ...]]:
    """Rows of a finished result folder: one for each receiver."""
    run = lf.load(folder)
    for light in run.light.receivers:
        least = light.efficiency.value / light.possible.efficiency
        yield (
            folder.name,
            f"{light.name}, {light.place}",
            shown(light.nmse, 5),
            shown(light.uniformity, 3),
            shown(light.share_in_target, 4),
            shown(light.efficiency, 4),
            f"{light.possible.efficiency:.3f}; reached {least:.3f} of it",
            f"{run.design.seconds:.0f} s",
        )
    for limit in run.light.limits:
        words = f"{limit.label}: {limit.note} {limit.text}, must be {limit.required}"
        yield (folder.name, limit.place, words, limit.outcome, "", "", "", "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--wall", type=Path, help="folder for the design of the vertical wall")
    parser.add_argument("--again", type=Path, help="folder of a lens whose far field is the next target")
    given = parser.parse_args()
    folders = list(given.folders)
    if given.wall:
        folders.append(lf.run(vertical_wall(), given.wall).folder)
    if given.again:
        folders.append(lf.run(again(given.again), given.again.with_name(f"{given.again.name}_again")).folder)
    print("| " + " | ".join(COLUMNS) + " |\n" + "|---" * len(COLUMNS) + "|")
    for folder in folders:
        for row in rows(folder):
            print("| " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
