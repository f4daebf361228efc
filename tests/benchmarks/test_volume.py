"""The benchmark of a full database, with few episodes: its stages do what they say."""

from contextlib import closing

import pytest
from benchmarks.speed import volume_stages, volume_store

from eigenfail.values.episode import Outcome
from eigenfail_services.store.store import open_store

TOTAL = 1_200


@pytest.mark.parametrize("total", [10, 1_000, 1_000_000, 999_999])
def test_the_parts_make_the_whole(total):
    sizes = volume_store.sizes_of(total)
    assert sum(sizes) == total
    assert sizes[0] >= total // 2
    assert len(set(sizes[1:])) == 1


def test_rates_are_of_parts_of_equal_size(monkeypatch):
    store = volume_store
    monkeypatch.setattr(store, "PER_GROUP_OF_SPEED", 2)
    times = [(10, 1.0), (10, 3.0), (10, 0.5), (10, 0.5), (7, 0.5)]
    assert [*store.rates(times)] == [5.0, 20.0, 14.0]


def test_what_is_filled_is_analysed_exported_pruned_and_sound(tmp_path):
    address = f"sqlite:///{tmp_path / 'a.db'}"
    filled = volume_store.fill(address, TOTAL)
    assert filled.commits_s > 0.0
    stages = volume_stages.STAGES
    with closing(open_store(address)) as store:
        done = [campaign.counts.completed for campaign in store.campaigns.page(10).items]
        assert sum(done) == TOTAL
        kinds = {row.outcome for row in store.episodes.page(1, 1_000).items}
        assert kinds == {Outcome.SAFE, Outcome.COLLISION}
        failures = store.campaigns.get(1).counts.failures
    assert stages["analysis"](address, tmp_path) == failures
    assert stages["csv"](address, tmp_path) > 600 * 50
    noise, rows = (stages[name](address, tmp_path) for name in ("parquet_noise", "parquet"))
    assert noise - rows > 600 * 100 * 2 * 4 * 0.8
    would = stages["rehearse"](address, tmp_path)
    pruned = stages["prune"](address, tmp_path)
    assert would >= pruned * 100 * 2 * 2 * 4
    assert stages["vacuum"](address, tmp_path) > 0.9 * would
    assert stages["rehearse"](address, tmp_path) == 0
    assert len(list(tmp_path.iterdir())) == 1
