"""The exported mesh in three dimensions: pictures rendered off-screen, and a small mesh to rotate in the page.

A child process renders, within limits of memory and time: where a machine has no renderer, or on a hostile mesh, OpenGL
may end the process instead of raising; then the page says so in one line.

Bytes of the small mesh, little-endian: vertex and triangle counts (uint32); mm per unit, half the height of the first
view (mm) and the z of its centre (mm) (float32); then positions about the origin (int16 x 3 per vertex), triangles
(uint16 x 3) and normals (int8 x 3). ``templates/turn.js`` reads them.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import InputError
from lensforge.results.file_bounds import stl_corners
from lensforge.results.files import temporary_folder
from lensforge.results.sandbox import Child, ChildLimits, Ending, serve

_MESH = "part.stl"
_RADIUS = "radius.json"
_PLATE = "plate.stl"
# A mesh of 200,000 triangles takes 0.5 GiB, 1.3 million take 1 GiB and, on a busy machine, 54 s by software.
_LIMITS = ChildLimits(memory_mib=4096, seconds=60.0)
_AGAIN = "run `lensforge export` again"
_PIXELS = (880, 640)
_FINER = 2  # drawn so many times as fine and averaged, so that edges are smooth
_GLASS = "#a3bfd8"
_CUT = "#e8b27a"
_ON_PLANE = 1e-7  # of the part's size: cells of the cut have all of their corners in it
_WHOLE = 0.37  # half the height of a picture, in diagonals of the part
_CLOSE = 1.45  # the same of a close view, in radii of the optics
_MARGIN = 1.1  # of a picture over the part that it frames
MOST_TRIANGLES = 12_000  # about 110 kB: too coarse to measure on, fine enough to look at
_EDGE_DEG = 35.0  # sharper edges keep two normals
_CANDIDATES = 8
_FLAT = 1.3e-4  # of the size: 5 um of a lens of 39 mm


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
_OF_PLATE = {"plate": _Viewpoint((0.45, -1.0, 0.9), close=False)}


@dataclass(frozen=True)
class SolidViews:
    """PNG pictures by name of the view, the bounds of the part (mm, low and high x, y, z), or why there are none.

    ``mesh``: the part to rotate in a browser, as :func:`small_mesh` packs it.
    """

    pictures: dict[str, bytes]
    bounds_mm: tuple[float, ...] = ()
    mesh: bytes = b""
    problem: str = ""


def solid_views(stl: bytes, optics_radius_mm: float, plate_stl: bytes | None = None) -> SolidViews:
    """Render the bytes of an STL, and of a plate's, in a child process. Raises :class:`InputError` for no mesh."""
    with temporary_folder(_MESH) as folder:
        for name, content in {_MESH: stl, _PLATE: plate_stl}.items():
            if content is not None:
                (folder / name).write_bytes(content)
        (folder / _RADIUS).write_text(json.dumps(optics_radius_mm), encoding="utf-8")
        with Child(Path(__file__).resolve(), folder, _LIMITS) as child:
            ending, message = child.wait()
        if ending is Ending.REFUSED:
            raise InputError(message)
        if ending in (Ending.TIME, Ending.MEMORY):
            return SolidViews({}, problem=f"No 3-D picture: the renderer {message}.")
        if ending is not Ending.DONE:
            return SolidViews({}, problem="No 3-D picture: this machine has no off-screen renderer (OpenGL).")
        bounds = json.loads((folder / "bounds.json").read_text(encoding="utf-8"))
        pictures = {path.stem: path.read_bytes() for path in folder.glob("*.png")}
        return SolidViews(pictures, tuple(bounds), (folder / "mesh.bin").read_bytes())


def _render(folder: Path) -> None:
    """Work of the child process: one PNG per view, mesh.bin and bounds.json. Raises :class:`InputError` for no mesh."""
    optics_radius_mm = float(json.loads((folder / _RADIUS).read_text(encoding="utf-8")))
    # before a renderer is loaded
    names = {_MESH: "lens.stl", _PLATE: _PLATE}
    given = {name: folder / name for name in names if (folder / name).exists()}
    corners = {name: stl_corners(path.read_bytes(), names[name], _AGAIN) for name, path in given.items()}
    mesh = _merged(corners[_MESH])
    shaded = _with_normals(mesh)
    _draw_views(folder, mesh, shaded, optics_radius_mm, VIEWS)
    if _PLATE in corners:
        plate = _merged(corners[_PLATE])
        _draw_views(folder, plate, _with_normals(plate), optics_radius_mm, _OF_PLATE)
    half_height, centre_z = _frame(mesh, VIEWS["above"], optics_radius_mm)
    (folder / "mesh.bin").write_bytes(small_mesh(mesh, half_height, centre_z, shaded))
    (folder / "bounds.json").write_text(json.dumps([float(bound) for bound in mesh.GetBounds()]), encoding="utf-8")


def _merged(corners: Float[np.ndarray, "t 3 3"]) -> Any:
    """Triangles as a ``vtkPolyData``, equal corners merged; without those that lose an area by it."""
    from vtkmodules.vtkFiltersCore import vtkCleanPolyData, vtkTriangleFilter

    points = corners.reshape(-1, 3).astype(np.float32)  # as the file has them
    mesh = _output(vtkCleanPolyData(), _triangle_mesh(points, np.arange(len(points)).reshape(-1, 3)))
    if mesh.GetNumberOfCells() != mesh.GetNumberOfPolys():
        of_polygons = vtkTriangleFilter()
        of_polygons.PassVertsOff()
        of_polygons.PassLinesOff()
        mesh = _output(of_polygons, mesh)
    if mesh.GetNumberOfCells() == 0 or not mesh.GetLength() > 0.0:
        raise InputError(f"lens.stl: none of its triangles has an area; {_AGAIN}")
    return mesh


def _triangle_mesh(points: Float[np.ndarray, "n 3"], triangles: Int[np.ndarray, "m 3"]) -> Any:
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    places = vtkPoints()
    cells = vtkCellArray()
    mesh = vtkPolyData()
    places.SetData(numpy_to_vtk(points, deep=True))
    ends = np.arange(0, triangles.size + 1, 3, dtype=np.int64)
    cells.SetData(
        *(numpy_to_vtkIdTypeArray(indices, deep=True) for indices in (ends, triangles.astype(np.int64).ravel()))
    )
    mesh.SetPoints(places)
    mesh.SetPolys(cells)
    return mesh


def _output(step: Any, mesh: Any) -> Any:
    step.SetInputData(mesh)
    step.Update()
    return step.GetOutput()


def _draw_views(folder: Path, mesh: Any, shaded: Any, optics_radius_mm: float, views: Mapping[str, _Viewpoint]) -> None:
    """One PNG for each of ``views`` of ``mesh``, ``shaded`` by its normals: a window and its shaders serve them all."""
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  by which there is a window
    from vtkmodules.vtkCommonDataModel import vtkPlane
    from vtkmodules.vtkRenderingCore import vtkRenderWindow

    renderer = _renderer()
    window = vtkRenderWindow()
    plane = vtkPlane()
    plane.SetNormal(0.0, 1.0, 0.0)
    window.SetMultiSamples(0)
    window.SetAlphaBitPlanes(1)
    window.SetOffScreenRendering(1)
    window.SetSize(*(_FINER * side for side in _PIXELS))
    window.AddRenderer(renderer)
    solid = _actor(shaded, _GLASS)
    renderer.AddActor(solid)
    for name, view in views.items():
        cut = [_actor(_cap(mesh, plane), _CUT)] if view.cut else []
        for cap in cut:
            cap.GetProperty().LightingOff()
            renderer.AddActor(cap)
            solid.GetMapper().AddClippingPlane(plane)
        _aim(renderer, mesh, view, optics_radius_mm)
        _save(window, folder / f"{name}.png")
        solid.GetMapper().RemoveAllClippingPlanes()
        for cap in cut:
            renderer.RemoveActor(cap)


def _save(window: Any, path: Path) -> None:
    """Render what a window shows, as a PNG with a transparent ground."""
    from PIL import Image
    from vtkmodules.vtkRenderingCore import vtkWindowToImageFilter

    window.Render()
    shown = vtkWindowToImageFilter()
    shown.SetInputBufferTypeToRGBA()
    shown.ShouldRerenderOff()
    shown.ReadFrontBufferOff()
    shown.SetInput(window)
    shown.Update()
    pixels = _array(shown.GetOutput().GetPointData().GetScalars()).reshape(*window.GetSize()[::-1], 4)
    fine = Image.fromarray(np.ascontiguousarray(pixels[::-1])).convert("RGBa")  # by which edges keep their colour
    fine.reduce(_FINER).convert("RGBA").save(path)


def _renderer() -> Any:
    """A renderer with a transparent ground, a kit of lights and a parallel projection."""
    from vtkmodules.vtkRenderingCore import vtkLight, vtkLightKit, vtkRenderer

    renderer = vtkRenderer()
    light = vtkLight()
    vtkLightKit().AddLightsToRenderer(renderer)
    light.SetLightTypeToHeadlight()
    light.SetIntensity(0.15)  # else the underside is dark
    renderer.AddLight(light)
    renderer.SetBackground(1.0, 1.0, 1.0)
    renderer.SetBackgroundAlpha(0.0)
    renderer.GetActiveCamera().ParallelProjectionOn()
    return renderer


def _actor(mesh: Any, colour: str) -> Any:
    from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

    mapper = vtkPolyDataMapper()
    actor = vtkActor()
    mapper.SetInputData(mesh)
    mapper.ScalarVisibilityOff()
    actor.SetMapper(mapper)
    look = actor.GetProperty()
    look.SetInterpolationToPhong()
    look.SetColor(*(share / 255.0 for share in bytes.fromhex(colour[1:])))
    look.SetAmbient(0.12)
    look.SetSpecular(0.35)
    look.SetSpecularColor(look.GetColor())
    look.SetSpecularPower(25.0)
    return actor


def _cap(mesh: Any, plane: Any) -> Any:
    from vtkmodules.vtkCommonDataModel import vtkPlaneCollection
    from vtkmodules.vtkFiltersGeneral import vtkClipClosedSurface

    planes = vtkPlaneCollection()
    cut = vtkClipClosedSurface()
    planes.AddItem(plane)
    cut.SetClippingPlanes(planes)
    half = _output(cut, mesh)
    points = _points(half)
    triangles = _triangles(half)
    flat = (np.abs(points[:, 1]) < _ON_PLANE * mesh.GetLength())[triangles].all(axis=1)
    return _triangle_mesh(points, triangles[flat])


def _frame(mesh: Any, view: _Viewpoint, optics_radius_mm: float) -> tuple[float, float]:
    """Half the height of a picture (mm) and the z of its centre (mm), for the part, or for its optics if small."""
    whole = _WHOLE * mesh.GetLength()
    close = _CLOSE * optics_radius_mm
    if view.close and close < whole:
        return close, 0.4 * optics_radius_mm
    return whole, mesh.GetCenter()[2]


def _framed(mesh: Any, view: _Viewpoint, optics_radius_mm: float) -> tuple[float, tuple[float, float, float]]:
    """Half the height of a picture and its centre (mm): close, but with room to turn in the one that readers turn."""
    half_height, centre_z = _frame(mesh, view, optics_radius_mm)
    if view is VIEWS["above"] or half_height < _WHOLE * mesh.GetLength():
        return half_height, (0.0, 0.0, centre_z)
    camera = np.array(view.camera) / np.linalg.norm(view.camera)
    right = np.cross((0.0, 0.0, 1.0), camera)
    right /= np.linalg.norm(right)
    up = np.cross(camera, right)
    points = _points(mesh)
    seen = points[points[:, 1] >= 0.0] if view.cut else points
    across = seen @ right
    along = seen @ up
    reach = max(np.ptp(along), np.ptp(across) * _PIXELS[1] / _PIXELS[0])
    x, y, z = 0.5 * (across.min() + across.max()) * right + 0.5 * (along.min() + along.max()) * up
    return 0.5 * _MARGIN * float(reach), (float(x), float(y), float(z))


def _aim(renderer: Any, mesh: Any, view: _Viewpoint, optics_radius_mm: float) -> None:
    half_height, centre = _framed(mesh, view, optics_radius_mm)
    distance = 3.0 * mesh.GetLength()
    camera = renderer.GetActiveCamera()
    camera.SetPosition(*(c + distance * d for c, d in zip(centre, view.camera, strict=True)))
    camera.SetFocalPoint(*centre)
    camera.SetViewUp(0.0, 0.0, 1.0)
    camera.SetParallelScale(half_height)
    renderer.ResetCameraClippingRange()


def small_mesh(mesh: Any, half_height_mm: float, centre_z_mm: float, shaded: Any = None) -> bytes:
    """Pack a triangle mesh (``vtkPolyData``) for the page; the normals are those of the full mesh.

    ``shaded``: the same with its normals, where they are known.
    """
    coarse = _with_normals(_reduced(mesh))
    normals = _nearest_normals(coarse, shaded or _with_normals(mesh))
    return _pack(_points(coarse), _triangles(coarse), normals, half_height_mm, centre_z_mm)


def _reduced(mesh: Any) -> Any:
    """``mesh`` with at most ``MOST_TRIANGLES``: first of a closed one all that bends less than a part of a pixel."""
    from manifold3d import Error, Manifold, Mesh
    from vtkmodules.vtkFiltersCore import vtkQuadricDecimation

    if mesh.GetNumberOfPolys() <= MOST_TRIANGLES:
        return mesh
    closed = Manifold(Mesh(_points(mesh).astype(np.float32), _triangles(mesh).astype(np.uint32)))
    if closed.status() is Error.NoError:
        fewer = closed.simplify(_FLAT * mesh.GetLength()).to_mesh()
        mesh = _triangle_mesh(fewer.vert_properties[:, :3], fewer.tri_verts)
    if (count := mesh.GetNumberOfPolys()) <= MOST_TRIANGLES:
        return mesh
    decimation = vtkQuadricDecimation()
    decimation.SetTargetReduction(1.0 - MOST_TRIANGLES / count)
    return _output(decimation, mesh)


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
    from vtkmodules.vtkFiltersCore import vtkPolyDataNormals

    normals = vtkPolyDataNormals()
    normals.SetFeatureAngle(_EDGE_DEG)
    normals.ConsistencyOff()
    return _output(normals, mesh)


def _nearest_normals(coarse: Any, fine: Any) -> Float[np.ndarray, "n 3"]:
    """Normal of the nearby vertices of the full mesh that agrees best: at an edge there are two."""
    from vtkmodules.vtkCommonCore import vtkIdList
    from vtkmodules.vtkCommonDataModel import vtkStaticPointLocator

    normals, full = (_array(mesh.GetPointData().GetNormals()) for mesh in (coarse, fine))
    count = min(_CANDIDATES, len(full))
    nearest_ids = vtkIdList()
    near = vtkStaticPointLocator()
    near.SetDataSet(fine)
    near.BuildLocator()
    candidates = np.empty((len(normals), count, 3))
    for row, point in enumerate(_points(coarse).tolist()):
        near.FindClosestNPoints(count, point, nearest_ids)
        candidates[row] = full[[nearest_ids.GetId(number) for number in range(count)]]
    best = np.argmax(np.einsum("nkc,nc->nk", candidates, normals), axis=1)
    return np.asarray(candidates[np.arange(len(normals)), best])


def _points(mesh: Any) -> Float[np.ndarray, "n 3"]:
    return _array(mesh.GetPoints().GetData()).astype(np.float64)


def _triangles(mesh: Any) -> Int[np.ndarray, "m 3"]:
    return _array(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3)


def _array(values: Any) -> np.ndarray:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    return np.asarray(vtk_to_numpy(values))


if __name__ == "__main__":
    serve(_render)
