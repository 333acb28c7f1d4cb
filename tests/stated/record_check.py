"""Every number of ``check.json`` by docs/definitions.md, section 13, from the exact faces alone."""

from itertools import pairwise

import numpy as np
import oracle_turning as turning
from oracle_mould import ball, cooling_s, half, is_moulded, parting
from oracle_part import body_of, gap_mm
from oracle_shop import (
    ANGLE_DEG,
    FIT,
    GOOD_DRAFT_DEG,
    asked_draft,
    ball_mm,
    cutter_state,
    draft_state,
    edge_deg,
    face_of,
    free_tilt,
    hollow_mm,
    is_milled,
    plate_wall_mm,
    reached_share,
    relief_of,
    relief_state,
    slack_mm,
    tilt_state,
    wall_state,
)

FREE_TILT_DEG = 0.1  # the highest undercut place is read at the nodes


def wall_record(case, wall, thickness):
    """Of a wall: its two ends are on the exact faces, as far apart as it is thick."""
    body = body_of(case)
    ends = np.array([wall["cavity_point_mm"], wall["envelope_point_mm"]])
    for end, parts in zip(ends, (body.cavity, body.envelope), strict=True):
        away = np.linalg.norm(end)
        assert min(abs(part.exact(end[None] / away)[0][0] - away) for part in parts) < 1e-5
    assert abs(np.linalg.norm(ends[0] - ends[1]) - wall["thickness_mm"]) < 1e-5
    return {"thickness_mm": (thickness, slack_mm(case)), "cavity_point_mm": [...] * 3, "envelope_point_mm": [...] * 3}


def face_record(case, name):
    face = face_of(case, name)
    radius, pv, rms, centre = face.sphere
    least = face.kappa
    most = face.highest
    hollow = hollow_mm(case, name)
    hollow = None if hollow[0] is None else hollow
    return {
        "best_fit_sphere": {
            "radius_mm": (radius, 1e-6 * radius), "centre_mm": [0.0, 0.0, (centre, 2e-6 * radius)],
            "pv_mm": (pv, 1e-4 * pv + 1e-6), "rms_mm": (rms, 1e-4 * rms + 1e-6),
        },
        "curvature": {"kappa_min_per_mm": (least, 1e-4), "kappa_max_per_mm": (most, 1e-4),
                      "smallest_concave_radius_mm": hollow},
        "cutter": turning.cutter_record(case, name) if turning.is_turned(case, name) else mill_record(case, name),
        "layer_step_um": None,
        "draft_deg": {"min": (face.draft_deg, 0.003)},
        "undercut_fraction": (facing_wrong(case, name), 5e-3),
        "largest_tilt_deg": (max(0, -face.draft_deg), 0.003),
        "free_tilt_deg": (free_tilt(case, name), FREE_TILT_DEG) if is_milled(case, name) else None,
        "area_mm2": (face.scale**2 * face.part.area[2].sum(), 2e-6 * face.scale**2 * face.part.area[2].sum()),
    }  # fmt: skip


def mill_record(case, name):
    (reached, within) = reached_share(case, name)
    ball = ball_mm(case, name)
    largest = None if ball[0] is None else ball
    left = 0.0 if reached == 1 else ...
    return {"radius_mm": face_of(case, name).cutter, "reachable_fraction": (reached, within),
            "largest_radius_mm": largest, "residual_mm": left}  # fmt: skip


def facing_wrong(case, name):
    """Share of the area that faces away from the half that makes it."""
    face = face_of(case, name)
    _, n, areas = face.part.area
    under = np.where(face.draft_deg < -ANGLE_DEG, face.sense * n[:, 2] < -2e-5, False)
    return areas[under].sum() / areas.sum()


def mould_record(case, names):
    faces = {}
    for name in names:
        upper, lower, heights, draft_deg = half(case, name)
        hidden = {"undercut_heights_mm": [(height, 0.25) for height in heights] if heights else None}
        shares = {"upper_fraction": upper, "lower_fraction": lower, "undercut_fraction": 1 - upper - lower}
        shares = {key: (share, 0.015) for key, share in shares.items()}
        faces[name] = {**shares, "draft_deg": (draft_deg, 0.02), **hidden}
    line = parting(case)
    diameter = ball(case)
    seconds = cooling_s(case)
    return {
        "faces": faces, "parting": {key: list(value) if key == "places" else value for key, value in line.items()},
        "thickest": {"diameter_mm": (diameter, 4e-3 * diameter), "centre_mm": [...] * 3},
        "upright": [], "gate": "plate" if case.lens["spec"]["plate"] else "base",
        "cooling_s": None if seconds is None else (seconds, 1e-2 * seconds),
    }  # fmt: skip


def least_draft(case, name):
    """Draft (degrees) below which a face is too steep: what is asked of it, and for a mill what its axis tilts."""
    asked = [asked_draft(case, name)]
    if not is_moulded(case) and not turning.is_turned(case, name):
        asked.append(-free_tilt(case, name))
    return max((draft for draft in asked if draft is not None), default=-90.0)


def is_faulty(case, name, stored):
    """True of a face that is too steep, undercut, beside a base in the way, or out of its tool's reach."""
    steep = face_of(case, name).draft_deg < least_draft(case, name) - ANGLE_DEG
    hidden = is_moulded(case) and half(case, name)[2] is not None
    if turning.is_turned(case, name):
        return steep or hidden or stored[name]["cutter"]["reachable_fraction"] < 1
    return steep or hidden or relief_fails(case, name) or cutter_state(case, name) == "fail"


def relief_fails(case, name):
    based = case.lens["spec"]["base"]["kind"] != "none" and not is_moulded(case)
    return based and relief_state(case, name) == "fail"


def faults_record(case, name, stored):
    """Worst places of a face that cannot be made: each is on the exact face, the steepest within a sample of that."""
    part = face_of(case, name).part
    turned = turning.is_turned(case, name)
    hidden = is_moulded(case) and half(case, name)[2] is not None
    keys = {"tilt", "draft", *(("nose", "turning", "corner") if turned else ("cutter",))}
    keys |= {"relief"} if not turned and relief_fails(case, name) else set()
    keys |= {"undercut"} if hidden else set()
    places = next(fault["places_mm"] for fault in stored["faults"] if fault["face"] == name)
    drafts = {}
    for key, place in places.items():
        away = np.linalg.norm(place)
        radius, normal = part.exact(np.array(place)[None] / away)
        assert abs(radius[0] - away) < 2e-5, (name, key)
        drafts[key] = np.degrees(np.arcsin(np.clip(face_of(case, name).sense * normal[0, 2], -1, 1)))
    assert abs(drafts["tilt"] - face_of(case, name).draft_deg) < 1.5, name
    least = half(case, name)[3] if is_moulded(case) else face_of(case, name).draft_deg
    assert abs(abs(drafts["draft"]) - abs(least)) < 1.5, name
    if hidden:
        low, high = half(case, name)[2]
        assert low - 0.25 <= places["undercut"][2] <= high + 0.25, name
    return {"face": name, "places_mm": {key: [...] * 3 for key in keys}}


def judged(name, value, sense, limit, unit, tolerance, **more):
    """A criterion or a finding; a limit or a value may have a tolerance of its own."""
    tolerance = tolerance if isinstance(tolerance, tuple) else (tolerance, 1e-9)
    return {"value": value, "sense": sense, "limit": limit, "unit": unit, "tolerance": tolerance, "name": name,
            "remedy": ..., **more}  # fmt: skip


def check_record(case):
    spec = case.lens["spec"]
    body = body_of(case)
    stored = case.json("check")
    limits = spec["constraints"]
    shop = spec["manufacture"]
    slack = slack_mm(case)
    names = [part.name for part in body.parts.values() if part.name not in ("mouth", "flange")]
    names.sort(key=list(case.lens["faces"]).index)
    thin = (body.thinnest, 1e-4)
    thick = body.thickest
    criteria = [judged("thinnest wall", thin, ">=", limits["min_thickness_mm"], "mm", slack, passed=...)]
    if limits["max_wall_mm"] is not None:
        criteria.append(
            judged("largest radial wall", (thick, slack), "<=", limits["max_wall_mm"], "mm", slack, passed=...)
        )
    pairs = [
        (part.name, following.name) for parts in (body.cavity, body.envelope) for part, following in pairwise(parts)
    ]
    edges = [{"faces": list(pair), "angle_deg": (edge_deg(case, *pair), 0.01), "point_mm": [...] * 3} for pair in pairs]
    least_deg = limits["min_edge_angle_deg"]
    if least_deg is not None:
        criteria += [
            judged(f"edge of {one} and {other}", edge["angle_deg"], ">=", least_deg, "deg", ANGLE_DEG, passed=...)
            for (one, other), edge in zip(pairs, edges, strict=True)
        ]  # fmt: skip
    based = spec["base"]["kind"] != "none" and shop["process"] != "moulded"
    note = "a mould insert has no base" if shop["process"] == "moulded" else "there is no base"
    reliefs = {name: {key: (value, 2e-2 * value + 2e-5) for key, value in relief_of(case, name).items()}
            for name in names if based}  # fmt: skip
    faults = [faults_record(case, name, stored) for name in names if is_faulty(case, name, stored)]
    return {
        **({"faults": faults} if faults else {}),
        "process": shop["process"], "scale": (1 + shop["shrinkage"] if shop["process"] == "moulded" else 1.0, 1e-12),
        "min_wall_mm": thin,
        "walls": {"thinnest": wall_record(case, stored["walls"]["thinnest"], thin[0]),
                  "thickest": wall_record(case, stored["walls"]["thickest"], thick)},
        "relief": {"faces": reliefs, "note": None if based else note},
        "edges": edges, "criteria": criteria, "verdicts": list(verdicts(case, names, reliefs, thin)),
        **({"mould": mould_record(case, names)} if is_moulded(case) else {}),
        **{name: face_record(case, name) for name in names},
    }  # fmt: skip


def verdicts(case, names, reliefs, thin):
    """The findings in their order: value, limit and tolerance of each."""
    spec = case.lens["spec"]
    limits = spec["constraints"]
    shop = spec["manufacture"]
    slack = slack_mm(case)
    cut = spec["manufacture"]["process"] != "moulded"

    def verdict(name, surface, value, sense, limit, unit, tolerance, state):
        return judged(name, value, sense, limit, unit, tolerance, surface=surface, reason=..., holds=state == "pass")

    lathe = [name for name in names if turning.is_turned(case, name)]
    milled = [name for name in names if name not in lathe]
    for name in milled:
        ball, within = ball_mm(case, name)
        largest, fit = (None, 0.0) if ball is None else ((ball, within), (FIT * ball, FIT * within + 1e-9))
        yield verdict("cutter", name, shop["cutter_radius_mm"], "<=", largest, "mm", fit, cutter_state(case, name))
    for name, figures in reliefs.items():
        most = max((value for key, value in figures.items() if key.endswith("mm")), key=lambda pair: pair[0])
        yield verdict("relief", name, most, "<=", 0.0, "mm", 0.0, relief_state(case, name))
    for name in milled if cut else ():
        tilted = (max(0, -face_of(case, name).draft_deg), 0.003)
        yield verdict(
            "tilt", name, tilted, "<=", (free_tilt(case, name), FREE_TILT_DEG), "deg", ANGLE_DEG, tilt_state(case, name)
        )
    yield verdict("wall", "body", thin, ">=", limits["min_thickness_mm"], "mm", slack, wall_state(case))
    for name in names if is_moulded(case) else ():
        upper, lower, heights, _ = half(case, name)
        share = (1 - upper - lower, 0.015) if heights else 0.0
        yield verdict("undercut", name, share, "<=", 0.0, "of the face", 0.0, "fail" if heights else "pass")
    for name in names:
        wanted = asked_draft(case, name)
        if cut and wanted is None:
            continue
        least = (half(case, name)[3], 0.02) if is_moulded(case) else (face_of(case, name).draft_deg, 0.003)
        wanted = GOOD_DRAFT_DEG if wanted is None else wanted
        yield verdict("draft", name, least, ">=", wanted, "deg", ANGLE_DEG, draft_state(case, name))
    yield from turning.findings(case, lathe, verdict)
    if spec["plate"] is not None:
        if cut:
            wide = 2 * shop["cutter_radius_mm"]
            gap = (gap_mm(case), 0.004)
            yield verdict("gap", "body", wide, "<=", gap, "mm", slack, "pass" if wide <= gap[0] + slack else "fail")
        least = (plate_wall_mm(case), 1e-4)
        state = "pass" if least[0] >= limits["min_thickness_mm"] - slack else "fail"
        yield verdict("plate", "body", least, ">=", limits["min_thickness_mm"], "mm", slack, state)


RECORDS = {"check": check_record}
