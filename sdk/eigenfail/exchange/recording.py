"""The course of an episode as other tools need it, and what a format of their files is."""

from collections.abc import Callable
from enum import StrEnum
from math import ceil

import msgspec

from eigenfail.values import Mission, NoiseTrajectory, Outcome, Scene
from eigenfail.values.showing import Brief

ANIMATION = "gif"
"""Format in which pages show the failures of a mode over each other, if it is installed."""


SHORTEST_FRAME_S = 0.04
"""Browsers show no frame for less; episodes with shorter steps lose some of them. [s]"""


MAX_FRAMES = 600


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
        mission: lanes of the scenario; None where they are not known.
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
        """Name of the episode as that of a file, without its ending."""
        return f"episode-{self.campaign}-{self.index}"

    @property
    def title(self) -> str:
        """What the file shows, in words."""
        return f"Episode {self.campaign}/{self.index}: {self.outcome.word}"


class OverlaidRecordings(Brief, msgspec.Struct, frozen=True, eq=False, kw_only=True):
    """Episodes of one failure mode, to be drawn over each other.

    Attributes:
        title: what they are, in words.
        scenes: courses of the episodes, all with the same time step; the first is the one that
            the view follows.
        total: episodes of the mode, of which the scenes may be a sample.
        mission: lanes of the scenario; None where they are not known.
        aligned_at_end: whether they are aligned at their last step, and not at their first.
        episodes: campaign and index of each, in the order of the scenes; empty if not told.
        has_medoid: whether the first one is the medoid of the mode, whose scene may be missing.
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
    """Format of another tool in which a single episode is written; plug-ins bring it.

    An entry point of `eigenfail.exports` names an object of this class. Its own name is the name of
    the format.

    Attributes:
        title: name of the format for people, such as "OpenSCENARIO".
        suffix: ending of a file's name, such as ".zip".
        media_type: media type of a file, such as "application/zip".
        write: returns the file of an episode. The same recording gives the same bytes.
        overlay: returns the file of several episodes over each other; None: the format has none.
        has_controller: whether `write` can leave the ego to a controller of the simulator.
    """

    title: str
    suffix: str
    media_type: str
    write: Callable[[EpisodeRecording, EgoControl], bytes]
    overlay: Callable[[OverlaidRecordings], bytes] | None = None
    has_controller: bool = False


def list_frame_steps(steps: int, dt_s: float) -> list[int]:
    """Return the steps that an animation shows, the last one among them.

    Args:
        steps: steps from the first moment to the last.
        dt_s: time between two of them.
    """
    every = max(1, ceil(SHORTEST_FRAME_S / dt_s - 1e-6), ceil((steps + 1) / MAX_FRAMES))
    shown = list(range(0, steps, every))
    return [*shown, steps]
