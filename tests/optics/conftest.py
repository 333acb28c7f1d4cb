"""Pictures by their bytes: their light, or the line with which they are refused."""

import pytest

from lensforge.errors import InputError
from lensforge.optics.image_reading import read_light


@pytest.fixture
def light(tmp_path):
    def read(content, luminance="as_stored"):
        path = tmp_path / "picture"
        path.write_bytes(content)
        return read_light(path, luminance, missing="give one")

    return read


@pytest.fixture
def refused(light):
    def line(content, luminance="as_stored"):
        with pytest.raises(InputError) as caught:
            light(content, luminance)
        assert "\n" not in str(caught.value) and len(str(caught.value)) < 400
        return str(caught.value)

    return line
