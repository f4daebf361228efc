"""`eigenfail noise`: from a sensor's log to a model that a campaign uses."""

import csv
import json

import numpy as np
import pytest

from eigenfail.cli.specs import read_spec
from eigenfail.suites import read_disturbance
from eigenfail.values.disturbance import DisturbanceModel

HEAD = ("track", "time_s", "dx_m", "dy_m", "seen_dx_m", "seen_dy_m")


@pytest.fixture
def log(tmp_path):
    """A log of white noise that grows along the road alone; one row is absent."""
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
                if (track, step) != (0, 3):
                    table.writerow((track, round(0.1 * step, 3), dx, dy, along, across))
    return file


@pytest.fixture
def log_of_channels(log, tmp_path):
    """The same log with speeds, misses for two steps in a row, and ghosts ahead and behind."""
    random = np.random.default_rng(6)
    file = tmp_path / "channels.csv"
    with log.open() as text, file.open("w", newline="") as copy:
        table = csv.DictWriter(copy, (*HEAD, "speed_mps", "seen_speed_mps"))
        table.writeheader()
        for row in csv.DictReader(text):
            step = round(10.0 * float(row["time_s"]))
            row |= {"speed_mps": 20.0, "seen_speed_mps": 20.0 + 0.3 * random.standard_normal()}
            if (int(row["track"]) + step) % 15 in {3, 4}:
                row |= {"seen_dx_m": "", "seen_dy_m": "", "seen_speed_mps": ""}
            row["time_s"] = round(float(row["time_s"]) + 2.5 * int(row["track"]), 3)
            table.writerow(row)
        for number in range(25):
            for step in range(2):
                time_s = round(0.5 + 4.0 * number + 0.1 * step, 3)
                seen = {"seen_dx_m": 30.0 + number if number % 5 else -4.0, "seen_dy_m": 0.0}
                table.writerow({"track": f"ghost {number}", "time_s": time_s} | seen)
    return file


def test_a_fitted_model_is_what_a_campaign_reads(eigenfail, log, tmp_path):
    model_file, campaign = tmp_path / "sensor.toml", tmp_path / "campaign.toml"
    done = eigenfail("noise", "fit", log, "--output", model_file, "--json")
    assert done.exit_code == 0, done.stderr
    report = json.loads(done.stdout)
    assert (report["tracks"], report["measurements"]) == (40, 1199)
    assert report["misses"] == {"share": 0.0, "mean_steps": None, "ghosts": 0}
    assert not {"bands", "remarks"} & report.keys()
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
        "0 % of the steps",
        f"Written to {file}. A campaign in the same folder uses it with disturbance = ",
    ):
        assert words in done.stdout
    again = eigenfail("noise", "fit", log, "--output", file)
    assert again.exit_code == 2
    assert f"'{file}' exists already. Choose another file" in again.stderr


def test_a_log_of_more_than_positions_gives_channels(eigenfail, log_of_channels, tmp_path):
    file, pictures = tmp_path / "sensor.toml", tmp_path / "pictures"
    words = ("--output", file, "--pictures", pictures, "--json")
    done = eigenfail("noise", "fit", log_of_channels, *words)
    assert done.exit_code == 0, done.stderr
    report = json.loads(done.stdout)
    found = {channel["name"]: channel for channel in report["model"]["channels"]}
    assert list(found) == ["longitudinal", "lateral", "speed", "missed", "ghost"]
    assert found["speed"]["sigma"] == pytest.approx(0.3, abs=0.05)
    # Runs of two steps after thirteen without, some of them cut off by the ends of tracks.
    assert found["missed"]["shape"]["rate"] == pytest.approx(1.0 / 13.0, abs=0.01)
    assert found["missed"]["shape"]["mean_steps"] == pytest.approx(2.0, abs=0.05)
    ahead = [30.0 + number for number in range(25) if number % 5]
    assert found["ghost"]["ahead_m"] == pytest.approx(np.median(ahead))
    assert found["ghost"]["shape"]["mean_steps"] == pytest.approx(2.0)
    assert "5 ghosts first seen next to or behind the ego: left out." in report["remarks"]
    assert sum(band["begun"] for band in report["bands"]) > 40
    failed = {one["name"] for one in report["checks"] if not one["holds"]}
    assert "missed: share of runs that end after its first step" in failed

    written = read_disturbance(file)
    assert [channel.name for channel in written.list_channels()] == list(found)
    assert written.list_channels()[3].shape.rate == pytest.approx(
        found["missed"]["shape"]["rate"], rel=1e-5
    )
    assert "# missed.mean_steps: 95 % interval" in file.read_text()
    assert {one.stem for one in pictures.iterdir()} == set(found)
    assert all(one.read_text().startswith("<svg") for one in pictures.iterdir())
    again = eigenfail("noise", "fit", log_of_channels, "--pictures", pictures)
    assert again.exit_code == 2
    assert f"'{pictures}' exists already. Choose another folder" in again.stderr


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


def test_what_a_model_draws_is_drawn(eigenfail, tmp_path):
    file, pictures = tmp_path / "model.toml", tmp_path / "pictures"
    file.write_text(
        '[[channels]]\nname = "ego.speed"\n[[channels]]\nname = "delay"\n'
        '[[channels]]\nname = "missed"\n'
        'shape = { kind = "markov", rate = 0.01, mean_steps = 3.0, rate_per_m = 0.001 }\n'
    )
    shown = eigenfail("noise", "show", file, "--pictures", pictures)
    assert shown.exit_code == 0, shown.stderr
    assert f"Pictures in {pictures}: ego-speed.svg, missed.svg." in shown.stdout
    assert "Events of missed" in (pictures / "missed.svg").read_text()


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
    drawn = eigenfail("noise", "show", file, "--pictures", tmp_path / "pictures")
    assert drawn.exit_code == 2
    assert "noise of a function is not drawn" in drawn.stderr


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
        (("import", "absent.yaml"), "absent.yaml: cannot be read"),
    ],
)
def test_a_file_that_is_not_there_is_a_mistake(eigenfail, words, text):
    done = eigenfail("noise", *words)
    assert done.exit_code == 2
    assert text in done.stderr


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
