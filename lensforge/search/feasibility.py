"""Feasibility: constraints of a finished lens by the exact sum, and the projection of a search's end onto them.

A search of a few hundred noisy steps ends some micrometres to either side of its limits. Where a limit is missed, the
parameters are projected to the feasible set, a change too small to affect the light. A search that ended inside its
limits is left as it is, to the bit.
"""

import inspect
from collections.abc import Iterable
from operator import itemgetter

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.search.constraint_points import ChartOperator, ChartPoints, RadiusJet, constraint_points, section_points
from lensforge.search.constraints import WALL, AugmentedLagrangian, Constraint, constraints_of
from lensforge.search.design_result import DIRECTIONS, EDGE, FLANGE_ROOM, Limit, Margins
from lensforge.search.parameters import Parametrisation
from lensforge.search.problem import Problem
from lensforge.search.search_state import Parameters
from lensforge.spec import AnyAccuracy, Spec
from lensforge.surfaces import surface as chart
from lensforge.surfaces.bicubic_table import TableGrid, grid_for, tabulate
from lensforge.surfaces.mirror_group import first_images

# Curvature and draft come from a table of the exact sum, by differences of fourth order: at 8 nodes across the
# narrowest function its curvature is off by less than 1e-4, and a window of 21 x 21 points looks between the nodes.
_NODES_PER_SIGMA = 8.0
_ZOOM_POINTS = 21
_ROUNDS = 12
_ITERATIONS = 40
_PENALTY = 1e6
_CORRECTIONS = 3  # of the limits, by what the measured lens misses: a milled quickstart needs one
_ACCEPTED = 0.7  # of the margin may be missing: the rest covers peaks between the points
_STALLED = 0.8  # of the shortfall left by a round: more, and further rounds do not help
_OF_PAPER = 3  # constraints that every lens has
_HOPELESS = 10.0  # margins missing after a projection; a search of hundreds of steps finds its way out of fewer


def measure_constraints(lens: Lens, directions: int = DIRECTIONS) -> Margins:
    """Measure the least value of each constraint, of lenses of several kinds over all of them.

    Lengths: by the exact sum, over a Fibonacci grid of the hemisphere and its rim, one of mirror images each. The wall:
    between the splines that an export would write. Edges: of the faces all along their creases.
    """
    of_kinds = [_measured(kind, directions) for kind in lens.kinds]
    least = map(min, zip(*(limits.values() for limits in of_kinds), strict=True))
    return Margins.of(dict(zip(of_kinds[0], least, strict=True)))


def _measured(lens: Lens, directions: int) -> dict[Limit, float]:
    from lensforge.cad.boundary import lens_boundaries, sharpest_edges  # a third of a second, at the end of a search
    from lensforge.cad.flange import flange_heights_mm
    from lensforge.cad.wall import thinnest_of

    constraints = constraints_of(lens.spec)
    places, exact = _exact_radii(lens, directions)
    least: dict[Limit, float] = {}
    for constraint in constraints:
        if constraint.kind == WALL:
            wall = thinnest_of(lens)
            least[constraint] = wall.thickness_mm - constraint.given
        elif constraint.kind == EDGE:
            edges = (edge for side in lens_boundaries(lens) for edge in sharpest_edges(side))
            least[constraint] = (
                min(edge.angle_deg for edge in edges if set(edge.faces) <= set(constraint.names)) - constraint.given
            )
        elif constraint.kind == FLANGE_ROOM:
            low, high = flange_heights_mm(lens_boundaries(lens)[1])
            least[constraint] = high - low - constraint.given
        elif not constraint.derivatives:
            least[constraint] = float(constraint.of(exact, places).min())
    of_shape = [constraint for constraint in constraints if constraint not in least]
    if of_shape:
        grid = grid_for(lens.detail_rad, _NODES_PER_SIGMA)
        tables = {name: torch.from_numpy(tabulate(grid, surface)) for name, surface in lens.surfaces.items()}
        drawn = lens.spec.lens.drawn_mm is not None
        points = (section_points if drawn else constraint_points)(grid, lens.symmetry)
        everywhere = ChartOperator.of(grid, points, derivatives=True)
        least |= {limit: _least(limit, grid, everywhere, tables) for limit in of_shape}
    return least


def _exact_radii(lens: Lens, directions: int) -> tuple[ChartPoints, dict[str, RadiusJet]]:
    u = lens.directions(directions)
    if lens.spec.lens.drawn_mm is None:
        azimuth = np.linspace(0.0, 2.0 * np.pi, 2048, endpoint=False)
        rim = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], axis=1)
        u = np.concatenate([u, rim])
    u = u[first_images(u, lens.symmetry)]
    nothing = torch.empty(0, len(u), dtype=torch.float64)
    exact = {name: RadiusJet(torch.from_numpy(surface.radius(u)), nothing) for name, surface in lens.surfaces.items()}
    return ChartPoints.of(chart.to_chart(u)), exact


def _least(
    constraint: Constraint, grid: TableGrid, everywhere: ChartOperator, tables: dict[str, Float[Tensor, "s s"]]
) -> float:
    """Minimum ``everywhere``, then at finer points around it."""
    stacked = torch.stack([tables[name] for name in constraint.names])

    def least_of(operator: ChartOperator) -> tuple[float, Float[np.ndarray, "2"]]:
        jets = dict(zip(constraint.names, operator.jets(stacked), strict=True))
        field = constraint.of(jets, operator.points)
        points = operator.points
        k = int(field.argmin())
        return float(field[k]), np.array([points.x[k], points.y[k]])

    coarse, at = least_of(everywhere)
    window = at + chart.grid(_ZOOM_POINTS, grid.step).reshape(-1, 2)
    finer = window / np.maximum(1.0, np.linalg.norm(window, axis=1, keepdims=True))
    return min(coarse, least_of(ChartOperator.of(grid, finer, derivatives=True))[0])


def feasible_lens(
    problem: Problem, searched: Parameters, seed: int, accuracy: AnyAccuracy
) -> tuple[Lens, Margins, Parameters]:
    """The lens of ``searched`` parameters, projected to the feasible set, its constraints, and its parameters.

    The projection sees faces by coarser tables than those that measure a lens, a draft's curvature by 1 % of the ball's
    too flat. A limit that the measured lens misses is made stricter by all that the projection sees too much, and the
    parameters are projected again. Of all lenses that were tried the one that misses least is kept.
    """
    parametrisation, constraints = problem.in_full()
    limits = constraints.constraints
    stricter = dict[str, float]()
    tried: list[tuple[float, tuple[Lens, Margins, Parameters]]] = []
    for _ in range(_CORRECTIONS + 1):
        parameters = Parameters(*project_to_feasible(parametrisation, constraints.tightened(stricter), *searched))
        lens = problem.parametrisation.lens(*parameters, problem.spec, seed, accuracy)
        margins = measure_constraints(lens)
        tried.append((max(limit.missed_by(margins.at(limit)) for limit in limits), (lens, margins, parameters)))
        missed = [limit for limit in limits if not limit.missed_by(margins.at(limit)) <= 1.0]
        if not missed:
            break
        seen = constraints.least(constraints.fields(parametrisation.tables(*parameters)))
        stricter |= {limit.key: seen[limit.key] - margins.at(limit) + limit.spare for limit in missed}
    return min(tried, key=itemgetter(0))[1]


class _LBFGS(torch.optim.LBFGS):
    """Optimiser of torch without the compiler of torch, whose start would take seconds."""

    add_param_group = inspect.unwrap(torch.optim.Optimizer.add_param_group)


def project_to_feasible(
    parametrisation: Parametrisation,
    constraints: AugmentedLagrangian,
    weights: Float[Tensor, "m f"],
    offsets: Float[Tensor, " f"],
) -> tuple[Float[Tensor, "m f"], Float[Tensor, " f"]]:
    """Move ``weights`` and ``offsets`` by as little as makes all constraint points feasible, with part of the margin.

    Least squares in the relative parameters, by augmented Lagrangian. Where some point stays beyond its limit, moved to
    where the worst is the least beyond; unchanged where no move lessens that.
    """
    moved, _ = _least_move(parametrisation, constraints, weights, offsets, _ACCEPTED)
    return weights + moved[1:], offsets + moved[0]


def require_feasible_start(problems: Iterable[Problem]) -> None:
    """Raise :class:`InputError` where no lens is found that keeps all limits, before a search for the best of them.

    For optional limits, and fixed surfaces; of the paper's three the spec knows all. The starting lens is projected, at
    first by the functions of the first level of the first of ``problems``, at last by all functions of the last one.
    """
    for problem in problems:
        spec = problem.spec
        parametrisation = problem.parametrisation
        constraints = problem.constraints
        if not any(spec.lens.fixed.values()) and len(constraints.constraints) == _OF_PAPER:
            return
        for functions in sorted({parametrisation.levels[0], parametrisation.size}):
            weights, offsets = parametrisation.start(functions)
            moved, shortfall = _least_move(parametrisation, constraints, weights, offsets, _HOPELESS)
            if shortfall <= _HOPELESS:
                return
    least = constraints.least(constraints.fields(parametrisation.tables(weights + moved[1:], offsets + moved[0])))
    given = ", ".join(f"{name} = {value}" for name, value in _given(spec).items())
    missed = [constraint for constraint in constraints.constraints if least[constraint.key] < -constraint.tolerance]
    missed_limits = "; ".join(f"{limit.name} {least[limit.key]:.3g} {limit.unit}: {limit.remedy}" for limit in missed)
    raise InputError(f"constraints: no lens meets all of {given}; the closest has {missed_limits}")


def _given(spec: Spec) -> dict[str, str]:
    """The limits of ``spec`` by name, as text: the paper's, and those that it sets."""
    constraints = spec.constraints
    without = {"keep_out_margin_mm"} if constraints.keep_out is None else None
    values = constraints.model_dump(exclude_none=True, exclude=without)
    for name in spec.lens.names:
        limits = vars(spec.face_limits(name))
        values |= {f"lens.{name}.{field}": value for field, value in limits.items() if value is not None}
    return {name: f"{value:g}" if isinstance(value, float) else str(value) for name, value in values.items()}


def _least_move(
    parametrisation: Parametrisation,
    constraints: AugmentedLagrangian,
    weights: Float[Tensor, "m f"],
    offsets: Float[Tensor, " f"],
    accepted: float,
) -> tuple[Float[Tensor, "k f"], float]:
    """Least change of offsets (first row) and weights to the feasible set, and the margins that are still missing.

    It ends where no more than ``accepted`` margins are missing.
    """
    constraints = constraints.fresh(_PENALTY)
    moved = torch.zeros(len(weights) + 1, len(offsets), dtype=torch.float64, requires_grad=True)

    def fields() -> Float[Tensor, "c k"]:
        return constraints.fields(parametrisation.tables(weights + moved[1:], offsets + moved[0]))

    shortfall = constraints.shortfall(fields())
    best = moved.detach().clone()
    least = shortfall
    for _ in range(_ROUNDS):
        if shortfall <= accepted:
            break
        optimiser: torch.optim.LBFGS = _LBFGS([moved], max_iter=_ITERATIONS, line_search_fn="strong_wolfe")

        def closure() -> Tensor:
            moved.grad = None
            loss = 0.5 * torch.sum(moved**2) + constraints.term(fields())
            loss.backward()
            return loss

        optimiser.step(closure)
        with torch.no_grad():
            now = fields()
        constraints.update(now)
        before, shortfall = shortfall, constraints.shortfall(now)
        if shortfall < least:
            best = moved.detach().clone()
            least = shortfall
        if shortfall > _STALLED * before:
            break
    return best, least
