"""Suites from TOML: what varies becomes members, and what cannot be meant is refused in words."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.suites import (
    MOST_MEMBERS,
    Suite,
    SuiteFile,
    _apply_changes,
    _list_variations,
    format_value,
    list_leaves,
    list_references,
    order_members,
    read_path,
    replace_references,
    resolve_references,
)
from eigenfail.values.shapes import Correlated, White

ROOT = Path(__file__).parents[3]
BASE = '[base]\nmethod = "ast"\nepisodes = 7\nsettings.alpha = 10\n'

PAPER_DEFAULTS = {
    "alpha": 10_000,
    "c_dist": 1000,
    "tau": 0.005,
    "learning_rate": 3e-4,
    "batch_size": 64,
    "buffer_size": 100_000,
}
PAPER_ROWS = [
    *(("alpha", value) for value in (500, 1000, 5000, 10_000)),
    *(("c_dist", value) for value in (100, 1000, 5000)),
    *(("learning_rate", value) for value in (0.001, 0.0001, 0.0003, 0.00005)),
    *(("batch_size", value) for value in (16, 64, 256)),
]


@pytest.fixture
def read(tmp_path):
    def read_text(text):
        file = tmp_path / "wanted.toml"
        file.write_text(text)
        return Suite.read(file)

    return read_text


def names(suite):
    return [member.name for member in suite.members]


def test_a_sweep_varies_each_axis_alone_around_the_base(read):
    suite = read(f'{BASE}[sweep]\nsettings.alpha = [5, 10, 20]\nplanner = ["idm"]\nseed = [3]')
    assert names(suite) == ["base", "alpha=5", "alpha=20", "planner=idm", "seed=3"]
    found = [(m.spec.settings["alpha"], m.spec.planner, m.spec.seed) for m in suite.members]
    assert found == [
        (10, "rulebook", 0),
        (5, "rulebook", 0),
        (20, "rulebook", 0),
        (10, "idm", 0),
        (10, "rulebook", 3),
    ]
    assert suite.episodes == 5 * 7


def test_a_grid_is_every_combination(read):
    suite = read(f"{BASE}[grid]\nepisodes = [1, 2]\nscenario_parameters.distance_m = [50.5, 60.0]")
    assert names(suite) == [
        "episodes=1, distance_m=50.5",
        "episodes=1, distance_m=60",
        "episodes=2, distance_m=50.5",
        "episodes=2, distance_m=60",
    ]
    assert suite.episodes == 6
    assert suite.members[2].spec.scenario_parameters == {"distance_m": 50.5}
    assert suite.members[2].spec.settings == {"alpha": 10}


def test_campaigns_are_written_down_and_may_have_names(read):
    suite = read(
        f'{BASE}[[campaigns]]\nname = "mine"\nsettings.tau = 0.1\n'
        '[[campaigns]]\nmethod = "cem"\nseed = 1\n[[campaigns]]\n'
    )
    assert names(suite) == ["mine", "method=cem, seed=1", "base"]
    assert suite.members[0].spec.settings == {"alpha": 10, "tau": 0.1}
    assert suite.members[0].spec.name == "wanted: mine"


def test_an_axis_may_hold_tables_and_replaces_what_stood_there(read):
    suite = read(
        f'name = "shapes"\n{BASE}disturbance.shape = {{ kind = "student_t" }}\n'
        '[grid.disturbance]\nscale = [1.5]\nshape = [{ kind = "white" }, { kind = "ar1" }]\n'
    )
    assert [m.spec.disturbance.shape for m in suite.members] == [White(), Correlated()]
    assert suite.members[1].spec.name == 'shapes: scale=1.5, shape={"kind":"ar1"}'


def test_axes_that_end_alike_are_told_apart(read):
    suite = read(f"{BASE}[sweep]\nsettings.seed = [1]\nseed = [1]")
    assert names(suite) == ["base", "settings.seed=1", "seed=1"]


def test_the_papers_sweep_is_its_table_without_rows_that_have_no_effect():
    suite = Suite.read(ROOT / "examples" / "sweep.toml")
    specs = [member.spec for member in suite.members]
    assert {(spec.method, spec.episodes) for spec in specs} == {("ast", 300)}
    wanted = [PAPER_DEFAULTS | {name: value} for name, value in PAPER_ROWS]
    assert len(wanted) == 14
    different = [row for place, row in enumerate(wanted) if row not in wanted[:place]]
    found = [spec.settings for spec in specs]
    assert sorted(found, key=str) == sorted(different, key=str)
    assert suite.episodes == 11 * 300


@pytest.mark.parametrize(
    ("written", "words"),
    [
        (f"{BASE}[sweeep]\nseed = [1]", "'sweeep' is not known. Did you mean 'sweep'?"),
        (f"{BASE}[sweep]\nsede = [1]", "wanted.toml: member 'sede=1': 'sede' is not known"),
        (f"{BASE}[sweep]\ndisturbance.sigma = [1]", "disturbance: 'sigma' is not known"),
    ],
)
def test_unknown_names_are_refused_with_the_known_ones(read, written, words):
    with pytest.raises(UnknownName) as caught:
        read(written)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("written", "words"),
    [
        (BASE, "has nothing to run. Give exactly one of sweep, grid, campaigns"),
        (f"{BASE}[sweep]\nseed = [1]\n[grid]\nseed = [2]", "has sweep and grid."),
        (f"{BASE}[sweep]\nsettings.alpha = []", "sweep.settings.alpha: has no values"),
        (f"{BASE}[grid]\nseed = 3", "grid.seed: is not a list"),
        (f"{BASE}[grid]\nseed = {{}}", "grid.seed: is not a list"),
        (f'{BASE}[grid]\nname = ["a"]', "grid.name: cannot vary"),
        (f'{BASE}name = "a"\n[grid]\nseed = [1]', "base.name: cannot be given"),
        (f"{BASE}[sweep]\nseed = [1, 1]", "has two members 'seed=1'"),
        (f"{BASE}[[campaigns]]\n[[campaigns]]", "has two members 'base'"),
        (f'{BASE}[[campaigns]]\n[[campaigns]]\nname = "b"', "'base' and 'b' are the same"),
        (f"{BASE}[sweep]\nseed = [-1]", "wanted.toml: member 'seed=-1'.seed: -1 is not an integer"),
        (
            f"{BASE}[sweep]\nepisodes.many = [1]",
            "'many=1'.episodes: {\"many\":1} is not an integer",
        ),
        (f"{BASE}[sweep]\nsettings.alpha = [nan]", "not finite"),
        (f"{BASE}[sweep]\nsettings.alpha = [1e999]", "not finite"),
        (f"{BASE}[sweep]\nsettings.day = [1979-05-27]", "holds a date"),
        ("[grid]\nseed = [1]", "is required"),
        ("base = 3\n[grid]\nseed = [1]", "base"),
        ("grid = [", "is not TOML"),
        (f"{BASE}[grid]\nseed = [{', '.join(map(str, range(1001)))}]", "has 1001 members"),
        (f"{BASE}[sweep]\nseed = [{', '.join(map(str, range(1, 1001)))}]", "has 1001 members"),
        (f"{BASE}[sweep]\nplanner = ['{'x' * 200}']", "length of at most 200"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_words(read, written, words):
    with pytest.raises(InvalidValue) as caught:
        read(written)
    assert words in str(caught.value)
    assert caught.value.exit_code == 2


CHAIN = (
    f'{BASE}[[campaigns]]\nname = "here"\nmethod = "evaluate"\n'
    'settings = { campaign = "trained" }\n'
    '[[campaigns]]\nname = "trained"\n'
    '[[campaigns]]\nname = "again"\nmethod = "difs"\nsettings.data_from = ["trained", 7, "here"]\n'
)


def test_members_may_build_upon_others_and_come_behind_them(read):
    suite = read(CHAIN)
    specs = {member.name: member.spec for member in suite.members}
    assert names(suite) == ["here", "trained", "again"]
    assert [list_references(specs[name]) for name in specs] == [
        ("trained",),
        (),
        ("trained", "here"),
    ]
    assert order_members(specs, "") == ("trained", "here", "again")
    numbers = {"trained": 3, "here": 4}
    assert resolve_references(specs["here"], numbers.get).settings == {"alpha": 10, "campaign": 3}
    assert resolve_references(specs["again"], numbers.get).settings["data_from"] == [3, 7, 4]
    assert specs["again"].settings["data_from"] == ["trained", 7, "here"]


def test_members_of_an_ensemble_may_build_upon_others_too(read):
    suite = read(
        '[base]\nepisodes = 8\nmethod = "ast"\n[[campaigns]]\nname = "a"\n'
        '[[campaigns]]\nmethod = "ensemble"\nsettings.settings.warm_start = "a"\n'
    )
    spec = suite.members[1].spec
    assert list_references(spec) == ("a",)
    assert replace_references(spec).settings == {"settings": {"warm_start": 1}}


def test_numbers_and_other_settings_name_no_member(read):
    suite = read(f'{BASE}[[campaigns]]\nsettings = {{ campaign = 3, reward = "paper" }}')
    assert list_references(suite.members[0].spec) == ()


def test_a_member_that_there_is_not_is_refused_with_the_known_ones(read):
    with pytest.raises(UnknownName) as refused:
        read(CHAIN.replace('campaign = "trained"', 'campaign = "trainde"'))
    assert "member 'here': 'trainde' is not known. Did you mean 'trained'?" in str(refused.value)
    assert refused.value.known == ["again", "here", "trained"]


@pytest.mark.parametrize("name", ["here", "trained"])
def test_members_that_wait_for_each_other_are_refused(read, name):
    circle = f'name = "trained"\nsettings.warm_start = "{name}"\n'
    with pytest.raises(InvalidValue, match="members that depend on each other: ") as refused:
        read(CHAIN.replace('name = "trained"\n', circle))
    told = refused.value.problem
    assert told.count("'trained' → ") == 1
    assert ("'here' → " in told) == (name == "here")


def test_a_huge_grid_is_refused_before_it_is_laid_out(read):
    axes = "\n".join(f"settings.x{n} = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]" for n in range(30))
    with pytest.raises(InvalidValue, match=f"more than {MOST_MEMBERS}"):
        read(f"{BASE}[grid]\n{axes}")


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InvalidValue, match=r"cannot be read.*examples/suite\.toml"):
        Suite.read(tmp_path / "none.toml")


axes = st.dictionaries(
    st.sampled_from(["a", "b", "c"]), st.lists(st.integers(0, 9), min_size=1, unique=True)
)
settings = st.dictionaries(st.sampled_from(["a", "b", "c", "d"]), st.integers(0, 9))


@given(base=settings, varied=axes.filter(bool))
def test_a_sweeps_members_differ_from_the_base_at_one_place_at_most(base, varied):
    written = SuiteFile(base={"settings": base}, sweep={"settings": varied})
    members = [
        _apply_changes(written.base, each.changes)["settings"]
        for each in _list_variations(written, "")
    ]
    apart = [[name for name in "abcd" if member.get(name) != base.get(name)] for member in members]
    assert [len(names) for names in apart] == [0] + [1] * (len(members) - 1)
    for name, values in varied.items():
        assert {member.get(name) for member in members} == {*values, base.get(name)}


@given(varied=axes.filter(bool))
def test_a_grids_members_are_all_different_and_as_many_as_the_product(varied):
    members = _list_variations(SuiteFile(grid={"settings": varied}), "")
    count = 1
    for values in varied.values():
        count *= len(values)
    assert len({each.name for each in members}) == len(members) == count


@given(value=st.floats(allow_nan=False, allow_infinity=False))
def test_different_numbers_have_different_names(value):
    assert float(format_value(value)) == value


def test_paths_are_read_and_written_without_touching_the_table():
    table = {"a": {"b": 1}, "c": {}}
    assert dict(list_leaves(table)) == {("a", "b"): 1, ("c",): {}}
    assert read_path(table, ("a", "b")) == 1
    assert read_path(table, ("a", "b", "x")) is None
    assert _apply_changes(table, {("a", "x"): 2, ("c", "y", "z"): 3}) == {
        "a": {"b": 1, "x": 2},
        "c": {"y": {"z": 3}},
    }
    assert table == {"a": {"b": 1}, "c": {}}


def test_a_suite_is_made_of_tables_as_of_a_file(read):
    base = {"method": "ast", "episodes": 7, "settings": {"alpha": 10}}
    made = Suite.of("wanted", base=base, sweep={"settings": {"alpha": [10, 20]}})
    assert made == read(BASE + "[sweep]\nsettings.alpha = [10, 20]\n")
    with pytest.raises(UnknownName, match="swep"):
        Suite.of("wanted", base=base, swep={})
    with pytest.raises(InvalidValue, match=r"base\.name"):
        Suite.of("wanted", base={**base, "name": "other"}, sweep={"seed": [1]})


@pytest.mark.parametrize(
    "values",
    [np.arange(10, 40, 10), np.linspace(10, 30, 3).astype(int), range(10, 40, 10), (10, 20, 30)],
)
def test_the_values_of_an_axis_may_be_any_sequence(values):
    base = {"method": "ast", "episodes": np.int64(7)}
    plain = Suite.of(
        "wanted", base=base, grid={"seed": [1, 2, 3], "settings": {"alpha": [10, 20, 30]}}
    )
    made = Suite.of(
        "wanted", base=base, grid={"seed": np.arange(1, 4), "settings": {"alpha": values}}
    )
    assert made == plain
    assert type(made.members[0].spec.settings["alpha"]) is int


def test_an_axis_of_objects_is_refused_by_its_name():
    with pytest.raises(InvalidValue, match=r"grid.*an object of type object is not plain data"):
        Suite.of("wanted", base={"method": "ast", "episodes": 7}, grid={"seed": [object()]})
