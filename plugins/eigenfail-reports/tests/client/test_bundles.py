"""Archives from anywhere: within limits, and never outside their folder."""

import io
import warnings
import zipfile

import pytest

from eigenfail.errors import ProtocolError
from eigenfail_reports import client
from eigenfail_reports.client import unpack


def packed(*files, method=zipfile.ZIP_DEFLATED):
    file = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(file, "w", method) as bundle:
        warnings.simplefilter("ignore")  # of a name that comes twice
        for name, content in files:
            bundle.writestr(name, content)
    return file.getvalue()


def test_what_was_packed_comes_back():
    files = {"report.json": b"{}", "tables/a.csv": b"1"}
    for method in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA):
        assert unpack(packed(*files.items(), method=method)) == files


@pytest.mark.parametrize(
    "name",
    [
        *("../report.json", "/etc/passwd", "tables/../../a.csv", "tables/..", "C:\\a.csv"),
        *("tables\\a.csv", "tables/a.csv/", "report.json\n", "tables/.csv", "x.py"),
    ],
)
def test_a_name_that_is_no_file_of_a_report_is_refused_before_anything_is_read(name, monkeypatch):
    monkeypatch.setattr(zipfile.ZipFile, "read", lambda *_: pytest.fail("It was read."))
    with pytest.raises(ProtocolError, match="which is not part of a report") as refused:
        unpack(packed(("report.json", "{}"), (name, "x")))
    assert "Nothing was written." in str(refused.value)


def test_an_archive_that_swells_is_refused_at_the_limit(monkeypatch):
    monkeypatch.setattr(client, "MAX_BYTES", 1 << 20)
    half = b"\0" * (1 << 19)
    whole = {"report.json": half, "report.html": half}
    assert unpack(packed(*whole.items())) == whole
    swelling = packed(*whole.items(), ("tables/a.csv", "x"))
    assert len(swelling) < 10_000
    with pytest.raises(ProtocolError, match="unpacks to more than 1 MiB"):
        unpack(swelling)


def test_a_size_that_an_archive_claims_is_not_trusted(monkeypatch):
    monkeypatch.setattr(client, "MAX_BYTES", 100)
    honest = packed(("report.json", b"\0" * 5_000))
    true, claimed = (5_000).to_bytes(4, "little"), (5).to_bytes(4, "little")
    assert honest.count(true) == 2
    with pytest.raises(ProtocolError):
        unpack(honest.replace(true, claimed))


def test_too_many_files_and_files_that_come_twice_are_refused(monkeypatch):
    monkeypatch.setattr(client, "MAX_FILES", 3)
    many = packed(*((f"tables/{n}.csv", "x") for n in range(4)))
    with pytest.raises(ProtocolError, match="more than 3 files"):
        unpack(many)
    with pytest.raises(ProtocolError, match="a duplicate file"):
        unpack(packed(("report.json", "1"), ("report.json", "2")))


def broken(data):
    """The same archive with a bit of a file's content turned over."""
    begin = data.index(b"report.json") + len(b"report.json")
    place = (begin + data.index(b"PK\x01\x02")) // 2
    return data[:place] + bytes([data[place] ^ 0xFF]) + data[place + 1 :]


SAID = "The archive is damaged: .*Ask for it again|The response is not a report"


def locked(data):
    """The same archive, which says that it is encrypted."""
    local, central = data.index(b"PK\x03\x04") + 6, data.index(b"PK\x01\x02") + 8
    for place in (local, central):
        data = data[:place] + bytes([data[place] | 1]) + data[place + 1 :]
    return data


@pytest.mark.parametrize("spoil", [broken, locked, lambda data: data[:-10], lambda data: b"PK"])
@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA])
def test_a_damaged_archive_is_an_error_in_words(spoil, method):
    with pytest.raises(ProtocolError, match=SAID):
        unpack(spoil(packed(("report.json", b"[1, 2, 3]" * 9), method=method)))
