"""The checksums that simple devices put behind their frames: functions from bytes to an integer."""

from __future__ import annotations

import binascii
import zlib
from collections.abc import Callable
from functools import reduce
from operator import xor


def _crc_table(polynomial: int) -> tuple[int, ...]:
    """Tabulate a reflected CRC's 256 steps."""

    def step(value: int) -> int:
        for _ in range(8):
            value = (value >> 1) ^ (polynomial if value & 1 else 0)
        return value

    return tuple(step(byte) for byte in range(256))


_MODBUS = _crc_table(0xA001)  # x^16 + x^15 + x^2 + 1, reflected


def crc16_modbus(data: bytes) -> int:
    """Compute CRC-16/MODBUS: reflected 0x8005 from 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        crc = (crc >> 8) ^ _MODBUS[(crc ^ byte) & 0xFF]
    return crc


# name: (bytes that it takes, function)
CHECKSUMS: dict[str, tuple[int, Callable[[bytes], int]]] = {
    "sum8": (1, lambda data: sum(data) & 0xFF),
    "xor8": (1, lambda data: reduce(xor, data, 0)),
    "lrc8": (1, lambda data: -sum(data) & 0xFF),  # of Modbus ASCII: all bytes and it sum to 0
    "sum16": (2, lambda data: sum(data) & 0xFFFF),
    "crc16-modbus": (2, crc16_modbus),
    "crc16-ccitt": (2, lambda data: binascii.crc_hqx(data, 0xFFFF)),
    "crc16-xmodem": (2, lambda data: binascii.crc_hqx(data, 0)),
    "crc32": (4, lambda data: zlib.crc32(data)),
}
