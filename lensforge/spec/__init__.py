"""The specification of a design, read from TOML: validated once, immutable, every length in mm."""

from lensforge.spec.design import Spec, load_spec, parse_spec
from lensforge.spec.drawing import DrawingSection
from lensforge.spec.lens import LensSection
from lensforge.spec.part import BaseSection, ManufactureSection, Tool
from lensforge.spec.picture_targets import ArrayTarget, ImageTarget, TableTarget, TextTarget
from lensforge.spec.receiver_section import Target
from lensforge.spec.receivers import AnyReceiver
from lensforge.spec.search import Accuracy, ConstraintsSection, EvaluateSection, OptimiseSection
from lensforge.spec.shapes import CrossTarget, FlatTopTarget, RectangleTarget

__all__ = [
    "Accuracy",
    "AnyReceiver",
    "ArrayTarget",
    "BaseSection",
    "ConstraintsSection",
    "CrossTarget",
    "DrawingSection",
    "EvaluateSection",
    "FlatTopTarget",
    "ImageTarget",
    "LensSection",
    "ManufactureSection",
    "OptimiseSection",
    "RectangleTarget",
    "Spec",
    "TableTarget",
    "Target",
    "TextTarget",
    "Tool",
    "load_spec",
    "parse_spec",
]
