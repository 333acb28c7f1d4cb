"""Rows of kits in tables of the suite."""

import json
from functools import cache
from pathlib import Path

from click.testing import CliRunner
from scenes import small_spec, sphere

from lensforge.addons.recheck.recheck_command import recheck
from lensforge.cad.part import Part
from lensforge.cad.part_export import build_part
from lensforge.light.evaluation_result import Light
from lensforge.light.lens_light import evaluate
from lensforge.report.folder import opened
from lensforge.scene.lens import Lens
from lensforge.surfaces.imported_face import LENS_FILE


@cache
def _lit_part() -> tuple[Lens, Part, Light]:
    lens = Lens.double(sphere(3.0), sphere(6.0), small_spec(), 0, "draft")
    return lens, build_part(lens, rings=12), evaluate(lens, rays=1024).changed(conditions=None)


def of_recheck(flag: str, here: Path) -> bool:
    """Rays in the files, and what is printed."""
    lens, *results = _lit_part()
    lens.save(here / LENS_FILE)
    with opened(here) as folder:
        for result in results:
            folder.write(result)

    def written(*more: str) -> str:
        done = CliRunner().invoke(recheck, [str(here), "--rays", "1024", *more])
        assert done.exception is None, done.exception
        return done.stdout

    if flag == "--rays":
        written()
        return (here / "recheck" / "source.npy").stat().st_size == 128 + 1024 * 6 * 8
    return written("--quiet") == "" and json.loads(written("--json"))["recheck"] == str(here / "recheck")


SHOWN = {"recheck": (of_recheck, ("--rays", "--json", "--quiet"))}
CHOICES = {}
CACHES = {}
