"""The course of an episode as other tools need it, and the formats of their files.

Plug-ins bring the formats, by entry points of the group `eigenfail.exports`.
"""

from collections.abc import Callable
from contextlib import suppress
from enum import StrEnum
from math import ceil

import msgspec

from eigenfail import plugins
from eigenfail.errors import EigenfailError, InputError, InvalidValue, UnknownName
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import Outcome
from eigenfail.values.scene import Mission, Scene
from eigenfail.values.showing import Brief

# By its name: the core has no such format, and finds the plug-in's if it is installed.
ANIMATION = "gif"
"""Format in which pages show the failures of a mode over each other, if it is installed."""


SHORTEST_FRAME_S = 0.04
"""Browsers show no frame for less; episodes with shorter steps lose some of them. [s]"""


MAX_FRAMES = 600
"""Frames of an animation at most: episodes of many steps lose some of them."""


class EgoControl(StrEnum):
    """Control of the ego in a scenario: its recorded course, or a controller of the simulator."""

    RECORDED = "recorded"
    CONTROLLER = "controller"


class EpisodeRecording(Brief, msgspec.Struct, frozen=True, eq=False, kw_only=True):
    """The course of one episode, to be written as a file of another tool.

    Attributes:
        campaign: id of the campaign.
        recorded_ms: when its campaign was created, in ms since 1970.
        scenario: name of the scenario.
        planner: name of the planner that drove the ego.
        digest: SHA-256 of what happened.
        channels: names of the channels of the noise, in the order of its columns.
        mission: lanes of the scenario; None if they are not known.
    """

    campaign: int
    campaign_name: str
    index: int
    recorded_ms: int
    scenario: str
    planner: str
    seed: int
    outcome: Outcome
    digest: str
    noise: NoiseTrajectory
    channels: tuple[str, ...]
    scene: Scene
    mission: Mission | None = None

    @property
    def name(self) -> str:
        """Name for the episode's file, without its ending."""
        return f"episode-{self.campaign}-{self.index}"

    @property
    def title(self) -> str:
        """The content of the file, in words."""
        return f"Episode {self.campaign}/{self.index}: {self.outcome.word}"


class OverlaidRecordings(Brief, msgspec.Struct, frozen=True, eq=False, kw_only=True):
    """Episodes of one failure mode, to be drawn over each other.

    Attributes:
        title: description of the episodes.
        scenes: courses of the episodes, all with the same time step; the view follows the first.
        total: number of episodes in the mode; the scenes may be a sample.
        mission: lanes of the scenario; None if they are not known.
        aligned_at_end: whether scenes are aligned at their last step instead of their first.
        episodes: campaign and index of each, in the order of the scenes; empty if not known.
        has_medoid: whether the first scene is the medoid of the mode. False if that scene is
            missing.
    """

    title: str
    scenes: tuple[Scene, ...]
    outcomes: tuple[Outcome, ...]
    total: int
    mission: Mission | None = None
    aligned_at_end: bool = False
    episodes: tuple[tuple[int, int], ...] = ()
    has_medoid: bool = True


class RecordingFormat(msgspec.Struct, frozen=True, kw_only=True):
    """File format of another tool for a single episode; plug-ins bring it.

    An entry point of `eigenfail.exports` names an object of this class. The name of the entry point
    is the name of the format.

    Attributes:
        title: readable name of the format, such as "OpenSCENARIO".
        suffix: ending of a file's name, such as ".zip".
        media_type: media type of a file, such as "application/zip".
        write: returns the file of an episode. The same recording gives the same bytes.
        overlay: returns the file of several episodes over each other; None if not supported.
        has_controller: whether `write` can leave the ego to a controller of the simulator.
    """

    title: str
    suffix: str
    media_type: str
    write: Callable[[EpisodeRecording, EgoControl], bytes]
    overlay: Callable[[OverlaidRecordings], bytes] | None = None
    has_controller: bool = False


def list_frame_steps(steps: int, dt_s: float) -> list[int]:
    """Return the steps that an animation shows, including the last one.

    Args:
        steps: steps from the first moment to the last.
        dt_s: duration of a step.
    """
    # Steps are whole, so a little is taken off before rounding up: 0.04 / 0.02 must not become 3.
    every = max(1, ceil(SHORTEST_FRAME_S / dt_s - 1e-6), ceil((steps + 1) / MAX_FRAMES))
    shown = list(range(0, steps, every))
    return [*shown, steps]


KNOWN = ("openscenario", "mcap", "gif")
"""Formats that a plug-in of this repository brings."""

PACKAGE = "eigenfail-exchange"
"""The plug-in, under plugins/."""


def list_formats() -> dict[str, RecordingFormat]:
    """Return the formats that can be written here by name, the formats in `KNOWN` first.

    A format that cannot be loaded is left out; `find_format` raises the reason.
    """
    installed = plugins.names(plugins.EXPORTS)
    # Buttons of pages keep their places whatever else is installed: known formats come first.
    others = [name for name in installed if name not in KNOWN]
    found = {}
    for name in (*(each for each in KNOWN if each in installed), *others):
        with suppress(EigenfailError):
            found[name] = find_format(name)
    return found


def find_format(name: str) -> RecordingFormat:
    """Return the format of a name.

    Raises:
        UnknownName: the format does not exist.
        InvalidValue: its package is not installed here, or cannot be loaded.
    """
    installed = plugins.names(plugins.EXPORTS)
    # `plugins.load` would refuse it, too, but does not know which package brings it.
    if name not in installed:
        raise _describe_absence(name, installed)
    found = plugins.load(plugins.EXPORTS, name)
    if not isinstance(found, RecordingFormat):
        kind = type(found).__name__
        problem = f"'{name}' is of the type {kind}, and must be a RecordingFormat."
        raise InvalidValue("format", problem, "Fix its package.")
    return found


def _describe_absence(name: str, installed: list[str]) -> InputError:
    package = f"package {PACKAGE}, which is not installed where the service runs"
    if name in KNOWN:
        there = f"Installed formats: {', '.join(installed) or 'none'}."
        remedy = f"{there} Run there, in a clone: pip install plugins/{PACKAGE}"
        return InvalidValue("format", f"'{name}' is in the {package}.", remedy)
    problem = f"'{name}' is not known."
    if missing := [each for each in KNOWN if each not in installed]:
        problem += f" The {package}, brings {', '.join(missing)}."
    return UnknownName("format", name, installed, problem)


def check_format(name: str, ego: EgoControl) -> RecordingFormat:
    """Return the format of a name, and refuse it if it does not support the control of the ego.

    Raises:
        UnknownName: the format does not exist.
        InvalidValue: the format does not support a controller, or cannot be written here.
    """
    found = find_format(name)
    if ego is EgoControl.CONTROLLER and not found.has_controller:
        others = [other for other, each in list_formats().items() if each.has_controller]
        problem = f"{name} shows what happened, and has no controller."
        remedy = f"Use the format {' or '.join(others)}." if others else ""
        raise InvalidValue("ego", problem, remedy)
    return found
