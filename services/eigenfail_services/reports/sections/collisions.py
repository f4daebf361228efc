"""A real collision of each mode from above: the medoid's, and where the planner saw the car."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import EpisodeResult, Scene
from eigenfail.values.report import Cell, ReportPicture, ReportSection
from eigenfail_services.reports import formats
from eigenfail_services.reports.analysed import MOST_MODES, Analysed, analysed
from eigenfail_services.reports.material import Material
from eigenfail_services.reports.parts import Drawing, Part, table
from eigenfail_services.reports.pictures import INK, MARKS, MUTED, Mark

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TABLE = "collisions"
SHOWN_S = 4.0
COLUMNS = (
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
WORDS = (
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
        """Where the planner saw the nearest vehicle, shape (moments - 1, 2). [m]"""
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


def part(material: Material) -> Part | None:
    """The medoids' collisions of every campaign that was analysed."""
    found = {each.name: (each, crashes(each)) for each in analysed(material)}
    shown = {name: (each, of) for name, (each, of) in found.items() if of}
    if not shown:
        return None
    rows = [row for each, of in shown.values() for crash in of for row in moments(each, crash)]
    section = ReportSection(
        name="collisions",
        title="A collision of each mode",
        words=(WORDS,),
        tables=(table(TABLE, "The end of the medoids' episodes", COLUMNS, rows),),
        pictures=tuple(picture(each, of) for each, of in shown.values()),
    )
    return Part(section, drawings={f"collisions-{n}": drawing(of) for n, (_, of) in shown.items()})


def crashes(found: Analysed) -> tuple[Crash, ...]:
    """The medoids of the largest modes, as far as their scenes were kept."""
    medoids = enumerate(found.medoids[:MOST_MODES], start=1)
    return tuple(
        crash(mode, medoid, medoid.scene) for mode, medoid in medoids if medoid.scene is not None
    )


def crash(mode: int, medoid: EpisodeResult, scene: Scene) -> Crash:
    """The end of an episode."""
    gaps = np.linalg.norm(scene.vehicles[-1, 1:, :2] - scene.vehicles[-1, 0, :2], axis=1)
    first = max(0, medoid.steps - round(SHOWN_S / scene.dt_s))
    return Crash(mode, medoid.index, scene, 1 + int(np.argmin(gaps)), first)


def moments(found: Analysed, of: Crash) -> Iterator[tuple[Cell, ...]]:
    """A row for each step shown."""
    vehicles, perceived = of.scene.vehicles, of.scene.perceived
    last = len(vehicles) - 1
    for step in range(of.first, last + 1):
        seen = perceived[step].tolist() if step < len(perceived) else (None, None)
        before_s = (last - step) * of.scene.dt_s
        pair = (*vehicles[step, 0].tolist(), *vehicles[step, of.struck].tolist())
        yield (found.subject.id, of.mode, of.episode, before_s, *pair, *seen)


def picture(found: Analysed, of: tuple[Crash, ...]) -> ReportPicture:
    """The collisions of a campaign, in words."""
    return ReportPicture(
        name=f"collisions-{found.name}",
        title=f"Collisions from above, campaign {found.subject.label}",
        alternative=" ".join(map(told, of)),
        table=TABLE,
        campaigns=(found.subject.id,),
        note=found.modes_note,
    )


def told(of: Crash) -> str:
    """Where the vehicles were, and how far off they were seen."""
    truck, actor = of.scene.vehicles[-1, 0], of.scene.vehicles[-1, of.struck]
    begin, end = of.actor[0], of.actor[-1]
    seen = of.perceived - of.actor[: len(of.perceived)]
    off = np.sqrt(np.mean(np.square(seen), axis=0)) if len(seen) else np.zeros(2)
    return (
        f"Mode {of.mode}, episode {of.episode}: truck at {formats.number(float(truck[3]))} m/s, "
        f"struck vehicle at {formats.number(float(actor[3]))} m/s; its centre moved from "
        f"{begin[0]:.1f} m ahead and {begin[1]:+.1f} m across to {end[0]:.1f} m and {end[1]:+.1f} "
        f"m; it was seen {off[0]:.1f} m off along and {off[1]:.1f} m across (root mean square)."
    )


def drawing(of: tuple[Crash, ...]) -> Drawing:
    """A strip for each mode."""

    def draw(figure: "Figure") -> None:
        strips = figure.subplots(len(of), 1, squeeze=False, sharex=True)[:, 0]
        for axes, crash in zip(strips, of, strict=True):
            strip(axes, crash)
        strips[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.18), ncols=4, borderaxespad=0.0)
        strips[-1].set_xlabel("along the road, from the truck's centre [m]")

    return Drawing(draw, 1.0 + 1.5 * len(of))


def strip(axes: "Axes", of: Crash) -> None:
    """One collision."""
    footprint(axes, of.box(0), MARKS[0], "truck")
    footprint(axes, of.box(of.struck), MARKS[1], "vehicle struck")
    for other in range(1, len(of.scene.sizes)):
        if other != of.struck:
            axes.fill(*of.box(other).T, facecolor="none", edgecolor=MUTED, linestyle=":")
    axes.plot(*of.actor.T, color=INK, linewidth=1.4, label="its way")
    axes.plot(
        *of.perceived.T,
        linestyle="none",
        marker="x",
        markersize=3.5,
        color=MARKS[3].colour,
        label="seen by the planner",
    )
    axes.set_title(f"mode {of.mode}: episode {of.episode}")
    axes.set_ylabel("across [m]")
    axes.set_aspect("equal", adjustable="datalim")


def footprint(axes: "Axes", corners: NDArray[np.float64], look: Mark, name: str) -> None:
    """A vehicle at the collision."""
    style: dict[str, Any] = {"edgecolor": look.colour, "hatch": look.hatch}
    axes.fill(*corners.T, facecolor="white", label=name, **style)
