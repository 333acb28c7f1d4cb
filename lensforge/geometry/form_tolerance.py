"""The record of a form tolerance on an optical face of the STEP file."""

from lensforge.records import Positive, Record, Text


class FormTolerance(Record):
    """The surface profile on ``face`` in the STEP file: ``width_um`` of its zone, half of it on each side of the face.

    ``datum_faces``: the faces in z = 0 that are datum A; empty where the body has none there.
    """

    face: Text
    width_um: Positive
    datum_faces: tuple[Text, ...]
