"""Every number of ``compare --on`` by docs/definitions.md, section 18, from the photographs and the light alone."""

import numpy as np
from crooked import SHOT, Expected
from oracle_part import kept_of
from oracle_proof import arrays
from page_scene import mask_of, receivers_of
from PIL import Image
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter
from scipy.optimize import least_squares

NEAR = 0.01
CORNER_PX = 0.2
BLOCKS = 5
FINE = 16
UNITS = ("", "deg", "mm", "mm")
NAMES = ("scale", "rotation_deg", "displacement_x_mm", "displacement_y_mm")


def rectified(case, receiver):
    """The light of the photograph on the receiver's pixels, its mean 1, and the share of pixels at full scale."""
    on, off = (np.asarray(Image.open(case.folder / f"{name}.png"), dtype=float) / 65535 for name in ("on", "off"))
    (a, b) = np.array(receiver.size) / 2
    rows = []
    for (x, y), (u, v) in zip([(-a, b), (a, b), (a, -b), (-a, -b)], SHOT["corners"], strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y, -u], [0, 0, 0, x, y, 1, -v * x, -v * y, -v]]
    to_pixel = np.linalg.svd(np.array(rows))[2][-1].reshape(3, 3)
    x, y = receiver.centres(FINE)
    columns, lines, scale = np.einsum("ij,jkl->ikl", to_pixel, np.array([x, y, np.ones_like(x)]))
    pictures = []
    for picture in (on ** SHOT["gamma"] - off ** SHOT["gamma"], (on >= 1).astype(float)):
        fine = map_coordinates(picture, [lines / scale, columns / scale], order=1)
        pictures.append(fine.reshape(receiver.shape[0], FINE, receiver.shape[1], FINE).mean(axis=(1, 3)))
    return pictures[0] / pictures[0].mean(), pictures[1].mean()


def ssim(picture, reference):
    """Wang et al., IEEE Trans. Image Process. 13 (2004): a Gaussian window of 1.5 pixels, 11 wide, inside the edge."""

    def mean(image):
        return gaussian_filter(image, 1.5, truncate=3.5)

    a = mean(picture)
    b = mean(reference)
    span = np.ptp(reference)
    aa = mean(picture**2) - a**2
    bb = mean(reference**2) - b**2
    ab = mean(picture * reference) - a * b
    c = (0.01 * span) ** 2
    d = (0.03 * span) ** 2
    return ((2 * a * b + c) * (2 * ab + d) / ((a**2 + b**2 + c) * (aa + bb + d)))[5:-5, 5:-5].mean()


class Aligned:
    """The transform p' = s R p + t from the light to the photograph, gain and offset free, both smoothed by a pixel."""

    def __init__(self, measured, simulated, receiver):
        (self.rows, self.columns), (self.width, self.height) = measured.shape, receiver.size
        self.x, self.y = (array.ravel() for array in receiver.centres())
        self.seen, light = (gaussian_filter(image, 1.0, mode="nearest") for image in (measured, simulated))
        self.spline = spline_filter(light)
        self.units = np.array([1.0, 1.0, self.width, self.height])
        self.best = least_squares(self.residual, np.zeros(4), x_scale=0.01, xtol=1e-12, ftol=1e-12).x

    def read(self, spline, x, y):
        """A picture at places; its edge goes on."""
        j = np.clip((x / self.width + 0.5) * self.columns - 0.5, 0, self.columns - 1)
        i = np.clip((y / self.height + 0.5) * self.rows - 0.5, 0, self.rows - 1)
        return map_coordinates(spline, [i, j], order=3, mode="mirror", prefilter=False)

    def moved(self, parameters):
        log_s, turn, tx, ty = parameters * self.units
        c = np.cos(turn)
        s = np.sin(turn)
        x = self.x - tx
        y = self.y - ty
        return self.read(self.spline, np.exp(-log_s) * (c * x + s * y), np.exp(-log_s) * (c * y - s * x))

    def fitted(self, parameters):
        light = np.column_stack([self.moved(parameters), np.ones(len(self.x))])
        return light, np.linalg.lstsq(light, self.seen.ravel(), rcond=None)[0]

    def residual(self, parameters):
        light, weights = self.fitted(parameters)
        return self.seen.ravel() - light @ weights

    def errors(self):
        """The jackknife over blocks of the picture, in the linear model about the fit."""
        light, (gain, _) = self.fitted(self.best)
        slopes = [(self.moved(self.best + h) - self.moved(self.best - h)) * gain / 2e-3 for h in 1e-3 * np.eye(4)]
        design = np.column_stack([*slopes, light])
        left = self.residual(self.best)
        i, j = np.indices((self.rows, self.columns))
        block = ((i * BLOCKS // self.rows) * BLOCKS + j * BLOCKS // self.columns).ravel()
        out = np.array([np.linalg.lstsq(design[block != k], left[block != k], rcond=None)[0] for k in range(BLOCKS**2)])
        return np.sqrt((BLOCKS**2 - 1) * out[:, :4].var(axis=0)) * self.units

    def undone(self, image):
        log_s, turn, tx, ty = self.best * self.units
        c = np.exp(log_s) * np.cos(turn)
        s = np.exp(log_s) * np.sin(turn)
        back = self.read(spline_filter(image), c * self.x - s * self.y + tx, s * self.x + c * self.y + ty)
        return back.reshape(image.shape) / back.mean()


def by_corners(receiver):
    """Of ln s, the angle and both shifts, by corners that scatter."""
    sides = np.linalg.norm(np.roll(SHOT["corners"], -1, axis=0) - SHOT["corners"], axis=1)
    wide = (sides[0] + sides[2]) / 2
    high = (sides[1] + sides[3]) / 2
    turn = CORNER_PX / np.hypot(wide, high)
    return np.array([turn, turn, CORNER_PX / 2 * receiver.size[0] / wide, CORNER_PX / 2 * receiver.size[1] / high])


def photo_record(case):
    receiver = receivers_of(case.lens["spec"])[0]
    light = arrays(case, "evaluate")["receivers.0.map"]
    (measured, clipped) = rectified(case, receiver)
    simulated = light / light.mean()
    mask = mask_of(receiver)
    for name, image in (("measured", measured), ("simulated", simulated)):
        assert abs(arrays(case, "compare")[name] - image).max() < NEAR * image.max(), name
    fit = Aligned(measured, simulated, receiver)
    log_s, turn, tx, ty = fit.best * fit.units
    values = (np.exp(log_s), np.degrees(turn), tx, ty)
    errors = np.hypot(fit.errors(), by_corners(receiver)) * [np.exp(log_s), np.degrees(1), 1, 1]
    alignment = {name: {"value": (value, 0.1 * error), "unit": unit, "standard_error": near(error, 0.1)}
                 for name, value, error, unit in zip(NAMES, values, errors, UNITS, strict=True)}  # fmt: skip
    aligned = fit.undone(measured)
    regions = (measured[mask], simulated[mask])
    evenness = [{"uniformity": near(area.min() / area.mean(), 0.02), "rsd": near(area.std() / area.mean(), 0.02)}
                for area in regions]  # fmt: skip
    return {
        "on": "on.png", "off": "off.png", "corners": SHOT["corners"], "corners_located": None,
        "target_mm": list(receiver.size), "width_mm": receiver.size[0], "height_mm": receiver.size[1],
        "gamma": SHOT["gamma"], "pixels": max(receiver.shape), "ssim": near(ssim(measured, simulated)),
        "nmse": near(between(measured, simulated)), "alignment": alignment,
        "aligned": {"ssim": near(ssim(aligned, simulated)), "nmse": near(between(aligned, simulated), 0.05)},
        "measured_evenness": evenness[0], "simulated_evenness": evenness[1], "clipped": near(clipped, 0.05),
        "criteria": [{"name": "photo_clipped", "value": near(clipped, 0.05), "sense": "<=", "limit": 0.01,
                      "unit": "of the target", "tolerance": 0.0, "remedy": ..., "passed": True}],
        "likely_cause": ...,
    }  # fmt: skip


def between(picture, reference):
    return ((picture - reference) ** 2).sum() / (reference**2).sum()


def near(value, part=NEAR):
    return value, part * abs(value)


def told(path, factor=1.0, unit="", state="", limit=None):
    def oracle(case, place):
        entry = kept_of(case, "photo", lambda: photo_record(case))
        for key in path.split("."):
            entry = entry[key]
        pair, error = (entry["value"], entry["standard_error"]) if isinstance(entry, dict) else (entry, (None, 0))
        return Expected(factor * pair[0], factor * pair[1], unit, *error, limit=limit, state=state)

    return oracle


def cause(case, place):
    """Named are the causes of what is beyond three standard errors."""
    likely = case.json("compare")["likely_cause"]
    alignment = kept_of(case, "photo", lambda: photo_record(case))["alignment"]
    for (name, figure), told_as in zip(alignment.items(), ("scale", "rotation", "along x", "along y"), strict=True):
        beyond = abs(figure["value"][0] - (name == "scale")) > 3 * figure["standard_error"][0]
        assert (told_as in likely) == beyond, name
    return Expected(likely)


ORACLES = {f"compare.{name}": told(f"alignment.{name}", 1.0, unit) for name, unit in zip(NAMES, UNITS, strict=True)}
ORACLES |= {
    "compare.ssim": told("ssim"), "compare.photo_nmse": told("nmse"), "compare.aligned_ssim": told("aligned.ssim"),
    "compare.aligned_nmse": told("aligned.nmse"), "compare.photo_uniformity": told("measured_evenness.uniformity"),
    "compare.clipped": told("clipped", 100.0, "%", "pass", ("<=", 1.0)), "compare.cause": cause,
    "compare.photographs": lambda case, place: Expected("on.png minus off.png"),
    "compare.corners": lambda case, place: Expected("given"),
}  # fmt: skip
RECORDS = {"compare": photo_record}
