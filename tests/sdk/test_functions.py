"""What may be imported is listed by whoever starts a service, and by no request."""

from contextlib import contextmanager, suppress

import pytest
from msgspec.structs import replace

from eigenfail.cli import connection
from eigenfail.errors import InvalidValue, ServiceError
from eigenfail.functions import ALLOWED_VARIABLE, allow, allow_of, check, refuse_unlisted
from eigenfail.hosting.service import Plan
from eigenfail.values import AXES, CampaignSpec, Correlated, DisturbanceModel, HeavyTailed
from eigenfail.worlds import world_of

ON = {"name": "n", "method": "monte_carlo", "episodes": 1, "scenario": "function"}


@pytest.fixture(autouse=True)
def nothing_listed(monkeypatch):
    """The variable as it was, afterwards."""
    monkeypatch.setenv(ALLOWED_VARIABLE, "")
    monkeypatch.delenv(ALLOWED_VARIABLE)


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
        ["A"],
        ["a b"],
        ["a\n"],
        ["a-b"],
        ["é"],
        ["1"],
        [1],
        "a",
        2,
        {"a": 1},
        ["a" * 33],
        ["a"] * 51,
        ["joint"],
        ["a_sigma"],
    ],
)
def test_channels_without_names_of_their_own_are_refused(given):
    with pytest.raises(InvalidValue) as refused:
        world_of("function").channels(with_channels(given))
    assert refused.value.field.startswith("scenario_parameters.channels")


def test_noise_of_too_many_values_is_refused():
    many = with_channels([f"c{number}" for number in range(50)])
    longest = replace(many, scenario_parameters=many.scenario_parameters | {"steps": 2_000})
    check(longest)
    with pytest.raises(InvalidValue, match="2001 steps of 50 channels are 100,050 values"):
        check(replace(longest, scenario_parameters=many.scenario_parameters | {"steps": 2_001}))


@pytest.mark.parametrize("channels", [["wind"], ["b", "a", "c"], ["lateral", "longitudinal"]])
def test_noise_that_is_correlated_by_axis_needs_the_axes(channels):
    correlated = DisturbanceModel(shape=Correlated())
    with pytest.raises(InvalidValue, match="ar1 correlates longitudinal and lateral noise only"):
        check(with_channels(channels, disturbance=correlated))
    check(with_channels(None, disturbance=correlated))
    check(with_channels(channels, disturbance=DisturbanceModel(shape=HeavyTailed())))


def is_listed(module):
    try:
        refuse_unlisted(f"{module}:f")
    except InvalidValue:
        return False
    return True


def test_without_a_list_there_is_nothing():
    assert not is_listed("any_function")


def test_whoever_starts_a_service_lists():
    allow("mine, deep.inside")
    assert (is_listed("mine"), is_listed("deep.inside.more"), is_listed("deep")) == (
        True,
        True,
        False,
    )


@pytest.mark.parametrize("given", ["", "a,", "a b", "a:f", "../a", "."])
def test_what_is_no_module_is_refused(given):
    with pytest.raises(InvalidValue, match="is not a valid module name"):
        allow(given)


def test_a_service_for_some_campaigns_alone_takes_their_modules():
    allow_of([spec("one:f"), spec("two.deep:f"), spec("idm", "point_mass"), spec("no place")])
    assert [is_listed(name) for name in ("one", "two.deep", "idm", "no place")] == [
        *(True, True, False, False)
    ]


def test_a_list_of_its_own_holds(monkeypatch):
    monkeypatch.setenv(ALLOWED_VARIABLE, "other")
    allow_of([spec("one:f")])
    assert not is_listed("one")


def test_what_runs_a_file_by_itself_starts_a_service_for_the_files_module(tmp_path, monkeypatch):
    """It finds the list in its environment; what it is started with is all that matters here."""
    (tmp_path / "sut_alone.py").write_text("")
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
