"""The failing region of campaigns, from what the store holds of them."""

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Annotated

import msgspec
import numpy as np
from msgspec.structs import asdict
from numpy.typing import NDArray

from eigenfail import logs, processes
from eigenfail.errors import InvalidValue
from eigenfail.processes import answer
from eigenfail.values.campaign import Campaign
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.worlds import world_of
from eigenfail_failing_region.boxes import RegionQuestion, find_failing_region
from eigenfail_failing_region.trials import read_trials
from eigenfail_failing_region.values import Region
from eigenfail_services.analysis.sampling_design import SamplingDesign
from eigenfail_services.comparison.comparability import find_mixed_fields, list_unpairable
from eigenfail_services.comparison.sides import warn_of_unfinished
from eigenfail_services.store.store import Store

Parameters = dict[str, object]


MODULE = "eigenfail_failing_region.campaigns"


APART = frozenset({"method", "planner", "simulator", "disturbance model"})
"""Other things that may make the failure rates of campaigns differ."""


PATIENCE_S = 120.0


MOST_TRIALS = 20_000
"""How many episodes a region rests on at most."""


Numbers = Annotated[bytes, "int64, little-endian"]


Flags = Annotated[bytes, "a byte each, 0 or 1"]


class ExaminedEpisodes(msgspec.Struct, frozen=True):
    """Episodes of a campaign by seed, and which of them are failures."""

    spec: CampaignSpec
    seeds: Numbers
    failed: Flags


class RegionQuery(msgspec.Struct, frozen=True):
    """The input of a region's computation in a separate process.

    Attributes:
        warnings: what keeps the region from saying more.
    """

    campaigns: tuple[int, ...]
    scenario: str
    tried: tuple[ExaminedEpisodes, ...]
    warnings: tuple[str, ...]
    errored: int


def find_region(store: Store, ids: Sequence[int], most: int = MOST_TRIALS) -> Region:
    """Return the failing region over all episodes of campaigns so far.

    Args:
        store: store of the campaigns.
        ids: ids of campaigns on one scenario: a campaign whose parameters vary, or the campaigns of
            a grid.
        most: how many episodes are looked at, of all campaigns together.

    Raises:
        NotFound: no such campaign.
        InvalidValue: none is named, one twice, or they are on different scenarios.
        UnknownName: their scenario is not installed here.
    """
    return compute_region(_read_query(store, ids, most))


def find_region_in_process(store: Store, ids: Sequence[int], most: int = MOST_TRIALS) -> Region:
    """Return the failing region, computed in another process, since it takes seconds.

    Raises:
        NotFound: no such campaign.
        InvalidValue: none is named, one twice, or they are on different scenarios.
        UnknownName: their scenario is not installed here.
        ServiceError: the process gave no answer.
    """
    question = msgspec.msgpack.encode(_read_query(store, ids, most))
    answer = processes.ask(MODULE, question, PATIENCE_S)
    return msgspec.msgpack.decode(answer, type=Region)


def _read_query(store: Store, ids: Sequence[int], most: int) -> RegionQuery:
    _refuse_repeats(ids)
    campaigns = [store.campaigns.get(campaign) for campaign in ids]
    scenario = _find_scenario(campaigns)
    tried = [_read_examined(store, one, max(1, most // len(ids))) for one in campaigns]
    warnings = _list_caveats(campaigns, sum(len(each.failed) for each in tried))
    errored = sum(campaign.counts.errored for campaign in campaigns)
    return RegionQuery(tuple(ids), scenario, tuple(tried), tuple(warnings), errored)


def _read_examined(store: Store, campaign: Campaign, most: int) -> ExaminedEpisodes:
    trials = read_trials(store.database, campaign.id, most)
    return ExaminedEpisodes(
        campaign.spec, trials.seeds.astype("<i8").tobytes(), trials.failed.tobytes()
    )


def compute_region(asked: RegionQuery) -> Region:
    """Return the failing region among examined episodes.

    Raises:
        UnknownName: their scenario is not installed here.
    """
    tables = (_list_parameters(one.spec, np.frombuffer(one.seeds, "<i8")) for one in asked.tried)
    names, values, left_out = make_columns(list(chain.from_iterable(tables)))
    failed = np.frombuffer(b"".join(one.failed for one in asked.tried), np.bool_)
    warnings = (*left_out, *asked.warnings)
    return find_failing_region(
        RegionQuestion(
            campaigns=asked.campaigns,
            scenario=asked.scenario,
            names=names,
            values=values,
            failed=failed,
            warnings=warnings,
            design=SamplingDesign.of([one.spec for one in asked.tried]),
            errored=asked.errored,
        )
    )


def _refuse_repeats(ids: Sequence[int]) -> None:
    """Make sure that every campaign is named once.

    Raises:
        InvalidValue: there is none, or one is named twice.
    """
    # The episodes of a campaign that is named twice would count twice.
    if not ids or len(set(ids)) < len(ids):
        raise InvalidValue("campaigns", f"{list(ids)} is not one or several different campaigns.")


def _find_scenario(campaigns: Sequence[Campaign]) -> str:
    """Return the scenario that all campaigns share.

    Raises:
        InvalidValue: there are several.
    """
    names = sorted({campaign.spec.scenario for campaign in campaigns})
    if len(names) > 1:
        problem = f"they are on different scenarios: {', '.join(names)}."
        raise InvalidValue("campaigns", problem, "Name campaigns of one scenario.")
    return names[0]


def _list_parameters(spec: CampaignSpec, seeds: NDArray[np.int64]) -> Iterator[Parameters]:
    world = world_of(spec.simulator)
    if not world.has_road:
        # Values are counted: the names of channels, a list, must be hashable.
        given = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in spec.scenario_parameters.items()
        }
        return (given for _ in seeds)
    variation = world.variation(spec)
    shared = {
        name: value
        for name, value in asdict(next(variation.corners())).items()
        if name not in variation.searched
    }
    return (shared | variation.drawn(seed) for seed in seeds.tolist())


def make_columns(
    rows: Sequence[Parameters],
) -> tuple[tuple[str, ...], NDArray[np.float64], list[str]]:
    """Return the parameters that took more than one value, and notes on those left out.

    Returns:
        The names, their values in shape (rows, names), and a sentence for each parameter that is
        left out because its values are not numbers.
    """
    names = sorted(set().union(*rows))
    seen = {name: {row.get(name) for row in rows} for name in names}
    varied = [name for name in names if len(seen[name]) > 1]
    # A row without the parameter counts as None, which is not a number: every row has the
    # parameters that remain.
    plain = [n for n in varied if all(isinstance(value, int | float) for value in seen[n])]
    values = np.array([[row[name] for name in plain] for row in rows], np.float64)
    left_out = [f"{n} is left out: its values are not numbers." for n in varied if n not in plain]
    return tuple(plain), values.reshape(len(rows), len(plain)), left_out


def _list_caveats(campaigns: Sequence[Campaign], episodes: int) -> Iterator[str]:
    if differing := [t for t in find_mixed_fields([one.spec for one in campaigns]) if t in APART]:
        yield f"The campaigns differ in {', '.join(differing)}: their episodes count alike."
    learning = list_unpairable(campaigns)
    if learning and len(campaigns) > 1:
        yield (
            f"Campaigns of {' and '.join(learning)} also vary between training runs, "
            "of which the p-value knows nothing."
        )
    completed = sum(campaign.counts.completed for campaign in campaigns)
    if episodes < completed:
        yield f"{episodes} of {completed} episodes were looked at, evenly spread in index order."
    yield from warn_of_unfinished(campaigns)


def reply(question: bytes) -> bytes:
    """Return the failing region for a question; both are encoded as MessagePack."""
    return msgspec.msgpack.encode(
        compute_region(msgspec.msgpack.decode(question, type=RegionQuery))
    )


if __name__ == "__main__":
    logs.configure("services")
    answer(reply)
