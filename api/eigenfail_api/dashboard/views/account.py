"""What the planner says of an episode, for the player and for people."""

from collections.abc import Sequence

import msgspec

from eigenfail.errors import EigenfailError
from eigenfail.stories.moments import notable
from eigenfail.values import ExplainedStep, Explanation, Mission
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.charts import Chart, rounded
from eigenfail_api.dashboard.views.moments import Jump, jump
from eigenfail_api.dashboard.views.scene import clearance_chart, scene_chart

WORDS = ("mode", "rule", "candidate", "override", "heeds")
FIGURES = ("gap_m", "closing_mps")


class AccountView(msgspec.Struct, frozen=True, kw_only=True):
    """The part of the episode's page that comes later.

    Attributes:
        problem: why there is no account; the rest is empty then.
        is_same: whether the replay was the stored episode, bit for bit.
        steps: for the player; None where the account is of another course than the one shown.
        scene: of the replay, where the stored episode kept none.
        clearance: the strip of that scene.
    """

    campaign: int
    campaign_name: str
    index: int
    problem: str = ""
    is_same: bool = True
    verdict: str = ""
    note: str = ""
    story: tuple[str, ...] = ()
    jumps: tuple[Jump, ...] = ()
    steps: dict[str, object] | None = None
    scene: Chart | None = None
    clearance: Chart | None = None


def account_view(
    campaign: int, name: str, index: int, told: Explanation, mission: Mission | None
) -> AccountView:
    """The account of an episode."""
    same = told.replayed.same
    return AccountView(
        campaign=campaign,
        campaign_name=name,
        index=index,
        is_same=same,
        verdict=told.verdict,
        note=told.note,
        story=tuple(map(formats.signed, told.story)),
        jumps=tuple(map(jump, notable(told.steps))) if same else (),
        steps=for_player(told.steps) if same else None,
        scene=scene_chart(told.scene, mission, told.replayed.outcome) if told.scene else None,
        clearance=clearance_chart(told.scene) if told.scene else None,
    )


def no_account(campaign: int, name: str, index: int, error: EigenfailError) -> AccountView:
    """Why there is none."""
    problem = f"{error.problem} {error.remedy}".strip()
    return AccountView(campaign=campaign, campaign_name=name, index=index, problem=problem)


def for_player(steps: Sequence[ExplainedStep]) -> dict[str, object]:
    """Columns by name, a value for each step: words, figures, and the path as x, y, x, y …"""
    words = {name: [str(step.account.get(name, "")) for step in steps] for name in WORDS}
    figures = {name: rounded(figure(step, name) for step in steps) for name in FIGURES}
    truth = {
        "true_gap_m": rounded(step.gap_m for step in steps),
        "true_closing_mps": rounded(step.closing_mps for step in steps),
    }
    paths = [rounded(value for point in step.path for value in point) for step in steps]
    return {**words, **figures, **truth, "path": paths}


def figure(step: ExplainedStep, name: str) -> float | None:
    """A figure of the account; None where it has none of that name."""
    value = step.account.get(name)
    return value if isinstance(value, float) else None
