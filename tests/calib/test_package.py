"""The package's head: every name is there, and none is imported before it is asked for."""

import subprocess
import sys

import pytest

import calib


def test_every_public_name_is_found_and_listed() -> None:
    assert all(getattr(calib, name).__module__.startswith("calib.") for name in calib.__all__)
    assert set(calib.__all__) <= set(dir(calib))


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="nothing"):
        _ = calib.nothing


def test_import_alone_brings_neither_arrays_nor_schemas() -> None:
    code = "import sys, calib; print(sorted({'numpy', 'scipy', 'pydantic'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
