"""States in a sign and a word, so that colour is never alone."""

import msgspec

from eigenfail.values import AnalysisState, CampaignState, Outcome

S = CampaignState

WORKING = frozenset({S.QUEUED, S.RUNNING})
"""In which a campaign needs workers."""


class Badge(msgspec.Struct, frozen=True):
    """A word, a sign before it, and the tone of its colour."""

    word: str
    sign: str
    tone: str


CAMPAIGN_BADGES = {
    S.QUEUED: Badge("queued", "○", "waiting"),
    S.RUNNING: Badge("running", "▶", "active"),
    S.PAUSING: Badge("pausing", "‖", "waiting"),
    S.PAUSED: Badge("paused", "‖", "waiting"),
    S.CANCELLING: Badge("cancelling", "×", "waiting"),
    S.CANCELLED: Badge("cancelled", "×", "ended"),
    S.DONE: Badge("done", "✓", "good"),
    S.DEAD: Badge("dead", "!", "bad"),
}
ANALYSIS_BADGES = {
    AnalysisState.QUEUED: Badge("queued", "○", "waiting"),
    AnalysisState.RUNNING: Badge("running", "▶", "active"),
    AnalysisState.DONE: Badge("done", "✓", "good"),
    AnalysisState.FAILED: Badge("failed", "!", "bad"),
}
OUTCOME_BADGES = {
    Outcome.COLLISION: Badge("collision", "◆", "bad"),
    Outcome.SAFE: Badge("safe", "○", "good"),
    Outcome.FAILED: Badge("could not be run", "!", "waiting"),
}
