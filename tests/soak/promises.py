"""What the rows do not show: whether work was done twice for nothing, and whether it went on."""

import time
from collections.abc import Collection, Iterator, Mapping

from stage import Stage
from started import wait_until
from storm import Storm

from eigenfail_services.campaigns.supervisor import LEASE_S
from eigenfail_services.hub import commits
from eigenfail_services.hub.learner_link import PAUSES_S
from eigenfail_services.hub.worker_sessions import ADOPTION_GRACE_S, HEARTBEAT_S, SILENCE_LIMIT_S
from eigenfail_workers.worker.parent import HELLO_EVERY_S

A_LEASE_S = max(SILENCE_LIMIT_S, LEASE_S)
BACK_OFF_S = HELLO_EVERY_S + HEARTBEAT_S + commits.RETRY_S + ADOPTION_GRACE_S + max(PAUSES_S)
START_S = 5.0
"""What a process that was killed takes to be there again; nobody else has to wait for it."""

MORE = 1.2


def run_again(storm: Storm, harmless: Collection[str]) -> Iterator[str]:
    """P3: nothing comes a second time as long as workers, services and their lines are spared."""
    for method, campaign in storm.campaigns:
        again = storm.stage.campaign(campaign).counts.duplicates
        if again and storm.met[campaign] <= set(harmless):
            yield f"P3: {again} results of campaign {campaign} ({method}) came twice, for nothing."


def late(storm: Storm, undisturbed_s: Mapping[str, float]) -> Iterator[str]:
    """P6: once faults stop, what is left of a campaign takes no longer than is promised."""
    method, campaign = storm.campaigns[-1]
    bound_s = START_S + A_LEASE_S + BACK_OFF_S + MORE * undisturbed_s[method]
    took_s = rest_s(storm.stage, campaign)
    if took_s > bound_s:
        yield f"P6: {method} took {took_s:.1f} s after its last fault, of at most {bound_s:.1f} s."


def rest_s(stage: Stage, campaign: int) -> float:
    """How long it takes to its end, from now."""
    began_s = time.monotonic()
    wait_until(lambda: stage.is_over(campaign), f"campaign {campaign} ends")
    return time.monotonic() - began_s
