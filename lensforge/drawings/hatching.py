"""Hatching of cut material: lines at 45 degrees inside closed outlines."""

import numpy as np

from lensforge.drawings.sheet import Points, Stroke

_TURN = np.array([[1.0, 1.0], [-1.0, 1.0]]) / np.sqrt(2.0)  # rows: along the lines, and across them


def hatch(outlines: list[Points], spacing_mm: float) -> list[Stroke]:
    """Lines ``spacing_mm`` apart inside all ``outlines`` together, inside being what an odd number of them encloses."""
    chains = [np.vstack([outline, outline[:1]]) @ _TURN.T for outline in outlines]
    across = np.concatenate([chain[:, 1] for chain in chains])
    first, last = np.ceil(across.min() / spacing_mm), np.floor(across.max() / spacing_mm)
    found = []
    for level in spacing_mm * (np.arange(first, last + 1.0) + 0.37):  # off the places where corners are likely
        cuts = np.sort(np.concatenate([_cuts(chain, level) for chain in chains]))
        for start, end in zip(cuts[0::2], cuts[1::2], strict=False):
            found.append(Stroke(np.array([(start, level), (end, level)]) @ _TURN, "hatch"))
    return found


def _cuts(chain: Points, level: float) -> np.ndarray:
    """Places along a level at which a chain crosses it."""
    above = chain[:, 1] > level
    changes = np.flatnonzero(above[1:] != above[:-1])
    start, end = chain[changes], chain[changes + 1]
    share = (level - start[:, 1]) / (end[:, 1] - start[:, 1])
    return np.asarray(start[:, 0] + share * (end[:, 0] - start[:, 0]))
