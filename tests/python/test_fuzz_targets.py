"""The Python fuzz targets on seeded bytes: `make fuzz` looks farther."""

import random

import pytest
from fuzz_targets import TARGETS

# Inputs of each; a command reads files.
COUNTS = {"read_scan": 250, "read_stored": 250, "run_command": 50}


@pytest.mark.parametrize("name", TARGETS)
def test_targets_find_nothing(name: str) -> None:
    rng = random.Random(name)
    for _ in range(COUNTS[name]):
        data = rng.randbytes(rng.choice([8, 16, 24, 40]))
        try:
            TARGETS[name](data)
        except Exception as error:  # noqa: BLE001 - whatever it is, it is a finding
            pytest.fail(f"{name}: bytes.fromhex({data.hex()!r}): {type(error).__name__}: {error}")
