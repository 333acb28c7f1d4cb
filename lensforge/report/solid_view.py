"""The exported mesh in three dimensions, rendered off-screen by a process of its own.

Where a machine has no renderer at all, OpenGL may end the process instead of raising: then the page says so in one
line and all else stays. This file is what that process runs: ``solid_view.py STL FOLDER RADIUS``.
"""

import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lensforge.errors import InputError
from lensforge.report.turn_mesh import small_mesh

# -P: the folder of this file is not searched for modules, only where lensforge itself is installed.
_COMMAND = (sys.executable, "-P", str(Path(__file__).resolve()))
_MESH = "part.stl"
_LIMIT_SECONDS = 60.0
_UNREADABLE = 3  # exit code of the process when the file is no mesh
_PIXELS = (880, 640)
_GLASS, _CUT = "#a3bfd8", "#e8b27a"
_ON_PLANE = 1e-7  # of the part's size: cells of the cut have all of their corners in it

_WHOLE, _CLOSE = 0.37, 1.45  # half the height of a picture: of the part's diagonal, of the optics' radius


@dataclass(frozen=True)
class _View:
    """``camera``: direction in which it stands; ``cut``: without the half towards it; ``close``: the optics only."""

    camera: tuple[float, float, float]
    cut: bool = False
    close: bool = True


VIEWS = {
    "above": _View((0.75, -1.2, 0.75)),
    "cut": _View((0.25, -1.2, 0.45), cut=True),
    "below": _View((0.6, -1.0, -1.0), close=False),
}


@dataclass(frozen=True)
class SolidViews:
    """PNG pictures by name of the view, the bounds of the part (mm, low and high x, y, z), or why there are none.

    ``mesh``: the part to turn in a browser, as :mod:`lensforge.report.turn_mesh` packs it.
    """

    pictures: dict[str, bytes]
    bounds_mm: tuple[float, ...] = ()
    mesh: bytes = b""
    problem: str = ""


class Rendering:
    """A rendering of the bytes of an STL under way, so that figures can be drawn meanwhile."""

    def __init__(self, stl: bytes, optics_radius_mm: float) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="lensforge-")
        folder = Path(self._folder.name).resolve()
        (folder / _MESH).write_bytes(stl)
        self._process = subprocess.Popen(
            [*_COMMAND, str(folder / _MESH), str(folder), str(optics_radius_mm)],
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            stdin=subprocess.DEVNULL,
        )

    def result(self) -> SolidViews:
        """Wait for the pictures. Raises :class:`InputError` when the bytes are no mesh."""
        try:
            code = self._process.wait(_LIMIT_SECONDS)
        except subprocess.TimeoutExpired:
            return SolidViews({}, problem=f"No 3-D picture: the renderer took more than {_LIMIT_SECONDS:.0f} s.")
        finally:
            self._process.kill()
            self._process.wait()
        if code == _UNREADABLE:
            raise InputError("lens.stl: not a readable mesh; run `lensforge export` again")
        if code != 0:
            return SolidViews({}, problem="No 3-D picture: this machine has no off-screen renderer (OpenGL).")
        folder = Path(self._folder.name)
        bounds = json.loads((folder / "bounds.json").read_text(encoding="utf-8"))
        pictures = {name: (folder / f"{name}.png").read_bytes() for name in VIEWS}
        return SolidViews(pictures, tuple(bounds), (folder / "mesh.bin").read_bytes())

    def close(self) -> None:
        """End the process if it still runs, and remove its files."""
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        self._folder.cleanup()


def _render(stl: Path, folder: Path, optics_radius_mm: float) -> None:
    """Write one PNG per view, mesh.bin and bounds.json into ``folder``; :class:`ValueError` for what is no mesh."""
    import pyvista as pv

    try:
        mesh: Any = pv.read(stl).clean()
    except Exception as error:  # whatever the reader throws, the file is not a mesh
        raise ValueError(str(error)) from error
    if mesh.n_cells == 0:
        raise ValueError("no triangles")
    for name, view in VIEWS.items():
        plotter = pv.Plotter(off_screen=True, window_size=list(_PIXELS))
        for part, colour in _parts(mesh, view.cut):
            plotter.add_mesh(
                part, color=colour, smooth_shading=True, split_sharp_edges=True, feature_angle=35.0, specular=0.35,
                specular_power=25.0, ambient=0.12, lighting=colour != _CUT,
            )  # fmt: skip
        plotter.add_light(pv.Light(light_type="headlight", intensity=0.15))  # the standard lights leave it dark below
        _aim(plotter, mesh, view, optics_radius_mm)
        plotter.screenshot(folder / f"{name}.png", transparent_background=True, return_img=False)
        plotter.close()
    half_height, centre_z = _frame(mesh, VIEWS["above"], optics_radius_mm)
    (folder / "mesh.bin").write_bytes(small_mesh(mesh, half_height, centre_z))
    (folder / "bounds.json").write_text(json.dumps([float(bound) for bound in mesh.bounds]), encoding="utf-8")


def _parts(mesh: Any, cut: bool) -> list[tuple[Any, str]]:
    """The mesh, or its half behind y = 0, with the cut in a flat colour of its own."""
    if not cut:
        return [(mesh, _GLASS)]
    half = mesh.clip_closed_surface(normal="y", origin=(0.0, 0.0, 0.0))
    cap = abs(half.cell_centers().points[:, 1]) < _ON_PLANE * mesh.length
    return [(half.remove_cells(cap), _GLASS), (half.remove_cells(~cap), _CUT)]


def _frame(mesh: Any, view: _View, optics_radius_mm: float) -> tuple[float, float]:
    """Half the height of a picture (mm) and the z of its centre: of the part, or of its optics if those are small."""
    whole, close = _WHOLE * mesh.length, _CLOSE * optics_radius_mm
    if view.close and close < whole:
        return close, 0.4 * optics_radius_mm
    return whole, mesh.center[2]


def _aim(plotter: Any, mesh: Any, view: _View, optics_radius_mm: float) -> None:
    """A parallel view from the direction of ``view``."""
    half_height, centre_z = _frame(mesh, view, optics_radius_mm)
    distance = 3.0 * mesh.length
    centre = (0.0, 0.0, centre_z)
    position = tuple(c + distance * d for c, d in zip(centre, view.camera, strict=True))
    plotter.camera_position = [position, centre, (0.0, 0.0, 1.0)]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = half_height
    plotter.enable_anti_aliasing("ssaa")


if __name__ == "__main__":
    try:
        _render(Path(sys.argv[1]), Path(sys.argv[2]), float(sys.argv[3]))
    except ValueError:
        sys.exit(_UNREADABLE)
