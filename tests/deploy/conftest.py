"""The recipes, as they are read; the manifests, as kubectl builds them."""

import sys
from pathlib import Path

import pytest
import yaml

sys.path.append(str(Path(__file__).parent))

from composed import with_defaults
from manifests import DEPLOY, OVERLAYS, built


@pytest.fixture(scope="session")
def services():
    """Those of the compose file."""
    return yaml.safe_load(with_defaults((DEPLOY / "compose.yaml").read_text()))["services"]


@pytest.fixture(params=OVERLAYS)
def overlay(request):
    """All objects of an overlay: a copy, to be changed."""
    return built(request.param)


@pytest.fixture
def trial():
    """All objects of the overlay that brings everything along: a copy, to be changed."""
    return built("trial")
