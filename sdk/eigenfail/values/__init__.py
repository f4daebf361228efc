"""Frozen nouns that cross borders."""

from eigenfail.values.analysis import (
    Analysis,
    AnalysisResult,
    AnalysisSettings,
    AnalysisState,
    FailureMode,
)
from eigenfail.values.arrays import Floats
from eigenfail.values.campaign import (
    FINAL_STATES,
    Campaign,
    CampaignSpec,
    CampaignState,
    Cost,
    Counts,
    Interval,
    Rate,
    Summary,
)
from eigenfail.values.disturbance import AXES, DisturbanceModel, NoiseTrajectory
from eigenfail.values.episode import (
    EpisodeFault,
    EpisodeResult,
    EpisodeSetup,
    EpisodeTask,
    Measures,
    Outcome,
    PolicySource,
    PriorSource,
    Source,
    TrajectorySource,
    unrunnable,
)
from eigenfail.values.event import Event
from eigenfail.values.explanation import Account, ExplainedEpisode, ExplainedStep
from eigenfail.values.learning import LearnerContext, Proposal, Round
from eigenfail.values.paging import Page
from eigenfail.values.policy import STATE, Layer, Policy
from eigenfail.values.randomness import episode_seed, learner_seed
from eigenfail.values.scene import Control, Mission, Observation, Perception, Scene, VehicleState

__all__ = [
    "AXES",
    "FINAL_STATES",
    "STATE",
    "Account",
    "Analysis",
    "AnalysisResult",
    "AnalysisSettings",
    "AnalysisState",
    "Campaign",
    "CampaignSpec",
    "CampaignState",
    "Control",
    "Cost",
    "Counts",
    "DisturbanceModel",
    "EpisodeFault",
    "EpisodeResult",
    "EpisodeSetup",
    "EpisodeTask",
    "Event",
    "ExplainedEpisode",
    "ExplainedStep",
    "FailureMode",
    "Floats",
    "Interval",
    "Layer",
    "LearnerContext",
    "Measures",
    "Mission",
    "NoiseTrajectory",
    "Observation",
    "Outcome",
    "Page",
    "Perception",
    "Policy",
    "PolicySource",
    "PriorSource",
    "Proposal",
    "Rate",
    "Round",
    "Scene",
    "Source",
    "Summary",
    "TrajectorySource",
    "VehicleState",
    "episode_seed",
    "learner_seed",
    "unrunnable",
]
