"""How long an episode without a collision lasts, in seconds: what a failure rate is within."""

from functools import lru_cache

import msgspec
import structlog

from eigenfail.errors import InputError
from eigenfail.values import CampaignSpec
from eigenfail_services.campaigns.analysed import step_s
from eigenfail_services.campaigns.checks import horizon

MOST_SPECS = 1_000

log = structlog.get_logger()


def horizon_s(spec: CampaignSpec) -> float | None:
    """The longest that an episode lasts; None where steps have no duration, as of a function. [s]

    None too of a scenario that is not here any more.
    """
    return _horizon_s(msgspec.json.encode(spec))


@lru_cache(MOST_SPECS)
def _horizon_s(text: bytes) -> float | None:
    spec = msgspec.json.decode(text, type=CampaignSpec)
    try:
        duration = step_s(spec)
        return None if duration is None else horizon(spec) * duration
    except InputError:
        return None
    # What a plug-in of today says to a campaign of yesterday must not cost its summary.
    except Exception:
        log.exception("horizon not known", scenario=spec.scenario)
        return None
