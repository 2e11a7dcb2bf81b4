"""Types of arrays, and arrays that are computed once."""

from collections.abc import Callable, Hashable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Key = tuple[Hashable, ...]


class Once:
    """Arrays by what they are of, each computed when it is first asked for; a key says all on which its array hangs."""

    def __init__(self) -> None:
        self._kept: dict[Key, Array] = {}

    def of(self, keys: Sequence[Key], make: Callable[[Sequence[Key]], Mapping[Key, Array]]) -> list[Array]:
        """The arrays of keys; make: those of keys that are absent, and any others that come with them."""
        absent = [key for key in dict.fromkeys(keys) if key not in self._kept]
        if absent:
            self._kept.update(make(absent))
        return [self._kept[key] for key in keys]

    def one(self, key: Key, make: Callable[[], Array]) -> Array:
        """The array of one key."""
        return self.of([key], lambda _: {key: make()})[0]
