"""What a turning tool reaches of a face of revolution by docs/definitions.md, section 13, ray by ray."""

from functools import cached_property

import numpy as np
from crooked import Expected
from oracle_part import kept_of
from oracle_shop import ANGLE_DEG, FIT, NEARLY_FLAT_MM, answer, face_of, in_file, of_face, on_face

RUB_MM = 1e-4


def is_turned(case, name):
    """True of a face of revolution that is moulded, and of all faces of a lens that is turned."""
    spec = case.lens["spec"]
    lens = spec["lens"]
    process = spec["manufacture"]["process"]
    fixed = lens[name]["fixed"] if name in lens else None
    stays = lens["kind"] == "tir" and name == "side" and not fixed
    round_one = stays or (lens["kind"] != "double" and not lens["levels"] and not fixed)
    return process == "turned" or (process == "moulded" and round_one)


class TurnedFace:
    """One meridian of a face, and the tool at the tilt from which its normals are farthest by the least."""

    def __init__(self, case, name):
        face = face_of(case, name)
        shop = case.lens["spec"]["manufacture"]
        self.face = face
        self.nose = shop["nose_radius_mm"]
        self.shank = shop["shank_width_mm"]
        self.flank_deg = shop["included_angle_deg"] / 2 + shop["clearance_deg"]
        self.up = face.sense * face.air
        p, n, _ = face.part.at(np.linspace(0, 1, 401), np.zeros(401))
        self.p = face.scale * p[:, ::2]
        self.n = face.air * n[:, ::2]
        rest = [
            face.scale * neighbour.at(np.linspace(0, 1, 401), np.zeros(401))[0][:, ::2] for neighbour in face.beside
        ]
        self.beside = np.concatenate([np.empty((0, 2)), *rest])
        slopes = np.degrees(np.arctan2(self.n[:, 0], self.up * self.n[:, 1]))
        most = shop["max_tilt_deg"]
        self.tilt_deg = np.clip((slopes.min() + slopes.max()) / 2, -most, most)
        self.slope_deg = np.abs(slopes - self.tilt_deg).max()

    @cached_property
    def reaches_all(self):
        """True where no point of the half of the mould is within a nose of a ray of the tool, at 41 contacts."""
        turn = np.radians(self.tilt_deg + np.linspace(-self.flank_deg, self.flank_deg, 721))
        rays = np.column_stack([np.sin(turn), self.up * np.cos(turn)])
        work = np.concatenate([points * side for points in (self.p, self.beside) for side in ((1, 1), (-1, 1))])
        for place, normal in zip(self.p[::10], self.n[::10], strict=True):
            away = work - (place + self.nose * normal)
            along = np.maximum(away @ rays.T, 0)
            apart = np.sqrt(((away[:, None] - along[:, :, None] * rays) ** 2).sum(axis=-1)).min(axis=1)
            if (apart < self.nose - RUB_MM).any():
                return False
        return True


def turned(case, name):
    return kept_of(case, f"turned {name}", lambda: TurnedFace(case, name))


def largest_mm(case, name):
    """Radius of the tightest hollow of the meridian; if that is straight, of its spline."""
    profile = turned(case, name)
    step = np.gradient(profile.p, axis=0)
    bend = np.gradient(step, axis=0)
    way = np.hypot(*step.T)
    kappa = -(bend * profile.n).sum(axis=1)[2:-2] / way[2:-2] ** 2
    if kappa.min() > -1 / NEARLY_FLAT_MM:
        return in_file(case, name, "cutter", "largest_radius_mm"), 0.0
    return -1 / kappa.min(), 1e-3 / -kappa.min()


def cutter_record(case, name):
    """The record of the tool; where it does not reach all at the middle tilt, its best is not sought here."""
    profile = turned(case, name)
    whole = turned(case, name).reaches_all
    share = 1.0 if whole else ...
    return {
        "radius_mm": profile.nose, "largest_radius_mm": largest_mm(case, name), "reachable_fraction": share,
        "bare_fraction": share, "residual_mm": 0.0 if whole else ..., "corner_fraction": 0.0 if whole else ...,
        "slope_deg": (profile.slope_deg, 1e-3), "tilt_deg": (profile.tilt_deg, 1e-3) if whole else ...,
    }  # fmt: skip


def states(case, name):
    """Whether the nose fits, the flanks clear, and the tool reaches all; the limits of the first two."""
    profile = turned(case, name)
    (largest, within) = largest_mm(case, name)
    fits = largest is None or profile.nose <= largest * (1 + FIT)
    return {
        "nose": (profile.nose, None if largest is None else (largest, within), fits),
        "slope": (
            (profile.slope_deg, 1e-3),
            90 - profile.flank_deg,
            profile.slope_deg <= 90 - profile.flank_deg + ANGLE_DEG,
        ),
        "turning": (1.0, 1.0, profile.reaches_all),
    }


def findings(case, names, verdict):
    """The findings on turned faces, in their order."""
    for name in names:
        by_name = states(case, name)
        (nose, largest, fits), (slope, most, clears), (share, whole, reached) = by_name.values()
        fit = 0.0 if largest is None else (FIT * largest[0], FIT * largest[1] + 1e-9)
        yield verdict("nose", name, nose, "<=", largest, "mm", fit, "pass" if fits else "fail")
        yield verdict("slope", name, slope, "<=", most, "deg", ANGLE_DEG, "pass" if clears else "fail")
        yield verdict("turning", name, share, ">=", whole, "of the face", 1e-9, "pass" if reached else "fail")


def reached(case, name):
    assert turned(case, name).reaches_all
    return Expected(100.0, 1e-7, "%")


def nose(case, name):
    largest, within = largest_mm(case, name)
    _, _, fits = states(case, name)["nose"]
    limit = (">=", turned(case, name).nose)
    return Expected("any" if largest is None else largest, within, "mm", limit=limit, state="pass" if fits else "fail")


def slope(case, name):
    (value, within), most, clears = states(case, name)["slope"]
    return Expected(value, within, "°", limit=("<=", most), state="pass" if clears else "fail")


def lathe_tilt(case, name):
    return Expected(turned(case, name).tilt_deg, 1e-3, "°")


def corner(case, name):
    assert turned(case, name).reaches_all
    return Expected(0.0, 1e-9, "%")


def finding(key):
    return lambda case, place: answer("pass" if states(case, on_face(place))[key][2] else "fail")


ORACLES = {
    f"check.{name}_{figure.__name__}": of_face(figure, name)
    for name in ("side",)  # of the crooked designs
    for figure in (reached, nose, slope, lathe_tilt, corner)
} | {f"check.{key}": finding(key) for key in ("nose", "slope", "turning")}
