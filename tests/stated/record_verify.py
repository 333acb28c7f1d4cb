"""Every number of ``verify.json`` by docs/definitions.md, section 14, by exact faces, files and pictures."""

import numpy as np
from oracle_part import lamps_of, mesh_of
from oracle_proof import (
    DEVIATION,
    NOISE_ALLOWANCE,
    NOISE_FLOORS,
    ORACLES,
    arrays,
    floor_of,
    reach_mm,
    record,
    same_rays_limit,
    screens,
)
from record_export import area_mm2, box_mm, mesh_figures, near, volume

MOVED_MM = 0.002
MOST_CHORD_MM = 0.05
MOST_AREA = 0.01
GAPS = ("rms", "p99", "max")


def gaps_record(values, rays, stored):
    """Of landing gaps by their quantiles at 0, 0.2 ... 100 %."""
    quantiles = {
        "rms": near(np.sqrt(0.5 * (values[1:] ** 2 + values[:-1] ** 2).mean()), 0.15),
        "p99": near(values[495], 1e-9),
        "max": near(values[-1], 1e-9),
    }
    assert 0 < stored["compared"] <= rays
    return quantiles | {"compared": ...} | same_light(stored)


def same_light(stored):
    """Light that is that of the design but for a few rays that graze an edge, told in pairs of fates."""
    assert sum(pair["rays"] for pair in stored["pairs"]) == stored["fates"]
    pairs = [dict.fromkeys(pair, ...) for pair in stored["pairs"]]
    return {"flux": (0.0, 5e-4), "fates": (0, 4), "fates_flux": (0.0, 4e-3), "pairs": pairs}


def budget_of(designed):
    """Shares of the design's light by the fates of the part's."""
    flux = designed["flux"]
    more = designed["missed_by_cause"]["event_limit"]
    names = (
        "detected",
        "outside",
        "total_reflection",
        "absorbed",
        "cover_glass",
        "bodies",
        "housing",
        "second_wall",
        "reflected",
    )
    return {name: flux[name] for name in names} | {"missed": flux["missed"] - more, "event_limit": more}


def receiver_record(case, index):
    stored = record(case)["receivers"][index]
    designed = case.json("evaluate")["receivers"][index]
    maps = arrays(case, "verify")
    rays = record(case)["rays"]
    kind = screens(case)[index][0]
    part, design = (maps[f"receivers.{index}.{name}"] for name in ("irradiance", "design_irradiance"))
    share = designed["efficiency"]["value"]
    budget = stored["flux"]
    noise = 4 * np.sqrt(share * (1 - share) / rays) + 5e-4
    assert abs(sum(budget.values()) - 1) < 1e-9 and budget["detected"] == stored["efficiency"]
    reach = reach_mm(case, index)
    own_rays = stored["own_rays"]
    redrawn = own_rays["efficiency_design"]["value"]
    error = np.sqrt(share * (1 - share) / own_rays["rays"])
    together = np.hypot(*(own_rays[key]["standard_error"] for key in ("efficiency", "efficiency_design")))
    assert sorted(own_rays["flux"]) == sorted(budget) and abs(sum(own_rays["flux"].values()) - 1) < 1e-9
    brep = stored["brep"]
    gaps_step = maps[f"receivers.{index}.gaps_step_mm"]
    return {
        "name": designed["name"], "width": designed["width"], "height": designed["height"],
        "far_field": kind == "far_field", "nmse_vs_design": (((part - design) ** 2).sum() / (design**2).sum(), 1e-9),
        "noise_floor_nmse": ..., "nmse_same_rays": (0.0, same_rays_limit(stored)), "efficiency": (share, noise),
        "efficiency_design_same_rays": (stored["efficiency"], 1e-3),
        "against_design": gaps_record(maps[f"receivers.{index}.gaps_mesh_mm"], rays, stored["against_design"]),
        "deviation_limit_mm": ... if reach is None else near(DEVIATION * reach, 1e-6),
        "flux": {name: (share_of, noise + 0.01) for name, share_of in budget_of(designed).items()},
        "brep": {"rays": min(1024, rays), "seconds": ...,
                 "against_design": gaps_record(gaps_step, brep["rays"], brep["against_design"]),
                 "against_mesh": dict.fromkeys((*GAPS, "compared"), ...) | same_light(brep["against_mesh"])},
        "mitsuba": None,
        "own_rays": {
            "rays": rays,
            "efficiency": {"value": (redrawn, 4 * together + 1e-3), "unit": "",
                           "standard_error": (0.6 * error, 0.5 * error)},
            "efficiency_design": {"value": ..., "unit": "", "standard_error": ...},
            "nmse_less_noise": ...
                if own_rays["nmse_less_noise"] is None else dict.fromkeys(own_rays["nmse_less_noise"], ...),
            "flux": dict.fromkeys(budget, ...),
        },
    }  # fmt: skip


def sizes_record(case):
    """Volume, area and box of each file by its own facets, or exact; what flat facets may change is taken as stated."""
    stored = record(case)["sizes"]
    export = case.json("export")
    stl = case.folder / "lens.stl"
    volume_mm3, area, *_ = mesh_figures(stl)
    mesh = {"volume_mm3": near(volume_mm3, 1e-6), "area_mm2": near(area, 1e-6),
            "bounds_mm": [[(coordinate, 1e-5) for coordinate in corner] for corner in mesh_of(stl).bounds]}  # fmt: skip
    solid = volume(case, None).value
    step = {"volume_mm3": near(solid, 3e-6), "area_mm2": near(area_mm2(case), 3e-6),
            "bounds_mm": [[(coordinate, 5e-3) for coordinate in corner] for corner in box_mm(case)]}  # fmt: skip
    chord = 1e-3 * export["triangulation"]["chord_error_um"]
    assert 0 < stored["mesh"]["facets_mm3"] < 0.02 * solid and stored["mesh"]["facets_mm2"] < 0.01 * area
    facets = dict.fromkeys(("chord_mm", "facets_mm3", "facets_mm2"), ...)
    return {
        "exported": {key: export[key] for key in ("volume_mm3", "area_mm2", "bounds_mm")},
        "chord_mm": near(chord, 1e-6),
        "mesh": {"size": mesh, **facets}, "step": {"size": step, **dict.fromkeys(facets, 0.0)},
    }  # fmt: skip


def verify_record(case):
    stored = record(case)
    every = [receiver_record(case, k) for k in range(len(record(case)["receivers"]))]
    volume_mm3, _, _, _, facets, _ = mesh_figures(case.folder / "lens.stl")
    assert stored["emission_apart"] <= 5.5 and 200 <= stored["plain_cast"]["casts"] <= 400
    together = [
        {"name": every[k]["name"], "lamps": len(lamps_of(case)[0]), "rays": stored["rays"],
         "efficiency": (case.json("evaluate")["receivers"][k]["efficiency"]["value"], 0.05),
         "nmse_vs_sum": ..., "noise_floor_nmse": near(floor_of(case, k), 0.2)} for k, _ in enumerate(stored["together"])
    ]  # fmt: skip
    return {
        "conditions": None, "receivers": every, "rays": stored["rays"], "triangles": facets, "open_edges": 0,
        "volume_mm3": near(volume_mm3, 1e-6), "sizes": stored["sizes"] and sizes_record(case), "emission_apart": ...,
        "facet_height_um": {"rms": ..., "max": ...}, "far_facets": 0, "altered_files": [],
        "plain_cast": {"rays": min(200, stored["rays"]), "casts": ..., "disagreements": 0},
        "together": together, "forms": [form_record(case, form["name"]) for form in stored["forms"]],
        "criteria": [criterion_record(case, criterion) for criterion in stored["criteria"]],
        **{key: every[0][key] for key in ("nmse_vs_design", "noise_floor_nmse", "efficiency")},
        "deviation_mm": {key: every[0]["against_design"][key] for key in GAPS},
    }  # fmt: skip


def form_record(case, name):
    off = ORACLES[f"verify.form {name}"](case, None)
    limit = 0.07
    if not name.endswith("step"):
        limit += np.sqrt(3) * np.spacing(np.float32(abs(mesh_of(case.folder / f"{name[:-4]}.stl").bounds).max())) * 1e3
    return {"name": name, "off_um": (1e-3 * off.value, 1e-3 * off.within), "face": ..., "at_mm": [...] * 3,
            "limit_um": (limit, 1e-3), "open_edges": 0, "lacking": []}  # fmt: skip


def lamps_in(case):
    return "plate" if case.lens["spec"]["plate"] else "lamps"


def limits(case):
    """The largest value of each criterion, by the end of its name; those of sizes by what is stated of the facets."""
    stored = record(case)
    receivers = stored["receivers"]
    sizes = stored["sizes"]
    known = {"open_edges": 0.0, "plain_cast_disagreements": 0.0, "own_rays_emission": 5.5, "gaps": 0.0}
    for start, file in (("", sizes["mesh"]), ("brep_", sizes["step"])) if sizes else ():
        volume_mm3 = sizes["exported"]["volume_mm3"]
        area = sizes["exported"]["area_mm2"]
        moved = MOVED_MM * area / volume_mm3
        known[f"{start}volume_change"] = min(file["facets_mm3"], MOST_CHORD_MM * area) / volume_mm3 + moved
        known[f"{start}area_change"] = min(file["facets_mm2"] / area, MOST_AREA) + moved
        known[f"{start}box_change"] = min(file["chord_mm"], MOST_CHORD_MM) + sizes["chord_mm"] + MOVED_MM
    for index, receiver in enumerate(receivers):
        start = f"{receiver['name']}: " if index else ""
        floor = receiver["noise_floor_nmse"]
        own_rays = receiver["own_rays"]
        error = np.hypot(*(own_rays[key]["standard_error"] for key in ("efficiency", "efficiency_design")))
        less = own_rays["nmse_less_noise"]
        known |= {
            f"{start}deviation_rms": receiver["deviation_limit_mm"],
            f"{start}brep_deviation_rms": receiver["deviation_limit_mm"] / 2,
            f"{start}flux_deviation": 1e-3, f"{start}fate_disagreement_flux": 1e-3, f"{start}brep_flux_deviation": 1e-4,
            f"{start}brep_fate_disagreements": 2.0, f"{start}nmse_same_rays": same_rays_limit(receiver),
            f"{start}nmse_vs_design": NOISE_FLOORS * floor + NOISE_ALLOWANCE,
            f"{start}own_rays_efficiency": 1e-3 + 4 * error,
            f"{start}own_rays_nmse": 1e-3 + 4 * less["standard_error"] if less else None,
        }  # fmt: skip
    for lit in stored["together"]:
        known[f"{lit['name']}: {lamps_in(case)}_nmse_vs_sum"] = NOISE_FLOORS * lit["noise_floor_nmse"] + NOISE_ALLOWANCE
    forms = {f"{form['name']}: form": form["limit_um"] for form in stored["forms"]}
    return known | forms | {f"{form['name']}: gaps": 0.0 for form in stored["forms"]}


def values(case):
    """What criteria are on, of the record's own figures, by their names."""
    stored = record(case)
    known = {"open_edges": stored["open_edges"], "plain_cast_disagreements": stored["plain_cast"]["disagreements"],
             "own_rays_emission": stored["emission_apart"]}  # fmt: skip
    for index, receiver in enumerate(stored["receivers"]):
        start = f"{receiver['name']}: " if index else ""
        for prefix, gaps in (("", receiver["against_design"]), ("brep_", receiver["brep"]["against_design"])):
            known |= {f"{start}{prefix}deviation_rms": gaps["rms"], f"{start}{prefix}flux_deviation": gaps["flux"]}
        known |= {f"{start}{key}": receiver[key] for key in ("nmse_same_rays", "nmse_vs_design")}
        known[f"{start}fate_disagreement_flux"] = receiver["against_design"]["fates_flux"]
        known[f"{start}brep_fate_disagreements"] = receiver["brep"]["against_design"]["fates"]
        own_rays = receiver["own_rays"]
        known[f"{start}own_rays_efficiency"] = abs(
            own_rays["efficiency"]["value"] - own_rays["efficiency_design"]["value"]
        )
        known[f"{start}own_rays_nmse"] = own_rays["nmse_less_noise"] and own_rays["nmse_less_noise"]["value"]
    known |= size_changes(stored["sizes"]) | {f"{form['name']}: form": form["off_um"] for form in stored["forms"]}
    known |= {f"{form['name']}: gaps": form["open_edges"] + len(form["lacking"]) for form in stored["forms"]}
    return known | {f"{lit['name']}: {lamps_in(case)}_nmse_vs_sum": lit["nmse_vs_sum"] for lit in stored["together"]}


def size_changes(sizes):
    """Relative changes of volume and area, and the largest change (mm) of a side of the box, of each file."""
    known = {}
    for start, file in (("", sizes["mesh"]), ("brep_", sizes["step"])) if sizes else ():
        exported, size = sizes["exported"], file["size"]
        known |= {f"{start}{key}_change": abs(size[f"{key}_{unit}"] / exported[f"{key}_{unit}"] - 1.0)
                  for key, unit in (("volume", "mm3"), ("area", "mm2"))}  # fmt: skip
        known[f"{start}box_change"] = float(np.abs(np.subtract(size["bounds_mm"], exported["bounds_mm"])).max())
    return known


def criterion_record(case, stored):
    name = stored["name"]
    limit = limits(case)[stored["name"]]
    return {
        "name": name, "value": values(case)[name], "sense": "<=", "limit": near(limit, 1e-9), "unit": ...,
        "tolerance": 0.0, "remedy": ..., "passed": stored["value"] <= limit,
    }  # fmt: skip


RECORDS = {"verify": verify_record}
