"""Receiver, target and figures of the light by sections 8 to 10 of docs/definitions.md alone."""

from pathlib import Path

import matplotlib
import numpy as np
from page_chain import trace_chain
from page_tracer import FATES, LANDED, trace
from PIL import Image, ImageDraw, ImageFont
from scipy import ndimage

# -- Section 8: receiver and pixels ------------------------------------------------------------------------------------


def hard_bins(lens, place, flux):
    """Flux of the pixels, [row, column]."""
    n = lens["spec"]["evaluate"]["pixels"]
    side = lens["spec"]["target"]["receiver_mm"]
    j, i = np.floor((place / side + 0.5) * n).astype(int).T
    on = (j >= 0) & (j < n) & (i >= 0) & (i < n)
    return np.bincount(i[on] * n + j[on], weights=flux[on], minlength=n * n).reshape(n, n)


def filtered(image, variance):
    if variance == 0:
        return image
    e = np.exp(-1 / (2 * variance))
    taps = np.array([e, 1, e]) / (1 + 2 * e)
    rows, columns = image.shape
    wide = np.pad(image, 1, mode="edge")
    wide = sum(tap * wide[i : i + rows] for i, tap in enumerate(taps))
    return sum(tap * wide[:, i : i + columns] for i, tap in enumerate(taps))


# -- Section 9: target -------------------------------------------------------------------------------------------------


def glyphs(text):
    font = ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts/ttf/DejaVuSans.ttf"), 1024)
    box = font.getbbox(text)
    canvas = Image.new("L", (box[2] + 64, box[3] + 64))
    ImageDraw.Draw(canvas).text((32, 32), text, fill=255, font=font)
    return np.asarray(canvas.crop(canvas.getbbox())) / 255


def luma(file):
    red, green, blue = np.moveaxis(np.asarray(Image.open(file).convert("RGB")).astype(int), -1, 0)
    return (19595 * red + 38470 * green + 7471 * blue) / 65536 / 255


def pattern(target, x, y, folder):
    kind = target["kind"]
    if kind == "flat_top":
        return np.exp(-(abs(2.0 * x / target["width_mm"]) ** target["exponent"])
                      - abs(2.0 * y / target["width_mm"]) ** target["exponent"])  # fmt: skip
    if kind == "cross":
        long = target["length_mm"] / 2
        short = target["stroke_mm"] / 2
        return ((abs(x) <= long) & (abs(y) <= short) | (abs(x) <= short) & (abs(y) <= long)).astype(float)
    picture = glyphs(target["text"]) if kind == "text" else luma(Path(folder) / target["file"])
    h, w = picture.shape
    x = -x if target.get("mirrored") else x
    column = np.floor(x * w / target["width_mm"] + w / 2).astype(int) + 0 * y.astype(int)
    row = np.floor(-y * w / target["width_mm"] + h / 2).astype(int) + 0 * x.astype(int)
    on = (column >= 0) & (column < w) & (row >= 0) & (row < h)
    return np.where(on, picture[np.clip(row, 0, h - 1), np.clip(column, 0, w - 1)], 0.0)


def blurred(image, q):
    """Convolved with a Gaussian of standard deviations ``q`` along rows and columns; nothing outside."""
    for axis, sigma in enumerate(q):
        if sigma > 0:
            i = np.arange(-np.floor(4 * sigma + 0.5), np.floor(4 * sigma + 0.5) + 1)
            taps = np.exp(-(i**2) / (2 * sigma**2))
            image = ndimage.convolve1d(image, taps / taps.sum(), axis=axis, mode="constant")
    return image


def target_image(lens, folder):
    """T, whose pixels add up to 1, and the sub-pixels in which it is above a tenth of its largest pixel."""
    target = lens["spec"]["target"]
    n = lens["spec"]["evaluate"]["pixels"]
    k = max(1, min(max(8, 512 // n), 4096 // n))
    centres = ((np.arange(n * k) + 0.5) / (n * k) - 0.5) * target["receiver_mm"]
    fine = pattern(target, centres[None, :], centres[:, None], folder)
    q = (target.get("edge_mm") or 0) * k * n / target["receiver_mm"]
    if target["kind"] != "flat_top":
        fine = blurred(fine, (q, q))
    image = fine.reshape(n, k, n, k).mean(axis=(1, 3))
    return image / image.sum(), fine > 0.1 * image.max()


# -- Section 10: figures of the light ----------------------------------------------------------------------------------


def raw_nmse(image, t):
    s = image.sum() / t.sum()
    return ((image - s * t) ** 2).sum() / ((s * t) ** 2).sum() if s else 1.0


def share_in_target(lens, place, flux, inside):
    """Of the flux of rays that land."""
    j, i = np.floor((place / lens["spec"]["target"]["receiver_mm"] + 0.5) * len(inside)).astype(int).T
    on = (j >= 0) & (j < len(inside)) & (i >= 0) & (i < len(inside))
    return flux[on][inside[i[on], j[on]]].sum()


def budget(lens, fate, place, flux, absorbed, in_glass):
    """Shares of the emitted flux; rays have equal flux."""
    window = lens["spec"]["evaluate"]["window_mm"] or lens["spec"]["target"]["receiver_mm"]
    within = (fate == LANDED) & (abs(place) <= window / 2).all(axis=1)
    shares = {name: flux[fate == i].sum() / len(fate) for i, name in enumerate(FATES)}
    shares |= {"detected": flux[within].sum() / len(fate), "absorbed": absorbed.sum() / len(fate)}
    shares["cover_glass"] = in_glass.sum() / len(fate)
    shares["bodies"] = shares["housing"] = shares["second_wall"] = 0.0  # the scenes of the page have none
    shares["outside"] = shares.pop("landed") - shares["detected"]
    return shares | {"reflected": 1 - sum(shares.values())}


def light(lens, pair, rays, folder="."):
    """Figures of the replicates, each a tuple (positions, directions, wavelengths) of rays in the lens's frame."""
    (t, inside) = target_image(lens, folder)
    bins = []
    budgets = []
    follow = trace if lens["spec"]["lens"]["kind"] == "double" else trace_chain
    for p, d, nm in rays:
        fate, place, flux, absorbed, in_glass = follow(lens, pair, p, d, nm)
        landed = fate == LANDED
        bins.append(hard_bins(lens, place[landed], flux[landed]) / len(p))
        share = share_in_target(lens, place[landed], flux[landed], inside) / len(p)
        budgets.append(budget(lens, fate, place, flux, absorbed, in_glass) | {"share_in_target": share})
    images = [filtered(image, lens["spec"]["evaluate"]["filter_variance"]) for image in bins]
    figures = {name: np.array([b[name] for b in budgets]) for name in budgets[0]}
    return {"target": t, "bins": bins, "images": images, "figures": figures}
