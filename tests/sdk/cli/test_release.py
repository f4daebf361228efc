"""`eigenfail release`: versions of a planner and their failure modes, from campaigns that ran."""

import json

import pytest

LINES = 'planner_version = "{}"\nproject = "lanes"\n'


@pytest.fixture
def tested(eigenfail, spec_file):
    """Run and analyse the campaign of a file for a version, and return its id."""
    plain = spec_file.read_text()

    def run(version, seed=1, analysed=True):
        text = plain.replace("seed = 1", f"seed = {seed}") + LINES.format(version)
        spec_file.write_text(text)
        ran = eigenfail("run", spec_file, "--json")
        assert ran.exit_code == 0, ran.output
        campaign = json.loads(ran.stdout)["campaign"]
        if analysed:
            assert eigenfail("analyze", campaign).exit_code == 0
        return campaign

    return run


def show(eigenfail, campaign):
    return json.loads(eigenfail("release", "show", campaign, "--json").stdout)


def test_a_rerun_under_another_version_shows_nothing_new(eigenfail, tested):
    tested("v1")
    newest = tested("v2", seed=2)
    (question,) = json.loads(eigenfail("release", "list", "--json").stdout)
    assert (question["campaign"], question["versions"]) == (newest, ["v1", "v2"])
    found = show(eigenfail, newest)
    assert [each["version"] for each in found["releases"]] == ["v1", "v2"]
    assert found["modes"]
    for mode in found["modes"]:
        first, second = (each["status"] for each in mode["sightings"])
        assert first in {"first seen", None}
        assert second in {"still there", "undecided"}
        assert mode["name"]
    drawn = eigenfail("release", "show", newest).stdout
    assert "in the first version compared (10)" in " ".join(drawn.split())


def test_a_version_without_an_analysis_is_not_compared(eigenfail, tested):
    tested("v1")
    newest = tested("v2", analysed=False)
    found = show(eigenfail, newest)
    assert f"run `eigenfail analyze {newest}`" in found["releases"][1]["problem"]
    assert all(mode["sightings"][1]["status"] is None for mode in found["modes"])
    assert any("are not compared" in note for note in found["notes"])


def test_projects_are_told_apart(eigenfail, tested):
    tested("v1")
    assert json.loads(eigenfail("release", "list", "--project", "other", "--json").stdout) == []
    assert len(json.loads(eigenfail("release", "list", "--project", "lanes", "--json").stdout)) == 1


def test_a_campaign_without_a_version_is_part_of_no_release(eigenfail, done):
    refused = eigenfail("release", "show", done)
    assert refused.exit_code != 0
    assert "is part of no release" in refused.stderr
    assert json.loads(eigenfail("release", "list", "--json").stdout) == []
