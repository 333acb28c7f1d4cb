"""Oracles of the search: size, free space and walls of the lens that it ends with, and its source, by section 12."""

from dataclasses import replace

import numpy as np
from crooked import Expected, led_rays
from page_colour import flux_and_efficacy
from page_figures import plain
from page_scene import faces_of
from scipy.optimize import minimize
from scipy.spatial import cKDTree


def directions(count):
    """Even over the hemisphere, and the rim."""
    z = 1 - (np.arange(count) + 0.5) / count
    turn = np.arange(count) * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z**2)
    rim = 2 * np.pi * np.arange(2048) / 2048
    inside = np.column_stack([ring * np.cos(turn), ring * np.sin(turn), z])
    return np.concatenate([inside, np.column_stack([np.cos(rim), np.sin(rim), 0 * rim])])


class Solid:
    """Radii of the cavity and of the body in each of some directions: the least of the faces that bound them."""

    def __init__(self, case, u):
        lens = case.lens
        kind = case.lens["spec"]["lens"]["kind"]
        self.faces = dict(zip(lens["faces"], faces_of(lens, lens["faces"]), strict=True))
        sides = {"double": (["inner"], ["outer"]), "tir": (["cap", "side"], ["wall", "flange", "exit"]),
                 "reflector": (["cup", "mouth"], ["back", "mouth"])}[kind]  # fmt: skip
        self.cavity, self.body = (
            np.min([self.faces[name].exact(u)[0] for name in names if name in self.faces], axis=0) for names in sides
        )


def thinnest(case):
    """Least distance between the faces of a double lens: of many points, then of the best pair."""
    inner, outer = faces_of(case.lens, case.lens["faces"])
    u = directions(20_000)
    points = [face.exact(u)[0][:, None] * u for face in (inner, outer)]
    away, at = cKDTree(points[1]).query(points[0])
    best = int(np.argmin(away))

    def apart(x):
        pair = []
        for face, (a, b) in zip((inner, outer), (x[:2], x[2:]), strict=True):
            z = np.clip(np.cos(a), 0, 1)
            direction = np.array([[np.sqrt(1 - z**2) * np.cos(b), np.sqrt(1 - z**2) * np.sin(b), z]])
            pair.append(face.exact(direction)[0][0] * direction[0])
        return np.linalg.norm(pair[0] - pair[1])

    start = [v for k in (best, at[best]) for v in (np.arccos(np.clip(u[k, 2], 0, 1)), np.arctan2(u[k, 1], u[k, 0]))]
    minimum = minimize(apart, start, method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-9, "maxiter": 2000})
    return min(minimum.fun, away[best])


KEPT = {}


def design(case):
    if case.name not in KEPT:
        KEPT[case.name] = worst_record(case)
    return KEPT[case.name]


def worst_record(case):
    """Of lenses of several kinds the worst of all."""
    others = (case.lens.get("others") or {}).values()
    records = [record_of(replace(case, lens=case.lens | {"faces": faces})) for faces in (case.lens["faces"], *others)]
    record = records[0]
    for other in records[1:]:
        record |= {key: max(record[key], other[key]) for key in ("max_radius_mm", "height_mm")}
        for key, value in record["constraints"].items():
            if isinstance(value, tuple):
                record["constraints"][key] = min(value, other["constraints"][key])
    return record


def record_of(case):
    spec = case.lens["spec"]
    u = directions(20_000)
    limits = spec["constraints"]
    solid = Solid(case, u)
    z = u[:, 2]
    kind = spec["lens"]["kind"]
    h = limits["cavity_height_mm"]
    r = limits["cavity_radius_mm"]
    clear = (h / r**2 * solid.cavity**2 * (1 - z**2) + solid.cavity * z - h).min()
    from_axis = solid.body * (1 if kind == "double" else np.sqrt(1 - z**2))
    near = 4e-3  # between the directions at which the program looks
    largest = (from_axis.max(), near)
    height = ((solid.body * z).max(), near)
    margins = {
        "cavity_clearance_mm": (clear, near), "radius_margin_mm": (limits["max_radius_mm"] - largest[0], near),
        "wall_margin_mm": (thinnest(case) - limits["min_thickness_mm"], 1e-4) if kind == "double" else ...,
        "largest_wall_margin_mm": None, "height_margin_mm": None, "keep_out_clearance_mm": None,
        "opening_margin_mm": opening(case, solid, u),
        "flange_margin_mm": ..., "curvature_margin_per_mm": ..., "draft_margin_deg": ..., "edge_margin_deg": ...,
    }  # fmt: skip
    if limits["max_wall_mm"]:
        margins["largest_wall_margin_mm"] = limits["max_wall_mm"] - (solid.body - solid.cavity).max(), near
    if limits["max_height_mm"]:
        margins["height_margin_mm"] = limits["max_height_mm"] - height[0], near
    functions = sum(spec["lens"]["levels"])
    steps = sum(spec["optimise"]["steps_per_level"][-1:])
    return {
        "rays_per_step": spec["optimise"]["rays"], "steps": ..., "max_radius_mm": largest, "height_mm": height,
        "constraints": margins, "source": source(case), "source_outline_mm": ..., "history": ..., "ended": ...,
        "kept_start": ..., "starts": [], "criteria": ..., "functions": functions, "last": steps,
    }  # fmt: skip


def opening(case, solid, u):
    """Room of a cup that levels shape over its mouth; None of any other lens."""
    spec = case.lens["spec"]
    about = u[u[:, 2] > np.cos(0.3)]
    if spec["lens"]["kind"] != "reflector" or not spec["lens"]["levels"] or spec["lens"]["cup"]["fixed"]:
        return None
    room = (solid.faces["cup"].exact(about)[0] - solid.faces["mouth"].exact(about)[0]).min()
    return min(room, spec["constraints"]["max_radius_mm"]), 0.05


def source(case):
    """Of the first LED."""
    spec = case.lens["spec"]
    watts, efficacy = flux_and_efficacy(spec["source"], case.files)
    record = dict.fromkeys((
        "wavelengths_nm", "refractive_indices", "extrapolated_index_share", "clamped_index_share", "title", "warnings",
        "files", "placement", "rays", "effective_rays", "virtual_focus_mm",
    ), ...)  # fmt: skip
    record |= {
        "flux_w": plain(watts),
        "lumens_per_watt": efficacy and plain(efficacy),
        "symmetry": "none",
        "model": None,
    }
    if spec["source"]["kind"] == "rayfile":
        p, d, flux = (rays.astype(float) for rays in led_rays("near"))
        d /= np.linalg.norm(d, axis=1)[:, None]
        across = flux[:, None, None] * (np.eye(3) - d[:, :, None] * d[:, None, :])
        focus = np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, p))
        record |= {
            "rays": len(p), "effective_rays": plain(flux.sum() ** 2 / (flux**2).sum()),
            "virtual_focus_mm": [plain(place) for place in focus],
        }  # fmt: skip
    return record


def size(key, limit, margin):
    """A length with its limit, which is kept where its margin is not below 0 but for the tolerance."""

    def oracle(case, _place):
        values = design(case)
        limits = case.lens["spec"]["constraints"]
        value, near = values[key] if key in values else values["constraints"][key]
        bound = 0.0 if limit is None else limits[limit]
        if bound is None:
            return Expected(value, near, "mm")
        kept = values["constraints"][margin][0] >= -7e-5 * limits["max_radius_mm"]
        sense = ">=" if limit is None else "<="
        return Expected(value, near, "mm", limit=(sense, bound), state="pass" if kept else "fail")

    return oracle


def levels(case, place):
    return Expected(len(case.json("design")["history"]))


ORACLES = {
    "design.radius": size("max_radius_mm", "max_radius_mm", "radius_margin_mm"),
    "design.height": size("height_mm", "max_height_mm", "height_margin_mm"),
    "design.cavity": size("cavity_clearance_mm", None, "cavity_clearance_mm"),
    "design.levels": levels,
    "design.steps": lambda case, place: Expected(sum(len(level["loss"]) for level in case.json("design")["history"])),
    "design.functions": lambda case, place: Expected(case.json("design")["history"][-1]["functions"]),
}
RECORDS = {
    "design": lambda case: {key: entry for key, entry in design(case).items() if key not in ("functions", "last")}
}
