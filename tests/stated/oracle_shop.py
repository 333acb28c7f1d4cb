"""Every figure of ``check`` by docs/definitions.md, section 13, from the exact faces alone."""

from functools import cached_property
from itertools import pairwise

import numpy as np
from crooked import Expected
from oracle_mould import half, is_moulded
from oracle_part import base_of, body_of, bore_scale, kept_of, lamps_of, plate_sides, slope_of
from page_body import HORIZON, directions
from scipy.optimize import brentq, minimize_scalar

ANGLE_DEG = 0.02
FIT = 1e-6
PLANE_MM = 1e6
GOOD_DRAFT_DEG = 2.0
NEARLY_FLAT_MM = 1e4  # splines within 1 nm of a face that is flat along one way have hollows of such radii
FACES = ("inner", "outer", "cap", "side", "wall", "exit", "cup", "back")
FROM_BELOW = ("wall", "cup", "back")
CAVITY = ("inner", "cap", "side", "cup")


class CutFace:
    """A face as it is cut: ``scale`` times as large and seen from the air; a mould insert has air where the lens is."""

    def __init__(self, case, name):
        spec = case.lens["spec"]
        body = body_of(case)
        self.part = body.parts[name]
        shop = spec["manufacture"]
        self.scale = 1 + shop["shrinkage"] if shop["process"] == "moulded" else 1.0
        self.cutter = shop["cutter_radius_mm"]
        self.air = (-1 if self.part.before == "cavity" else 1) * (-1 if shop["process"] == "moulded" else 1)
        self.sense = -1 if name in FROM_BELOW else 1
        boundary = body.cavity if self.part.before == "cavity" else body.envelope
        others = [part for part in boundary if part.name not in (name, "mouth", "flange")]
        halves = shop["process"] == "moulded"  # each half has an insert of its own
        self.beside = [part for part in others if not halves or (part.name in FROM_BELOW) == (name in FROM_BELOW)]

    def least_curvature(self, share, phi):
        low, high = self.part.curvatures(share, phi)
        return (low if self.air > 0 else -high) / self.scale

    def most_curvature(self, share, phi):
        low, high = self.part.curvatures(share, phi)
        return (high if self.air > 0 else -low) / self.scale

    @cached_property
    def kappa(self):
        return self.part.extreme(self.least_curvature, -1.0)

    @cached_property
    def highest(self):
        return self.part.extreme(self.most_curvature)

    @cached_property
    def draft_deg(self):
        least = self.part.extreme(lambda s, f: self.sense * self.part.at(s, f)[1][..., 2], -1.0)
        return np.degrees(np.arcsin(np.clip(least, -1, 1)))

    @cached_property
    def sphere(self):
        """Radius, departure from peak to valley and rms (mm) of the best-fit sphere, and the height of its centre."""
        p, _, areas = self.part.area
        p = self.scale * p
        share = areas / areas.sum()

        def spread(c):
            distance = np.linalg.norm(p - [0, 0, c], axis=1)
            return share @ (distance - share @ distance) ** 2

        reach = np.linalg.norm(p, axis=1).max()
        places = reach * np.concatenate([-np.geomspace(1e4, 1e-2, 200), np.geomspace(1e-2, 1e4, 200)])
        k = np.argmin([spread(place) for place in places])
        ends = places[max(k - 1, 0)], places[min(k + 1, len(places) - 1)]
        c = minimize_scalar(spread, bounds=ends, method="bounded", options={"xatol": 1e-11}).x
        radius = share @ np.linalg.norm(p - [0, 0, c], axis=1)

        def sag(s, f):
            return np.linalg.norm(self.scale * self.part.at(s, f)[0] - [0, 0, c], axis=-1) - radius

        return radius, self.part.extreme(sag) - self.part.extreme(sag, -1.0), np.sqrt(spread(c)), c

    @cached_property
    def balls(self):
        """Largest ball (mm) that touches the face at each piece of an even grid alone, and the areas of the pieces."""
        share, phi = np.meshgrid(np.arange(1, 31) / 30, 2 * np.pi * np.arange(90) / 90, indexing="ij")
        p, n, u = self.part.at(share, phi)
        low, high = self.part.ends(phi)
        areas = (high - low) * np.hypot(u[..., 0], u[..., 1]) * (p**2).sum(axis=-1) / (n * u).sum(axis=-1)
        areas[-1] /= 2
        kappa = self.least_curvature(share, phi).ravel()
        p = self.scale * p.reshape(-1, 3)
        a = self.air * n.reshape(-1, 3)
        others = np.concatenate([p, *(self.scale * face.at(share, phi)[0].reshape(-1, 3) for face in self.beside)])
        radii = np.where(kappa < -1 / PLANE_MM, -1 / np.minimum(kappa, -1e-12), np.inf)
        for k, (place, normal) in enumerate(zip(p, a, strict=True)):
            away = others - place
            ahead = away @ normal
            near = ahead > 1e-9
            if near.any():
                radii[k] = min(radii[k], ((away[near] ** 2).sum(axis=1) / (2 * ahead[near])).min())
        reach = 20 * np.linalg.norm(p, axis=1).max()
        return np.where(radii < reach, radii, np.inf), areas.ravel()

    @cached_property
    def largest_ball(self):
        kappa = self.kappa
        return min(-1 / kappa if kappa < -1 / PLANE_MM else np.inf, self.balls[0].min())


def face_of(case, name):
    return kept_of(case, name, lambda: CutFace(case, name))


def asked_draft(case, name):
    stated = case.lens["spec"]["lens"][name].get("draft_deg")
    return GOOD_DRAFT_DEG if stated is None and is_moulded(case) else stated


def draft_state(case, name):
    """The draft of a cut face from the side of its tool, of a moulded one from the half that draws it."""
    wanted = asked_draft(case, name)
    moulded = is_moulded(case)
    if wanted is None and not moulded:
        return ""
    least = half(case, name)[3] if moulded else face_of(case, name).draft_deg
    return "pass" if least >= (GOOD_DRAFT_DEG if wanted is None else wanted) - ANGLE_DEG else "fail"


def is_milled(case, name):
    shop = case.lens["spec"]["manufacture"]
    return shop["process"] == "milled" and name in case.lens["spec"]["lens"]


def free_tilt(case, name):
    """Tilt (degrees) that machine and mouth leave to the axis of a mill: of a tool on the axis, at the lower edge."""
    spec = case.lens["spec"]
    most = spec["manufacture"]["max_tilt_deg"]
    if name not in CAVITY:
        return most
    if spec["plate"] or spec["base"]["kind"] == "step" or name in FROM_BELOW:
        return 0.0
    face = face_of(case, name)
    turns = np.meshgrid(np.linspace(0, 1, 161), 2 * np.pi * np.arange(720) / 720, indexing="ij")
    p, n, _ = face.part.at(*turns)
    highest = (p - face.cutter * n)[n[..., 2] < 0, 2].max(initial=0.0)
    deep = highest + (0.0 if spec["base"]["kind"] == "none" else spec["base"]["height_mm"])
    mouth = min(part.exact(HORIZON)[0].min() for part in (face.part, *face.beside))

    def room(tilt):  # between the shank and the edge, a mouth's radius from the axis
        return mouth * np.cos(tilt) - deep * np.sin(tilt) - face.cutter

    return min(np.degrees(brentq(room, 0.0, np.pi / 2)), most) if room(0.0) > 0.0 else 0.0


def tilt_state(case, name):
    held = -face_of(case, name).draft_deg <= free_tilt(case, name) + ANGLE_DEG
    return "pass" if held else "fail"


def cutter_state(case, name):
    face = face_of(case, name)
    return "pass" if face.cutter <= face.largest_ball * (1 + FIT) else "fail"


def in_file(case, name, *keys):
    """A radius of a face that is flat to rounding: that of its spline, if that is as large."""
    value = case.json("check")[name]
    for key in keys:
        value = value[key]
    return value if value is None or value > NEARLY_FLAT_MM else -1.0


def ball_mm(case, name):
    """The largest ball, and how well it is known: near a hollow edge it is read at the nodes, and falls with them."""
    face = face_of(case, name)
    hollow = -1 / face.kappa if face.kappa < 0 else np.inf
    if face.largest_ball > NEARLY_FLAT_MM:
        return in_file(case, name, "cutter", "largest_radius_mm"), 0.0
    return face.largest_ball, (0.02 if face.largest_ball > 0.999 * hollow else 0.5) * face.largest_ball


def hollow_mm(case, name):
    kappa = face_of(case, name).kappa
    if kappa > -1 / NEARLY_FLAT_MM:
        return in_file(case, name, "curvature", "smallest_concave_radius_mm"), 0.0
    return -1 / kappa, -1e-3 / kappa


def reached_share(case, name):
    """Share of the area that the ball reaches, and how well it is known."""
    face = face_of(case, name)
    balls, areas = face.balls
    share = areas[balls >= face.cutter * (1 - FIT)].sum() / areas.sum()
    return share, 0.015 if share == 1.0 or ball_mm(case, name)[1] < 0.1 * face.largest_ball else 0.15


def ball(case, name):
    value, within = ball_mm(case, name)
    limit = (">=", face_of(case, name).cutter)
    state = cutter_state(case, name)
    return Expected("any" if value is None else value, within, "mm", limit=limit, state=state)


def reached(case, name):
    share, within = reached_share(case, name)
    return Expected(100 * share, 100 * within, "%")


def concave(case, name):
    value, within = hollow_mm(case, name)
    return Expected("none" if value is None else value, within, "mm")


def tilt(case, name):
    limit, state = (None, "") if is_moulded(case) else (("<=", free_tilt(case, name)), tilt_state(case, name))
    return Expected(
        max(0, -face_of(case, name).draft_deg), 0.003, "°", limit=limit, limit_within=0.05, state=state
    )  # by the highest place of its grid


def draft(case, name):
    wanted = asked_draft(case, name)
    limit, state = (None, "") if wanted is None else ((">=", wanted), draft_state(case, name))
    return Expected(face_of(case, name).draft_deg, 0.003, "°", limit=limit, state=state)


def sphere(case, name):
    radius = face_of(case, name).sphere[0]
    return Expected("plane", unit="mm") if radius >= PLANE_MM else Expected(radius, 1e-6 * radius, "mm")


def departure(case, name):
    value = 1e3 * face_of(case, name).sphere[1]
    return Expected(value, 1e-4 * value + 1e-3, "µm")


def departure_rms(case, name):
    value = 1e3 * face_of(case, name).sphere[2]
    return Expected(value, 1e-4 * value + 1e-3, "µm")


def area(case, name):
    face = face_of(case, name)
    value = face.scale**2 * face.part.area[2].sum()
    return Expected(value, 2e-6 * value, "mm²")


def of_face(figure, name):
    return lambda case, place: figure(case, name)


# -- Walls and edges, of the lens itself -------------------------------------------------------------------------------


def slack_mm(case):
    return 7e-5 * case.lens["spec"]["constraints"]["max_radius_mm"]


def wall_state(case):
    limits = case.lens["spec"]["constraints"]
    return "pass" if body_of(case).thinnest >= limits["min_thickness_mm"] - slack_mm(case) else "fail"


def thinnest(case, place):
    limit = (">=", case.lens["spec"]["constraints"]["min_thickness_mm"])
    return Expected(body_of(case).thinnest, 1e-4, "mm", limit=limit, state=wall_state(case))


def thickest(case, place):
    most = case.lens["spec"]["constraints"]["max_wall_mm"]
    value = body_of(case).thickest
    if most is None:
        return Expected(value, slack_mm(case), "mm")
    return Expected(
        value, slack_mm(case), "mm", limit=("<=", most), state="pass" if value <= most + slack_mm(case) else "fail"
    )


def edge_deg(case, one, other):
    """The least angle of the wedge in which two faces meet, over 1440 azimuths."""
    body = body_of(case)
    phi = 2 * np.pi * np.arange(1440) / 1440
    parts = next(p for p in (body.envelope, body.cavity) if {one, other} <= {part.name for part in p})
    first, last = (next(part for part in parts if part.name == name) for name in (one, other))
    u = directions(first.ends(phi)[1], phi)
    cosine = (first.exact(u)[1] * last.exact(u)[1]).sum(axis=1)
    around = one == "mouth" and parts is body.cavity  # the body is on the other side of its opening
    return np.degrees(np.arccos(cosine if around else -cosine)).min()


def edge(name):
    """The edge of a face and its neighbour: the next one from the axis, of a mouth the one before."""

    def figure(case, place):
        body = body_of(case)
        pairs = [pair for parts in (body.cavity, body.envelope) for pair in pairwise([part.name for part in parts])]
        one, other = next(pair for pair in pairs if name == pair[1 if pair[0] == "mouth" else 0])
        least = case.lens["spec"]["constraints"]["min_edge_angle_deg"]
        value = edge_deg(case, one, other)
        if least is None:
            return Expected(value, 0.01, "°")
        state = "pass" if value >= least - ANGLE_DEG else "fail"
        return Expected(value, 0.01, "°", limit=(">=", least), state=state)

    return figure


# -- Findings ----------------------------------------------------------------------------------------------------------


CLEAR_MM = 1e-6


def circle_wall(case, name):
    """Distance from the axis and radii of the rim, over the azimuths of the opening or of the envelope's rim."""
    body = body_of(case)
    parts = body.cavity if name in CAVITY else body.envelope
    phi = 2 * np.pi * np.arange(2880) / 2880
    rim = body.radius(parts, directions(np.full(2880, np.pi / 2), phi))
    return rim, rim[:, None] * np.column_stack([np.cos(phi), np.sin(phi)])


def relief(case, name):
    """Clearances (mm) that the ball lacks of the base, the largest over what it reaches; the share that needs none."""
    base = base_of(case)
    face = face_of(case, name)
    share, phi = np.meshgrid(1 - (1 - np.arange(1, 81) / 80) ** 2, 2 * np.pi * np.arange(180) / 180, indexing="ij")
    p, n, u = face.part.at(share, phi)
    low, high = face.part.ends(phi)
    wide = np.gradient(share[:, 0])[:, None] * (high - low)
    areas = (wide * np.hypot(u[..., 0], u[..., 1]) * (p**2).sum(axis=-1) / (n * u).sum(axis=-1)).ravel()
    b = (p + face.cutter * face.air * n).reshape(-1, 3)
    r = face.cutter
    across = np.hypot(b[:, 0], b[:, 1])
    rim, around = circle_wall(case, name)

    def needed(depth):
        return np.sqrt(np.maximum(r**2 - np.maximum(depth, 0) ** 2, 0))

    def along_rim(depth):
        below = -b[:, 2] - depth
        near = np.array([np.linalg.norm(around - place, axis=1).min() if low else 0.0
                         for place, low in zip(b[:, :2], b[:, 2] < 0, strict=True)])  # fmt: skip
        return np.where((b[:, 2] < 0) & (below < r), needed(below) - near, 0)

    def beyond(values):
        return np.where(values > CLEAR_MM, values, 0.0)

    if name in CAVITY:
        depth = base["height_mm"] - (base["pocket_depth_mm"] if base["pocket_diameter_mm"] else 0.0)
        bore = beyond(along_rim(depth))
        if base["bore_setback_mm"]:
            radius = across + needed(np.maximum(b[:, 2], -b[:, 2] - depth))
            bore = np.where(radius > rim.max() + base["bore_setback_mm"] + CLEAR_MM, radius - rim.max(), 0.0)
        figures = {"bore_clearance_mm": bore, "pocket_diameter_mm": 0 * bore}
    else:
        disc = base["diameter_mm"] / 2
        present = base["relief_step_mm"] or 0.0
        aside = np.maximum(across - disc, 0)
        step = beyond(np.where(aside < r, needed(aside) - b[:, 2] - present, 0.0))
        step = np.where(step > 0, step + present, 0.0)
        if base["relief_setback_mm"]:
            largest = np.where(b[:, 2] < r, across - needed(b[:, 2]), np.inf)
            tight = largest < rim.min() - base["relief_setback_mm"] - CLEAR_MM
            wall = np.where(tight, rim.min() - largest, 0.0)
        else:
            wall = beyond(along_rim(present or base["height_mm"])) if present or disc > rim.max() else 0 * step
        figures = {"smallest_step_mm": step, "step_clearance_mm": wall, "flange_clearance_mm": 0 * step}
    clear = np.max(list(figures.values()), axis=0) == 0.0
    return {key: values.max() for key, values in figures.items()} | {"flush_fraction": areas[clear].sum() / areas.sum()}


def relief_of(case, name):
    return kept_of(case, f"relief {name}", lambda: relief(case, name))


def relief_state(case, name):
    """Of a face that the ball reaches: pass where nothing is lacking."""
    figures = relief_of(case, name)
    return "pass" if max(value for key, value in figures.items() if key.endswith("mm")) == 0.0 else "fail"


def answer(state):
    return Expected("yes" if state == "pass" else "no", state=state)


def on_face(place):
    return place.title.removeprefix("Manufacture, ").removesuffix(" face")


def plate_wall_mm(case):
    """The least distance, at the bottom, between a hole or a pin and a bore, the edge, or another of them."""
    plate = case.lens["spec"]["plate"]
    (places, turns) = lamps_of(case)
    rim = body_of(case).rim * bore_scale(case)
    wider = slope_of(case) * plate["thickness_mm"]
    marks = [(np.array(mark["place_mm"]), mark["diameter_mm"] / 2 + (wider if kind == "holes" else 0.0))
             for kind in ("holes", "pins", "bosses") for mark in plate[kind]]  # fmt: skip
    phi = 2 * np.pi * np.arange(len(rim)) / len(rim)
    walls = []
    for at, turn in zip(places, turns, strict=True):
        a = phi + np.radians(turn)
        cavity = at + rim[:, None] * np.column_stack([np.cos(a), np.sin(a)])
        walls += [np.linalg.norm(cavity - mark, axis=1).min() - radius for mark, radius in marks]
    half = np.array(plate_sides(case)) / 2
    corner = plate["corner_radius_mm"]
    for k, (mark, radius) in enumerate(marks):
        beyond = abs(mark) - (half - corner)
        walls.append(corner - np.linalg.norm(np.maximum(beyond, 0)) - min(beyond.max(), 0) - radius - wider)
        walls += [np.linalg.norm(mark - other) - radius - wide for other, wide in marks[:k]]
    return min(walls)


def plate(case, place):
    least = case.lens["spec"]["constraints"]["min_thickness_mm"]
    return answer("pass" if plate_wall_mm(case) >= least - slack_mm(case) else "fail")


def azimuth_mark(case, place):
    """By the kind of the base alone; a lens whose light is round, and a plate, state none."""
    base = case.lens["spec"]["base"]
    if base["kind"] == "cylinder":
        return Expected("none" if base["flat_mm"] is None else "flat")
    return Expected({"square": "square base", "step": "as in the base's file", "none": "none"}[base["kind"]])


ORACLES = {
    f"check.{name}_{figure.__name__}": of_face(figure, name)
    for name in FACES
    for figure in (ball, reached, concave, tilt, draft, sphere, departure, departure_rms, area)
    if name != "side" or figure not in (ball, reached, tilt)  # which is turned
} | {
    "check.thinnest": thinnest,
    "check.thickest": thickest,
    **{f"check.edge_{name}": edge(name) for name in ("cap", "exit", "cup", "back")},
    "check.cutter": lambda case, place: answer(cutter_state(case, on_face(place))),
    "check.relief": lambda case, place: answer(relief_state(case, on_face(place))),
    "check.tilt": lambda case, place: answer(tilt_state(case, on_face(place))),
    "check.draft": lambda case, place: answer(draft_state(case, on_face(place))),
    "check.wall": lambda case, place: answer(wall_state(case)),
    "check.plate": plate,
    "check.azimuth_mark": azimuth_mark,
}
