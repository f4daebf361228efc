"""What may be imported is listed by whoever starts a service, and by no request."""

from contextlib import contextmanager, suppress

import pytest
from msgspec.structs import replace

from eigenfail import functions
from eigenfail.cli import connection
from eigenfail.errors import InvalidValue, ServiceError
from eigenfail.hosting.service import Plan
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import AXES, DisturbanceModel
from eigenfail.values.shapes import Correlated, HeavyTailed
from eigenfail.worlds import world_of

ON = {"name": "n", "method": "monte_carlo", "episodes": 1, "scenario": "function"}


@pytest.fixture(autouse=True)
def nothing_listed(monkeypatch):
    """The variable as it was, afterwards."""
    monkeypatch.setenv(functions.ALLOWED_VARIABLE, "")
    monkeypatch.delenv(functions.ALLOWED_VARIABLE)


def spec(place, simulator="function"):
    return CampaignSpec(**ON, simulator=simulator, planner=place, scenario_parameters={"steps": 2})


def with_channels(channels, **fields):
    return CampaignSpec(
        **ON | fields,
        simulator="function",
        planner="a:f",
        scenario_parameters={"steps": 2} | ({} if channels is None else {"channels": channels}),
    )


@pytest.mark.parametrize(
    ("given", "names"), [(None, AXES), (["wind"], ("wind",)), (["b", "a", "c"], ("b", "a", "c"))]
)
def test_channels_are_those_that_the_campaign_names_in_its_order(given, names):
    spec = with_channels(given)
    assert world_of("function").channels(spec) == names
    assert world_of("highway").channels(spec) == AXES


@pytest.mark.parametrize(
    "given",
    [
        [],
        ["a", "a"],
        ["a\n"],
        ["a-b"],
        ["é"],
        [1],
        "a",
        2,
        {"a": 1},
        ["a"] * 51,
    ],
)
def test_channels_without_names_of_their_own_are_refused(given):
    with pytest.raises(InvalidValue) as refused:
        world_of("function").channels(with_channels(given))
    assert refused.value.field.startswith("scenario_parameters.channels")


@pytest.mark.parametrize(
    "name", ["A", "a b", "1", "", "a" * 33, "joint", "step", "log_probability", "a_sigma", "a_z"]
)
def test_a_name_that_is_none_is_refused_with_the_rule_in_words(name):
    with pytest.raises(InvalidValue, match=f"'{name}'") as refused:
        functions.check(with_channels(["b", name]))
    assert "regex" not in refused.value.problem
    for words in ("lower case letters", "at most 32", "'joint'", "'step'", "'_sigma'"):
        assert words in refused.value.remedy


def test_noise_of_too_many_values_is_refused():
    many = with_channels([f"c{number}" for number in range(50)])
    longest = replace(many, scenario_parameters=many.scenario_parameters | {"steps": 2_000})
    functions.check(longest)
    with pytest.raises(InvalidValue, match="2001 steps of 50 channels are 100,050 values"):
        functions.check(
            replace(longest, scenario_parameters=many.scenario_parameters | {"steps": 2_001})
        )


@pytest.mark.parametrize("channels", [["wind"], ["b", "a", "c"], ["lateral", "longitudinal"]])
def test_noise_that_is_correlated_by_axis_needs_the_axes(channels):
    correlated = DisturbanceModel(shape=Correlated())
    with pytest.raises(InvalidValue, match="ar1 correlates longitudinal and lateral noise only"):
        functions.check(with_channels(channels, disturbance=correlated))
    functions.check(with_channels(None, disturbance=correlated))
    functions.check(with_channels(channels, disturbance=DisturbanceModel(shape=HeavyTailed())))


def is_listed(module):
    try:
        functions.refuse_unlisted(f"{module}:f")
    except InvalidValue:
        return False
    return True


def test_without_a_list_there_is_nothing():
    assert not is_listed("any_function")


def test_whoever_starts_a_service_lists():
    functions.allow("mine, deep.inside")
    assert (is_listed("mine"), is_listed("deep.inside.more"), is_listed("deep")) == (
        True,
        True,
        False,
    )


@pytest.mark.parametrize("given", ["", "a,", "a b", "a:f", "../a", "."])
def test_what_is_no_module_is_refused(given):
    with pytest.raises(InvalidValue, match="is not a valid module name"):
        functions.allow(given)


def test_a_service_for_some_campaigns_alone_takes_their_modules():
    functions.allow_functions(
        [spec("one:f"), spec("two.deep:f"), spec("idm", "point_mass"), spec("no place")]
    )
    assert [is_listed(name) for name in ("one", "two.deep", "idm", "no place")] == [
        *(True, True, False, False)
    ]


def test_a_list_of_its_own_holds(monkeypatch):
    monkeypatch.setenv(functions.ALLOWED_VARIABLE, "other")
    functions.allow_functions([spec("one:f")])
    assert not is_listed("one")


BINDINGS = (
    "def robustness(z): pass",
    "async def robustness(z): pass",
    "class robustness: pass",
    "robustness = of_trajectory(len)",
    "robustness: object = 1",
    "first, (robustness, *rest) = 1, (2, 3)",
    "from eigenfail import functions as robustness",
    "import robustness.deep",
    "if True:\n    try:\n        def robustness(z): pass\n    finally:\n        pass",
    "for robustness in (): pass",
    "with open('x') as robustness: pass",
    "match 1:\n    case robustness: pass",
    "def bind():\n    global robustness\n    robustness = 1",
)
UNSEEN_BINDINGS = (
    "from eigenfail.functions import *",
    "def __getattr__(name): return len",
    "globals()['robust' + 'ness'] = len",
    "def (",
    "x = 1\0",
)


@pytest.fixture
def source(tmp_path, monkeypatch):
    """Writes the module `sut_source` of the working folder."""
    monkeypatch.chdir(tmp_path)
    return (tmp_path / "sut_source.py").write_text


@pytest.mark.parametrize("text", [*BINDINGS, *UNSEEN_BINDINGS])
def test_a_name_that_the_source_binds_or_may_bind_is_left_to_the_workers(source, text):
    source(f"{text}\nraise SystemExit(4)  # nothing is run\n")
    functions.refuse_undefined("sut_source:robustness")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "def other(z):\n    robustness = 1",
        "class Other:\n    def robustness(self, z): pass",
        "import deep.robustness",
        "from robustness import other",
        "other.robustness = robustness",
    ],
)
def test_a_name_that_the_source_binds_nowhere_is_refused(source, text):
    source(f"{text}\nraise SystemExit(4)  # nothing is run\n")
    with pytest.raises(InvalidValue, match="module 'sut_source' has no 'robustness'") as refused:
        functions.refuse_undefined("sut_source:robustness")
    assert refused.value.field == "planner"
    assert refused.value.remedy == "Correct the name behind the colon."


def test_a_campaign_with_a_typo_is_refused_with_the_near_names(source, monkeypatch):
    source("def robustness(z): pass\n")
    monkeypatch.setenv(functions.ALLOWED_VARIABLE, "sut_source")
    world, mistyped = world_of("function"), spec("sut_source:robustnes")
    for refuse in (world.check, world.require_code):
        with pytest.raises(InvalidValue, match="has no 'robustnes'") as refused:
            refuse(mistyped)
        assert refused.value.remedy == "Did you mean 'robustness'?"
        refuse(spec("sut_source:robustness"))


def test_the_source_of_a_module_that_is_not_listed_is_not_read(source):
    source("def robustness(z): pass\n")
    with pytest.raises(InvalidValue, match="is not in the list of modules"):
        world_of("function").check(spec("sut_source:robustnes"))


def test_modules_of_packages_are_read_without_running_the_packages(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    inner = tmp_path / "sut_package" / "inner"
    inner.mkdir(parents=True)
    (tmp_path / "sut_package" / "__init__.py").write_text("raise SystemExit(4)\n")
    (inner / "deep.py").write_text("def robustness(z): pass\n")
    functions.require_module("sut_package.inner.deep:robustness")
    with pytest.raises(InvalidValue, match=r"module 'sut_package\.inner\.deep' has no 'other'"):
        functions.require_module("sut_package.inner.deep:other")
    with pytest.raises(InvalidValue, match="module 'sut_package' has no 'robustness'"):
        functions.require_module("sut_package:robustness")


@pytest.mark.parametrize("place", ["sut_nowhere:f", "sys:f", "json.none.deep:f"])
def test_a_module_without_a_source_here_is_left_to_the_workers(place):
    functions.refuse_undefined(place)


def test_what_runs_a_file_by_itself_starts_a_service_for_the_files_module(tmp_path, monkeypatch):
    """It finds the list in its environment; what it is started with is all that matters here."""
    (tmp_path / "sut_alone.py").write_text("def f(z): pass")
    monkeypatch.chdir(tmp_path)
    started = []

    @contextmanager
    def start(_plan):
        started.append(is_listed("sut_alone"))
        raise ServiceError("enough")
        yield

    monkeypatch.setattr(connection, "local_service", start)
    monkeypatch.setattr(connection, "_list_addresses", lambda *_: ())
    plan = Plan(tmp_path, 0)
    with suppress(ServiceError), connection.open_place(None, spec("sut_alone:f"), None, plan):
        pass
    assert started == [True]
