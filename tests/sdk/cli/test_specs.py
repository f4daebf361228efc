"""TOML files: what is wrong in them is said by file, field and known names."""

import pytest

from eigenfail.cli.specs import check_plugins, describe_check, read_spec
from eigenfail.errors import InputError, InvalidValue, UnknownName
from eigenfail.suites import Suite
from eigenfail.values.campaign_spec import StopRules
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.shapes import Correlated
from eigenfail.wire.http import CampaignCheck


@pytest.fixture
def write(tmp_path):
    def write_file(text):
        file = tmp_path / "wanted.toml"
        file.write_text(text)
        return file

    return write_file


def test_a_file_becomes_a_spec_named_after_it(write):
    spec = read_spec(write('method = "ast"\nepisodes = 7\n[disturbance]\nlateral_base_m = 0.5'))
    assert (spec.name, spec.method, spec.episodes) == ("wanted", "ast", 7)
    assert spec.disturbance.lateral_base_m == 0.5
    assert spec.disturbance.longitudinal_base_m == 1.0


def test_options_take_the_place_of_the_file(write):
    file = write('name = "mine"\nmethod = "ast"\nepisodes = 7\nseed = 3')
    spec = read_spec(file, episodes=9, seed=None)
    assert (spec.name, spec.episodes, spec.seed) == ("mine", 9, 3)


def test_a_file_names_the_shape_of_the_noise(write):
    shape = '[disturbance.shape]\nkind = "ar1"\nlateral_correlation = 0.5'
    text = f'method = "ast"\nepisodes = 7\n{shape}'
    assert read_spec(write(text)).disturbance.shape == Correlated(0.8, 0.5)


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("episodes = 7", "method"),
        ('method = "ast"', "episodes"),
        ('method = "ast"\nepisodes = 0', "episodes"),
        ('method = "ast"\nepisodes = nan', "episodes"),
        ('method = "ast"\nepisodes = "many"', "episodes"),
        ('method = "ast"\nepisodes = 1\n[disturbance]\nlateral_base_m = 0.0', "lateral_base_m"),
        ('method = "ast"\nepisodes = 1\ndisturbance = 3', "disturbance"),
        ('method = "ast"\nepisodes = 1\n[disturbance]\nshape = "ar1"', "disturbance.shape"),
    ],
)
def test_a_value_outside_its_bounds_is_refused_by_field(write, text, field):
    with pytest.raises(InvalidValue) as caught:
        read_spec(write(text))
    assert field in str(caught.value)
    assert caught.value.exit_code == 2


@pytest.mark.parametrize("text", ["episodes =", "[[", "\x00"])
def test_what_is_not_toml_is_refused_by_file(write, text):
    with pytest.raises(InvalidValue, match=r"wanted\.toml: is not TOML"):
        read_spec(write(text))


def test_a_file_that_is_not_there_or_not_text_is_refused(tmp_path):
    with pytest.raises(InvalidValue, match="cannot be read: No such file"):
        read_spec(tmp_path / "none.toml")
    with pytest.raises(InvalidValue, match="cannot be read: Is a directory"):
        read_spec(tmp_path)
    (tmp_path / "image.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(InvalidValue, match="is not TOML"):
        read_spec(tmp_path / "image.toml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('method = "asd"\nepisodes = 1', "method: 'asd' is not known. Did you mean 'ast'?"),
        (
            'method = "ast"\nepisodes = 1\n[settings]\nalfa = 1.0',
            "settings: 'alfa' is not known. Did you mean 'alpha'?",
        ),
    ],
)
def test_plug_ins_and_their_settings_are_checked_before_anything_starts(write, text, message):
    with pytest.raises(UnknownName) as caught:
        check_plugins(read_spec(write(text)))
    assert message in str(caught.value)


def test_a_setting_outside_its_bounds_is_refused_before_anything_starts(write):
    spec = read_spec(write('method = "ast"\nepisodes = 1\n[scenario_parameters]\ndistance_m = 1.0'))
    with pytest.raises(InvalidValue, match=r"scenario_parameters\.distance_m"):
        check_plugins(spec)


STOPPING = 'method = "ast"\nepisodes = 7\n[stop]\n'


def test_options_take_the_place_of_single_stop_rules(write):
    file = write(STOPPING + "failures = 3\nwall_s = 60")
    assert read_spec(file).stop == StopRules(failures=3, wall_s=60.0)
    again = read_spec(file, {"failures": 10, "cv": 0.2, "wall_s": None})
    assert again.stop == StopRules(failures=10, cv=0.2, wall_s=60.0)


@pytest.mark.parametrize("given", [{}, {"failures": 1}])
def test_stop_rules_are_a_table(write, given):
    with pytest.raises(InvalidValue, match=r"wanted\.toml.*stop"):
        read_spec(write('method = "ast"\nepisodes = 7\nstop = 3'), given)


def test_a_stop_rule_of_an_option_has_bounds_too(write):
    with pytest.raises(InvalidValue, match=r"wanted\.toml: stop\.half_width"):
        read_spec(write('method = "ast"\nepisodes = 7'), {"half_width": 0.7})


def test_a_suite_is_named_as_one_with_the_command_that_runs_it(write):
    file = write('[base]\nmethod = "ast"\nepisodes = 7\n[sweep]\nseed = [1, 2]')
    with pytest.raises(InvalidValue) as caught:
        read_spec(file)
    told = (
        f"wanted.toml: this is a suite, not a campaign. Run it with `eigenfail suite run {file}`."
    )
    assert str(caught.value) == told


def test_a_campaign_is_named_as_one_where_a_suite_is_wanted(write):
    file = write('method = "ast"\nepisodes = 7\n[settings]\nalpha = 3.0')
    with pytest.raises(InvalidValue) as caught:
        Suite.read(file)
    told = f"wanted.toml: this is a campaign, not a suite. Run it with `eigenfail run {file}`."
    assert str(caught.value) == told


def test_fields_from_the_command_line_take_the_place_of_the_files(write):
    file = write('method = "ast"\nepisodes = 7\nseed = 1\n[settings]\nalpha = 3.0\nc_dist = 9.0')
    changes = ["settings.alpha=100", "seed=2", "name=a=b", "stop.failures=4"]
    found = read_spec(file, {"failures": 5}, changes, episodes=8)
    assert found.settings == {"alpha": 100, "c_dist": 9.0}
    assert (found.name, found.seed, found.episodes) == ("a=b", 2, 8)
    assert found.stop.failures == 5, "An option of its own has the last word."
    with pytest.raises(UnknownName, match="'sed' is not known"):
        read_spec(file, changes=["sed=2"])


@pytest.mark.parametrize("simulator", ["highway", "function"])
def test_a_check_lists_slopes_and_bases_on_roads_alone(write, simulator):
    text = f'method = "cem"\nepisodes = 7\nsimulator = "{simulator}"\n[disturbance]\nscale = 2.0'
    lines = describe_check(CampaignCheck(read_spec(write(text)))).splitlines()
    listed = {line.split()[0] for line in lines if "disturbance." in line}
    everywhere = {"disturbance.scale", "disturbance.shape.kind"}
    on_roads = {f"disturbance.{name}" for name in DisturbanceModel.__struct_fields__[:4]}
    assert listed == (everywhere if simulator == "function" else everywhere | on_roads)


def test_a_suite_names_the_file_in_its_base(tmp_path):
    (tmp_path / "sensor.toml").write_text('[shape]\nkind = "ar1"\nlongitudinal_correlation = 0.6\n')
    suite = tmp_path / "suite.toml"
    suite.write_text(
        '[base]\nmethod = "monte_carlo"\nepisodes = 5\ndisturbance = "sensor.toml"\n'
        "[sweep]\nseed = [1, 2]\n"
    )
    models = {member.spec.disturbance for member in Suite.read(suite).members}
    assert models == {DisturbanceModel(shape=Correlated(0.6, 0.8))}


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("sigma = 1.0", "'sigma' is not known"),
        ("scale = 99.0", "scale"),
        ("scale =", "is not TOML"),
    ],
)
def test_a_model_that_is_none_is_refused_by_its_file(tmp_path, text, problem):
    (tmp_path / "sensor.toml").write_text(text)
    campaign = tmp_path / "campaign.toml"
    campaign.write_text('method = "monte_carlo"\nepisodes = 5\ndisturbance = "sensor.toml"\n')
    with pytest.raises(InputError, match=problem) as caught:
        read_spec(campaign)
    assert "sensor.toml" in str(caught.value)
