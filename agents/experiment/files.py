"""Files that are complete or not there at all: text, YAML, JSON and CSV, each put in its place in one move."""

import csv
import io
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray


def write_safely(path: Path, write: Callable[[IO[bytes]], object]) -> None:
    """Put a file in its place in one move: a crash at any moment leaves the old one or the new one whole.

    Raises:
        OSError: naming the file, if it could not be written; the old one is intact then.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with failures_name(path):
            with temporary.open("wb") as file:
                write(file)
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(path)
            _sync_folder(path.parent)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def failures_name(path: Path) -> Iterator[None]:
    """While entered, an OSError says which file could not be written, and that no harm was done."""
    try:
        yield
    except OSError as error:
        reason = f"{path} could not be written: {error.strerror or error}; what was saved before is intact"
        raise OSError(reason) from error


def write_text(path: Path, text: str) -> None:
    """A text file, in one move."""
    write_safely(path, lambda file: file.write(text.encode("utf-8")))


def write_yaml(path: Path, table: Mapping[str, Any]) -> None:
    """A YAML file, in one move."""
    import yaml

    write_text(path, yaml.safe_dump(dict(table), sort_keys=False, allow_unicode=True))


def write_json(path: Path, value: Any) -> None:
    """A JSON file, in one move."""
    write_text(path, json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def write_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """A CSV file, in one move."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([header, *rows])
    write_text(path, text.getvalue())


def read_json(path: Path) -> Any:
    """The value of a JSON file."""
    return json.loads(path.read_text(encoding="utf-8"))


def read_csv(path: Path, dtype: np.dtype) -> NDArray[np.void]:
    """The columns of a CSV file that ``dtype`` names, as a structured array; an empty number is NaN."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    table = np.zeros(len(rows), dtype)
    for name in dtype.names or ():
        values = [row[name] for row in rows]
        match dtype[name].kind:
            case "b":
                table[name] = [value == "True" for value in values]
            case "f":
                table[name] = [value or "nan" for value in values]
            case _:
                table[name] = values
    return table


def header_of(path: Path) -> list[str]:
    """The names of the columns of a CSV file."""
    with path.open(encoding="utf-8", newline="") as file:
        return next(csv.reader(file))


def _sync_folder(folder: Path) -> None:
    """Make a move outlast a power cut."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
