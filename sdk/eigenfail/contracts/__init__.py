"""What the parts of the house ask of each other, and what outsiders write.

Each contract has a conformance suite in `eigenfail.testing`.
"""

from eigenfail.contracts.access import AuditLog, KeyStore
from eigenfail.contracts.analyses import AnalysisStore
from eigenfail.contracts.campaigns import CampaignStore
from eigenfail.contracts.checkpoints import CheckpointStore
from eigenfail.contracts.episodes import EpisodeStore
from eigenfail.contracts.events import EventLog
from eigenfail.contracts.figures import FigureStore
from eigenfail.contracts.jobs import JobQueue
from eigenfail.contracts.learning import Estimator, Exploiter, Learner, Method, Paced, Trained
from eigenfail.contracts.retention import RetentionStore
from eigenfail.contracts.roster import Roster
from eigenfail.contracts.storage import Store
from eigenfail.contracts.world import (
    EpisodeEngine,
    Explainer,
    ExplainingPlanner,
    LockstepEngine,
    Planner,
    PlannerPlugin,
    PlottingPlanner,
    Scenario,
    Simulation,
    Simulator,
    Situation,
)

__all__ = [
    "AnalysisStore",
    "AuditLog",
    "CampaignStore",
    "CheckpointStore",
    "EpisodeEngine",
    "EpisodeStore",
    "Estimator",
    "EventLog",
    "Explainer",
    "ExplainingPlanner",
    "Exploiter",
    "FigureStore",
    "JobQueue",
    "KeyStore",
    "Learner",
    "LockstepEngine",
    "Method",
    "Paced",
    "Planner",
    "PlannerPlugin",
    "PlottingPlanner",
    "RetentionStore",
    "Roster",
    "Scenario",
    "Simulation",
    "Simulator",
    "Situation",
    "Store",
    "Trained",
]
