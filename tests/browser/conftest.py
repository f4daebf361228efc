"""A real server over made-up results, and Debian's Chromium to look at it."""

import contextlib
import shutil
from types import SimpleNamespace

import deadlines
import numpy as np
import pytest
from accepted import accept_spec
from made_once import make_once
from msgspec.structs import replace
from playwright.sync_api import expect, sync_playwright
from served import serve
from store_checks.gates import make_report

from eigenfail import plugins
from eigenfail.gate.verdicts import GateVerdict
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign import Overhead
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import (
    EpisodeFault,
    EpisodeResult,
    EpisodeTask,
    Outcome,
    TrajectorySource,
    unrunnable,
)
from eigenfail.values.estimates import Estimate, Interval
from eigenfail.values.measures import Measures
from eigenfail.values.records import Delivery
from eigenfail.values.scene import Scene
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.campaigns.analysis_jobs import run_analysis
from eigenfail_services.campaigns.proofs import launch_replays
from eigenfail_services.store.store import open_store

CHROMIUM = shutil.which("chromium-headless-shell") or shutil.which("chromium")
"""The shell has no window: it takes less than half of the processor time."""

ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
STEPS, HORIZON, DT_S = 70, 100, 0.1
PATIENCE_MS = 1_000 * deadlines.PROCESS_S

expect.set_options(timeout=PATIENCE_MS)


def spec(name, method, episodes=300, **fields):
    near = {"distance_m": 58.0}
    return CampaignSpec(
        name=name, method=method, episodes=episodes, scenario_parameters=near, **fields
    )


def noise_of(rng, steps, collided):
    bump = np.exp(-(((np.arange(steps) - 38) / 9.0) ** 2))[:, None] * np.array([1.9, -1.1])
    z = 0.9 * rng.normal(size=(steps, 2)) + (bump * rng.choice([-1, 1]) if collided else 0.0)
    sigma = np.stack([np.linspace(2.9, 1.2, steps), np.full(steps, 0.21)], axis=1)
    return NoiseTrajectory(z.astype(np.float32), sigma.astype(np.float32))


def scene_of(noise, steps):
    """The truck closes in on a car that changes into its lane."""
    t = DT_S * np.arange(steps + 1)
    # In every second kind of failure the truck brakes at the end.
    braking = 0.2 * noise.z[0, 0] + 4.0 * (noise.z[:, 0].sum() > 0.0)
    slower = braking * np.clip(t - t[-1] + 1.5, 0.0, None)
    ego = np.stack([24.0 * t - 0.55 * t**2, 0 * t, 0 * t, 24.0 - 1.1 * t - slower], axis=1)
    share = np.clip((t - 1.0) / 5.0, 0.0, 1.0)
    side = 3.5 * (1.0 - share**2 * (3.0 - 2.0 * share))
    heading = np.gradient(side, DT_S) / 12.0
    car = np.stack([72.0 + 12.0 * t, side, heading, 0 * t + 12.0], axis=1)
    perceived = car[:-1, :2] + noise.injected
    return Scene(
        dt_s=DT_S,
        vehicles=np.stack([ego, car], axis=1).astype(np.float32),
        sizes=np.array([[16.0, 2.5], [5.0, 2.0]], np.float32),
        perceived=perceived.astype(np.float32),
        controls=np.tile(np.array([-1.1, 0.0], np.float32), (steps, 1)),
    )


def result_of(index, share, seed=0):
    """One episode; it collides with the given probability."""
    rng = np.random.default_rng([seed, index])
    collided = bool(rng.random() < share)
    steps = STEPS + int(rng.integers(0, 12)) if collided else HORIZON
    noise = noise_of(rng, steps, collided)
    measures = Measures(
        robustness_m=0.0 if collided else float(rng.gamma(4.0, 1.6)),
        severity=float(rng.gamma(9.0, 12.0)) if collided else None,
        min_ttc_s=float(rng.uniform(0.1, 0.8) if collided else rng.uniform(2.0, 6.0)),
        max_drac_mps2=float(rng.uniform(5.0, 9.0) if collided else rng.uniform(0.3, 2.0)),
        ttc_violated_s=DT_S * (steps - 21) if collided else None,
        drac_violated_s=DT_S * (steps - 3) if collided and index % 2 else None,
        drac_at_warning_mps2=3.0 + index % 6 if collided else None,
        collided_s=DT_S * steps if collided else None,
        max_jerk_mps3=4.0,
        hard_brakings=index % 3,
        clipped_steps=0,
    )
    return EpisodeResult(
        index=index,
        seed=index + 1000,
        outcome=Outcome.COLLISION if collided else Outcome.SAFE,
        steps=steps,
        noise=noise,
        source="prior",
        measures=measures,
        scene=scene_of(noise, steps) if collided or index % 50 == 0 else None,
        wall_s=0.05,
    )


def deliver(store, campaign, results):
    store.episodes.commit(campaign, [Delivery(result, "worker-1") for result in results])


def analysed(store, campaign, **settings):
    """An analysis as the service makes it; its id."""
    analysis = store.analyses.create(campaign, AnalysisSettings(**settings)).id
    run_analysis(store, analysis)
    return analysis


def replay(store, campaign):
    """All episodes of a replay, of which every second one fails again."""
    store.campaigns.move(campaign, "running")
    count = store.campaigns.get(campaign).spec.episodes
    deliver(store, campaign, [result_of(index, float(index % 2 == 0), 4) for index in range(count)])
    store.campaigns.add_active(campaign, 0.4)
    store.campaigns.move(campaign, "done")


def fill(store):
    """Campaigns in every interesting state, analyses, and a proof that is half done."""
    made = SimpleNamespace()
    made.baseline = store.campaigns.create(
        accept_spec(spec("Monte Carlo on cut-in", "monte_carlo", 2000))
    ).id
    store.campaigns.move(made.baseline, "running")
    deliver(store, made.baseline, [result_of(index, 0.0, 1) for index in range(400)])
    store.campaigns.add_active(made.baseline, 61.0)
    made.ast = store.campaigns.create(accept_spec(spec("AST on cut-in", "ast"))).id
    store.campaigns.move(made.ast, "running")
    learned = [result_of(index, min(0.9, index / 250), 2) for index in range(300)]
    deliver(store, made.ast, learned)
    store.campaigns.add_active(made.ast, 43.0, Overhead(9.0, 4.0, 2.5))
    store.campaigns.move(made.ast, "done")
    made.failures = [result.index for result in learned if result.is_failure]
    made.difs = store.campaigns.create(accept_spec(spec("DiFS <b>on</b> cut-in", "difs"))).id
    store.campaigns.move(made.difs, "running")
    deliver(store, made.difs, [result_of(index, 0.03, 3) for index in range(180)])
    store.campaigns.add_active(made.difs, 27.0)
    made.analysis = analysed(store, made.ast)
    made.snapshot = analysed(store, made.difs, campaigns=(made.ast,), clusters=3)
    made.failed_analysis = analysed(store, made.baseline)
    proof = launch_replays(store, store.analyses.get(made.analysis), None)
    made.replay, made.second_replay, _ = (scenario.campaign for scenario in proof.scenarios)
    replay(store, made.replay)
    store.campaigns.move(made.second_replay, "running")
    deliver(store, made.second_replay, [result_of(0, 0.0, 5)])
    made.waiting_analysis = store.analyses.create(made.ast, AnalysisSettings(clusters=3)).id
    made.queued = store.campaigns.create(accept_spec(spec("Waits", "ast"))).id
    return made


LONG = "regression of the truck's planner release-2026.11-rc4, wet road, 58 m ahead, seed 1"
UNBROKEN = "planner-rulebook-v2.13.0+build.20261123." * 2
FAULT = "ValueError: the planner's state is not finite: [nan, 0.0, 0.0, nan]. " * 3
SUITE = "regression-of-release-2026.11-rc4 @ planner-rulebook-v2.13.0"
SIGN = np.where((np.arange(100) // 20) % 2 == 0, 2.0, -2.0)
WAVE = np.stack([SIGN, 0.0 * SIGN], axis=1).astype(np.float32)
TOLD = Estimate(
    by="importance sampling",
    episodes=9_100,
    probability=3.65e-6,
    cv=0.25,
    interval=Interval(2.2e-6, 5.9e-6),
    note="It knows nothing of regions that the search has not found; there it is a lower bound.",
)
REFUSED = Estimate(
    by="importance sampling",
    episodes=500,
    effective=4.0,
    problem="Too few episodes count: 4 of 500 hold the weight of all. Run more episodes.",
)


def mixed(index, share):
    """An episode that may collide, be unresolved at the horizon, or be errored."""
    if index % 7 == 6:
        task = EpisodeTask(index, index + 1000, TrajectorySource(WAVE))
        return unrunnable(task, EpisodeFault("planner", FAULT))
    result = result_of(index, share, 6)
    if result.is_failure or index % 5:
        return result
    measures = replace(result.measures, max_drac_mps2=9.0, final_drac_mps2=9.0)
    return replace(result, measures=measures)


def campaign_of(store, name, results, method="ast", **fields):
    """A campaign that has ended with these results; its id."""
    given = CampaignSpec(name=name, method=method, episodes=len(results), **fields)
    campaign = store.campaigns.create(accept_spec(given)).id
    store.campaigns.move(campaign, "running")
    deliver(store, campaign, results)
    store.campaigns.add_active(campaign, 12.0)
    store.campaigns.move(campaign, "done")
    return campaign


def fill_tables(store, made):
    """What makes tables wide: long names, unresolved and errored episodes, suites, estimates."""
    several = [mixed(index, 0.3) for index in range(60)]
    made.long = campaign_of(store, f"{LONG} {UNBROKEN}", several)
    errored = [mixed(7 * index + 6, 0.0) for index in range(5)]
    errored = [replace(result, index=index) for index, result in enumerate(errored)]
    made.errored = campaign_of(store, f"Errored: {LONG}", errored)
    drawn = {"distance_m": {"uniform": [52.0, 60.0]}}
    made.varied = campaign_of(store, f"Varied: {LONG}", several, scenario_parameters=drawn)
    made.members = [
        campaign_of(
            store,
            f"{SUITE}: far {number}, {LONG}",
            several,
            "cem",
            seed=number,
            planner=("rulebook", "idm")[number % 2],
            scenario_parameters={"distance_m": 52.0 + number},
        )
        for number in range(3)
    ]
    store.checkpoints.save(made.members[0], b"state", TOLD)
    store.checkpoints.save(made.members[1], b"state", REFUSED)
    made.suite = SUITE
    made.gate = store.gates.record(make_report(*GateVerdict, version=UNBROKEN[:80])).id
    made.long_analysis = analysed(store, made.long)
    made.real = campaign_of(store, "Wave on cut-in", real_results(), planner_version="1.4")


def real_results():
    """Episode 0 is a collision of the rulebook, whose planner can be asked for an account."""
    made = CampaignSpec(name="Wave on cut-in", method="monte_carlo", episodes=2)
    engine = plugins.load(plugins.ENGINES, "default")(made.setup())
    scales = (1.0, 0.3)
    tasks = [
        EpisodeTask(index, 5, TrajectorySource(scale * WAVE)) for index, scale in enumerate(scales)
    ]
    return list(engine.run(tasks))


@contextlib.contextmanager
def serving(store):
    """A real server on a free port of this machine."""
    with serve(create_app(store, ApiSettings(port=0, poll_s=0.05))) as port:
        yield f"http://127.0.0.1:{port}"


@pytest.fixture(scope="session")
def template(tmp_path_factory):
    """A database file that was filled, and the ids of what is in it; every module copies it."""

    def make(folder):
        opened = open_store(f"sqlite:///{folder / 'eigenfail.db'}")
        made = fill(opened)
        opened.close()
        return f"{folder / 'eigenfail.db'}", vars(made)

    return make_once(tmp_path_factory, "browser", make)


@pytest.fixture(scope="module")
def store(template, tmp_path_factory):
    file = shutil.copy(template[0], tmp_path_factory.mktemp("browser"))
    opened = open_store(f"sqlite:///{file}")
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def made(template):
    """Ids of what the store was filled with."""
    return SimpleNamespace(**template[1])


@pytest.fixture(scope="module")
def filled(store, made):
    """Ids of what the store was filled with, wide tables among it."""
    fill_tables(store, made)
    return made


@pytest.fixture(scope="module")
def address(store, made):
    with serving(store) as url:
        yield url


@pytest.fixture
def bare_address(tmp_path):
    """A server that knows of no campaign; to be named before `visit`, which leaves first then."""
    opened = open_store(f"sqlite:///{tmp_path / 'bare.db'}")
    with serving(opened) as url:
        yield url
    opened.close()


@pytest.fixture(scope="module")
def browser():
    """Chromium; not for the session, since Playwright's event loop runs for as long as it does."""
    if CHROMIUM is None:
        pytest.skip("no chromium")
    with sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield launched
        launched.close()


REPORT_VIOLATIONS = (
    "document.addEventListener('securitypolicyviolation',"
    " (event) => console.error('CSP ' + event.violatedDirective + ' ' + event.blockedURI))"
)
ANSWERS_WITH_A_PROBLEM = "Failed to load resource"


@pytest.fixture(scope="module")
def watch():
    """Notes what a page should not do, in a list, other than what its console may say."""

    def note(page, troubles, tolerated=(ANSWERS_WITH_A_PROBLEM,)):
        def note_console(message):
            expected = any(words in message.text for words in tolerated)
            if message.type in {"error", "warning"} and not expected:
                troubles.append(f"console: {message.text}")

        def note_request(request):
            if not request.url.startswith(("http://127.0.0.1:", "data:", "blob:", "file:")):
                troubles.append(f"off-host: {request.url}")

        page.add_init_script(REPORT_VIOLATIONS)
        page.on("console", note_console)
        page.on("pageerror", lambda error: troubles.append(f"error: {error}"))
        page.on("request", note_request)

    return note


@pytest.fixture(scope="module")
def troubles():
    """What the one tab of a module did that it should not do."""
    return []


@pytest.fixture
def visit(browser, address, watch):
    """Opens pages; what they should not do fails the test when it ends."""
    contexts, troubles, tolerated = [], [], [ANSWERS_WITH_A_PROBLEM]

    def go(path, server=address, status=200, **options):
        context = browser.new_context(**{"viewport": {"width": 1280, "height": 900}, **options})
        contexts.append(context)
        context.set_default_timeout(PATIENCE_MS)
        page = context.new_page()
        watch(page, troubles, tolerated)
        response = page.goto(server + path)
        assert response.status == status
        return page

    go.tolerate = tolerated.append
    yield go
    for context in contexts:
        context.close()
    assert not troubles


@pytest.fixture
def queue(store, address):
    """Queues a campaign; its id."""
    return lambda name: store.campaigns.create(accept_spec(spec(name, "ast"))).id


@pytest.fixture
def bring(store):
    """Commits results of episodes that collide with the given probability."""
    return lambda campaign, indices, share: deliver(
        store, campaign, [result_of(index, share, campaign) for index in indices]
    )


@pytest.fixture
def replayed(store):
    """Has a campaign replay all of its episodes, of which every second one fails again."""
    return lambda campaign: replay(store, campaign)
