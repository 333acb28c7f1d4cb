"""Oracles of the search, the light, the far field and the roads, by docs/definitions.md alone."""

from collections.abc import Callable
from typing import Any

ORACLES: dict[str, Callable[[Any, Any], Any]] = {}
