"""Add-ons from inside and outside the package: found, taken by each room, and refused in one line."""

import os
import subprocess
import sys
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType

import pytest
from scenes import small_spec, sphere

import lensforge as lf
from lensforge.addon import Addon, _installed, _shipped, addons, require_libraries, usable_addons
from lensforge.verbs import NAMES, public_names

SHIPPED = Path(lf.__file__).parent / "addons"
OF_ANYBODY = '''
import click
from lensforge.addon import Addon

class Glow:
    """Nothing but a name."""

@click.command()
def glow() -> None:
    """Glow in the dark."""
    click.echo("glowing")

def _records() -> None:
    import acme_record

ADDON = Addon("acme", records=_records, names=lambda: {"Glow": Glow}, commands=lambda: (glow,), heading="Tolerances")
'''


RECORD = '''
from typing import ClassVar
from lensforge.report.results import facts_of
from lensforge.results import Fact, Group, NotNegative, StageResult

class Afterglow(StageResult):
    """Seconds in which a lens glows."""

    stage: ClassVar[str] = "afterglow"
    glow_s: NotNegative

@facts_of.register
def _facts(glow: Afterglow) -> list[Group]:
    return [Group("glow", "Afterglow", (Fact("glow_s", "Afterglow", glow.glow_s, "s"),))]
'''


SHELF = '''
from lensforge.addon import Addon
from lensforge.spec.application import Application

class ShelfSection(Application):
    """A shelf under a lamp, which needs light on the axis."""

    table = "shelves"
    of_table = "Shelves."
    noun = "shelf"

def _light():
    from acme_record import ShelfLight
    return {ShelfSection: ShelfLight}

ADDON = Addon("acme", applications=lambda: (ShelfSection,), light=_light)
'''


SHELF_LIGHT = """
import numpy as np
from lensforge.results import Fact, Group
from lensforge.scene.application_light import ApplicationLight, ApplicationJudgement
from lensforge.scene.intensity_limit import CandelaSum, IntensityLimit

class ShelfLight(ApplicationLight):
    judgement = ApplicationJudgement

    def limits(self):
        from scipy import sparse
        from lensforge.spec.quantities import PlaceLight
        axis = CandelaSum(np.zeros(1), np.zeros(1), sparse.csr_array([[1.0]]))
        yield IntensityLimit("axis", PlaceLight(), ">=", float(self.entry.lighting_class), "cd", axis)

    def judged(self, candela, name):
        from lensforge.light.by_intensities import IntensityFigures
        limits = tuple(IntensityFigures(candela).judged(self.limits(), name))
        return ApplicationJudgement(name=name, lighting_class=self.entry.lighting_class, reached="none", limits=limits)

    def facts(self, judgement):
        return Group("shelf", judgement.name, ())
"""


def installed(folder: Path, module: str, beside: str = RECORD) -> dict[str, str]:
    """Environment of a process in which a package with an entry point is installed, as pip leaves one."""
    (folder / "acme_lenses.py").write_text(module, encoding="utf-8")
    (folder / "acme_record.py").write_text(beside, encoding="utf-8")
    about = folder / "acme_lenses-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: acme-lenses\nVersion: 1.0\n", encoding="utf-8")
    (about / "entry_points.txt").write_text("[lensforge.addons]\nacme = acme_lenses\n", encoding="utf-8")
    return os.environ | {"PYTHONPATH": os.pathsep.join((str(folder), str(SHIPPED.parents[1])))}


def ended(environment: dict[str, str], *arguments: str) -> tuple[int, str, str]:
    done = subprocess.run([sys.executable, *arguments], env=environment, capture_output=True, encoding="utf-8")
    return done.returncode, done.stdout, done.stderr


def test_each_package_of_the_folder_is_an_add_on_of_its_name() -> None:
    folders = sorted(path.parent.name for path in SHIPPED.glob("*/__init__.py"))
    assert [addon.name for addon in addons()] == folders


def test_an_add_on_that_is_installed_adds_its_names_and_commands(tmp_path: Path) -> None:
    environment = installed(tmp_path, OF_ANYBODY)
    code = "import lensforge as lf; print(lf.Glow.__module__, 'Glow' in dir(lf), lf.Glow.__doc__)"
    assert ended(environment, "-c", code) == (0, "acme_lenses True Nothing but a name.\n", "")
    assert ended(environment, "-m", "lensforge", "glow") == (0, "glowing\n", "")
    shown = ended(environment, "-m", "lensforge", "--help")[1]
    assert (
        "  yield        Draw parts of the lens in DIR from its tolerances.\n  glow         Glow in the dark.\n" in shown
    )


def test_the_record_of_an_add_on_is_one_of_a_result_folder(tmp_path: Path) -> None:
    """It is read and shown without a row in any table of the core."""
    lens = lf.Lens.double(sphere(3.0), sphere(6.0), small_spec(), 0, "draft")
    lens.save(tmp_path / "lens.json")
    write = "import acme_record as a; a.Afterglow(glow_s=2.5, inputs={'lens': sys.argv[1]}).write(sys.argv[2])"
    read = "import lensforge as lf; run = lf.load(sys.argv[2]); (glow,) = run.found.values()"
    show = "(group,) = run.facts(glow); print(glow.glow_s, glow.stem, group.title, group.facts[0].text)"
    environment = installed(tmp_path, OF_ANYBODY)
    for code, printed in ((write, ""), (f"{read}; {show}", "2.5 afterglow Afterglow 2.5 s\n")):
        assert ended(environment, "-c", f"import sys; {code}", lens.sha256, str(tmp_path)) == (0, printed, "")


@pytest.mark.parametrize("first", ["", "import acme_lenses; "])
def test_an_application_of_an_add_on_is_judged_by_the_intensity_that_files_hold(tmp_path: Path, first: str) -> None:
    """A table of the spec, a field of the photometry, and a limit of the light, whichever module is loaded first."""
    far = {"kind": "beam", "fwhm_deg": 60.0, "half_angle_deg": 90.0}
    lens = lf.Lens.double(sphere(3.0), sphere(6.0), small_spec(target=far), 0, "draft")
    lens.save(tmp_path / "lens.json")
    judge = (
        f"{first}import lensforge as lf, dataclasses; lens = lf.load_lens({str(tmp_path / 'lens.json')!r}); "
        "spec = lens.spec.replace(shelves=[{'lighting_class': '5', 'lamp_lm': 250.0}]); "
        "own = dataclasses.replace(lens, spec=spec); lit = lf.photometry(own, rays=2**14); "
        "(shelf,) = lit.shelves; (limit,) = shelf.limits; (same,) = lf.evaluate(own, rays=2**14).limits; "
        "print(limit.value / lit.axis_cd.value * lit.source_lm / 250.0, same.label, same.value / limit.value)"
    )
    code, printed, errors = ended(installed(tmp_path, SHELF, SHELF_LIGHT), "-c", judge)
    assert (code, errors) == (0, "")
    on_axis, label, by_light = printed.split(" ", 1)[0], printed.split(" ")[1:3], printed.split(" ")[-1]
    assert (
        float(on_axis) == pytest.approx(1.0) and label == ["shelf:", "axis"] and float(by_light) == pytest.approx(1.0)
    )


@pytest.mark.parametrize(("module", "message"), [
    ("import nowhere", "add-on acme: cannot be loaded (No module named 'nowhere'); install or remove it"),
    ("", "add-on acme: cannot be loaded (module 'acme_lenses' has no attribute 'ADDON'); install or remove it"),
    ("ADDON = 3", "add-on acme: its ADDON is no lensforge.addon.Addon"),
])  # fmt: skip
def test_an_add_on_that_cannot_be_used_is_refused_in_a_line(
    tmp_path: Path, module: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed(tmp_path, module)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "acme_lenses", raising=False)
    (point,) = entry_points(group="lensforge.addons")
    with pytest.raises(lf.InputError) as caught:
        _installed(point)
    assert str(caught.value) == message
    sys.modules.pop("acme_lenses", None)


@pytest.mark.parametrize("names", [("acme", "bolt"), ("bolt", "acme")])
def test_an_add_on_that_cannot_be_used_takes_no_other_with_it(
    names: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whichever of two that are installed is found first."""
    whole = ModuleType("bolt_lenses")
    vars(whole)["ADDON"] = Addon("bolt")
    monkeypatch.setitem(sys.modules, "bolt_lenses", whole)
    points = [EntryPoint(name, f"{name}_lenses", "lensforge.addons") for name in names]
    monkeypatch.setattr("lensforge.addon.entry_points", lambda *, group: points)
    shipped = [addon.name for addon in _shipped()]
    assert [addon.name for addon in usable_addons.__wrapped__()] == [*shipped, "bolt"]


def test_the_core_goes_on_beside_an_add_on_that_cannot_be_used(tmp_path: Path) -> None:
    """A command of the core runs, one that nobody knows ends in a line, and no name of the library is taken."""
    environment = installed(tmp_path, "ADDON = 3")
    assert ended(environment, "-m", "lensforge", "examples")[0] == 0
    refused = "lensforge: add-on acme: its ADDON is no lensforge.addon.Addon\n"
    assert ended(environment, "-m", "lensforge", "glow") == (2, "", refused)
    declared = "from lensforge.addon import Addon\nADDON = Addon('acme', names=lambda: {'design': 3})"
    (tmp_path / "acme_lenses.py").write_text(declared, encoding="utf-8")
    code = "import lensforge as lf\ntry:\n    lf.glow\nexcept lf.InputError as error:\n    print(error)"
    taken = "add-on acme: design is a name that the library has; take another\n"
    assert ended(environment, "-c", code) == (0, taken, "")


def test_a_missing_library_is_named_with_the_remedy() -> None:
    require_libraries("acme", "json", "numpy")
    with pytest.raises(lf.InputError) as caught:
        require_libraries("acme", "json", "no_such_library", "nor_this")
    assert str(caught.value) == 'acme: needs no_such_library, nor_this; pip install "lensforge[acme]"'


def test_names_of_add_ons_are_public_ones() -> None:
    public = public_names()
    for addon in addons():
        for name in addon.names():
            assert getattr(lf, name) is public[name] is NAMES[name] and name in lf.__all__
    assert Addon("acme").names() == {} and Addon("acme").commands() == ()
