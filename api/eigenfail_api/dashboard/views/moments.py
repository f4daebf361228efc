"""Moments of an episode to which one may want to jump."""

from collections.abc import Iterator

import msgspec

from eigenfail.stories.moments import Notable
from eigenfail.values import EpisodeResult, Measures
from eigenfail_api.dashboard.views.scene import nearest_moment


class Jump(msgspec.Struct, frozen=True):
    """A moment: when, as the address has it, and what it is."""

    time: str
    words: str
    tone: str = ""


def jumps(result: EpisodeResult) -> tuple[Jump, ...]:
    """What was measured at moments, in the order of time."""
    found = [*measured(result.measures)] if result.measures else []
    if result.scene and not result.is_failure:
        found.append(Notable(nearest_moment(result.scene), "nearest"))
    return tuple(map(jump, sorted(found, key=lambda each: each.time_s)))


def measured(measures: Measures) -> Iterator[Notable]:
    """Thresholds that were passed, and the collision."""
    times = {
        "TTC below 1.5 s": measures.ttc_violated_s,
        "DRAC above 7 m/s²": measures.drac_violated_s,
        "left the road": measures.left_road_s,
        "collision": measures.collided_s,
    }
    for words, time_s in times.items():
        if time_s is not None:
            yield Notable(time_s, words)


def jump(found: Notable) -> Jump:
    """As it is shown."""
    tone = "bad" if found.words == "collision" else ""
    return Jump(f"{found.time_s:.1f}", found.words, tone)
