"""Every figure of the mould of ``check`` by docs/definitions.md, section 13: bodies asked by points, and a search."""

from itertools import pairwise

import numpy as np
from crooked import Expected
from oracle_part import body_of, bore_scale, kept_of, slope_of
from page_body import directions
from page_tracer import unit
from scipy.spatial import cKDTree

UPRIGHT = np.sin(np.radians(0.02))
HEAT = {"PMMA": (0.11, 240.0, 70.0, 95.0)}  # mm^2/s; deg C of the melt, of the mould, as it is ejected
RATIO = 3.0


def is_moulded(case):
    return case.lens["spec"]["manufacture"]["process"] == "moulded"


def below_mm(case):
    """Depth of what stands below z = 0, and its radius: a cylinder, or a plate without an end."""
    spec = case.lens["spec"]
    if spec["plate"]:
        return spec["plate"]["thickness_mm"], 1e3
    return spec["base"]["height_mm"], spec["base"]["diameter_mm"] / 2


def inside(case, q):
    """True for points (mm) in the material of the lens, its base or its plate."""
    body = body_of(case)
    (depth, wide) = below_mm(case)
    across = np.hypot(q[..., 0], q[..., 1])
    above = q[..., 2] > 0
    away = np.linalg.norm(q[above], axis=-1)
    u = unit(q[above])
    lens = np.zeros_like(above)
    lens[above] = (away > body.radius(body.cavity, u)) & (away < body.radius(body.envelope, u))
    turn = np.arctan2(q[..., 1], q[..., 0]) / (2 * np.pi) % 1 * len(body.rim)
    bore = np.interp(turn, np.arange(len(body.rim) + 1), np.append(body.rim, body.rim[0]))
    bore = bore * (1 - (bore_scale(case) - 1) * q[..., 2] / depth)
    wide = wide + slope_of(case) * q[..., 2]
    foot = (q[..., 2] < 0) & (q[..., 2] > -depth) & (across > bore) & (across < wide)
    return lens | foot


def free(case, p, way):
    """True for points (mm) of the boundary from which the way along z, up or down, meets no material."""
    steps = np.concatenate([[0.003, 0.01, 0.03], np.arange(0.1, 12.0, 0.1)])
    clear = np.full(len(p), True)
    for some in np.array_split(steps, 20):
        rows = np.flatnonzero(clear)
        ahead = p[rows, None] + way * some[:, None] * [0.0, 0, 1]
        clear[rows] = ~inside(case, ahead).any(axis=1)
    return clear


def half(case, name):
    """Shares of a face by the upper and the lower half, heights of the rest, and the least draft (degrees) drawn."""
    return kept_of(case, f"half {name}", lambda: halves(case, name))


def halves(case, name):
    part = body_of(case).parts[name]
    out = -1 if part.before == "cavity" else 1
    p, n, areas = part.area
    facing = out * n[:, 2]
    above, below = (free(case, p + 1e-4 * out * n, way) for way in (1, -1))
    up = above & (facing > -UPRIGHT)
    down = below & (facing < UPRIGHT)
    hidden = ~(up | down) & (abs(facing) > UPRIGHT)
    upper = up & ((facing > 0) | ~down)
    shares = [areas[mask].sum() / areas.sum() for mask in (upper, ~upper & ~hidden)]
    heights = (p[hidden, 2].min(), p[hidden, 2].max()) if hidden.any() else None
    share, phi = np.meshgrid(np.linspace(0, 1, 61), 2 * np.pi * np.arange(240) / 240)
    q, m, _ = (array.reshape(-1, 3) for array in part.at(share, phi))
    if m[:, 2].min() < 0 < m[:, 2].max():
        return *shares, heights, 0.0
    drawn = free(case, q + 1e-4 * out * m, np.sign(out * m[:, 2].mean())) if hidden.any() else np.full(len(q), True)
    return *shares, heights, np.degrees(np.arcsin(abs(m[drawn, 2]).min()))


def parting(case):
    """Of a plate the edge of its top; else the crease at which wall and exit are widest."""
    if case.lens["spec"]["plate"]:
        return {"places": ("plate",), "radius_mm": None, "low_mm": 0.0, "high_mm": 0.0}
    body = body_of(case)
    phi = 2 * np.pi * np.arange(1440) / 1440
    leaving = body.parts["exit"]
    u = directions(leaving.ends(phi)[1], phi)
    p = leaving.exact(u)[0][:, None] * u
    z = p[:, 2]
    return {"places": ("exit", "wall"), "radius_mm": (np.hypot(*p[:, :2].T).max(), 2e-3),
            "low_mm": (z.min(), 2e-3), "high_mm": (z.max(), 2e-3)}  # fmt: skip


def ball(case):
    """Diameter (mm) of the largest ball, by steps at random from the best of many random places in the material."""
    return kept_of(case, "ball", lambda: sought_ball(case))


def sought_ball(case):
    body = body_of(case)
    (depth, wide) = below_mm(case)
    rng = np.random.default_rng(1)
    share, phi = np.meshgrid(np.linspace(0, 1, 150), 2 * np.pi * np.arange(400) / 400)
    faces = [part.at(share, phi)[0].reshape(-1, 3) for part in (*body.cavity, *body.envelope)]
    turn = 2 * np.pi * np.arange(720) / 720
    rim = body.rim
    wide = min(wide, body.outer_rim.max() + 4.0)
    outer = body.outer_rim
    axes = np.stack([np.cos(turn), np.sin(turn)], axis=1)

    def within(q):
        return inside(case, q) & (np.hypot(q[..., 0], q[..., 1]) < wide)

    foot = rim * bore_scale(case)
    narrow = wide + 0 * rim - (0.0 if wide < below_mm(case)[1] else slope_of(case) * depth)
    levels = [(foot, narrow, -depth), (np.minimum(wide, outer), np.maximum(wide, outer), 0.0)]
    for low, high, z in levels:
        across = low + np.linspace(0, 1, 80)[:, None] * (high - low)
        faces.append(np.dstack([across[..., None] * axes, np.full((*across.shape, 1), z)]).reshape(-1, 3))
    for top, end in ((rim, foot), (wide + 0 * rim, narrow)):
        down = np.linspace(0, 1, 40)[:, None, None]
        around = (top + down[..., 0] * (end - top))[..., None] * axes
        faces.append(np.dstack([around, np.broadcast_to(-depth * down, (40, 720, 1))]).reshape(-1, 3))
    points = np.concatenate(faces)
    tree = cKDTree(points)
    coarse = cKDTree(points[::40])  # a ball that is too small by some points is so by all
    places = rng.uniform(points.min(axis=0), points.max(axis=0), (20_000, 3))
    places = places[within(places)]
    best = places[np.argsort(tree.query(places)[0])[-12:]]
    radii = tree.query(best)[0]
    step = 0.3
    for _ in range(60):
        tried = best[:, None] + step * rng.normal(size=(1, 80, 3))
        larger = coarse.query(tried)[0] > radii[:, None]
        larger[larger] = within(tried[larger])
        distances = np.zeros(larger.shape)
        distances[larger] = tree.query(tried[larger])[0]
        better = distances.argmax(axis=1)
        wins = distances.max(axis=1) > radii
        best = np.where(wins[:, None], tried[np.arange(len(best)), better], best)
        radii = np.where(wins, distances.max(axis=1), radii)
        step = step * 0.9
    return 2 * radii.max()


def cooling_s(case):
    heat = HEAT.get(case.lens["spec"]["lens"]["material"])
    if heat is None:
        return None
    a, melt, mould, out = heat
    return ball(case) ** 2 / (np.pi**2 * a) * np.log(4 / np.pi * (melt - mould) / (out - mould))


def drawn(name):
    def figure(case, place):
        upper, lower, *_ = half(case, name)
        return Expected(100 * (upper + lower), 1.5, "%")

    return figure


def parting_line(case, place):
    places = parting(case)["places"]
    return Expected("where exit and wall meet" if len(places) > 1 else "the edge of the plate’s top")


def gate(case, place):
    return Expected(f"at the side of the {'plate' if case.lens['spec']['plate'] else 'base'}")


def inner_corners(case, place):
    """Creases of the cavity, and the foot of the dome on its plate."""
    pairs = [f"{part.name} and {following.name}" for part, following in pairwise(body_of(case).cavity)]
    return Expected(", ".join([*pairs, *(["plate and outer"] if case.lens["spec"]["plate"] else [])]))


def thickest_ball(case, place):
    return Expected(ball(case), 4e-3 * ball(case), "mm")


def thickness_ratio(case, place):
    value = ball(case) / body_of(case).thinnest
    return Expected(value, 5e-3 * value)


def cooling(case, place):
    seconds = cooling_s(case)
    return Expected("no estimate") if seconds is None else Expected(seconds, 1e-2 * seconds, "s")


def undercut(case, place):
    name = place.title.removeprefix("Manufacture, ").removesuffix(" face")
    held = half(case, name)[2] is None
    return Expected("yes" if held else "no", state="pass" if held else "fail")


ORACLES = {f"check.{name}_drawn": drawn(name) for name in ("inner", "outer", "cap", "side", "wall", "exit")} | {
    "check.parting": parting_line,
    **{f"check.{oracle.__name__}": oracle
       for oracle in (gate, inner_corners, thickest_ball, thickness_ratio, cooling, undercut)},
}  # fmt: skip
