"""Spline faces of a STEP file, read from its text and evaluated by the formula of B-splines."""

import re
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

_ENTITY = re.compile(r"#(\d+)\s*=\s*([A-Z_]+)\s*\(((?:[^;'']|'[^']*')*)\)\s*;")


def numbers(text):
    return np.array([float(number) for number in re.findall(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:E[-+]?\d+)?", text)])


@dataclass
class StepSpline:
    """A spline over the chart: its knots along both parameters, and its poles (mm)."""

    knots: tuple
    poles: np.ndarray

    def at(self, x, y, pairs=False):
        """Points (mm) and unit normals at all pairs of two rows of parameters, or at ``pairs`` of them one by one."""
        ends = "ai,aic->ac" if pairs else "bi,aic->bac"
        rows = []
        for p, q in ((0, 0), (1, 0), (0, 1)):
            across = np.einsum("ijc,aj->aic", self.poles, self.basis(1, y, q), optimize=True)
            rows.append(np.einsum(ends, self.basis(0, x, p), across, optimize=True))
        n = np.cross(rows[1], rows[2])
        return rows[0], n / np.linalg.norm(n, axis=-1, keepdims=True)

    def basis(self, axis, places, order):
        count = self.poles.shape[axis]
        spline = BSpline(self.knots[axis], np.eye(count), len(self.knots[axis]) - count - 1)
        return spline(places, order)


def spline_faces(text):
    """The spline faces of a STEP file by their names."""
    kinds = {number: (kind, body) for number, kind, body in _ENTITY.findall(text)}
    splines = {}
    for kind, body in kinds.values():
        if kind != "ADVANCED_FACE":
            continue
        name = re.match(r"\s*'([^']*)'", body)[1]
        surface = re.findall(r"#(\d+)", body)[-1]
        if kinds.get(surface, ("", ""))[0] != "B_SPLINE_SURFACE_WITH_KNOTS":
            continue
        groups = re.findall(r"\(([^()]*)\)", kinds[surface][1])
        rows = [re.findall(r"#(\d+)", row) for row in groups[:-4]]
        poles = np.array([[numbers(kinds[point][1].split("'")[2]) for point in row] for row in rows])
        many_x, many_y, at_x, at_y = map(numbers, groups[-4:])
        knots = tuple(np.repeat(at, many.astype(int)) for at, many in ((at_x, many_x), (at_y, many_y)))
        splines[name] = StepSpline(knots, poles)
    return splines
