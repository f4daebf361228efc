"""`eigenfail campaign create`, `check` and `clone`: what scripts get of them."""

import json

import pytest


@pytest.mark.parametrize("words", [("--quiet",), ("-q", "--json")])
def test_quietly_the_id_alone_is_printed(eigenfail, spec_file, words):
    assert eigenfail("campaign", "create", spec_file, *words).stdout == "1\n"
    assert eigenfail("campaign", "clone", "1", *words).stdout == "2\n"


def test_otherwise_the_campaign_is_shown(eigenfail, spec_file):
    created = eigenfail("campaign", "create", spec_file).stdout
    assert created.startswith("campaign     1: quick")
    cloned = eigenfail("campaign", "clone", "1", "--seed", "4", "--json").stdout
    assert json.loads(cloned)["spec"]["seed"] == 4


def test_a_quiet_check_says_it_by_its_exit_code(eigenfail, spec_file, store):
    good = eigenfail("campaign", "check", spec_file, "-q")
    spec_file.write_text(spec_file.read_text().replace("idm", "idn"))
    bad = eigenfail("campaign", "check", spec_file, "-q")
    assert (good.exit_code, good.output) == (0, "")
    assert (bad.exit_code, bad.output) == (2, "")
    assert store.campaigns.page(1).items == ()
