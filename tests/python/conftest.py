"""Hypothesis profiles, and the folder that command lines run in.

By default Hypothesis draws the same examples in every run. HYPOTHESIS_PROFILE=random draws new ones, or those of
--hypothesis-seed; HYPOTHESIS_PROFILE=thorough draws many more.
"""

import os
import signal
from pathlib import Path
from unittest.mock import patch

import pytest
from hypothesis import HealthCheck, settings

with patch.dict(
    os.environ, OPENBLAS_NUM_THREADS="1"
):  # small matrices are quicker so; children keep the default
    import numpy as np  # noqa: F401 - it reads the variable once

TOO_MUCH = [HealthCheck.too_slow, HealthCheck.data_too_large]
settings.register_profile(
    "default",
    max_examples=60,
    deadline=None,
    suppress_health_check=TOO_MUCH,
    derandomize=True,
    print_blob=True,
)
settings.register_profile("random", settings.get_profile("default"), derandomize=False)
settings.register_profile("thorough", settings.get_profile("random"), max_examples=1000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    # Started in the background: the processes that tests interrupt would inherit the deafness.
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run command lines in an empty folder, of 80 columns."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("COLUMNS", raising=False)
    return tmp_path


@pytest.fixture
def log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the file that `benchmark_fakes` writes a line to for each call."""
    path = tmp_path / "calls.log"
    path.touch()
    monkeypatch.setenv("FAKES_LOG", str(path))
    return path
