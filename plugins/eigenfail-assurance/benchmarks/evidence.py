"""Figures: how many changed bytes `eigenfail evidence verify` finds in a bundle.

A bundle is made of two campaigns that are run for it: a bound of P(failure) and a count, beside a
claim that nothing supports. A change is another value of a random byte of a random file.
`evidence.tampering_found` is the share of changes that are found. `evidence.rehashed_found` is the
share that is found where the manifest is computed again after the change, so that all of its hashes
fit: what other hashes and the numbers of the bundle show. `evidence.intact_found` is the number of
defects reported in unchanged bundles.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import Figure
from benchmarks.samples import COMMAND, share
from benchmarks.targets import Target

from eigenfail import __version__, plugins
from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeTask, PriorSource, episode_seed
from eigenfail_assurance.evidence import records
from eigenfail_assurance.evidence.bundle import MANIFEST, EvidenceBundle, make_bundle, make_manifest
from eigenfail_assurance.evidence.question import (
    Claim,
    EvidenceQuestion,
    ProbabilitySolution,
    SearchSolution,
)
from eigenfail_assurance.evidence.storage import write_bundle
from eigenfail_assurance.evidence.verification import verify_bundle

CHANGES = 1_000
EPISODES = 200


def find_tampering(_crew: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """How often a changed byte is found, with the hashes of before and with new ones."""
    bundle = make_example_bundle(seed)
    generator = np.random.default_rng(seed)
    with TemporaryDirectory() as folder:
        place = Path(folder) / "bundle"
        write_bundle(bundle.files, place)
        intact = verify_bundle(place, bundle.manifest.sha256, replay=EPISODES)
        changes = [_change_byte(place, bundle.files, generator) for _ in range(CHANGES)]
        rehashed = [_change_and_rehash(place, bundle, generator) for _ in range(CHANGES)]
    note = f"a random byte of a random one of {len(bundle.files)} files"
    yield "evidence.tampering_found", share(changes, note)
    yield "evidence.rehashed_found", share(rehashed, f"{note}; hashes of the manifest made again")
    yield (
        "evidence.intact_found",
        Figure(
            value=float(len(intact.defects)),
            unit="defects",
            n=intact.replayed,
            note="a bundle as it was written, with replays",
            command=COMMAND,
        ),
    )


def make_example_bundle(seed: int) -> EvidenceBundle:
    """Return a bundle of two campaigns that are run for it."""
    claims = (
        Claim(
            text="A failure is rare.",
            argument="By a random sample.",
            solutions=(ProbabilitySolution(campaigns=(1,), at_most=0.5),),
        ),
        Claim(text="Few failures are met.", solutions=(SearchSolution(campaigns=(2,)),)),
        Claim(text="Nothing supports this."),
    )
    claim = Claim(text="The planner is safe.", argument="Over three claims.", claims=claims)
    question = EvidenceQuestion(name="Example", claim=claim)
    campaigns = {number: _run_campaign(number, seed + number) for number in (1, 2)}
    inputs = tuple(records.SolutionInput(campaigns=((number,),)) for number in (1, 2))
    return make_bundle(question, records.EvidenceRecords(campaigns, inputs), __version__)


def _run_campaign(number: int, seed: int) -> records.CampaignRecord:
    spec = CampaignSpec(
        name=f"example {number}",
        method="monte_carlo",
        episodes=EPISODES,
        seed=seed,
        planner="idm",
        simulator="point_mass",
    )
    engine = plugins.load(plugins.ENGINES, "default")(spec.setup())
    tasks = [
        EpisodeTask(index, episode_seed(seed, index), PriorSource()) for index in range(EPISODES)
    ]
    results = sorted(engine.run(tasks), key=lambda each: each.index)
    engine.close()
    rows = [",".join(records.COLUMNS)]
    for each in results:
        severity = each.measures.severity if each.measures else None
        robustness = each.measures.robustness_m if each.measures else ""
        rows.append(
            f"{each.index},{each.seed},{each.source},{each.outcome.word},{each.steps},"
            f"{robustness},{'' if severity is None else severity},{each.digest()}"
        )
    table = ("\r\n".join(rows) + "\r\n").encode()
    failures = sum(each.is_failure for each in results)
    campaign = Campaign(
        id=number,
        spec=spec,
        state=CampaignState.DONE,
        counts=Counts(planned=EPISODES, completed=EPISODES, failures=failures),
        created_ms=0,
        digest=records.hash_episodes(records.read_episodes(table, "example")),
    )
    return records.CampaignRecord(facts=records.CampaignFacts(campaign=campaign), table=table)


def _draw_change(
    files: Mapping[str, bytes], generator: np.random.Generator, *, manifest: bool
) -> tuple[str, bytes]:
    """Return a random file, with another value of a random byte."""
    names = sorted(files) if manifest else sorted(files.keys() - {MANIFEST})
    name = names[generator.integers(len(names))]
    content = bytearray(files[name])
    content[generator.integers(len(content))] ^= int(generator.integers(1, 256))
    return name, bytes(content)


def _change_byte(place: Path, files: Mapping[str, bytes], generator: np.random.Generator) -> bool:
    """Return whether a change is found by its file; the bundle is then as before."""
    name, content = _draw_change(files, generator, manifest=True)
    (place / name).write_bytes(content)
    checked = verify_bundle(place)
    (place / name).write_bytes(files[name])
    return any(each.where.startswith(name) for each in checked.defects)


def _change_and_rehash(place: Path, bundle: EvidenceBundle, generator: np.random.Generator) -> bool:
    """Return whether a change is found though all hashes of the manifest fit."""
    name, content = _draw_change(bundle.files, generator, manifest=False)
    changed = {each: file for each, file in bundle.files.items() if each != MANIFEST}
    changed[name] = content
    forged = make_manifest(bundle.graph, changed, __version__)
    (place / name).write_bytes(content)
    (place / MANIFEST).write_bytes(records.encode_canonical(forged))
    checked = verify_bundle(place)
    (place / name).write_bytes(bundle.files[name])
    (place / MANIFEST).write_bytes(bundle.files[MANIFEST])
    return not checked.is_verified


TRIALS = ((("evidence.",), find_tampering),)
TARGETS = {
    "evidence.tampering_found": Target(low=1.0),
    "evidence.intact_found": Target(high=0.0),
}
