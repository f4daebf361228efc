"""Two groups of campaigns side by side, from a store that holds them."""

from collections.abc import Iterable
from typing import Any

import msgspec
import numpy as np
import pytest
from accepted import accept_spec
from msgspec.structs import replace
from store_checks.examples import deliver, name_channels

from eigenfail.errors import InvalidValue, NotFound
from eigenfail.intervals import difference, find_interval, paired_difference
from eigenfail.testing.examples import make_errored_result, result
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec, StopRules
from eigenfail.values.comparison import PairTotals
from eigenfail.values.disturbance import DisturbanceModel, NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.estimates import RateDesign
from eigenfail.values.measures import Measures
from eigenfail.values.requirements import NoCollision, TimeHeadway
from eigenfail.values.shapes import Correlated
from eigenfail_services.comparison.comparability import (
    THINGS,
    find_differing_fields,
    find_distinctions,
    find_mixed_fields,
)
from eigenfail_services.comparison.sides import compare
from eigenfail_services.statistics.intervals import clopper_pearson, rate
from eigenfail_services.store.store import Store

EPISODES = 50
CHANGES_NO_RESULT = {"name", "seed", "scene_every", "priority", "project", "tags"}


def spec(**changes: Any) -> CampaignSpec:
    fields: dict[str, Any] = {"name": "n", "method": "monte_carlo", "episodes": EPISODES}
    return CampaignSpec(**fields | changes)


def noise(seed: int, index: int, steps: int = 3) -> NoiseTrajectory:
    """What the same draw gives in every campaign of a seed, however long it lasts."""
    z = np.random.default_rng([seed, index]).standard_normal((9, 2)).astype(np.float32)[:steps]
    return NoiseTrajectory(z, np.ones_like(z))


def episode(seed: int, index: int, crashed: bool, **changes: Any) -> EpisodeResult:
    outcome = Outcome.COLLISION if crashed else Outcome.SAFE
    steps = 3 if crashed else 6
    measures = Measures(0.0, severity=16.0) if crashed else Measures(2.0)
    made = result(index, outcome, steps, measures=measures)
    fields: dict[str, Any] = {"noise": noise(seed, index, steps), "seed": 1000 * seed + index}
    return replace(made, **fields | changes)


def campaign(store: Store, crashes: Iterable[int], **changes: Any) -> int:
    """A campaign that is done, in which these episodes crashed."""
    made = store.campaigns.create(accept_spec(spec(**changes)))
    store.campaigns.move(made.id, CampaignState.RUNNING)
    crashed = set(crashes)
    seed = made.spec.seed
    deliver(store, made, *(episode(seed, i, i in crashed) for i in range(made.spec.episodes)))
    store.campaigns.add_active(made.id, 3600.0)
    store.campaigns.move(made.id, CampaignState.DONE)
    return made.id


def test_two_planners_that_saw_the_same_noise(store: Store) -> None:
    a = campaign(store, range(5), planner="rulebook")
    b = campaign(store, range(3, 23), planner="idm")
    found = compare(store, [a], [b])
    assert (found.a.failure_rate, found.b.failure_rate) == (rate(5, 50), rate(20, 50))
    assert found.difference == paired_difference(PairTotals(2, 3, 18, 27))
    assert found.difference.value == pytest.approx(0.3)
    assert (found.pairs.n, found.pairs.only_a, found.pairs.only_b) == (50, 3, 18)
    assert (found.pairs.both, found.pairs.neither) == (2, 27)
    # 2 · (1 + 21 + 210 + 1330) / 2^21
    assert found.pairs.p_value == pytest.approx(2 * 1562 / 2**21)
    assert found.a.mean_severity == 16.0
    assert (found.a.cost.per_failure_usd, found.b.cost.per_failure_usd) == (0.24, 0.06)
    assert found.effect is None
    assert [each.thing for each in found.distinctions] == ["planner"]
    assert found.warnings == ()


def test_few_pairs_that_differ_leave_it_open_whether_they_do(store: Store) -> None:
    a, b = campaign(store, range(0)), campaign(store, range(5), planner="idm")
    found = compare(store, [a], [b])
    # 5 of 5 pairs: p = 2 ÷ 2⁵, though the interval excludes 0.
    assert found.difference.interval.low > 0.0
    assert found.sentences[1].startswith("Whether they differ is open: B − A is +10.0 % [+")
    assert "does not distinguish them (p = 0.0625)" in found.sentences[2]


def test_a_side_that_stopped_at_its_failures_has_exact_intervals(store: Store) -> None:
    stop = StopRules(failures=25)
    a, b = campaign(store, range(5), stop=stop), campaign(store, range(3, 23), stop=stop)
    found = compare(store, [a], [b])
    # The budget ended both before their 25th failure: as with a fixed number of episodes.
    exact = [
        replace(rate(k, 50), interval=clopper_pearson(k, 50), design=RateDesign.FAILURES)
        for k in (5, 20)
    ]
    assert [found.a.failure_rate, found.b.failure_rate] == exact
    assert found.difference == difference(*exact)
    assert any("ended none of these episodes" in warning for warning in found.warnings)


def test_seeds_are_pooled_and_have_an_effect_size(store: Store) -> None:
    a = [campaign(store, range(k), seed=k) for k in (1, 2, 3, 4)]
    b = [campaign(store, range(k + 2), seed=k, planner="idm") for k in (3, 1, 2, 4)]
    found = compare(store, a, b)
    assert found.a.campaigns == tuple(a)
    assert found.a.failure_rate == rate(10, 200)
    assert found.a.rates == (0.02, 0.04, 0.06, 0.08)
    assert found.a.cost.instance_hours == pytest.approx(4.0)
    assert (found.pairs.n, found.pairs.only_b, found.pairs.only_a) == (200, 8, 0)
    # {1, 2, 3, 4} against {3, 4, 5, 6}: of 16 pairs 13 are won and two are ties.
    assert found.effect.a12 == pytest.approx(14 / 16)
    assert "0.88: large effect (Vargha–Delaney A12, n = 4 and 4 campaigns)" in found.sentences[-1]


UNPAIRED = [
    ({"seed": 7}, "their seeds differ."),
    ({"method": "cem"}, "cem chooses its noise by what earlier episodes did."),
    ({"method": "replay"}, "monte_carlo and replay do not draw the same noise."),
    (
        {"disturbance": DisturbanceModel(shape=Correlated(0.5, 0.5))},
        "their noise differs in shape.",
    ),
]


@pytest.mark.parametrize(("changes", "because"), UNPAIRED)
def test_it_is_said_why_episodes_are_not_paired(store: Store, changes, because) -> None:
    a, b = campaign(store, range(5)), campaign(store, range(6), **changes)
    found = compare(store, [a], [b])
    assert (found.pairs, found.unpaired_because) == (None, because)
    assert f"Episodes are not paired: {because}" in found.sentences


def test_noise_of_other_channels_is_not_paired(store: Store) -> None:
    one, same, other = (
        store.campaigns.create(accept_spec(spec(**name_channels(count)))).id for count in (3, 3, 5)
    )
    assert compare(store, [one], [other]).unpaired_because == "their noise differs in its channels."
    assert "channels" not in compare(store, [one], [same]).unpaired_because


def test_noise_is_looked_at_and_not_only_promised(store: Store) -> None:
    a = campaign(store, range(5))
    made = store.campaigns.create(accept_spec(spec()))
    store.campaigns.move(made.id, CampaignState.RUNNING)
    strange = [episode(0, i, False, noise=noise(1, i, 6)) for i in range(EPISODES)]
    deliver(store, made, *strange)
    because = compare(store, [a], [made.id]).unpaired_because
    assert because == f"the noise, or the seed, of episode {a}/0 is not that of {made.id}/0."


def test_two_campaigns_of_one_seed_on_a_side_are_not_paired(store: Store) -> None:
    a, b, c = (campaign(store, range(k)) for k in (1, 2, 3))
    found = compare(store, [a, b], [c])
    assert found.unpaired_because == "two campaigns of one side have the same seed."


def test_campaigns_without_an_episode_are_compared_as_far_as_possible(store: Store) -> None:
    a, b = (
        store.campaigns.create(accept_spec(spec(planner=name))).id for name in ("idm", "rulebook")
    )
    found = compare(store, [a], [b])
    assert found.a.failure_rate is found.difference is found.pairs is found.effect is None
    assert found.sentences[0] == "A has completed no episode; B has completed no episode."
    assert "no episode was completed on both sides" in found.unpaired_because
    assert found.warnings == tuple(
        f"Campaign {each} is queued: its figures may still change." for each in (a, b)
    )


def test_more_than_one_difference_is_warned_of_and_listed(store: Store) -> None:
    a = campaign(store, range(5), scenario_parameters={"distance_m": 53.0})
    b = campaign(store, range(6), planner="idm", episodes=40, seed=3)
    found = compare(store, [a], [b])
    listed = {each.thing: (each.a, each.b) for each in found.distinctions}
    assert listed == {
        "scenario_parameters.distance_m": ("53.0", "58.0"),
        "planner": ("rulebook", "idm"),
        "episodes": ("50", "40"),
    }
    (warned,) = found.warnings
    assert "differ in more than one thing (scenario, planner, budget)" in warned


def test_the_same_campaign_twice_over_is_no_comparison(store: Store) -> None:
    a, b = campaign(store, range(5)), campaign(store, range(5), seed=1)
    (warned,) = compare(store, [a], [b]).warnings
    assert "were asked for the same thing" in warned


@pytest.mark.parametrize(
    ("versions", "expected"),
    [(("1.0", "1.1"), ("1.0", "1.1")), ((msgspec.UNSET, "1.1"), ("not given", "1.1"))],
)
def test_versions_of_the_planner_are_a_difference(store: Store, versions, expected) -> None:
    a, b = (campaign(store, range(5), planner_version=version) for version in versions)
    found = compare(store, [a], [b])
    assert [(each.thing, each.a, each.b) for each in found.distinctions] == [
        ("planner_version", *expected)
    ]
    assert found.warnings == ()
    assert compare(store, [b], [campaign(store, [], planner_version="1.1")]).distinctions == ()
    # A version and a setting of the planner are one thing; a version and a budget are two.
    others = spec(planner_version="2", planner="idm"), spec(planner_version="2", episodes=9)
    assert [find_differing_fields(find_distinctions([spec()], [each])) for each in others] == [
        ("planner",),
        ("planner", "budget"),
    ]


def test_a_side_of_several_kinds_is_warned_of(store: Store) -> None:
    a, b = campaign(store, range(5)), campaign(store, range(5), seed=1, planner="idm")
    c = campaign(store, range(5), planner="idm", seed=2)
    warned = compare(store, [a, b], [c]).warnings
    assert "The campaigns of A differ among themselves in planner." in warned


def test_a_side_that_services_of_two_versions_ran_is_told_without_advice(store: Store) -> None:
    a, b = campaign(store, range(5)), campaign(store, range(5), planner="idm")
    for version in ("1.0.0", "1.1.0"):
        store.campaigns.begin_part(b, {"eigenfail": version})
    (warned,) = compare(store, [a], [b]).warnings
    assert warned.startswith(f"Campaign {b} went on with other versions after 50 results:")


@pytest.mark.parametrize(("a", "b"), [([], [1]), ([1], []), ([1, 1], [2]), ([1, 2], [2])])
def test_every_campaign_counts_once(store: Store, a, b) -> None:
    with pytest.raises(InvalidValue, match=r"names no campaign|is listed twice"):
        compare(store, a, b)


def test_strangers_are_not_found(store: Store) -> None:
    with pytest.raises(NotFound):
        compare(store, [campaign(store, [])], [99])


def test_every_field_of_a_spec_is_a_thing_or_changes_no_result() -> None:
    assert set(CampaignSpec.__struct_fields__) == THINGS.keys() | CHANGES_NO_RESULT
    assert CHANGES_NO_RESULT.isdisjoint(THINGS)


def test_settings_are_told_apart_wherever_they_are() -> None:
    wide = spec(disturbance=DisturbanceModel(scale=2.0), name="x", seed=5, scene_every=3)
    (found,) = find_distinctions([spec()], [wide])
    assert (found.thing, found.a, found.b) == ("disturbance.scale", "1.0", "2.0")
    assert find_differing_fields([found]) == ("disturbance model",)
    assert find_mixed_fields([spec(), wide]) == ("disturbance model",)
    assert find_mixed_fields([spec(), spec(seed=1)]) == ()


def test_a_default_that_is_written_out_is_no_difference(store: Store) -> None:
    """As in the examples: one file says the distance, the other leaves it to the scenario."""
    a = campaign(store, range(5), scenario_parameters={"distance_m": 58})
    settings = {"exponent": 4.0, "time_headway_s": 1.0}
    b = campaign(store, range(6), planner="idm", planner_settings=settings)
    found = compare(store, [a], [b])
    listed = {each.thing: (each.a, each.b) for each in found.distinctions}
    assert listed == {
        "planner": ("rulebook", "idm"),
        "planner_settings.time_headway_s": ("–", "1.0"),
    }
    assert found.warnings == ()
    c = campaign(store, range(6), settings={"round_size": 100}, seed=1)
    default = compare(store, [a, c], [b]).warnings
    assert not [warned for warned in default if "differ" in warned]


def test_settings_of_plug_ins_that_are_not_installed_are_compared_as_they_are_given() -> None:
    given = spec(
        planner="gone", planner_settings={"x": 1}, scenario_parameters={"distance_m": 58.0}
    )
    (found,) = find_distinctions([given], [spec(planner="gone")])
    assert (found.thing, found.a, found.b) == ("planner_settings.x", "1", "default")


def test_a_setting_that_one_side_lacks_has_no_value_there() -> None:
    def differ(**other: Any) -> dict[str, tuple[str, str]]:
        found = find_distinctions([spec()], [spec(**other)])
        return {each.thing: (each.a, each.b) for each in found}

    assert differ(method="difs")["settings.round_size"] == ("100", "–")
    learning = differ(method="ast", settings={"round_size": 20, "gamma": 0.9})
    assert learning["settings.round_size"] == ("100", "20")
    assert learning["settings.gamma"] == ("–", "0.9")
    following = differ(planner="idm", planner_settings={"time_headway_s": 1.0})
    assert following["planner_settings.time_headway_s"] == ("–", "1.0")


def test_errored_episodes_are_told_beside_the_rates(store: Store) -> None:
    made = store.campaigns.create(accept_spec(spec(planner="idm")))
    store.campaigns.move(made.id, CampaignState.RUNNING)
    deliver(
        store,
        made,
        *map(make_errored_result, range(10)),
        *(episode(0, i, crashed=False) for i in (10, 11)),
    )
    store.campaigns.move(made.id, CampaignState.DONE)
    (warned,) = compare(store, [campaign(store, range(5))], [made.id]).warnings
    assert warned == (
        "10 of 12 episodes of B errored: its rate leaves them out, and an upper bound counts them "
        "as failures."
    )
    found = compare(store, [campaign(store, range(5))], [made.id])
    assert found.b.failure_rate.interval == find_interval(0, 12, 10)
    assert not found.difference.is_paired
    assert found.difference.interval.high > 0.0


def test_a_side_whose_every_episode_errored_has_nothing_to_compare(store: Store) -> None:
    made = store.campaigns.create(accept_spec(spec(planner="idm")))
    store.campaigns.move(made.id, CampaignState.RUNNING)
    deliver(store, made, *map(make_errored_result, range(10)))
    store.campaigns.move(made.id, CampaignState.DONE)
    found = compare(store, [campaign(store, range(5))], [made.id])
    assert "Every episode of B errored (10): there is nothing to compare." in found.warnings
    assert "B has completed no episode" in found.sentences[0]
    assert found.difference is None


def test_what_one_side_alone_requires_or_follows_is_a_difference():
    (found,) = find_distinctions([spec()], [spec(importance=TimeHeadway())])[:1]
    assert found.thing.startswith("importance")
    told = [
        each.thing for each in find_distinctions([spec()], [spec(requirements=(TimeHeadway(),))])
    ]
    assert any(thing.startswith("requirements") for thing in told)
    assert find_distinctions([spec()], [spec(requirements=(NoCollision(),))]) == ()
