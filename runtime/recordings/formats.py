"""Which format a file has, by its content and not by its name, and the module that reads it."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path

from runtime.recordings import hdf5, matlab, mcap_file, numpy_files, parquet, sqlite_bag, text
from runtime.recordings.contents import Contents
from runtime.recordings.errors import Refusal
from runtime.recordings.lines import check_file
from runtime.recordings.settings import MAX_BYTES

EXPECTED = "CSV, plain or gzip, or MCAP, a ROS 2 bag, MATLAB, HDF5, Parquet or NumPy"
_HEAD = 1024

Reader = Callable[[Path, Refusal], Contents]

_BY_START: Mapping[bytes, Reader] = {
    mcap_file.MAGIC: mcap_file.opened,
    sqlite_bag.MAGIC: sqlite_bag.opened,
    matlab.MAGIC: matlab.opened,
    hdf5.MATLAB: hdf5.opened,
    hdf5.SIGNATURE: hdf5.opened,
    parquet.MAGIC: parquet.opened,
    numpy_files.NPY: numpy_files.opened,
    numpy_files.ZIP: numpy_files.opened,
}
"""The first bytes of a file -> how its format is read."""

_REFUSED: Mapping[bytes, str] = {
    b"#ROSBAG V": "is a bag of ROS 1; convert it to MCAP with: mcap convert FILE FILE.mcap",
    b"\x28\xb5\x2f\xfd": "is packed with zstd; unpack it first, with: zstd -d FILE",
    b"BZh": "is packed with bzip2; unpack it first",
    b"\xfd7zXZ": "is packed with xz; unpack it first",
    b"\xd0\xcf\x11\xe0": "is an old Excel workbook; save the sheet as CSV",
}


def opened(path: Path, refuse: Refusal) -> Contents:
    """The contents of a recording, its format recognised. Raises RecordingError."""
    if os.path.isdir(path):
        return _folder(path, refuse)
    check_file(path, f"a recording in {EXPECTED}", refuse)
    try:
        with open(path, "rb") as file:
            head = file.read(_HEAD)
    except (OSError, ValueError) as error:
        refuse(f"cannot be read: {getattr(error, 'strerror', None) or error}")
    for start, why in _REFUSED.items():
        if head.startswith(start):
            refuse(why)
    if head[hdf5.AFTER_OTHERS :].startswith(hdf5.SIGNATURE):
        return hdf5.opened(path, refuse)
    reader = next((found for start, found in _BY_START.items() if head.startswith(start)), text.opened)
    return reader(path, refuse)


def _folder(path: Path, refuse: Refusal) -> Contents:
    """A bag of ROS 2 or a data set of LeRobot, which are folders."""
    about = path / "meta" / "info.json"
    if about.is_file() and about.stat().st_size < MAX_BYTES:
        try:
            features = list(json.loads(about.read_text(encoding="utf-8"))["features"])
        except (ValueError, KeyError, TypeError, RecursionError):
            features = []
        parquet.refuse_without_torque(features, refuse)
        refuse("is a folder of a LeRobot data set; name one of the Parquet files in its folder data")
    bags = sorted([*path.glob("*.mcap"), *path.glob("*.db3")])
    if not bags:
        refuse(f"is a directory without a bag of ROS 2; expected a recording in {EXPECTED}")
    if len(bags) > 1:
        listed = ", ".join(bag.name for bag in bags[:4])
        refuse(f"is a bag in {len(bags)} files; name them one by one as recordings: {listed}")
    return opened(bags[0], refuse)
