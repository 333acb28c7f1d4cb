"""The designed body in plain numbers, for each file that the export writes.

An optical face becomes a table of exact radii, with as many nodes as its measured error asks for; base and plate become
planes and walls, from the spec and the exact rims: nothing of the fitted faces that are exported is used.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from lensforge.cad.boundary import Domain, TrimmedFace, lens_boundaries, optical_name
from lensforge.cad.cutter_room import base_with_room
from lensforge.cad.drawn_body import END_FACE
from lensforge.cad.facets import CHORD_MM
from lensforge.cad.flange import FlangeRing, ring_of
from lensforge.cad.form_error import chart_samples, remember_fit
from lensforge.cad.keep_out import mesh_error_mm
from lensforge.cad.outline import circle
from lensforge.cad.part import SURFACES_FILE, Part
from lensforge.cad.plan import (
    FOOT_END,
    FOOT_SIDE,
    RIM,
    RIM_FLANGE_BOTTOM,
    RIM_FLANGE_SIDE,
    RIM_FLANGE_TOP,
    Corner,
    Plan,
    base_corners,
    lay_out,
    rim_directions,
    rim_points,
    rim_radius,
)
from lensforge.cad.plate_layout import (
    BOSS_BORE,
    BOSS_ROOF,
    PIN_END,
    PIN_SIDE,
    PLATE_BORE,
    PLATE_BOTTOM,
    PLATE_HOLE,
    PLATE_SIDE,
    PLATE_TOP,
    PlateLayout,
    RoundWall,
    layout_of,
)
from lensforge.cad.plate_result import PLATE_FILES
from lensforge.proof.designed_body import (
    Designed,
    DesignedBody,
    DesignedFace,
    DrawnProfile,
    Ends,
    Levels,
    PlacedFace,
    StandingWalls,
)
from lensforge.proof.file_form import Chords, DesignedFile
from lensforge.proof.optical_faces import PlateOfLenses
from lensforge.results.refined_maximum import refined_maximum
from lensforge.scene.lens import Lens
from lensforge.surfaces.drawn_profile import in_section
from lensforge.surfaces.plane_loop import Loop, LoopEdge, circle_at
from lensforge.surfaces.surface import Surface, scaled, to_sphere

_AIM_NM = 2.0
_NODES = 96
_MOST_NODES = 960
_TESTED = 1024
_REACH = 0.03  # of the chart: about the distance of the tested points
_ORDER = 6  # an error of the table falls with this power of its nodes
_BEYOND = 1.03  # of the extent of a face: a table is worst at its ends
_PIECES = 1536  # of a closed curve, and of an edge of a plate's outline: a quarter of a circle bends by 1e-12 in one
_EDGE_PIECES = 384
_UPRIGHT = 0.0, 0.0, 0.0, 0.0
_FAR = 1e6
_PROFILE_RAD = 1.6  # a little below z = 0
_PROFILE_NODES = 4001  # of a profile that is drawn along y
_NO_AREA_MM = 1e-4  # a ring this narrow is none: a base flush with the rim


def designed_files(part: Part) -> Iterator[DesignedFile]:
    """Every exported file, with the body that it should hold."""
    lens = part.lens
    plate = layout_of(part.lens)
    remember_fit(lens, part.nodes)  # by which the base has room for the cutter
    body = designed_lens(lens)
    chord_mm = 1e-3 * part.triangulation.chord_error_um
    tolerance_um = 1e-3 * part.face_tolerance.form_nm
    round_mm = mesh_error_mm(lens.spec.base, part.triangulation.rings, chord_mm)
    whole = None if plate is None or part.plate is None else designed_plate(lens, plate)
    for name, content in part.exported.items():
        if name == SURFACES_FILE and part.untrimmed_surfaces is not None:
            untrimmed = part.untrimmed_surfaces
            faces = designed_faces(lens, untrimmed.scale, untrimmed.extension_deg)
            yield DesignedFile(
                name, content, DesignedBody(tuple(faces), ()), Chords(0.0, 0.0), tolerance_um, trimmed=False
            )
        elif name in PLATE_FILES and whole is not None and part.plate is not None:
            stated_mm = 1e-3 * part.plate.chord_error_um
            allowed_mm = CHORD_MM * 2.0 ** max(0.0, np.ceil(np.log2(stated_mm / CHORD_MM)))
            yield DesignedFile(name, content, whole, Chords(stated_mm, allowed_mm), tolerance_um)
        else:
            cut_mm = 0.0 if body.below is not None else chord_mm
            yield DesignedFile(name, content, body, Chords(chord_mm, round_mm, cut_mm), tolerance_um)


def designed_faces(lens: Lens, scale: float = 1.0, beyond_deg: float = 0.0) -> Iterator[DesignedFace]:
    """The optical faces, and the ring around an opening; ``beyond_deg``: known margin beyond their edges."""
    for boundary in lens_boundaries(lens):
        for face in boundary.of_material:
            if not face.is_flange:
                yield _tabulated(face, scaled(face.shape, scale), beyond_deg)


def _tabulated(face: TrimmedFace[Surface], surface: Surface, beyond_deg: float) -> DesignedFace:
    edges_rad = 2.0 * np.arctan(face.domain.extent) + np.radians([-beyond_deg, beyond_deg])
    low, high = np.tan(np.maximum(edges_rad, 0.0) / 2.0).tolist()
    tested = chart_samples(_TESTED, domain=face.domain)
    half = float(np.arctan(_BEYOND * high))
    nodes = _NODES
    while True:
        axis = np.tan(np.linspace(-half, half, nodes))
        chart = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
        values = 1.0 / surface.radius_on_grid(to_sphere(chart))
        face_table = DesignedFace(face.label, axis, values, face.domain.extent, (low, high))
        error_nm = 1e6 * _table_error_mm(face_table, surface, tested, face.domain)
        if error_nm <= _AIM_NM or nodes == _MOST_NODES:
            return face_table
        nodes = min(_MOST_NODES, int(np.ceil(nodes * max(1.1, (1.5 * error_nm / _AIM_NM) ** (1.0 / _ORDER)))))


def _table_error_mm(
    face_table: DesignedFace, surface: Surface, tested: Float[np.ndarray, "n 2"], domain: Domain
) -> float:
    """Largest distance of a table from its ``surface``, searched for between the ``tested`` chart points.

    Where a tall cup ends at its mouth its table is at its worst, in a ring that samples alone step over.
    """

    def error_mm(chart: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, " m"]:
        directions = to_sphere(chart)
        return face_table.off_mm(surface.radius(directions)[:, None] * directions)[0]

    return refined_maximum(error_mm, tested, error_mm(tested), _REACH, within=domain.within)[1]


def designed_lens(lens: Lens) -> DesignedBody:
    """The body of one lens on its base; of a linear lens between its ends."""
    length_mm = lens.spec.lens.drawn_mm
    if length_mm is not None:
        profiles = [_profile(optical_name(name), surface) for name, surface in lens.surfaces.items()]
        return DesignedBody(
            [*profiles, Ends((f"{END_FACE}_1", f"{END_FACE}_2"), 0.5 * length_mm)], [Levels((RIM,), np.zeros(1))]
        )
    cavity, envelope = lens_boundaries(lens)
    plan = lay_out(cavity, envelope, base_with_room(lens))
    above: list[Designed] = list(designed_faces(lens))
    ring = ring_of(lens)
    if ring is not None:
        above += _of_ring(ring, next(face.label for face in envelope.of_material if face.is_flange))
    return DesignedBody(above, None if plan.base.kind == "step" else _of_base(plan).faces)


def _profile(name: str, surface: Surface) -> DrawnProfile:
    angles = np.linspace(-_PROFILE_RAD, _PROFILE_RAD, _PROFILE_NODES)
    return DrawnProfile(name, angles, 1.0 / surface.radius(in_section(angles)))


def _of_ring(ring: FlangeRing, cylinder: str) -> list[Designed]:
    made = _SideFaces()
    made.add_level(RIM_FLANGE_TOP, ring.high_mm)
    made.add_level(RIM_FLANGE_BOTTOM, ring.low_mm)
    made.add_round(
        RIM_FLANGE_SIDE, RoundWall((0.0, 0.0), ring.outer_mm, ring.foot_mm, -ring.high_mm, ring.thickness_mm)
    )
    made.add_wall(cylinder, _around(circle(ring.inner_mm).radius, ()))
    return made.faces


@dataclass
class _SideFaces:
    levels: dict[float, str] = field(default_factory=dict)
    walls: list[tuple[str, Float[np.ndarray, "_ 3 2"], Float[np.ndarray, "_ 4"]]] = field(default_factory=list)

    def add_level(self, name: str, height_mm: float) -> None:
        """Add a plane; planes of equal height are merged."""
        self.levels.setdefault(round(height_mm, 9), name)

    def add_wall(
        self, name: str, pieces: Float[np.ndarray, "s 3 2"], draft: Sequence[float] | np.ndarray = _UPRIGHT
    ) -> None:
        """Add a wall over a closed curve in pieces; ``draft``: one for all pieces, or as in :class:`StandingWalls`."""
        self.walls.append((name, pieces, np.broadcast_to(draft, (len(pieces), 4))))

    def add_round(self, name: str, wall: RoundWall) -> None:
        """Add a round wall of a plate."""
        draft = (*wall.place, -wall.depth_mm, wall.growth_per_mm)
        self.add_wall(name, _along(circle_at(wall.place, wall.radius_mm)), draft)

    @property
    def faces(self) -> list[Designed]:
        """Levels and walls; equal names are numbered."""
        faces: list[Designed] = []
        if self.levels:
            faces.append(Levels(_numbered(list(self.levels.values())), np.array(list(self.levels))))
        if self.walls:
            names, pieces, drafts = zip(*self.walls, strict=True)
            owners = np.repeat(np.arange(len(names)), [len(piece) for piece in pieces])
            faces.append(StandingWalls(_numbered(list(names)), np.concatenate(pieces), owners, np.concatenate(drafts)))
        return faces


def _numbered(names: list[str]) -> tuple[str, ...]:
    return tuple(
        f"{name}_{names[: k + 1].count(name)}" if names.count(name) > 1 else name for k, name in enumerate(names)
    )


def _of_base(plan: Plan[Surface]) -> _SideFaces:
    """Planes and walls below the rims, from corner to corner."""
    made = _SideFaces()
    corners = base_corners(plan)
    turns = np.linspace(0.0, 2.0 * np.pi, _PIECES, endpoint=False)
    for corner, following in zip(corners, [*corners[1:], Corner(rim_radius(plan.cavity), 0.0, "")], strict=True):
        if corner.depth_mm != following.depth_mm:
            grown = float(following.radius(turns[:1])[0] / corner.radius(turns[:1])[0]) - 1.0
            draft = 0.0, 0.0, -corner.depth_mm, grown / (following.depth_mm - corner.depth_mm)
            made.add_wall(corner.face, _around(corner.radius, plan.outline.corners if plan.has_base else ()), draft)
        elif np.abs(corner.radius(turns) - following.radius(turns)).max() > _NO_AREA_MM:
            made.add_level(corner.face, -corner.depth_mm)
    feet = plan.base.feet
    if feet is not None:
        made.add_level(FOOT_END, -plan.base.height_mm - feet.height_mm)
        for place in feet.places_mm:
            made.add_round(FOOT_SIDE, RoundWall(place, *plan.base.foot_radii_mm, plan.base.height_mm, feet.height_mm))
    return made


def designed_plate(lens: Lens, layout: PlateLayout) -> DesignedBody:
    """The plate with all its lenses."""
    made = _SideFaces()
    thick = layout.plate.thickness_mm
    lamps = layout.lenses
    lenses = PlateOfLenses(np.array(lamps.places_mm), np.radians(lamps.turns_deg), None, lamps.kind_of_each)
    cavities = [lens_boundaries(kind)[0] for kind in lens.kinds]
    growths = [(layout.bore_scale(rim_points(cavity)) - 1.0) / thick for cavity in cavities]
    mouths = [_around(rim_radius(cavity), ()) for cavity in cavities]
    made.add_level(PLATE_TOP, 0.0)
    made.add_level(PLATE_BOTTOM, -thick)
    leaning = [_UPRIGHT] * len(layout.outline)
    if layout.inset_mm:
        leaning = [_leaning(top, foot, thick) for top, foot in zip(layout.outline, layout.foot, strict=True)]
    made.add_wall(PLATE_SIDE, _along(layout.outline), np.repeat(leaning, _EDGE_PIECES, axis=0))
    for number, kind in enumerate(lamps.kind_of_each):
        around = layout.placed(mouths[kind].reshape(-1, 2), number).reshape(mouths[kind].shape)
        made.add_wall(PLATE_BORE, around, (*lamps.places_mm[number], 0.0, growths[kind]))
    for hole in layout.holes:
        made.add_round(PLATE_HOLE, hole)
    for slot in layout.slots:
        made.add_wall(PLATE_HOLE, _along(slot))
    for pin, bore in layout.standing:
        made.add_round(PIN_SIDE, pin)
        made.add_level(PIN_END, -pin.depth_mm - pin.length_mm)
        if bore is not None:
            made.add_round(BOSS_BORE, bore)
            made.add_level(BOSS_ROOF, -bore.depth_mm)
    faces = zip(*map(designed_faces, lens.kinds), strict=True)
    return DesignedBody([PlacedFace(of_kinds, lenses) for of_kinds in faces], made.faces)


def _leaning(top: LoopEdge, foot: LoopEdge, length_mm: float) -> tuple[float, float, float, float]:
    """The draft of a side between two edges, as a cone; a straight side has its apex far away."""
    if top.centre is not None and foot.centre is not None:
        scale = foot.radius_mm / top.radius_mm
        start = np.array(top.centre)
        end = np.array(foot.centre)
    else:
        scale = 1.0 - 1.0 / _FAR
        start = np.array(top.start)
        end = np.array(foot.start)
    x, y = ((end - scale * start) / (1.0 - scale)).tolist()
    return x, y, 0.0, (scale - 1.0) / length_mm


def _around(
    radius: Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, " n"]], corners: Float[np.ndarray, " k"] | tuple[()]
) -> Float[np.ndarray, "s 3 2"]:
    """The curve of ``radius`` over azimuth in pieces that end at its ``corners``."""
    turns = np.unique(np.concatenate([np.linspace(0.0, 2.0 * np.pi, _PIECES + 1), corners]))
    turns = turns[np.diff(turns, prepend=-1.0) > 1e-9]
    azimuths = np.stack([turns[:-1], 0.5 * (turns[:-1] + turns[1:]), turns[1:]], axis=1)
    points: Float[np.ndarray, "s 3 2"] = (
        radius(azimuths.ravel())[:, None, None] * rim_directions(azimuths.ravel())[:, None, :2]
    )
    return points.reshape(-1, 3, 2)


def _along(loop: Loop) -> Float[np.ndarray, "s 3 2"]:
    shares = np.arange(_EDGE_PIECES)[:, None] / _EDGE_PIECES + np.array([0.0, 0.5, 1.0]) / _EDGE_PIECES
    return np.concatenate([edge.at(shares) for edge in loop])
