"""The file of `eigenfail risk`: what is refused, and by which name."""

import pytest

from eigenfail.errors import InputError
from eigenfail_assurance.risk.question import read_risk_file

HEAD = "[target]\nper_hour = 1e-3\n[exposure]\nhours = 100.0\nkilometres = 8000.0\n"
ONE = '[[scenarios]]\nname = "a"\nencounters = 3\ncampaigns = [1, "b"]\n'


def read(tmp_path, text):
    file = tmp_path / "motorway.toml"
    file.write_text(text)
    return read_risk_file(file)


def test_a_file_is_a_question(tmp_path):
    found = read(tmp_path, HEAD + ONE)
    assert found.name == "motorway"
    assert found.km_per_hour == 80.0
    assert found.scenarios[0].campaigns == (1, "b")
    assert found.episodes == 10_000


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("severty = [1.0]\n" + HEAD + ONE, "severity"),
        (HEAD + ONE + "encounter = 3\n", "encounters"),
        (HEAD.replace("per_hour", "per_hours") + ONE, "per_hour"),
        (HEAD, "scenarios"),
        (ONE, "target"),
        (HEAD.replace("per_hour = 1e-3", "") + ONE, "target"),
        (HEAD.replace("1e-3", "1e-3\nper_million_km = 3.0") + ONE, "target"),
        (HEAD.replace("1e-3", "-1.0") + ONE, "target.per_hour"),
        (HEAD.replace("100.0", "inf") + ONE, "exposure"),
        (HEAD + ONE + ONE, "scenarios"),
        (HEAD + ONE.replace("3", "-3"), "encounters"),
        (HEAD + ONE + "per_hour = 3.0\n", "scenario 'a'"),
        (HEAD + ONE.replace("encounters = 3", ""), "scenario 'a'"),
        (HEAD + ONE + "interval = [1.0, 2.0]\n", "scenario 'a'"),
        (HEAD + ONE.replace("encounters = 3", "per_hour = 3.0\ninterval = [4.0, 5.0]"), "'a'"),
        (HEAD + ONE.replace("encounters = 3", "per_hour = 3.0\nhours = 4.0"), "scenario 'a'"),
        ("severity = [2.0, 1.0]\n" + HEAD + ONE, "severity"),
        (
            HEAD.replace("per_hour = 1e-3", "per_million_km = 1.0").replace(
                "kilometres = 8000.0", ""
            )
            + ONE,
            "target.per_million_km",
        ),
        (
            HEAD.replace("kilometres = 8000.0", "")
            + ONE.replace("encounters = 3", "per_kilometre = 3.0"),
            "scenario 'a'",
        ),
        ("[target", "motorway.toml"),
        ("a = " + "[" * 3_000 + "]" * 3_000, "is not TOML"),
        ("a = " + "3" * 5_000, "is not TOML"),
    ],
)
def test_what_is_refused_is_named(tmp_path, text, named):
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    assert named in str(caught.value)
