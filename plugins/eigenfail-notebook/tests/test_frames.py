"""Values as tables: the rows of each kind, for pandas and for numpy."""

import builtins
import math

import msgspec
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from store_checks.examples import deliver, result, running
from store_checks.modes import analysed

from eigenfail.errors import InvalidValue, ServiceError
from eigenfail.filters import CAMPAIGN_ORDERS, COLUMNS, read_value
from eigenfail.testing.examples import analysis_result, collision
from eigenfail.values.analysis import (
    Analysis,
    AnalysisResult,
    AnalysisSettings,
    AnalysisState,
    Mode,
)
from eigenfail.values.campaign import Campaign
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import Outcome
from eigenfail.values.records import Assessment, ConflictClass, EpisodeRow
from eigenfail.values.rows import Rows
from eigenfail.values.safety import FailurePoint
from eigenfail.values.summary import CostPoint, CourseBlock, Summary
from eigenfail_notebook import to_arrow, to_numpy, to_pandas
from eigenfail_notebook.frames import list_struct_columns

ROW = EpisodeRow(
    campaign=1,
    index=0,
    seed=5,
    outcome=Outcome.COLLISION,
    steps=4,
    source="prior",
    worker="w",
    robustness_m=0.0,
    log_probability=-8.0,
    severity=9.0,
    min_ttc_s=None,
    max_drac_mps2=None,
    wall_s=0.1,
    finished_ms=7,
    digest="d",
    has_scene=True,
)
SAFE = msgspec.structs.replace(ROW, index=1, outcome=Outcome.SAFE, severity=None)


@pytest.fixture
def analysis():
    result = AnalysisResult(
        episodes=(3, 7),
        explained=np.ones(2, np.float32),
        components=np.ones((2, 4, 2), np.float32),
        scores=np.array([[1.0, 2.0], [3.0, 4.0]], np.float32),
        labels=(1, 0),
        modes=(),
        influence=np.ones((4, 2), np.float32),
        silhouette=None,
        noise_silhouette=None,
    )
    return Analysis(5, 2, AnalysisSettings(), AnalysisState.DONE, 0, result)


def test_a_list_has_a_row_for_each_and_a_column_for_each_field():
    frame = to_pandas(Rows(lambda: iter([ROW, SAFE])))
    assert list(frame["outcome"]) == ["collision", "safe"]
    assert list(frame.loc[frame["severity"] > 0, "index"]) == [0]
    assert not any(name.startswith("assessed") for name in frame.columns)


def test_an_episode_has_the_columns_of_filters_and_files_and_no_other_name():
    assessed = Assessment(ConflictClass.PLANNER_FAILURE, 2.0, 0.25, unresolved=False)
    row = msgspec.structs.replace(ROW, assessed=assessed, requirements=(-0.5, 2.0))
    frame = to_pandas(Rows(lambda: iter([row])))
    beside = ["unresolved", "noise_pruned_ms"]
    assert list(frame.columns) == [*COLUMNS, "requirement_1", "requirement_2", *beside]
    first = frame.iloc[0]
    assert first["class"] == "planner_failure"
    for name in (*COLUMNS, "requirement_2"):
        value = read_value(row, name)
        assert pd.isna(first[name]) if value is None else first[name] == value
    assert isinstance(first["outcome"], str)


def test_a_campaign_has_the_columns_that_campaigns_are_sorted_by(client, fields):
    client.campaigns.create(**fields)
    campaign = to_pandas(client.campaigns.list())
    summary = to_pandas(client.campaigns.summaries())
    assert {*CAMPAIGN_ORDERS} <= {*campaign.columns, *summary.columns}
    assert {"failures", "completed", "planned", "errored"} <= {*campaign.columns} & {
        *summary.columns
    }
    assert {*CampaignSpec.__struct_fields__} - {"stop", "disturbance"} <= {*campaign.columns}
    assert "stop_failures" in campaign.columns


def test_a_setting_with_the_name_of_a_finding_is_kept_apart(client, fields):
    for failures in (1, 2):
        stop = {"failures": failures}
        client.campaigns.create(**fields | {"name": f"s: {failures}", "stop": stop})
    table = to_pandas(client.suites.table("s"))
    assert table["setting_failures"].tolist() == [1, 2]
    assert table["failures"].tolist() == [0, 0]


def test_arrow_has_null_where_nothing_is_known_and_json_in_place_of_nested_values(client, fields):
    table = to_arrow(Rows(lambda: iter([ROW, SAFE])))
    assert table.column_names == list(to_pandas(Rows(lambda: iter([ROW]))).columns)
    assert table["severity"].to_pylist() == [9.0, None]
    assert table["has_scene"].to_pylist() == [True, True]
    client.campaigns.create(**fields | {"settings": {"round_size": 5}})
    campaigns = to_arrow(client.campaigns.list())
    assert campaigns["requirements"].to_pylist() == [None]
    assert campaigns["settings"].to_pylist() == ['{"round_size":5}']
    kept = pa.BufferOutputStream()
    pq.write_table(campaigns, kept)
    assert pq.read_table(pa.BufferReader(kept.getvalue())).equals(campaigns)
    assert to_arrow(Rows(lambda: iter(()))).num_rows == 0


def test_the_types_of_arrow_do_not_depend_on_the_data(client, store, fields):
    full, bare = running(store, episodes=4), running(store, episodes=4)
    deliver(store, full, collision(0), result(1))
    deliver(store, bare, result(0))
    tables = [to_arrow(client.episodes.list(each)) for each in (full, bare)]
    assert pa.concat_tables(tables).num_rows == 3
    assert tables[1].schema.field("severity").type == pa.float64()
    picked = ["index", "class", "severity"]
    some = [to_arrow(client.episodes.list(each, fields=picked)) for each in (full, bare)]
    assert pa.concat_tables(some).column_names == picked
    nothing = client.episodes.list(bare, filter="severity > 1e9")
    assert to_arrow(nothing).schema == tables[0].schema
    client.campaigns.create(**fields | {"seed": 2, "stop": {"failures": 3}})
    campaigns = [client.campaigns.list(state=each) for each in ("queued", "running", "dead")]
    assert len({str(to_arrow(each).schema) for each in campaigns}) == 1
    assert to_arrow(tuple(campaigns[0])).schema == to_arrow(campaigns[0]).schema


def test_an_empty_table_has_its_columns(client, store):
    made = running(store, episodes=4)
    episodes = client.episodes.list(made)
    columns = [*COLUMNS, "unresolved", "noise_pruned_ms"]
    frame, table = to_pandas(episodes), to_numpy(episodes)
    assert (frame.empty, list(frame.columns), table.shape) == (True, columns, (0,))
    assert (frame["severity"] > 1).sum() == 0
    assert table["index"].dtype == np.int64
    assert list(to_pandas(client.episodes.list(made, fields=["index", "class"]))) == [
        "index",
        "class",
    ]
    assert "severity" in to_pandas(client.campaigns.safety(made.id))
    assert "failures" in to_pandas(client.campaigns.list(state="dead"))


@pytest.mark.parametrize("kind", [Campaign, Summary, Mode, CourseBlock, CostPoint, FailurePoint])
def test_known_columns_are_those_of_the_rows(kind, client, store, fields):
    made = running(store, episodes=4)
    deliver(store, made, collision(0), result(1))
    analysed(store, made, analysis_result())
    given = {
        Campaign: client.campaigns.list(),
        Summary: client.campaigns.summaries(),
        Mode: client.analyses.modes(1),
        CourseBlock: client.campaigns.course(made.id),
        CostPoint: client.campaigns.cost(made.id),
        FailurePoint: client.campaigns.safety(made.id),
    }[kind]
    known, table = list_struct_columns(kind), to_arrow(given)
    assert table.num_rows
    assert list(known) == table.column_names


def test_numbers_that_are_not_known_are_nan_in_numpy():
    table = to_numpy(Rows(lambda: iter([ROW, SAFE])))
    assert table["severity"].dtype == np.float64
    assert table["severity"][0] == 9.0
    assert math.isnan(table["severity"][1])
    assert table["index"].tolist() == [0, 1]
    assert table["has_scene"].dtype == bool


def test_a_list_with_nothing_in_it_is_an_empty_table():
    nothing = Rows(lambda: iter(()))
    assert to_pandas(nothing).empty
    assert to_numpy(nothing).shape == (0,)


def test_an_analysis_has_a_row_for_each_failure_and_its_scores(analysis):
    frame = to_pandas(analysis)
    assert frame.to_dict("list") == {
        "campaign": [2, 2],
        "index": [3, 7],
        "mode": [2, 1],
        "score_1": [1.0, 3.0],
        "score_2": [2.0, 4.0],
    }
    assert to_numpy(analysis) is analysis.result.scores


def test_an_analysis_without_a_result_says_so(analysis):
    queued = msgspec.structs.replace(analysis, state=AnalysisState.QUEUED, result=None)
    with pytest.raises(InvalidValue, match=r"analysis 5 is queued.*analyses\.wait"):
        to_numpy(queued)
    with pytest.raises(InvalidValue, match="queued"):
        to_pandas(queued)


def test_noise_has_a_row_for_each_step_in_metres_and_in_sigma():
    z = np.array([[1.0, -1.0], [0.5, 2.0]], np.float32)
    noise = NoiseTrajectory(z, np.full_like(z, 2.0))
    assert np.array_equal(to_numpy(noise), [[2.0, -2.0], [1.0, 4.0]])
    frame = to_pandas(noise)
    assert list(frame["lateral_m"]) == [-2.0, 4.0]
    assert list(frame["lateral_z"]) == [-1.0, 2.0]
    assert list(frame["longitudinal_sigma_m"]) == [2.0, 2.0]


@pytest.mark.parametrize("channels", [1, 3, 5])
def test_noise_by_itself_numbers_its_channels(channels):
    z = np.arange(2 * channels, dtype=np.float32).reshape(2, channels)
    noise = NoiseTrajectory(z, np.full_like(z, 2.0))
    assert np.array_equal(to_numpy(noise), 2.0 * z)
    frame = to_pandas(noise)
    assert len(frame.columns) == 1 + 3 * channels
    assert list(frame[f"channel_{channels}"]) == [2.0 * (channels - 1), 2.0 * (2 * channels - 1)]


def test_values_of_a_service_are_tables(client, fields):
    made = [client.campaigns.create(**fields).id for _ in range(2)]
    assert list(to_pandas(client.campaigns.list())["id"]) == made[::-1]
    assert to_pandas(client.campaigns.compare(*made))["side"].tolist() == ["A", "B"]
    assert to_pandas(client.campaigns.course(made[0])).empty
    assert to_numpy(client.campaigns.safety(made[0])).shape == (0,)
    assert to_pandas(client.campaigns.cost(made[0]))["usd"].tolist()[0] == 0.0
    summaries = tuple(client.campaigns.summaries())
    assert to_pandas((*summaries, None))["campaign"].tolist() == made[::-1]
    assert to_numpy(client.campaigns.get(made[0]))["name"].tolist() == ["first"]


@pytest.mark.parametrize("value", [3, "text", {"a": 1}])
def test_what_has_no_table_is_refused(value):
    with pytest.raises(InvalidValue, match="there is no table"):
        to_numpy(value)


def test_without_pyarrow_the_remedy_is_said(monkeypatch):
    ordinary = builtins.__import__

    def without(name, *rest):
        if name == "pyarrow":
            raise ImportError(name)
        return ordinary(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ServiceError, match=r"pip install 'plugins/eigenfail-notebook\[arrow\]'"):
        to_arrow(Rows(lambda: iter([ROW])))
    assert len(to_numpy(Rows(lambda: iter([ROW])))) == 1
