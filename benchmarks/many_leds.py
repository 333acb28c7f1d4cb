"""Ten ray files to ten verified lenses, by one command; and what one lens for several LEDs loses.

    python benchmarks/many_leds.py ten [--spec led_rayfile] [--accuracy standard] [--folder FOLDER]
    python benchmarks/many_leds.py one [--spec second_source] [--accuracy standard]

``ten``: the LED of examples/make_led_rayfile.py with chips of 1.0 to 1.9 mm and 60,000 rays each, designed for by
``lensforge design SPEC --sources``; seconds of the command, and the verdict on each part's light and files. ``one``:
every LED of the spec with its own lens and in the one for all, by rays that no search has used. Nothing else should
run.
"""

import argparse
import json
import runpy
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import lensforge as lf
from lensforge.sources.rayfiles.ray_file_io import write_rayfile

EXAMPLES = Path(__file__).parents[1] / "examples"
CHIPS_MM = [1.0 + 0.1 * number for number in range(10)]
RAYS = 60_000


def write_leds(folder: Path) -> list[Path]:
    """Ray files of chips of all sizes."""
    files = []
    for number, chip_mm in enumerate(CHIPS_MM):
        led = runpy.run_path(str(EXAMPLES / "make_led_rayfile.py"))
        make = led["make_led"]
        make.__globals__.update(CHIP_MM=chip_mm, RAYS=RAYS, SEED=led["SEED"] + number)
        files.append(folder / f"led_{chip_mm:.1f}.tm25ray")
        write_rayfile(files[-1], make(), "tm25")
    return files


def ten(spec: str, accuracy: str, folder: Path) -> None:
    """Design for every file by one command."""
    files = write_leds(folder)
    out = folder / "designs"
    command = [
        sys.executable,
        "-m",
        "lensforge",
        "design",
        str(EXAMPLES / f"{spec}.toml"),
        "--sources",
        *map(str, files),
    ]
    began = time.perf_counter()
    ended = subprocess.run([*command, "--accuracy", accuracy, "--out", str(out), "--quiet"], check=False)
    seconds = time.perf_counter() - began
    for row in json.loads((out / "sweep.json").read_text())["designs"]:
        run = lf.load(out / row["folder"])
        print(
            f"{row['value']:10} NMSE {run.light.nmse}, efficiency {run.light.efficiency}, light {run.verdict.light}, "
            f"files {run.verdict.files}, {run.design.steps} steps, {run.seconds:.0f} s"
        )
    print(f"{len(files)} files, {accuracy}: {seconds:.0f} s, exit code {ended.returncode}")


def one(spec: str, accuracy: str) -> None:
    """Each LED with its own lens, and in the one for all."""
    content = lf.load_spec(EXAMPLES / f"{spec}.toml")
    common = lf.evaluate(lf.design(content, accuracy=accuracy).lens).by_led
    for led, own in zip(content.sources, content.of_each_source, strict=True):
        best, with_all = lf.evaluate(lf.design(own, accuracy=accuracy).lens), common[led.name]
        print(
            f"{led.name:10} own lens: NMSE {best.nmse}, efficiency {best.efficiency}; one for all: NMSE {with_all.nmse}"
            f", efficiency {with_all.efficiency}; efficiency lost "
            f"{100.0 * (1.0 - with_all.efficiency.value / best.efficiency.value):.2f} %, NMSE ratio "
            f"{with_all.nmse.value / best.nmse.value:.2f}",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", choices=("ten", "one"))
    parser.add_argument("--spec")
    parser.add_argument("--accuracy", default="standard")
    parser.add_argument("--folder", type=Path)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    if options.study == "one":
        one(options.spec or "second_source", options.accuracy)
    elif options.folder is not None:
        options.folder.mkdir(parents=True, exist_ok=True)
        ten(options.spec or "led_rayfile", options.accuracy, options.folder)
    else:
        with tempfile.TemporaryDirectory() as folder:
            ten(options.spec or "led_rayfile", options.accuracy, Path(folder))


if __name__ == "__main__":
    main()
