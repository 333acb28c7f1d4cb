"""Readers of photometric files that share no code with ours.

photompy 0.3.1 reads LM-63-1995, 2002 and 2019, and EULUMDAT without symmetry codes. What it does not read, LM-63-1986
and 1991 and TM-33, is read here by position and by element, after the standards.
"""

import xml.etree.ElementTree as ET

import numpy as np
import photompy


def by_photompy(path):
    """C, gamma and candela, and the lumens of the lamp; C closed at 360."""
    read = photompy.LDTFile.read(path) if path.suffix == ".ldt" else photompy.IESFile.read(path)
    c, candela = np.asarray(read.photometry.phis, float), np.asarray(read.photometry.values, float)
    if len(c) > 1 and c[-1] != 360.0:
        c, candela = np.append(c, 360.0), np.concatenate([candela, candela[:1]])
    lumens = read.header.lamps[0].total_flux if path.suffix == ".ldt" else read.header.lumens_per_lamp
    return c, np.asarray(read.photometry.thetas, float), candela, lumens, read


def by_position(path):
    """The numbers of LM-63 below TILT=, in the order that all its editions have."""
    numbers = [float(word) for word in path.read_text(encoding="ascii").split("TILT=NONE")[1].split()]
    v, h = int(numbers[3]), int(numbers[4])
    assert numbers[5] == 1.0 and len(numbers) == 13 + v + h + v * h
    candela = np.reshape(numbers[13 + v + h :], (h, v)) * numbers[2] * numbers[10]
    return np.array(numbers[13 + v : 13 + v + h]), np.array(numbers[13 : 13 + v]), candela, numbers[1]


def by_element(path):
    """The intensities of TM-33, and the lumens of its emitter."""
    emitter = ET.parse(path).getroot().find("Emitter")
    intensity = emitter.find("LuminousData").find("LuminousIntensity")
    data = {
        (float(element.get("h")), float(element.get("v"))): float(element.text)
        for element in intensity.findall("IntData")
    }
    h, v = (sorted({pair[axis] for pair in data}) for axis in (0, 1))
    counts = [int(intensity.find(name).text) for name in ("NumberHorz", "NumberVert", "NumberMeasured")]
    assert counts == [len(h), len(v), len(data)]
    rated = emitter.find("RatedLumens")
    absolute = intensity.find("AbsolutePhotometry").text == "true"
    assert absolute == (rated is None)
    stated = float(emitter.find("LuminousData").find("LuminousFlux").text)
    candela = np.array([[data[plane, angle] for angle in v] for plane in h])
    return np.array(h), np.array(v), candela, -1.0 if absolute else float(rated.text), stated
