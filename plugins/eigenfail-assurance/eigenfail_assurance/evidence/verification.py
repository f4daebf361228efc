"""Verification of a bundle without a service: hashes, numbers, and replays of a sample.

Every file is compared with its hash in the manifest, the manifest with its own. The numbers of all
solutions, the graph and the report are made again from the records and compared. A sample of
episodes is run again from seeds or recorded noise, and its digests are compared.
"""

from collections.abc import Mapping
from pathlib import Path

import msgspec
from msgspec.structs import replace

from eigenfail.errors import InvalidValue, describe_error
from eigenfail_assurance.evidence.bundle import FORMAT, MANIFEST, Manifest
from eigenfail_assurance.evidence.recomputation import compare_contents, read_records
from eigenfail_assurance.evidence.records import decode_file, encode_canonical, hash_bytes
from eigenfail_assurance.evidence.sampled_replays import choose_episodes, replay_episodes
from eigenfail_assurance.evidence.solutions import INPUTS
from eigenfail_assurance.evidence.storage import BundleDefect, make_defect, read_bundle


class EvidenceCheck(msgspec.Struct, frozen=True, kw_only=True):
    """The findings of the verification of a bundle.

    Attributes:
        root_hash: root hash of the bundle, as its manifest states it.
        verdict: of the top claim, as the manifest states it.
        files: number of files that were compared with their hashes.
        solutions: number of solutions whose numbers were computed again.
        episodes: number of episodes in the bundle.
        replayed: number of episodes that were run again.
        defects: parts that differ from the original bundle; empty for a verified bundle.
        notes: parts that were not checked, and why, in sentences.
    """

    root_hash: str
    verdict: str
    files: int
    solutions: int = 0
    episodes: int = 0
    replayed: int = 0
    defects: tuple[BundleDefect, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def is_verified(self) -> bool:
        """True if the bundle has no defects."""
        return not self.defects


NO_MANIFEST = Manifest(format="", eigenfail="", name="", verdict="", files=())

NOT_COMPUTED = "Numbers were not computed again, as files do not have their hashes."
NOT_REPLAYED = "No episode was run again; --replay N does that."
NO_ROOT_HASH = (
    "No root hash was given: whoever can change all files of the bundle can compute its hashes "
    "again. Give --root-hash with the one that was printed when the bundle was made."
)


def verify_bundle(
    path: Path | str, root_hash: str = "", replay: int = 0, seed: int | None = None
) -> EvidenceCheck:
    """Return the defects of a bundle.

    Args:
        path: a folder or a ZIP archive.
        root_hash: root hash that came another way; empty if there is none.
        replay: number of episodes to run again.
        seed: of their choice; None takes one that follows from the root hash.

    Raises:
        InvalidValue: the path holds no bundle, or another release wrote it in another format.
        ServiceError: episodes are to be run again, and none can be run here.
    """
    stored = read_bundle(Path(path))
    if stored.defects:
        defects, notes = stored.defects, (NOT_COMPUTED,)
        return EvidenceCheck(root_hash="", verdict="", files=0, defects=defects, notes=notes)
    manifest, checked = _check_hashes(stored.files, root_hash)
    if checked.defects:
        return replace(checked, notes=(*checked.notes, NOT_COMPUTED))
    checked = _recompute(checked, manifest, stored.files)
    if checked.defects or not replay:
        return replace(checked, notes=(*checked.notes, NOT_REPLAYED))
    return _replay(
        checked, stored.files, replay, int(checked.root_hash, 16) if seed is None else seed
    )


def _check_hashes(files: Mapping[str, bytes], root_hash: str) -> tuple[Manifest, EvidenceCheck]:
    """Return the manifest, and the defects of it and of the hashes of files."""
    if MANIFEST not in files:
        defect = BundleDefect(where=MANIFEST, problem="It is missing.")
        return NO_MANIFEST, EvidenceCheck(root_hash="", verdict="", files=0, defects=(defect,))
    manifest, defects = _read_manifest(files[MANIFEST], root_hash)
    if manifest is not NO_MANIFEST:
        defects += compare_hashes(manifest, files)
    checked = EvidenceCheck(
        root_hash=manifest.sha256,
        verdict=manifest.verdict,
        files=len(files),
        defects=tuple(defects),
        notes=() if root_hash else (NO_ROOT_HASH,),
    )
    return manifest, checked


def _replay(
    checked: EvidenceCheck, files: Mapping[str, bytes], count: int, seed: int
) -> EvidenceCheck:
    """Return a check of hashes and numbers, with the check of replays added."""
    campaigns = read_records(files).records.campaigns
    found = replay_episodes(campaigns, choose_episodes(campaigns, count, seed))
    return replace(
        checked,
        replayed=found.replayed,
        defects=found.defects,
        notes=(*checked.notes, *found.notes),
    )


def _recompute(
    checked: EvidenceCheck, manifest: Manifest, files: Mapping[str, bytes]
) -> EvidenceCheck:
    """Return a check of hashes, with the check of numbers added."""
    try:
        read = read_records(files)
        found = compare_contents(manifest, files, read)
    except InvalidValue as error:
        return replace(checked, defects=(make_defect(error),))
    except (ArithmeticError, LookupError, ValueError) as error:
        # Records that fit their types may still contradict one another, or hold numbers of which
        # none can be computed: no campaign that was run is like that.
        problem = f"The records do not fit together: {describe_error(error)}."
        return replace(checked, defects=(BundleDefect(where=INPUTS, problem=problem),))
    return replace(
        checked,
        solutions=len(read.records.inputs),
        episodes=sum(each.table.count(b"\n") - 1 for each in read.records.campaigns.values()),
        defects=found.defects,
        notes=(*checked.notes, *found.notes),
    )


def _read_manifest(content: bytes, root_hash: str) -> tuple[Manifest, list[BundleDefect]]:
    """Return the manifest, and its defects.

    Raises:
        InvalidValue: it is of another format.
    """
    try:
        manifest = decode_file(content, Manifest, MANIFEST)
    except InvalidValue as error:
        return NO_MANIFEST, [make_defect(error)]
    if manifest.sha256 == manifest.find_hash() and manifest.format != FORMAT:
        problem = f"the format is '{manifest.format}', not '{FORMAT}'."
        raise InvalidValue(MANIFEST, problem, "Use the release that wrote it.")
    found = []
    if manifest.sha256 != manifest.find_hash():
        problem = "It is not that of the other fields."
        found.append(BundleDefect(where=f"{MANIFEST}: sha256", problem=problem))
    if content != encode_canonical(manifest):
        problem = "It is not written as eigenfail writes it."
        found.append(BundleDefect(where=MANIFEST, problem=problem))
    if root_hash and root_hash.lower() != manifest.sha256:
        problem = f"The root hash is {manifest.sha256}, not the one that was given."
        found.append(BundleDefect(where=f"{MANIFEST}: sha256", problem=problem))
    return manifest, found


def compare_hashes(manifest: Manifest, files: Mapping[str, bytes]) -> list[BundleDefect]:
    """Return the files that are missing, not in the manifest, or of another hash or size."""
    entries = {each.path: each for each in manifest.files}
    found = []
    for name in sorted((entries.keys() | files.keys()) - {MANIFEST}):
        if name not in files:
            found.append(BundleDefect(where=name, problem="It is missing."))
        elif name not in entries:
            found.append(BundleDefect(where=name, problem="It is not in the manifest."))
        elif entries[name].sha256 != hash_bytes(files[name]):
            problem = "Its SHA-256 is not the one in the manifest."
            found.append(BundleDefect(where=name, problem=problem))
        elif entries[name].size != len(files[name]):
            problem = "Its size is not the one in the manifest."
            found.append(BundleDefect(where=name, problem=problem))
    return found
