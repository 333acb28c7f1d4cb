"""Every number of ``compare --points`` and ``correct`` by docs/definitions.md, sections 17 and 18, from the points."""

from hashlib import sha256

import numpy as np
from crooked import Expected
from oracle_part import kept_of
from oracle_proof import arrays
from oracle_shop import hollow_mm
from oracle_study import Bent, change_of, figures, hemisphere, metrics_of, metrics_record
from page_body import Part
from page_chain import from_chart
from page_colour import flux_and_efficacy
from page_light import filtered
from page_scene import exits, faces_of, receivers_of
from page_step import spline_faces
from page_tracer import unit
from scipy import sparse
from scipy.interpolate import BSpline
from scipy.optimize import least_squares, nnls
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

FACE = "inner"
NODES_PER_WAVE = 4.0
WIDEST = np.tan(np.radians(56))
FADE = 1e-3
RIM = 1.02
NEAR = 0.03  # of figures of the filter
NOISY = 0.15  # of what noise drawn anew decides
# Of a standard error: one of 1024 rays that a shape 0.2 % off moves over the edge of a pixel makes a twelfth.
BY_TWO_RAYS = 0.2
FIGURES = ("nmse", "uniformity", "rsd", "efficiency")


class Filter:
    """The smoothest deviation near the points: sum a c^2 (d - s)^2 + (w/2 pi)^4 integral of bending + 0.001 of s^2."""

    def __init__(self, face, u, wavelength_mm):
        self.rho = face.exact(u)[0]
        self.c = (face.exact(u)[1] * u).sum(axis=1)
        largest = face.exact(hemisphere(2000))[0].max()
        count = int(np.ceil(NODES_PER_WAVE * 4 * np.arctan(WIDEST) * largest / wavelength_mm))
        breaks = np.tan(np.linspace(-1, 1, count + 1) * np.arctan(WIDEST))
        self.knots = np.concatenate([[-WIDEST] * 3, breaks, [WIDEST] * 3])
        places = ((breaks[1:] + breaks[:-1]) / 2 + np.array([[-1], [1]]) * np.diff(breaks) / 2 / np.sqrt(3)).T.ravel()
        weights = np.repeat(np.diff(breaks) / 2, 2)
        at = from_chart(*(coordinates.ravel() for coordinates in np.meshgrid(places, places, indexing="ij")))
        m = face.exact(at)[0] * (1 + at[:, 2])  # mm for a unit of the chart
        area = np.outer(weights, weights).ravel() * m**2
        by = [sparse.csr_array(BSpline(self.knots, np.eye(count + 3), 3)(places, nu=order)) for order in range(3)]
        matrix = FADE * self.square(sparse.kron(by[0], by[0]), area)
        for i, j, times in ((2, 0, 1), (1, 1, 2), (0, 2, 1)):
            matrix += times * (wavelength_mm / 2 / np.pi) ** 4 * self.square(sparse.kron(by[i], by[j]), area / m**4)
        self.values = self.rows(u)
        self.weights = areas(face, u) * self.c**2
        self.solver = splu((matrix + self.square(self.values, self.weights)).tocsc())

    @staticmethod
    def square(rows, weights):
        return (rows.T @ sparse.diags_array(weights) @ rows).tocsc()

    def basis(self, u):
        places = np.clip(u[:, :2].T / (1 + u[:, 2]), -WIDEST, WIDEST)
        return [BSpline(self.knots, np.eye(len(self.knots) - 4), 3)(place) for place in places]

    def rows(self, u):
        return sparse.csr_array(np.einsum("ni,nj->nij", *self.basis(u)).reshape(len(u), -1))

    def at(self, u, control):
        along, across = self.basis(u)
        return ((along @ control.reshape(along.shape[1], -1)) * across).sum(axis=1)

    def through(self, d):
        """Coefficients of what passes of radial deviations."""
        return self.solver.solve(self.values.T @ (self.weights * d.T).T)

    def passed(self, d):
        return self.values @ self.through(d)

    def mean_square(self, values):
        return (self.weights * values**2).sum() / (self.weights / self.c**2).sum()


def areas(face, u):
    """Area (mm^2) of each point: cells of a Fibonacci pattern, shared by the points in them."""
    cells = hemisphere(max(1, len(u) // 16))
    cell = cKDTree(cells).query(u)[1]
    n = face.exact(u)[1]
    area = 2 * np.pi / len(cells) * face.exact(cells)[0] ** 2 / np.maximum(np.bincount(cell, minlength=len(cells)), 1)
    return area[cell] / (n * u).sum(axis=1)


class Measured:
    """Points of one face, registered to it, and their deviations through filters of several wavelengths."""

    def __init__(self, case, registration):
        self.face = faces_of(case.lens, case.lens["faces"])[0]
        cloud = np.loadtxt(case.folder / f"points_{registration}.csv", delimiter=",")
        over = self.over(cloud)

        def placed(motion):
            return Rotation.from_rotvec(motion[:3]).apply(cloud) + motion[3:]

        self.motion = np.zeros(6)
        for _ in range(3 if registration == "rigid" else 0):
            self.motion = least_squares(lambda m, used=over: self.distance(placed(m)[used]), self.motion, xtol=1e-14).x
            over = self.over(placed(self.motion))
        self.count = len(cloud)
        self.points = placed(self.motion)[over]
        self.used = over.mean()
        self.u = unit(self.points)
        self.d = np.linalg.norm(self.points, axis=1) - self.face.exact(self.u)[0]
        self.radius = self.face.exact(hemisphere(2000))[0].max()

    @staticmethod
    def over(p):
        u = unit(p)
        return (u[:, :2] ** 2).sum(axis=1) <= (RIM * (1 + u[:, 2])) ** 2

    def distance(self, p):
        u = unit(p)
        rho, n = self.face.exact(u)
        return (np.linalg.norm(p, axis=1) - rho) * (n * u).sum(axis=1)

    def spacing(self):
        """Twice the distance to the nearest point that three quarters of the face's area do not exceed."""
        at = hemisphere(5000)
        rho = self.face.exact(at)[0]
        away = cKDTree(self.u).query(at)[0] * rho
        order = np.argsort(away)
        share = np.cumsum(rho[order] ** 2) / (rho**2).sum()
        return 2 * away[order][np.searchsorted(share, 0.75)]

    def covered(self, spacing):
        away = cKDTree(self.u).query(hemisphere(2000))[0]
        return (away <= 2 * np.sin(spacing / self.radius)).mean()

    def settle(self, spacing):
        """The noise by the finest filter, and the longest wavelength at which no more than noise is left out."""
        shortest = max(3 * spacing, 3 * self.radius * 4 * np.arctan(WIDEST) / 160)
        steps = 1 + int(np.floor(np.log(self.radius / shortest) / np.log(np.sqrt(2))))
        tried = [Filter(self.face, self.u, shortest * np.sqrt(2) ** k) for k in range(steps)]
        scores = []
        for k, trial in enumerate(tried):
            left = np.eye(len(self.u)) - trial.passed(np.eye(len(self.u)))
            square = trial.mean_square(self.d - trial.passed(self.d))
            scores.append(square / (np.trace(left) / len(self.u)) ** 2)
            if k == 0:
                noise = (trial.weights[:, None] * (left / trial.c) ** 2).sum() / (trial.weights / trial.c**2).sum()
                self.noise = np.sqrt(square / noise)
        allowed = min(scores) * (1 + np.sqrt(2 / len(self.u)))
        self.wavelength, self.form = max(
            (shortest * np.sqrt(2) ** k, tried[k]) for k in range(steps) if scores[k] <= allowed
        )


def map_of(measured, form, control):
    """Of a change over the chart, along the normal (um), and areas (mm^2); nan beyond the rim."""
    axis = np.linspace(-1, 1, 201)
    x, y = (coordinates.ravel() for coordinates in np.meshgrid(axis, axis))
    inside = x**2 + y**2 <= 1
    values = np.full(201**2, np.nan)
    area = np.full(201**2, np.nan)
    u = from_chart(x[inside], y[inside])
    rho, n = measured.face.exact(u)
    c = (n * u).sum(axis=1)
    values[inside] = 1e3 * c * form.at(u, control)
    area[inside] = (rho * (1 + u[:, 2]) * 0.01) ** 2 / c
    return values.reshape(201, 201), area.reshape(201, 201)


def extent(values, area):
    rms = np.sqrt(np.nansum(area * values**2) / np.nansum(area))
    return {"max": near(np.nanmax(abs(values)), 2 * NEAR), "rms": near(rms)}


def near(value, part=NEAR):
    return value, part * abs(value) + 1e-6


def light(case, face, call):
    """Figures of one light of a stage, with another face."""
    spec = case.lens["spec"]
    faces = faces_of(case.lens, case.lens["faces"])
    receiver = receivers_of(spec)[0]
    images = []
    window = []
    flux = np.concatenate([factor * part for _, factor, _, _, part, _ in call])
    number = np.concatenate([np.full(len(part), k) for k, _, _, _, part, _ in call])
    p, d, nm = (np.concatenate([part[k] for part in call]) for k in (2, 3, 5))
    behind = exits(case.lens, [face or faces[0], *faces[1:]], p, d, nm)
    at = receiver.land(behind.p[behind.left], behind.d[behind.left])
    flux = (behind.flux * flux)[behind.left]
    number = number[behind.left]
    for k in range(16):
        rows = (number == k) & ~np.isnan(at[:, 0])
        images.append(filtered(receiver.bins(at[rows], flux[rows]), spec["evaluate"]["filter_variance"]))
        window.append(flux[rows & receiver.in_window(*at.T)].sum() / flux_and_efficacy(spec["source"], case.files)[0])
    return np.array(images), figures(case, np.array(images), np.array(window))


def count_of(call):
    return sum(len(part[2]) for part in call)


def near_light(readings, of_value=0.0, of_error=0.1):
    """Figures of a light by another shape of the same form: within a part of their change and of its error."""
    return {name: {"value": (value, of_value * abs(value) + of_error * error), "unit": "",
                   "standard_error": near(error, 0.2)} for name, (value, error, *_) in readings.items()}  # fmt: skip


def motion_errors(measured):
    """Standard errors (rad, mm) of the motion by form error that neighbours share, from all pairs of points.

    Lensforge takes means over cells of neighbours: within a third.
    """
    u = measured.u
    (rho, n) = measured.face.exact(measured.u)
    slopes = np.hstack([np.cross(rho[:, None] * u, n), n])
    some = np.random.default_rng(0).permutation(len(u))[:1000]  # products of all are as many as their square
    slopes = slopes[some]
    left = (measured.d * (n * u).sum(axis=1))[some]
    cosines = u[some] @ u[some].T
    fit = np.linalg.pinv(slopes)
    without = np.eye(len(some)) - slopes @ fit
    kernels = [np.eye(len(some)), *(np.exp((cosines - 1) / s**2) for s in (0.1, 0.2, 0.4, 0.8))]
    seen = np.array([(without @ kernel @ without).ravel() for kernel in kernels])
    products = np.outer(without @ left, without @ left).ravel()
    root = np.linalg.cholesky(seen @ seen.T)
    amounts = nnls(root.T, np.linalg.solve(root, seen @ products))[0]
    noise, *fields = (np.einsum("ki,ij,kj->k", fit, kernel, fit) for kernel in kernels)
    # of all points: noise falls with their number, a field does not
    return np.sqrt(amounts[0] * noise * len(some) / len(u) + np.array(amounts[1:]) @ np.array(fields))


def pose_record(measured):
    """Of each parameter of the motion the value and its standard error; none is fitted to points that stay."""
    pose = {}
    errors = motion_errors(measured)
    for k, axis in enumerate("xyz"):
        pose[f"rotation_{axis}_deg"] = np.degrees(measured.motion[k]), np.degrees(errors[k]), "deg"
        pose[f"translation_{axis}_mm"] = measured.motion[3 + k], errors[3 + k], "mm"
    return {key: {"value": (value, 5e-3), "unit": unit, "standard_error": near(error, 0.35) if value else None}
            for key, (value, error, unit) in pose.items()}  # fmt: skip


class Changed(Bent):
    """A face with a change of its radius."""

    def radius(self, u):
        return self.face.radius(u) + self.error(u)

    def exact(self, u):
        return self.radius(u), self.normal(u)


def changed(measured, form, control):
    return Changed(measured.face, lambda u: form.at(u, control))


def criterion(name, value, sense, limit, unit, passed=True):
    return {"name": name, "value": value, "sense": sense, "limit": limit, "unit": unit, "tolerance": 0.0, "remedy": ...,
            "passed": passed}  # fmt: skip


def of_points(measured, covered):
    return [criterion("points_used", measured.used, ">=", 0.9, "of the points"),
            criterion("surface_covered", covered, ">=", 0.8, "of the surface")]  # fmt: skip


def settled(case, registration):
    """The points with the filter that they ask for; the spacing is that of correct.json, which is the oracle's, too."""

    def make():
        measured = Measured(case, registration)
        spacing_mm = case.json("correct_inner")["point_spacing_mm"]
        measured.spacing_mm = spacing_mm if registration == "none" else measured.spacing()
        measured.settle(measured.spacing_mm)
        return measured

    return kept_of(case, f"points {registration}", make)


def compare_record(case):
    measured = settled(case, "rigid")
    fit = measured.form
    receiver = receivers_of(case.lens["spec"])[0]
    control = fit.through(measured.d)
    form, area = map_of(measured, fit, control)
    distance = 1e3 * measured.d * fit.c
    residual = fit.mean_square(measured.d - fit.passed(measured.d))
    calls = case.rays["compare_inner"]
    faces = zip((None, changed(measured, fit, control)), calls, strict=True)
    (before, designed), (after, traced) = (light(case, face, call) for face, call in faces)
    covered = (measured.covered(measured.spacing_mm), 0.005)
    rays = count_of(calls[0])
    mean = (before.mean(axis=0), after.mean(axis=0))
    maps = arrays(case, "compare_inner")
    assert np.nanmax(abs(maps["deviation_um"] - form)) < 0.1 * np.nanmax(abs(form))
    for name, fit in zip(("irradiance_design", "irradiance_measured"), mean, strict=True):
        assert abs(maps[name] * receiver.measure - fit).max() < 0.05 * fit.max(), name
    return {
        "conditions": None, "surface": FACE, "registration": "rigid", "point_count": measured.count,
        "used_share": measured.used, "covered_share": covered, "pose": pose_record(measured),
        "point_deviation_um": {"pv": near(np.ptp(distance), 1e-3), "rms": near(np.sqrt((distance**2).mean()), 1e-3),
                               "min": near(distance.min(), 1e-3), "max": near(distance.max(), 1e-3)},
        "form_deviation_um": {"pv": near(np.nanmax(form) - np.nanmin(form), 2 * NEAR), "rms": extent(form, area)["rms"],
                              "min": near(np.nanmin(form), 2 * NEAR), "max": near(np.nanmax(form), 2 * NEAR)},
        "residual_rms_um": near(1e3 * np.sqrt(residual)), "rays": rays, "receiver": receiver.name, "far_field": False,
        "width": receiver.size[0], "height": receiver.size[1], "design": metrics_record(metrics_of(designed)),
        "measured": near_light(metrics_of(traced)), "change": near_light(change_of(traced, designed), 0.1),
        "nmse_between": near(((mean[1] - mean[0]) ** 2).sum() / (mean[0] ** 2).sum(), 0.2),
        "criteria": of_points(measured, covered),
    }  # fmt: skip


def correct_record(case):
    spec = case.lens["spec"]
    measured = settled(case, "none")
    stored = case.json("correct_inner")
    chosen = Filter(measured.face, measured.u, stored["wavelength_mm"])
    gain = stored["gain"]
    control = chosen.through(measured.d)
    likeliest = measured.form.through(measured.d)
    deviation, area = map_of(measured, measured.form, likeliest)
    passed, _ = map_of(measured, chosen, control)
    noise = measured.noise * np.random.default_rng(7).normal(size=len(measured.u)) / chosen.c
    again = chosen.through(measured.form.passed(measured.d) + noise)
    expected = extent(deviation - gain * map_of(measured, chosen, again)[0], area)
    left = Changed(measured.face, lambda u: measured.form.at(u, likeliest) - gain * chosen.at(u, again))
    calls = zip((None, changed(measured, measured.form, likeliest), left), case.rays["correct_inner"], strict=True)
    designed, first, second = (light(case, face, call)[1] for face, call in calls)
    rays = count_of(case.rays["correct_inner"][0])
    covered = (measured.covered(measured.spacing_mm), 0.005)
    content = (case.folder / "lens_corrected_inner.step").read_bytes()
    (hollow, hollow_near) = hollow_mm(case, FACE)
    cut = Part(FACE, changed(measured, chosen, -gain * control), "cavity", "body")
    lowest = cut.extreme(lambda share, phi: -cut.curvatures(share, phi)[1], -1)
    small = {"max": (0.5, 0.5), "rms": (0.5, 0.5)}
    record = {
        "conditions": None, "surface": FACE, "registration": "none", "process": "milled", "scale": 1.0,
        "point_count": measured.count, "point_spacing_mm": near(measured.spacing(), 0.02), "used_share": measured.used,
        "covered_share": covered, "pose": pose_record(measured), "gain": 0.7,
        "wavelength_mm": 2.1, "wavelength_given": True,
        "noise_rms_um": near(1e3 * measured.noise, 0.05),
        "residual_rms_um": near(1e3 * np.sqrt(chosen.mean_square(measured.d - chosen.passed(measured.d)))),
        "deviation_um": extent(deviation, area), "correction_um": extent(gain * passed, area),
        "expected_um": {"max": near(expected["max"][0], 2 * NOISY), "rms": near(expected["rms"][0], NOISY)},
        "cutter": {"cutter_radius_mm": spec["manufacture"]["cutter_radius_mm"],
                   "concave_radius_before_mm": (hollow, hollow_near), "concave_radius_mm": near(-1 / lowest, 0.01),
                   "smoothed_more_share": 0.0, "cut_back_um": {"max": 0.0, "rms": 0.0}},
        "nodes": ..., "step_schema": "AP214", "step_volume_change": (0.0, 1e-9), "form_error_nm": small,
        "normal_error_mrad": {"max": (0.01, 0.01), "rms": (0.01, 0.01)}, "rays": rays,
        "design": metrics_record(metrics_of(designed)),
        "first_cut": near_light(metrics_of(first), of_error=BY_TWO_RAYS),
        "second_cut": near_light(metrics_of(second), of_error=0.25),
        "change": near_light(change_of(second, designed), 0.3),
        "criteria": [*of_points(measured, covered),
                     criterion("concave_radius", stored["cutter"]["concave_radius_mm"], ">=", near(0.499, 1e-9), "mm"),
                     criterion("step_volume_change", stored["step_volume_change"], "<=", 1e-9, ""),
                     criterion("form_error", stored["form_error_nm"]["max"], "<=", 1.0, "nm"),
                     criterion("normal_error", stored["normal_error_mrad"]["max"], "<=", 0.02, "mrad")],
        "file": {"bytes": len(content), "sha256": sha256(content).hexdigest()},
    }  # fmt: skip
    cut_as_stated(case, measured)
    return record


def cut_as_stated(case, measured):
    """The face in the file is the design with the correction that is stated, to nanometres."""
    axis = arrays(case, "correct_inner")["chart"]
    spline = spline_faces((case.folder / "lens_corrected_inner.step").read_text())["OPTICAL_INNER"]
    p = spline.at(axis, axis)[0]
    stated = arrays(case, "correct_inner")["correction_map_um"].T
    off = 1e3 * measured.distance(p.reshape(-1, 3)).reshape(201, 201) - stated
    assert np.nanmax(abs(off)) < 0.005 and np.nanmax(abs(stated)) > 1, np.nanmax(abs(off))


RECORDS = {"compare_inner": compare_record, "correct_inner": correct_record}
TEXTS = {
    "compare_inner.registration": "rigid", "correct_inner.registration": "none, by datums",
    "correct_inner.file": "lens_corrected_inner.step",
}  # fmt: skip
PATHS = {
    "compare_inner": {"points": ("point_count", 1, ""), "covered": ("covered_share", 100, "%"),
                      "form": ("form_deviation_um.pv", 1, "µm"), "residual": ("residual_rms_um", 1, "µm")},
    "correct_inner": {"first_cut": ("deviation_um.rms", 1, "µm"), "correction": ("correction_um.rms", 1, "µm"),
                      "second_cut": ("expected_um.rms", 1, "µm"), "filter": ("wavelength_mm", 1, "mm"),
                      "left_out": ("residual_rms_um", 1, "µm"), "concave": ("cutter.concave_radius_mm", 1, "mm")},
}  # fmt: skip


def told(stage, path, factor=1.0, unit=""):
    """A fact by the record."""

    def oracle(case, place):
        entry = kept_of(case, stage, lambda: RECORDS[stage](case))
        for key in path.split("."):
            entry = entry[key]
        error, error_within = entry["standard_error"] if isinstance(entry, dict) else (None, 0.0)
        value, within = entry["value"] if isinstance(entry, dict) else entry if isinstance(entry, tuple) else (entry, 0)
        state = "pass" if place.key in ("form", "concave") else ""
        limit = (">=", 0.499) if place.key == "concave" else None  # the ball of 0.5 mm, less two thousandths
        return Expected(
            factor * value,
            factor * within,
            unit,
            error and factor * error,
            factor * error_within,
            limit=limit,
            state=state,
        )

    return oracle


ORACLES = {key: lambda case, place, text=text: Expected(text) for key, text in TEXTS.items()}
for own_stage, lit in (("compare_inner", "measured"), ("correct_inner", "second_cut")):
    ORACLES |= {f"{own_stage}.{key}": told(own_stage, *path) for key, path in PATHS[own_stage].items()}
    for figure in FIGURES:
        in_unit = (100.0, "%") if figure == "efficiency" else (1.0, "")
        ORACLES[f"{own_stage}.{figure}_change"] = told(own_stage, f"change.{figure}", *in_unit)
        ORACLES |= {f"{own_stage}.{figure}": told(own_stage, f"{lit}.{figure}", *in_unit)} if figure != "rsd" else {}
