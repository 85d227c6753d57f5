"""What is said where a library of an extra is missing, incomplete or broken."""

import sys

import pytest

from bspline_mdao.base.extras import library
from bspline_mdao.errors import InputError


def test_a_library_that_is_there_is_imported():
    assert library("json.decoder", "files need json", "files") is sys.modules["json.decoder"]


@pytest.mark.parametrize(
    ("otherwise", "expected"),
    [
        ("", 'wings need feathers: pip install "bspline_mdao[birds]"'),
        ("walk", 'wings need feathers: pip install "bspline_mdao[birds]", or walk'),
    ],
)
def test_the_extra_of_a_missing_library_is_named(otherwise, expected):
    with pytest.raises(InputError) as error:
        library("feathers.of_geese", "wings need feathers", "birds", otherwise)
    assert str(error.value) == expected


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("import down", "wings need feathers, which needs down: pip install down"),
        (
            "raise ImportError('libGL.so.1: no such file')",
            "wings need feathers, which is installed but cannot be imported: libGL.so.1: no such file",
        ),
    ],
)
def test_a_library_that_cannot_be_imported_is_not_called_missing(tmp_path, monkeypatch, source, expected):
    (tmp_path / "feathers.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(InputError) as error:
        library("feathers", "wings need feathers", "birds")
    assert str(error.value) == expected
