"""What is wanted? The TOML of a design: validated once, immutable, every length in mm."""

from lensforge.spec.accuracy import Accuracy, AnyAccuracy, Preset
from lensforge.spec.design_spec import Spec, load_spec, parse_spec
from lensforge.spec.face_section import FaceSection
from lensforge.spec.lens_section import LensSection
from lensforge.spec.part_section import BaseSection, DrawingSection, ManufactureSection, Tool
from lensforge.spec.receiver_sections import AnyReceiver, Target
from lensforge.spec.search_section import ConstraintsSection, EvaluateSection, OptimiseSection
from lensforge.spec.shape_targets import CrossTarget, FlatTopTarget, RectangleTarget
from lensforge.spec.target_sections import ArrayTarget, ImageTarget, TableTarget, TextTarget

__all__ = [
    "Accuracy",
    "AnyAccuracy",
    "AnyReceiver",
    "ArrayTarget",
    "BaseSection",
    "ConstraintsSection",
    "CrossTarget",
    "DrawingSection",
    "EvaluateSection",
    "FaceSection",
    "FlatTopTarget",
    "ImageTarget",
    "LensSection",
    "ManufactureSection",
    "OptimiseSection",
    "Preset",
    "RectangleTarget",
    "Spec",
    "TableTarget",
    "Target",
    "TextTarget",
    "Tool",
    "load_spec",
    "parse_spec",
]
