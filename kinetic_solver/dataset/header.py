"""How long a classic netCDF file must be, by its own header (the format's specification, CDF-1, 2 and 5).

The library reads zeros beyond the end of a file, so one that was cut short looks whole.
"""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import BinaryIO

SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 4, 6: 8, 7: 1, 8: 2, 9: 4, 10: 8, 11: 8}
"""Bytes of a value of each type: byte, char, short, int, float, double, and the unsigned and long ones of CDF-5."""


def needed_bytes(path: Path) -> int | None:
    """Up to the end of the last value that the header speaks of; None where the file is no classic netCDF.

    Raises struct.error where the header itself is cut short.
    """
    with path.open("rb") as file:
        magic = file.read(4)
        return _Header(file, magic[3]).needed() if magic[:3] == b"CDF" and magic[3:] in (b"\1", b"\2", b"\5") else None


class _Header:
    def __init__(self, file: BinaryIO, version: int) -> None:
        self._file = file
        self._count = ">q" if version == 5 else ">i"
        """The form of numbers of elements, and of places in the file."""
        self._place = ">i" if version == 1 else ">q"

    def _number(self, form: str) -> int:
        return int(struct.unpack(form, self._file.read(struct.calcsize(form)))[0])

    def _skip(self, size: int) -> None:
        self._file.seek(-(-size // 4) * 4, 1)

    def _entries(self) -> range:
        """Of a list of dimensions, attributes or variables: its tag, and how many there are."""
        self._number(">i")
        return range(self._number(self._count))

    def _attributes(self) -> None:
        for _ in self._entries():
            self._skip(self._number(self._count))
            size = SIZES.get(self._number(">i"), 0)
            self._skip(size * self._number(self._count))

    def needed(self) -> int:
        records = self._number(self._count)
        lengths = []
        for _ in self._entries():
            self._skip(self._number(self._count))
            lengths.append(self._number(self._count))
        self._attributes()
        last, growing, record = 0, [], 0
        for _ in self._entries():
            self._skip(self._number(self._count))
            shape = [lengths[self._number(self._count)] for _ in range(self._number(self._count))]
            self._attributes()
            size = SIZES.get(self._number(">i"), 0) * math.prod(n for n in shape if n)
            padded, begin = self._number(self._count), self._number(self._place)
            if 0 in shape:  # the dimension that grows
                growing.append((begin, size))
                record += padded
            else:
                last = max(last, begin + size)
        if records > 0 and growing:
            if len(growing) == 1:
                record = growing[0][1]  # a single one is not padded
            last = max(last, max(begin + size for begin, size in growing) + (records - 1) * record)
        return last
