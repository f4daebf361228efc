"""What the parts of the house ask of each other, and what outsiders write.

Each contract has a conformance suite in `eigenfail.testing`.
"""

from eigenfail.contracts.learning import Estimator, Exploiter, Learner, Method, Trained
from eigenfail.contracts.storage import (
    AnalysisStore,
    CampaignStore,
    CheckpointStore,
    EpisodeStore,
    EventLog,
    JobQueue,
    Store,
)
from eigenfail.contracts.world import (
    EpisodeEngine,
    Explainer,
    ExplainingPlanner,
    Planner,
    PlannerPlugin,
    Scenario,
    Simulation,
    Simulator,
    Situation,
)

__all__ = [
    "AnalysisStore",
    "CampaignStore",
    "CheckpointStore",
    "EpisodeEngine",
    "EpisodeStore",
    "Estimator",
    "EventLog",
    "Explainer",
    "ExplainingPlanner",
    "Exploiter",
    "JobQueue",
    "Learner",
    "Method",
    "Planner",
    "PlannerPlugin",
    "Scenario",
    "Simulation",
    "Simulator",
    "Situation",
    "Store",
    "Trained",
]
