"""Data that the programs of this folder share: rays, detector, and the figures to expect with their standard errors.

Lengths are in mm. The rays of ``source.npy`` have equal flux; a row is x, y, z and the direction. Light counts where it
lands in the window of the detector, and in which of its zones.
"""

import json
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
KIT = json.loads((HERE / "kit.json").read_text(encoding="utf-8"))
DETECTOR = KIT["detector"]
AXES = np.array(DETECTOR["axes"])  # unit vectors x, y and the normal, as rows
IS_FAR = DETECTOR["kind"] == "far_field"  # a detector of directions
WITHIN = 2.0  # standard errors


def window() -> list[float]:
    """Width and height (mm) in which light counts."""
    return [side or DETECTOR[whole] for side, whole in zip(DETECTOR["window"], ("width", "height"), strict=False)]


def source_rays(count: int | None = None) -> np.ndarray:
    """The first ``count`` rays of the source, all of them by default."""
    return np.asarray(np.load(HERE / "source.npy")[:count], dtype=np.float64)


def landings(points: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Places (x, y) on the detector of rays that leave the lens; NaN for those that do not reach it.

    On a plane in mm; in the far field on the chart of radius 2 sin(gamma / 2) about its axis.
    """
    along = directions @ AXES.T
    if IS_FAR:
        across = np.hypot(along[:, 0], along[:, 1])
        radius = 2.0 * np.sin(0.5 * np.arctan2(across, along[:, 2]))
        return along[:, :2] * (radius / np.maximum(across, 1e-300))[:, None]
    away = (points - np.array(DETECTOR["centre_mm"])) @ AXES.T
    with np.errstate(divide="ignore", invalid="ignore"):
        places = away[:, :2] - (away[:, 2] / along[:, 2])[:, None] * along[:, :2]
    places[(along[:, 2] <= 0.0) | (away[:, 2] >= 0.0)] = np.nan
    return places


def shares(places: np.ndarray, count: int) -> tuple[float, np.ndarray]:
    """Share of ``count`` rays in the window, and in each zone [row y, column x] of the whole detector."""
    sides = np.array([DETECTOR["width"], DETECTOR["height"]])
    reach = [np.inf if side is None else side for side in DETECTOR["window"]]
    with np.errstate(invalid="ignore"):
        inside = (np.abs(places) <= 0.5 * np.array(reach[:2])).all(axis=1)
        inside &= np.hypot(places[:, 0], places[:, 1]) <= reach[2]
        placed = places[(np.abs(places) <= 0.5 * sides).all(axis=1)]
    rows, columns = np.array(KIT["zone_shares"]).shape
    edges = [np.linspace(-0.5, 0.5, cells + 1) * side for cells, side in ((columns, sides[0]), (rows, sides[1]))]
    zones, *_ = np.histogram2d(placed[:, 1], placed[:, 0], bins=edges[::-1])
    return float(inside.sum()) / count, zones / count


def judged(program: str, share: float, zones: np.ndarray, count: int) -> int:
    """Print the share by ``count`` rays of ``program`` beside the expected one; return 0 if they agree, else 1.

    The program averages the polarisation at every face.
    """
    wanted = KIT["expected"].get("efficiency_averaged_polarisation", KIT["expected"]["efficiency"])
    error = float(np.hypot(wanted["standard_error"] or 0.0, np.sqrt(share * (1.0 - share) / count)))
    apart = (share - wanted["value"]) / error
    expected = np.array(KIT["zone_shares"])
    noise = expected * (1.0 - expected) * (1.0 / count + 1.0 / KIT["expected"]["rays"])
    lit = expected * count >= 10.0
    rms = float(np.sqrt(np.mean((zones - expected)[lit] ** 2 / noise[lit])))
    most = 1.0 + WITHIN / np.sqrt(2.0 * lit.sum())
    agree = abs(apart) <= WITHIN and rms <= most
    print(f"{KIT['name']}: {program}, {count} rays")
    print(f"  share of the light in the window: {share:.5f}, expected {wanted['value']:.5f}")
    print(f"  apart by {apart:+.2f} standard errors of {error:.5f}; at most {WITHIN:g}")
    print(f"  {int(lit.sum())} zones of the detector: {rms:.2f} standard errors apart, rms; at most {most:.2f}")
    print("  agrees" if agree else "  DIFFERS")
    return 0 if agree else 1
