"""What is wanted? The TOML of a design: validated once, immutable, every length in mm."""

from typing import TYPE_CHECKING

from lensforge.spec.shape_targets import CrossTarget, FlatTopTarget, RectangleTarget

# Kinds stand on pages and in messages as they are registered: shapes before others.
# isort: split
from lensforge.spec.accuracy import Accuracy, AnyAccuracy, Preset
from lensforge.spec.camera_target import CameraTarget
from lensforge.spec.cut_off import CutOffLimit
from lensforge.spec.double_lens import LensSection
from lensforge.spec.extruded import ExtrudedSection
from lensforge.spec.extruded_tir import ExtrudedTirSection
from lensforge.spec.face_section import FaceSection, FlangeSection
from lensforge.spec.far_field_targets import BeamTarget
from lensforge.spec.internal_reflection import ExitFace, TirSection
from lensforge.spec.light_field import LightFieldLimit
from lensforge.spec.part_section import BaseSection, DrawingSection, ManufactureSection, Tool
from lensforge.spec.peak_limit import PeakLimit
from lensforge.spec.picture_targets import ArrayTarget, ImageTarget, TableTarget, TextTarget
from lensforge.spec.receiver_fields import ReceiverSection
from lensforge.spec.reflector import CupSection, ReflectorSection
from lensforge.spec.screen_points import ScreenLimit
from lensforge.spec.search_section import ConstraintsSection, EvaluateSection, OptimiseSection
from lensforge.spec.target_sections import TargetSection

if TYPE_CHECKING:
    from lensforge.spec.design_spec import Spec, load_spec, parse_spec
else:

    def __getattr__(name: str) -> object:
        """Load the spec when it is asked for: it has tables of add-ons, whose modules begin with those of this room."""
        if name not in ("Spec", "load_spec", "parse_spec"):
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from lensforge.spec import design_spec

        return getattr(design_spec, name)


__all__ = [
    "Accuracy",
    "AnyAccuracy",
    "ArrayTarget",
    "BaseSection",
    "BeamTarget",
    "CameraTarget",
    "ConstraintsSection",
    "CrossTarget",
    "CupSection",
    "CutOffLimit",
    "DrawingSection",
    "EvaluateSection",
    "ExitFace",
    "ExtrudedSection",
    "ExtrudedTirSection",
    "FaceSection",
    "FlangeSection",
    "FlatTopTarget",
    "ImageTarget",
    "LensSection",
    "LightFieldLimit",
    "ManufactureSection",
    "OptimiseSection",
    "PeakLimit",
    "Preset",
    "ReceiverSection",
    "RectangleTarget",
    "ReflectorSection",
    "ScreenLimit",
    "Spec",
    "TableTarget",
    "TargetSection",
    "TextTarget",
    "TirSection",
    "Tool",
    "load_spec",
    "parse_spec",
]
