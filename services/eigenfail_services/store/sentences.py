"""What the event log says to a person."""

from eigenfail.values import Analysis, AnalysisResult, AnalysisState, Campaign
from eigenfail.values.retention import Retention
from eigenfail_services.campaigns.lifecycle import STORIES


def campaign_created(campaign: Campaign) -> str:
    """A new campaign."""
    spec = campaign.spec
    return f"{_named(campaign)} waits in the queue: {spec.episodes} episodes by {spec.method}."


def campaign_moved(campaign: Campaign, because: str) -> str:
    """A campaign in a new state."""
    return f"{_named(campaign)} {STORIES[campaign.state]}. {because}".strip()


def campaign_prioritised(campaign: Campaign) -> str:
    """A campaign with another priority."""
    return f"{_named(campaign)} has the priority {campaign.spec.priority} from now on."


def episode_alarm(campaign: int, index: int, worker: str) -> str:
    """A result that contradicts the one that is kept."""
    return (
        f"Worker {worker} brought another result of episode {index} of campaign {campaign} than "
        "the one that is kept: simulator, planner or machine is not deterministic."
    )


def checkpoint_damaged(campaign: int) -> str:
    """The newest checkpoint is not what was saved."""
    return (
        f"The last checkpoint of campaign {campaign} is damaged: its SHA-256 does not match. The "
        "campaign goes on from the one before it, with the same episodes. Check the disk."
    )


def pruning(campaign: int, rule: Retention, who: str) -> str:
    """The noise of a campaign's episodes begins to go."""
    return (
        f"{who} prunes campaign {campaign}: of its safe episodes with noise by {rule.source}, each "
        f"{rule.keep_every}th keeps noise and scene. All rows and all failures stay."
    )


def analysis_moved(analysis: Analysis) -> str:
    """An analysis in a new state."""
    stories = {
        AnalysisState.QUEUED: "waits in the queue",
        AnalysisState.RUNNING: "is running",
        AnalysisState.DONE: f"is done{_found(analysis.result)}",
        AnalysisState.FAILED: "failed",
    }
    story = f"Analysis {analysis.id} of campaign {analysis.campaign} {stories[analysis.state]}."
    return f"{story} {analysis.problem}".strip()


def _named(campaign: Campaign) -> str:
    return f"Campaign {campaign.id} '{campaign.spec.name}'"


def _found(result: AnalysisResult | None) -> str:
    return f": {len(result.modes)} modes in {len(result.episodes)} failures" if result else ""
