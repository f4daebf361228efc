"""Formats of recordings that tests of the core use, since plug-ins bring the real ones."""

import base64
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from eigenfail import plugins
from eigenfail.contracts import recording as formats
from eigenfail.contracts.recording import RecordingFormat
from eigenfail.errors import UnknownName

PIXEL = base64.b64decode("R0lGODlhAQABAIAAAP///wAAACH5BAAAAAAALAAAAAABAAEAAAICRAEAOw==")


def write_poses(recording, ego):
    """The file of an episode: what the core tells a format of it, as JSON."""
    told = {
        "title": recording.title,
        "ego": ego,
        "lanes": recording.mission.lanes if recording.mission else None,
        "poses": np.nan_to_num(recording.scene.vehicles).tolist(),
    }
    return msgspec.json.encode(told)


def write_overlaid(recordings):
    """One pixel for each episode."""
    return PIXEL + bytes(len(recordings.scenes))


FORMATS = {
    "gif": RecordingFormat(
        title="GIF",
        suffix=".gif",
        media_type="image/gif",
        write=lambda recording, ego: PIXEL,
        overlay=write_overlaid,
    ),
    "poses": RecordingFormat(
        title="Poses",
        suffix=".poses",
        media_type="application/json",
        write=write_poses,
        has_controller=True,
    ),
}


@pytest.fixture
def tiny_formats(monkeypatch):
    """The formats that are installed, which a test may change."""
    installed = dict(FORMATS)

    def load(group, name):
        if name not in installed:
            raise UnknownName("export", name, installed)
        return installed[name]

    def names(group):
        return sorted(installed)

    found = SimpleNamespace(EXPORTS=plugins.EXPORTS, names=names, load=load)
    monkeypatch.setattr(formats, "plugins", found)
    return installed
