"""Checks of what `EpisodeStore` sums over blocks of episodes and counts over pairs of them."""

from math import fsum, isclose

from msgspec.structs import replace

from eigenfail.testing import expect
from eigenfail.testing.examples import CRASH, collision, make_errored_result, result
from eigenfail.values.comparison import PairTotals
from eigenfail.values.episode import EpisodeResult
from eigenfail.values.measures import Measures
from eigenfail.values.summary import BlockTotals
from eigenfail_services.store.store import Store
from store_checks.examples import BEYOND, deliver, equal, running


def sums_blocks(store: Store) -> None:
    """Blocks hold completed episodes by index, of one campaign alone, whatever came first."""
    campaign, other = running(store, episodes=20), running(store, episodes=20)
    equal(store.figures.course(campaign.id, 4), [], "The course of nothing")
    given = [
        *(safe(index, metres) for index, metres in ((0, 4.0), (1, 1.5), (3, 2.0))),
        make_errored_result(2),
        *(collision(index, steps=index) for index in (8, 9)),
        safe(10, 3.0),
        safe(11, 7.0),
        make_errored_result(12),
        replace(collision(17, steps=2), measures=None),
    ]
    deliver(store, campaign, *reversed(given))
    deliver(store, other, collision(1), safe(2, 0.1))
    blocks = store.figures.course(campaign.id, 4)
    crashes = [given[4], given[5]]
    log_p = fsum(crash.noise.log_probability for crash in crashes)
    equal(without_sums(blocks[0]), BlockTotals(0, 3, 0, 0.0, 0, 1.5, 2.0, errored=1), "Block 0")
    equal(without_sums(blocks[1]), BlockTotals(8, 4, 2, 0.0, 17, 0.0, 1.5), "Block 8")
    equal(without_sums(blocks[2]), BlockTotals(16, 1, 1, 0.0, 2, None, None), "Block 16")
    equal(len(blocks), 3, "Blocks with a completed episode")
    expect(isclose(blocks[1].log_probability, log_p), f"log p: {blocks[1].log_probability}.")
    equal(len(store.figures.course(campaign.id, 1)), 8, "Blocks of one episode")
    equal([b.completed for b in store.figures.course(campaign.id, 1000)], [8], "One block")


def safe(index: int, metres: float) -> EpisodeResult:
    """An episode that came so near."""
    return result(index, measures=Measures(metres))


def without_sums(block: BlockTotals) -> BlockTotals:
    """The block without what depends on the order of a sum."""
    return replace(block, log_probability=0.0)


def pairs_episodes(store: Store) -> None:
    """Pairs are completed episodes of equal index, seed and source."""
    one, other, third = (running(store, episodes=20) for _ in range(3))
    crash = replace(collision(0), source="prior", measures=CRASH)
    crashes = {index: replace(crash, index=index, seed=100 + index) for index in range(20)}
    deliver(
        store,
        one,
        *(crashes[i] for i in (0, 1, 2, 3)),
        *map(result, (4, 5, 6)),
        make_errored_result(7),
    )
    deliver(store, one, crashes[8], crashes[9], result(10))
    deliver(store, other, crashes[0], *map(result, (1, 2, 5, 7)), crashes[4], crashes[6])
    deliver(
        store,
        other,
        make_errored_result(3),
        replace(crashes[8], seed=1),
        result(9, source="policy"),
    )
    deliver(store, other, result(11))
    found = store.episodes.paired(one.id, other.id)
    equal(found, PairTotals(both=1, only_first=2, only_second=2, neither=1), "Pairs")
    swapped = store.episodes.paired(other.id, one.id)
    equal(swapped, PairTotals(1, 2, 2, 1), "Pairs the other way round")
    nobody = [store.episodes.paired(one.id, who) for who in (third.id, *BEYOND)]
    equal(nobody, [PairTotals()] * len(nobody), "Pairs with nobody")
