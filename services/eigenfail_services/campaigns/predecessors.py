"""The learner of an earlier campaign, for a campaign that uses it or starts from it."""

from collections.abc import Mapping
from typing import Any

from eigenfail import plugins
from eigenfail.contracts import Store
from eigenfail.errors import InvalidValue, ProtocolError
from eigenfail.values import Campaign, CampaignSpec, Predecessor, learner_seed
from eigenfail_services.campaigns.checkpoint import read_checkpoint
from eigenfail_services.campaigns.checks import horizon
from eigenfail_services.campaigns.earlier import ENSEMBLE, Search, ended, search
from eigenfail_services.campaigns.fitness import check_estimates

LEARNERS = {"evaluate": "campaign", "ast": "warm_start"}
"""The setting of a method that names the campaign whose learner it starts from."""

AT_BIRTH = frozenset({"warm_start", "data_from"})
"""What came of them is in a learner's state, so that one that is restored can do without."""


def predecessors(spec: CampaignSpec, store: Store) -> tuple[Predecessor, ...]:
    """The learner of the campaign that the settings name; none if they name none.

    Raises:
        InvalidValue: no such campaign, it has not ended, or its learner is of no use.
    """
    found = search(spec)
    name = LEARNERS.get(found.method, "")
    campaign = found.settings.get(name)
    if campaign is None:
        return ()
    field = f"{found.field}.{name}"
    before = ended(campaign, field, store)
    CHECKS[found.method](before, field)
    if spec.stop.cv is not None and spec.method == "evaluate":
        own = Search(before.spec.method, before.spec.settings)
        check_estimates(own, "stop.cv", ability="weigh")
    return (predecessor(before, field, store),)


def check_useful(before: Campaign, field: str) -> None:
    """Make sure that a campaign's method has knowledge to be used.

    Raises:
        InvalidValue: it has none.
    """
    name = search(before.spec).method
    method = plugins.load(plugins.METHODS, name)
    if isinstance(method, type) and not hasattr(method, "exploit"):
        problem = f"campaign {before.id} is one of {name}, which learns nothing that could be used."
        raise InvalidValue(field, problem, "Name a campaign of a method that learns, such as ast.")


def check_policy(before: Campaign, field: str) -> None:
    """Make sure that a campaign has trained one policy.

    Raises:
        InvalidValue: it has not.
    """
    if before.spec.method != "ast":
        problem = f"campaign {before.id} is one of {before.spec.method} and has no policy of ast."
        raise InvalidValue(field, problem, "Name a campaign of ast.")


CHECKS = {"evaluate": check_useful, "ast": check_policy}


def predecessor(before: Campaign, field: str, store: Store) -> Predecessor:
    """The learner of a campaign that has ended.

    Raises:
        InvalidValue: it never got as far as a state, or another program wrote it.
    """
    spec = before.spec
    return Predecessor(
        campaign=before.id,
        method=spec.method,
        settings=without_birth(spec.method, spec.settings),
        seed=learner_seed(spec.seed),
        episodes=spec.episodes,
        horizon=horizon(spec),
        state=last_state(before, field, store),
    )


def last_state(before: Campaign, field: str, store: Store) -> bytes:
    """What `Learner.state` last gave in a campaign.

    Raises:
        InvalidValue: it never got as far as a state, or another program wrote it.
    """
    try:
        checkpoint = store.checkpoints.load(before.id)
        if checkpoint is not None:
            return read_checkpoint(checkpoint).learner
    except ProtocolError as error:
        raise InvalidValue(field, f"campaign {before.id}: {error.problem}", error.remedy) from error
    problem = f"campaign {before.id} ended before its first round and has no checkpoint."
    raise InvalidValue(field, problem, "Start one like it anew, and name that.")


def without_birth(method: str, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings without those that matter at a learner's birth alone."""
    kept = {name: value for name, value in settings.items() if name not in AT_BIRTH}
    if method == ENSEMBLE and "settings" in kept:
        kept["settings"] = without_birth(kept.get("method", ""), kept["settings"])
    return kept
