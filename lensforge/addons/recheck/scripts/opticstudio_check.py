# Not run by us: written after ZOSPy 2.2 and its stubs of the ZOS-API; nobody has run it with OpticStudio yet.
"""The light of the exported part by Ansys Zemax OpticStudio, non-sequential: pip install zospy numpy, on its machine.

OpticStudio follows the polarisation: its share of the light is to be compared with ``efficiency``. Reflected rays are
not split off.
"""

import shutil
import sys
from pathlib import Path

import numpy as np
import zospy as zp
from kit_figures import AXES, DETECTOR, HERE, KIT, window

TOTAL_FLUX = 0  # data of pixel 0


def main() -> int:
    """Build the scene, trace, and print both shares."""
    if DETECTOR["kind"] != "plane" or not np.allclose(AXES, np.eye(3)):
        sys.exit("this program places a level plane alone; place the detector of kit.json by hand")
    if KIT["absorption_per_mm"]:
        sys.exit(
            "this program gives the lens an index alone, and yours absorbs; enter a glass with its transmission by hand"
        )
    zos = zp.ZOS()
    kinds = zp.constants.Editors.NCE.ObjectType  # there from here on
    system = zos.connect("standalone")
    system.make_nonsequential()
    system.SystemData.Wavelengths.GetWavelength(1).Wavelength = 1e-3 * KIT["wavelength_nm"]
    objects = Path(zos.Application.ObjectsDir)
    shutil.copy(HERE / "lens.step", objects / "CAD Files" / "lensforge_lens.step")
    shutil.copy(HERE / "source.dat", objects / "Sources" / "Source Files" / "lensforge_source.dat")
    rays = len(np.load(HERE / "source.npy"))
    source = added(system, 1, kinds.SourceFile, "lensforge_source.dat")
    source.ObjectData.NumberOfAnalysisRays = rays
    lens = added(system, 2, kinds.CADPartSTEPIGESSAT, "lensforge_lens.step")
    model = lens.MaterialCell.CreateSolveType(zp.constants.Editors.SolveType.MaterialModel)
    model._S_MaterialModel.IndexNd = KIT["refractive_index"]
    lens.MaterialCell.SetSolveData(model)
    detector = added(system, 3, kinds.DetectorRectangle)
    detector.XPosition, detector.YPosition, detector.ZPosition = DETECTOR["centre_mm"]
    detector.ObjectData.XHalfWidth, detector.ObjectData.YHalfWidth = (0.5 * side for side in window())
    trace = system.Tools.OpenNSCRayTrace()
    trace.ClearDetectors(0)
    trace.UsePolarization = True
    trace.SplitNSCRays = False
    trace.RunAndWaitForCompletion()
    trace.Close()
    _, landed = system.NCE.GetDetectorData(3, 0, TOTAL_FLUX)
    wanted = KIT["expected"]["efficiency"]
    print(f"share of the light: {landed / KIT['source_w']:.5f}; expected {wanted['value']:.5f}")
    print(f"standard errors: {np.sqrt(wanted['value'] * (1.0 - wanted['value']) / rays):.5f} of these rays")
    return 0


def added(system, number, kind, file=""):
    """A new object of a kind, with its file."""
    if number > 1:
        system.NCE.InsertNewObjectAt(number)
    thing = system.NCE.GetObjectAt(number)
    settings = thing.GetObjectTypeSettings(kind)
    if file:
        settings.FileName1 = file
    thing.ChangeType(settings)
    return thing


if __name__ == "__main__":
    sys.exit(main())
