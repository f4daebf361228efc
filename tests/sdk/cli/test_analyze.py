"""`eigenfail analyze`: its options, and what it says besides the modes."""

import json
import re
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import httpx2
import msgspec
import numpy as np
import pytest
from example_values import NOTHING, make_findings
from msgspec.structs import replace

from eigenfail.client import Client
from eigenfail.presentation import analyses
from eigenfail.values import analysis
from eigenfail.values.estimates import Interval

README = Path(__file__).parents[3] / "README.md"
EPISODE = re.compile(r"(?<=episode )\d+/\d+")
"""Replays of two analyses are in two campaigns."""
URL = "http://127.0.0.1:8440"
BARE = make_findings()


def test_every_option_reaches_the_analysis(eigenfail, done, spec_file, store):
    also = json.loads(eigenfail("run", spec_file, "--seed", 5, "--json").stdout)["campaign"]
    asked = eigenfail(
        *("analyze", done, "--axes", "longitudinal", "--clusterer", "gaussian_mixture"),
        *("--also", also, "--bootstrap", 3, "--clusters", 2, "--json"),
    )
    assert asked.exit_code == 0, asked.output
    settings = json.loads(asked.stdout)["analysis"]["settings"]
    assert settings | {"align": "start", "components": 3} == settings
    assert (settings["axes"], settings["clusterer"]) == ("longitudinal", "gaussian_mixture")
    assert (settings["campaigns"], settings["bootstrap"], settings["clusters"]) == ([also], 3, 2)
    result = json.loads(asked.stdout)["analysis"]["result"]
    assert set(result["campaigns"]) == {done, also}
    assert result["stability"]["resamples"] == 3


def test_wrong_options_are_refused_in_words(check_session, done):
    wrong = (
        ("--also", 99),
        ("--clusterer", "hdbscan", "--clusters", 3),
        ("--bootstrap", -1),
        ("--clusterer", "ward"),
        ("--axes", "latral"),
    )
    check_session("cli/errors/analyze", *(("analyze", done, *options) for options in wrong))


def test_a_command_without_options_has_the_defaults_of_all_other_faces(eigenfail, done, service):
    asked = eigenfail("analyze", done, "--json")
    assert asked.exit_code == 0, asked.output
    by_command = msgspec.convert(
        json.loads(asked.stdout)["analysis"]["settings"], analysis.AnalysisSettings
    )
    with Client(URL, service) as client:
        by_client = client.analyses.create(done).settings
    by_rest = service.api.handle_request(
        httpx2.Request("POST", f"{URL}/api/v1/campaigns/{done}/analyses", json={})
    )
    assert by_rest.status_code == 201
    by_rest = msgspec.json.decode(by_rest.read(), type=analysis.Analysis).settings
    form = service.api.handle_request(httpx2.Request("GET", f"{URL}/campaigns/{done}")).read()
    assert {by_command, by_client, by_rest, read_form(form.decode()), load_demo().ANALYSIS} == {
        analysis.AnalysisSettings()
    }


def read_form(page):
    """The settings that the form of a page has before anybody changes them."""
    (form,) = re.findall(r"<form[^>]*/analyses\">.*?</form>", page, re.DOTALL)
    chosen = dict(re.findall(r'<select name="(\w+)">.*?value="(\w*)" selected', form, re.DOTALL))
    typed = dict(re.findall(r'<input name="(\w+)" [^>]*value="(\w*)"', form))
    typed.pop("campaigns")
    numbers = {name: int(value) for name, value in typed.items() if value}
    return msgspec.convert(chosen | numbers, analysis.AnalysisSettings)


def test_demo_prints_the_modes_that_the_command_of_the_readme_prints(
    eigenfail, spec_file, service, capsys
):
    spec_file.write_text(spec_file.read_text().replace("24", "60"))
    for _ in range(2):
        assert eigenfail("run", spec_file).exit_code == 0
    (command,) = re.findall(r"^eigenfail (analyze 2.*?) *#", README.read_text(), re.MULTILINE)
    by_command = EPISODE.sub("", eigenfail(*command.split()).stdout).splitlines()
    with Client(URL, service) as client:
        load_demo().explain(client, 2)
    _, heading, *printed = EPISODE.sub("", capsys.readouterr().out).splitlines()
    assert heading.startswith("Failure modes of campaign 2")
    assert len(printed) > 8
    assert [line for line in printed if line not in by_command] == []


def load_demo():
    found = spec_from_file_location("demo", README.parent / "examples" / "demo.py")
    module = module_from_spec(found)
    found.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("step_s", "words"),
    [(None, "lateral at step 3"), (0.1, "lateral 0.200 s before the collision")],
)
def test_where_noise_differs_is_told_in_the_alignment_of_the_analysis(step_s, words):
    components = np.zeros((1, 5, 2), np.float32)
    components[0, 3, 1] = -1.0
    mode = analysis.FailureMode(
        failures=2,
        medoid=0,
        centre=NOTHING,
        eigenfailure=NOTHING,
        components=components,
        explained=np.ones(1, np.float32),
    )
    table = analyses.tabulate_noise_within(replace(BARE, modes=(mode,)), step_s)
    assert table.rows[0][-1] == words


def test_a_verdict_says_which_test_failed():
    modes = replace(BARE, silhouette=0.5, noise_silhouette=0.3, stability=None)
    unstable = replace(modes, stability=analysis.Stability(20, 300, 0.5, Interval(0.1, 0.9)))
    assert (modes.distinct, unstable.distinct) == (True, False)
    assert "adjusted Rand index is 0.50, below 0.8" in unstable.verdict
    assert "cannot be distinguished from noise" in replace(modes, noise_silhouette=0.6).verdict


def test_modes_of_few_failures_and_a_low_interval_are_told_with_the_verdict():
    modes = replace(BARE, silhouette=0.5, noise_silhouette=0.3, stability=None)

    def of(*sizes, low=None):
        made = tuple(analysis.FailureMode(count, 0, NOTHING, NOTHING) for count in sizes)
        stability = None if low is None else analysis.Stability(20, 15, 1.0, Interval(low, 1.0))
        return replace(modes, modes=made, stability=stability)

    assert of(14, 5, 2, 2).verdict.startswith(
        "2 distinct modes, 2 more with too few failures (silhouette 0.50"
    )
    assert of(3, 12, low=0.8).caution == of(3, 12).caution == ""
    assert of(14, 1).caution == "Mode 2 has a single failure: fewer than 3 do not show a mode."
    assert of(2, 14, 1).caution.startswith("Mode 1 has 2 failures, mode 3 has a single failure: ")
    low = of(14, 4, low=0.0)
    assert low.distinct
    assert "adjusted Rand index is 1.00" in low.verdict
    assert low.caution == (
        "The interval of the index begins at 0.00, below 0.8: some draws of the failures fall into "
        "other groups."
    )
    assert replace(low, noise_silhouette=0.6).caution == ""
    assert analyses.describe_modes(1, replace(low, modes=()))[
        -1
    ] == f"{low.verdict} {low.caution}".replace("2 distinct", "0 distinct")


def test_clusters_that_are_not_distinct_are_groups_wherever_they_are_named():
    words = ("Mode 1: It pushes.", "Mode 2: It pulls.")
    modes = replace(BARE, silhouette=0.5, noise_silhouette=0.3, words=words)
    groups = replace(modes, noise_silhouette=0.6)
    assert [*analyses.list_mode_words(modes)] == [*words]
    assert [*analyses.list_mode_words(groups)] == ["Group 1: It pushes.", "Group 2: It pulls."]
    assert [analyses.tabulate_modes(1, each).columns[0].title for each in (modes, groups)] == [
        "Mode",
        "Group",
    ]


@pytest.mark.usefixtures("tiny_formats")
def test_an_animation_of_each_mode_is_written_to_a_folder(eigenfail, done, tmp_path):
    folder = tmp_path / "animations"
    asked = ("analyze", done, "--clusters", 2, "--bootstrap", 0, "--animations", folder)
    assert eigenfail(*asked).exit_code == 0
    assert sorted(path.name for path in folder.iterdir()) == ["mode-1.gif", "mode-2.gif"]
    assert all(path.read_bytes().startswith(b"GIF89a") for path in folder.iterdir())
    taken = tmp_path / "file"
    taken.touch()
    refused = eigenfail(*asked[:-1], taken / "folder")
    assert refused.exit_code == 3
    assert "cannot be made" in refused.stderr
    assert refused.stdout == ""


@pytest.mark.usefixtures("tiny_formats")
def test_an_animation_that_fails_leaves_the_result_printed(eigenfail, done, tmp_path):
    (tmp_path / "mode-1.gif").mkdir()
    asked = ("analyze", done, "--clusters", 2, "--bootstrap", 0, "--json")
    refused = eigenfail(*asked, "--animations", tmp_path)
    assert refused.exit_code == 3
    assert json.loads(refused.stdout)["analysis"]["result"]


def test_without_the_format_an_animation_is_refused_after_the_result(
    eigenfail, done, tmp_path, tiny_formats
):
    del tiny_formats["gif"]
    asked = ("analyze", done, "--clusters", 2, "--bootstrap", 0, "--animations", tmp_path)
    refused = eigenfail(*asked)
    assert refused.exit_code == 2
    assert "pip install plugins/" in refused.stderr
    assert "analysis" in refused.stdout
