"""The launch form: every field that there is, problems at their fields, clones of campaigns."""

import asyncio
import html
import json
import re
import tomllib

import msgspec
import pytest

from eigenfail import plugins
from eigenfail.errors import InvalidValue
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail_api.dashboard import launch_fields, launch_page
from eigenfail_api.dashboard.launch_layout import make_layout
from eigenfail_api.dashboard.launch_page import describe_error, list_fields

FORM = "/launch/form"
KEY = re.compile(r'data-key="([^"]*)"')
BODY = re.compile(r'data-body="([^"]*)"')


def post(http, **typed):
    return http.post(FORM, content="&".join(f"{k}={v}" for k, v in typed.items()))


@pytest.fixture
def typed():
    """The least that makes a campaign, as it is typed."""
    return {"name": "first", "method": "monte_carlo", "episodes": "10", "simulator": "point_mass"}


def names(texts):
    return [field.name for field in list_fields(make_layout(texts))]


@pytest.mark.parametrize("method", plugins.names(plugins.METHODS))
def test_every_setting_of_every_method_has_a_field(method):
    found = names(launch_fields.Texts({"method": method}, {}))
    wanted = plugins.load(plugins.METHODS, method).Settings.__struct_fields__
    own = [name.removeprefix("settings.") for name in found if name.startswith("settings.")]
    assert own == list(wanted)
    assert len(found) == len(set(found))


@pytest.mark.parametrize("planner", ["idm", "rulebook"])
def test_every_setting_of_a_planner_has_a_field_however_deep(planner):
    found = set(names(launch_fields.Texts({"planner": planner}, {})))
    settings = msgspec.to_builtins(plugins.load(plugins.PLANNERS, planner).Settings())

    def paths(value, above):
        for name, part in value.items():
            yield from (
                paths(part, f"{above}.{name}") if isinstance(part, dict) else [f"{above}.{name}"]
            )

    assert set(paths(settings, "planner_settings")) <= found


def test_every_field_of_a_spec_is_in_the_form():
    found = {name.partition(".")[0] for name in names(launch_fields.Texts({}, {}))}
    assert found == set(CampaignSpec.__struct_fields__)


@pytest.mark.parametrize("shape", ["white", "ar1", "student_t"])
def test_the_shape_of_the_noise_brings_its_own_fields(shape):
    found = [
        name.removeprefix("disturbance.shape.")
        for name in names(launch_fields.Texts({"disturbance.shape.kind": shape}, {}))
        if name.startswith("disturbance.shape.")
    ]
    expected = {
        "white": ["kind"],
        "ar1": ["kind", "longitudinal_correlation", "lateral_correlation"],
        "student_t": ["kind", "degrees_of_freedom"],
    }
    assert found == expected[shape]


def test_fields_tell_bounds_units_defaults_and_what_they_mean():
    scenario = plugins.load(plugins.SCENARIOS, "cut_in")
    group = launch_fields.group_of(
        msgspec.json.schema(scenario.Parameters), "p", "Parameters", varied=True
    )
    field = next(each for each in group.fields if each.label == "distance_m")
    assert (field.kind, field.unit, field.default) == ("varied", "m", "58.0")
    assert (field.least, field.most) == ("52.0", "70.0")
    assert field.hint.startswith(
        "Gap at which the car begins to come over. At least 52, at most 70."
    )


def test_what_docstrings_say_of_fields_is_their_help():
    fields = {field.name: field for field in list_fields(make_layout(launch_fields.Texts({}, {})))}
    assert "that reappears" in fields["planner_settings.tracker.again_speed_sd_mps"].help
    assert fields["planner_settings.tracker.again_speed_sd_mps"].unit == "m/s"
    assert "95 % confidence sequence" in fields["stop.half_width"].help
    assert fields["seed"].hint.endswith("Whole, at least 0. Default 0.")


SPECS = [
    {"method": "ast", "settings": {"hidden": [8, 4], "patience": None, "tau": 1e-05}},
    {"method": "replay", "settings": {"campaign": 3, "what": ["medoid"], "episodes": [1, 2]}},
    {"method": "ensemble", "settings": {"method": "cem", "settings": {"batch": 7}}},
    {
        "scenario_parameters": {
            "distance_m": {"uniform": [53, 60.5]},
            "lane_change_s": {"choice": [2.8, 3.0]},
            "ego_speed_mps": 23,
        },
        "planner_settings": {"tracker": {"gate": 9.0}, "merging": {"changes": {"spare_m": 2.0}}},
    },
    {
        "disturbance": {"scale": 1.5, "shape": {"kind": "ar1", "lateral_correlation": 0.5}},
        "stop": {"failures": 3, "cost_usd": 0.5},
        "seed": 2**63 - 1,
        "name": "σ <b>\"&\\' name",
    },
    {
        "simulator": "function",
        "scenario": "function",
        "planner": "m:f",
        "scenario_parameters": {"steps": 12},
    },
    {
        "simulator": "bridge",
        "scenario": "crossing",
        "planner": "theirs",
        "scenario_parameters": {"steps": 12, "dt_s": 0.05, "gap_m": {"uniform": [9.0, 12.0]}},
        "planner_settings": {"bold": True},
    },
]


@pytest.mark.parametrize("given", SPECS)
def test_a_campaign_comes_out_of_the_form_as_it_went_in(given):
    spec = msgspec.convert({"name": "n", "method": "cem", "episodes": 5} | given, CampaignSpec)
    texts = launch_fields.Texts({}, msgspec.to_builtins(spec))
    body = launch_fields.make_body(list_fields(make_layout(texts)), texts)
    assert msgspec.convert(body, CampaignSpec) == spec
    # Types as well: 23 stays 23, and 60.5 stays a float.
    again = msgspec.convert(body, CampaignSpec)
    written, wanted = (msgspec.json.encode(each, order="sorted") for each in (again, spec))
    assert written == wanted


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("3", 3),
        ("-2", -2),
        ("1e3", 1000.0),
        (".5", 0.5),
        ("1_0", "1_0"),
        ("nan", "nan"),
        ("٣", "٣"),
        ("9" * 25, 1e25),
    ],
)
def test_numbers_are_read_as_typed(text, value):
    found = launch_fields.read_number(text)
    assert found == value
    assert type(found) is type(value)


def test_the_field_is_not_said_twice():
    error = InvalidValue("settings.alpha", "2 is not a number of at most 1.0.", "Do so.")
    assert describe_error(error) == "2 is not a number of at most 1.0. Do so."
    assert describe_error(InvalidValue("name", "is required.")) == "Is required."


@pytest.mark.usefixtures("without_plugins")
def test_problems_stand_at_their_fields_and_what_was_typed_stays(http, typed, golden):
    wrong = {
        **typed,
        "method": "cem",
        "planner": "idm",
        "episodes": "many",
        "settings.batch": "1",
        "scenario_parameters.distance_m.how": "uniform",
        "scenario_parameters.distance_m.low": "60",
        "scenario_parameters.distance_m.high": "53",
        "wish": "launch",
    }
    response = post(http, **wrong)
    assert response.status_code == 200
    golden.check_page("dashboard/launch/problems", response.text)
    assert KEY.search(response.text)[1] == ""


def test_what_is_in_order_is_told_whole_and_has_a_key(http, typed, golden, store):
    response = post(http, **typed, wish="check")
    golden.check_page("dashboard/launch/valid", response.text, "launch-word")
    body = msgspec.json.decode(html.unescape(BODY.search(response.text)[1]))
    assert body == {**typed, "episodes": 10}
    assert KEY.search(response.text)[1]
    assert store.campaigns.page(10).items == ()


def test_what_a_check_found_stands_beside_the_buttons_too(http, typed, text_of):
    def beside(**more):
        bar = post(http, **{**typed, **more}).text.split('<div class="send">')[1]
        return bar.split("</div>")[0]

    assert beside().index("Launch</button>") < beside().index("Check</button>")
    assert 'href="#launch-word"' not in beside()
    assert "1 problem</a>" in beside(wish="check", episodes="many")
    assert "2 problems</a>" in beside(wish="launch", episodes="many", seed="-1")
    assert "Valid" in beside(wish="check")


def test_two_clicks_have_one_key_and_another_body_another(http, typed):
    def key(**more):
        return KEY.search(post(http, **typed, wish="launch", token="t", **more).text)[1]

    assert key() == key()
    assert key(seed="1") != key()
    assert KEY.search(post(http, **typed, wish="launch", token="u").text)[1] != key()


def test_an_address_is_a_form_that_works_without_scripts(check_page):
    check_page("dashboard/launch/empty", "/launch")
    check_page("dashboard/launch/ast", "/launch?method=ast", "part-method")
    asked = "/launch?name=x&method=monte_carlo&planner=idm&simulator=point_mass&wish=check"
    check_page("dashboard/launch/valid_address", f"{asked}&episodes=5", "launch-word")
    check_page("dashboard/launch/problem_in_address", asked, "launch-word")


def test_a_plug_in_that_is_not_known_is_a_problem_at_its_field(check_page):
    address = "/launch?name=x&method=magic&episodes=5&simulator=point_mass&wish=check"
    check_page("dashboard/launch/unknown_method", address, "launch-word")


@pytest.mark.parametrize(
    ("name", "query", "status"),
    [
        ("no_campaign", "from=99", 404),
        ("no_id", "from=x", 422),
        ("large_id", "from=" + "9" * 40, 422),
        ("no_field", "bogus=1", 422),
    ],
)
def test_addresses_that_make_no_sense_are_problems(check_page, name, query, status):
    check_page(f"dashboard/launch/refused_{name}", f"/launch?{query}", status=status)


def test_markup_in_what_is_typed_is_text(http, typed):
    response = post(
        http, **{**typed, "name": "<script>x</script>\"'", "settings.round_size": "<i>"}
    )
    assert "<script>x" not in response.text
    assert "&lt;script&gt;" in response.text
    assert 'value="&lt;i&gt;"' in response.text


def test_forms_that_are_too_large_are_refused_in_words(http):
    response = http.post(
        FORM, content=b"name=" + b"x" * 10_000_000, headers={"Accept": "text/html"}
    )
    assert response.status_code == 413
    assert "larger than" in response.text
    many = "&".join(f"settings.a{place}=1" for place in range(5_000))
    assert http.post(FORM, content=many).status_code == 400
    assert http.post(FORM, content=b"\xff=\xfe&name=%ff").status_code in {200, 400}


@pytest.mark.parametrize("value", ["9" * 400, "1e999", "nan", "-", "{", "[" * 5_000])
@pytest.mark.parametrize("name", ["episodes", "settings.settings", "stop.cv", "seed"])
def test_whatever_is_typed_there_is_an_answer(http, typed, name, value):
    response = post(http, **{**typed, "method": "ensemble", name: value}, wish="launch")
    assert response.status_code == 200
    assert "problem" in response.text


@pytest.fixture
def learnt(store, http, fields):
    """A campaign of a method that learns."""
    given = {**fields, "method": "cem", "settings": {"batch": 7}, "episodes": 40}
    return http.post("/api/v1/campaigns", json=given).json()["id"]


def test_a_clone_is_prefilled_and_differences_are_marked(check_page, learnt):
    check_page("dashboard/launch/clone", f"/launch?from={learnt}")
    changed = f"/launch?from={learnt}&seed=5&settings.batch=9"
    check_page("dashboard/launch/clone_changed_seed", changed, "part-campaign")
    check_page("dashboard/launch/clone_changed_batch", changed, "part-method")


def test_a_clone_with_another_method_leaves_its_settings_behind(http, learnt):
    page = http.get(f"/launch?from={learnt}&method=difs&wish=check").text
    assert 'name="settings.batch"' not in page
    assert '"batch":7' not in html.unescape(BODY.search(page)[1])


def test_extending_is_a_new_campaign_and_the_page_says_so(check_page, look, learnt, store):
    check_page("dashboard/launch/extension", f"/launch?from={learnt}&episodes=80")
    store.campaigns.move(learnt, CampaignState.CANCELLED)
    assert "Use what it learnt, and learn no further." in look(f"/launch?from={learnt}")


def test_an_empty_entry_is_nothing():
    assert (
        launch_fields.Texts({}, {"stop": {"cv": None}}).entry(
            next(
                field
                for field in list_fields(make_layout(launch_fields.Texts({}, {})))
                if field.name == "stop.cv"
            )
        )
        == launch_fields.LaunchEntry()
    )


@pytest.mark.parametrize("ask", [lambda http: http.get("/launch"), post])
def test_the_form_is_made_in_a_thread_while_others_are_answered(http, monkeypatch, ask):
    make = launch_page.launch_view

    def aside(*given):
        with pytest.raises(RuntimeError):
            asyncio.get_running_loop()
        return make(*given)

    monkeypatch.setattr(launch_page, "launch_view", aside)
    assert ask(http).status_code == 200


FILE = """
name = "from a file"
method = "ast"
episodes = 50
simulator = "point_mass"
seed = 7

[settings]
alpha = 250.0

[scenario_parameters]
distance_m = { uniform = [54.0, 60.0] }
"""


def import_file(http, text):
    return http.post(FORM, data={"wish": "import", "toml": text, "name": "typed before"}).text


def test_a_file_fills_in_the_form_and_is_what_would_be_launched(http):
    page = import_file(http, FILE)
    body = json.loads(html.unescape(BODY.search(page)[1]))
    assert body == tomllib.loads(FILE)
    assert KEY.search(page)[1]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name = ", "The file is not TOML"),
        ("[" * 5_000, "The file is not TOML"),
        ("x = " + "9" * 5_000, "The file is not TOML"),
        ('[[campaigns]]\nname = "a"', "page of a new suite"),
        (FILE.replace("episodes = 50", "episods = 50"), "Did you mean 'episodes'"),
        (FILE.replace("alpha", "alfa"), "Did you mean 'alpha'"),
        (FILE.replace("50", "0"), "from 1 to"),
    ],
)
def test_a_file_that_is_no_campaign_is_refused_in_words(http, text, words):
    page = import_file(http, text)
    assert words in html.unescape(page)
    assert not KEY.search(page)[1]


def test_the_estimate_is_that_of_the_newest_campaign_of_the_same_kind(
    http, store, fields, deliver, result
):
    others = ({}, {"method": "cem"}, {"scenario": "merge_in"})
    made = [http.post("/api/v1/campaigns", json={**fields, **more}).json()["id"] for more in others]
    for campaign in made:
        deliver(campaign, *(result(index) for index in range(10)))
        store.campaigns.add_active(campaign, 2.0)
        store.campaigns.move(campaign, CampaignState.DONE)
    named = ("name", "method", "simulator", "planner")
    typed = {**{name: fields[name] for name in named}, "episodes": 100, "wish": "check"}
    told = post(http, **typed).text
    assert "About 20 s and" in told
    assert f"those of campaign {made[0]} did" in told
    assert "each episode takes" not in post(http, **{**typed, "planner": "rulebook"}).text
