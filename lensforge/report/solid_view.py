"""The exported mesh in three dimensions: pictures rendered off-screen, and a small mesh to rotate in the page.

A separate process renders: where a machine has no renderer, OpenGL may end the process instead of raising; then the
page says so in one line. That process runs this file: ``solid_view.py STL FOLDER RADIUS``.

Bytes of the small mesh, little-endian: vertex and triangle counts (uint32); mm per unit, half the height of the first
view (mm) and the z of its centre (mm) (float32); then positions about the origin (int16 x 3 per vertex), triangles
(uint16 x 3) and normals (int8 x 3). ``templates/turn.js`` reads them.
"""

import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from lensforge.errors import InputError

# -P: the folder of this file is not searched for modules, only where lensforge itself is installed.
_COMMAND = (sys.executable, "-P", str(Path(__file__).resolve()))
_MESH = "part.stl"
_LIMIT_SECONDS = 60.0
_UNREADABLE = 3  # exit code of the process when the file is no mesh
_PIXELS = (880, 640)
_GLASS, _CUT = "#a3bfd8", "#e8b27a"
_ON_PLANE = 1e-7  # of the part's size: cells of the cut have all of their corners in it
_WHOLE, _CLOSE = 0.37, 1.45  # half the height of a picture, in the part's diagonal and in the optics' radius
MOST_TRIANGLES = 12_000  # about 110 kB: too coarse to measure on, fine enough to look at
_EDGE_DEG = 35.0  # sharper edges keep two normals
_CANDIDATES = 8


@dataclass(frozen=True)
class _Viewpoint:
    """Direction to the ``camera``; ``cut``: without the half towards it; ``close``: the optics only."""

    camera: tuple[float, float, float]
    cut: bool = False
    close: bool = True


VIEWS = {
    "above": _Viewpoint((0.75, -1.2, 0.75)),
    "cut": _Viewpoint((0.25, -1.2, 0.45), cut=True),
    "below": _Viewpoint((0.6, -1.0, -1.0), close=False),
}


@dataclass(frozen=True)
class SolidViews:
    """PNG pictures by name of the view, the bounds of the part (mm, low and high x, y, z), or why there are none.

    ``mesh``: the part to rotate in a browser, as :func:`small_mesh` packs it.
    """

    pictures: dict[str, bytes]
    bounds_mm: tuple[float, ...] = ()
    mesh: bytes = b""
    problem: str = ""


class Rendering:
    """A rendering of the bytes of an STL in the background, so that figures can be drawn meanwhile."""

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
    except Exception as error:  # whatever the reader raises, the file is not a mesh
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
        plotter.add_light(pv.Light(light_type="headlight", intensity=0.15))  # else the underside is dark
        _aim(plotter, mesh, view, optics_radius_mm)
        plotter.screenshot(folder / f"{name}.png", transparent_background=True, return_img=False)
        plotter.close()
    half_height, centre_z = _frame(mesh, VIEWS["above"], optics_radius_mm)
    (folder / "mesh.bin").write_bytes(small_mesh(mesh, half_height, centre_z))
    (folder / "bounds.json").write_text(json.dumps([float(bound) for bound in mesh.bounds]), encoding="utf-8")


def _parts(mesh: Any, cut: bool) -> list[tuple[Any, str]]:
    """The mesh, or its half behind y = 0, with the cut face in its own flat colour."""
    if not cut:
        return [(mesh, _GLASS)]
    half = mesh.clip_closed_surface(normal="y", origin=(0.0, 0.0, 0.0))
    cap = abs(half.cell_centers().points[:, 1]) < _ON_PLANE * mesh.length
    return [(half.remove_cells(cap), _GLASS), (half.remove_cells(~cap), _CUT)]


def _frame(mesh: Any, view: _Viewpoint, optics_radius_mm: float) -> tuple[float, float]:
    """Half the height of a picture (mm) and the z of its centre (mm), for the part, or for its optics if small."""
    whole, close = _WHOLE * mesh.length, _CLOSE * optics_radius_mm
    if view.close and close < whole:
        return close, 0.4 * optics_radius_mm
    return whole, mesh.center[2]


def _aim(plotter: Any, mesh: Any, view: _Viewpoint, optics_radius_mm: float) -> None:
    """Set a parallel projection from the direction of ``view``."""
    half_height, centre_z = _frame(mesh, view, optics_radius_mm)
    distance = 3.0 * mesh.length
    centre = (0.0, 0.0, centre_z)
    position = tuple(c + distance * d for c, d in zip(centre, view.camera, strict=True))
    plotter.camera_position = [position, centre, (0.0, 0.0, 1.0)]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = half_height
    plotter.enable_anti_aliasing("ssaa")


def small_mesh(mesh: Any, half_height_mm: float, centre_z_mm: float) -> bytes:
    """Pack a triangle mesh (pyvista) for the page; the normals are those of the full mesh."""
    coarse = mesh
    if mesh.n_cells > MOST_TRIANGLES:
        coarse = mesh.decimate(1.0 - MOST_TRIANGLES / mesh.n_cells)
    coarse, fine = _with_normals(coarse), _with_normals(mesh)
    normals = _nearest_normals(coarse, fine)
    triangles = np.asarray(coarse.faces).reshape(-1, 4)[:, 1:]
    return _pack(np.asarray(coarse.points, dtype=np.float64), triangles, normals, half_height_mm, centre_z_mm)


def _pack(
    points: Float[np.ndarray, "n 3"],
    triangles: Int[np.ndarray, "m 3"],
    normals: Float[np.ndarray, "n 3"],
    half_height_mm: float,
    centre_z_mm: float,
) -> bytes:
    """Bytes of the mesh, quantised: positions to 1/32767 of the largest coordinate, normals to 1/127."""
    unit = float(np.abs(points).max()) / 32767.0
    counts = np.array([len(points), len(triangles)], dtype="<u4")
    view = np.array([unit, half_height_mm, centre_z_mm], dtype="<f4")
    parts = (
        counts,
        view,
        np.round(points / unit).astype("<i2"),
        triangles.astype("<u2"),
        np.round(127.0 * normals).astype("i1"),
    )
    return b"".join(part.tobytes() for part in parts)


def _with_normals(mesh: Any) -> Any:
    return mesh.compute_normals(split_vertices=True, feature_angle=_EDGE_DEG, consistent_normals=False)


def _nearest_normals(coarse: Any, fine: Any) -> Float[np.ndarray, "n 3"]:
    """Normal of the nearby vertices of the full mesh that agrees best: at an edge there are two."""
    own, full = np.asarray(coarse.point_data["Normals"]), np.asarray(fine.point_data["Normals"])
    count = min(_CANDIDATES, fine.n_points)
    _, nearest = cKDTree(fine.points).query(coarse.points, k=count)
    candidates = full[np.reshape(nearest, (-1, count))]
    best = np.argmax(np.einsum("nkc,nc->nk", candidates, own), axis=1)
    return np.asarray(candidates[np.arange(len(own)), best], dtype=np.float64)


if __name__ == "__main__":
    try:
        _render(Path(sys.argv[1]), Path(sys.argv[2]), float(sys.argv[3]))
    except ValueError:
        sys.exit(_UNREADABLE)
