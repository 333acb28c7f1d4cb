"""Every number of ``export.json`` by docs/definitions.md, section 14, from the exact faces and the files themselves."""

import re
from functools import partial
from hashlib import sha256

import numpy as np
from oracle_part import (
    FORM_NM,
    base_of,
    body_of,
    bore_mm2,
    bore_scale,
    density_of,
    gap_mm,
    lamps_of,
    mesh_of,
    normal_mrad,
    own_places,
    plate_form_error,
    plate_mm3,
    schema,
    slope_of,
    volume,
    worst_errors,
)
from page_tracer import unit


def area_mm2(case):
    """Of all faces of the solid, on a base without relief that is wider than the lens, or none."""
    body = body_of(case)
    base = base_of(case)
    sums = {sign: [(part.name, part.area[2].sum()) for part in parts]
            for sign, parts in ((1, body.envelope), (-1, body.cavity))}  # fmt: skip
    total = sum(value for name, value in sums[1]) + sum(
        value * (-1 if name == "mouth" else 1) for name, value in sums[-1]
    )
    rim = np.pi * (body.outer_rim**2).mean()
    opening = body.opening_mm2
    if base["kind"] == "none":
        total += rim - opening
    else:
        radius = base["diameter_mm"] / 2
        disc = np.pi * radius**2
        around = 2 * np.sqrt(np.pi * bore_mm2(case)) if base["bore_setback_mm"] else length_mm(body.rim)
        scale = 1 - slope_of(case) * base["height_mm"] / radius
        wider = bore_scale(case)
        high = base["height_mm"]
        slant = np.hypot(high, radius * (1 - scale))
        total += disc * (1 + scale**2) - rim - opening * wider**2 + np.pi * radius * (1 + scale) * slant
        total += lateral_mm2(body.rim, wider, high) if wider != 1.0 else around * high
        if base["relief_step_mm"]:
            wall = body.outer_rim.min() - base["relief_setback_mm"]
            narrow, along = (
                (np.pi * wall**2, 2 * np.pi * wall) if base["relief_setback_mm"] else (rim, length_mm(body.outer_rim))
            )
            total += 2 * (rim - narrow) + (along - np.pi * base["diameter_mm"]) * base["relief_step_mm"]
    flange = case.lens["spec"]["lens"].get("flange")
    if flange:
        inner = 0.9994 * case.lens["spec"]["constraints"]["max_radius_mm"]
        outer = flange["diameter_mm"] / 2
        total += 2 * np.pi * (outer**2 - inner**2) + 2 * np.pi * (outer - inner) * flange["thickness_mm"]
    return total


def lateral_mm2(rim, scale, high):
    """Area of the cone about the axis from a rim to its foot, which is ``scale`` times as wide, by its heights."""
    slope = np.fft.irfft(np.fft.rfft(rim) * 1j * np.arange(len(rim) // 2 + 1))
    nearest = rim**2 / np.hypot(rim, slope)  # of the tangent to the axis
    slant = np.hypot(high, (scale - 1) * nearest)
    return 2 * np.pi * (np.hypot(rim, slope) * slant).mean() * (1 + scale) / 2


def length_mm(rim):
    """Length of a rim whose radius is known at even azimuths."""
    slope = np.fft.irfft(np.fft.rfft(rim) * 1j * np.arange(len(rim) // 2 + 1))
    return 2 * np.pi * np.hypot(rim, slope).mean()


def box_mm(case):
    """Least and largest corner of the box around the solid."""
    spec = case.lens["spec"]
    body = body_of(case)
    base = spec["base"]
    flange = spec["lens"].get("flange")

    def reach(axis, sign):
        def place(part, s, f):
            return sign * part.at(s, f)[0][..., axis]

        return max(part.extreme(partial(place, part)) for part in body.envelope)

    low = -np.array([reach(axis, -1) for axis in range(3)])
    high = np.array([reach(axis, 1) for axis in range(3)])
    wide = max(0.0 if base["kind"] == "none" else base["diameter_mm"] / 2, flange["diameter_mm"] / 2 if flange else 0.0)
    low[:2] = np.minimum(low[:2], -wide)
    high[:2] = np.maximum(high[:2], wide)
    low[2] = 0.0 if base["kind"] == "none" else -base["height_mm"]
    return np.array([low, high])


def chord_um(case, path, to_local=lambda p: p):
    """The largest distance of the middles of facets and of their sides from the face on which all corners lie."""
    mesh = mesh_of(path)
    most = 0.0
    corners = to_local(np.asarray(mesh.triangles).reshape(-1, 3)).reshape(-1, 3, 3)
    corners = corners[(corners[..., 2] > -1e-5).all(axis=1) & (corners[..., 2] > 1e-5).any(axis=1)]
    for part in body_of(case).parts.values():
        if part.name in ("mouth", "flange"):
            continue

        def off(p, part=part):
            u = unit(p)
            rho, n = part.exact(u)
            return abs(np.linalg.norm(p, axis=1) - rho) * (n * u).sum(axis=1)

        on = (off(corners.reshape(-1, 3)).reshape(-1, 3) < 1e-5).all(axis=1)
        facets = corners[on]
        middles = [facets.mean(axis=1), *((facets[:, k] + facets[:, k - 1]) / 2 for k in range(3))]
        most = max(most, *(off(middle).max() for middle in middles))
    return 1e3 * most


def mesh_figures(path):
    """Volume, area, closed, genus, facets and vertices of a mesh file."""
    mesh = mesh_of(path)
    genus = 1 - (len(mesh.vertices) - len(mesh.faces) // 2) // 2
    return mesh.volume, mesh.area, bool(mesh.is_watertight), genus, len(mesh.faces), len(mesh.vertices)


def judged(name, value, sense, limit, unit=""):
    return {"value": value, "sense": sense, "limit": limit, "unit": unit, "tolerance": 0.0, "name": name, "remedy": ...,
            "passed": True}  # fmt: skip


def near(value, share):
    return value, share * abs(value)


def criteria_of(start, form, more, mesh_mm3, solid_mm3):
    changed = abs(mesh_mm3 / solid_mm3 - 1)
    return [
        judged(f"{start}form_error", form, "<=", FORM_NM, "nm"), *more[:1],
        judged(f"{start}step_valid", 1.0, ">=", 1.0), judged(f"{start}step_volume_change", (0.0, 1e-9), "<=", 1e-9),
        *more[1:], judged(f"{start}watertight", 1.0, ">=", 1.0), judged(f"{start}watertight_3mf", 1.0, ">=", 1.0),
        judged(f"{start}genus_difference", 0.0, "<=", 0.0),
        judged(f"{start}mesh_volume_change", (changed, 3e-6), "<=", ...),
    ]  # fmt: skip


def tolerance_record(case):
    spec = case.lens["spec"]
    source = spec["source"]
    n = spec["lens"]["refractive_index"]
    kind = spec["lens"].get("kind", "double")
    last, turn = {"tir": ("exit", 4 * n - 2), "reflector": ("cup", 2.0)}.get(kind, ("outer", 2 * n - 2))
    image = None
    if source["kind"] in ("rectangle", "chips"):
        chips = source.get("chips", [source | {"x_mm": 0.0, "y_mm": 0.0}])
        away = body_of(case).parts[last].shape.exact(np.array([[0.0, 0.0, 1.0]]))[0][0]
        image = near(2e3 * max(map(reach_mm, chips)) / away, 1e-9)
    return {"form_nm": 50.0, "normal_mrad": normal_mrad(case), "image_mrad": image,
            "turn": near(turn, 0.01)}  # fmt: skip


def reach_mm(chip):
    corners = [complex(x * chip["width_mm"], y * chip["height_mm"]) / 2 for x in (-1, 1) for y in (-1, 1)]
    return max(abs(complex(chip["x_mm"], chip["y_mm"]) + corner) for corner in corners)


def export_record(case):
    spec = case.lens["spec"]
    stored = case.json("export")
    stl = case.folder / "lens.stl"
    (form, normal) = worst_errors(case)
    density = density_of(case)
    solid = volume(case, None).value
    (volume_mm3, area, closed_, genus, facets, corners) = mesh_figures(stl)
    names = sorted(re.findall(r"ADVANCED_FACE\s*\(\s*'([^']*)'", (case.folder / "lens.step").read_text()))
    chord = chord_um(case, stl)
    angle = judged("normal_error", near(normal, 0.1), "<=", normal_mrad(case), "mrad")
    files = {name: (case.folder / name).read_bytes() for name in stored["files"]}
    record = {
        "face_tolerance": tolerance_record(case), "keep_out": None,
        "form_error_nm": {"max": near(form, 0.1), "rms": ...},
        "normal_error_mrad": {"max": near(normal, 0.1), "rms": ...},
        "volume_mm3": near(solid, 3e-6), "volume_mesh_mm3": near(volume_mm3, 1e-6),
        "mass_g": near(solid * density / 1000, 3e-6) if density else None,
        "area_mm2": near(area_mm2(case), 3e-6), "area_mesh_mm2": near(area, 1e-6),
        "bounds_mm": [[(x, 2e-3 * chord + 1e-5) for x in corner] for corner in box_mm(case)],
        "watertight": closed_, "genus": genus, "faces": {"count": len(names), "names": names},
        "nodes": dict.fromkeys(stored["nodes"], ...), "step_schema": schema(case, None).value,
        "signature": {name: spec["manufacture"][name] for name in ("author", "organisation", "date")},
        "untrimmed_surfaces": None,
        "triangulation": {"triangles": facets, "vertices": corners, "rings": ..., "chord_error_um": near(chord, 0.1)},
        "files": {name: {"bytes": len(data), "sha256": sha256(data).hexdigest()} for name, data in files.items()},
        "criteria": criteria_of("", near(form, 0.1), [angle], volume_mm3, solid),
    }  # fmt: skip
    if spec["plate"] is None:
        return record | {"plate": None}
    plate, criteria = plate_record(case)
    *of_lens, facets_cut = record["criteria"]  # follows from two fields, and stands behind those of the plate
    return record | {"plate": plate, "criteria": [*of_lens, *criteria, facets_cut]}


def plate_record(case):
    volume_mm3, _, closed_, genus, facets, _ = mesh_figures(case.folder / "plate.stl")
    solid = plate_mm3(case)
    form = plate_form_error(case, None)
    box = mesh_of(case.folder / "plate.stl").bounds
    density = density_of(case)
    criteria = criteria_of("plate_", (form.value, form.within), [], volume_mm3, solid)
    criteria.insert(3, judged("plate_volume_error", (0.0, 1e-6), "<=", 1e-6))
    chord = chord_um(case, case.folder / "plate.stl", lambda p: own_places(case, p))
    return {
        "lenses": len(lamps_of(case)[0]), "gap_mm": (gap_mm(case), 0.004), "form_error_nm": (form.value, form.within),
        "volume_mm3": near(solid, 3e-6), "volume_mesh_mm3": near(volume_mm3, 1e-6),
        "mass_g": near(solid * density / 1000, 3e-6) if density else None,
        "bounds_mm": [[near(x, 1e-6) for x in corner] for corner in box], "watertight": closed_, "genus": genus,
        "faces": len(re.findall("ADVANCED_FACE", (case.folder / "plate.step").read_text())), "triangles": facets,
        "chord_error_um": near(chord, 0.1), "seconds": ...,
    }, criteria  # fmt: skip


RECORDS = {"export": export_record}
