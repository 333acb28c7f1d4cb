"""Every number of ``sensitivity`` by docs/definitions.md, section 15: one error at a time, by the same rays."""

import numpy as np
from crooked import Expected
from oracle_part import kept_of
from page_chain import drawn, facet, keys_of, leave_chain
from page_colour import flux_and_efficacy
from page_figures import CLOSE, apart_of, by_half_samples, error_over_pairs, jackknife, least_parts
from page_light import filtered
from page_scene import faces_of, mask_of, receivers_of, target_light, through
from page_tracer import BACKWARD, LANDED, OUTSIDE_CAVITY, TOTAL, Functions, leave, unit

NEAR = 0.02  # of a standard error
OF_TABLES = 2e-8  # by which faces as tables change a figure, beside which a change by a tolerance may be small
# Faces with tolerances, that against which others are placed first, and those others.
FACES = {"double": (("inner", "outer"), ("outer",)), "tir": (("cap", "side", "wall", "exit"), ("wall", "exit")),
         "reflector": (("cup",), ())}  # fmt: skip


def kinds_of(section):
    """Words by the name of a tolerance, and whether it is to both sides, along x and y, about x and y, or one shape."""
    (first, *_), placed = faces, _ = FACES[section["kind"]]
    kinds = {
        "source_shift_mm": ("source, decentre", "in"), "source_height_mm": ("source, height", "±"),
        "source_tilt_deg": ("source, tilt", "about"), "source_flux": ("source, flux", "±"),
        "source_size": ("source, size", "±"),
    }  # fmt: skip
    for kind, label, way in (("shift_mm", "decentre", "in"), ("gap_mm", "gap", "±"), ("tilt_deg", "tilt", "about")):
        for face in placed:
            name = "gap_mm" if (face, kind) == ("outer", "gap_mm") else f"{face}_{kind}"
            kinds[name] = f"{face} face against {first}, {label}", way
    kinds |= {
        "lens_shift_mm": ("lens against source, decentre", "in"),
        "lens_height_mm": ("lens against source, height", "±"),
        "lens_tilt_deg": ("lens against source, tilt", "about"),
    }  # fmt: skip
    if section["kind"] != "reflector":
        kinds |= {"index": ("refractive index", "±"), "shrinkage": ("shrinkage", "±")}
    shapes = ("roughness", "mrad"), ("ripple", "um"), ("form", "um"), ("waviness", "um")
    return kinds | {f"{face}_{kind}_{unit}": (f"{kind}, {face} face", "") for kind, unit in shapes for face in faces}


STILL = np.eye(3), np.zeros(3)
ROUGH = (
    "roughness_mrad",
    "ripple_um",
    "waviness_um",
)  # which turn normals: here rings and waves are too fine for tables
UNITS = {"mm": 1.0, "deg": np.pi / 180, "um": 1e-3, "mrad": 1e-3}


def rows_of(case):
    """Name, amount, unit and tolerance with its numbers (mm, rad or 1) of every row."""
    for name, (label, way) in kinds_of(case.lens["spec"]["lens"]).items():
        unit = name.rpartition("_")[2] if name.rpartition("_")[2] in UNITS else ""
        amount = amount_of(case.lens["spec"], name)
        factor = UNITS.get(unit, 1.0)
        if way == "±":
            for sign in (1.0, -1.0):
                yield label, sign * amount, unit, name, sign * amount * factor
        elif way:
            for axis, along in (("x", [1.0, 0.0]), ("y", [0.0, 1.0])):
                yield f"{label} {way} {axis}", amount, unit, name, amount * factor * np.array(along)
        else:
            yield label, amount, unit, name, amount * factor


def amount_of(spec, name):
    """As the spec has it: of a face in its own table."""
    face = face_of(spec["lens"], name)
    field = name
    table = spec["tolerances"] if face is None else spec["lens"][face]
    return table[field if face is None else field.removeprefix(f"{face}_")]["amount"]


def face_of(section, name):
    """The face of a tolerance; None for one of the lens or the source."""
    faces = [face for face in FACES[section["kind"]][0] if name.startswith(f"{face}_")]
    return faces[0] if faces else "outer" if name == "gap_mm" else None


def turn_by(x, y):
    """The rotation by a vector (rad) across z."""
    angle = np.hypot(x, y)
    cross = np.array([[0, 0, y], [0, 0, -x], [-y, x, 0]]) / (angle or 1.0)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


class Moved:
    """A face turned about the origin, then shifted."""

    def __init__(self, face, turn, shift):
        self.face = face
        self.turn = turn
        self.shift = np.array(shift)
        self.largest = face.largest + 1.0

    def to_local(self, p):
        return (p - self.shift) @ self.turn

    def radius(self, u):
        rho = self.face.radius(u)
        for _ in range(8):
            q = self.to_local(rho[:, None] * u)
            rho = rho + self.face.radius(unit(q)) - np.linalg.norm(q, axis=1)
        return rho

    def normal(self, u):
        return self.face.normal(unit(self.to_local(self.radius(u)[:, None] * u))) @ self.turn.T


class Bent:
    """A face with an error e(u) along its normal; normals by differences."""

    def __init__(self, face, error):
        self.face = face
        self.error = error
        self.largest = face.largest + 1.0

    def radius(self, u):
        return self.face.radius(u) + self.error(u) / (self.face.normal(u) * u).sum(axis=1)

    def normal(self, u):
        rho = self.radius(u)
        slope = np.zeros_like(u)
        h = 1e-5
        for e in np.eye(3):
            t = e - (u @ e)[:, None] * u
            slope += ((self.radius(unit(u + h * t)) - self.radius(unit(u - h * t))) / (2 * h))[:, None] * e
        return unit(u - (slope - (slope * u).sum(axis=1)[:, None] * u) / rho[:, None])


class Rough:
    """A face with facets of this rms slope and noise, those that the rays meet which come to it."""

    def __init__(self, face, rms, noise):
        self.face = face
        self.rms = rms
        self.slopes = rms * noise
        self.radius = face.radius
        self.largest = face.largest

    def seen(self, u, d):
        return facet(self.face.normal(u), d, self.slopes, self.rms)


class BentFace:
    """A face of a chain with an error e(u, rho, n) along its normal; it counts near the face alone."""

    def __init__(self, face, error):
        self.face = face
        self.error = error
        self.name = face.name
        self.reach = face.reach + 1.0
        self.before = face.before
        self.behind = face.behind

    def radius(self, u):
        rho, n = self.face.exact(u)
        return rho + self.error(u, rho, n) / (n * u).sum(axis=1)

    def exact(self, u):
        return self.radius(u), Bent.normal(self, u)

    def room(self, u, far):
        room = self.face.room(u, far)
        near = abs(room) < 1.0
        room[near] = self.radius(u[near]) - far[near]
        return room


def displaced(name, value):
    """Error along the normal of a face of a chain that is out of its place: (s + w x p) . n."""
    x, y = value if np.ndim(value) else (0.0, 0.0)
    if name.endswith("tilt_deg"):
        return lambda u, rho, n: (np.cross([x, y, 0.0], rho[:, None] * u) * n).sum(axis=1)
    shift = np.array([x, y, 0.0] if name.endswith("shift_mm") else [0.0, 0.0, value])
    return lambda u, rho, n: n @ shift


def hemisphere(count):
    j = np.arange(count)
    z = 1 - (j + 0.5) / count
    phi = j * np.pi * (3 - np.sqrt(5))
    return np.column_stack([np.sqrt(1 - z**2) * np.cos(phi), np.sqrt(1 - z**2) * np.sin(phi), z])


def shape_of(name, amount, covers=lambda u: np.full(len(u), True)):
    """The one shape of a form error: nine broad functions with numbers from the name of the tolerance.

    ``own``: directions in which the face bounds its medium.
    """
    numbers = np.random.default_rng([11, *name.encode()]).standard_normal(9)
    functions = Functions({"levels": [9], "sigma_c": 1.75, "symmetry": "none"}, numbers)
    u = hemisphere(4000)
    rms = np.sqrt((functions.mean(u[covers(u)])[0] ** 2).mean())
    return lambda u: amount * functions.mean(u)[0] / rms


def fine_slope(spec, name, amount):
    """Rms slope of what is too fine for tables: rings, or waves of all widths alike by their logarithm."""
    tolerances = spec["tolerances"]
    if "ripple" in name:
        return amount * np.pi / 2 / tolerances["ripple_period_mm"]
    longest = tolerances["waviness_longest_mm"]
    shortest = tolerances["waviness_shortest_mm"]
    widths = np.sqrt(2) / (2 * np.pi) * longest * (shortest / longest) ** ((np.arange(384) + 0.5) / 384)
    return amount * np.sqrt((1 / widths**2).mean())


def light_with(case, led, name="", value=None):
    """Pictures (W) of each replicate on the first receiver, and shares in its window, with one error and one LED."""
    spec = case.lens["spec"]
    source = spec["sources"][led]["source"] if spec["sources"] else spec["source"]
    receiver = receivers_of(spec)[0]
    lens_at = STILL
    source_at = STILL
    scale = 1.0
    size = 1.0
    section = spec["lens"]
    if name == "index":
        section = section | {"refractive_index": section["refractive_index"] + value}
    elif name == "shrinkage":
        scale = 1 + value  # of the way in the body, too
        section = section | {"absorption_per_mm": section["absorption_per_mm"] * scale}
    elif name == "source_size":
        size = 1 + value
    elif name.startswith("source_") and name != "source_flux":
        source_at = motion(name, value)
    elif name.startswith("lens_"):
        lens_at = motion(name, value)
    (turn, shift) = lens_at
    up = np.array([0, 0, (spec["base"]["height_mm"] or 0.0) * (scale - 1)])
    number, p, d, flux, nm = rays_of(case, led)
    noise = noise_of(d, 2 * len(case.lens["faces"]))
    keys = keys_of(p, d)
    p = source["position_mm"] + size * (p - source["position_mm"]) @ source_at[0].T + source_at[1]
    d = d @ source_at[0].T
    local = ((p - shift) @ turn - up) / scale, d @ turn
    behind = behind_double if section["kind"] == "double" else behind_chain
    left, p, d, share, nm, (q, u, s) = behind(case, section, local, nm, (noise, keys), name, value)
    p = (scale * p + up) @ turn.T + shift
    d = d @ turn.T
    stokes = (q, u, s @ turn.T)
    for body in spec["bodies"]:
        left, stokes, _ = through(body, spec["lens"], left, p, d, share, nm, stokes)
    at = receiver.land(p[left], d[left])
    flux = (share * flux)[left]
    number = number[left]
    seen = receiver.in_window(*at.T)
    images = []
    window = []
    for k in range(16):
        images.append(filtered(receiver.bins(at[number == k], flux[number == k]), spec["evaluate"]["filter_variance"]))
        window.append(flux[seen & (number == k)].sum() / flux_and_efficacy(source, case.files)[0])
    return np.array(images), np.array(window)


def behind_double(case, section, local, nm, numbers, name, value):
    """Rays behind a lens of two faces with one error: numbers of those that leave it, places, directions, shares."""
    faces = list(faces_of(case.lens, case.lens["faces"]))
    k = int(name.startswith("outer"))
    if name.endswith("form_um"):
        faces[k] = Bent(faces[k], shape_of(name, value))
    elif name.startswith(("outer_shift", "outer_tilt", "gap_")):
        faces[1] = Moved(faces[1], *motion(name, value))
    elif name.endswith(ROUGH):
        fate = leave({"spec": {"lens": section}}, faces, *local, nm)[3]
        rows = (fate == LANDED) | (fate == TOTAL) if k else (fate != BACKWARD) & (fate != OUTSIDE_CAVITY)
        faces[k] = Rough(faces[k], slope_of(case, name, value), numbers[0][rows, 2 * k : 2 * k + 2])
    left, p, d, _, share, _, nm, stokes = leave({"spec": {"lens": section}}, faces, *local, nm)
    return left, p, d, share, nm, stokes


def behind_chain(case, section, local, nm, numbers, name, value):
    """As :func:`behind_double`, of a lens of more faces, which a ray may meet again; each begins with a key."""
    faces = list(faces_of(case.lens, case.lens["faces"]))
    turns = {}
    face = next((face for face in faces if face.name == face_of(section, name)), None)
    if face is not None and name.endswith(ROUGH):
        number = [face.name for face in faces].index(face.name)
        noise, keys = numbers
        slopes = [noise[:, 2 * number : 2 * number + 2]]
        for times in range(1, section["events"]):
            radial, azimuthal = drawn(keys, 256 * times + number)
            length = np.sqrt(-2 * np.log(1 - radial))
            turn = 2 * np.pi * azimuthal
            slopes.append(length[:, None] * np.column_stack([np.cos(turn), np.sin(turn)]))
        slopes = np.stack(slopes, axis=1)
        rms = slope_of(case, name, value)
        turns = {face.name: (rms * slopes, rms)}
    elif face is not None:
        beside = [neighbour for neighbour in faces if neighbour.before == face.before]

        def nearest(u):
            return np.argmin([neighbour.exact(u)[0] for neighbour in beside], axis=0) == beside.index(face)

        form = shape_of(name, value, nearest) if name.endswith("form_um") else None
        error = displaced(name, value) if form is None else lambda u, rho, n: form(u)
        faces[faces.index(face)] = BentFace(face, error)
    left, p, d, _, share, _, nm, stokes, _ = leave_chain({"spec": {"lens": section}}, faces, *local, nm, turns)
    return left, p, d, share, nm, stokes


def slope_of(case, name, value):
    return value if "roughness" in name else fine_slope(case.lens["spec"], name, value)


def rays_of(case, led):
    """Number of the replicate, position, direction, flux (W) and wavelength of every ray of an LED."""
    calls = case.rays["sensitivity"][led]
    parts = [(np.full(len(p), k), p, d, factor * flux) for k, factor, p, d, flux, _ in calls]
    return *(np.concatenate([part[k] for part in parts]) for k in range(4)), None


def noise_of(d, width):
    """Numbers by which normals are turned at each face: lensforge's, which has its rays in order of direction."""
    order = np.lexsort((d[:, 1], np.floor(32 * d[:, 0])))
    noise = np.empty((len(d), width))
    noise[order] = np.random.default_rng(2029).standard_normal((len(d), width))
    return noise


def motion(name, value):
    """Turn and shift of an error of place."""
    if name.endswith("tilt_deg"):
        return turn_by(*value), np.zeros(3)
    return np.eye(3), np.array([*value, 0.0] if name.endswith("shift_mm") else [0.0, 0.0, value])


# -- Figures and their changes -----------------------------------------------------------------------------------------


def figures(case, images, window):
    """What the changes are made of: value and its pairs of each figure by pairs, least and its parts, shares."""
    receiver = receivers_of(case.lens["spec"])[0]
    target = target_light(receiver)[0]
    mask = mask_of(receiver)
    scales = images.sum(axis=(1, 2))
    errors = images - scales[:, None, None] * target / target.sum()
    nmse = apart_of(errors, scales * np.sqrt((target**2).sum()) / target.sum())
    if mask is None:
        return {"nmse": nmse, "efficiency": window}
    inside = images[:, mask]
    means = inside.mean(axis=1)
    square, apart = apart_of((inside - means[:, None]) / np.sqrt(inside.shape[1]), means)
    value = np.sqrt(max(square, 0))
    slopes = apart / (2 * max(value, np.sqrt(error_over_pairs(apart)) or 1.0))
    least = least_parts(inside / means[:, None], 1.0)
    return {"nmse": nmse, "rsd": (value, slopes), "uniformity": least, "efficiency": window}


def metrics_of(readings):
    """Value and standard error of each."""
    pairs = {
        name: (readings[name][0], error_over_pairs(readings[name][1])) for name in ("nmse", "rsd") if name in readings
    }
    if "uniformity" in readings:
        value, by_halves, unsure = readings["uniformity"]
        pairs["uniformity"] = value, np.hypot(by_half_samples(by_halves), unsure)
    return pairs | {"efficiency": jackknife(readings["efficiency"])}


def change_of(after, before):
    """The difference of each figure, with the error of what the noise of both has not in common; rounding is none."""
    changes = difference_of(after, before)
    rounding = {name for name, figure in changes.items() if max(map(abs, figure)) <= 1e-11}
    return {name: (0.0,) * len(figure) if name in rounding else figure for name, figure in changes.items()}


def difference_of(after, before):
    changes = {}
    for name in [name for name in ("nmse", "rsd") if name in after]:
        (value, apart) = after[name]
        (other, others) = before[name]
        changes[name] = value - other, error_over_pairs(apart - others)
    changes["efficiency"] = jackknife(after["efficiency"] - before["efficiency"])
    if "uniformity" not in after:
        return changes
    value, by_halves, unsure = after["uniformity"]
    before_value, before_by_halves, before_unsure = before["uniformity"]
    error = np.hypot(by_half_samples(by_halves - before_by_halves), unsure - before_unsure)
    return changes | {"uniformity": (value - before_value, error)}


def study(case, led):
    """Figures as designed with one LED, and those and their changes of every row."""
    before = figures(case, *light_with(case, led))
    rows = []
    for *labels, name, value in rows_of(case):
        readings = figures(case, *light_with(case, led, name, value))
        rows.append((labels, metrics_of(readings), change_of(readings, before)))
    return metrics_of(before), rows


def of_case(case):
    """Of each LED."""
    return kept_of(case, "sensitivity", lambda: [study(case, led) for led in range(len(names_of(case)))])


def names_of(case):
    return [source["name"] for source in case.lens["spec"]["sources"]] or [""]


def within(figure):
    """Value and error, each with how near; what tables change in an error is spread over fifteen pairs of halves."""
    value, error = figure
    return (value, NEAR * error + CLOSE * abs(value) + OF_TABLES), (error, NEAR * error + OF_TABLES / np.sqrt(15))


def metrics_record(metrics):
    pairs = {name: within(figure) for name, figure in metrics.items()}
    none = {"uniformity": None, "rsd": None}  # without a region of uniform light
    return none | {
        name: {"value": value, "unit": "", "standard_error": error} for name, (value, error) in pairs.items()
    }


def sensitivity_record(case):
    first, *others = [led_record(case, led) for led in range(len(names_of(case)))]
    return first | {"others": others} if others else first


def led_record(case, led):
    before, rows = of_case(case)[led]
    led_name = {"led": names_of(case)[led]} if names_of(case)[led] else {}
    return led_name | {
        "conditions": None, "preset": case.lens["spec"]["tolerances"]["preset"],
        "nominal": metrics_record(before), "rays": len(rays_of(case, led)[0]),
        "rows": [{"name": name, "amount": amount, "unit": unit, "metrics": metrics_record(metrics),
                  "change": metrics_record(change), "limits": []} for (name, amount, unit), metrics, change in rows],
    }  # fmt: skip


def fact(key):
    """As designed with each LED, and of its rows in the order of what they do to the NMSE."""
    factor, unit = (100.0, "%") if key == "efficiency" else (1.0, "")

    def oracle(case, place):
        as_designed = place.title.startswith("As designed")
        readings = of_case(case)[place.group][0] if as_designed else row_of(case, place)[2]
        (value, near), (error, near_error) = within(readings[key])
        return Expected(factor * value, factor * near, unit, factor * error, factor * near_error)

    return oracle


def ordered(rows):
    return sorted(rows, key=lambda row: -abs(row[2]["nmse"][0]))


def row_of(case, place):
    """The row of a group: all rows of the first LED come first, then those of the next."""
    every = of_case(case)
    led, number = divmod(place.group, len(every[0][1]))
    (name, *labels), *readings = ordered(every[led][1])[number]
    end = f", {names_of(case)[led]}" if names_of(case)[led] else ""
    return (f"{name}{end}", *labels), *readings


def amount(case, place):
    """The flux changes no figure: which of its ends comes first is a matter of rounding."""
    name, value, unit = row_of(case, place)[0]
    if place.title != name:
        return Expected(f"that of {name}")
    return Expected(
        value, 2 * abs(value) if name.startswith("source, flux") else 1e-9, {"deg": "°", "um": "µm"}.get(unit, unit)
    )


ORACLES = {f"sensitivity.{key}": fact(key) for key in ("nmse", "uniformity", "rsd", "efficiency")} | {
    "sensitivity.amount": amount, "sensitivity.rays": lambda case, place: Expected(len(rays_of(case, place.group)[0])),
}  # fmt: skip
RECORDS = {"sensitivity": sensitivity_record}
