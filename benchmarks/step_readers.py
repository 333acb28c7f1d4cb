"""Seconds that other programs take to open and to mesh STEP files: `python benchmarks/step_readers.py FILE...`.

Run it by a Python that has one of the readers: FreeCAD (of its packages, PYTHONPATH=/usr/lib/freecad-python3/lib),
gmsh, or the CAD kernel of cadquery. Each file is opened three times, of which the median counts.
"""

import statistics
import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

CHORD_MM, SIZE_MM = 0.01, 0.7


def timed(action: Callable[[], Any]) -> tuple[float, Any]:
    """Seconds of an action, and what it returns."""
    started = time.perf_counter()
    done = action()
    return time.perf_counter() - started, done


def by_freecad(path: str) -> tuple[float, float, str]:
    """Seconds to open and to mesh, and what was read."""
    import FreeCAD  # noqa: F401  loads the paths of its modules
    import Part

    opened = [timed(lambda: Part.read(path)) for _ in range(3)]
    shape = opened[0][1]
    meshing, (_, facets) = timed(lambda: shape.tessellate(CHORD_MM))
    read = f"valid {shape.isValid()}, {len(shape.Solids)} solid, {shape.Volume:.6f} mm³, {len(facets)} facets"
    return statistics.median(seconds for seconds, _ in opened), meshing, read


def by_gmsh(path: str) -> tuple[float, float, str]:
    """Seconds to open and to mesh, and what was read."""
    import gmsh

    gmsh.initialize(["gmsh", "-v", "0"])
    gmsh.option.setNumber("Mesh.MeshSizeMax", SIZE_MM)
    opened = []
    for _ in range(3):
        gmsh.clear()
        opened.append(timed(lambda: gmsh.merge(path))[0])
    read = f"{len(gmsh.model.getEntities(3))} solid, {gmsh.model.occ.getMass(3, 1):.6f} mm³"
    meshing, _ = timed(lambda: gmsh.model.mesh.generate(3))
    gmsh.finalize()
    return statistics.median(opened), meshing, read


def by_the_kernel(path: str) -> tuple[float, float, str]:
    """Seconds to open and to mesh, and what was read."""
    import cadquery
    from OCP.BRepMesh import BRepMesh_IncrementalMesh

    opened = [timed(lambda: cadquery.importers.importStep(path).val()) for _ in range(3)]
    shape = opened[0][1]
    meshing, _ = timed(lambda: BRepMesh_IncrementalMesh(shape.wrapped, CHORD_MM))
    read = f"valid {shape.isValid()}, {len(shape.Solids())} solid, {shape.Volume():.6f} mm³"
    return statistics.median(seconds for seconds, _ in opened), meshing, read


READERS = {"FreeCAD": by_freecad, "gmsh": by_gmsh, "cadquery": by_the_kernel}

if __name__ == "__main__":
    for name, reader in READERS.items():
        for path in sys.argv[1:] if find_spec(name) else ():
            opening, meshing, read = reader(path)
            print(f"{name}: {path}: opened in {opening:.2f} s, meshed in {meshing:.1f} s; {read}")
