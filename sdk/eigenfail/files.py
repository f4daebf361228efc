"""Files that a user names: read within bounds, and written completely or for their owner only."""

import csv
import errno
import io
import os
import re
import shutil
import stat
import tomllib
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from math import isfinite, nan
from pathlib import Path
from tempfile import mkdtemp
from typing import IO, Any, BinaryIO, NamedTuple

from eigenfail.errors import InvalidValue, ServiceError, suggest_name

OWNER_ONLY = 0o600


FOLDER_MODE = 0o700


OTHERS = 0o007

MOST_BYTES = 10_000_000
"""Longest text file that is read whole: settings, campaigns, keys."""

LONGEST_LINE = 1_000_000
MOST_TABLE_BYTES = 2_000_000_000
MOST_ROWS = 2_000_000
"""Largest table that is read. Its numbers alone take 16 MB a column."""

DELIMITERS = (",", ";", "\t", "|", " ")

METRIC = ("", "m", "cm", "mm", "km", "rad", "radians", "mps", "ms", "kmh", "kmph", "kph")
OTHER_UNITS = frozenset(
    (*METRIC, "ft", "feet", "in", "mph", "fps", "kn", "deg", "degree", "degrees")
)
"""Ends of names of columns after that of a quantity, without signs."""

MOST_EDITS, SHORTEST_MISSPELT = 2, 4
"""Longer names that are so far from that of a column at most are misspelt."""


def make_private_folder(folder: Path) -> None:
    """Make a folder and its missing parents, accessible to their owner only.

    An existing folder keeps its permissions.

    Raises:
        OSError: it cannot be made.
    """
    if folder.is_dir():
        return
    if folder.parent != folder:
        make_private_folder(folder.parent)
    folder.mkdir(FOLDER_MODE, exist_ok=True)


def open_private(path: Path, mode: str) -> IO[bytes]:
    """Open a file to write bytes to it; a new file is accessible to its owner only.

    An existing file keeps its permissions.

    Args:
        path: path of the file.
        mode: binary mode of `open`: ab, wb or xb.

    Raises:
        OSError: it cannot be opened.
    """
    return open(path, mode, opener=partial(os.open, mode=OWNER_ONLY))


def write_whole(path: Path, chunks: Iterable[bytes]) -> None:
    """Write a file under a temporary name and move it into place once it is complete.

    Raises:
        ServiceError: it cannot be written.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        try:
            with open_private(part, "wb") as file:
                file.writelines(chunks)
            part.replace(path)
        finally:
            with suppress(OSError):
                part.unlink(missing_ok=True)
    except OSError as error:
        problem = f"{path} cannot be written: {error.strerror or error}."
        raise ServiceError(problem, "Choose a file in a writable folder.") from error


def check_output_folder(
    folder: Path, kind: str, own_names: re.Pattern[str], *, force: bool
) -> None:
    """Refuse to write over a folder, unless force is given and all files in it are of one kind.

    Args:
        folder: folder that may exist.
        kind: kind of output, for errors: a "report".
        own_names: pattern of the paths of such files within the folder.
        force: whether files of that kind may be replaced.

    Raises:
        InvalidValue: the folder has a file that must not be replaced.
    """
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return
    foreign = "" if folder.is_dir() else "it is not a folder"
    for path in folder.rglob("*"):
        name = path.relative_to(folder).as_posix()
        if not path.is_dir() and not own_names.fullmatch(name):
            foreign = name
            break
    if foreign:
        problem = f"{folder} already exists and contains files of no {kind}: {foreign}."
        raise InvalidValue("output", problem, "Choose a folder that does not exist.")
    if not force:
        problem = f"{folder} already contains a {kind}."
        remedy = "Choose another folder, or give force=True (on the command line --force)."
        raise InvalidValue("output", problem, remedy)


def write_folder(files: Mapping[str, bytes], folder: Path) -> None:
    """Write files by their paths within a folder: either all of them, or the folder is unchanged.

    Raises:
        ServiceError: they cannot be written.
    """
    try:
        with replace_whole(folder) as made:
            for name, content in files.items():
                (made / name).parent.mkdir(parents=True, exist_ok=True)
                (made / name).write_bytes(content)
    except OSError as error:
        problem = f"{folder} cannot be written: {error.strerror or error}."
        raise ServiceError(problem, "Choose a folder that you can write to.") from error


@contextmanager
def replace_whole(place: Path) -> Iterator[Path]:
    """Yield a temporary path; a file or folder made there is moved to `place` at the end.

    Previous contents of `place` are removed, or kept if anything fails.

    Raises:
        OSError: it cannot be moved there.
    """
    place = place.absolute()
    place.parent.mkdir(parents=True, exist_ok=True)
    # Beside the place, since nothing is renamed from one file system to another.
    beside = Path(mkdtemp(prefix=f".{place.name}-", dir=place.parent))
    made, old = beside / "made", beside / "old"
    try:
        yield made
        if place.exists():
            place.rename(old)
        try:
            made.rename(place)
        except OSError:
            if old.exists():
                old.rename(place)
            raise
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def write_private(path: Path, text: str, field: str) -> None:
    """Make a file with one line that only its owner can read; an existing file is not replaced.

    Raises:
        InvalidValue: it exists already, or cannot be written.
    """
    with _written(path, field):
        descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, OWNER_ONLY)
        with os.fdopen(descriptor, "w") as file:
            file.write(f"{text}\n")


def write_new(path: Path, text: str, field: str) -> None:
    """Make a text file; an existing file is not replaced.

    Raises:
        InvalidValue: it exists already, or cannot be written.
    """
    with _written(path, field), path.open("x", encoding="utf-8") as file:
        file.write(text)


def replace_private(path: Path, text: str, field: str) -> None:
    """Make a file with one line that only its owner can read; replace an existing file whole.

    Raises:
        InvalidValue: it cannot be written.
    """
    draft = path.with_name(f".{path.name}.new")
    with _written(path, field):
        draft.unlink(missing_ok=True)
        write_private(draft, text, field)
        draft.replace(path)


@contextmanager
def _written(path: Path, field: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        problem = f"'{path}' cannot be written: {error.strerror}."
        raise InvalidValue(field, problem, "Choose another file, or remove this one.") from error


OPEN_FILES = ("/dev/stdin", "/dev/fd/", "/proc/self/fd/")
"""Begin of the paths of files that this process has open."""


def open_regular(path: Path, most_bytes: int) -> BinaryIO:
    """Open a regular file to read bytes, or a pipe that this process was started with.

    Devices and named pipes are refused: devices do not end, and opening a named pipe waits for a
    writer. The pipes of `<(…)` and of standard input were already opened by the shell.

    Args:
        path: path of the file.
        most_bytes: largest accepted size.

    Raises:
        OSError: it cannot be opened, is another kind of file, or is larger.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    if stat.S_ISFIFO(os.fstat(descriptor).st_mode) and str(path).startswith(OPEN_FILES):
        os.set_blocking(descriptor, True)
        return os.fdopen(descriptor, "rb")
    if fault := _find_fault(os.fstat(descriptor), most_bytes):
        os.close(descriptor)
        raise fault
    return os.fdopen(descriptor, "rb")


def _find_fault(found: os.stat_result, most_bytes: int) -> OSError | None:
    if stat.S_ISDIR(found.st_mode):
        return IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(found.st_mode):
        return OSError(errno.EINVAL, "it is a device or a pipe, and not a regular file")
    if found.st_size > most_bytes:
        problem = f"it has {found.st_size:,} bytes, and at most {most_bytes:,} are read"
        return OSError(errno.EFBIG, problem)
    return None


def read_whole(path: Path, most_bytes: int = MOST_BYTES) -> bytes:
    """Return the bytes of a regular file.

    Raises:
        OSError: it cannot be read, is not a regular file, or has more bytes.
    """
    with open_regular(path, most_bytes) as file:
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise OSError(errno.EFBIG, f"it has more than {most_bytes:,} bytes")
    return content


def read_private(path: Path, field: str) -> str:
    """Return the line in a private file.

    Raises:
        InvalidValue: it cannot be read, or every user of the machine can read it.
    """
    try:
        with open_regular(path, MOST_BYTES) as file:
            mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
            text = file.read(MOST_BYTES).decode().strip()
    except (OSError, UnicodeDecodeError) as error:
        problem = f"'{path}' cannot be read: {getattr(error, 'strerror', 'it is not a text file')}."
        raise InvalidValue(field, problem, "Specify the file that contains the key.") from error
    if mode & OTHERS:
        problem = f"other users of this machine can access '{path}' (mode {mode:o})."
        raise InvalidValue(field, problem, f"Run: chmod 600 {path}; if others had it, revoke it.")
    return text


def read_toml(file: Path, like: str) -> dict[str, Any]:
    """Return the table in a TOML file.

    Args:
        file: path of the file.
        like: description of a valid file: the remedy of every error.

    Raises:
        InvalidValue: it cannot be read, or is not TOML.
    """
    try:
        text = read_whole(file).decode("utf-8-sig")
    except OSError as error:
        raise InvalidValue(str(file), f"cannot be read: {error.strerror}.", like) from error
    except ValueError as error:
        raise InvalidValue(str(file), f"is not TOML: {error}.", like) from error
    return parse_toml(text, str(file), like)


def parse_toml(text: str, field: str, like: str) -> dict[str, Any]:
    """Return the table in a TOML text.

    Args:
        text: TOML.
        field: name of the text, for the error.
        like: description of a valid text: the remedy of the error.

    Raises:
        InvalidValue: it is not TOML.
    """
    try:
        return tomllib.loads(text)
    # tomllib gives up on deep nesting and on endless integers in errors of its own.
    except (ValueError, RecursionError) as error:
        raise InvalidValue(field, f"is not TOML: {error}.", like) from error


class TableColumns(NamedTuple):
    """Columns that a table may have. All except the column of text are numbers.

    Attributes:
        text: the only column of text, which is required; empty if the table does not need one.
        required: columns that the table must have.
        optional: columns that the table may have.
        like: description of a valid table: the remedy of every error.
        most_rows: largest permitted number of rows.
    """

    text: str
    required: tuple[str, ...]
    optional: tuple[str, ...]
    like: str
    most_rows: int = MOST_ROWS


class DataTable(NamedTuple):
    """The used columns of a table.

    Attributes:
        rows: number of each row in its file: the line in CSV, counted from 1 in Parquet. Shape
            (n,).
        texts: distinct values of the column of text, in the order of their first rows.
        text: index in `texts` of each row's value, shape (n,).
        numbers: each column of numbers by name, NaN for an empty cell, shape (n,).
        unread: names of the unused columns, as in the file.
    """

    rows: "array[int]"
    texts: tuple[str, ...]
    text: "array[int]"
    numbers: "Mapping[str, array[float]]"
    unread: tuple[str, ...]


Cells = Iterable[tuple[int, Sequence[object]]]
"""Rows of a table: the number of each, and its cells."""


def read_table(path: Path, columns: TableColumns, field: str = "") -> DataTable:
    """Read the columns of a CSV table, or of a Parquet table if the name ends in `.parquet`.

    Column names may be in capitals and may have blanks around them. CSV cells may be separated by
    commas, semicolons, tabs, bars or blanks; the header determines the separator.

    Args:
        path: path of the file.
        columns: columns to use.
        field: option or field that named the file, for errors; empty for the file's name.

    Raises:
        InvalidValue: the file cannot be read or is too large; a column is missing, or has nearly
            the name of an optional column; or a cell is not a number.
    """
    field = field or path.name
    is_parquet = path.suffix.lower() == ".parquet"
    try:
        with open_regular(path, MOST_TABLE_BYTES) as file:
            if is_parquet:
                return _read_parquet(file, columns, field)
            text = io.TextIOWrapper(file, encoding="utf-8-sig", newline="")
            return _read_csv(text, columns, field)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise InvalidValue(field, f"cannot be read: {why}.", columns.like) from error


def _read_csv(file: IO[str], columns: TableColumns, field: str) -> DataTable:
    header, lines = "", _list_lines(file)
    for header in lines:
        if header.strip():
            break
    delimiter = _find_delimiter(header, columns)
    names = next(csv.reader([header], delimiter=delimiter, skipinitialspace=True), [])
    table = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)

    def list_cells(_places: Sequence[int]) -> Cells:
        for cells in table:
            if not any(map(str.strip, cells)):
                continue
            number = table.line_num + 1
            # Blanks may stand for an empty cell, and the cells after it would move to its place.
            is_moved = delimiter == " " and _count_cells(cells) != _count_cells(names)
            if is_moved or any(map(str.strip, cells[len(names) :])):
                problem = f"has {_count_cells(cells)} cells, and the header {_count_cells(names)}."
                remedy = "Write numbers with a point, and quote texts with a separator in them."
                if is_moved:
                    remedy = "Separate cells by commas where some are empty or contain blanks."
                raise InvalidValue(f"{field}, row {number}", problem, remedy)
            yield number, cells

    return _collect(names, list_cells, columns, field)


def _count_cells(cells: Sequence[str]) -> int:
    """Return the number of cells in a row, without empty cells from blanks at its end."""
    count = len(cells)
    while count and not cells[count - 1].strip():
        count -= 1
    return count


def _list_lines(file: IO[str]) -> Iterator[str]:
    while line := file.readline(LONGEST_LINE):
        if len(line) == LONGEST_LINE:
            raise OSError(errno.EFBIG, f"a line has more than {LONGEST_LINE:,} characters")
        yield line


def _find_delimiter(header: str, columns: TableColumns) -> str:
    """Return the delimiter of a header: the one that yields the most names of used columns."""
    wanted = set(map(_simplify_name, (columns.text, *columns.required, *columns.optional)))

    def count_known(delimiter: str) -> int:
        names = next(csv.reader([header], delimiter=delimiter, skipinitialspace=True), [])
        return len(wanted & set(map(_simplify_name, names)))

    return max(DELIMITERS, key=count_known)


def _read_parquet(file: BinaryIO, columns: TableColumns, field: str) -> DataTable:
    try:
        from pyarrow import ArrowException
        from pyarrow.parquet import ParquetFile
    except ModuleNotFoundError as error:
        remedy = "Install eigenfail[export], or give CSV."
        raise InvalidValue(field, "Parquet needs pyarrow.", remedy) from error
    try:
        table = ParquetFile(file)
        # A file of few bytes may hold any number of equal rows.
        if table.metadata.num_rows > columns.most_rows:
            raise _refuse_length(field, columns)
        names = table.schema_arrow.names

        def list_cells(places: Sequence[int]) -> Cells:
            number = 0
            used = [names[place] for place in places]
            for batch in table.iter_batches(10_000, columns=used):
                found: list[list[object]] = [[None] * batch.num_rows for _ in names]
                for place, name in zip(places, used, strict=True):
                    found[place] = batch.column(name).to_pylist()
                for cells in zip(*found, strict=True):
                    number += 1
                    yield number, cells

        return _collect(names, list_cells, columns, field)
    except ArrowException as error:
        raise InvalidValue(field, f"cannot be read: {error}.", columns.like) from error


def _simplify_name(name: str) -> str:
    return name.strip().lower()


def _refuse_length(field: str, columns: TableColumns) -> InvalidValue:
    problem = f"has more than {columns.most_rows:,} rows, the most that are read."
    return InvalidValue(field, problem, "Take the part of it that you need.")


def _collect(
    names: Sequence[str],
    list_cells: Callable[[Sequence[int]], Cells],
    columns: TableColumns,
    field: str,
) -> DataTable:
    """Return the used columns.

    Args:
        names: names of the columns in the file.
        list_cells: returns the rows, given the positions of the used columns.
        columns: columns to use.
        field: option or field that named the file, for errors.
    """
    places = _place_columns(names, columns, field)
    numbers = {name: array("d") for name in places if name != columns.text}
    rows, text, texts = array("q"), array("q"), dict[str, int]()
    for number, cells in list_cells(list(places.values())):
        if len(rows) == columns.most_rows:
            raise _refuse_length(field, columns)
        rows.append(number)
        for name, values in numbers.items():
            place = places[name]
            cell = cells[place] if place < len(cells) else None
            value = _read_cell(cell)
            if value is None:
                raise _refuse_cell(f"{field}, row {number}: {name}", str(cell))
            values.append(value)
        if columns.text:
            cell = cells[places[columns.text]] if places[columns.text] < len(cells) else None
            named = "" if _is_empty(cell) else str(cell).strip()
            if not named:
                raise InvalidValue(
                    f"{field}, row {number}: {columns.text}", "is empty.", "Name the vehicle."
                )
            text.append(texts.setdefault(named, len(texts)))
    used = {names[place] for place in places.values()}
    return DataTable(
        rows=rows,
        texts=tuple(texts),
        text=text,
        numbers=numbers,
        unread=tuple(name for name in names if name not in used and name.strip()),
    )


def _place_columns(names: Sequence[str], columns: TableColumns, field: str) -> dict[str, int]:
    """Return the position of each used column.

    Raises:
        InvalidValue: a column is missing, exists twice, or has nearly the name of a missing
            optional column.
    """
    simple = list(map(_simplify_name, names))
    required = (*([columns.text] if columns.text else []), *columns.required)
    known = (*required, *columns.optional)
    found = {name: _find_places(name, names) for name in known}
    if missing := [name for name in required if not found[name]]:
        given = f"its columns are {', '.join(names)}" if names else "it has none"
        if names and all(_read_cell(name) is not None for name in names):
            given = f"its first line has numbers, and not names of columns: {', '.join(names)}"
        others = [name for name in names if _simplify_name(name) not in known]
        near = _suggest_column(missing[0], others)
        lacking = f"columns {', '.join(missing)} are" if missing[1:] else f"column {missing[0]} is"
        problem = f"{lacking} missing; {given}."
        raise InvalidValue(field, problem, f"{near}{columns.like}")
    for name, places in found.items():
        if len(places) > 1:
            raise InvalidValue(field, f"has two columns {name}.", "Remove or rename one of them.")
    absent = [name for name in columns.optional if not found[name]]
    for name, given in zip(simple, names, strict=True):
        close = next((each for each in absent if _is_meant(name, each)), None)
        if name not in known and close is not None:
            problem = f"column {given} is not read, and column {close} is missing."
            remedy = f"Rename it to {close} if it has that unit; otherwise convert or remove it."
            raise InvalidValue(field, problem, remedy)
    return {name: places[0] for name, places in found.items() if places}


def _suggest_column(missing: str, others: Sequence[str]) -> str:
    """Return a hint at a misnamed column for a missing one, after a blank; empty without one."""
    # A column that a user names himself, without a unit, is misspelt rather than converted.
    has_unit = "_" in missing
    if has_unit and (meant := [name for name in others if _is_in_other_unit(name, missing)]):
        return f"Convert {meant[0]}, if it is in another unit, and name it {missing}. "
    return suggest_name(missing, others).partition("Known:")[0] if others else ""


def _is_meant(name: str, column: str) -> bool:
    """Return whether a name means a column: without its unit, with another unit, or misspelt."""
    if _is_in_other_unit(name, column):
        return True
    return len(column) > SHORTEST_MISSPELT and _is_misspelt(name.strip(), column)


def _is_in_other_unit(name: str, column: str) -> bool:
    """Return whether a name equals a column's name without its unit, or with another unit."""
    quantity = _squash(column.rpartition("_")[0] or column)
    squashed = _squash(name)
    unit = squashed.removeprefix(quantity)
    return squashed.startswith(quantity) and unit in OTHER_UNITS


def _squash(name: str) -> str:
    return "".join(filter(str.isalnum, name.lower()))


def _is_misspelt(name: str, column: str) -> bool:
    """Return whether two names are at most `MOST_EDITS` insertions, removals or changes apart."""
    if abs(len(name) - len(column)) > MOST_EDITS:
        return False
    costs = list(range(len(column) + 1))
    for number, letter in enumerate(name, 1):
        before, costs = costs, [number]
        for place, other in enumerate(column):
            change = before[place] + (letter != other)
            costs.append(min(change, before[place + 1] + 1, costs[place] + 1))
    return costs[-1] <= MOST_EDITS


def _find_places(name: str, names: Sequence[str]) -> list[int]:
    """Return the positions of columns with a name; ignore case only if none matches exactly."""
    exact = [place for place, given in enumerate(names) if given.strip() == name]
    simple = _simplify_name(name)
    return exact or [place for place, given in enumerate(names) if _simplify_name(given) == simple]


def _is_empty(cell: object) -> bool:
    return cell is None or cell != cell or (isinstance(cell, str) and not cell.strip())  # noqa: PLR0124 - NaN is an empty value of Parquet


def _read_cell(cell: Any) -> float | None:
    """Return a finite number, NaN for an empty cell, and None for anything else."""
    try:
        value = float(cell)
    except (TypeError, ValueError):
        return nan if _is_empty(cell) else None
    if isfinite(value):
        return value
    return nan if _is_empty(cell) else None


def _refuse_cell(place: str, cell: str) -> InvalidValue:
    remedy = "Correct it, or leave out the row: an empty field will do only in optional columns."
    if cell.count(",") == 1 and _read_cell(cell.replace(",", ".")) is not None:
        remedy = "Write it with a point in the place of the comma."
    return InvalidValue(place, f"'{cell}' is not a finite number.", remedy)
