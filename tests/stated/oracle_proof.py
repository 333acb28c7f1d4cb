"""Every figure of ``verify`` by docs/definitions.md, section 14, from the exact faces and the written files alone."""

import re
import zipfile

import numpy as np
from crooked import Expected
from oracle_part import body_of, kept_of, lamps_of, mesh_of, own_places, placed, splines_of, worst_errors
from page_scene import receivers_of
from page_tracer import unit

DEVIATION = 1e-4
NOISE_FLOORS = 2.5
NOISE_ALLOWANCE = 1e-3
# Of the table that stands for the design there: it aims at 2, a face of tir has 2.6; and the limit on a form.
TABLE_NM = 3.0
FORM_NM = 70.0


def record(case):
    return kept_of(case, "verify", lambda: case.json("verify"))


def arrays(case, stage):
    return kept_of(case, f"{stage}.npz", lambda: dict(np.load(case.folder / f"{stage}.npz")))


def kept(value, limit):
    return "pass" if value <= limit else "fail"


def screens(case):
    """Name, kind, centre, normal and size of each receiver's plane; of directions the kind alone."""
    spec = case.lens["spec"]
    if not spec["receivers"]:
        section = spec["target"]
        if section.get("half_angle_deg"):
            return [("far_field", None, None, None, 0.0)]
        return [
            (
                "plane",
                np.array([0, 0, section["distance_mm"]]),
                np.array([0.0, 0, 1]),
                [section["receiver_mm"]] * 2,
                0.0,
            )
        ]
    planes = []
    for section in spec["receivers"]:
        normal = None
        if section["kind"] == "plane":
            a, b = np.radians(section["tilt_deg"] or (0, 0))
            normal = np.array(
                section["normal"] or [np.cos(a) * np.sin(b), -np.sin(a), np.cos(a) * np.cos(b)], dtype=float
            )
        sides = [section.get("width_mm"), section.get("height_mm")]
        planes.append(
            (section["kind"], np.array(section.get("centre_mm", (0.0, 0, 0))), normal, sides, section["rotation_deg"])
        )
    return planes


def reach_mm(case, index):
    """Root mean square of L/cos over the design's light: of pixels of a plane, 1 m of directions."""
    kind, centre, normal, sides, turn_deg = screens(case)[index]
    if kind == "far_field":
        return 1000.0
    if kind != "plane":
        return None
    light = arrays(case, "verify")[f"receivers.{index}.design_irradiance"]
    x, y = (side * ((np.arange(n) + 0.5) / n - 0.5) for side, n in zip(sides, light.shape[::-1], strict=True))
    z = unit(normal[None])[0]
    about = np.cross([0, 0, 1.0], z)  # its axes: the lens's after the shortest turn
    cross = np.array([[0, -about[2], about[1]], [about[2], 0, -about[0]], [-about[1], about[0], 0]])
    turn = np.eye(3) + cross + cross @ cross / (1 + z[2])
    c = np.cos(np.radians(turn_deg))
    s = np.sin(np.radians(turn_deg))
    across = c * turn[:, 0] + s * turn[:, 1]
    up = c * turn[:, 1] - s * turn[:, 0]
    places = x[None, :, None] * across + y[:, None, None] * up + centre - first_pole(case)
    away = np.linalg.norm(places, axis=-1)
    return np.sqrt((light * (away**2 / abs(places @ z)) ** 2).sum() / light.sum())


def first_pole(case):
    """Place of the lens whose light is cast: the first of lamps that have heights or aims, else the origin."""
    lamps = case.lens["spec"]["lamps"] or {}
    return np.array(lamps["places_mm"][0]) if lamps.get("aims_mm") else np.zeros(3)


def landing(case, place):
    """The part is the design within nm: what is stated is the error of the cast, below the limit for each receiver.

    Its number is that of the record; that this is a length on the receiver, see test_landing_gaps.py.
    """
    rms = landed_rms(case, place.group, "mesh")
    reach = reach_mm(case, place.group)
    limit = record(case)["receivers"][place.group]["deviation_limit_mm"]
    if reach is not None:
        assert abs(limit / (DEVIATION * reach) - 1) < 1e-6, (limit, reach)
    return Expected(1e3 * rms, 150 * rms, "µm", limit=("<=", 1e3 * limit), state=kept(rms, limit))


def nmse_vs_design(case, place):
    part, design = (
        arrays(case, "verify")[f"receivers.{place.group}.{name}"] for name in ("irradiance", "design_irradiance")
    )
    value = ((part - design) ** 2).sum() / (design**2).sum()
    limit = NOISE_FLOORS * record(case)["receivers"][place.group]["noise_floor_nmse"] + NOISE_ALLOWANCE
    return Expected(value, 1e-9, limit=("<=", limit), state=kept(value, limit))


def nmse_same_rays(case, place):
    """Part and design are the same within nm: pictures by the same rays differ by rays on the edge of a pixel."""
    receiver = record(case)["receivers"][place.group]
    limit = same_rays_limit(receiver)
    return Expected(0.0, limit, limit=("<=", limit), state=kept(receiver["nmse_same_rays"], limit))


def same_rays_limit(receiver):
    return 0.1 * receiver["noise_floor_nmse"] + 1e-4


def part_efficiency(case, place):
    designed = case.json("evaluate")["receivers"][place.group]["efficiency"]["value"]
    rays = record(case)["rays"]
    return Expected(100 * designed, 400 * np.sqrt(designed * (1 - designed) / rays) + 0.05, "%")


def part_rays(case, place):
    return Expected(case.json("verify")["rays"])


def print_mesh(case, place):
    """Light through the facets misses a limit that it keeps by half through the STEP file, on every receiver.

    The designs are exported with 24 rings: facets of tir land light nine limits off, a fourteenth of one by STEP.
    """
    landed = {name: [landed_rms(case, index, name) for index in range(len(screens(case)))] for name in ("mesh", "step")}
    limits = [receiver["deviation_limit_mm"] for receiver in record(case)["receivers"]]
    assert case.json("export")["triangulation"]["rings"] == 24
    assert any(off > limit for off, limit in zip(landed["mesh"], limits, strict=True)), (landed, limits)
    assert all(off <= 0.5 * limit for off, limit in zip(landed["step"], limits, strict=True)), (landed, limits)
    return Expected("too coarse for the light")


def landed_rms(case, index, file):
    """Root mean square (mm) of quantiles, the last of them the largest: how far off rays land through a file."""
    values = arrays(case, "verify")[f"receivers.{index}.gaps_{file}_mm"]
    return float(np.sqrt(0.5 * (values[1:] ** 2 + values[:-1] ** 2).mean()))


# -- Form of the files -------------------------------------------------------------------------------------------------


def off_nm(case, points):
    """The largest distance of those of ``points`` that lie on an optical face from that face."""
    u = unit(points)
    distances = []
    for part in body_of(case).parts.values():
        if part.name in ("mouth", "flange"):
            continue
        rho, n = part.exact(u)
        distances.append(abs(np.linalg.norm(points, axis=1) - rho) * (n * u).sum(axis=1))
    off = np.where(np.array(distances) < 1e-4, distances, 0.0)  # at a crease of both faces
    return 1e6 * off[:, points[:, 2] > -1e-6].max()


def vertices_of(path):
    """Vertices (mm) of an STL or a 3MF file."""
    if path.suffix == ".stl":
        return np.asarray(mesh_of(path).vertices)
    with zipfile.ZipFile(path) as archive:
        text = archive.read(next(name for name in archive.namelist() if name.endswith(".model"))).decode()
    return np.array([re.findall(r'"([^"]+)"', vertex) for vertex in re.findall(r"<vertex ([^>]*)>", text)], dtype=float)


def of_mesh(file):
    def form(case, place):
        points = vertices_of(case.folder / file)
        value = off_nm(case, own_places(case, points) if file.startswith("plate") else points)
        step = np.sqrt(3) * np.spacing(np.float32(abs(points).max())) * 1e6
        limit = FORM_NM + step
        return Expected(value, 0.1 * value + TABLE_NM, "nm", limit=("<=", limit), state=kept(value, limit))

    return form


def of_step(file):
    def form(case, place):
        splines = splines_of(case, "lens.step")
        off = 0.0
        if file == "plate.step":
            copies = splines_of(case, file)
            lamps = list(enumerate(zip(*lamps_of(case), strict=True), 1))
            apart = [
                copies[f"{name}_{k}"].poles - placed(splines[name].poles, *lamp)
                for name in splines
                for k, lamp in lamps
            ]
            off = max(np.linalg.norm(gaps, axis=2).max() for gaps in apart)
        value = worst_errors(case)[0] + 1e6 * off
        return Expected(value, 0.2 * value + TABLE_NM, "nm", limit=("<=", FORM_NM), state=kept(value, FORM_NM))

    return form


# -- All lamps of a plate ----------------------------------------------------------------------------------------------


def lit(case, place):
    return record(case)["together"][place.group]


def floor_of(case, index):
    """Noise of independent rays: of a pixel's flux F in rays of f each, f F - F^2/n, through the squared taps."""
    light = arrays(case, "evaluate")[f"receivers.{index}.map"]
    spec = case.lens["spec"]
    stored = record(case)["receivers"][index]
    receiver = receivers_of(spec)[index]
    e = np.exp(-1 / (2 * spec["evaluate"]["filter_variance"]))
    taps = np.array([e, 1, e]) / (1 + 2 * e)
    landed = np.prod(receiver.size) * (1 if receiver.kind == "far_field" else 1e-6) / light.size * light
    rays = record(case)["rays"]
    sides = zip(receiver.size, light.shape[::-1], strict=True)
    x, y = (((np.arange(n) + 0.5) / n - 0.5) * side for side, n in sides)
    emitted = (
        landed[receiver.in_window(*np.meshgrid(x, y))].sum()
        / case.json("evaluate")["receivers"][index]["efficiency"]["value"]
    )
    per_ray = (
        emitted * (1 - stored["flux"]["cover_glass"] - stored["flux"]["reflected"] - stored["flux"]["absorbed"]) / rays
    )
    return (taps**2).sum() ** 2 * (per_ray * landed - landed**2 / rays).sum() / (landed**2).sum()


def nmse_vs_sum(case, place):
    floor = lit(case, place)["noise_floor_nmse"]
    assert abs(floor / floor_of(case, place.group) - 1) < 0.2, (floor, floor_of(case, place.group))
    limit = NOISE_FLOORS * floor + NOISE_ALLOWANCE
    value = lit(case, place)["nmse_vs_sum"]
    return Expected(floor, 0.4 * floor, limit=("<=", limit), state=kept(value, limit))


FILES = [f"{name}.{kind}" for name in ("lens", "plate") for kind in ("stl", "3mf", "step")]
ORACLES = {
    f"verify.{oracle.__name__}": oracle
    for oracle in (landing, nmse_vs_design, nmse_same_rays, print_mesh, part_efficiency, part_rays, nmse_vs_sum)
} | {f"verify.form {name}": of_step(name) if name.endswith("step") else of_mesh(name) for name in FILES}
ORACLES["verify.plate_efficiency"] = part_efficiency
