"""The failing region of campaigns, from what the store holds of them."""

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail import functions, side_process
from eigenfail.contracts import Store
from eigenfail.errors import InvalidValue
from eigenfail.values import Campaign, CampaignSpec, Region
from eigenfail.values.region import MOST_TRIALS
from eigenfail.variations import variation_of
from eigenfail_services.campaigns.comparison_words import unfinished
from eigenfail_services.campaigns.distinctions import mixed
from eigenfail_services.campaigns.pairing import PAIRABLE

Parameters = dict[str, object]

MODULE = "eigenfail_services.campaigns.region_process"

APART = frozenset({"method", "planner", "simulator", "disturbance model"})
"""What else may make the failure rates of campaigns differ."""


PATIENCE_S = 120.0

Numbers = Annotated[bytes, "int64, little-endian"]
Flags = Annotated[bytes, "a byte each, 0 or 1"]


class Tried(msgspec.Struct, frozen=True):
    """Episodes of a campaign by seed, and which of them collided."""

    spec: CampaignSpec
    seeds: Numbers
    failed: Flags


class Wanted(msgspec.Struct, frozen=True):
    """All that a region is made of, as a process can be told it.

    Attributes:
        warnings: what keeps the region from saying more.
    """

    campaigns: tuple[int, ...]
    scenario: str
    tried: tuple[Tried, ...]
    warnings: tuple[str, ...]


def region_of(store: Store, ids: Sequence[int], most: int = MOST_TRIALS) -> Region:
    """The failing region over all episodes of some campaigns so far.

    Args:
        store: where they are.
        ids: of campaigns on one scenario: one whose parameters vary, or those of a grid.
        most: how many episodes are looked at, of all campaigns together.

    Raises:
        NotFound: no such campaign.
        InvalidValue: none is named, one twice, or they are on different scenarios.
        UnknownName: their scenario is not installed here.
    """
    return region_in(wanted(store, ids, most))


def region_aside(store: Store, ids: Sequence[int], most: int = MOST_TRIALS) -> Region:
    """The same, made in a process of its own: it keeps a processor busy for seconds.

    Raises:
        NotFound: no such campaign.
        InvalidValue: none is named, one twice, or they are on different scenarios.
        UnknownName: their scenario is not installed here.
        ServiceError: the process gave no answer.
    """
    question = msgspec.msgpack.encode(wanted(store, ids, most))
    answer = side_process.ask(MODULE, question, PATIENCE_S)
    return msgspec.msgpack.decode(answer, type=Region)


def wanted(store: Store, ids: Sequence[int], most: int) -> Wanted:
    """What the store holds of it; raises as `region_of` does."""
    refuse_repeats(ids)
    campaigns = [store.campaigns.get(campaign) for campaign in ids]
    scenario = the_scenario(campaigns)
    tried = [tried_in(store, one, max(1, most // len(ids))) for one in campaigns]
    warnings = caveats(campaigns, sum(len(each.failed) for each in tried))
    return Wanted(tuple(ids), scenario, tuple(tried), tuple(warnings))


def tried_in(store: Store, campaign: Campaign, most: int) -> Tried:
    """The episodes of a campaign."""
    trials = store.episodes.trials(campaign.id, most)
    return Tried(campaign.spec, trials.seeds.astype("<i8").tobytes(), trials.failed.tobytes())


def region_in(asked: Wanted) -> Region:
    """The failing region among these episodes.

    Raises:
        UnknownName: their scenario is not installed here.
    """
    from eigenfail_services.analysis.region import (  # scikit-learn takes a second to load
        Question,
        failing_region,
    )

    tables = (parameters(one.spec, np.frombuffer(one.seeds, "<i8")) for one in asked.tried)
    names, values, left_out = columns(list(chain.from_iterable(tables)))
    failed = np.frombuffer(b"".join(one.failed for one in asked.tried), np.bool_)
    warnings = (*left_out, *asked.warnings)
    return failing_region(
        Question(asked.campaigns, asked.scenario, names, values, failed, warnings)
    )


def refuse_repeats(ids: Sequence[int]) -> None:
    """Every campaign counts once.

    Raises:
        InvalidValue: there is none, or one is named twice.
    """
    if not ids or len(set(ids)) < len(ids):
        raise InvalidValue("campaigns", f"{list(ids)} is not one or several different campaigns.")


def the_scenario(campaigns: Sequence[Campaign]) -> str:
    """The one that all of them are on.

    Raises:
        InvalidValue: there are several.
    """
    names = sorted({campaign.spec.scenario for campaign in campaigns})
    if len(names) > 1:
        problem = f"they are on different scenarios: {', '.join(names)}."
        raise InvalidValue("campaigns", problem, "Name campaigns of one scenario.")
    return names[0]


def parameters(spec: CampaignSpec, seeds: NDArray[np.int64]) -> Iterator[Parameters]:
    """The scenario parameters of episodes; a function under test has what its campaign set."""
    if not functions.drives(spec):
        return (dict(spec.scenario_parameters) for _ in seeds)
    return variation_of(spec).table(seeds.tolist())


def columns(rows: Sequence[Parameters]) -> tuple[tuple[str, ...], NDArray[np.float64], list[str]]:
    """Names and values of the parameters that took more than one value, and what was left out.

    Returns:
        The names, their values in shape (rows, names), and a sentence for each that is no number.
    """
    names = sorted(set().union(*rows))
    seen = {name: {row.get(name) for row in rows} for name in names}
    varied = [name for name in names if len(seen[name]) > 1]
    plain = [n for n in varied if all(isinstance(value, int | float) for value in seen[n])]
    values = np.array([[row[name] for name in plain] for row in rows], np.float64)
    left_out = [f"{n} is left out: its values are not numbers." for n in varied if n not in plain]
    return tuple(plain), values.reshape(len(rows), len(plain)), left_out


def caveats(campaigns: Sequence[Campaign], episodes: int) -> Iterator[str]:
    """What keeps a region from saying more."""
    if differing := [t for t in mixed([one.spec for one in campaigns]) if t in APART]:
        yield f"The campaigns differ in {', '.join(differing)}: their episodes count alike."
    learning = sorted({campaign.spec.method for campaign in campaigns} - PAIRABLE)
    if learning and len(campaigns) > 1:
        yield (
            f"Campaigns of {' and '.join(learning)} also differ by the luck of what each learnt, "
            "of which the p-value knows nothing."
        )
    completed = sum(campaign.counts.completed for campaign in campaigns)
    if episodes < completed:
        yield f"{episodes} of {completed} episodes were looked at, evenly spread in index order."
    yield from unfinished(campaigns)
