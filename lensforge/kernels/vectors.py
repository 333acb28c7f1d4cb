"""Vectors of three numbers, as tuples: what kernels compute with them."""

from math import sqrt

from lensforge.kernels.compiled import inline


@inline
def dot(a, b):
    """The scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inline
def difference(a, b):
    """The vector a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inline
def cross(a, b):
    """The vector product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inline
def scaled(a, x):
    """The vector a x."""
    return a * x[0], a * x[1], a * x[2]


@inline
def add_scaled(x, a, y):
    """The vector x + a y."""
    return x[0] + a * y[0], x[1] + a * y[1], x[2] + a * y[2]


@inline
def linear_combination(a, x, b, y):
    """The vector a x + b y."""
    return a * x[0] + b * y[0], a * x[1] + b * y[1], a * x[2] + b * y[2]


@inline
def length_of(x):
    """The length of a vector."""
    return sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])


@inline
def unit(x):
    """The vector with length 1."""
    length = length_of(x)
    return x[0] / length, x[1] / length, x[2] / length
