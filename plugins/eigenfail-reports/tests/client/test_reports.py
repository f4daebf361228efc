"""Reports written by the client: all of it, or nothing."""

import io
import zipfile
from pathlib import Path

import httpx2
import pytest

from eigenfail.errors import InvalidValue, NotFound, ProtocolError, ServiceError
from eigenfail_reports.client import write_report


@pytest.fixture
def campaign(client, fields):
    return client.campaigns.create(**fields).id


def names(folder):
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def test_a_report_is_written_whole(client, campaign, tmp_path):
    made = write_report(client, campaign, tmp_path / "new" / "out")
    found = names(tmp_path / "new" / "out")
    assert {"report.html", "report.json", "tables/results.csv"} <= found
    assert {f"tables/{table.name}.csv" for table in made.tables} <= found
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["out"]
    assert made.campaigns[0].id == campaign


def test_an_empty_folder_may_be_filled(client, campaign, tmp_path):
    (tmp_path / "out").mkdir()
    write_report(client, [campaign], tmp_path / "out")
    assert "report.html" in names(tmp_path / "out")


def test_a_report_is_replaced_only_by_force(client, campaign, tmp_path):
    out = tmp_path / "out"
    write_report(client, campaign, out)
    (out / "tables" / "of-an-older-release.csv").write_text("x")
    with pytest.raises(InvalidValue, match="--force"):
        write_report(client, campaign, out)
    write_report(client, campaign, out, force=True)
    assert "tables/of-an-older-release.csv" not in names(out)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("force", [False, True])
def test_what_is_no_report_is_never_overwritten(client, campaign, tmp_path, force):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(InvalidValue, match="contains files of no report"):
        write_report(client, campaign, tmp_path, force=force)
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


def test_nothing_is_written_of_a_campaign_that_is_not_there(client, tmp_path):
    with pytest.raises(NotFound):
        write_report(client, 7, tmp_path / "out")
    assert not list(tmp_path.iterdir())


def test_nothing_is_left_of_a_report_that_cannot_be_written(
    client, campaign, tmp_path, monkeypatch
):
    write_report(client, campaign, tmp_path / "out")
    before = (tmp_path / "out" / "report.json").read_bytes()

    def full_disk(self, content):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full_disk)
    with pytest.raises(ServiceError, match="No space left"):
        write_report(client, campaign, tmp_path / "out", force=True)
    assert (tmp_path / "out" / "report.json").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def packed(**files):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as bundle:
        for name, content in files.items():
            bundle.writestr(name, content)
    return file.getvalue()


@pytest.mark.parametrize(
    "answer",
    [
        b"<html>",
        packed(),
        packed(**{"report.json": "{}", "../elsewhere.csv": "x"}),
        packed(**{"report.json": "{}", "/etc/passwd": "x"}),
        packed(**{"report.json": "{}"}),
    ],
)
def test_an_answer_that_is_no_report_is_refused(scripted, tmp_path, answer):
    client, _ = scripted(lambda request, count: httpx2.Response(200, content=answer))
    with pytest.raises(ProtocolError):
        write_report(client, 1, tmp_path / "out")
    assert not list(tmp_path.iterdir())


def test_a_report_with_other_files_in_it_stays_even_if_forced(client, campaign, tmp_path):
    out = tmp_path / "out"
    write_report(client, campaign, out)
    (out / "notes.md").write_text("mine")
    with pytest.raises(InvalidValue, match=r"notes\.md"):
        write_report(client, campaign, out, force=True)
    assert (out / "notes.md").read_text() == "mine"


def test_a_report_that_cannot_come_in_leaves_the_old_one(client, campaign, tmp_path, monkeypatch):
    out = tmp_path / "out"
    write_report(client, campaign, out)
    before = (out / "report.json").read_bytes()
    rename = type(out).rename

    def refuse(path, target):
        if path.name == "made":
            raise PermissionError(13, "Permission denied")
        return rename(path, target)

    monkeypatch.setattr(type(out), "rename", refuse)
    with pytest.raises(ServiceError, match="cannot be written"):
        write_report(client, campaign, out, force=True)
    assert (out / "report.json").read_bytes() == before
