"""Who is coming into the truck's lane: evidence with commitment, so that noise does not flicker."""

from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail.values import VehicleState
from eigenfail_workers.planners.rulebook.tracker import Track

Metres = Annotated[float, Meta(gt=0.0, le=10.0)]


class IntentSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the others' intent is judged.

    Attributes:
        preview_s: the lateral position is judged this far ahead.
        enter_m: nearer than this to the truck's line: evidence for.
        leave_m: farther than this: evidence against.
        commit: evidence at which a vehicle becomes the lead; it stays so until none is left.
        youngest_s: age below which a track is not judged.
    """

    preview_s: Annotated[float, Meta(ge=0.0, le=5.0)] = 1.0
    enter_m: Metres = 2.4
    leave_m: Metres = 2.8
    commit: Annotated[int, Meta(ge=1, le=100)] = 5
    youngest_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 1.5


def judge(track: Track, ego: VehicleState, dt_s: float, settings: IntentSettings) -> None:
    """Weigh one more step of a track, and commit to it as the lead or let it go."""
    if track.age * dt_s < settings.youngest_s:
        return
    across = track.across
    aside_m = abs(across.position_m - ego.y_m + settings.preview_s * across.velocity_mps)
    if aside_m < settings.enter_m:
        track.evidence = min(track.evidence + 1, settings.commit)
    elif aside_m > settings.leave_m:
        track.evidence = max(track.evidence - 1, 0)
    if track.evidence >= settings.commit:
        track.leads = True
    elif track.evidence == 0:
        track.leads = False
