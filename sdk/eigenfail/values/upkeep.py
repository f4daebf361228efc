"""What came of a database's check, its backup and its restoration."""

import msgspec


class Defect(msgspec.Struct, frozen=True):
    """One thing that is wrong.

    Attributes:
        where: campaign, episode, job or page.
        found: what is there, and what should be.
        remedy: what to do next.
    """

    where: str
    found: str
    remedy: str


class Check(msgspec.Struct, frozen=True):
    """One question to a database.

    Attributes:
        promise: what holds if there is no defect.
        defects: how many there are.
        shown: the first of them.
    """

    name: str
    promise: str
    defects: int
    shown: tuple[Defect, ...]


class Verification(msgspec.Struct, frozen=True):
    """A database, held against what is promised of it.

    Attributes:
        database: its address, without secrets.
        mended: what was put right before these checks, one sentence each.
    """

    database: str
    checks: tuple[Check, ...]
    mended: tuple[str, ...] = ()

    @property
    def defects(self) -> int:
        """How many there are in all."""
        return sum(check.defects for check in self.checks)


class Backup(msgspec.Struct, frozen=True):
    """A file with all that is in a database, or a database with all that is in a file.

    Attributes:
        bytes: size of the file.
        revision: of the schema in it.
    """

    database: str
    file: str
    bytes: int
    revision: str
