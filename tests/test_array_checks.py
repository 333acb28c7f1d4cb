"""Checks of arrays while the tests run: a wrong shape or dtype is an error in every kind of function, in each test."""

from dataclasses import dataclass

import array_checks
import beartype
import numpy as np
import pytest
from jaxtyping import Float, TypeCheckError
from nightly import NIGHTLY

from lensforge.surfaces import surface


def plain(points: Float[np.ndarray, "n 3"], flux: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    return flux[: len(points) - int(flux[0] < 0.0)]


def checked(subject):
    return array_checks.checked(subject, typechecker=beartype.beartype)


POINTS, FLUX = np.zeros((4, 3)), np.ones(4)
WRONG = [(POINTS[:, :2], FLUX), (POINTS, FLUX[:3]), (POINTS.astype(int), FLUX), (POINTS, -FLUX), (POINTS, None)]


@pytest.mark.parametrize("arguments", WRONG, ids=["columns", "rows", "dtype", "returned", "none"])
@pytest.mark.parametrize("again", [1, 2])
def test_a_wrong_array_is_an_error_in_every_test(arguments, again) -> None:
    function = checked(plain)
    assert function(POINTS, FLUX).shape == (4,)
    with pytest.raises(TypeCheckError):
        function(*arguments)


def test_methods_and_dataclasses_are_checked_too() -> None:
    @checked
    @dataclass(frozen=True)
    class Rays:
        points: Float[np.ndarray, "n 3"]
        flux: Float[np.ndarray, " n"]

        @classmethod
        @checked
        def of(cls, flux: Float[np.ndarray, " n"]):
            return cls(np.zeros((len(flux), 3)), flux)

        @property
        @checked
        def total(self) -> Float[np.ndarray, ""]:
            return self.flux

    assert len(Rays(POINTS, FLUX).points) == len(Rays.of(FLUX).points) == 4
    for wrong in (lambda: Rays(POINTS, FLUX[:3]), lambda: Rays.of(POINTS), lambda: Rays(POINTS, FLUX).total):
        with pytest.raises(TypeCheckError):
            wrong()


@pytest.mark.skipif(NIGHTLY, reason="by night every call is checked")
def test_the_package_itself_is_checked_in_the_first_calls_of_each_test() -> None:
    for _ in range(2):
        for _ in range(array_checks.CALLS):
            with pytest.raises(TypeCheckError):
                surface.to_sphere(np.zeros((4, 3), dtype=int))
        assert surface.to_sphere(np.zeros((4, 2), dtype=int)).shape == (4, 3), "later calls: the function itself"
        array_checks.begin_test()
