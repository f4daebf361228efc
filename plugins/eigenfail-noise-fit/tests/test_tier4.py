"""Parameters of scenario_simulator_v2 become channels, and what has no counterpart is listed."""

import copy
import os

import numpy as np
import pytest
import yaml

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.suites import read_disturbance
from eigenfail.values.shapes import Autoregressive, Markov, White
from eigenfail_noise_fit.report import format_channels
from eigenfail_noise_fit.tier4 import import_noise

RADII = [10.0, 50.0, 200.0]


def constant(value):
    return {"ellipse_normalized_x_radius": 1.0, "values": [value] * 3}


ELLIPTIC = {
    "ellipse_y_radii": RADII,
    "distance": {
        "autocorrelation_coefficient": {"amplitude": 0.8, "decay": 0.0, "offset": 0.1},
        "mean": constant(0.0),
        "standard_deviation": constant(0.5),
    },
    "yaw": {"standard_deviation": constant(0.02)},
    "yaw_flip": {"rate": 0.1, "speed_threshold": 0.1},
    "true_positive": {
        "autocorrelation_coefficient": {"amplitude": 0.0, "decay": 0.0, "offset": 0.6},
        "rate": constant(0.9),
    },
}
ENTITIES = {"types": ["*"], "subtypes": ["*"], "names": ["*"]}
AXIS = {key: value for key, value in ELLIPTIC["distance"].items() if key != "mean"}
LOCAL = {name: value for name, value in ELLIPTIC.items() if name != "distance"} | {
    "position": {"x": AXIS, "y": AXIS | {"standard_deviation": constant(1.5)}},
    "noise_application_entities": ENTITIES,
}


def write(tmp_path, version, table, **topic):
    noise = {"model": {"version": version}, f"v{version}": table}
    topics = {"/perception/object_recognition/detection/objects": {"noise": noise, **topic}}
    file = tmp_path / "parameters.yaml"
    file.write_text(yaml.safe_dump({"/**": {"ros__parameters": topics}}))
    return file


def read(tmp_path, version, table, config=None, **topic):
    return import_noise(write(tmp_path, version, table, **topic), 0.1, 100.0, config)


def list_by_name(imported):
    return {channel.name: channel for channel in imported.channels}


def test_constant_values_become_what_they_are(tmp_path):
    imported = read(tmp_path, 2, ELLIPTIC, override_legacy_configuration=True, delay=0.2)
    found = list_by_name(imported)
    assert list(found) == ["every.longitudinal", "every.heading", "every.missed"]
    along, heading, missed = found.values()
    assert (along.sigma, along.sigma_per_m) == pytest.approx((0.5, 0.0), abs=1e-9)
    assert along.shape == Autoregressive(pytest.approx(0.9))
    assert heading.shape == White()
    assert heading.sigma == pytest.approx(0.02)
    # P(missed | detected) = (1 − 0.6) · 0.1, and P(detected | missed) = (1 − 0.6) · 0.9.
    assert isinstance(missed.shape, Markov)
    assert missed.shape.rate == pytest.approx(0.04)
    assert missed.shape.mean_steps == pytest.approx(1.0 / 0.36)
    assert missed.shape.growth_per_m == pytest.approx(0.0, abs=1e-12)
    assert [one.split(":")[0] for one in imported.left_out] == [
        "noise.v2.distance",
        "noise.v2.yaw_flip",
        "delay",
    ]


def test_the_correlation_is_that_of_a_step(tmp_path):
    table = copy.deepcopy(ELLIPTIC)
    table["distance"]["autocorrelation_coefficient"]["decay"] = 2.0
    file = write(tmp_path, 2, table)
    for step_s, phi in ((0.1, 0.1 + 0.8 * 0.8187308), (0.2, 0.1 + 0.8 * 0.6703200)):
        along = import_noise(file, step_s, 100.0, None).channels[0]
        assert along.shape.correlation == pytest.approx(phi)


def test_steps_over_the_distance_become_a_line_and_its_deviation_is_told(tmp_path):
    table = copy.deepcopy(ELLIPTIC)
    table["distance"]["standard_deviation"] = {
        "ellipse_normalized_x_radius": 2.0,
        "values": [0.0, 1.0, 1.0],
    }
    table["true_positive"]["rate"]["values"] = [1.0, 0.9, 0.8]
    table["distance"]["mean"]["values"] = [0.1, 0.0, 0.0]
    imported = read(tmp_path, 2, table)
    along = list_by_name(imported)["every.longitudinal"]
    assert along.sigma_per_m > 0.0
    # 0 up to 20 m, then 1.
    distance = np.arange(101.0)
    apart = np.abs(along.sigma_per_m * distance + along.sigma - (distance >= 20.0)).max()
    words = f"the line of sigma differs from the steps by up to {apart:.3g}"
    assert any(words in one for one in imported.mapped)
    assert list_by_name(imported)["every.missed"].shape.growth_per_m > 0.0
    assert any("mean: channels have no bias" in one for one in imported.left_out)
    assert any("misses last longer where they are frequent" in one for one in imported.left_out)


def test_the_simple_model_is_white_and_misses_are_independent(tmp_path):
    table = {"position": {"standard_deviation": 0.3}, "missing_probability": 0.2}
    imported = read(tmp_path, 1, table)
    found = list_by_name(imported)
    assert found["every.lateral"].sigma == found["every.longitudinal"].sigma == 0.3
    assert found["every.missed"].shape == Markov(0.2, pytest.approx(1.25))
    assert any("override_legacy_configuration: is false" in one for one in imported.left_out)


def test_the_fourth_model_has_both_axes_and_a_name(tmp_path):
    found = list_by_name(read(tmp_path, 4, {"all": LOCAL}))
    assert found["every.longitudinal"].sigma == pytest.approx(1.5)
    assert found["every.lateral"].sigma == pytest.approx(0.5)
    two = {"cars": LOCAL, "trucks": LOCAL}
    with pytest.raises(InvalidValue, match="has 2 configurations: cars, trucks"):
        read(tmp_path, 4, two)
    with pytest.raises(UnknownName, match="truck"):
        read(tmp_path, 4, two, config="truck")
    assert read(tmp_path, 3, {"cars": ELLIPTIC, "trucks": ELLIPTIC}, config="cars").channels


def test_what_is_written_is_a_model(tmp_path):
    imported = read(tmp_path, 2, ELLIPTIC)
    file = tmp_path / "model.toml"
    file.write_text(format_channels(imported.channels))
    names = [channel.name for channel in read_disturbance(file).list_channels()]
    assert names == [channel.name for channel in imported.channels]


def change(**values):
    return ELLIPTIC | values


@pytest.mark.parametrize(
    ("version", "table", "problem"),
    [
        (5, {}, "noise.model.version: '5' is not known. Versions are 1, 2, 3, 4"),
        (1, {}, "all of its noise is 0"),
        (1, {"missing_probability": 1.0}, "missing_probability: is 1 or more"),
        (1, {"missing_probability": "often"}, "'often' is not a number of 0 or more"),
        (1, {"position": 3.0}, "noise.v1.position: is not a table"),
        (2, change(ellipse_y_radii=[10.0]), "has 3 values, and ellipse_y_radii 1"),
        (2, change(ellipse_y_radii="near"), "ellipse_y_radii: is not a list of numbers"),
        (2, change(true_positive={"rate": constant(1.5)}), "true_positive.rate.values: is above 1"),
        (2, change(yaw={"standard_deviation": constant(-1.0)}), "has a negative value"),
        (
            2,
            change(yaw={"standard_deviation": constant(1.0) | {"ellipse_normalized_x_radius": 0}}),
            "is 0, so that every distance is infinite",
        ),
        (
            2,
            change(
                yaw={
                    "standard_deviation": constant(1.0),
                    "autocorrelation_coefficient": {"offset": 1.2},
                }
            ),
            "gives a correlation of 1.2 after 0.1 s",
        ),
    ],
)
def test_parameters_that_are_none_are_refused_with_their_place(tmp_path, version, table, problem):
    with pytest.raises(InvalidValue, match=problem):
        read(tmp_path, version, table)


@pytest.mark.parametrize(
    ("text", "problem"),
    [("a: [", "is not YAML"), ("a: 1", "has no noise.model"), ("", "has no noise.model")],
)
def test_a_file_that_has_no_parameters_is_refused(tmp_path, text, problem):
    file = tmp_path / "parameters.yaml"
    file.write_text(text)
    with pytest.raises(InvalidValue, match=problem):
        import_noise(file, 0.1, 100.0, None)


def rename(table, path, new):
    """The table with a key at a path renamed."""
    changed = copy.deepcopy(table)
    inner = changed
    for name in path[:-1]:
        inner = inner[name]
    inner[new] = inner.pop(path[-1])
    return changed


@pytest.mark.parametrize(
    ("version", "table", "path", "new"),
    [
        (2, ELLIPTIC, ("distance", "standard_deviation"), "standard_devation"),
        (2, ELLIPTIC, ("distance", "standard_deviation", "values"), "vaules"),
        (2, ELLIPTIC, ("true_positive",), "true_positve"),
        (2, ELLIPTIC, ("ellipse_y_radii",), "ellipse_radii"),
        (2, ELLIPTIC, ("yaw_flip", "rate"), "rates"),
        (4, {"all": LOCAL}, ("all", "position"), "positions"),
        (4, {"all": LOCAL}, ("all", "position", "y", "standard_deviation"), "standard_deviaton"),
    ],
)
def test_a_misspelt_parameter_is_refused_with_the_right_name(tmp_path, version, table, path, new):
    with pytest.raises(UnknownName, match=f"'{new}'.*Did you mean '{path[-1]}'") as refused:
        read(tmp_path, version, rename(table, path, new))
    assert new in refused.value.field


def test_a_misspelt_topic_parameter_is_refused(tmp_path):
    with pytest.raises(UnknownName, match="Did you mean 'override_legacy_configuration'"):
        read(tmp_path, 2, ELLIPTIC, override_legacy_configurations=True)


def test_unknown_and_unused_parameters_are_left_out_by_name(tmp_path):
    table = rename(LOCAL, ("yaw",), "rotation") | {"colour": 3}
    imported = read(tmp_path, 4, {"all": table, "none": {}}, config="all", seed=3, vehicles=[1])
    said = " ".join(imported.left_out)
    for name in ("all.rotation: is not", "all.colour: is not", "v4.none: is another"):
        assert f"noise.v4.{name}".replace("v4.v4", "v4") in said
    assert "seed: " in said
    assert "vehicles: is not known" in said
    assert "every.heading" not in list_by_name(imported)


@pytest.mark.parametrize("name", ["/dev/zero", "pipe.yaml"])
def test_parameters_are_read_from_a_regular_file_alone(tmp_path, name):
    os.mkfifo(tmp_path / "pipe.yaml")
    with pytest.raises(InvalidValue, match="not a regular file"):
        import_noise(tmp_path / name, 0.1, 100.0, None)
