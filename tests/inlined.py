"""Functions that kernels inline, for tests that call them: alone they have no code for calls from Python."""

from collections.abc import Callable
from typing import Any

import numba


def alone(inlined: Callable[..., Any]) -> Callable[..., Any]:
    """A kernel that is ``inlined`` and nothing else."""

    @numba.njit(error_model="numpy")
    def call(*arguments: Any) -> Any:
        return inlined(*arguments)

    return call
