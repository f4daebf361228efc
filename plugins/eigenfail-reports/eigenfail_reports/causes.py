"""Collisions, and when noise matters: what leads to a failure."""

from collections.abc import Iterator, Sequence
from math import isnan
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenfail.presentation import svg
from eigenfail.presentation.figures import format_number, format_share
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.scene import Scene
from eigenfail_reports import page
from eigenfail_reports.contents import Cell, ReportPicture
from eigenfail_reports.material import (
    MOST_MODES,
    Analysed,
    Material,
    arrange_by_channel,
    list_analysed,
    list_channels,
)
from eigenfail_services.analysis.footprints import find_struck

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


COLLISIONS_TABLE = "collisions"


SHOWN_S = 4.0


COLLISIONS_COLUMNS = (
    ("campaign", "Campaign"),
    ("mode", "Mode"),
    ("episode", "Episode"),
    ("time_s", "Time before the collision", "s"),
    ("truck_x_m", "Truck x", "m"),
    ("truck_y_m", "Truck y", "m"),
    ("truck_heading_rad", "Truck heading", "rad"),
    ("truck_speed_mps", "Truck speed", "m/s"),
    ("actor_x_m", "Actor x", "m"),
    ("actor_y_m", "Actor y", "m"),
    ("actor_heading_rad", "Actor heading", "rad"),
    ("actor_speed_mps", "Actor speed", "m/s"),
    ("perceived_x_m", "Perceived x", "m"),
    ("perceived_y_m", "Perceived y", "m"),
)


COLLISIONS_WORDS = (
    f"The last {SHOWN_S:g} s before the collision of each mode's medoid, a failure that happened "
    "in simulation. Positions are relative to the centre of the truck at each moment, so that the "
    "truck stands still: the solid line is the way of the vehicle that was struck, crosses are "
    "where the planner saw the nearest vehicle. Both axes have one scale."
)


class Crash(NamedTuple):
    """The end of an episode, relative to the truck's centre.

    Attributes:
        mode: counted from 1.
        struck: which vehicle.
        first: the first step shown.
    """

    mode: int
    episode: int
    scene: Scene
    struck: int
    first: int

    @property
    def actor(self) -> NDArray[np.float64]:
        """Positions of the vehicle that was struck, shape (moments, 2). [m]"""
        return self._relative(self.struck)[self.first :]

    @property
    def perceived(self) -> NDArray[np.float64]:
        """Perceived positions of the nearest vehicle, shape (moments - 1, 2). [m]"""
        truck = self.scene.vehicles[: len(self.scene.perceived), 0, :2]
        return (self.scene.perceived - truck).astype(np.float64)[self.first :]

    def box(self, vehicle: int) -> NDArray[np.float64]:
        """The corners of a vehicle's footprint at the collision, shape (4, 2). [m]"""
        heading = float(self.scene.vehicles[-1, vehicle, 2])
        turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
        corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * self.scene.sizes[vehicle] / 2.0
        return np.asarray(corners @ turn.T + self._relative(vehicle)[-1], np.float64)

    def _relative(self, vehicle: int) -> NDArray[np.float64]:
        vehicles = self.scene.vehicles
        return (vehicles[:, vehicle, :2] - vehicles[:, 0, :2]).astype(np.float64)


def make_collisions(material: Material) -> page.ReportPart | None:
    """The medoids' collisions of every campaign that was analysed."""
    found = [(each, find_crashes(each)) for each in list_analysed(material)]
    shown = [(each, crashes) for each, crashes in found if crashes]
    if not shown:
        return None
    rows: list[tuple[Cell, ...]] = []
    for each, crashes in shown:
        for crash in crashes:
            rows += list_moment_rows(each, crash)
    return page.ReportPart(
        name="collisions",
        title="A collision of each mode",
        words=(COLLISIONS_WORDS,),
        tables=(
            page.make_table(
                COLLISIONS_TABLE, "The end of the medoids' episodes", COLLISIONS_COLUMNS, rows
            ),
        ),
        pictures=tuple(
            (describe_collisions_picture(each, crashes), draw_collisions(crashes))
            for each, crashes in shown
        ),
    )


def find_crashes(found: Analysed) -> tuple[Crash, ...]:
    """Return the medoids of the largest modes that collided, and whose scenes were kept."""
    medoids = enumerate(found.medoids[:MOST_MODES], start=1)
    return tuple(
        make_crash(mode, medoid, medoid.scene)
        for mode, medoid in medoids
        if medoid.scene is not None and medoid.outcome is Outcome.COLLISION
    )


def make_crash(mode: int, medoid: EpisodeResult, scene: Scene) -> Crash:
    """Return the end of an episode."""
    first = max(0, medoid.steps - round(SHOWN_S / scene.dt_s))
    return Crash(mode, medoid.index, scene, find_struck(scene), first)


def list_moment_rows(found: Analysed, of: Crash) -> Iterator[tuple[Cell, ...]]:
    """Yield a row for each step of the influence table."""
    vehicles, perceived = of.scene.vehicles, of.scene.perceived
    last = len(vehicles) - 1
    for step in range(of.first, last + 1):
        seen = _read_position(perceived[step]) if step < len(perceived) else (None, None)
        before_s = (last - step) * of.scene.dt_s
        pair = map(_read_number, (*vehicles[step, 0].tolist(), *vehicles[step, of.struck].tolist()))
        yield (found.subject.id, of.mode, of.episode, before_s, *pair, *seen)


def _read_number(value: float) -> float | None:
    """Return a number of a vehicle's state; None while the vehicle is not there."""
    return None if isnan(value) else value


def _read_position(seen: NDArray[np.float32]) -> tuple[float | None, float | None]:
    """Return a perceived position; None if the vehicle was not detected."""
    x_m, y_m = seen.tolist()
    return (None, None) if isnan(x_m) else (x_m, y_m)


def describe_collisions_picture(found: Analysed, of: tuple[Crash, ...]) -> ReportPicture:
    """The collisions of a campaign, in words."""
    return ReportPicture(
        name=f"collisions-{found.name}",
        title=f"Collisions from above, campaign {found.subject.label}",
        alternative=" ".join(map(describe_collisions, of)),
        table=COLLISIONS_TABLE,
        campaigns=(found.subject.id,),
        note=found.modes_note,
    )


def describe_collisions(of: Crash) -> str:
    """Return the motion of the vehicles, and the errors of the perceived positions, as text."""
    truck, actor = of.scene.vehicles[-1, 0], of.scene.vehicles[-1, of.struck]
    there = of.actor[~np.isnan(of.actor[:, 0])]
    begin, end = there[0], there[-1]
    off_m = of.perceived - of.actor[: len(of.perceived)]
    seen = off_m[~np.isnan(off_m[:, 0])]
    off = np.sqrt(np.mean(np.square(seen), axis=0)) if len(seen) else np.zeros(2)
    seen_off = (
        f"it was seen {off[0]:.1f} m off along and {off[1]:.1f} m across (root mean square)."
        if len(seen)
        else "it was not detected."
    )
    return (
        f"Mode {of.mode}, episode {of.episode}: truck at {format_number(float(truck[3]))} m/s, "
        f"struck vehicle at {format_number(float(actor[3]))} m/s; its centre moved from "
        f"{begin[0]:.1f} m ahead and {begin[1]:+.1f} m across to {end[0]:.1f} m and {end[1]:+.1f} "
        f"m; {seen_off}"
    )


def draw_collisions(of: tuple[Crash, ...]) -> svg.Drawing:
    """A strip for each mode."""

    def draw(figure: "Figure") -> None:
        strips = figure.subplots(len(of), 1, squeeze=False, sharex=True)[:, 0]
        for axes, crash in zip(strips, of, strict=True):
            strip(axes, crash)
        strips[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.18), ncols=4, borderaxespad=0.0)
        strips[-1].set_xlabel("along the road, from the truck's centre [m]")

    return svg.Drawing(draw, 1.0 + 1.5 * len(of))


def strip(axes: "Axes", of: Crash) -> None:
    """One collision."""
    draw_footprint(axes, of.box(0), svg.MARKS[0], "truck")
    draw_footprint(axes, of.box(of.struck), svg.MARKS[1], "vehicle struck")
    for other in range(1, len(of.scene.sizes)):
        if other != of.struck and not np.isnan(of.box(other)).any():
            axes.fill(*of.box(other).T, facecolor="none", edgecolor=svg.MUTED, linestyle=":")
    axes.plot(*of.actor.T, color=svg.INK, linewidth=1.4, label="its way")
    axes.plot(
        *of.perceived.T,
        linestyle="none",
        marker="x",
        markersize=3.5,
        color=svg.MARKS[3].colour,
        label="seen by the planner",
    )
    axes.set_title(f"mode {of.mode}: episode {of.episode}")
    axes.set_ylabel("across [m]")
    axes.set_aspect("equal", adjustable="datalim")


def draw_footprint(axes: "Axes", corners: NDArray[np.float64], look: svg.Mark, name: str) -> None:
    """Draw a vehicle at the collision."""
    style: dict[str, Any] = {"edgecolor": look.colour, "hatch": look.hatch}
    axes.fill(*corners.T, facecolor="white", label=name, **style)


INFLUENCE_TABLE = "influence"


INFLUENCE_WORDS = (
    "The influence of a step is the size of its entries in the components, each weighted with the "
    "variance that it explains. Where it is large, failures differ most in their noise."
)


def make_influence(material: Material) -> page.ReportPart | None:
    """The influence of every campaign that was analysed."""
    found = [each for each in list_analysed(material) if each.result.influence.any()]
    if not found:
        return None
    channels = list_channels(found)
    columns = (
        ("campaign", "Campaign"),
        ("step", "Step"),
        ("time_s", "Time", "s"),
        *((channel, f"{channel.capitalize()} influence") for channel in channels),
    )
    rows = [row for each in found for row in list_influence_steps(each, channels)]
    return page.ReportPart(
        name="influence",
        title="Influence over time",
        words=(
            INFLUENCE_WORDS,
            *(sentence for each in found for sentence in describe_influence(each)),
        ),
        tables=(page.make_table(INFLUENCE_TABLE, "Influence of each step", columns, rows),),
        pictures=tuple((describe_influence_picture(each), draw_influence(each)) for each in found),
    )


def describe_influence(found: Analysed) -> Iterator[str]:
    """The moments that matter most, in seconds before the collision."""
    channels = found.result.channels
    moments = [*filter(None, (describe_moments(found, channel) for channel in channels))]
    if moments:
        yield f"Campaign {found.subject.id}, seconds before the collision: {'; '.join(moments)}."
    shares = [
        f"the last {each.seconds:g} s are {format_share(each.time)} of the time and hold "
        f"{format_share(each.both)} of the influence"
        for each in found.result.before_collision
    ]
    if shares:
        yield f"Campaign {found.subject.id}, before the collision: {'; '.join(shares)}."


def describe_moments(found: Analysed, channel: str) -> str:
    """Return the moments of a channel as text; empty if none is known."""
    known = [
        format_number(each.before_collision_s)
        for each in found.result.moments
        if each.axis == channel and each.before_collision_s is not None
    ]
    return f"{channel} noise matters most at {', '.join(known)}" if known else ""


def list_positions(found: Analysed) -> NDArray[np.float64]:
    """Return the time of each step [s], or its number if the duration of a step is unknown.

    From the start, or to the collision if the failures stand side by side there.
    """
    steps = np.arange(len(found.result.influence), dtype=float)
    origin = len(steps) if found.at_collision else 0
    return (steps - origin) * (found.step_s or 1.0)


def title_axis(found: Analysed) -> str:
    """Return the title of the time axis."""
    unit = "time [s]" if found.step_s else "step"
    return f"{unit}; 0 is the collision" if found.at_collision else unit


def list_influence_steps(found: Analysed, channels: Sequence[str]) -> Iterator[tuple[Cell, ...]]:
    """A row for each step."""
    for step, (at, weights) in enumerate(
        zip(list_positions(found), found.result.influence.astype(float), strict=True)
    ):
        time_s = float(at) if found.step_s else None
        cells = [(float(weight),) for weight in weights]
        placed = arrange_by_channel(cells, found.result.channels, channels)
        yield (found.subject.id, step, time_s, *placed)


def describe_influence_picture(found: Analysed) -> ReportPicture:
    """When noise matters, in words."""
    at, weights = list_positions(found), found.result.influence
    sentences = (
        f"{channel} influence is largest at "
        f"{describe_position(found, float(at[int(np.argmax(weights[:, way]))]))}"
        for way, channel in found.drawn_channels
    )
    return ReportPicture(
        name=f"influence-{found.name}",
        title=f"Influence over time, campaign {found.subject.label}",
        alternative=f"{'; '.join(sentences)}.".capitalize(),
        table=INFLUENCE_TABLE,
        campaigns=(found.subject.id,),
        note=found.channels_note,
    )


def describe_position(found: Analysed, at: float) -> str:
    """Return a position on the time axis as text."""
    return f"{format_number(at)} s" if found.step_s else f"step {at:g}"


def draw_influence(found: Analysed) -> svg.Drawing:
    """A line for each channel."""

    def draw(figure: "Figure") -> None:
        axes = figure.subplots()
        for place, (way, channel) in enumerate(found.drawn_channels):
            look = svg.pick_mark(place)
            axes.plot(
                list_positions(found),
                found.result.influence[:, way],
                color=look.colour,
                linestyle=look.line,
                label=channel,
            )
        axes.set_xlabel(title_axis(found))
        axes.set_ylabel("influence")
        axes.set_ylim(bottom=0.0)
        page.draw_legend(axes, page.count_panels_beside(len(found.drawn_channels)))

    return svg.Drawing(draw, 2.8)
