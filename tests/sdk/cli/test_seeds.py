"""`eigenfail run --seeds`: campaigns of one file that differ in their seeds, and their spread."""

import json

import pytest

from eigenfail.client import Client
from eigenfail.suites import Suite


@pytest.fixture
def repeat(eigenfail, spec_file):
    """Runs the campaign of seed 1, with options."""
    return lambda *options: eigenfail("run", spec_file, *options)


def list_lines(printed):
    return [" ".join(line.split()) for line in printed.splitlines()]


def test_members_one_row_of_means_and_the_spread_are_printed(repeat, store):
    run = repeat("--seeds", 3)
    assert run.exit_code == 0, run.output
    lines = list_lines(run.stdout)
    header, _, *members = lines[:5]
    assert header.startswith("member state id method episodes failures failed [95 %]")
    assert [line.split()[0] for line in members] == ["seed=1", "seed=2", "seed=3"]
    label = "rate of all episodes, means over 3 seeds"
    (mean,) = [line for line in lines if line.startswith(label)]
    failures = [campaign.counts.failures for campaign in store.campaigns.page(10).items]
    assert mean.removeprefix(label).split()[:3] == ["monte_carlo", "72", str(sum(failures))]
    assert (
        "over seeds mean over 3 seeds [95 %] std dev smallest median largest seed with fewest"
        in lines
    )
    words = "Share of episodes that failed, mean over 3 seeds [95 % interval of the mean]: "
    assert any(line.startswith(words) for line in lines)
    assert [campaign.spec.seed for campaign in store.campaigns.page(10).items] == [3, 2, 1]
    assert {campaign.spec.name for campaign in store.campaigns.page(10).items} == {
        f"quick: seed={seed}" for seed in (1, 2, 3)
    }


def test_json_has_the_value_of_the_service(repeat, service):
    found = json.loads(repeat("--seeds", 3, "--json").stdout)
    (spread,) = found["over_seeds"]
    assert (spread["seeds"], spread["campaigns"]) == ([1, 2, 3], [1, 2, 3])
    assert [member["name"] for member in found["members"]] == ["seed=1", "seed=2", "seed=3"]
    with Client(transport=service) as client:
        (table,) = client.suites.table("quick").over_seeds
        assert client.campaigns.over_seeds([1, 2, 3]) == (table,)
        assert table.share.mean == spread["share"]["mean"]
        assert table.cost.per_failure_usd == spread["cost"]["per_failure_usd"]


def test_the_same_command_runs_nothing_twice_and_more_seeds_add_to_it(repeat, store):
    first = repeat("--seeds", 2, "--json")
    assert repeat("--seeds", 2, "--json").stdout == first.stdout
    assert repeat("--seeds", 3).exit_code == 0
    assert len(store.campaigns.page(10).items) == 3


def test_options_of_the_campaign_hold_for_every_seed(repeat, store):
    run = repeat("--seeds", 2, "--seed", 7, "--episodes", 12, "--stop-failures", 5)
    assert run.exit_code == 0, run.output
    specs = [campaign.spec for campaign in store.campaigns.page(10).items]
    assert [(spec.seed, spec.episodes, spec.stop.failures) for spec in specs] == [
        (8, 12, 5),
        (7, 12, 5),
    ]


@pytest.mark.parametrize("seeds", [0, 1, 1001, "many"])
def test_what_is_no_number_of_seeds_exits_with_2(repeat, store, seeds):
    refused = repeat("--seeds", seeds)
    assert refused.exit_code == 2
    assert "--seeds" in refused.stderr
    assert "Traceback" not in refused.output
    assert store.campaigns.page(10).items == ()


def test_seeds_beyond_the_largest_are_refused(repeat, store):
    refused = repeat("--seed", 2**63 - 1, "--seeds", 2)
    assert refused.exit_code == 2
    assert "seed" in refused.stderr
    assert store.campaigns.page(10).items == ()


def test_a_suite_with_seeds_per_variant_has_a_row_for_each(eigenfail, tmp_path):
    file = tmp_path / "grid.toml"
    file.write_text(
        '[base]\nmethod = "monte_carlo"\nplanner = "idm"\nsimulator = "point_mass"\nepisodes = 12\n'
        "[grid]\nscenario_parameters.distance_m = [60.0, 70.0]\nseed = [1, 2, 3]\n"
    )
    run = eigenfail("suite", "run", file)
    assert run.exit_code == 0, run.output
    for printed in (run.stdout, eigenfail("suite", "show", "grid").stdout):
        means = [
            line.split(":")[0]
            for line in list_lines(printed)
            if ": rate of all episodes, means over 3 seeds" in line
        ]
        assert means == ["distance_m=60", "distance_m=70"]
    assert len(Suite.read(file).members) == 6
