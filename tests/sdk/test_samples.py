"""Samples that a campaign's file takes from a column of a CSV file."""

import io
import os
from pathlib import Path

import pytest

from eigenfail import files
from eigenfail.cli.specs import read_spec
from eigenfail.errors import InvalidValue
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
        (GIVEN.replace("gap_m", "gap"), "car,gap_m\n", InvalidValue, "Did you mean 'gap_m'"),
        ('{ empirical = "gaps.csv" }', "gap_m\n1\n", InvalidValue, "column .* is not named"),
        (GIVEN.replace("gaps.csv", "none.csv"), "", InvalidValue, "cannot be read"),
        (GIVEN, "car,gap_m\na,57.5\nb,wide\n", InvalidValue, "gaps.csv, row 3: gap_m: 'wide'"),
        (GIVEN, "car,gap_m\na\n", InvalidValue, "gaps.csv, row 2: gap_m: is empty"),
        (GIVEN, "gap_m\n" + "1\n" * (MOST_SAMPLES + 1), InvalidValue, "more than 10,000 rows"),
    ],
)
def test_what_cannot_be_read_is_refused_by_field(write, given, rows, kind, words) -> None:
    with pytest.raises(kind, match=words) as refused:
        read_spec(write(given, rows))
    assert refused.value.field.startswith("campaign.toml: scenario_parameters.distance_m")


@pytest.mark.parametrize("name", ["/dev/zero", "/dev/random", "pipe.csv", "folder.csv"])
def test_a_sample_is_read_from_a_regular_file_alone(write, tmp_path: Path, name) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(InvalidValue, match=r"not a regular file|Is a directory") as refused:
        read_spec(write(GIVEN.replace("gaps.csv", name)))
    assert refused.value.field.startswith("campaign.toml: scenario_parameters.distance_m")


def test_a_sample_is_not_read_beyond_its_bound(write, tmp_path: Path, monkeypatch) -> None:
    class Endless(io.BytesIO):
        """A file that grows while it is read."""

        def read1(self, _size: int = -1) -> bytes:
            return b"1\n" * 100

        read = read1

    grown = Endless()
    with monkeypatch.context() as patch:
        patch.setattr(files, "open_regular", lambda *_: grown)
        with pytest.raises(InvalidValue, match="more than 10,000 rows"):
            files.read_table(
                tmp_path / "a.csv", files.TableColumns("", ("1",), (), "", MOST_SAMPLES)
            )


@pytest.mark.parametrize("name", ["/dev/zero", "pipe.toml"])
def test_campaigns_are_read_from_regular_files_alone(tmp_path: Path, name) -> None:
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(InvalidValue, match="not a regular file"):
        read_spec(tmp_path / name)


def test_a_long_file_is_no_campaign(tmp_path: Path) -> None:
    file = tmp_path / "campaign.toml"
    file.write_bytes(b"#" * (files.MOST_BYTES + 1))
    with pytest.raises(InvalidValue, match="at most 10,000,000 are read"):
        read_spec(file)


def test_a_table_of_one_endless_line_is_refused(write, tmp_path: Path) -> None:
    file = write()
    with (tmp_path / "gaps.csv").open("wb") as sparse:
        sparse.truncate(1_000_000_000)
    with pytest.raises(InvalidValue, match="a line has more than 1,000,000 characters"):
        read_spec(file)
