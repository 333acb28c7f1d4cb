"""One statement of what the shop can or cannot do with this lens; it judges the tool, not the design."""

from typing import Literal

from lensforge.records import Flag, Record, Text


class ShopVerdict(Record):
    """One statement: about what, of which face, whether it holds, and why."""

    name: Literal["cutter", "relief", "tilt", "wall", "draft", "tool"]
    surface: Literal["inner", "outer", "body"]
    holds: Flag
    reason: Text
