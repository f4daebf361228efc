"""Episodes as files over HTTP, made while they are sent."""

import csv
import hashlib
import io
import json

import msgspec
import pytest
from msgspec.structs import replace
from store_checks.examples import deliver, name_channels, result_of, running

import eigenfail
from eigenfail.filters import BY_INDEX, COLUMNS
from eigenfail.values.episode import Outcome
from eigenfail.values.records import Delivery
from eigenfail_services import export_formats

URL = "/api/v1/campaigns"


@pytest.fixture
def filled(campaign, store, deliver, result, failed):
    """Three collisions, a safe episode and one that could not be run."""
    deliver(campaign, result(0), *(result(i, Outcome.COLLISION) for i in (1, 2, 3)), failed(4))
    store.episodes.commit(campaign, [Delivery(replace(result(5), source="=1+1"), "@evil")])
    return campaign


def table(response):
    assert response.status_code == 200, response.text
    return list(csv.DictReader(io.StringIO(response.text)))


def test_csv_has_a_line_for_each_episode(http, filled):
    response = http.get(f"{URL}/{filled}/episodes.csv")
    rows = table(response)
    assert response.headers["content-type"].startswith("text/csv")
    assert "campaign-1.csv" in response.headers["content-disposition"]
    assert list(rows[0]) == list(COLUMNS)
    assert [row["index"] for row in rows] == ["0", "1", "2", "3", "4", "5"]
    assert (rows[1]["severity"], rows[0]["severity"]) == ("25.0", "")
    assert (rows[1]["has_scene"], rows[0]["has_scene"]) == ("true", "false")
    assert rows[4]["problem"] == "planner: It raised."
    assert float(rows[0]["log_probability"]) < 0.0


@pytest.mark.fault("markup in names, formulas in exported tables")
def test_texts_are_no_formulas_but_numbers_stay_numbers(http, filled):
    rows = table(http.get(f"{URL}/{filled}/episodes.csv", params={"filter": "index = 5"}))
    assert (rows[0]["source"], rows[0]["worker"]) == ("'=1+1", "'@evil")
    assert rows[0]["log_probability"].startswith("-")


def test_files_take_filter_sort_and_fields(http, filled):
    asked = {"filter": "outcome = collision", "sort": "-index", "fields": "index,outcome"}
    text = http.get(f"{URL}/{filled}/episodes.csv", params=asked).text
    assert text.split() == ["index,outcome", "3,collision", "2,collision", "1,collision"]
    lines = http.get(f"{URL}/{filled}/episodes.ndjson", params=asked).text.splitlines()
    assert [json.loads(line)["index"] for line in lines] == [3, 2, 1]
    assert set(json.loads(lines[0])) == {"index", "outcome"}


def test_ndjson_has_every_column_and_null_for_what_is_missing(http, filled):
    lines = http.get(f"{URL}/{filled}/episodes.ndjson").text.splitlines()
    rows = [json.loads(line) for line in lines]
    assert [list(row) for row in rows] == [list(COLUMNS)] * 6
    assert rows[0]["severity"] is None


def test_portions_follow_each_other(http, filled, monkeypatch):
    monkeypatch.setattr(export_formats, "PORTION", 2)
    rows = table(http.get(f"{URL}/{filled}/episodes.csv", params={"sort": "severity"}))
    assert [row["index"] for row in rows] == ["1", "2", "3", "0", "4", "5"]


def test_nothing_is_a_file_without_lines(http, filled):
    nothing = {"filter": "severity < 0"}
    assert table(http.get(f"{URL}/{filled}/episodes.csv", params=nothing)) == []
    assert http.get(f"{URL}/{filled}/episodes.ndjson", params=nothing).text == ""


@pytest.mark.parametrize("form", ["csv", "ndjson", "parquet"])
def test_what_cannot_be_streamed_is_a_problem_not_half_a_file(http, campaign, problem, form):
    wrong = {"filter": "severity >"}
    problem(http.get(f"{URL}/{campaign}/episodes.{form}", params=wrong), 422)
    problem(http.get(f"{URL}/99/episodes.{form}"), 404)


def parquet_of(http, campaign, **asked):
    import pyarrow.parquet

    response = http.get(f"{URL}/{campaign}/episodes.parquet", params=asked)
    assert response.status_code == 200, response.text
    assert response.headers["content-type"] == "application/vnd.apache.parquet"
    assert f"campaign-{campaign}.parquet" in response.headers["content-disposition"]
    return pyarrow.parquet.ParquetFile(io.BytesIO(response.content))


def test_parquet_has_types_noise_and_packed_columns(http, filled, result):
    asked = {"filter": "outcome = collision", "sort": "-index", "noise": True}
    file = parquet_of(http, filled, **asked)
    rows = file.read().to_pylist()
    assert [row["index"] for row in rows] == [3, 2, 1]
    assert list(rows[0]) == [*COLUMNS, "longitudinal_z", "lateral_z"]
    z = result(3, Outcome.COLLISION).noise.z
    assert rows[0]["longitudinal_z"] == z[:, 0].tolist()
    assert rows[0]["lateral_z"] == z[:, 1].tolist()
    chunk = file.metadata.row_group(0)
    packed = {chunk.column(i).path_in_schema: chunk.column(i) for i in range(chunk.num_columns)}
    assert {column.compression for column in packed.values()} == {"ZSTD"}
    for name in ("severity", "log_probability", "lateral_z.list.element"):
        assert "BYTE_STREAM_SPLIT" in packed[name].encodings


def test_parquet_is_sent_while_it_is_written(http, store, filled, monkeypatch):
    monkeypatch.setattr(export_formats, "PORTION", 2)
    file = parquet_of(http, filled, sort="severity")
    assert file.num_row_groups == 3
    assert [row["index"] for row in file.read().to_pylist()] == [1, 2, 3, 0, 4, 5]
    wanted = export_formats.Selection((), BY_INDEX, ("index",))
    source = export_formats.ExportSource(store, filled, wanted)
    parts = list(export_formats.write_parquet(source, noise=False))
    assert len(parts) == 4
    assert all(parts)


@pytest.mark.parametrize("channels", [1, 3, 5])
def test_parquet_holds_the_noise_of_each_channel(http, store, channels):
    campaign = running(store, **name_channels(channels))
    deliver(store, campaign, *(result_of(channels, index) for index in range(2)))
    file = parquet_of(http, campaign.id, fields="index", noise=True)
    names = [f"c{number}_z" for number in range(channels)]
    for row in file.read().to_pylist():
        z = result_of(channels, row.pop("index")).noise.z
        assert row == {name: z[:, column].tolist() for column, name in enumerate(names)}
    origin = json.loads(file.schema_arrow.metadata[b"eigenfail"])
    assert origin["units"] == dict.fromkeys(names, "sigma")


def test_a_parquet_file_says_where_it_comes_from(http, store, filled, tmp_path):
    import pandas as pd

    asked = {"fields": "index,severity,min_ttc_s", "noise": True}
    schema = parquet_of(http, filled, **asked).schema_arrow
    origin = json.loads(schema.metadata[b"eigenfail"])
    sorted_json = msgspec.json.encode(store.campaigns.get(filled).spec, order="sorted")
    assert origin == {
        "campaign": filled,
        "spec_sha256": hashlib.sha256(sorted_json).hexdigest(),
        "eigenfail": eigenfail.__version__,
        "units": {
            "severity": "m²/s²",
            "min_ttc_s": "s",
            "longitudinal_z": "sigma",
            "lateral_z": "sigma",
        },
    }
    assert schema.field("min_ttc_s").metadata == {b"words": b"smallest time to collision [s]"}
    path = tmp_path / "fetched.parquet"
    path.write_bytes(http.get(f"{URL}/{filled}/episodes.parquet", params=asked).content)
    assert pd.read_parquet(path).attrs == origin


def test_parquet_of_nothing_has_its_columns(http, filled):
    file = parquet_of(http, filled, filter="severity < 0", fields="index,severity,has_scene")
    assert file.metadata.num_rows == 0
    assert file.schema_arrow.names == ["index", "severity", "has_scene"]


def test_parquet_needs_its_library(http, campaign, problem, monkeypatch):
    problem(http.get(f"{URL}/{campaign}/episodes.parquet", params={"fields": "sevrity"}), 422)
    monkeypatch.setattr(export_formats, "find_spec", lambda _: None)
    told = problem(http.get(f"{URL}/{campaign}/episodes.parquet"), 422)
    assert ".[export]" in told["remedy"]
