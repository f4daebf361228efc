"""Animations: as many frames as there are moments, in real time, with what happened in them."""

import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_recordings import MISSION, STEPS, drive, record
from msgspec.structs import replace
from PIL import Image

from eigenfail.contracts.recording import (
    MAX_FRAMES,
    SHORTEST_FRAME_S,
    OverlaidRecordings,
    list_frame_steps,
)
from eigenfail.values.episode import Outcome
from eigenfail.values.scene import Scene
from eigenfail_exchange import animation

BLUE, RED = (37, 99, 200), (204, 36, 50)
NEAR = 12
"""How much a colour may differ: a picture has a palette."""


def open_frames(gif):
    """The frames of an animation as arrays, and their durations. [ms]"""
    frames, durations = [], []
    with Image.open(io.BytesIO(gif)) as picture:
        for number in range(picture.n_frames):
            picture.seek(number)
            durations.append(picture.info["duration"])
            frames.append(np.asarray(picture.convert("RGB"), np.int16))
    return frames, durations


def count(frame, colour):
    return int((np.abs(frame - colour).max(axis=2) <= NEAR).sum())


def road_scene(steps=STEPS, ahead_m=20.0, y_m=0.0):
    """A truck that closes in on a car ahead of it."""
    vehicles = np.zeros((steps + 1, 2, 4), np.float32)
    vehicles[:, 0, 0] = np.arange(steps + 1)
    vehicles[:, 1, 0] = ahead_m + 0.5 * np.arange(steps + 1)
    vehicles[:, :, 1] = y_m
    return Scene(
        dt_s=0.1,
        vehicles=vehicles,
        sizes=np.array([[16.0, 2.5], [5.0, 2.0]], np.float32),
        perceived=np.zeros((steps, 2), np.float32),
        controls=np.zeros((steps, 2), np.float32),
    )


def test_there_is_a_frame_for_each_moment():
    frames, durations = open_frames(animation.draw_episode(record(road_scene(), mission=MISSION)))
    assert len(frames) == STEPS + 1
    height, width, _ = frames[0].shape
    assert width == animation.WIDTH_PX
    assert animation.CAPTION_PX < height <= animation.MAX_HEIGHT_PX
    assert durations == [100] * STEPS + [round(1000 * animation.LAST_FRAME_S)]


@pytest.mark.parametrize(("outcome", "is_red"), [(Outcome.COLLISION, True), (Outcome.SAFE, False)])
def test_the_ego_turns_red_at_its_collision(outcome, is_red):
    frames, _ = open_frames(animation.draw_episode(record(road_scene(), outcome, MISSION)))
    blue, red = ([count(frame, colour) for frame in frames] for colour in (BLUE, RED))
    assert min(blue[:-1]) > 500
    assert max(red[:-1]) == 0
    assert (red[-1] > 500, blue[-1] > 500) == (is_red, not is_red)


def test_vehicles_that_are_not_there_are_not_drawn():
    scene = road_scene()
    scene.vehicles[5:, 1] = np.nan
    car = (110, 114, 124)
    frames, _ = open_frames(animation.draw_episode(record(scene, mission=MISSION)))
    assert count(frames[4], car) > count(frames[6], car) + 100


@given(steps=st.integers(1, 5_000), dt_s=st.floats(0.005, 2.0))
def test_frames_are_few_not_too_short_and_include_both_ends(steps, dt_s):
    drawn = list_frame_steps(steps, dt_s)
    gaps = np.diff(drawn)
    assert (drawn[0], drawn[-1]) == (0, steps)
    assert (gaps > 0).all()
    assert len(drawn) <= MAX_FRAMES + 1
    assert (gaps[:-1] * dt_s >= SHORTEST_FRAME_S - 1e-6).all()


@pytest.mark.parametrize("dt_s", [1 / 30, 1 / 24, 0.05, 0.125])
def test_an_animation_is_as_long_as_its_episode(dt_s):
    """GIF counts in 10 ms, which a step need not be a multiple of."""
    scene = replace(road_scene(steps=60), dt_s=dt_s)
    _, durations = open_frames(animation.draw_episode(record(scene, mission=MISSION)))
    shown_ms = np.cumsum(durations[:-1])
    wanted_ms = 1000 * dt_s * np.array(list_frame_steps(60, dt_s)[1:])
    assert shown_ms == pytest.approx(wanted_ms, abs=5.001)


def test_an_ego_alone_is_drawn():
    scene = road_scene()
    alone = replace(scene, vehicles=scene.vehicles[:, :1], sizes=scene.sizes[:1])
    frames, _ = open_frames(animation.draw_episode(record(alone, mission=MISSION)))
    assert min(count(frame, BLUE) for frame in frames[:-1]) > 500


def overlay(scenes, outcomes, **changes):
    return OverlaidRecordings(
        title="mode 1",
        scenes=tuple(scenes),
        outcomes=tuple(outcomes),
        total=9,
        mission=MISSION,
        **changes,
    )


def test_episodes_are_drawn_over_each_other():
    scenes = road_scene(), road_scene(steps=8, ahead_m=30.0, y_m=3.5)
    both = (Outcome.COLLISION, Outcome.COLLISION)
    alone, _ = open_frames(animation.draw_overlaid_episodes(overlay(scenes[:1], both[:1])))
    frames, _ = open_frames(animation.draw_overlaid_episodes(overlay(scenes, both)))
    assert len(frames) == STEPS + 1
    assert [count(frame, RED) > 0 for frame in alone] == [False] * STEPS + [True]
    # The shorter one ends first, and is in outline.
    assert [count(frame, RED) > 0 for frame in frames] == [False] * 8 + [True] * (STEPS - 7)
    assert count(frames[8], RED) < count(alone[-1], RED) / 2


def test_episodes_that_are_aligned_at_the_collision_end_together():
    scenes = road_scene(), road_scene(steps=8, y_m=3.5)
    both = (Outcome.COLLISION, Outcome.COLLISION)
    frames, _ = open_frames(
        animation.draw_overlaid_episodes(overlay(scenes, both, aligned_at_end=True))
    )
    assert [count(frame, RED) > 0 for frame in frames] == [False] * STEPS + [True]


def test_a_drive_without_a_known_road_is_drawn_as_well():
    recording = record(drive())
    frames, _ = open_frames(animation.draw_episode(recording))
    assert len(frames) == STEPS + 1
    assert animation.draw_episode(recording) == animation.draw_episode(recording)
