"""Every figure of ``export`` by docs/definitions.md, section 14, and the written files alone."""

import re
from functools import cache
from itertools import combinations

import numpy as np
import trimesh
from crooked import Expected
from page_body import PageBody, directions
from page_step import spline_faces
from page_tracer import unit

FORM_NM = 50.0
SCHEMES = {"AUTOMOTIVE_DESIGN": "AP214", "AP242_MANAGED_MODEL_BASED_3D_ENGINEERING": "AP242"}
_kept = {}


def kept_of(case, name, make):
    """What ``make`` returns, made once for each design."""
    key = (case.folder, name)
    if key not in _kept:
        _kept[key] = make()
    return _kept[key]


def normal_mrad(case):
    """By the angle under which an LED is seen, where its size is known: of all more than 20 t 0.2 mrad.

    Less where the light that was tried before the export asked for it; then its faces use half of a limit or less.
    """
    most = 0.2 if case.lens["spec"]["source"]["kind"] in ("rectangle", "chips") else 0.02
    stated = case.json("export")["face_tolerance"]["normal_mrad"]
    assert most / 100.0 < stated <= most
    return stated


def body_of(case):
    return kept_of(case, "body", lambda: PageBody(case.lens))


def splines_of(case, file):
    return kept_of(case, file, lambda: spline_faces((case.folder / file).read_text()))


@cache
def mesh_of(path):
    return trimesh.load_mesh(path)


def errors_of(part, spline):
    """Distances (nm) from the exact face along its normal, and angles between the normals (mrad), all over it."""
    knots = np.unique(spline.knots[0])
    places = np.linspace(knots[0], knots[-1], 5 * len(knots))
    p, n = (array.reshape(-1, 3) for array in spline.at(places, places))
    u = unit(p)
    low, high = part.ends(np.arctan2(u[:, 1], u[:, 0]))
    theta = np.arctan2(np.hypot(u[:, 0], u[:, 1]), u[:, 2])
    inside = (theta >= low) & (theta <= high)
    turn = 2 * np.pi * np.arange(1440) / 1440
    ends = [(end, side) for end, side in zip(part.ends(turn), (1, -1), strict=True) if end.min() > 0]
    edges = [np.tan(end / 2) * (1 + side * 0.002 * k) for end, side in ends for k in range(6)]  # and near them
    on = [spline.at(edge * np.cos(turn), edge * np.sin(turn), pairs=True) for edge in edges]
    p, n = (np.concatenate([all_over[inside], *rims]) for all_over, *rims in zip((p, n), *on, strict=True))
    u = unit(p)
    rho, exact = part.exact(u)
    off = (np.linalg.norm(p, axis=1) - rho) * (exact * u).sum(axis=1)
    angle = np.linalg.norm(np.cross(n, exact), axis=1)
    return 1e6 * abs(off), 1e3 * angle


def worst_errors(case):
    """The largest distance (nm) and angle (mrad) of all optical faces in the STEP file."""
    return kept_of(case, "errors", lambda: np.max([
        [errors.max() for errors in errors_of(body_of(case).parts[name.removeprefix("OPTICAL_").lower()], spline)]
        for name, spline in splines_of(case, "lens.step").items() if name.startswith("OPTICAL_")
    ], axis=0).tolist())  # fmt: skip


def kept(value, limit):
    return "pass" if value <= limit else "fail"


def form_error(case, place):
    value = worst_errors(case)[0]
    return Expected(value, 0.1 * value, "nm", limit=("<=", FORM_NM), state=kept(value, FORM_NM))


def normal_error(case, place):
    value = worst_errors(case)[1]
    return Expected(value, 0.1 * value, "mrad", limit=("<=", normal_mrad(case)), state=kept(value, normal_mrad(case)))


def is_cut(case, name):
    """True of a face that is designed for the ball: of a part, not of a mould."""
    spec = case.lens["spec"]
    shop = spec["manufacture"]
    hollow = spec["lens"][name].get("concave_radius_mm")
    return shop["process"] in ("milled", "turned") and (
        shop["required"]
        or (hollow or 0.0) >= shop["nose_radius_mm" if shop["process"] == "turned" else "cutter_radius_mm"]
    )


def rounded_mm(needed):
    """With 5 um to spare, up to whole hundredths; 0 where that much is not missing."""
    return 0.0 if needed <= -5e-3 else float(np.ceil((needed + 5e-3) / 1e-2) * 1e-2)


def base_of(case):
    """The base; what the spec leaves out of bore and step is what the ball needs at a face that is designed for it."""
    return kept_of(case, "base", lambda: with_room(case))


def with_room(case):
    spec = case.lens["spec"]
    body = body_of(case)
    base = dict(spec["base"])
    r = spec["manufacture"]["cutter_radius_mm"]
    if base["kind"] == "none":
        return base
    share, phi = np.meshgrid(np.linspace(0, 1, 241), 2 * np.pi * np.arange(720) / 720)

    def contacts(parts, side):
        samples = [part.at(share, phi)[:2] for part in parts if is_cut(case, part.name)]
        b = np.concatenate([(p + side * r * n).reshape(-1, 3) for p, n in samples]) if samples else np.zeros((0, 3))
        return np.hypot(b[:, 0], b[:, 1]), b[:, 2]

    across, z = contacts(body.cavity, -1)
    if base["bore_setback_mm"] is None:
        depth = base["height_mm"] - (base["pocket_depth_mm"] if base["pocket_diameter_mm"] else 0.0)
        away = np.maximum(np.maximum(z, -z - depth), 0)
        radius = across + np.sqrt(np.maximum(r**2 - away**2, 0))
        base["bore_setback_mm"] = rounded_mm(radius.max() - body.rim.max()) if len(z) else 0.0
    across, z = contacts(body.envelope, 1)
    if base["relief_step_mm"] is None:
        aside = np.maximum(across - (base["flange_diameter_mm"] or base["diameter_mm"]) / 2, 0)
        step = np.where(aside < r, np.sqrt(np.maximum(r**2 - aside**2, 0)) - z, -np.inf)
        base["relief_step_mm"] = rounded_mm(step.max()) if len(z) else 0.0
    if base["relief_setback_mm"] is None:
        wall = np.where(z < r, across - np.sqrt(np.maximum(r**2 - np.maximum(z, 0) ** 2, 0)), np.inf)
        needed = rounded_mm(body.outer_rim.min() - wall.min()) if len(z) and base["relief_step_mm"] else 0.0
        base["relief_setback_mm"] = needed
    return base


def base_mm3(case):
    """Volume below z = 0: a prism, or a frustum of a moulded part, less its bore, narrower down to the step."""
    base = base_of(case)
    body = body_of(case)
    if base["kind"] == "none":
        return 0.0
    height = base["height_mm"]
    opening = bore_mm2(case)
    radius = base["diameter_mm"] / 2
    area = base["side_mm"] ** 2 if base["kind"] == "square" else np.pi * radius**2
    if base["flat_mm"] is not None:
        half = np.arccos(base["flat_mm"] / radius)
        area -= radius**2 * (half - np.sin(half) * np.cos(half))
    scale = 1 - slope_of(case) * height / radius
    wider = bore_scale(case)
    volume = height * (area * (1 + scale + scale**2) - opening * (1 + wider + wider**2)) / 3
    if base["relief_step_mm"]:
        circle = np.pi * (body.outer_rim.min() - base["relief_setback_mm"]) ** 2
        narrow = circle if base["relief_setback_mm"] else np.pi * (body.outer_rim**2).mean()
        volume -= (area - narrow) * base["relief_step_mm"]
    if base["pocket_diameter_mm"] is not None:
        volume -= (np.pi * base["pocket_diameter_mm"] ** 2 / 4 - opening) * base["pocket_depth_mm"]
    if base["flange_diameter_mm"] is not None:
        volume += (np.pi * base["flange_diameter_mm"] ** 2 / 4 - area) * base["flange_height_mm"]
    if base["feet"] is not None:
        volume += base["feet"]["number"] * np.pi * base["feet"]["diameter_mm"] ** 2 / 4 * base["feet"]["height_mm"]
    return volume


def bore_mm2(case):
    """Area of the bore: the cavity's rim, or a circle about it."""
    body = body_of(case)
    setback = base_of(case)["bore_setback_mm"]
    return np.pi * (body.rim.max() + setback) ** 2 if setback else body.opening_mm2


def flange_mm3(case):
    """Volume of the ring around a lens for total internal reflection."""
    flange = case.lens["spec"]["lens"].get("flange")
    if not flange:
        return 0.0
    inner = 0.9994 * case.lens["spec"]["constraints"]["max_radius_mm"]
    return np.pi * (flange["diameter_mm"] ** 2 / 4 - inner**2) * flange["thickness_mm"]


def lens_mm3(case):
    return body_of(case).lens_mm3 + flange_mm3(case)


def volume(case, place):
    value = lens_mm3(case) + base_mm3(case)
    return Expected(value, 3e-6 * value, "mm³")


def density_of(case):
    """Density of the spec, or published of the one plastic that a design here names without it; None of others."""
    lens = case.lens["spec"]["lens"]
    return lens["density_g_per_cm3"] or {"PC": 1.2}.get(lens["material"])


def density(case, place):
    return Expected(density_of(case), 0.0, "g/cm³")


def mass(case, place):
    value = volume(case, place).value * density_of(case) / 1000
    return Expected(value, 3e-6 * value, "g")


def mesh(case, place):
    return Expected(closed(case.folder / "lens.stl"))


def closed(path):
    return "closed" if mesh_of(path).is_watertight else "not closed"


def schema(case, place):
    text = (case.folder / "lens.step").read_bytes()[:4000].decode("latin1")
    return Expected(SCHEMES[re.search(r"FILE_SCHEMA\s*\(\(\s*'([A-Z0-9_]+)", text)[1]])


def scale(case, place):
    return Expected(1 + case.lens["spec"]["manufacture"]["shrinkage"], 1e-12)


# -- The plate ---------------------------------------------------------------------------------------------------------


def lamps_of(case):
    lamps = case.lens["spec"]["lamps"]
    return np.array(lamps["places_mm"])[:, :2], np.array(lamps["turns_deg"] or [0.0] * len(lamps["places_mm"]))


def placed(points, place, turn_deg):
    a = np.radians(turn_deg)
    return points @ np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]]) + [*place, 0]


def own_places(case, points):
    """Points of a plate in the coordinates of the lens that is nearest."""
    places, turns = lamps_of(case)
    number = np.linalg.norm(points[:, None, :2] - places, axis=2).argmin(axis=1)
    local = np.empty_like(points)
    for k, (place, turn) in enumerate(zip(places, turns, strict=True)):
        rows = number == k
        local[rows] = placed(points[rows] - [*place, 0], (0.0, 0.0), -turn)
    return local


def gap_mm(case):
    """The least distance of any two envelopes at their places, each above z = 0."""
    body = body_of(case)
    (places, turns) = lamps_of(case)

    def points(x, k):
        u = directions(np.clip(x[:, 0], 0, np.pi / 2), x[:, 1])
        return placed(body.radius(body.envelope, u)[:, None] * u, places[k], turns[k])

    ticks = np.linspace(-1, 1, 9)
    around = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    gaps = []
    theta, phi = np.meshgrid(np.linspace(0, np.pi / 2, 16), 2 * np.pi * np.arange(60) / 60)
    every = np.stack([theta, phi], axis=-1).reshape(-1, 2)
    for i, j in combinations(range(len(places)), 2):
        clouds = [points(every, k) for k in (i, j)]
        apart = np.array([np.linalg.norm(clouds[1] - p, axis=1) for p in clouds[0]])
        a, b = np.unravel_index(apart.argmin(), apart.shape)
        ends = [every[a], every[b]]
        step = 0.1
        for _ in range(32):
            near = [end + step * around for end in ends]
            apart = np.linalg.norm(points(near[0], i)[:, None] - points(near[1], j)[None], axis=2)
            a, b = np.unravel_index(apart.argmin(), apart.shape)
            ends = [near[0][a], near[1][b]]
            step = step / 1.7
        gaps.append(apart.min())
    return min(gaps)


def plate_lenses(case, place):
    return Expected(len(lamps_of(case)[0]))


def plate_gap(case, place):
    return Expected(gap_mm(case), 0.004, "mm")


def plate_sides(case):
    plate = case.lens["spec"]["plate"]
    (places, _) = lamps_of(case)
    beyond = case.lens["spec"]["constraints"]["max_radius_mm"] + (
        2.0 if plate["margin_mm"] is None else plate["margin_mm"]
    )
    if plate["kind"] == "round":
        return [plate["diameter_mm"] or 2 * (np.hypot(*places.T).max() + beyond)] * 2
    return (
        [plate["width_mm"], plate["height_mm"]] if plate["width_mm"] else list(2 * (abs(places).max(axis=0) + beyond))
    )


def plate_size(case, place):
    """Sides of the box; its height from the ends of the longest pins, or its bottom, to the top of the lenses."""
    plate = case.lens["spec"]["plate"]
    body = body_of(case)
    top = max(part.extreme(lambda s, f, part=part: part.at(s, f)[0][..., 2]) for part in body.envelope)
    down = plate["thickness_mm"] + max((pin["height_mm"] for pin in (*plate["pins"], *plate["bosses"])), default=0.0)
    box = mesh_of(case.folder / "plate.stl").extents
    assert np.allclose(box, [*plate_sides(case), top + down], rtol=0, atol=0.004), "within the chord of its facets"
    return Expected(" × ".join(f"{side:.5g}" for side in box) + " mm")


def plate_form_error(case, place):
    """The lens's own, and how far any pole of its copies is from where the lens at its place has it."""
    splines = splines_of(case, "lens.step")
    copies = splines_of(case, "plate.step")
    (places, turns) = lamps_of(case)
    off = 0.0
    for name, spline in splines.items():
        for k, (at, turn) in enumerate(zip(places, turns, strict=True)):
            copy = copies[f"{name}_{k + 1}"].poles.reshape(-1, 3)
            off = max(off, np.linalg.norm(copy - placed(spline.poles.reshape(-1, 3), at, turn), axis=1).max())
    value = worst_errors(case)[0] + 1e6 * off
    return Expected(value, 0.1 * value, "nm", limit=("<=", FORM_NM), state=kept(value, FORM_NM))


def plate_mm3(case):
    plate = case.lens["spec"]["plate"]
    count = len(lamps_of(case)[0])
    wide, high = plate_sides(case)
    thick = plate["thickness_mm"]
    scale = bore_scale(case)
    corner = plate["corner_radius_mm"]
    inset = slope_of(case) * thick * (np.arange(4000) + 0.5) / 4000
    rectangle = (wide - 2 * inset) * (high - 2 * inset) - (4 - np.pi) * (corner - inset) ** 2
    area = (np.pi * (wide / 2 - inset) ** 2 if plate["kind"] == "round" else rectangle).mean()
    bores = count * body_of(case).opening_mm2 * thick * (1 + scale + scale**2) / 3
    holes = sum(cone_mm3(case, hole["diameter_mm"] / 2, thick, 1) for hole in plate["holes"])
    pins = sum(cone_mm3(case, pin["diameter_mm"] / 2, pin["height_mm"], -1) for pin in plate["pins"])
    return count * body_of(case).lens_mm3 + thick * area - bores - holes + pins


def slope_of(case):
    """Tangent of the draft of plate or base; left out, that of a moulded base has one degree."""
    spec = case.lens["spec"]
    moulded = 1.0 if spec["manufacture"]["process"] == "moulded" else 0.0
    stated = (spec["plate"] or spec["base"])["draft_deg"]
    return np.tan(np.radians(moulded if stated is None else stated))


def depth_mm(case):
    """Length of the bore."""
    plate = case.lens["spec"]["plate"]
    base = case.lens["spec"]["base"]
    return plate["thickness_mm"] if plate else base["height_mm"]


def cone_mm3(case, radius, length, way):
    """A wall that widens (1) or narrows (-1) downwards by the draft, by slices."""
    z = (np.arange(4000) + 0.5) / 4000 * length
    return np.pi * ((radius + way * slope_of(case) * z) ** 2).mean() * length


def bore_scale(case):
    """From a cavity's rim to its bore's foot: the tangent of the rim that is nearest to the axis has the draft."""
    rim = body_of(case).rim
    turns = 2 * np.pi / len(body_of(case).rim)
    along = (np.roll(rim, -1) - np.roll(rim, 1)) / (2 * turns)
    return 1 + slope_of(case) * depth_mm(case) / (rim**2 / np.hypot(rim, along)).min()


def plate_volume(case, place):
    value = plate_mm3(case)
    return Expected(value, 3e-6 * value, "mm³")


def plate_mesh(case, place):
    return Expected(closed(case.folder / "plate.stl"))


def plate_files(case, place):
    sizes = {name: (case.folder / name).stat().st_size for name in ("plate.step", "plate.stl", "plate.3mf")}
    return Expected(", ".join(
        f"{name} {count / scale:.3g}\u2009{unit}" for name, count in sizes.items()
        for scale, unit in [(1e6, "MB") if count >= 1e6 else (1e3, "kB")]
    ))  # fmt: skip


ORACLES = {
    f"export.{oracle.__name__}": oracle
    for oracle in (form_error, normal_error, volume, density, mass, mesh, schema, scale, plate_lenses, plate_gap,
                 plate_size, plate_form_error, plate_volume, plate_mesh, plate_files)
}  # fmt: skip
