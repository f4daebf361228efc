"""`eigenfail noise`: from a sensor's log to a model that a campaign uses."""

import csv
import json

import numpy as np
import pytest

from eigenfail.cli.specs import read_spec
from eigenfail.errors import InputError
from eigenfail.suites import Suite, read_disturbance
from eigenfail.values import Correlated, DisturbanceModel

HEAD = ("track", "time_s", "dx_m", "dy_m", "seen_dx_m", "seen_dy_m")


@pytest.fixture
def log(tmp_path):
    """A log of white noise that grows along the road alone; one measurement is missed."""
    random = np.random.default_rng(5)
    file = tmp_path / "tracks.csv"
    with file.open("w", newline="") as text:
        table = csv.writer(text)
        table.writerow(HEAD)
        for track in range(40):
            for step in range(30):
                dx, dy = 20.0 + 2.0 * track - 0.5 * step, -3.5 + 0.1 * step
                along = dx + (0.02 * dx + 1.0) * random.standard_normal()
                across = dy + 0.2 * random.standard_normal()
                seen = ("", "") if (track, step) == (0, 3) else (along, across)
                table.writerow((track, round(0.1 * step, 3), dx, dy, *seen))
    return file


def test_a_fitted_model_is_what_a_campaign_reads(eigenfail, log, tmp_path):
    model_file, campaign = tmp_path / "sensor.toml", tmp_path / "campaign.toml"
    done = eigenfail("noise", "fit", log, "--output", model_file, "--json")
    assert done.exit_code == 0, done.stderr
    report = json.loads(done.stdout)
    assert (report["tracks"], report["measurements"]) == (40, 1199)
    assert report["misses"] == {"share": 1 / 1200, "mean_steps": 1.0, "ghosts": 0}
    assert [one["kind"] for one in report["shapes"]] == ["white", "ar1", "student_t"]

    campaign.write_text('method = "monte_carlo"\nepisodes = 5\ndisturbance = "sensor.toml"\n')
    model = read_spec(campaign).disturbance
    assert model == read_disturbance(model_file) == read_disturbance(campaign)
    for name in DisturbanceModel.__struct_fields__[:4]:
        assert getattr(model, name) == pytest.approx(report["model"][name], rel=1e-5)
    planted = {"longitudinal_slope": 0.02, "longitudinal_base_m": 1.0, "lateral_base_m": 0.2}
    for one in report["parameters"]:
        if one["name"] in planted:
            width = one["interval"]["high"] - one["interval"]["low"]
            assert abs(one["value"] - planted[one["name"]]) < width < planted[one["name"]]
    assert "# longitudinal_slope: 95 % interval" in model_file.read_text()


def test_the_terminal_says_what_was_fitted_how_well_and_where_it_was_written(
    eigenfail, log, tmp_path
):
    file = tmp_path / "sensor.toml"
    done = eigenfail("noise", "fit", log, "--output", file)
    for words in (
        "longitudinal_slope",
        "shape chosen",
        "1,199, 0.1 s apart",
        "in runs of 1 steps on average; not part of the model",
        f"Written to {file}. A campaign in the same folder uses it with disturbance = ",
    ):
        assert words in done.stdout
    again = eigenfail("noise", "fit", log, "--output", file)
    assert again.exit_code == 2
    assert f"'{file}' exists already. Choose another file" in again.stderr


def test_a_model_of_another_step_says_so(eigenfail, log, tmp_path):
    slower = tmp_path / "slower.csv"
    with log.open() as text:
        rows = list(csv.DictReader(text))
    with slower.open("w", newline="") as text:
        table = csv.DictWriter(text, HEAD)
        table.writeheader()
        table.writerows({**row, "time_s": 2.0 * float(row["time_s"])} for row in rows)
    file = tmp_path / "sensor.toml"
    done = eigenfail("noise", "fit", slower, "--step", "0.2", "--output", file)
    assert done.exit_code == 0, done.stderr
    words = "The model is of steps of 0.2 s: use it in scenarios with this time step alone."
    assert words in done.stdout
    assert f"# {words}" in file.read_text()
    refused = eigenfail("noise", "fit", slower)
    assert refused.exit_code == 2
    assert "If the sensor is slower, give its period as --step." in refused.stderr


def test_a_model_is_shown_in_metres_at_several_distances(eigenfail, tmp_path):
    file = tmp_path / "model.toml"
    file.write_text('longitudinal_base_m = 2.0\n[shape]\nkind = "student_t"\n')
    shown = eigenfail("noise", "show", file)
    assert shown.exit_code == 0, shown.stderr
    assert "heavy tails of 5 degrees of freedom" in shown.stdout
    row = next(line.split() for line in shown.stdout.splitlines() if line.split()[:1] == ["0"])
    # Half of a Student t of 5 degrees of freedom is below 0.7267, in unit variance 0.5629.
    assert row[:3] == ["0", "2.00", "1.13"]


def test_a_model_of_channels_is_shown_in_their_units(eigenfail, tmp_path):
    file = tmp_path / "model.toml"
    file.write_text(
        'scale = 2.0\n[[channels]]\nname = "speed"\nsigma_per_m = 0.01\n'
        '[[channels]]\nname = "every.missed"\n[[channels]]\nname = "ego.heading"\n'
    )
    shown = eigenfail("noise", "show", file)
    assert shown.exit_code == 0, shown.stderr
    assert "begins with probability 0.01 a step" in shown.stdout
    assert "Size of speed errors [m/s]" in shown.stdout
    assert "Size of ego.heading errors [rad]" in shown.stdout
    rows = [line.split() for line in shown.stdout.splitlines() if line.split()[:1] == ["0"]]
    assert [row[1] for row in rows] == ["1.00", "0.0400"]


FUNCTION = """
method = "cem"
episodes = 5
simulator = "function"
scenario = "function"
planner = "my_module:robustness"
[scenario_parameters]
steps = 20
channels = ["gust", "drift"]
"""


def test_the_noise_of_a_function_is_its_scale_at_every_step_of_each_channel(eigenfail, tmp_path):
    file = tmp_path / "campaign.toml"
    file.write_text(f'{FUNCTION}[disturbance]\nscale = 2.0\nshape = {{kind = "student_t"}}\n')
    shown = eigenfail("noise", "show", file)
    assert shown.exit_code == 0, shown.stderr
    for words in ("gust, drift", "2 at every step", "heavy tails of 5 degrees of freedom"):
        assert words in shown.stdout
    # As in the model above: 0.5629 sigma are not exceeded by half of the noise.
    assert ["2.00", "1.13"] in [line.split()[:2] for line in shown.stdout.splitlines()]
    for words in ("dx", "istance", "ongitudinal", "ateral"):
        assert words not in shown.stdout


def test_a_model_of_a_road_in_a_campaign_on_a_function_is_refused(eigenfail, tmp_path):
    file = tmp_path / "campaign.toml"
    file.write_text(f"{FUNCTION}[disturbance]\nlateral_slope = 0.1\n")
    shown = eigenfail("noise", "show", file)
    assert shown.exit_code == 2
    assert "slopes and bases do not apply to functions" in shown.stderr


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("fit", "absent.csv"), "absent.csv: cannot be read"),
        (("show", "absent.toml"), "absent.toml: cannot be read"),
    ],
)
def test_a_file_that_is_not_there_is_a_mistake(eigenfail, words, text):
    done = eigenfail("noise", *words)
    assert done.exit_code == 2
    assert text in done.stderr


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


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("disturbance = 5", "is not a table"),
        ('disturbance = "campaign.toml"', "'campaign.toml' describes a campaign"),
        ("[disturbance]\nshape = {kind = 'ar1', phi = 0.5}", "phi"),
    ],
)
def test_a_campaign_whose_model_is_none_is_refused(eigenfail, tmp_path, text, problem):
    file = tmp_path / "campaign.toml"
    file.write_text(f'method = "monte_carlo"\nepisodes = 5\n{text}\n')
    done = eigenfail("noise", "show", file)
    assert done.exit_code == 2
    assert problem in done.stderr
    assert "campaign.toml" in done.stderr
