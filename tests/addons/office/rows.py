"""Rows of offices in tables of the suite."""

import json
from pathlib import Path
from xml.etree import ElementTree
from zipfile import ZipFile

import pytest
from cie_luminaire import OFFICE
from click.testing import CliRunner
from scenes import small_spec, sphere

from lensforge.addons.office.gldf_command import gldf
from lensforge.addons.office.office_light import OfficeLight
from lensforge.addons.office.office_room import OfficeReadings
from lensforge.addons.office.office_section import OfficeSection
from lensforge.light.lens_light import photometry
from lensforge.report.folder import opened
from lensforge.scene.lens import Lens
from lensforge.surfaces.imported_face import LENS_FILE

Case = tuple[object, object]  # found, and by hand

# Transfer factors FW and WW - 1 of CIE 190, table 5: of rooms for 70/50/20, and of 4H 8H for other reflectances.
BY_ROOM = {
    "2H 2H": (0.220, 0.422), "2H 3H": (0.199, 0.376), "2H 4H": (0.187, 0.351), "2H 6H": (0.174, 0.322),
    "2H 8H": (0.167, 0.307), "2H 12H": (0.160, 0.290), "4H 2H": (0.187, 0.351), "4H 3H": (0.158, 0.295),
    "4H 4H": (0.142, 0.265), "4H 6H": (0.124, 0.230), "4H 8H": (0.115, 0.211), "4H 12H": (0.105, 0.190),
    "8H 4H": (0.115, 0.211), "8H 6H": (0.094, 0.175), "8H 8H": (0.083, 0.155), "8H 12H": (0.071, 0.133),
    "12H 4H": (0.105, 0.190), "12H 6H": (0.083, 0.153), "12H 8H": (0.071, 0.133),
}  # fmt: skip
BY_REFLECTANCES = {
    "70/50/20": (0.115, 0.211), "70/30/20": (0.106, 0.117), "50/50/20": (0.100, 0.187), "50/30/20": (0.093, 0.104),
    "30/30/20": (0.081, 0.092),
}  # fmt: skip


def _onto_walls(**fields: str) -> tuple[float, float]:
    return OfficeReadings(OfficeSection(**OFFICE, **fields))._onto_walls()


def room(name: str) -> Case:
    return _onto_walls(room=name), pytest.approx(BY_ROOM[name], abs=6e-4)


def reflectances(name: str) -> Case:
    return _onto_walls(reflectances=name), pytest.approx(BY_REFLECTANCES[name], abs=6e-4)


def lighting_class(name: str) -> Case:
    office = OfficeSection(**OFFICE | {"lighting_class": name})
    return {limit.bound for limit in OfficeLight(office).limits()}, {float(name.removeprefix("UGR "))}


def of_gldf(flag: str, here: Path) -> bool:
    """Efficacy by the power, and what is printed."""
    lens = Lens.double(sphere(3.0), sphere(6.0), small_spec(), 0, "draft")
    lens.save(here / LENS_FILE)
    with opened(here) as folder:
        folder.write(photometry(lens, rays=1024, lumens=100.0).changed(conditions=None))

    def written(*more: str) -> str:
        done = CliRunner().invoke(gldf, [str(here), *more])
        assert done.exception is None, done.exception
        return done.stdout

    def efficacy() -> str | None:
        with ZipFile(here / "lens.gldf") as archive:
            return ElementTree.fromstring(archive.read("product.xml")).findtext(".//LuminousEfficacy")

    if flag == "--watts":
        lumens = json.loads(written("--watts", "2", "--json"))["variants"][0]["lumens"]
        halved = efficacy()
        written()
        return float(halved or 0.0) == pytest.approx(lumens / 2.0, rel=1e-3) and efficacy() is None
    return written("--quiet") == "" and json.loads(written("--json"))["gldf"] == str(here / "lens.gldf")


SHOWN = {"gldf": (of_gldf, ("--watts", "--json", "--quiet"))}
CHOICES = {"room": room, "reflectances": reflectances, "OfficeSection.lighting_class": lighting_class}
CACHES = {}
