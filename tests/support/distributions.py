"""Distributions as pip leaves them behind: their entry points are found where they lie."""

from pathlib import Path


def write_record(folder: Path, name: str, points: str, version: str = "1.0") -> Path:
    """Write what tells of a distribution and its entry points, and return its place."""
    record = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    record.mkdir(parents=True)
    about = f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"
    (record / "METADATA").write_text(about)
    (record / "entry_points.txt").write_text(points)
    return record
