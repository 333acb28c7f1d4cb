"""Ball, tilt, draft and undercut of finished parts by an independent program: OpenCASCADE on their STEP files.

python benchmarks/shop_oracle.py cad_out/rectangle cad_out/street_lamp

Each folder has been designed and checked. The optical faces of ``lens.step`` are sampled on their own parameters by
OpenCASCADE, with its normals and curvatures; the largest ball is found by brute force over all pairs of samples. At
undercut places of a milled lens a shank as thick as the ball is tried against the whole part, its base and bore too.
None of it shares code with the check. The table has both figures, and says where they differ by more than 1 %, or 0.1
degrees, and where a verdict would differ.
"""

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path

import cadquery as cq
import numpy as np
from jaxtyping import Float
from OCP.BRepAdaptor import BRepAdaptor_Curve2d, BRepAdaptor_Surface
from OCP.BRepLProp import BRepLProp_SLProps
from OCP.BRepTopAdaptor import BRepTopAdaptor_FClass2d
from OCP.gp import gp_Pnt2d
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.STEPControl import STEPControl_Reader
from OCP.TopAbs import TopAbs_Orientation, TopAbs_State

sys.path.append(str(Path(__file__).parent))
from result_tables import table

SIDE = 121  # samples along either parameter of a face
OBSTACLES = 61  # of a face that a shank must not meet
FINER = 21  # around the worst places
ALONG = 721  # samples along each edge
ROWS = 256  # samples of which the pairs are looked at together
MOULDED_DEG = 2.0  # draft of a face that a mould releases, where none is stated
MOST_PLACES = 400  # undercut ones, at which a shank is tried
NEARLY_CLEAR_MM = 1e-3  # of a shank that touches, by samples
FAR = 20.0  # radii of a part, beyond which a ball counts as a plane
Points = Float[np.ndarray, "k 3"]
COLUMNS = ("part, face", "figure", "check", "OpenCASCADE", "verdict")


@dataclass(frozen=True)
class Samples:
    """Points (mm) of a face, unit normals out of the solid, and curvatures (1/mm) that are positive where hollow."""

    points: Float[np.ndarray, "k 3"]
    normals: Float[np.ndarray, "k 3"]
    hollow: Float[np.ndarray, " k"]
    dome: Float[np.ndarray, " k"]


def samples_of(face: cq.Face) -> Samples:
    """Samples of a face: on a grid of its parameters, along its edges, and finer where it is most hollow or domed."""
    u, v = grid_of(face, SIDE)
    step = u[1] - u[0], v[1] - v[0]
    places = [*inside(face, u, v), *along_edges(face)]
    coarse = measured(face, places)
    for worst in (coarse.hollow.argmax(), coarse.dome.argmin(), coarse.normals[:, 2].argmin()):
        near = [np.linspace(at - by, at + by, FINER) for at, by in zip(places[worst], step, strict=True)]
        places += inside(face, *near)
    return measured(face, places)


def grid_of(face: cq.Face, side: int) -> tuple[Float[np.ndarray, " u"], Float[np.ndarray, " v"]]:
    """Even parameters over a face."""
    adaptor = BRepAdaptor_Surface(face.wrapped)
    return (
        np.linspace(adaptor.FirstUParameter(), adaptor.LastUParameter(), side),
        np.linspace(adaptor.FirstVParameter(), adaptor.LastVParameter(), side),
    )


def obstacles_of(face: cq.Face) -> Points:
    """Points of a face that a shank must not meet."""
    return measured(face, [*inside(face, *grid_of(face, OBSTACLES)), *along_edges(face)]).points


def inside(face: cq.Face, u: Float[np.ndarray, " u"], v: Float[np.ndarray, " v"]) -> list[tuple[float, float]]:
    """Parameters of a grid that lie within the edges of a face."""
    within = BRepTopAdaptor_FClass2d(face.wrapped, 1e-9)
    pairs = ((float(x), float(y)) for x in u for y in v)
    return [pair for pair in pairs if within.Perform(gp_Pnt2d(*pair)) == TopAbs_State.TopAbs_IN]


def along_edges(face: cq.Face) -> list[tuple[float, float]]:
    """Parameters along the edges of a face."""
    places = []
    for edge in face.Edges():
        curve = BRepAdaptor_Curve2d(edge.wrapped, face.wrapped)
        for at in np.linspace(curve.FirstParameter(), curve.LastParameter(), ALONG):
            point = curve.Value(float(at))
            places.append((point.X(), point.Y()))
    return places


def measured(face: cq.Face, places: list[tuple[float, float]]) -> Samples:
    """Points, normals and curvatures of a face at these parameters, by OpenCASCADE."""
    adaptor = BRepAdaptor_Surface(face.wrapped)
    sense = -1.0 if face.wrapped.Orientation() == TopAbs_Orientation.TopAbs_REVERSED else 1.0
    rows = []
    for u, v in places:
        at = BRepLProp_SLProps(adaptor, u, v, 2, 1e-9)
        point = at.Value()
        normal = at.Normal()
        bends = sense * at.MinCurvature(), sense * at.MaxCurvature()
        direction = (sense * normal.X(), sense * normal.Y(), sense * normal.Z())
        rows.append((point.X(), point.Y(), point.Z(), *direction, max(bends), min(bends)))
    values = np.array(rows)
    return Samples(values[:, :3], values[:, 3:6], values[:, 6], values[:, 7])


def largest_ball_mm(samples: Samples, air: float) -> float:
    """Radius of the largest ball that touches every sample from its air side, and holds no other; infinite for any.

    ``air``: 1 where that lies along the normals, -1 for the insert of a mould, whose air is the lens.
    """
    bend = samples.hollow if air > 0 else -samples.dome
    with np.errstate(divide="ignore"):
        local = np.where(bend > 0.0, 1.0 / bend, np.inf)
    largest = float(local.min())
    for first in range(0, len(samples.points), ROWS):
        part = slice(first, first + ROWS)
        chord = samples.points[None] - samples.points[part, None]
        ahead = air * np.einsum("rkj,rj->rk", chord, samples.normals[part])
        near = ahead > 1e-9
        radius = np.where(near, np.einsum("rkj,rkj->rk", chord, chord) / np.where(near, 2.0 * ahead, 1.0), np.inf)
        largest = min(largest, float(radius.min()))
    return largest if largest < FAR * float(np.abs(samples.points).max()) else np.inf


def least_room_mm(part: Points, samples: Samples, outwards: float, tilt_deg: float, radius_mm: float) -> float:
    """Least distance (mm) between the ``part`` and a shank as thick as its ball, at all undercut places of a face.

    ``outwards``: sense along z in which an upright shank leaves the face. The axis leans by ``tilt_deg`` to the side of
    the normal. Negative where the shank enters the part; infinite where no place is undercut.
    """
    undercut = np.flatnonzero(outwards * samples.normals[:, 2] < -1e-3)
    tilt = np.radians(tilt_deg)
    least = np.inf
    for place in undercut[:: max(1, len(undercut) // MOST_PLACES)]:
        normal = samples.normals[place]
        towards = normal[:2] / np.hypot(*normal[:2])
        axis = np.array([*(np.sin(tilt) * towards), outwards * np.cos(tilt)])
        away = part - (samples.points[place] + radius_mm * normal)
        along = away @ axis
        across = np.linalg.norm(away - along[:, None] * axis, axis=1)[along > 0.0]
        least = min(least, float(across.min(initial=np.inf)) - radius_mm)
    return least


def faces_of(path: Path) -> dict[str, cq.Face]:
    """The named faces of a STEP file."""
    reader = STEPControl_Reader()
    if reader.ReadFile(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise SystemExit(f"{path}: cannot be read")
    reader.TransferRoots()
    transfer = reader.WS().TransferReader()
    named = {}
    for face in cq.Shape.cast(reader.OneShape()).Faces():
        entity = transfer.EntityFromShapeResult(face.wrapped, 1)
        named[str(entity.Name().ToCString())] = face
    return named


def rows_of(folder: Path) -> list[tuple[str, ...]]:
    """Rows of the table on one part."""
    spec = json.loads((folder / "lens.json").read_text(encoding="utf-8"))["spec"]
    check = json.loads((folder / "check.json").read_text(encoding="utf-8"))
    shop = spec["manufacture"]
    moulded = shop["process"] == "moulded"
    faces = faces_of(folder / "lens.step")
    part = np.concatenate([obstacles_of(face) for face in faces.values()])
    rows = []
    for name in ("inner", "outer"):
        stated = check[name]
        samples = samples_of(faces[f"OPTICAL_{name.upper()}"])
        upwards = -1.0 if name == "inner" else 1.0  # the sense in which the face is left: the cavity downwards
        ball_mm = largest_ball_mm(samples, -1.0 if moulded else 1.0)
        told_mm = stated["cutter"]["largest_radius_mm"] or np.inf
        draft_deg = float(np.degrees(np.arcsin(np.clip(upwards * samples.normals[:, 2], -1.0, 1.0)).min()))
        told_deg = stated["draft_deg"]["min"]
        radius_mm = shop["cutter_radius_mm"]
        if moulded:
            least_deg = MOULDED_DEG if spec["lens"][name]["draft_deg"] is None else spec["lens"][name]["draft_deg"]
        else:
            least_deg = -stated["free_tilt_deg"]
            room_mm = least_room_mm(part, samples, upwards, stated["largest_tilt_deg"], radius_mm)
            clear = room_mm > -NEARLY_CLEAR_MM
            tilt = f"axis at {stated['largest_tilt_deg']:.1f} deg: room of the shank, mm"
            rows.append((name, (tilt, "clear", f"{room_mm:.3f}"), (clear, True, True)))
        same = told_mm == ball_mm or abs(told_mm / ball_mm - 1.0) <= 0.01
        verdicts = (ball_mm >= radius_mm * (1.0 - 1e-3), told_mm >= radius_mm * (1.0 - 1e-6))
        rows.append((name, ("largest ball, mm", f"{told_mm:.4g}", f"{ball_mm:.4g}"), (*verdicts, same)))
        held = (draft_deg >= least_deg - 0.02, told_deg >= least_deg - 0.02)
        same = abs(draft_deg - told_deg) <= 0.1
        rows.append((name, ("least draft, deg", f"{told_deg:.3f}", f"{draft_deg:.3f}"), (*held, same)))
    return [(f"{folder.name}, {name}", *row, _said(*judged)) for name, row, judged in rows]


def _said(here: bool, there: bool, same: bool) -> str:
    other = "" if here == there else " here, not in the check"
    return ("pass" if here else "fail") + other + ("" if same else "; differs")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, help="result folders of lenses of two faces")
    rows = [row for folder in parser.parse_args().folders for row in rows_of(folder)]
    print(table(rows, COLUMNS))
    return int(any(";" in row[-1] or "not" in row[-1] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
