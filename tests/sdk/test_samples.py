"""Samples that a campaign's file takes from a column of a CSV file."""

from pathlib import Path

import pytest

from eigenfail.cli.specs import read_spec
from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.suites import Suite
from eigenfail.values.variation import MOST_SAMPLES

CAMPAIGN = """
method = "held"
episodes = 5
[scenario_parameters]
ego_speed_mps = 24.0
distance_m = {given}
"""
GIVEN = '{ empirical = "gaps.csv", column = "gap_m" }'


@pytest.fixture
def write(tmp_path: Path):
    def write_both(given: str = GIVEN, rows: str = "car,gap_m\na,57.5\nb,60\n") -> Path:
        (tmp_path / "gaps.csv").write_text(rows)
        file = tmp_path / "campaign.toml"
        file.write_text(CAMPAIGN.replace("{given}", given))
        return file

    return write_both


def test_a_column_stands_in_the_place_of_its_name(write) -> None:
    spec = read_spec(write())
    parameters = {"ego_speed_mps": 24.0, "distance_m": {"empirical": [57.5, 60.0]}}
    assert spec.scenario_parameters == parameters
    written = read_spec(write("{ empirical = [57.5, 60.0] }"))
    assert written.scenario_parameters == parameters


def test_a_suite_reads_it_from_its_own_folder(write, tmp_path: Path) -> None:
    write()
    file = tmp_path / "suite.toml"
    base = f'[base]\nmethod = "held"\nepisodes = 5\nscenario_parameters.distance_m = {GIVEN}\n'
    file.write_text(f"{base}[sweep]\nseed = [1, 2]\n")
    found = [member.spec.scenario_parameters for member in Suite.read(file).members]
    assert found
    assert all(each == {"distance_m": {"empirical": [57.5, 60.0]}} for each in found)


@pytest.mark.parametrize(
    ("given", "rows", "kind", "words"),
    [
        (GIVEN.replace("gap_m", "gap"), "car,gap_m\n", UnknownName, "Did you mean 'gap_m'"),
        ('{ empirical = "gaps.csv" }', "gap_m\n1\n", InvalidValue, "column .* is not named"),
        (GIVEN.replace("gaps.csv", "none.csv"), "", InvalidValue, "cannot be read"),
        (GIVEN, "car,gap_m\na,57.5\nb,wide\n", InvalidValue, "'wide' in line 3 of"),
        (GIVEN, "car,gap_m\na\n", InvalidValue, "'' in line 2 of"),
        (GIVEN, "gap_m\n" + "1\n" * (MOST_SAMPLES + 1), InvalidValue, "10001 rows"),
    ],
)
def test_what_cannot_be_read_is_refused_by_field(write, given, rows, kind, words) -> None:
    with pytest.raises(kind, match=words) as refused:
        read_spec(write(given, rows))
    assert refused.value.field.startswith("campaign.toml: scenario_parameters.distance_m")
