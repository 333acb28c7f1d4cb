"""Rays that pass a rim closely: the edge of a tree nearest to each, and how much of the light of a search gets by.

``rim`` is the tangent of an angle, seen from the foot of the ray's line before an origin. With t that of the angle to
the nearest edge, a ray has the weight ``x^2 (3 - 2 x)``, x = t / rim, if t is less than ``rim``. A ray that ends on a
face of bodies has it beside those edges, too, at which that face ends behind the place; edges within it are none.
"""

from math import inf

from lensforge.kernels.compiled import inline, kernel
from lensforge.kernels.landing import write
from lensforge.kernels.lanes import LANES, bits_of_lanes
from lensforge.kernels.triangle_tree import AS_MET, following, negative_bits, planes, reciprocal
from lensforge.kernels.vectors import add_scaled, difference, dot, length_of, linear_combination, scaled

_AHEAD_MM = 1e-6  # beyond the start of a ray, where rims begin to count
_LEAST_MM = 1e-300  # of a distance that has a direction


@bits_of_lanes
def _may_be_near(planes, ray):
    """Boxes that do not lie wholly outside the cone of a tangent around a line.

    The cone is at most as wide as where the box ends along the line, which then meets the box grown by that much.
    """
    px, py, pz, dx, dy, dz, per_x, per_y, per_z, most = ray
    end = (planes[3] - px) * dx + (planes[4] - py) * dy + (planes[5] - pz) * dz
    wide = end * most
    x = wide * per_x.or_more(per_x * -1.0)
    y = wide * per_y.or_more(per_y * -1.0)
    z = wide * per_z.or_more(per_z * -1.0)
    near = ((planes[0] - px) * per_x - x).or_more((planes[1] - py) * per_y - y).or_more((planes[2] - pz) * per_z - z)
    far = ((planes[3] - px) * per_x + x).or_less((planes[4] - py) * per_y + y).or_less((planes[5] - pz) * per_z + z)
    return (near.or_more(0.0) <= far.or_less(end)) & (end >= 0.0)


@inline
def _nearest_of_edge(start, end, direction, least_along, most_along):
    """Least tangent of the angle between a line and the places of an edge as its point sees them, and that place.

    ``start``, ``end``: from that point. Seen along the line, places at the depth z are at (x, y)/z.
    """
    z0 = dot(start, direction)
    z1 = dot(end, direction)
    none = inf, 0.0, 0.0, 0.0
    if max(z0, z1) <= least_along:
        return none
    if z0 < least_along or z1 < least_along:  # cut off what lies behind the start of the ray
        share = (least_along - z0) / (z1 - z0)
        cut = add_scaled(start, share, difference(end, start))
        if z0 < least_along:
            start = cut
            z0 = least_along
        else:
            end = cut
            z1 = least_along
    a = difference(scaled(1.0 / z0, start), direction)
    b = difference(scaled(1.0 / z1, end), direction)
    along = difference(b, a)
    square = dot(along, along)
    share = min(max(-dot(a, along) / square, 0.0), 1.0) if square > 0.0 else 0.0
    aside = add_scaled(a, share, along)
    depth = 1.0 / ((1.0 - share) / z0 + share / z1)
    if depth >= most_along:
        return none
    x, y, z = scaled(depth, add_scaled(aside, 1.0, direction))
    return length_of(aside), x, y, z


@inline
def _nearest_rim(foot, direction, least_along, most_along, most, tree, face, sides):
    """Tangent of the angle between a line and the nearest edge, at most ``most``, and the place there from the foot.

    ``face``: that the line ends on, or -1; ``sides``: the two faces at each edge.
    """
    per = reciprocal(direction[0]), reciprocal(direction[1]), reciprocal(direction[2])
    signs = negative_bits(direction)
    nearest = most
    rim = direction
    leaves = len(tree.levels)
    level = 0
    index = 0
    waiting = 0
    against = 0
    going = True
    while going:
        bits = 0
        turned = 0
        if level == leaves:
            for k in range(tree.starts[index], tree.starts[index + 1]):
                of_face = (sides[k, 0] == face) + (sides[k, 1] == face)
                if of_face < 2:
                    start = difference(tree.corners[k, 0], foot)
                    end = difference(tree.corners[k, 1], foot)
                    farthest = inf if of_face else most_along
                    tangent, x, y, z = _nearest_of_edge(start, end, direction, least_along, farthest)
                    if tangent < nearest:
                        nearest = tangent
                        rim = x, y, z
        else:
            node = tree.levels[level] + index
            turned = tree.against[node, signs]
            line = (*foot, *direction, *per, nearest)
            bits = AS_MET[turned, _may_be_near(tree.boxes, node, planes(signs), line)]
        waiting = waiting << LANES | bits
        against = against << LANES | turned
        going = waiting != 0
        if going:
            level, index, waiting, against = following(level, index, waiting, against)
    return nearest, rim


@kernel
def dim_beside_rims(points, directions, reaches, faces, origin, rim, edges, sides, weights, by_points, by_directions):
    """Multiply into ``weights`` those of rays beside rims, and fill their slopes by points (1/mm) and directions.

    ``reaches``: distances (mm) at which rays end; one that is not positive, or has no weight, is left as it is.
    ``faces``: numbers of those that they end on, or -1; ``edges``: their tree, ``sides`` the faces at each of them;
    ``origin``: from which angles are seen.
    """
    for ray in range(len(points)):
        if not (reaches[ray] > 0.0 and weights[ray] > 0.0):
            continue
        direction = directions[ray, 0], directions[ray, 1], directions[ray, 2]
        point = difference(points[ray], origin)
        begin = dot(point, direction)
        foot = add_scaled(points[ray], -begin, direction)
        least_along = max(begin, 0.0) + _AHEAD_MM
        most_along = begin + reaches[ray]
        tangent, away = _nearest_rim(foot, direction, least_along, most_along, rim, edges, faces[ray], sides)
        if tangent < rim:
            place = add_scaled(away, 1.0, add_scaled(point, -begin, direction))
            along = dot(place, direction)
            ahead = along - begin
            aside = add_scaled(difference(place, point), -ahead, direction)
            aside = scaled(1.0 / max(length_of(aside), _LEAST_MM), aside)
            x = tangent / rim
            slope = -6.0 * x * (1.0 - x) / (rim * along)
            weights[ray] *= x * x * (3.0 - 2.0 * x)
            write(scaled(slope, aside), by_points[ray])
            write(linear_combination(slope * ahead, aside, slope * tangent, place), by_directions[ray])
