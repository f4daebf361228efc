"""What docs/noise.md says of the disturbance models is what they are."""

import re
import tomllib
from typing import get_args

import msgspec

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import EGO, GHOST_AHEAD_M, QUANTITIES
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.shapes import Markov, Shape

KINDS = {kind.__struct_config__.tag: kind for kind in get_args(Shape)}


def rows(text):
    """The cells of every line of the tables in a text."""
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_it_tells_every_setting_with_default_and_bounds(noise_page):
    stated = {cells[0]: cells[1:] for cells in rows(noise_page.text)}
    for kind in (DisturbanceModel, *KINDS.values()):
        schema = msgspec.json.schema(kind)["$defs"][kind.__name__]["properties"]
        for name, field in schema.items():
            if name in ("kind", "shape"):
                continue
            default, bounds = stated[f"`{name}`"][:2]
            if field.get("type") == "boolean":
                assert (default, bounds) == ("false", "true, false")
                continue
            known = field.get("default")
            assert default == "–" if known is None else float(default) == known, name
            low = field.get("minimum", field.get("exclusiveMinimum", field.get("minItems")))
            high = field.get("maximum", field.get("exclusiveMaximum", field.get("maxItems")))
            assert [float(n) for n in re.findall(r"[\d.]+", bounds)] == [low, high], name
            assert bounds.startswith("(" if "exclusiveMinimum" in field else "["), name
            assert bounds.endswith(")" if "exclusiveMaximum" in field else "]"), name


def test_it_names_every_kind(noise_page):
    assert [kind for kind in KINDS if f"### `{kind}`" not in noise_page.text] == []


def test_its_models_can_be_asked_for(noise_page):
    tables = [tomllib.loads(block)["disturbance"] for block in noise_page.blocks("toml")]
    models = [msgspec.convert(one, DisturbanceModel) for one in tables if isinstance(one, dict)]
    assert {type(model.shape) for model in models} == set(KINDS.values())
    assert any(model.scale > 1.0 for model in models)
    assert CampaignSpec(name="n", method="m", episodes=1).disturbance in models


def test_it_tells_every_quantity_with_its_defaults(noise_page):
    stated = {}
    for names, _, sigma, slope, of_ego in (
        cells for cells in rows(noise_page.text) if len(cells) == 5
    ):
        sigmas = sigma.split(", ")
        for name, own in zip(re.findall(r"`(\w+)`", names), sigmas, strict=False):
            stated[name] = (own, slope, of_ego)
    for name, quantity in QUANTITIES.items():
        numbers = (quantity.sigma, quantity.sigma_per_m)
        sigma, slope = ("–" if each is None else f"{each:g}" for each in numbers)
        assert stated[name][:2] == (sigma, slope), name
        assert (stated[name][2] == "yes") == (EGO in quantity.targets), name
    assert f"default {GHOST_AHEAD_M:g}" in noise_page.text
    chain = Markov()
    assert f"`rate` (default {chain.rate:g}, at most 0.5)" in noise_page.text
    assert f"`mean_steps` (default {chain.mean_steps:g})" in noise_page.text
