"""The tables. Names are those of the glossary; times are milliseconds since 1970."""

from eigenfail_services.store.schema.access_tables import audit, keys
from eigenfail_services.store.schema.analysis_tables import analyses, replays
from eigenfail_services.store.schema.base import VERSION, VERSION_TABLE, metadata
from eigenfail_services.store.schema.campaign_tables import campaigns, checkpoints, idempotency_keys
from eigenfail_services.store.schema.column_types import LONGEST_PROSE, Number, Prose
from eigenfail_services.store.schema.episode_tables import (
    deaths,
    episodes,
    prunings,
    scenes,
    trajectories,
)
from eigenfail_services.store.schema.event_tables import event_counter, events
from eigenfail_services.store.schema.work_tables import arrivals, jobs

__all__ = [
    "LONGEST_PROSE",
    "VERSION",
    "VERSION_TABLE",
    "Number",
    "Prose",
    "analyses",
    "arrivals",
    "audit",
    "campaigns",
    "checkpoints",
    "deaths",
    "episodes",
    "event_counter",
    "events",
    "idempotency_keys",
    "jobs",
    "keys",
    "metadata",
    "prunings",
    "replays",
    "scenes",
    "trajectories",
]
