"""The report beside the paper's tables: fetched from the service, if it makes reports."""

import io
import zipfile

import httpx2
import pytest

from eigenfail.client import Client
from eigenfail.errors import NotFound, ProtocolError
from eigenfail.wire.http import encode, make_problem
from eigenfail_reproduction.report import fetch_report


def ask(answer):
    """Return the report of a service that answers like this, and the addresses it was asked for."""
    asked = []

    def handle(request):
        asked.append(request.url)
        return answer

    with Client(transport=httpx2.MockTransport(handle)) as client:
        return fetch_report(client, [3, 1]), asked


def pack(*names):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name in names:
            archive.writestr(name, name)
    return httpx2.Response(200, content=file.getvalue())


def test_files_of_a_report_are_kept_and_no_others():
    kept = ("report.html", "tables/results.csv", "pictures/training-campaign-1.svg")
    files, (url,) = ask(pack(*kept, "../elsewhere.csv", "/etc/passwd", "notes.txt"))
    assert files == {name: name.encode() for name in kept}
    assert url.params.get_list("campaign") == ["3", "1"]
    assert url.params["format"] == "zip"


def test_a_service_without_reports_gives_none():
    problem = encode(make_problem(NotFound("Not Found", "")))
    headers = {"content-type": "application/problem+json"}
    assert ask(httpx2.Response(404, content=problem, headers=headers))[0] == {}


def test_an_answer_that_is_no_archive_is_refused():
    with pytest.raises(ProtocolError):
        ask(httpx2.Response(200, content=b"<html>"))
