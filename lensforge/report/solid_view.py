"""The exported mesh in three dimensions: pictures rendered off-screen, and a small mesh to rotate in the page.

A child process renders, within limits of memory and time: where a machine has no renderer, or on a hostile mesh, OpenGL
may end the process instead of raising; then the page says so in one line.

Bytes of the small mesh, little-endian: vertex and triangle counts (uint32); mm per unit, half the height of the first
view (mm) and the z of its centre (mm) (float32); then positions about the origin (int16 x 3 per vertex), triangles
(uint16 x 3) and normals (int8 x 3). ``templates/turn.js`` reads them.
"""

import json
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from lensforge.errors import InputError
from lensforge.results.file_bounds import stl_corners
from lensforge.results.files import temporary_folder
from lensforge.results.sandbox import Child, ChildLimits, Ending, serve

_MESH, _RADIUS = "part.stl", "radius.json"
# A mesh of 200,000 triangles takes 0.5 GiB, 1.3 million take 1 GiB and, on a busy machine, 54 s by software.
_LIMITS = ChildLimits(memory_mib=4096, seconds=60.0)
_AGAIN = "run `lensforge export` again"
_PIXELS = (880, 640)
_GLASS, _CUT = "#a3bfd8", "#e8b27a"
_ON_PLANE = 1e-7  # of the part's size: cells of the cut have all of their corners in it
_WHOLE, _CLOSE = 0.37, 1.45  # half the height of a picture, in the part's diagonal and in the optics' radius
_MARGIN = 1.1  # of a picture over the part that it frames
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
        with ExitStack() as stack:
            self._folder = stack.enter_context(temporary_folder(_MESH))
            (self._folder / _MESH).write_bytes(stl)
            (self._folder / _RADIUS).write_text(json.dumps(optics_radius_mm), encoding="utf-8")
            self._child = stack.enter_context(Child(Path(__file__).resolve(), self._folder, _LIMITS))
            self._stack = stack.pop_all()

    def result(self) -> SolidViews:
        """Wait for the pictures. Raises :class:`InputError` when the bytes are no mesh."""
        ending, words = self._child.wait()
        if ending is Ending.REFUSED:
            raise InputError(words)
        if ending in (Ending.TIME, Ending.MEMORY):
            return SolidViews({}, problem=f"No 3-D picture: the renderer {words}.")
        if ending is not Ending.DONE:
            return SolidViews({}, problem="No 3-D picture: this machine has no off-screen renderer (OpenGL).")
        folder = self._folder
        bounds = json.loads((folder / "bounds.json").read_text(encoding="utf-8"))
        pictures = {name: (folder / f"{name}.png").read_bytes() for name in VIEWS}
        return SolidViews(pictures, tuple(bounds), (folder / "mesh.bin").read_bytes())

    def close(self) -> None:
        """End the process if it still runs, and remove its files."""
        self._stack.close()


def _render(folder: Path) -> None:
    """Work of the child process: one PNG per view, mesh.bin and bounds.json. Raises :class:`InputError` for no mesh."""
    optics_radius_mm = float(json.loads((folder / _RADIUS).read_text(encoding="utf-8")))
    corners = stl_corners((folder / _MESH).read_bytes(), "lens.stl", _AGAIN)  # before a renderer is loaded

    import pyvista as pv

    mesh = _merged(corners)
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


def _merged(corners: Float[np.ndarray, "t 3 3"]) -> Any:
    """Triangles as a pyvista mesh, equal corners merged; without those that lose an area by it."""
    import pyvista as pv

    rows = np.arange(3 * len(corners)).reshape(-1, 3)
    points: Any = corners.reshape(-1, 3).astype(np.float32)  # as the file has them
    mesh: Any = pv.PolyData(points, np.insert(rows, 0, 3, axis=1).ravel()).clean()
    if mesh.n_cells == 0 or not mesh.is_all_triangles:
        mesh = mesh.triangulate()
    if mesh.n_cells == 0 or not mesh.length > 0.0:
        raise InputError(f"lens.stl: none of its triangles has an area; {_AGAIN}")
    return mesh


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


def _framed(mesh: Any, view: _Viewpoint, optics_radius_mm: float) -> tuple[float, tuple[float, float, float]]:
    """Half the height of a picture and its centre (mm): close, but with room to turn in the one that readers turn."""
    half_height, centre_z = _frame(mesh, view, optics_radius_mm)
    if view is VIEWS["above"] or half_height < _WHOLE * mesh.length:
        return half_height, (0.0, 0.0, centre_z)
    camera = np.array(view.camera) / np.linalg.norm(view.camera)
    right = np.cross((0.0, 0.0, 1.0), camera)
    right /= np.linalg.norm(right)
    up = np.cross(camera, right)
    points = np.asarray(mesh.points, dtype=np.float64)
    seen = points[points[:, 1] >= 0.0] if view.cut else points
    across, along = seen @ right, seen @ up
    reach = max(np.ptp(along), np.ptp(across) * _PIXELS[1] / _PIXELS[0])
    x, y, z = 0.5 * (across.min() + across.max()) * right + 0.5 * (along.min() + along.max()) * up
    return 0.5 * _MARGIN * float(reach), (float(x), float(y), float(z))


def _aim(plotter: Any, mesh: Any, view: _Viewpoint, optics_radius_mm: float) -> None:
    """Set a parallel projection from the direction of ``view``."""
    half_height, centre = _framed(mesh, view, optics_radius_mm)
    distance = 3.0 * mesh.length
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
    serve(_render)
