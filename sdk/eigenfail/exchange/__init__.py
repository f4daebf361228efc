"""Episodes as files of other tools: OpenSCENARIO and OpenDRIVE, MCAP with Foxglove's schemas, GIF.

Each writer turns one frozen value, an `EpisodeRecording` or the `OverlaidRecordings` of several
episodes, into the bytes of a file; the same value gives the same bytes.
"""

from collections.abc import Callable, Mapping
from importlib.util import find_spec

from eigenfail.errors import InvalidValue
from eigenfail.exchange.animation import draw_episode
from eigenfail.exchange.mcap_log import write_mcap
from eigenfail.exchange.open_scenario import write_open_scenario
from eigenfail.exchange.recording import EgoControl, EpisodeRecording, RecordingFormat

PACKAGES: Mapping[RecordingFormat, tuple[str, ...]] = {
    RecordingFormat.OPENSCENARIO: (),
    RecordingFormat.MCAP: ("mcap", "mcap_protobuf", "foxglove_schemas_protobuf"),
    RecordingFormat.GIF: ("PIL",),
}
"""Modules without which a format cannot be written."""


_WRITERS: Mapping[RecordingFormat, Callable[[EpisodeRecording], bytes]] = {
    RecordingFormat.OPENSCENARIO: write_open_scenario,
    RecordingFormat.MCAP: write_mcap,
    RecordingFormat.GIF: draw_episode,
}


MAX_POSES = 200_000
"""Vehicles times steps of an episode that is written: a file is made in memory as a whole."""


def write_recording(
    recording: EpisodeRecording, form: RecordingFormat, ego: EgoControl = EgoControl.RECORDED
) -> bytes:
    """Return the file of an episode.

    Args:
        recording: the episode.
        form: format of the file.
        ego: whether the ego repeats its course or is left to a controller; OpenSCENARIO alone.

    Raises:
        InvalidValue: the format leaves nothing to a controller, its packages are not installed, or
            the episode is too long.
    """
    check_recording(form, ego)
    steps, vehicles = recording.scene.vehicles.shape[:2]
    if steps * vehicles > MAX_POSES:
        problem = f"It has {steps} steps of {vehicles} vehicles: {steps * vehicles} poses."
        raise InvalidValue("episode", problem, f"At most {MAX_POSES} are written.")
    if ego is EgoControl.RECORDED:
        return _WRITERS[form](recording)
    return write_open_scenario(recording, ego)


def check_recording(form: RecordingFormat, ego: EgoControl) -> None:
    """Refuse what cannot be written of any episode here.

    Raises:
        InvalidValue: the format leaves nothing to a controller, or its packages are not installed.
    """
    require_packages(form)
    if ego is not EgoControl.RECORDED and form is not RecordingFormat.OPENSCENARIO:
        problem = f"{form} shows what happened, and has no controller."
        raise InvalidValue("ego", problem, "Use the format openscenario.")


def require_packages(form: RecordingFormat) -> None:
    """Refuse a format whose packages are not installed here.

    Raises:
        InvalidValue: one of them is missing.
    """
    missing = [name for name in PACKAGES[form] if find_spec(name) is None]
    if missing:
        problem = f"{form} needs {missing[0]}, which is not installed where the service runs."
        remedy = "Run there, in a clone: pip install '.[exchange]'; openscenario needs nothing."
        raise InvalidValue("format", problem, remedy)


def list_formats() -> tuple[RecordingFormat, ...]:
    """Return the formats that can be written here."""
    return tuple(form for form, names in PACKAGES.items() if all(map(find_spec, names)))
