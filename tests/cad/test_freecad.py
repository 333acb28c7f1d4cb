"""A STEP file as FreeCAD opens it, whose program for the command line is `freecadcmd` (Debian: freecad-python3)."""

import shutil
import subprocess

import pytest
from geometry_lenses import make_lens

from lensforge.cad.part_export import build_part

pytestmark = [
    pytest.mark.nightly("FreeCAD starts in some seconds; by day the CAD kernel reads the file back"),
    pytest.mark.skipif(shutil.which("freecadcmd") is None, reason="FreeCAD is not installed"),
]
_MACRO = """
import FreeCAD, Import
Import.insert({path!r}, FreeCAD.newDocument("read").Name)
for body in FreeCAD.ActiveDocument.Objects:
    shape = body.Shape
    size = repr(shape.Volume), repr(shape.Area), shape.optimalBoundingBox().ZMax
    print("READ", body.Label, shape.isValid(), len(shape.Solids), *size)
"""


@pytest.mark.parametrize("schema", ["AP214", "AP242"])
def test_freecad_reads_one_valid_solid_of_its_name_and_size(schema, tmp_path):
    part = build_part(make_lens(6.0, 12.7, 0.02, seed=3), schema=schema)
    (tmp_path / "lens.step").write_bytes(part.step)
    (tmp_path / "read.py").write_text(_MACRO.format(path=str(tmp_path / "lens.step")))
    done = subprocess.run(
        ["freecadcmd", str(tmp_path / "read.py")], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120
    )
    (read,) = (line for line in done.stdout.splitlines() if "READ" in line)
    label, valid, solids, volume, area, top = read.split("READ ")[1].split()
    assert (label, valid, solids) == (part.lens.spec.name, "True", "1")
    assert float(volume) == pytest.approx(part.volume_mm3, rel=2e-6)
    assert float(area) == pytest.approx(part.area_mm2, rel=2e-6)
    assert float(top) == pytest.approx(part.mesh.bounds[1][2], abs=1e-3)
