"""No reading is made up and memory stays flat under every fault: for seconds here, for half an hour by `make soak`."""

import pytest
from soak import soak
from soak_devices import arrays_at, crc16_modbus, singletact_at


def holds(result):
    for found in result.devices.values():
        assert found.error == ""
        assert found.invented == []
        assert found.readings > 5


@pytest.mark.long
def test_some_seconds_of_faults_make_no_reading_up(tmp_path):
    result = soak(5.0, tmp_path, often=8.0)
    print(result)
    holds(result)
    arrays, bridge = result.devices["arrays"], result.devices["bridge"]
    assert min(found.counters["reconnects"] for found in (arrays, bridge)) >= 1
    # The faults took place and were noticed.
    assert arrays.counters["unpaired"] > 0
    assert arrays.counters["garbage_bytes"] > 0
    assert bridge.counters["garbage_bytes"] > 0


@pytest.mark.soak
def test_half_an_hour_of_faults_makes_no_reading_up(tmp_path, soak_minutes):
    result = soak(60.0 * soak_minutes, tmp_path)
    print(f"\n{result}")
    holds(result)
    for name in ("restart", "same frame again", "unplugged"):
        assert result.devices["arrays"].faults[name] > 0
    arrays, bridge = result.devices["arrays"], result.devices["bridge"]
    assert bridge.counters["stale"] > 0
    assert arrays.readings > 100 * result.seconds
    assert bridge.readings > 4 * result.seconds
    for found in (arrays, bridge):  # each lost link came back
        assert found.counters["reconnects"] >= 0.5 * found.faults["unplugged"]
    assert result.reading
    assert result.memory_kb[1] - result.memory_kb[0] < 2000  # kB, in 20 minutes of 30
    assert result.blocks[1] - result.blocks[0] < 2000  # one a hundred readings would be eight thousand


def test_the_devices_of_the_soak_say_what_they_should():
    assert crc16_modbus(b"123456789") == 0x4B37  # the check value of CRC-16/MODBUS
    values = arrays_at(0x123456)
    assert values[0:3] == values[3:6] == [0x0, 0x123, 0x456]
    assert len({tuple(arrays_at(moment)) for moment in range(100)}) == 100
    assert max(max(singletact_at(moment)) for moment in range(100)) > 1000
    changed = sum(a != b for a, b in zip(arrays_at(7), arrays_at(8), strict=True))
    assert changed >= 30
