"""What the tests of the plug-in share."""

from pathlib import Path

import pytest
from golden import Golden

PLUGIN = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def plugin():
    """The folder of the plug-in."""
    return PLUGIN


@pytest.fixture(scope="session")
def golden(pytestconfig):
    """The golden files of the plug-in."""
    return Golden(pytestconfig.getoption("--update"), PLUGIN / "tests" / "golden")
