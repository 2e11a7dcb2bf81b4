"""Work of many parts: in order, told to who listens, ended by an exception."""

from __future__ import annotations

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.progress import Progress, heard_by, of_each


@given(st.lists(st.integers(0, 5), max_size=30))
def test_results_come_in_the_order_of_the_parts(parts: list[int]) -> None:
    assert of_each("squares", lambda part: part * part, parts) == [part * part for part in parts]


def test_every_part_is_told_and_the_time_left_falls_to_nothing() -> None:
    told: list[Progress] = []
    with heard_by(told.append):
        of_each("waits", lambda _: time.sleep(0.01), range(8))
    of_each("unheard", str, range(3))
    assert [(p.what, p.done, p.parts) for p in told] == [("waits", k, 8) for k in range(1, 9)]
    assert told[0].left > 0.0 == told[-1].left


def test_an_exception_ends_the_work() -> None:
    def fails(part: int) -> int:
        if part == 2:
            raise ValueError("two")
        return part

    with pytest.raises(ValueError, match="two"):
        of_each("parts", fails, range(5))
