"""Animated GIFs of an episode, and of the episodes of a failure mode over each other."""

import io
import itertools
from collections.abc import Iterator, Sequence
from math import ceil, cos, isfinite, sin
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from eigenfail.contracts.recording import (
    EgoControl,
    EpisodeRecording,
    OverlaidRecordings,
    RecordingFormat,
    list_frame_steps,
)
from eigenfail.values.episode import Outcome
from eigenfail.values.scene import Scene
from eigenfail_exchange.road import StraightRoad, find_road, make_road

WIDTH_PX = 800


CAPTION_PX = 26


MAX_HEIGHT_PX = 600


FINEST = 2
"""Factor by which frames are drawn larger, and then made smaller: edges become smooth."""


LAST_FRAME_S = 2.0
"""How long the end of an episode is shown. [s]"""


VIEW_M, WIDEST_VIEW_M, MARGIN_M = 60.0, 160.0, 12.0
"""Length of road that is seen at least and at most, and free space around vehicles. [m]"""


Colour = tuple[int, int, int]
Point = tuple[float, float]


_PAPER: Colour = (247, 247, 248)
_ASPHALT: Colour = (222, 224, 228)
_PAINT: Colour = (150, 154, 162)
_INK: Colour = (40, 42, 48)
_EGO: Colour = (37, 99, 200)
_EGO_OF_OTHERS: Colour = (150, 180, 228)
_ACTOR: Colour = (110, 114, 124)
_ACTOR_OF_OTHERS: Colour = (186, 189, 196)
_SEEN: Colour = (226, 130, 20)
_BAD: Colour = (204, 36, 50)


class _Course(NamedTuple):
    """A scene in the animation.

    Attributes:
        starts: step of the animation at which it begins.
        is_main: whether the view follows it; the others are drawn in outline, below it.
    """

    scene: Scene
    outcome: Outcome
    starts: int
    is_main: bool

    @property
    def ends(self) -> int:
        """Step of the animation at which it ends."""
        return self.starts + len(self.scene.vehicles) - 1

    def find_step(self, step: int) -> int:
        """Return the step of the scene at a step of the animation: its end is kept."""
        return min(max(step - self.starts, 0), len(self.scene.vehicles) - 1)


class _View(NamedTuple):
    """Scale and position of the picture in metres.

    Attributes:
        scale: pixels per metre, of the picture that is made smaller at the end.
        behind_m: length of road that is seen behind the ego's centre.
        top_y_m: y of the upper edge.
    """

    scale: float
    behind_m: float
    top_y_m: float
    height: int

    def place(self, ego_x_m: float, x_m: float, y_m: float) -> Point:
        """Return the pixel of a point."""
        x = (x_m - ego_x_m + self.behind_m) * self.scale
        return x, (self.top_y_m - y_m) * self.scale


def draw_episode(recording: EpisodeRecording) -> bytes:
    """Return an animated GIF of an episode from above, in real time."""
    course = _Course(recording.scene, recording.outcome, 0, is_main=True)
    return _animate([course], find_road(recording), recording.title)


def draw_overlaid_episodes(recordings: OverlaidRecordings) -> bytes:
    """Return an animated GIF of episodes over each other.

    The view follows the first episode, which is drawn above the others.
    """
    lengths = [len(scene.vehicles) for scene in recordings.scenes]
    longest = max(lengths) if recordings.aligned_at_end else 0
    starts = [longest - length if longest else 0 for length in lengths]
    courses = [
        _Course(scene, outcome, start, is_main=number == 0)
        for number, (scene, outcome, start) in enumerate(
            zip(recordings.scenes, recordings.outcomes, starts, strict=True)
        )
    ]
    shown = len(courses)
    count = f"{shown} of {recordings.total}" if shown < recordings.total else str(shown)
    road = make_road(recordings.scenes, recordings.mission)
    return _animate(courses, road, f"{recordings.title}: {count} episodes")


def list_durations_ms(steps: Sequence[int], dt_s: float) -> list[int]:
    """Return how long each drawn step but the last is shown, in whole 10 ms. [ms]

    GIF times are multiples of 10 ms. Moments are rounded, not durations, so that errors do not add
    up.

    Args:
        steps: steps that are drawn.
        dt_s: time between two steps.
    """
    moments_ms = [10 * round(100 * step * dt_s) for step in steps]
    return [max(after - before, 20) for before, after in itertools.pairwise(moments_ms)]


def _animate(courses: Sequence[_Course], road: StraightRoad, title: str) -> bytes:
    dt_s = courses[0].scene.dt_s
    steps = list_frame_steps(max(course.ends for course in courses), dt_s)
    palette = _make_palette()
    frames = [
        frame.quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in _draw_frames(courses, road, title, steps)
    ]
    buffer = io.BytesIO()
    frames[0].save(
        buffer,
        "GIF",
        save_all=True,
        append_images=frames[1:],
        duration=[*list_durations_ms(steps, dt_s), round(1000 * LAST_FRAME_S)],
        loop=0,
        disposal=1,
    )
    return buffer.getvalue()


def _make_palette() -> Image.Image:
    """Return the colours of all frames and mixtures of any two, since edges are smooth."""
    colours = np.array(
        [
            _PAPER,
            _ASPHALT,
            _PAINT,
            _INK,
            _EGO,
            _EGO_OF_OTHERS,
            _ACTOR,
            _ACTOR_OF_OTHERS,
            _SEEN,
            _BAD,
        ],
        np.float64,
    )
    pairs = [(i, j) for i in range(len(colours)) for j in range(i + 1, len(colours))]
    mixed = [
        share * colours[i] + (1.0 - share) * colours[j]
        for i, j in pairs
        for share in (0.25, 0.5, 0.75)
    ]
    flat = np.concatenate([colours, mixed]).round().astype(np.uint8)
    picture = Image.new("P", (1, 1))
    picture.putpalette(flat.tobytes())
    return picture


def _draw_frames(
    courses: Sequence[_Course], road: StraightRoad, title: str, steps: Sequence[int]
) -> Iterator[Image.Image]:
    view = _find_view(courses, road)
    font = ImageFont.load_default(15 * FINEST)
    main = next(course for course in courses if course.is_main)
    below_first = sorted(courses, key=lambda course: course.is_main)
    for step in steps:
        picture = Image.new("RGB", (WIDTH_PX * FINEST, view.height * FINEST), _PAPER)
        pen = ImageDraw.Draw(picture)
        ego_x_m = _follow(main.scene, main.find_step(step))
        _draw_road(pen, view, ego_x_m, road)
        for course in below_first:
            _draw_course(pen, view, ego_x_m, course, step)
        _draw_caption(pen, font, view, title, step * main.scene.dt_s)
        yield picture.reduce(FINEST)


def _find_view(courses: Sequence[_Course], road: StraightRoad) -> _View:
    scene = next(course.scene for course in courses if course.is_main)
    places = scene.vehicles[..., :2].astype(np.float64)
    ahead_m = places[:, 1:, 0] - places[:, :1, 0]
    # An ego alone has no other vehicle: what is never there stands for one.
    ahead_m = np.pad(ahead_m, ((0, 0), (0, 1)), constant_values=np.nan)
    # Of each step the nearest vehicle is to be seen, and a part of the road around it.
    nearest = np.where(np.isfinite(ahead_m), np.abs(ahead_m), np.inf).argmin(axis=1)
    offsets_m = np.take_along_axis(ahead_m, nearest[:, None], axis=1)
    offsets_m = offsets_m[np.isfinite(offsets_m)]
    lowest = min(0.0, float(offsets_m.min(initial=0.0))) - MARGIN_M
    highest = max(0.0, float(offsets_m.max(initial=0.0))) + MARGIN_M
    length_m = min(max(highest - lowest, VIEW_M), WIDEST_VIEW_M)
    # The ego stays in the view also where the nearest vehicle is too far away to be seen.
    behind_m = min(max(0.5 * (length_m - lowest - highest), MARGIN_M), length_m - MARGIN_M)
    low_m, high_m = road.right_edge_y_m, road.left_edge_y_m
    for course in courses:
        y_m = course.scene.vehicles[..., 1]
        low_m, high_m = min(low_m, float(np.nanmin(y_m))), max(high_m, float(np.nanmax(y_m)))
    low_m, high_m = low_m - 3.0, high_m + 3.0
    scale = min(WIDTH_PX / length_m, (MAX_HEIGHT_PX - CAPTION_PX) / (high_m - low_m))
    height = ceil((high_m - low_m) * scale) + CAPTION_PX
    behind_m += 0.5 * (WIDTH_PX / scale - length_m)
    return _View(scale * FINEST, behind_m, high_m, height)


def _follow(scene: Scene, step: int) -> float:
    return float(scene.vehicles[step, 0, 0])


def _draw_road(pen: ImageDraw.ImageDraw, view: _View, ego_x_m: float, road: StraightRoad) -> None:
    seen_m = WIDTH_PX * FINEST / view.scale
    first_m, last_m = ego_x_m - view.behind_m, ego_x_m - view.behind_m + seen_m
    first_m, last_m = max(first_m, road.starts_x_m), min(last_m, road.ends_x_m)
    lane_0_ends_m = last_m if road.lane_0_ends_x_m is None else road.lane_0_ends_x_m
    for lane in range(road.lanes):
        ends_m = min(last_m, lane_0_ends_m) if lane == 0 else last_m
        if ends_m > first_m:
            low_m = road.right_edge_y_m + lane * road.lane_width_m
            upper = view.place(ego_x_m, first_m, low_m + road.lane_width_m)
            pen.rectangle([upper, view.place(ego_x_m, ends_m, low_m)], fill=_ASPHALT)
    for edge in range(road.lanes + 1):
        y_m = road.right_edge_y_m + edge * road.lane_width_m
        ends_m = min(last_m, lane_0_ends_m) if edge == 0 else last_m
        is_outer = edge in (0, road.lanes)
        # Dashes are painted on the road: they pass by as the view moves on.
        starts = [first_m] if is_outer else np.arange(first_m // 10.0 * 10.0, ends_m, 10.0)
        for start_m in starts:
            end_m = ends_m if is_outer else start_m + 4.0
            line = [view.place(ego_x_m, start_m, y_m), view.place(ego_x_m, end_m, y_m)]
            pen.line(line, fill=_PAINT, width=2 * FINEST)


def _draw_course(
    pen: ImageDraw.ImageDraw, view: _View, ego_x_m: float, course: _Course, step: int
) -> None:
    scene, at = course.scene, course.find_step(step)
    has_collided = course.outcome is Outcome.COLLISION and step >= course.ends
    for number in range(len(scene.sizes) - 1, -1, -1):
        state = scene.vehicles[at, number]
        if not np.isfinite(state[:3]).all():
            continue
        corners = [
            view.place(ego_x_m, *corner) for corner in _find_corners(state, scene.sizes[number])
        ]
        is_hit = has_collided and number == 0
        # An outline that a polygon draws is made by way of a mask of the whole picture: slowly.
        closed = [*corners, corners[0]]
        if course.is_main:
            pen.polygon(corners, fill=_BAD if is_hit else _ACTOR if number else _EGO)
            pen.line(closed, fill=_INK, width=FINEST)
        else:
            outline = _BAD if is_hit else _ACTOR_OF_OTHERS if number else _EGO_OF_OTHERS
            pen.line(closed, fill=outline, width=2 * FINEST if is_hit else FINEST)
    if course.is_main and at < len(scene.perceived):
        _draw_perceived(pen, view, ego_x_m, *map(float, scene.perceived[at]))


def _find_corners(state: np.ndarray, size: np.ndarray) -> Iterator[Point]:
    x_m, y_m, heading_rad = map(float, state[:3])
    length_m, width_m = map(float, size)
    for ahead, left in ((0.5, 0.5), (0.5, -0.5), (-0.5, -0.5), (-0.5, 0.5)):
        along, across = ahead * length_m, left * width_m
        yield (
            x_m + along * cos(heading_rad) - across * sin(heading_rad),
            y_m + along * sin(heading_rad) + across * cos(heading_rad),
        )


def _draw_perceived(
    pen: ImageDraw.ImageDraw, view: _View, ego_x_m: float, x_m: float, y_m: float
) -> None:
    if isfinite(x_m) and isfinite(y_m):
        x, y = view.place(ego_x_m, x_m, y_m)
        radius = 5 * FINEST
        box = [x - radius, y - radius, x + radius, y + radius]
        pen.ellipse(box, outline=_SEEN, width=2 * FINEST)


def _draw_caption(
    pen: ImageDraw.ImageDraw,
    font: ImageFont.FreeTypeFont | ImageFont.ImageFont,
    view: _View,
    title: str,
    time_s: float,
) -> None:
    top = (view.height - CAPTION_PX) * FINEST
    pen.rectangle([0, top, WIDTH_PX * FINEST, view.height * FINEST], fill=_PAPER)
    pen.text((8 * FINEST, top + 3 * FINEST), title, fill=_INK, font=font)
    clock = f"{time_s:.2f} s"
    width = pen.textlength(clock, font=font)
    pen.text(
        (WIDTH_PX * FINEST - 8 * FINEST - width, top + 3 * FINEST), clock, fill=_INK, font=font
    )


def _write(recording: EpisodeRecording, ego: EgoControl) -> bytes:  # noqa: ARG001 - the contract's
    return draw_episode(recording)


GIF = RecordingFormat(
    title="GIF",
    suffix=".gif",
    media_type="image/gif",
    write=_write,
    overlay=draw_overlaid_episodes,
)
