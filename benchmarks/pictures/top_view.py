"""A scenario from above, at a few moments of an undisturbed run, and what noise makes of it."""

from collections.abc import Iterator
from math import degrees

import numpy as np
from benchmarks.pictures.courses import Course, course
from benchmarks.pictures.svg import WIDTH, Point, box, dot, line, page, text, turned_box

from eigenfail.values.scene import VehicleState
from eigenfail_workers.measures.geometry import find_nearest

MOMENTS = 6
SEEN_STEPS = 10
EDGE, HEAD, CAPTION, SPACE, FOOT = 20.0, 40.0, 20.0, 24.0, 30.0
MARGIN_M, BAR_M, DASH_M = 8.0, 20.0, 6.0


class TopView:
    """The stretch of road around the truck, the same at each moment; to scale in both axes."""

    def __init__(self, scenario: str) -> None:
        self._scenario = scenario
        self._course = course(scenario)
        self._steps = np.linspace(0, self._course.last_step, MOMENTS).round().astype(int).tolist()
        behind_m, ahead_m = reach(self._course, self._steps)
        self._behind_m = behind_m
        self._scale = (WIDTH - 2.0 * EDGE) / (behind_m + ahead_m)  # [px/m]
        mission = self._course.mission
        self._road_px = mission.lanes * mission.lane_width_m * self._scale

    def picture(self) -> str:
        """A row for each moment, between the legend and the scale."""
        row = CAPTION + self._road_px + SPACE
        height = HEAD + MOMENTS * row + FOOT
        drawn = [*self._legend(), *self._bar(height - 18.0)]
        for number, step in enumerate(self._steps):
            drawn.extend(self._moment(step, HEAD + number * row))
        return page(height, f"{self._scenario}: the road from above", drawn)

    def _legend(self) -> Iterator[str]:
        yield text(Point(EDGE, 26.0), f"{self._scenario}, undisturbed")
        for x, css, words in ((220.0, "truck", "truck"), (300.0, "car", "car")):
            yield box(Point(x, 16.0), 18.0, 10.0, css)
            yield text(Point(x + 24.0, 26.0), words)
        yield dot(Point(374.0, 21.0))
        words = "nearest car as perceived under noise, in ten steps around each moment"
        yield text(Point(384.0, 26.0), words)

    def _bar(self, y: float) -> Iterator[str]:
        end = Point(EDGE + BAR_M * self._scale, y)
        yield line((Point(EDGE, y), end), "true")
        yield text(Point(end.x + 8.0, y + 4.0), f"{BAR_M:g} m, along and across")

    def _moment(self, step: int, top: float) -> Iterator[str]:
        ego, *others = self._course.vehicles(step)
        actor = others[find_nearest(ego, others)]
        yield text(Point(EDGE, top + 13.0), self._caption(step, ego, actor))
        yield from self._lanes(ego, top)
        for vehicle, css in ((ego, "truck"), *((other, "car") for other in others)):
            centre = self._place(ego, top, vehicle.x_m, vehicle.y_m)
            size = vehicle.length_m * self._scale, vehicle.width_m * self._scale
            yield turned_box(centre, *size, -degrees(vehicle.heading_rad), css)
        for dx_m, dy_m in self._noise(step):
            yield dot(self._place(ego, top, actor.x_m + dx_m, actor.y_m + dy_m))

    def _place(self, ego: VehicleState, top: float, x_m: float, y_m: float) -> Point:
        """Where a point of the road is drawn in the row that begins at `top`."""
        up_m = y_m + 0.5 * self._course.mission.lane_width_m
        across = top + CAPTION + self._road_px - up_m * self._scale
        return Point(EDGE + (x_m - ego.x_m + self._behind_m) * self._scale, across)

    def _caption(self, step: int, ego: VehicleState, actor: VehicleState) -> str:
        ahead_m = abs(actor.x_m - ego.x_m) - (ego.length_m + actor.length_m) / 2.0
        gap = f", {ahead_m:.0f} m between bumpers" if ahead_m > 0.0 else ", side by side"
        speeds = f"truck {ego.speed_mps:.1f} m/s, nearest car {actor.speed_mps:.1f} m/s"
        return f"{step * self._course.scene.dt_s:.1f} s: {speeds}{gap}"

    def _noise(self, step: int) -> list[list[float]]:
        """What is added to the nearest car's position in the steps around a moment [m]."""
        metres = self._course.noise.injected
        first = min(max(step - SEEN_STEPS // 2, 0), max(len(metres) - SEEN_STEPS, 0))
        metres_then: list[list[float]] = metres[first : first + SEEN_STEPS].tolist()
        return metres_then

    def _lanes(self, ego: VehicleState, top: float) -> Iterator[str]:
        """Every lane as far as it is seen, and the line between them."""
        mission = self._course.mission
        height = mission.lane_width_m * self._scale
        ends_x_m = mission.lane_0_ends_x_m
        for lane in range(mission.lanes):
            y_m = (lane + 0.5) * mission.lane_width_m
            corner = self._place(ego, top, ego.x_m - self._behind_m, y_m)
            end = WIDTH - EDGE
            if lane == 0 and ends_x_m is not None:
                end = min(end, self._place(ego, top, ends_x_m, y_m).x)
            if end > EDGE:
                yield box(corner, end - EDGE, height, "road")
        yield from self._dashes(ego, top)

    def _dashes(self, ego: VehicleState, top: float) -> Iterator[str]:
        """The line between lanes 0 and 1, fixed to the road."""
        y_m = 0.5 * self._course.mission.lane_width_m
        period_m = 2.0 * DASH_M
        begins_m = ego.x_m - self._behind_m
        seen_m = (WIDTH - 2.0 * EDGE) / self._scale
        first = begins_m + -begins_m % period_m
        for x_m in np.arange(first, begins_m + seen_m - DASH_M, period_m).tolist():
            ends = (self._place(ego, top, x, y_m) for x in (x_m, x_m + DASH_M))
            yield line(tuple(ends), "line")


def reach(shown: Course, steps: list[int]) -> tuple[float, float]:
    """How far behind and ahead of the truck's centre there is somebody at these moments [m]."""
    ends = [0.0]
    for ego, *others in map(shown.vehicles, steps):
        for one in (ego, *others):
            ends += [one.x_m - ego.x_m + side * one.length_m / 2.0 for side in (-1.0, 1.0)]
    return MARGIN_M - min(ends), MARGIN_M + max(ends)
