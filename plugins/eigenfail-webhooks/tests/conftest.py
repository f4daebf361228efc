"""What the tests of the plug-in share."""

from pathlib import Path

import pytest

PLUGIN = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def plugin():
    """The folder of the plug-in."""
    return PLUGIN
