"""Checks of what `FigureStore` sums over many campaigns, and of the lists that pages show."""

from accepted import accept_spec
from msgspec.structs import replace

from eigenfail.testing.examples import collision, make_errored_result, result, spec
from eigenfail.values.campaign import CampaignFilter, CampaignState
from eigenfail.values.campaign_spec import StopRules
from eigenfail.values.episode import Outcome
from eigenfail.values.records import Delivery, FrequentFault
from eigenfail_services.store.store import Store
from store_checks.examples import BEYOND, deliver, equal, running


def sums_up_many_campaigns(store: Store) -> None:
    """The sums of several campaigns are those of each, also after further results."""
    one, other = running(store, episodes=20), running(store, episodes=20)
    wanted = [one.id, other.id, *BEYOND]
    for _ in range(2):
        found = store.figures.totals(wanted)
        equal(found, {each: store.figures.totals([each])[each] for each in wanted}, "Totals")
        deliver(store, one, collision(1), collision(2), result(3), make_errored_result(4))
        deliver(store, other, collision(0), result(5))
    found = store.figures.totals(wanted)
    equal([found[each].failures for each in wanted[:2]], [2, 1], "Failures")
    equal(store.figures.totals([]), {}, "Totals of nothing")


def names_the_most_frequent_fault(store: Store) -> None:
    """The most frequent reason of errored episodes is told; of equal ones, the earliest."""
    one, other, calm = (running(store, episodes=20) for _ in range(3))
    deliver(
        store,
        one,
        make_errored_result(7, "b"),
        make_errored_result(3, "a"),
        make_errored_result(2, "b"),
        result(0),
        make_errored_result(1, "a"),
    )
    deliver(
        store,
        other,
        make_errored_result(0, "c"),
        make_errored_result(4, "b"),
        make_errored_result(6, "b"),
    )
    deliver(store, calm, result(0))
    found = store.figures.totals([one.id, other.id, calm.id])
    equal(found[one.id].fault, FrequentFault("planner", "a", 2, 1), "Of two, the earlier")
    equal(found[other.id].fault, FrequentFault("planner", "b", 2, 4), "The more frequent")
    equal(found[calm.id].fault, None, "Without an errored episode")


def answers_anew_after_results(store: Store) -> None:
    """What was told of a campaign is told anew once another result is in."""
    campaign = running(store, episodes=20)
    for count in range(3):
        completed = [
            sum(block.completed for block in store.figures.course(campaign.id, 5)),
            store.figures.safety(campaign.id).completed,
            len(store.figures.spending(campaign.id).progress),
            len(store.figures.samples(campaign.id)),
            sum(share.episodes for share in store.figures.workers(campaign.id)),
        ]
        equal(completed, [count] * 5, f"Of {count} results")
        deliver(store, campaign, collision(count))


def samples_episodes(store: Store) -> None:
    """All completed episodes, or those whose index is a multiple of the smallest number."""
    campaign, other = running(store, episodes=40), running(store)
    equal(store.figures.samples(campaign.id), (), "Samples of nothing")
    deliver(
        store, campaign, *(result(n) for n in range(0, 30, 2)), collision(9), make_errored_result(3)
    )
    deliver(store, other, result(0))
    every = [0, 2, 4, 6, 8, 9, *range(10, 30, 2)]
    for most, wanted in ((29, every), (10, [0, 6, 9, 12, 18, 24]), (1, [0])):
        found = store.figures.samples(campaign.id, most)
        equal([each.index for each in found], wanted, f"At most {most}")
    found = store.figures.samples(campaign.id)
    crash = next(each for each in found if each.index == 9)
    equal((crash.outcome, crash.robustness_m), (Outcome.COLLISION, 0.0), "A collision")
    for who in BEYOND:
        equal(store.figures.samples(who), (), f"Samples of {who}")


def counts_workers(store: Store) -> None:
    """Each worker's episodes, failures and time, by campaign; who ran most comes first."""
    campaign, other = running(store, episodes=20), running(store)
    brought = {
        "a": [collision(0, wall_s=0.5), result(1, wall_s=0.25)],
        "b": [result(2), make_errored_result(3), collision(4), result(5)],
    }
    for worker, results in brought.items():
        store.episodes.commit(campaign.id, [Delivery(each, worker) for each in results])
    store.episodes.commit(other.id, [Delivery(result(0), "a")])
    busy, idle = store.figures.workers(campaign.id)
    equal((busy.worker, busy.episodes, busy.failures, busy.errored), ("b", 4, 1, 1), "The busiest")
    equal((idle.worker, idle.episodes, idle.wall_s), ("a", 2, 0.75), "The other one")
    rows = {row.index: row.finished_ms for row in store.episodes.page(campaign.id, 20).items}
    equal((busy.last_ms, idle.last_ms), (rows[5], rows[1]), "Last seen")
    lately = store.figures.workers_since(min(rows.values()))
    seen = [(each.worker, each.campaign, each.episodes) for each in lately]
    equal(seen, [("b", campaign.id, 4), ("a", campaign.id, 2), ("a", other.id, 1)], "Lately")
    equal(store.figures.workers_since(2**60), (), "Nobody")
    for who in BEYOND:
        equal(store.figures.workers(who), (), f"Workers of {who}")


def pools_campaigns(store: Store) -> None:
    """Campaigns that differ in seed, budget or name are pooled, by method; others are not."""
    equal(store.figures.pools(), (), "Pools of nothing")
    one = spec(episodes=20, instances=2, price_usd_per_hour=3.0)
    like = replace(one, seed=7, episodes=10, name="again", price_usd_per_hour=1.0, instances=1)
    like = replace(like, stop=StopRules(failures=3))
    apart = [replace(one, planner_settings={"gap": 2.0}), replace(one, method="ast")]
    ids = [store.campaigns.create(accept_spec(each)).id for each in (one, like, *apart)]
    for campaign in ids[:2]:
        store.campaigns.move(campaign, CampaignState.RUNNING)
        store.campaigns.add_active(campaign, 1800.0)
        deliver(
            store, store.campaigns.get(campaign), collision(0), result(1), make_errored_result(2)
        )
    pools = store.figures.pools()
    equal([pool.newest for pool in pools], [ids[3], ids[2], ids[1]], "The newest first")
    pool = pools[-1]
    equal((pool.campaigns, pool.completed, pool.failures), (2, 4, 2), "Sums")
    equal((pool.instance_hours, pool.total_usd), (1.5, 3.5), "Hours and money")
    equal(pool.method, one.method, "The method")
    equal(
        [each.judges_failures for each in pools], [False, False, True], "Stop rule of one of them"
    )
    equal(pools[1].peers.planner_settings, {"gap": 2.0}, "Other settings of the planner")
    equal(pool.peers.planner_settings, {}, "The settings that are none")
    equal(pool.peers.disturbance, one.disturbance, "The disturbance model")
    equal(pools[0].peers, pool.peers, "What methods have in common")
    equal([each.seeds for each in pools], [0, 0, 0], "Seeds of campaigns that differ in more")


def pools_seeds(store: Store) -> None:
    """Of campaigns that differ in their seeds alone the squares are summed, too."""
    for seed, failures in ((5, 1), (6, 3), (7, 0)):
        campaign = running(store, seed=seed, name=f"seed {seed}", price_usd_per_hour=2.0)
        store.campaigns.add_active(campaign.id, 1800.0 * (1 + failures))
        deliver(store, campaign, *(collision(n) for n in range(failures)), result(9))
    store.campaigns.create(accept_spec(spec(seed=8, episodes=20)))
    (pool,) = store.figures.pools()
    equal((pool.campaigns, pool.seeds), (4, 3), "Seeds with an episode")
    equal((pool.total_usd, pool.usd_squares), (7.0, 21.0), "Money and its squares")
    equal((pool.failures, pool.failure_squares), (4, 10.0), "Failures and their squares")
    equal(pool.usd_failures, 14.0, "Money times failures")


def filters_campaigns(store: Store) -> None:
    """By method, and by text in the name, together with the other conditions."""
    names = ("Cut-in 100%", "cut_in again", "Merging", "CUT-IN late")
    methods = ("ast", "monte_carlo", "ast", "ast")
    ids = [
        store.campaigns.create(accept_spec(replace(spec(), name=name, method=method))).id
        for name, method in zip(names, methods, strict=True)
    ]
    wanted = {
        CampaignFilter(): [3, 2, 1, 0],
        CampaignFilter("ast"): [3, 2, 0],
        CampaignFilter(search="cut-IN"): [3, 0],
        CampaignFilter(search="%"): [0],
        CampaignFilter(search="_"): [1],
        CampaignFilter("ast", "cut"): [3, 0],
        CampaignFilter("none"): [],
        CampaignFilter(besides="ast"): [1],
    }
    for where, places in wanted.items():
        found = [each.id for each in store.campaigns.page(10, where=where).items]
        equal(found, [ids[place] for place in places], f"Campaigns with {where}")
    first = store.campaigns.page(1, where=CampaignFilter("ast", "cut"))
    rest = store.campaigns.page(1, first.next, where=CampaignFilter("ast", "cut"))
    equal([*first.items, *rest.items], [store.campaigns.get(ids[n]) for n in (3, 0)], "By pages")
    equal(rest.next, None, "Behind the last")


def lists_the_latest_events(store: Store) -> None:
    """The newest events come first, of all campaigns or of one."""
    equal(store.events.latest(5), [], "Of an empty log")
    logged = [store.events.append("campaign.progress", str(n), n % 2) for n in range(6)]
    equal(store.events.latest(3), logged[:2:-1], "The latest three")
    equal(store.events.latest(2, 1), [logged[5], logged[3]], "The latest two of campaign 1")
    equal(store.events.latest(2, 9), [], "Of another one")
