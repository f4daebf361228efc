"""The form of a new suite: axes, a preview, problems at their fields, and what is launched."""

import html
import json
import re
import tomllib
from itertools import pairwise
from math import isfinite
from urllib.parse import unquote

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.suites import Suite, SuiteFile, expand_suite
from eigenfail.values import CampaignState
from eigenfail_api.dashboard.copying import to_suite_toml
from eigenfail_api.dashboard.suite_axes import (
    Axis,
    PreviewMember,
    find_axis_values,
    format_values,
    make_axes,
    make_preview,
    read_axes,
)

FORM = "/suites/new/form"
KEY = re.compile(r'data-key="([^"]*)"')
BODY = re.compile(r'data-body="([^"]*)"')
FILE = re.compile(r'href="data:application/toml;charset=utf-8,([^"]*)"')


@pytest.fixture
def typed():
    """A suite of four campaigns, as it is typed."""
    return {
        "suite": "two by two",
        "method": "monte_carlo",
        "episodes": "20",
        "simulator": "point_mass",
        "way": "grid",
        "wish": "check",
        "axis.1.field": "seed",
        "axis.1.values": "1, 2",
        "axis.2.field": "planner",
        "axis.2.values": "idm, rulebook",
    }


@pytest.fixture
def draw(http):
    def post(**data):
        answer = http.post(FORM, data=data)
        assert answer.status_code == 200, answer.text
        return answer.text

    return post


def body_of(page):
    return json.loads(html.unescape(BODY.search(page)[1]))


def test_a_suite_in_order_is_told_whole(draw, typed, golden):
    page = draw(**typed)
    golden.check_page("dashboard/suite_form/valid", page, "launch-word")
    golden.check_page("dashboard/suite_form/preview", page, "preview")
    assert KEY.search(page)[1]


def test_what_is_launched_is_a_suite_of_the_service(draw, typed, http, store):
    body = body_of(draw(**typed))
    assert body["grid"] == {"seed": [1, 2], "planner": ["idm", "rulebook"]}
    made = http.post("/api/v1/suites", json=body)
    assert made.status_code == 201, made.text
    assert len(store.campaigns.page(10).items) == 4
    assert 'data-page="/suites/two%20by%20two"' in draw(**typed)


def test_the_file_that_is_offered_is_the_same_suite(draw, typed, tmp_path):
    page = draw(**typed)
    file = tmp_path / "suite.toml"
    file.write_text(unquote(FILE.search(page)[1]))
    assert Suite.read(file) == Suite.of(**body_of(page))
    again = draw(wish="import", toml=file.read_text())
    assert body_of(again) == body_of(page)


def test_every_problem_stands_at_its_field(draw, typed, golden):
    wrong = {
        "suite": "",
        "episodes": "many",
        "axis.1.values": "1, -2",
        "axis.2.field": "settings.round_size",
        "axis.2.values": "0, 5",
    }
    page = draw(**{**typed, **wrong})
    golden.check_page("dashboard/suite_form/problems", page, "launch-word")
    assert not KEY.search(page)[1]
    page = draw(**{**typed, **wrong, "axis.3.start": "1"})
    golden.check_page("dashboard/suite_form/axis_problems", page, "launch-word")


def test_only_members_that_are_refused_are_marked(draw, typed, golden):
    page = draw(**{**typed, "axis.1.values": "1, -2", "axis.3.field": "episodes"})
    assert "Give values, or start, stop and number." in html.unescape(page)
    page = draw(**{**typed, "axis.1.values": "1, -2"})
    golden.check_page("dashboard/suite_form/refused_members", page, "preview")


def test_nothing_is_wrong_before_it_is_checked(draw):
    page = draw(wish="")
    assert "problem" not in page
    assert 'id="preview"' not in page


def test_a_setting_is_varied_once(draw, typed):
    page = draw(**{**typed, "axis.2.field": "seed", "axis.2.values": "3"})
    assert "seed varies already" in page


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"axis.1.values": "1, 1"}, "The suite has two members"),
        ({"axis.1.start": "1"}, "and not both"),
        ({"axis.1.values": "["}, "not a list in JSON"),
        ({"axis.1.values": "", "axis.1.start": "1", "axis.1.stop": "2"}, "start, stop and number"),
        (
            {"axis.1.values": "", "axis.1.start": "1", "axis.1.stop": "x", "axis.1.number": "3"},
            "'x' is not a number",
        ),
        (
            {"axis.1.values": "", "axis.1.start": "0", "axis.1.stop": "9", "axis.1.number": "2000"},
            "from 2 to 1,000",
        ),
        (
            {
                "axis.1.values": "",
                "axis.1.start": "0",
                "axis.1.stop": "1e308",
                "axis.1.number": "3",
            },
            "from -1e+300 to 1e+300",
        ),
        (
            {
                "axis.1.values": "",
                "axis.1.start": "-1" + 400 * "0",
                "axis.1.stop": "1",
                "axis.1.number": "3",
            },
            "from -1e+300 to 1e+300",
        ),
        (
            {"axis.1.field": "settings", "axis.2.field": "settings.round_size"},
            "settings.round_size is a part of settings, which varies too",
        ),
        (
            {"axis.1.field": "settings.round_size", "axis.2.field": "settings"},
            "settings.round_size is a part of settings, which varies too",
        ),
        ({"axis.1.values": ",".join(map(str, range(600)))}, "1200 members, more than 1000"),
        ({"axis.1.field": "settings.hidden", "axis.1.values": "8, 4"}, "round_size"),
        ({"suite": "a: b"}, "another suite"),
        ({"suite": "x" * 300}, "length"),
        ({"from": "99"}, "Campaign 99 does not exist"),
        ({"from": "x"}, "not a campaign id"),
    ],
    ids=str,
)
def test_what_cannot_be_is_refused_in_words(draw, typed, changes, words):
    page = draw(**{**typed, **changes})
    assert words in html.unescape(page)
    assert not KEY.search(page)[1]


def test_members_that_are_too_large_together_are_refused(draw):
    base = f'method = "monte_carlo"\nepisodes = 5\nplanner = "{"x" * 30_000}"'
    page = draw(wish="import", toml=f'name = "a"\n[base]\n{base}\n[grid]\nseed = {[*range(900)]}')
    assert "The members of the suite take about 27 MB, more than 20 MB." in page
    assert not KEY.search(page)[1]


def test_an_earlier_campaign_is_the_base(draw, http, fields):
    given = {**fields, "method": "cem", "settings": {"batch": 7}, "episodes": 40}
    made = http.post("/api/v1/campaigns", json=given).json()["id"]
    axes = {"axis.1.field": "seed", "axis.1.start": "1", "axis.1.stop": "3", "axis.1.number": "3"}
    page = draw(**{"from": str(made), "episodes": "9", "wish": "fill", "suite": "s", **axes})
    assert 'name="settings.batch" type="number" value="7"' in page
    page = http.get(
        "/suites/new",
        params={"from": made, "suite": "s", "wish": "check", "seed": "5", **axes},
    ).text
    body = body_of(page)
    assert body["grid"] == {"seed": [1, 2, 3]}
    assert (body["base"]["settings"], body["base"]["episodes"]) == ({"batch": 7}, 40)
    assert f"≠</span> campaign {made} has 0" in page


SWEEP = """
name = "around"
[base]
method = "ast"
episodes = 50
simulator = "point_mass"
settings.hidden = [8, 4]
scenario_parameters.distance_m = { uniform = [54.0, 60.0] }
[sweep]
settings.alpha = [10.0, 250.0]
settings.hidden = [[8], [16, 16]]
"""


def test_a_file_fills_in_the_form(draw):
    page = draw(wish="import", toml=SWEEP)
    assert body_of(page) == tomllib.loads(SWEEP)
    assert '<option value="sweep" selected>' in page
    assert 'value="[[8],[16,16]]"' in page
    assert "5 campaigns" in page


def test_the_file_of_a_campaign_is_a_base(draw):
    campaign = 'name = "one"\nmethod = "cem"\nepisodes = 5\n'
    page = draw(wish="import", toml=campaign)
    assert 'name="suite" type="text" value="one"' in page
    assert "Choose at least one setting that varies." in page


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name = ", "The file is not TOML"),
        ("[" * 5_000, "The file is not TOML"),
        (SWEEP.replace("[sweep]", "[swep]"), "Did you mean 'sweep'"),
        (SWEEP.replace("[sweep]", "[[campaigns]]"), "no list of campaigns"),
        (SWEEP.replace("alpha =", "alfa ="), "Did you mean 'alpha'"),
        (SWEEP.replace("alpha = [", "alpha = 3 #"), "is not a list"),
        (SWEEP.replace("episodes", "episods"), "Did you mean 'episodes'"),
        (SWEEP.replace('method = "ast"', "method = [1]"), "method"),
        (SWEEP + "[base.disturbance]\nshape = 3\n", "disturbance"),
        ("[sweep]\n" + "\n".join(f"settings.x{n} = [1]" for n in range(9)), "more than 8 settings"),
        ("[base]\nname = 'x'\nmethod = 'ast'\n[grid]\nseed = [1]", "names its campaigns"),
    ],
    ids=str,
)
def test_a_file_that_the_form_cannot_hold_is_refused_in_words(draw, text, words):
    page = draw(wish="import", toml=text)
    assert words in html.unescape(page)
    assert not KEY.search(page)[1]


@pytest.mark.parametrize("value", ["9" * 400, "1e999", "nan", "-", "{", "[" * 5_000, ",", "[{}]"])
@pytest.mark.parametrize("name", ["axis.1.field", "axis.1.values", "axis.1.start", "way", "suite"])
def test_whatever_is_typed_there_is_an_answer(draw, typed, name, value):
    spaced = {"axis.1.values": "", "axis.1.stop": "5", "axis.1.number": "3"}
    more = spaced if name == "axis.1.start" else {}
    assert "<h1>New suite</h1>" in draw(**{**typed, **more, name: value})


def test_markup_in_what_is_typed_is_text(draw, typed):
    page = draw(**{**typed, "suite": "<script>x</script>", "axis.2.values": "<i>"})
    assert "<script>x" not in page


def test_an_address_with_a_strange_name_is_a_problem(http, problem):
    problem(http.get("/suites/new?bogus=1"), 422)


def test_the_estimate_adds_up_what_like_campaigns_took(
    *, draw, typed, http, store, fields, deliver, result
):
    made = http.post("/api/v1/campaigns", json=fields).json()["id"]
    deliver(made, *(result(index) for index in range(10)))
    store.campaigns.add_active(made, 2.0)
    store.campaigns.move(made, CampaignState.DONE)
    page = draw(**typed)
    assert "About 8 s, one campaign after the other, and" in page
    assert "for 2 of 4" in page
    assert "About 16 s" in draw(**{**typed, "axis.2.values": "idm"} | {"axis.1.values": "1,2,3,4"})


def test_a_suite_that_is_called_new_has_a_page(http, fields, look):
    http.post("/api/v1/campaigns", json={**fields, "name": "new: one"})
    assert 'href="/suites/new/"' in http.get("/suites").text
    assert "<h1>new</h1>" in http.get("/suites/new/").text
    assert "<h1>New suite</h1>" in http.get("/suites/new").text


plain = st.one_of(
    st.integers(-(2**53), 2**53),
    st.floats(-1e6, 1e6, allow_nan=False),
    st.booleans(),
    st.text(st.characters(categories=["L"]), min_size=1, max_size=5).filter(
        lambda text: text not in {"none", "true", "false"}
    ),
)


@given(st.lists(st.one_of(plain, st.lists(st.integers(0, 9))), min_size=1, max_size=5))
def test_values_of_a_file_are_read_as_they_stand(values):
    axis = Axis(place=1, field="settings.x", values=format_values(values))
    kinds = {type(value) for value in values}
    if bool in kinds and list not in kinds:
        return  # without a field of the form, true is a word
    assert find_axis_values(axis, None) == (tuple(values), ())


@given(st.integers(-1000, 1000), st.integers(-1000, 1000), st.integers(2, 50))
def test_spaced_values_begin_and_end_as_typed_and_are_evenly_spaced(start, stop, number):
    axis = Axis(place=1, field="seed", start=str(start), stop=str(stop), number=str(number))
    values, problems = find_axis_values(axis, None)
    assert problems == ()
    assert (len(values), values[0], values[-1]) == (number, start, stop)
    steps = [after - before for before, after in pairwise(values)]
    assert steps == pytest.approx([(stop - start) / (number - 1)] * (number - 1))
    if (stop - start) % (number - 1) == 0:
        assert {type(value) for value in values} == {int}


@given(st.integers(0, 2**62), st.integers(-(2**51), 2**51), st.integers(2, 1000))
def test_whole_numbers_with_a_whole_step_are_exact(start, step, number):
    stop = start + step * (number - 1)
    axis = Axis(place=1, field="seed", start=str(start), stop=str(stop), number=str(number))
    values, problems = find_axis_values(axis, None)
    assert problems == ()
    assert values == tuple(start + step * place for place in range(number))
    assert {type(value) for value in values} == {int}


@pytest.mark.parametrize("end", ["9e299", "-1e300", "12345678901234567890"])
def test_far_ends_have_finite_values_in_between(draw, typed, end):
    axis = Axis(place=1, field="seed", start="-1e300", stop=end, number="7")
    values, problems = find_axis_values(axis, None)
    assert problems == ()
    assert (len(values), values[-1]) == (7, float(end))
    assert all(map(isfinite, values))
    spaced = {axis.name_part(part): getattr(axis, part) for part in ("start", "stop", "number")}
    assert not KEY.search(draw(**{**typed, "axis.1.values": "", **spaced}))[1]


def test_a_decimal_step_has_no_digits_of_binary_numbers():
    axis = Axis(place=1, field="x", start="0", stop="0.3", number="4")
    assert find_axis_values(axis, None)[0] == (0.0, 0.1, 0.2, 0.3)


def test_there_is_always_room_for_another_axis_up_to_eight():
    assert len(read_axes({})) == 3
    assert len(read_axes({"axis.3.field": "x"})) == 4
    assert len(read_axes({"axis.8.field": "x", "axis.9.field": "y"})) == 8
    first, second, _ = make_axes({"seed": [1, 2], "settings": {"tau": [0.5]}})
    assert (first.field, first.values) == ("seed", "1, 2")
    assert (second.path, second.values) == (("settings", "tau"), "0.5")


@given(st.lists(st.integers(1, 4), min_size=1, max_size=3))
def test_a_preview_has_each_member_once(sizes):
    names = ("seed", "episodes", "priority")[: len(sizes)]
    grid = {name: list(range(1, size + 1)) for name, size in zip(names, sizes, strict=True)}
    members = [
        PreviewMember(
            name=name,
            values=tuple(fields[axis] for axis in names),
            episodes=fields.get("episodes", 7),
            is_wrong=fields["seed"] == 1,
        )
        for name, fields in expand_suite(SuiteFile(grid=grid), "")
    ]
    preview = make_preview(names, members)
    cells = [cell for _, row in preview.rows for cell in row]
    assert len(preview.rows) == sizes[0]
    assert sum(cell.campaigns for cell in cells) == preview.campaigns == len(members)
    assert sum(cell.episodes for cell in cells) == preview.episodes
    assert sum(cell.wrong for cell in cells) == len(members) // sizes[0]
    assert all(0 <= cell.level <= 5 for cell in cells)
    assert preview.is_shaded == (len(sizes) > 1 and sizes[1] > 1)


def test_a_file_has_a_line_for_each_value():
    suite = {
        "name": 'a "b"',
        "base": {"method": "ast", "settings": {"tau": 0.5, "deep": {"x y": [1]}}},
        "grid": {"seed": [1, 2]},
    }
    text = to_suite_toml(suite)
    assert tomllib.loads(text) == suite
    assert "[base]" in text
    assert "settings.tau = 0.5" in text
