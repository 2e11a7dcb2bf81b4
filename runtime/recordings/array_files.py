"""Recordings as arrays of one or two dimensions, a column for each joint: HDF5, MATLAB, NumPy and Parquet."""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from struct import error as StructError
from struct import unpack
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from runtime.recordings.contents import Array, RecordedField, Refusal, Samples, require
from runtime.recordings.settings import LARGEST_MATRIX, LEAST_SIGNAL, MAX_BYTES, MOST_FIELDS

_TIMES = re.compile(r"(t|time|timestamp|stamp)s?(\d?|_.*)", re.IGNORECASE)
"""The last part of the name of a variable that is a time."""
_WHOLE_IN_FLOAT = 2**53


@dataclass(frozen=True)
class Variable:
    """An array in a file, before it is read.

    name    with the names of its groups or structs before it, separated by "." or "/"
    shape   as the file states it
    load    reads the whole array
    """

    name: str
    shape: tuple[int, ...]
    load: Callable[[], NDArray[Any]]

    @property
    def along(self) -> int:
        """The axis of the samples, the longer one."""
        return int(np.argmax(self.shape))

    @property
    def samples(self) -> int:
        return max(self.shape)

    @property
    def width(self) -> int:
        """Number of its columns."""
        return min(self.shape) if len(self.shape) == 2 else 1

    @property
    def is_signal(self) -> bool:
        """Whether its shape is that of samples of joints."""
        return len(self.shape) in (1, 2) and self.samples >= LEAST_SIGNAL and 0 < self.width <= LARGEST_MATRIX

    @property
    def place(self) -> str:
        """See RecordedField.place."""
        return f"{self.name} {'column' if self.along else 'row' if len(self.shape) == 2 else 'sample'}"

    @property
    def home(self) -> str:
        """The group or struct that contains it."""
        return re.match(r"(.*?)[^./]*$", self.name, re.DOTALL)[1].rstrip("./")  # type: ignore[index]


@dataclass(frozen=True)
class ArrayContents:
    """Variables whose columns are fields: q (N, 6) is q1 to q6. A variable called time is the clock of its group."""

    format: str
    variables: Sequence[Variable]
    refuse: Refusal
    header: str = ""
    torque: str = ""
    notes: Sequence[str] = ()

    @cached_property
    def columns(self) -> list[tuple[Variable, int, str]]:
        """Variable, column and name of each field."""
        found = []
        for variable in self.variables:
            if variable.is_signal:
                between = "_" if variable.name[-1:].isdigit() else ""
                many = range(1, variable.width + 1) if variable.width > 1 else ()
                names = [f"{variable.name}{between}{k}" for k in many] or [variable.name]
                found += [(variable, k, name) for k, name in enumerate(names)]
        if len(found) > MOST_FIELDS:
            self.refuse(f"has {len(found)} columns; expected at most {MOST_FIELDS}")
        if not found:
            named = ", ".join(f"{v.name} {v.shape}" for v in self.variables[:8])
            self.refuse(
                f"has no variable of one or two dimensions with samples of joints; it has {named or 'no variables'}"
            )
        return found

    @cached_property
    def _timed(self) -> dict[tuple[str, int], Variable]:
        """(group, number of samples) -> the variable with the time."""
        found: dict[tuple[str, int], Variable] = {}
        for variable in self.variables:
            last = variable.name[len(variable.home) :].lstrip("./")
            if variable.is_signal and variable.width == 1 and _TIMES.fullmatch(last):
                found.setdefault((variable.home, variable.samples), variable)
        return found

    def _clock(self, variable: Variable) -> str:
        """The time of the same length in the innermost group around a variable, else its number of samples."""
        home = variable.home
        while True:
            if time := self._timed.get((home, variable.samples)):
                return time.name
            if not home:
                return f"{variable.samples} samples"
            home = re.sub(r"[./]?[^./]*$", "", home)

    @cached_property
    def fields(self) -> tuple[RecordedField, ...]:
        return tuple(RecordedField(name, self._clock(v), v.place) for v, _, name in self.columns)

    @cached_property
    def times(self) -> Mapping[str, int]:
        places = {name: index for index, (_, _, name) in enumerate(self.columns)}
        return {time.name: places[time.name] for time in self._timed.values()}

    def load(self, wanted: Mapping[str, int]) -> Samples:
        read: dict[str, Array] = {}
        signals: dict[str, Array] = {}
        for name, index in wanted.items():
            variable, column, _ = self.columns[index]
            if variable.name not in read:
                read[variable.name] = self._read(variable, sum(x.nbytes for x in read.values()))
            signals[name] = np.ascontiguousarray(read[variable.name][column])
        length = max(len(x) for x in signals.values())
        places = {name: self.fields[index].place for name, index in wanted.items()}
        return Samples(signals, np.arange(1, length + 1), places)

    def _read(self, variable: Variable, beside: int) -> Array:
        """(columns, N) of a variable; integers too large for a float count from the first."""
        size = 8 * int(np.prod([float(n) for n in variable.shape])) + beside
        if size > MAX_BYTES:
            self.refuse(f"{variable.name} has {variable.shape} numbers; expected at most {MAX_BYTES // 10**9} GB")
        values = variable.load()
        if values.shape != variable.shape:
            self.refuse(
                f"{variable.name} has {values.shape} numbers, and the file states {variable.shape}; copy the file again"
            )
        if values.dtype.kind in "mM":
            values = values.astype("datetime64[ns]" if values.dtype.kind == "M" else "timedelta64[ns]")
            return (values.reshape(1, -1) - values.flat[0]).astype(np.int64) * 1e-9
        if values.dtype.kind in "iu" and np.abs(values.astype(np.float64)).max() > _WHOLE_IN_FLOAT:
            values = values - values.flat[0]
        rows = values.reshape(variable.samples, -1).T if variable.along == 0 else values.reshape(-1, variable.samples)
        return np.asarray(rows, dtype=np.float64)


def _is_numeric(dtype: np.dtype[Any]) -> bool:
    return dtype.kind in "biufmM"


def _numeric(name: str, shape: Sequence[int], dtype: np.dtype[Any], load: Callable[[], Any]) -> list[Variable]:
    """An array as a variable if it is numeric; of a compound type, each numeric member."""

    def member(part: str) -> NDArray[Any]:
        return np.asarray(load()[part])

    size = tuple(int(n) for n in shape)
    if dtype.names:
        return [Variable(f"{name}.{p}", size, partial(member, p)) for p in dtype.names if _is_numeric(dtype[p])]
    return [Variable(name, size, load)] if _is_numeric(dtype) else []


HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
MATLAB_7_3 = b"MATLAB 7.3"
_HDF5_ERRORS = (OSError, RuntimeError, ValueError, KeyError, TypeError, OverflowError, MemoryError)
HDF5_USER_BLOCK = 512
"""Position of the signature in a file that begins with a block of another program."""


def open_hdf5(path: Path, refuse: Refusal) -> ArrayContents:
    """The datasets of an HDF5 file; links to other files are ignored. Raises RecordingError."""
    require("h5py", "hdf5", "HDF5, and MATLAB since 7.3,", refuse)
    import h5py

    variables: list[Variable] = []
    with open(path, "rb") as begin:
        matlab = begin.read(len(MATLAB_7_3)) == MATLAB_7_3

    def visit(name: str, node: Any) -> bool | None:
        # Datasets of this file that are not text.
        plain = isinstance(node, h5py.Dataset) and not node.is_virtual and not node.external
        if plain and node.attrs.get("MATLAB_class") != b"char" and not name.startswith("#"):
            shown, load = name.replace("/", ".") if matlab else name, partial(_load_hdf5, path, name, refuse)
            variables.extend(_numeric(shown, node.shape or (), node.dtype, load))
        return True if len(variables) > MOST_FIELDS else None

    with refuse.on(_HDF5_ERRORS, "the HDF5 file is damaged or cut off", "copy it again"), h5py.File(path, "r") as file:
        file.visititems(visit)
        stated = _as_text(file.attrs.get(_MEANING, ""))
    return ArrayContents("MATLAB 7.3" if matlab else "HDF5", variables, refuse, torque=stated)


_MEANING = "torque"
"""The attribute or variable that says what torques are."""


def _as_text(value: Any) -> str:
    entry = value.flat[0] if isinstance(value, np.ndarray) and value.size == 1 else value
    return (
        entry.decode("utf-8", "replace") if isinstance(entry, bytes) else str(entry) if isinstance(entry, str) else ""
    )


def _load_hdf5(path: Path, name: str, refuse: Refusal) -> NDArray[Any]:
    import h5py

    with refuse.on(_HDF5_ERRORS, f"{name} is damaged or cut off", "copy the file again"), h5py.File(path, "r") as file:
        return np.asarray(file[name][()])


MATLAB_5 = b"MATLAB 5.0"
_MATLAB_HEADER = 128
_COMPRESSED = 15
_DEEPEST = 8
_PIECE = 1 << 20


def open_matlab(path: Path, refuse: Refusal) -> ArrayContents:
    """The numeric variables of a .mat file. Raises RecordingError."""
    from scipy.io import loadmat

    _check_lengths(path, refuse)
    # SciPy raises exceptions of many types on damaged files.
    with refuse.on((Exception,), "the MATLAB file is damaged", "save it again"):
        variables = loadmat(path, struct_as_record=True, squeeze_me=False)
    found: list[Variable] = []
    for name, value in variables.items():
        if not name.startswith("__"):
            found += _within(name, value, _DEEPEST)
    if len(found) > MOST_FIELDS:
        refuse(f"has {len(found)} variables; expected at most {MOST_FIELDS}")
    return ArrayContents("MATLAB", found, refuse, torque=_as_text(variables.get(_MEANING, "")))


def _within(name: str, value: Any, depth: int) -> Iterator[Variable]:
    """The numeric arrays in a value, also in nested structs."""
    if not isinstance(value, np.ndarray) or depth == 0:
        return
    if value.dtype.names:
        for k, entry in enumerate(value.flat):
            element = name if value.size == 1 else f"{name}({k + 1})"
            for part in value.dtype.names:
                yield from _within(f"{element}.{part}", entry[part], depth - 1)
    elif _is_numeric(value.dtype):
        shape = tuple(n for n in value.shape if n != 1) or (1,)
        yield Variable(name, shape, partial(value.reshape, shape))


def _check_lengths(path: Path, refuse: Refusal) -> None:
    """Refuses a file that is cut off or decompresses to more than MAX_BYTES, before SciPy reads it."""
    size, total = path.stat().st_size, 0
    damage = (StructError, zlib.error)
    with refuse.on(damage, "the MATLAB file is damaged or cut off", "copy it again"), open(path, "rb") as file:
        order = "<" if file.read(_MATLAB_HEADER)[-2:] == b"IM" else ">"
        while file.tell() < size:
            kind, length = unpack(f"{order}II", file.read(8))
            end = file.tell() + length
            if end > size:
                refuse("the MATLAB file is cut off; copy it again")
            total += _unpacked_size(file.read(length)) if kind == _COMPRESSED else length
            if total > MAX_BYTES:
                refuse(f"the MATLAB file decompresses to more than {MAX_BYTES // 10**9} GB; save only what is needed")
            file.seek(end)


def _unpacked_size(data: bytes) -> int:
    """Number of bytes of a decompressed element, counted up to the limit without keeping them."""
    inflate, total, left = zlib.decompressobj(), 0, data
    while left and total <= MAX_BYTES:
        total += len(inflate.decompress(left, _PIECE))
        left = inflate.unconsumed_tail
    return total


NPY = b"\x93NUMPY"
ZIP = b"PK\x03\x04"
_NUMPY_ERRORS = (ValueError, EOFError, KeyError, OSError, zipfile.BadZipFile, zlib.error, RuntimeError, MemoryError)
_ALONE = "column"
"""Name of the array in a .npy file, which has no names."""


def open_numpy(path: Path, refuse: Refusal) -> ArrayContents:
    """The arrays of a .npy or .npz file. Raises RecordingError."""
    with refuse.on(_NUMPY_ERRORS, "the NumPy file is damaged or cut off", "copy it again"), open(path, "rb") as file:
        alone = file.read(len(NPY)) == NPY
        file.seek(0)
        if alone:
            load = partial(_load_numpy, path, None, refuse)
            return ArrayContents("NumPy", _described(_ALONE, file, load, refuse), refuse)
        archive = zipfile.ZipFile(file)
        members = archive.infolist()
        if any(m.filename.startswith("xl/") for m in members):
            refuse("is an Excel workbook; save the sheet as CSV")
        members = [m for m in members if m.filename.endswith(".npy")]
        if not members:
            refuse("is a ZIP archive without NumPy arrays; unpack the recording first")
        if len(members) > MOST_FIELDS:
            refuse(f"has {len(members)} arrays; expected at most {MOST_FIELDS}")
        found, stated = list[Variable](), ""
        for member in members:
            name = member.filename.removesuffix(".npy")
            load = partial(_load_numpy, path, name, refuse)
            with archive.open(member) as inner:
                described = _described(name, inner, load, refuse, length=member.file_size)
            found += described
            if name == _MEANING and not described:
                stated = _as_text(load())
        return ArrayContents("NumPy", found, refuse, torque=stated)


def _described(
    name: str, file: IO[bytes], load: Callable[[], Any], refuse: Refusal, length: int | None = None
) -> list[Variable]:
    """The numeric arrays after a header. length: of the file in bytes, as the archive states it."""
    version = npy.read_magic(file)
    read_header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read_header(file)
    size = int(np.prod([float(n) for n in shape])) * dtype.itemsize
    if size > MAX_BYTES or (length is not None and size > length):
        refuse(
            f"{name} states {shape} numbers, more than the file holds, or over {MAX_BYTES // 10**9} GB; save it again"
        )
    return _numeric(name, shape, dtype, load)


def _load_numpy(path: Path, name: str | None, refuse: Refusal) -> NDArray[Any]:
    with refuse.on(_NUMPY_ERRORS, "the NumPy file is damaged or cut off", "copy it again"):
        found = np.load(path)
        return np.asarray(found if name is None else found[name])


PARQUET = b"PAR1"


def open_parquet(path: Path, refuse: Refusal) -> ArrayContents:
    """The columns of a Parquet file. Raises RecordingError."""
    require("pyarrow", "parquet", "Parquet", refuse)
    from pyarrow import ArrowException, parquet

    damage = (ArrowException, OSError, ValueError, MemoryError)
    with (
        refuse.on(damage, "the Parquet file is damaged or cut off", "copy it again"),
        parquet.ParquetFile(path) as file,
    ):
        schema, rows = file.schema_arrow, file.metadata.num_rows
        if len(schema) > MOST_FIELDS:
            refuse(f"has {len(schema)} columns; expected at most {MOST_FIELDS}")
        widths = [_width(file, entry) for entry in schema]
        stated = _as_text((schema.metadata or {}).get(_MEANING.encode(), ""))
    variables = [
        Variable(name, (rows,) if width is None else (rows, width), partial(_load_parquet, path, name, refuse))
        for name, width in zip(schema.names, widths, strict=True)
        if width != 0
    ]
    return ArrayContents("Parquet", variables, refuse, torque=stated)


def _width(file: Any, entry: Any) -> int | None:
    """None for a column of numbers, else how many numbers each row lists; 0 for other columns."""
    from pyarrow import types

    kind = entry.type
    if types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind) or types.is_temporal(kind):
        return None
    if types.is_fixed_size_list(kind) and types.is_floating(kind.value_type):
        return int(kind.list_size)
    if types.is_list(kind) and types.is_floating(kind.value_type):
        first = next(file.iter_batches(batch_size=1, columns=[entry.name]), None)
        size = 0 if first is None or not len(first) else len(first.column(0)[0].as_py() or ())
        return size if size <= LARGEST_MATRIX else 0
    return 0


def _load_parquet(path: Path, name: str, refuse: Refusal) -> NDArray[Any]:
    from pyarrow import ArrowException, parquet, types

    damage = (ArrowException, OSError, ValueError, MemoryError)
    with refuse.on(damage, f"{name} is damaged, or its rows differ in length", "write the file again"):
        column = parquet.read_table(path, columns=[name]).column(0).combine_chunks()
        if types.is_fixed_size_list(column.type) or types.is_list(column.type):
            values = column.flatten().to_numpy(zero_copy_only=False)
            return np.asarray(values).reshape(len(column), -1)
        return np.asarray(column.to_numpy(zero_copy_only=False))
