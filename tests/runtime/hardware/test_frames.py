"""The frames' codec on the host: what goes in comes out, in pieces of any length, and noise is counted."""

from __future__ import annotations

import ctypes
import json
import zlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from codegen import prepare
from codegen.firmware.source_tree import machine_files
from runtime.hardware.link import Codec, Decoder, FrameError, cobs_decode, cobs_encode
from symbolic.effects import LIBRARY
from symbolic.model import derive
from symbolic.model_file import reader

ARMS = Path(__file__).resolve().parents[3] / "symbolic" / "arms"
ARM = reader.load(ARMS / "vishard4.toml")
FILES = machine_files(derive(ARM), LIBRARY, {})
CODEC = Codec(json.loads(FILES["protocol.json"]))
NAMES = [item["name"] for item in CODEC.document["messages"]]
VALUES = {
    "u8": st.integers(0, 2**8 - 1),
    "u16": st.integers(0, 2**16 - 1),
    "u32": st.integers(0, 2**32 - 1),
    "i32": st.integers(-(2**31), 2**31 - 1),
    "float": st.floats(width=32, allow_nan=False),
}


@st.composite
def messages(draw: st.DrawFn) -> tuple[str, dict[str, object], int]:
    """A message's name, values and sequence number."""
    item = draw(st.sampled_from(CODEC.document["messages"]))
    values = {
        field["name"]: draw(
            VALUES[field["type"]]
            if field["count"] is None
            else st.lists(VALUES[field["type"]], min_size=field["count"], max_size=field["count"]).map(tuple)
        )
        for field in item["fields"]
    }
    return item["name"], values, draw(st.integers(0, 2**16 - 1))


def pieces(data: bytes, cuts: list[int]) -> list[bytes]:
    at = sorted(cut % (len(data) + 1) for cut in cuts)
    return [data[a:b] for a, b in zip([0, *at], [*at, len(data)], strict=True)]


@given(st.binary(max_size=700))
def test_cobs_has_no_zero_and_loses_nothing(plain: bytes) -> None:
    encoded = cobs_encode(plain)
    assert 0 not in encoded
    assert len(encoded) <= len(plain) + len(plain) // 254 + 1
    assert cobs_decode(encoded) == plain


def test_cobs_as_published() -> None:
    """Examples of the paper of Cheshire and Baker, and the ends of a full block."""
    assert cobs_encode(b"") == b"\x01"
    assert cobs_encode(b"\0") == b"\x01\x01"
    assert cobs_encode(b"\x11\x22\0\x33") == b"\x03\x11\x22\x02\x33"
    block = bytes(range(1, 255))
    assert cobs_encode(block + b"\xff") == b"\xff" + block + b"\x02\xff"
    assert cobs_decode(b"\xff" + block) == cobs_decode(b"\xff" + block + b"\x01") == block
    assert cobs_decode(b"\x05\x11\x22") is None


@given(st.lists(messages(), max_size=5), st.lists(st.integers(0, 10_000), max_size=9))
def test_what_goes_in_comes_out(sent: list[tuple[str, dict[str, object], int]], cuts: list[int]) -> None:
    stream = b"".join(CODEC.encode(*message) for message in sent)
    decoder = Decoder(CODEC)
    found = [message for piece in pieces(stream, cuts) for message in decoder.feed(piece)]
    assert [(m.name, m.values, m.sequence) for m in found] == sent
    assert not decoder.errors


@given(st.lists(st.one_of(st.binary(max_size=300), messages()), max_size=6))
def test_noise_is_counted_and_hides_only_its_neighbours(parts: list[object]) -> None:
    """A message with a delimiter before it comes through whatever was there before."""
    decoder = Decoder(CODEC)
    sent, stream = [], b""
    for part in parts:
        stream += b"\0" + (part if isinstance(part, bytes) else CODEC.encode(*part))
        sent += [] if isinstance(part, bytes) else [part]
    assert [(m.name, m.values, m.sequence) for m in decoder.feed(stream)] == sent


def test_noise_without_an_end_is_one_error() -> None:
    decoder = Decoder(CODEC)
    for _ in range(100):
        assert decoder.feed(b"\x55" * 100) == []
    assert decoder.feed(b"\0" + CODEC.encode("hello"))[0].name == "hello"
    assert decoder.errors == {"bad_frame": 1}


def test_errors_by_kind() -> None:
    def framed(*head: int) -> bytes:
        return cobs_encode(bytes(head) + zlib.crc32(bytes(head)).to_bytes(4, "little"))

    hello = CODEC.number("hello")
    assert CODEC.decode(framed(1, hello, 7, 0, 0, 0)).sequence == 7
    assert CODEC.decode(framed(9, hello, 7, 0, 0, 0)).name == "hello", "the same in every version"
    assert CODEC.decode(framed(9, CODEC.number("stop"), 7, 0, 0, 0)) == "bad_header"
    assert CODEC.decode(framed(1, hello, 7, 0, 1, 0)) == "bad_header"
    assert CODEC.decode(framed(1, hello, 7, 0, 1, 0, 5)) == "unknown", "of another size"
    assert CODEC.decode(framed(1, 99, 7, 0, 0, 0)) == "unknown"
    assert CODEC.decode(framed(1, hello, 7, 0, 0)) == "bad_frame"
    assert CODEC.decode(framed(1, hello, 7, 0, 0, 0)[:-1] + b"\x77") == "bad_crc"


def test_what_does_not_fill_a_message_is_named() -> None:
    with pytest.raises(FrameError, match='no message "go"; there are: hello, parameters'):
        CODEC.encode("go")
    with pytest.raises(FrameError, match="run has the fields periods, every; every is missing or unknown"):
        CODEC.encode("run", {"periods": 1})
    with pytest.raises(FrameError, match="run has the fields periods, every; evry is missing or unknown"):
        CODEC.encode("run", {"periods": 1, "every": 1, "evry": 1})
    with pytest.raises(FrameError, match="points: values has 32 values, not 3"):
        CODEC.encode("points", {"first_row": 0, "values": [1, 2, 3]})
    with pytest.raises(FrameError, match="run: "):
        CODEC.encode("run", {"periods": -1, "every": 1})


def test_a_record_a_millisecond_fits_one_megabaud() -> None:
    """10 bits a byte, 1000 records a second, room for what else there is to say."""
    values = {name: 0 if count is None else [0] * count for name, count in CODEC.fields("telemetry").items()}
    longest = max(len(CODEC.encode("telemetry", values | {"period": p, "time_us": p})) for p in (0, 0x7F7F7F7F))
    assert longest * 10 * 1000 < 0.8e6


def test_the_example_of_the_page() -> None:
    """Of PROTOCOL.md: a frame in hexadecimal, before and after the stuffing."""
    plain, wire = (
        bytes.fromhex(line.split(maxsplit=1)[1])
        for line in FILES["PROTOCOL.md"].splitlines()
        if line.startswith(("    plain ", "    wire "))
    )
    assert wire == CODEC.encode("run", {"periods": 2000, "every": 1}, 5)
    assert cobs_decode(wire[:-1]) == plain


def test_the_page_has_everything_of_the_table() -> None:
    page = FILES["PROTOCOL.md"]
    for item in CODEC.document["messages"]:
        assert f"### {item['name']}: {item['number']}, {item['size']} bytes" in page
        for field in item["fields"]:
            assert f"| {field['name']} | {field['type']}" in page
    for table in ("states", "reasons", "results"):
        for item in CODEC.document[table]:
            assert f"| {item['number']} | {item['name']} |" in page


# --- the same in C ---

C_TYPES = {
    "u8": ctypes.c_uint8,
    "u16": ctypes.c_uint16,
    "u32": ctypes.c_uint32,
    "i32": ctypes.c_int32,
    "float": ctypes.c_float,
}


@pytest.fixture(scope="module")
def compiled() -> ctypes.CDLL:
    return ctypes.CDLL(str(prepare.prepare_firmware(ARM, LIBRARY) / "lib.so"))


def record(name: str) -> ctypes.Structure:
    """The message's struct, as C lays it out."""
    item = next(m for m in CODEC.document["messages"] if m["name"] == name)
    fields = [
        (f["name"], C_TYPES[f["type"]] * f["count"] if f["count"] else C_TYPES[f["type"]]) for f in item["fields"]
    ]
    return type(name, (ctypes.Structure,), {"_fields_": fields})()


@given(message=messages())
def test_c_and_python_pack_the_same(compiled: ctypes.CDLL, message: tuple[str, dict[str, object], int]) -> None:
    """A command that Python packs is unpacked by C; a report that C packs is what Python packs."""
    name, values, _ = message
    if not values:
        return
    own = record(name)
    if CODEC.number(name) < 0x80:
        payload = CODEC.payload(name, values)
        getattr(compiled, f"tendon_unpack_{name}")(payload, ctypes.byref(own))
        for key, value in values.items():
            found = getattr(own, key)
            assert (tuple(found) if isinstance(value, tuple) else found) == value
    else:
        for key, value in values.items():
            setattr(own, key, value)
        room = ctypes.create_string_buffer(256)
        getattr(compiled, f"tendon_pack_{name}")(ctypes.byref(own), room)
        payload = CODEC.payload(name, values)
        assert room.raw[: len(payload)] == payload


@given(plain=st.binary(max_size=700), crc=st.integers(0, 2**32 - 1))
def test_c_and_python_frame_the_same(compiled: ctypes.CDLL, plain: bytes, crc: int) -> None:
    room = ctypes.create_string_buffer(len(plain) + len(plain) // 254 + 2)
    made = compiled.tendon_cobs_encode(plain, ctypes.c_uint32(len(plain)), room)
    assert room.raw[:made] == cobs_encode(plain) + b"\0"
    compiled.tendon_crc32.restype = ctypes.c_uint32
    assert compiled.tendon_crc32(ctypes.c_uint32(crc), plain, ctypes.c_uint32(len(plain))) == zlib.crc32(plain, crc)


class InC(ctypes.Structure):
    """tendon_decoder."""

    _fields_ = [("count", ctypes.c_uint32), ("left", ctypes.c_uint32), *((k, ctypes.c_bool) for k in ("a", "b", "c"))]


@given(stream=st.lists(st.sampled_from([0, 0, 1, 2, 3, 5, 254, 255]) | st.integers(0, 255), max_size=600).map(bytes))
def test_c_and_python_decode_the_same(compiled: ctypes.CDLL, stream: bytes) -> None:
    """Whatever comes: the same frames, and the same ones refused; what is too long is."""
    most, decoder = 300, InC()
    room = (ctypes.c_uint8 * most)()
    found: list[bytes | None] = []
    for byte in stream:
        event = compiled.tendon_decoder_put(ctypes.byref(decoder), room, ctypes.c_uint32(most), ctypes.c_uint8(byte))
        if event:
            found.append(bytes(room[: decoder.count]) if event == 1 else None)
    frames = [cobs_decode(frame) for frame in stream.split(b"\0")[:-1] if frame]
    assert found == [frame if frame is not None and len(frame) <= most else None for frame in frames]


def test_the_same_codec_from_a_file(tmp_path: Path) -> None:
    (tmp_path / "protocol.json").write_text(FILES["protocol.json"])
    assert Codec.from_json(tmp_path / "protocol.json").encode("stop", sequence=5) == CODEC.encode("stop", sequence=5)
